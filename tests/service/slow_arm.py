"""An arm that is on its way until it is stopped: a test can be in mid-motion for as long as it likes."""

from __future__ import annotations

import threading

from drivers import JointReading, MotionStopped
from tests.acquisition.fakes import Bench, FakeArm


class SlowArm(FakeArm):
    """Moves until it is stopped."""

    def __init__(self, bench: Bench) -> None:
        super().__init__(bench)
        self.moving, self.halted = threading.Event(), threading.Event()

    def move_to(self, joints_deg: object) -> JointReading:
        self.moving.set()
        self.halted.wait()
        raise MotionStopped("stopped", device=self.name)

    def stop(self) -> None:
        super().stop()
        self.halted.set()
