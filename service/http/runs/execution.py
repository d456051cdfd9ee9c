"""An execution uses the robot: one thread at a time, that of a run, or that of a closed loop with its runs."""

from __future__ import annotations

import threading
from dataclasses import dataclass, field


@dataclass
class RobotThread:
    """A thread that uses the robot. `run_id`: empty while a loop is between two runs; `begun`: that run can be paused.

    stopped: it was ordered to end; examines: devices are only asked how they are.
    """

    thread: threading.Thread
    run_id: str
    loop_id: str = ""
    begun: threading.Event = field(default_factory=threading.Event)
    stopped: bool = False
    examines: bool = False

    @property
    def what(self) -> str:
        if self.examines:
            return "an examination of the devices"
        return f"loop {self.loop_id}" if self.loop_id else f"run {self.run_id}"
