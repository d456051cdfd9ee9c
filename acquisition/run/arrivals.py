"""Arrivals: the robot goes to the pose of a visit, settles, and is checked there.

The read-back of its controller is compared with the pose that the record will have. A robot that is driven by hand is
not compared: the record has the joints at which it is.
"""

from __future__ import annotations

from dataclasses import dataclass

from acquisition.campaign.campaign import Campaign
from acquisition.campaign.plan import Visit
from acquisition.cell.transit import Transit
from acquisition.errors import Displaced
from acquisition.record.attempts import Attempts
from acquisition.record.store import PlannedReading, RecordStore
from acquisition.run.orders.control import Control
from acquisition.run.rig.rig import DevicePair, until_still
from drivers.errors import AcquisitionError, NotReached
from drivers.interfaces import JointReading, apart_deg

DISPLACED_DEG = 0.02  # above what servos hold and the coarsest controller reads back, 0.01


@dataclass(frozen=True)
class Arrival:
    """The arrival of the robot in the pose of a visit.

    It has the attempt that brought the robot there, and the joints read back, deg.
    """

    visit: int
    attempt: int
    read_deg: tuple[float, ...]


class Arrivals:
    """The arrivals of one execution.

    `transit` has the paths between poses; it is replaced when a touched cup moves an obstacle. `by_hand` states whether
    a person drives the robot.
    """

    def __init__(
        self,
        store: RecordStore,
        campaign: Campaign,
        rig: DevicePair,
        control: Control,
        transit: Transit,
        *,
        by_hand: bool,
    ) -> None:
        self._store = store
        self._attempts = Attempts(store)
        self._campaign = campaign
        self._rig = rig
        self._control = control
        self._by_hand = by_hand
        self.transit = transit

    def go(self, planned: PlannedReading) -> tuple[Arrival, int | None]:
        """Go to the pose over its approach point and settle.

        Returns the arrival and the attempt at the reading. The attempt is None if a person first has to put the ballbar
        on. All errors of a move are passed on.

        Raises
        ------
        NoClearWay
            No path to the approach point is clear.
        NotReached
            The robot is not in the pose.
        """
        visit = planned.visit
        path = self.transit.path(self._rig.joints_at_rest_deg(), visit.approach_deg)
        if len(path) > 1:
            self._store.add_event("detour", visit=visit.number, over_deg=path[0])
        arrival = self._attempts.begin_arrival(visit)
        try:
            reached = self._rig.go(path, visit.joints_deg)
            settle = self._campaign.settle_of(visit.block)
            self._control.settle(settle.seconds)
            if settle.check:
                reached = until_still(self._rig.position, self._control.settle)
            self._refuse_elsewhere(visit, reached)
        except AcquisitionError as error:
            self._attempts.failed(arrival, error)
            raise
        with self._store.changing():  # both at once: a sync of the disk is the largest cost of a pose
            self._attempts.arrived(arrival, reached)
            by_hand = planned.base_target is not None
            attempt = None if by_hand else self._attempts.begin_reading(planned, arrival)
            return Arrival(visit.number, arrival, reached.joints_deg), attempt

    def check_not_displaced(self, arrival: Arrival) -> None:
        """Check that the robot is still where it arrived: a brake may slip, a person may jog it.

        The joint angles of a robot driven by hand are those that the person reports.

        Raises
        ------
        Displaced
            A joint has turned since the arrival.
        """
        if self._by_hand:
            return
        off = apart_deg(self._rig.position().joints_deg, arrival.read_deg)
        if off > DISPLACED_DEG:
            raise Displaced(f"a joint was turned by {off:.3f} deg since the robot arrived", device="robot")

    def stands(self, planned: PlannedReading, arrival: Arrival | None) -> tuple[float, ...]:
        """Return the joints, deg, at which a target is expected.

        They are those of the plan, or for a robot driven by hand those that its person reports.
        """
        return arrival.read_deg if self._by_hand and arrival is not None else planned.visit.joints_deg

    def _refuse_elsewhere(self, visit: Visit, reached: JointReading) -> None:
        """Refuse an arrival at joints that differ from those of the visit.

        The drivers apply tighter limits to a move (decision 0016); this check protects the record, independently of the
        driver. It is skipped for a robot that is driven by hand, because then the record has the joints at which it
        was.

        Raises
        ------
        NotReached
            A joint is read back too far from its target.
        """
        if self._by_hand:
            return
        off = apart_deg(reached.joints_deg, visit.joints_deg)
        if off > DISPLACED_DEG:
            raise NotReached(
                f"a joint reports a position {off:.3f} deg from where visit {visit.number} sends it",
                device="robot",
                command="arrive",
                raw=reached.raw,
            )
