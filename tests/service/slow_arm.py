"""An arm that moves until it is stopped.

A test can stay in mid-motion as long as it needs.
"""

from __future__ import annotations

import threading

from drivers import JointReading, MotionStopped
from tests.acquisition.fakes import Bench, FakeArm


class SlowArm(FakeArm):
    """Arm that moves until it is stopped."""

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
