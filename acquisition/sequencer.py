"""The sequencer: nests, then every visit of the plan - approach, settle, measure, one durable reading at a time.

What it does about an error is a function of its class (`drivers.errors`):

    LinkError      connect, arm and approach again; after `LINK_TRIES` in a row: pause
    Unmeasurable   approach again and retry; then put off, come back at the end, then skip
    Refused        ask the operator: confirm tries again, skip leaves the reading out
    SafetyStop, StorageError, NoOperator and all others: pause

Any interruption voids the approach: a reading is only taken after an arrival with nothing in between.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from itertools import groupby

import numpy as np

from acquisition import world_frame
from acquisition.attempts import Attempts
from acquisition.campaign import Campaign
from acquisition.cell import Cell
from acquisition.clock import Clock
from acquisition.control import Control, Stopping
from acquisition.desk import Desk
from acquisition.errors import NestsDisagree
from acquisition.plan import Visit
from acquisition.rig import Rig
from acquisition.store import Planned, Store
from acquisition.workspace import targets_at
from acquisition.world_frame import WorldFrame
from drivers.errors import AcquisitionError, LinkError, Refused, Unmeasurable
from drivers.interfaces import Answer

LINK_TRIES = 5
FIRST_BACK_OFF_S = 0.1  # on the wall; doubles with every try
GIVEN_UP_IN_A_ROW = 10  # then it is no longer the poses: somebody has to look
NESTS_STAND_MM = 0.2  # nests measured again within this leave the world frame as it is


class Sequencer:
    """One execution of a record's plan."""

    def __init__(
        self,
        store: Store,
        cell: Cell,
        campaign: Campaign,
        rig: Rig,
        control: Control,
        desk: Desk,
        clock: Clock,
    ) -> None:
        self._store = store
        self._attempts = Attempts(store)
        self._cell = cell
        self._campaign = campaign
        self._rig = rig
        self._control = control
        self._desk = desk
        self._clock = clock
        self._seated: str | None = None
        self._link_faults = 0
        self._given_up = 0
        self._world: WorldFrame | None = None

    def run(self) -> None:
        """Measure what is left. Raises Pausing, Stopping, and the errors that pause a campaign."""
        self._warm_up()
        if self._store.world is not None:
            self._store.plan_nests_again("resumed: does the instrument still stand where it stood?")
        self._measure_nests()
        for status, last in (("planned", False), ("deferred", True)):
            for visit, readings in self._visits(status):
                self._visit(visit, readings, last=last)

    def _visits(self, status: str) -> Iterator[tuple[Visit, list[Planned]]]:
        plan = [each for each in self._store.plan() if each.status == status and each.visit.kind == "pose"]
        for _, group in groupby(plan, key=lambda each: each.visit.number):
            readings = list(group)
            yield readings[0].visit, readings

    # -- before the first pose ----------------------------------------------------------------------------

    def _warm_up(self) -> None:
        """Again in every execution: a cell that is resumed next morning has cooled down."""
        if self._campaign.warm_up_s > 0.0:
            now_s = self._store.moment().t_s or 0.0
            self._store.tell("warm_up", until_t_s=now_s + self._campaign.warm_up_s)
            self._control.wait(self._campaign.warm_up_s)

    def _measure_nests(self) -> None:
        while self._world is None:
            plan = self._store.plan()
            for planned in [p for p in plan if p.visit.kind == "nest" and p.status == "planned"]:
                self._visit(planned.visit, [planned], last=True)
            try:
                self._world = self._settled_world()
            except NestsDisagree as error:
                self._store.plan_nests_again(error.message)
                self._consult(error)

    def _settled_world(self) -> WorldFrame:
        """The frame of the record while the nests agree with it; else, or the first time, theirs."""
        nests = self._store.nests_mm()
        found = world_frame.from_nests(nests, self._cell.nests)
        kept = self._store.world
        if kept is not None:
            off = max(
                float(np.linalg.norm(kept.to_world(point) - np.array(self._cell.nests[name])))
                for name, point in nests.items()
            )
            if off <= NESTS_STAND_MM:
                return kept
            self._store.tell("instrument_moved", nests_off_mm=off)
        self._store.set_world(found)
        return found

    # -- one visit ----------------------------------------------------------------------------------------

    def _visit(self, visit: Visit, readings: list[Planned], *, last: bool) -> None:
        left = list(readings)
        unmeasurable: Counter[int] = Counter()
        refused = 0
        arrival: int | None = None
        while left:
            self._control.check()
            planned = left[0]
            try:
                if not self._seat(planned):
                    self._store.mark(planned.id, "skipped", "by the operator")
                    left.pop(0)
                    continue
                self._rig.make_ready()
                if visit.kind == "pose" and arrival is None:
                    arrival = self._approach(visit)
                self._measure(planned, arrival)
                left.pop(0)
                self._link_faults = self._given_up = 0
                continue
            except LinkError as error:
                self._control.check_stop()
                self._after_link_error(error)
            except Unmeasurable as error:
                unmeasurable[planned.id] += 1
                if unmeasurable[planned.id] > self._campaign.retries:
                    self._give_up(planned, error, last=last)
                    left.pop(0)
            except Refused as error:
                self._control.check_stop()  # a stop makes devices refuse
                refused += 1
                if refused > self._campaign.retries + 1:
                    raise
                if self._consult(error) is Answer.SKIP:
                    self._give_up(planned, error, last=True)
                    left.pop(0)
            arrival = None

    def _approach(self, visit: Visit) -> int:
        """Go to the pose over its approach point and settle; the arrival's attempt."""
        attempt = self._attempts.begin_arrival(visit)
        try:
            self._rig.move(visit.approach_deg)
            reached = self._rig.move(visit.joints_deg)
            self._control.settle(self._campaign.settle_s)
        except AcquisitionError as error:
            self._attempts.failed(attempt, error)
            raise
        self._attempts.arrived(attempt, reached)
        return attempt

    def _measure(self, planned: Planned, arrival: int | None) -> None:
        near = None
        if self._world is not None and planned.visit.kind == "pose":
            names = list(self._cell.tool.targets)
            at = targets_at(self._cell, np.array([planned.visit.joints_deg]))[0, names.index(planned.target)]
            near = tuple(float(x) for x in self._world.to_tracker(at))
        attempt = self._attempts.begin_reading(planned, arrival)
        try:
            reading = self._rig.measure(planned.target, self._campaign.samples, near)
        except AcquisitionError as error:
            self._attempts.failed(attempt, error)
            raise
        world = None
        if self._world is not None:
            world = tuple(float(x) for x in self._world.to_world(reading.xyz_mm))
        self._attempts.measured(attempt, planned, reading, world)

    def _seat(self, planned: Planned) -> bool:
        """Ask for the SMR to be moved, where there is only one; False to leave the reading out."""
        if not self._cell.instrument.one_smr or self._seated == planned.target:
            return True
        answer = self._desk.ask(f"Seat the SMR in {planned.target} and press confirm.")
        self._heed(answer)
        if answer is Answer.CONFIRM:
            self._seated = planned.target
        return answer is Answer.CONFIRM or planned.visit.kind == "nest"

    # -- reactions ----------------------------------------------------------------------------------------

    def _after_link_error(self, error: LinkError) -> None:
        self._link_faults += 1
        if self._rig.lost_in_move or self._link_faults > LINK_TRIES:
            raise error
        back_off_s = FIRST_BACK_OFF_S * 2.0 ** (self._link_faults - 1)
        self._store.tell("reconnect", attempt=self._link_faults, error=error.as_dict())
        self._control.wait(back_off_s * self._clock.time_scale)

    def _give_up(self, planned: Planned, error: AcquisitionError, *, last: bool) -> None:
        if planned.visit.kind == "nest":
            raise error  # without its nests a campaign has no world frame
        self._store.mark(planned.id, "skipped" if last else "deferred", error.message)
        self._given_up += 1
        if self._given_up >= GIVEN_UP_IN_A_ROW:
            self._given_up = 0
            self._consult(error)

    def _consult(self, error: AcquisitionError) -> Answer:
        """Ask whether to go on. Raises Stopping for abort, NoOperator, Pausing."""
        answer = self._desk.ask(f"{error.message}. {error.what_to_do}")
        self._heed(answer)
        return answer

    def _heed(self, answer: Answer) -> None:
        if answer is Answer.ABORT:
            self._control.stop()
            raise Stopping
