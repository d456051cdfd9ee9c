"""A path: the robot drives through its waypoints while both streams are recorded.

A pause ends it after the current motion, a stop or an error in the middle of it. The streams are closed, and their
samples stay in the record under an attempt that is not good. The next attempt drives the path from its beginning.
"""

from __future__ import annotations

from acquisition.campaign.campaign import Campaign
from acquisition.cell.transit import Transit
from acquisition.record.attempts import Attempts
from acquisition.record.store import PlannedReading, RecordStore
from acquisition.run.orders.control import Control, Pausing, Stopping
from acquisition.run.rig.recorder import Recorder
from acquisition.run.rig.rig import DevicePair
from drivers.errors import MotionStopped


class PathDrive:
    """The paths of one execution."""

    def __init__(
        self, store: RecordStore, campaign: Campaign, rig: DevicePair, control: Control, transit: Transit
    ) -> None:
        self._store = store
        self._campaign = campaign
        self._rig = rig
        self._control = control
        self._transit = transit

    def drive(self, planned: PlannedReading, attempt: int) -> None:
        """Drive the robot from the first waypoint to the last.

        Raises
        ------
        Pausing, Stopping
            The run must pause or stop.
        AcquisitionError
            A device failed.
        """
        path = self._campaign.path_of(planned.visit.block)
        assert path is not None, "only a path has waypoints"
        waypoints = planned.visit.waypoints
        reached = 1
        try:
            with (
                self._rig.at_speed(path.speed_deg_s),
                Recorder(self._store, attempt, self._rig, path.rates_hz) as recorder,
            ):
                recorder.wait_until_both_flow()
                self._record_waypoint(recorder, attempt, reached, len(waypoints) + 1)
                self._control.wait(path.rest_s)
                for waypoint in waypoints:
                    self._control.check()
                    for joints_deg in self._transit.path(self._rig.joints_at_rest_deg(), waypoint):
                        self._rig.move(joints_deg)
                    reached += 1
                    self._control.wait(path.rest_s)
                    recorder.look()
                    self._record_waypoint(recorder, attempt, reached, len(waypoints) + 1)
        except (Pausing, Stopping):
            left = MotionStopped(
                f"the robot left its path after waypoint {reached} of {len(waypoints) + 1}, so the "
                "recordings of this path are incomplete",
                device="robot",
                command="path",
            )
            Attempts(self._store).failed(attempt, left)
            raise

    def _record_waypoint(self, recorder: Recorder, attempt: int, reached: int, of: int) -> None:
        feeds = recorder.feeds.values()
        self._store.add_event(
            "waypoint",
            attempt=attempt,
            waypoint=reached,
            of=of,
            samples={feed.role: feed.taken for feed in feeds},
            lost={feed.role: feed.lost for feed in feeds},
        )
