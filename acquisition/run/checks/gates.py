"""The gates before every reading of a pose: a warm arm, and an instrument in its place.

    warm-up      the first visit, the reference pose, is measured until its last readings lie close together; those
                 before stay in the record, out of use. Again in every execution: the arm may have cooled down
    nest check   the nests are measured again after so many readings, and after the last; when one is beyond the limit
                 from where the world frame has it, a person decides what becomes of the readings since
    zero         the ballbar is read in its calibrator before the first visit, before each block and after so many
                 readings, and whenever a reading needs it built to another length
    new station  before the first reading of a block that asks for it, or when somebody says that the instrument is
                 moved, it is set up anew

The sequencer makes these measurements; the gates only request them. Lengths mm, times s.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from acquisition.campaign.campaign import Campaign, NestCheckTable, WarmUpTable
from acquisition.record.store import PlannedReading, RecordStore
from acquisition.run.orders.control import Control

_FIRST_VISIT = """
SELECT id, visit, status FROM pose WHERE replaced_by IS NULL AND visit = (
  SELECT min(visit) FROM pose WHERE kind = 'pose') ORDER BY id LIMIT 1
"""
_LAST_BLOCK = """
SELECT pose.block FROM attempt JOIN pose ON pose.id = attempt.pose
WHERE attempt.kind = 'measure' AND attempt.status = 'good' AND pose.kind = 'pose' ORDER BY attempt.id DESC LIMIT 1
"""


@dataclass(frozen=True)
class Zeroing:
    """The ballbar in its calibrator.

    Attributes
    ----------
    another
        Returns whether a reading needs another bar than the one that is built.
    read
        Builds the bar and reads its zero; False if the reading is then not available.
    """

    another: Callable[[PlannedReading], bool]
    read: Callable[[PlannedReading], bool]


class Gates:
    """The checks before an execution continues.

    Parameters
    ----------
    wait
        Waits for a number of seconds.
    ask
        Asks a person, with the readings that a redo measures again and the name of a picture.
    measure_nests
        Measures all nests again; with `aim` False, the beam is sent to where they were.
    """

    def __init__(
        self,
        store: RecordStore,
        campaign: Campaign,
        wait: Callable[[float], None],
        control: Control,
        ask: Callable[..., object],
        measure_nests: Callable[..., None],
        zeroing: Zeroing,
    ) -> None:
        self._store = store
        self._campaign = campaign
        self._wait, self._control = wait, control
        self._ask = ask
        self._measure_nests = measure_nests
        self._zeroing = zeroing
        self._since_zero: int | None = None
        self._station: int | None = None  # of the instrument now, None before it was read
        self._since_nests: list[int] = []  # planned readings of poses that were measured
        self._visit: int | None = None  # of the last reading
        self._block: int | None = None  # of the last reading of a pose
        self._warming = campaign.warm_up
        self._warming_since_s: float | None = None
        self._points: list[Sequence[float]] = []  # of the first visit, in this execution

    def open_for(self, planned: PlannedReading) -> bool:
        """Check whether this reading may be tried; False if others were planned before it.

        Errors of measuring nests are passed on.

        Raises
        ------
        Pausing, Stopping
            The run must pause or stop.
        NoOperator
            A question cannot be asked.
        StorageError
            The record cannot be written.
        """
        self._set_up_for(planned)
        self._set_up_where_it_is_now()
        check = self._campaign.nest_check
        between = planned.visit.number != self._visit  # the robot goes elsewhere anyway
        if check is not None and between and len(self._since_nests) >= check.every:
            self._check_nests(check)
        old = self._campaign.zero_every and between and self._zero_is_old(planned)
        if old or self._zeroing.another(planned):
            self._since_zero = 0
            if not self._zeroing.read(planned):
                return False
        return self._warming is None or self._is_warm(self._warming, planned)

    def measured(self, planned: PlannedReading, world_mm: Sequence[float] | None) -> None:
        """Note a good reading of a pose; `world_mm` is that of a point."""
        self._since_nests.append(planned.id)
        if self._since_zero is not None:
            self._since_zero += 1
        self._visit = planned.visit.number
        if planned.visit.kind == "pose":
            self._block = planned.visit.block
        if self._warming is not None and world_mm is not None:
            self._points.append(world_mm)

    def _zero_is_old(self, planned: PlannedReading) -> bool:
        """Check whether the zero must be read again.

        It is read in every new execution, because the bar may have been moved since.
        """
        if self._since_zero is None or self._since_zero >= self._campaign.zero_every:
            return True
        return planned.visit.kind == "pose" and self._block not in (None, planned.visit.block)

    # -- the instrument -----------------------------------------------------------------------------------

    def _set_up_for(self, planned: PlannedReading) -> None:
        if self._station is None:
            rows = self._store.database.query(_LAST_BLOCK)
            self._station = self._campaign.station_of(rows[0][0]) if rows else 0
        station = self._campaign.station_of(planned.visit.block)
        if station > self._station:  # readings that were put off at an earlier one are taken from here
            self._ask(
                "Set up the instrument at its next station, then confirm: the nests are measured there."
            )
            self._measured_nests("a new station of the instrument")
            self._station = station

    def _set_up_where_it_is_now(self) -> None:
        """Have the instrument set up again if `Run.restation` ordered it during the campaign.

        The order may come before the instrument is touched.
        """
        if (reason := self._control.take_new_station()) is None:
            return
        self._ask("Set up the instrument where it is to be, then confirm: the nests are measured there.")
        self._measured_nests(f"a new station of the instrument{f': {reason}' if reason else ''}")

    def _measured_nests(self, reason: str, *, aim: bool = True) -> None:
        self._measure_nests(reason, aim=aim)
        self._since_nests = []

    def check_nests_at_end(self) -> None:
        """Check the nests after the last reading, to detect a movement of the instrument."""
        if (check := self._campaign.nest_check) is not None and self._since_nests:
            self._check_nests(check)

    def _check_nests(self, check: NestCheckTable) -> None:
        before = self._store.world_nests_mm or self._store.nests_mm()
        since = self._since_nests
        self._measured_nests(f"check after {len(since)} readings: has the instrument moved?", aim=False)
        off = {name: _apart(before[name], point) for name, point in self._store.nests_mm().items()}
        worst = max(off, key=lambda name: off[name])
        moved = {"nest": worst, "since": since} if off[worst] > check.limit_mm else {}
        self._store.add_event("nests_checked", off_mm=off[worst], limit_mm=check.limit_mm, **moved)
        self.ask_about_nests()

    def ask_about_nests(self) -> None:
        """Ask for a decision on readings before a check whose nests had moved.

        A question that was cut off by a pause is asked again.
        """
        moved = [each for each in self._store.data_of_events("nests_checked") if "nest" in each]
        for each in moved[len(self._store.data_of_events("nests_judged")) :]:
            standing = {
                planned.id for planned in self._store.plan()
            }  # readings that were measured again meanwhile are replaced
            since = [number for number in each["since"] if number in standing]
            self._ask(
                f"Nest {each['nest']} is {each['off_mm']:.3f} mm from where the world frame has it, "
                f"the limit is {each['limit_mm']:g} mm. Look at the instrument and its stand; "
                "confirm to go on from the nests as they are now; "
                f"redo measures again what was measured since they were seen last ({len(since)}).",
                since,
                f"moved/{each['nest']}",
            )
            self._store.add_event("nests_judged", nest=each["nest"])

    # -- the arm ------------------------------------------------------------------------------------------

    def _is_warm(self, gate: WarmUpTable, planned: PlannedReading) -> bool:
        now_s = self._store.moment().t_s or 0.0
        if self._warming_since_s is None:
            self._warming_since_s = now_s
        row = self._store.database.query(_FIRST_VISIT)[0]
        if planned.visit.number == row["visit"]:
            return True  # it is measured now
        spread = None
        if row["status"] == "measured":
            last = np.array(self._points[-gate.over :])
            if len(last):
                spread = float(max(_apart(a, b) for a in last for b in last))
            if len(last) < gate.over or spread is None or spread > gate.below_mm:
                if now_s - self._warming_since_s < gate.at_most_s:
                    self._again(gate, row["id"], spread)
                    return False
                self._ask(
                    f"After {now_s - self._warming_since_s:.0f} s the reference pose still moves by "
                    f"{spread or 0.0:.3f} mm, {gate.below_mm:g} mm are allowed. Confirm to measure all the same."
                )
        self._store.add_event("warm", readings=len(self._points), spread_mm=spread)
        self._warming = None
        return True

    def _again(self, gate: WarmUpTable, pose: int, spread_mm: float | None) -> None:
        if self._points:
            self._store.add_event("warming_up", readings=len(self._points), spread_mm=spread_mm)
            self._wait(gate.every_s)
        reason = "warming up" if self._points else "resumed: is the arm still warm?"
        self._store.measure_again([pose], reason)


def _apart(one: Sequence[float], other: Sequence[float]) -> float:
    return float(np.linalg.norm(np.subtract(one, other)))
