"""Simulated Yaskawa controller without its protocol: mode, holds, alarms, jobs and pulses.

The arm of the cell turns by angles; the controller counts pulses, `pulses_per_deg` of each joint.
"""

from __future__ import annotations

import asyncio
from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from mocks.shared.arm_device import ArmDevice
from mocks.shared.clock import CellClock
from mocks.world.robots import Robot
from mocks.yaskawa.inform import Job, JobError, JointMotion, Variables

PULSES_PER_DEG = (1435.350459, 1300.317471, 1422.222174, 969.9555508, 980.2392898, 454.754161)  # of an MA1440
MAX_DEG_S = (375.0, 315.0, 410.0, 550.0, 550.0, 1000.0)  # of a GP7
NO_CAP_MM_S = 1e9  # a joint move has no cap on the speed of the tool
COLLISION, PULSE_LIMIT, JOB_ERROR = 4315, 4416, 4447
STEP, ONE_CYCLE, AUTO = 1, 2, 3


def shipped_job() -> str:
    """Return the text of the job that a person loads into the controller."""
    drivers = find_spec("drivers")  # found, not imported
    assert drivers is not None
    assert drivers.origin is not None
    folder = Path(drivers.origin).parent / "yaskawa" / "robot_side"
    return (folder / "TRUEPOSE1.JBI").read_text("ascii")


class YaskawaController:
    """One controller over the cell's arm.

    Attributes
    ----------
    remote : bool
        The mode switch is at REMOTE, and command remote is allowed.
    holds : set of str
        Those of `pendant`, `external` and `command` that hold the robot.
    file_busy : bool
        A person edits a job.
    """

    def __init__(
        self,
        arm: ArmDevice,
        clock: CellClock,
        robot: Robot,
        pulses_per_deg: Sequence[float] = (),
        max_deg_s: Sequence[float] = (),
    ) -> None:
        self.arm = arm
        self.clock = clock
        self.robot = robot
        self.per_deg = tuple(pulses_per_deg) or PULSES_PER_DEG
        self.max_deg_s = tuple(max_deg_s) or MAX_DEG_S
        self.variables = Variables()
        self.jobs: dict[str, Job] = {}
        self.load(shipped_job())
        self.load("//NAME OTHER\n//INST\nNOP\nEND\n")
        self.selected: tuple[str, int] | None = ("OTHER", 0)
        self.restart()

    def restart(self) -> None:
        """Put everything in order, as a person does: no job runs, nothing is held, no alarm."""
        self.remote = True
        self.file_busy = False
        self.holds: set[str] = set()
        self.alarm: tuple[int, str] | None = None
        self.error = False
        self.cycle = AUTO
        self.running = False
        self._task: asyncio.Task[None] | None = None
        self._paused: tuple[Job, int, JointMotion | None] | None = None

    def put(self, order: Mapping[str, Any]) -> None:
        """Carry out an order of the back door, which names what is to be put into a state."""
        self.remote = bool(order.get("remote", self.remote))
        self.error = bool(order.get("error", self.error))
        self.file_busy = bool(order.get("file_busy", self.file_busy))
        if "hold" in order:
            self.holds = {order["hold"]} & {"pendant", "external", "command"}
        if "alarm" in order:
            self.alarm = int(order["alarm"][0]), str(order["alarm"][1])
        self.arm.wake()

    def load(self, text: str) -> None:
        """Load a JBI file."""
        job = Job(text)
        self.jobs[job.name] = job

    # -- state --------------------------------------------------------------------------------------------

    @property
    def model(self) -> str:
        """Name that the controller has for the robot."""
        return self.robot.shown or self.robot.name.removeprefix("yaskawa-").upper()

    @property
    def teaching(self) -> bool:
        return self.arm.mode != "auto"

    @property
    def servo_on(self) -> bool:
        return self.arm.motors_on and not self.arm.emergency_stop

    def current_alarm(self) -> tuple[int, str] | None:
        if self.alarm is None and self.arm.hung and not self.arm.emergency_stop:
            return COLLISION, "COLLISION DETECT"
        return self.alarm

    def pulses(self) -> tuple[int, ...]:
        """Return the pulses of the joints as the controller counts them."""
        counted = self.robot.counting.counted(self.arm.joints_deg())
        return tuple(round(q * per) for q, per in zip(counted, self.per_deg, strict=True))

    # -- orders -------------------------------------------------------------------------------------------

    def hold(self, who: str, *, on: bool) -> None:
        """Hold or release the robot. A held job continues only when it is started."""
        if on:
            self.holds.add(who)
            self.arm.wake()
        else:
            self.holds.discard(who)

    def select(self, name: str, line: int) -> None:
        """Select a job from a line on; one that was held is forgotten."""
        self.selected, self._paused = (name, line), None

    def start(self) -> None:
        """Start the selected job, or go on with the one that was held."""
        assert self.selected is not None
        name, line = self.selected
        job, at, motion = self._paused or (self.jobs[name], line, None)
        self.running, self._paused = True, None
        self._task = asyncio.get_running_loop().create_task(self._run(job, at, motion))

    async def _run(self, job: Job, at: int | None, motion: JointMotion | None) -> None:
        try:
            while True:
                if motion is not None and not await self._move(motion):
                    assert at is not None
                    self._paused = (job, at, motion)
                    return
                if at is None:
                    if self.cycle != AUTO:
                        return
                    at = 0
                    await asyncio.sleep(0.001)
                at, motion = job.step(at, self.variables)
                await asyncio.sleep(0)
                if self.holds and at is not None:
                    self._paused = (job, at, motion)
                    return
        except JobError as error:
            self.alarm = JOB_ERROR, str(error)
        finally:
            self.running = False

    async def _move(self, motion: JointMotion) -> bool:
        """Move the joints; False if something stops them on the way."""
        arm = self.arm
        if not self._can_move():
            return False
        counted = [count / per for count, per in zip(motion.pulses, self.per_deg, strict=False)]
        if not arm.within_limits(counted):
            self.alarm = PULSE_LIMIT, "PULSE LIMIT (MIN./MAX.)"
            return False
        here, target = arm.joints_deg(), self.robot.counting.to_model(counted)
        share = motion.speed / 10_000
        own = self.robot.counting.counted(here)
        seconds = max(
            abs(b - a) / (share * top) for a, b, top in zip(own, counted, self.max_deg_s, strict=True)
        )
        far = max(abs(b - a) for a, b in zip(here, target, strict=True))
        arm.start(target, rate_deg_s=far / seconds if far > 0.0 < seconds else 1.0, tool_mm_s=NO_CAP_MM_S)
        while True:
            arm.changed.clear()
            if not self._can_move():
                arm.halt()
                return False
            if arm.left_s <= 0.0:
                return True
            await self.clock.wait(arm.left_s, arm.changed)

    def _can_move(self) -> bool:
        return self.arm.can_move and not self.holds and self.current_alarm() is None
