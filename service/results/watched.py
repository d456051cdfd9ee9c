"""A watched robot, for the command line: the plan (`truepose-watch-plan/1`) and the verdict (`truepose-watch/1`)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from acquisition import Cell
from acquisition.campaign import DECIMALS, Pose, draw_poses
from acquisition.record import planned_header
from calib import watch
from calib.data import Dataset, header_of
from calib.errors import DataError
from calib.fit import silent
from calib.saved import SavedModel, save_update
from calib.text import written_by
from calib.units import DEG
from calib.watch import Missed, Plan, Seen, Verdict
from service import exit_codes
from service.plain import finite

FORMAT, PLAN_FORMAT = "truepose-watch/1", "truepose-watch-plan/1"
CODES = {
    "unchanged": exit_codes.DONE,
    "changed": exit_codes.NOT_MET,
    "ambiguous": exit_codes.UNKNOWN_CAUSE,
    "unexplained": exit_codes.UNKNOWN_CAUSE,
}
"""Exit code of every verdict."""


@dataclass(frozen=True)
class PlanQuestion:
    """What to plan. targets: names, None for all of the cell; offset_deg: from how far every joint arrives; both: from
    sides drawn for every joint, else from below; rate: of false alarms."""

    poses: int
    candidates: int
    targets: tuple[str, ...] | None
    offset_deg: float
    both: bool
    rate: float
    seed: int


@dataclass(frozen=True)
class Planned:
    """The check poses of a cell and what they show."""

    cell: Cell
    model: Path
    asked: PlanQuestion
    targets: tuple[str, ...]
    poses: tuple[Pose, ...]
    plan: Plan

    @staticmethod
    def of(
        cell: Cell,
        file: Path,
        saved: SavedModel,
        model: Path,
        asked: PlanQuestion,
        say: Callable[[str], None] = silent,
    ) -> Planned:
        """Draw, choose, predict, for the cell of `file`. Raises DataError, ConfigError."""
        if cell.instrument.declared.measures_lengths:
            raise DataError(
                f"the {cell.instrument.name} measures distances; check poses are planned for points.",
                do="Measure some of the stances of its campaign again, and judge them with truepose watch judge.",
                key="instrument.driver",
            )
        targets = tuple(cell.tool.targets) if asked.targets is None else asked.targets
        if unknown := [name for name in targets if name not in cell.tool.targets]:
            raise DataError(
                f"'{unknown[0]}' is no target of the cell.",
                do=f"Use {', '.join(cell.tool.targets)}.",
                key="--targets",
            )
        _refuse_one_sided(saved, model, both=asked.both)
        header = header_of(planned_header(cell), Path(cell.name), "")
        say(f"drawing {asked.candidates} candidates")
        drawn = draw_poses(
            cell,
            asked.candidates,
            np.random.default_rng(asked.seed),
            -asked.offset_deg,
            both=asked.both,
            decimals=DECIMALS,
            targets=targets,
            fewest=asked.poses,
        )
        say(f"choosing {asked.poses} of {len(drawn)}")
        found = watch.plan(
            saved,
            header,
            cell.robot.model_angles([pose.joints_deg for pose in drawn]),
            np.array([pose.sides for pose in drawn], dtype=np.float64),
            np.array([pose.reach_deg for pose in drawn]) * DEG,
            targets,
            asked.poses,
            asked.rate,
        )
        poses = tuple(drawn[i] for i in found.chosen)
        refuse_poses(cell, file, saved, model, poses, targets)
        return Planned(cell, model, asked, targets, poses, found)

    @property
    def campaign(self) -> str:
        """The campaign, as its file has it."""
        block = {
            "kind": "poses",
            "set": "calibration",
            "select": "list",
            "targets": list(self.targets),
            "joints_deg": [list(pose.joints_deg) for pose in self.poses],
            "approach_sides": [list(pose.sides) for pose in self.poses],
        }
        table = {
            "format": "truepose-campaign/1",
            "seed": self.asked.seed,
            "approach": {"offset_deg": -self.asked.offset_deg, "sides": "both" if self.asked.both else "one"},
            "block": [block],
        }
        return f"# Check poses of {self.model.name}, by truepose watch plan.\n{tomli_w.dumps(table)}"

    def document(self) -> dict[str, Any]:
        """Document of the plan, as JSON has it."""
        return finite(
            {
                "format": PLAN_FORMAT,
                "cell": self.cell.name,
                "model": self.model.name,
                "targets": list(self.targets),
                "false_alarms": self.asked.rate,
                "seen_in": watch.SEEN,
                "alone_in": watch.ALONE,
                "poses_deg": [list(pose.joints_deg) for pose in self.poses],
                "sides": [list(pose.sides) for pose in self.poses],
                "causes": [
                    {
                        "label": each.label,
                        "meaning": each.meaning,
                        "seen_from": each.size,
                        "alone_from": each.alone,
                        "unit": each.unit,
                        "never_apart_from": list(each.always),
                    }
                    for each in self.plan.seen
                ],
                "not_seen": list(self.plan.unseen),
            }
        )


def _refuse_one_sided(saved: SavedModel, model: Path, *, both: bool) -> None:
    sides = saved.holds_for.get("approach") or ()
    if both and any(side != "both sides" for side in sides):
        raise DataError(
            "was calibrated with joints that came from one side only: play that was always there would look new.",
            do="Calibrate with approach sides = 'both', or plan with --one-side: play is not seen then.",
            file=model,
            key="holds_for.approach",
        )


def refuse_poses(
    cell: Cell, file: Path, saved: SavedModel, model: Path, poses: Sequence[Pose], targets: Sequence[str]
) -> None:
    """Raise DataError where the readings of some poses in the cell of `file` would be no watch of a baseline, before
    anything moves."""
    if cell.instrument.declared.measures_lengths or not poses:
        return
    would = watch.planned(
        saved,
        header_of(planned_header(cell), file, ""),
        cell.robot.model_angles([pose.joints_deg for pose in poses]),
        np.array([pose.sides for pose in poses], dtype=np.float64),
        np.array([pose.reach_deg for pose in poses]) * DEG,
        targets,
    )
    watch.refuse_unlike(saved, replace(would, path=file), model, frame_known=True, missing_allowed=False)


@dataclass(frozen=True)
class JudgeQuestion:
    """How to judge. history, update: files, None for none; rate: of false alarms; frame_known: whether robot and
    instrument stand where they stood; missing_allowed: whether check poses may be missing."""

    history: Path | None = None
    update: Path | None = None
    rate: float = watch.RATE
    frame_known: bool = True
    missing_allowed: bool = False


@dataclass(frozen=True)
class Watched:
    """A verdict and what else is said of it."""

    dataset: Dataset
    model: Path
    asked: JudgeQuestion
    verdict: Verdict
    error: Missed
    notes: tuple[str, ...]
    updated: bool

    @staticmethod
    def of(
        dataset: Dataset,
        saved: SavedModel,
        model: Path,
        asked: JudgeQuestion,
        say: Callable[[str], None] = silent,
    ) -> Watched:
        """Judge, append to the history, write the updated model where a cause is known. Raises DataError, OSError."""
        notes = saved.notes + watch.refuse_unlike(
            saved, dataset, model, frame_known=asked.frame_known, missing_allowed=asked.missing_allowed
        )
        history = None if asked.history is None else watch.read_history(asked.history)
        say("judging")
        seen = Seen.of(saved, dataset, frame_known=asked.frame_known)
        baseline = watch.baseline_hash(saved)
        before: Sequence[Any] = ()
        if history is not None:
            before, left_out = history.before(seen, dataset, baseline)
            if left_out:
                notes += (
                    f"{asked.history}: {left_out} earlier watches are of another model or other poses and were not "
                    "averaged.",
                )
        verdict = watch.judge(seen, before, asked.rate)
        if asked.history is not None and history is not None and not history.holds(dataset):
            watch.append(asked.history, seen, dataset, baseline, verdict)
        updated = False
        if asked.update is not None and verdict.kind != "unchanged":
            notes, updated = _update(saved, seen, dataset, model, asked.update, verdict, notes)
        return Watched(dataset, model, asked, verdict, watch.missed(seen, dataset), notes, updated)

    @property
    def exit_code(self) -> int:
        """The exit code of the verdict."""
        return CODES[self.verdict.kind]

    def document(self) -> dict[str, Any]:
        """Document of the verdict, as JSON has it."""
        verdict, header = self.verdict, self.dataset.header
        return finite(
            {
                "format": FORMAT,
                "program": written_by(),
                "verdict": verdict.kind,
                "exit_code": self.exit_code,
                "in_words": verdict.in_words,
                "advice": verdict.advice,
                "false_alarms": verdict.rate,
                "questions": [
                    {
                        "watches": each.watches,
                        "values": each.rows,
                        "t_squared": each.t_squared,
                        "t_squared_limit": each.limit,
                        "p_value": each.p_value,
                        "p_limit": each.p_limit,
                        "alarm": each.alarm,
                    }
                    for each in verdict.questions
                ],
                "causes": [
                    {
                        "label": cause.label,
                        "weight": weight,
                        "size": {"value": cause.size.value, "u": cause.size.u, "unit": cause.size.unit},
                        "parameters": watch.in_display(cause.effect, cause.values, cause.covariance),
                        "in_words": cause.changed,
                    }
                    for cause, weight in verdict.causes
                ],
                "p_left": verdict.left,
                "error_mm": asdict(self.error),
                "model": self.model.name,
                "data": self.dataset.name,
                "data_sha256": self.dataset.sha256,
                "robot": header.robot.name,
                "device": [dict(each) for each in header.devices],
                "measured": None
                if header.occasion is None
                else {"began": header.occasion.began, "ended": header.occasion.ended},
                "simulated": header.simulated,
                "updated_model": None if not self.updated else str(self.asked.update),
                "notes": list(self.notes),
            }
        )


def _update(
    saved: SavedModel,
    seen: Seen,
    dataset: Dataset,
    model: Path,
    out: Path,
    verdict: Verdict,
    notes: tuple[str, ...],
) -> tuple[tuple[str, ...], bool]:
    """Write the updated model, or say why there is none: the verdict stands without it."""
    try:
        cause = watch.cause_to_update(verdict)
        if verdict.questions[0].watches == 1 and not verdict.questions[0].alarm:
            raise DataError(
                "only the mean over watches shows the change, and not how large it is now.",
                do="Measure again.",
                file="--update",
            )
    except DataError as error:
        return (*notes, str(error)), False
    goal, estimate, covariance = watch.updated(saved, seen, cause)
    occasion = dataset.header.occasion
    save_update(
        out,
        model,
        goal,
        estimate,
        covariance,
        {
            "by": "truepose watch",
            "measured": None if occasion is None else occasion.began,
            "data": dataset.name,
            "data_sha256": dataset.sha256,
            "cause": cause.label,
            "class": [each.label for each, _ in verdict.causes],
            "changed": watch.in_display(cause.effect, cause.values, cause.covariance),
        },
    )
    return notes, True
