"""Execution: the one thread that uses the robot, for a run or for a loop with its runs."""

from __future__ import annotations

import threading
from dataclasses import dataclass, field


@dataclass
class RobotThread:
    """A thread that uses the robot.

    Attributes
    ----------
    run_id : str
        Empty while a loop is between two runs.
    loop_id : str
        The loop, or the verification, to which it is lent.
    kind : str
        Which of the two that is.
    begun : threading.Event
        Set when the run can be paused.
    stopped : bool
        Whether it was ordered to end.
    examines : bool
        Whether the devices are only asked for their state.
    """

    thread: threading.Thread
    run_id: str
    loop_id: str = ""
    begun: threading.Event = field(default_factory=threading.Event)
    stopped: bool = False
    examines: bool = False
    kind: str = "loop"

    @property
    def what(self) -> str:
        if self.examines:
            return "an examination of the devices"
        return f"{self.kind} {self.loop_id}" if self.loop_id else f"run {self.run_id}"
