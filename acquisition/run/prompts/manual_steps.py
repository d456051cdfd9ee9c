"""The manual steps before a reading: seat the only SMR, aim the tracker, attach the ballbar.

    one SMR    asked before the approach: people at the robot void it, so it is made after they have gone
    aim        at the nests, where the tracker's interface knows no names (emScon)
    ballbar    asked while the robot is in the pose: with the bar on it there is no approach, it would tear the
               bar off. The robot leaves a pose only after somebody has said that the bar is off

The confirmation of a person is checked with the next reading (`run.checks.repeated_point`; the stroke of the bar). The
present set-up is only known within one execution: a new one asks again.
"""

from __future__ import annotations

from collections.abc import Callable

from acquisition.cell.cell import Bar, Cell, bar_for
from acquisition.cell.picture import scene
from acquisition.record.store import PlannedReading
from acquisition.run.prompts.picture import Ask, PromptPicture
from drivers.interfaces import Answer


class ManualSteps:
    """The manual steps of one execution.

    `ask` asks a person; `lost` returns whether the beam cannot be sent to a nest.
    """

    def __init__(self, cell: Cell, ask: Ask, lost: Callable[[PlannedReading], bool]) -> None:
        self._ask, self._lost = ask, lost
        self._one_smr = cell.instrument.one_smr
        self._aimed = not cell.instrument.declared.finds_by_name
        self._ballbar = cell.instrument.declared.measures_lengths
        self._cell = cell
        self._seated: str | None = None
        self._spanned: tuple[str, str] | None = None  # base ball and tool ball
        self._free = False  # nothing hangs on the robot

    def doubt(self) -> None:
        """Ask again for everything that a person has set up, because it may have been changed."""
        self._seated = self._spanned = None
        self._free = False

    def seat(self, planned: PlannedReading) -> Answer:
        """Have the SMR seated in the nest of the reading, if there is only one SMR."""
        if not self._one_smr or self._seated == planned.target:
            return Answer.CONFIRM
        seat = PromptPicture(f"seat/{planned.target}")
        answer = self._ask(f"Seat the SMR in {planned.target} and press confirm.", seat)
        if answer is Answer.CONFIRM:
            self._seated = planned.target
        return answer

    def aim(self, planned: PlannedReading) -> Answer:
        """Have the beam aimed at the SMR of a nest."""
        if not self._aimed or planned.visit.kind != "nest" or not self._lost(planned):
            return Answer.CONFIRM
        return self._ask(
            f"Aim the tracker at the SMR in {planned.target} and press confirm.",
            PromptPicture(f"aim/{planned.target}"),
        )

    def free(self, planned: PlannedReading) -> Answer:
        """Have the ballbar removed, because the robot goes to the pose of the reading next."""
        if not self._ballbar or self._free:
            return Answer.CONFIRM
        answer = self._ask(
            f"Take the ballbar off, step back and press confirm: the robot moves to {planned.visit.name}.",
            PromptPicture("off", self._drawing(planned, None)),
        )
        if answer is Answer.CONFIRM:
            self._free, self._spanned = True, None
        return answer

    def span(self, planned: PlannedReading) -> Answer:
        """Have the ballbar attached between the balls of the reading."""
        if planned.base_target is None or self._spanned == (planned.base_target, planned.target):
            return Answer.CONFIRM
        self._free, self._spanned = False, None
        answer = self._ask(
            f"Attach the ballbar between {planned.base_target} and {planned.target} and press confirm: it must then "
            f"read {bar_for(self._cell, planned.target, planned.base_target).length_mm:g} mm, give or take its stroke.",
            PromptPicture(
                f"span/{planned.base_target}/{planned.target}",
                self._drawing(planned, (planned.base_target, planned.target)),
            ),
        )
        if answer is Answer.CONFIRM:
            self._spanned = (planned.base_target, planned.target)
        return answer

    def zero(self, bar: Bar | None) -> Answer:
        """Have the ballbar put into its calibrator.

        If `bar` is given, it is built to that length before.
        """
        self._spanned = None
        if bar is not None:
            return self._ask(
                f"Build {bar.in_words()}. Put it into its calibrator for that length and press confirm: "
                "its zero is read there.",
                PromptPicture("calibrator"),
            )
        return self._ask(
            "Put the ballbar into its calibrator and press confirm: its zero is read there, it drifts by micrometres.",
            PromptPicture("calibrator"),
        )

    def _drawing(self, planned: PlannedReading, now: tuple[str, str] | None) -> str:
        """Draw the pose of a reading with its legs, or two balls of one body."""
        visit = planned.visit
        legs = [(base, target) for target, base in visit.readings if base is not None]
        return scene(self._cell, visit.joints_deg or None, legs if visit.joints_deg else (), now)
