"""Simulated ABB IRC5 under ROS-Industrial's abb_driver.

It has a motion server (11000), a state server (11002) and a motion task. Written from the description of
`simple_message`, not from the driver. These properties are kept on purpose:

- A trajectory is acknowledged when it is received. Its first point is skipped within 0.1 deg.
- A new trajectory, or a stop, ends the current one. A lost client does not.
- A second client is accepted by the network and not read until the first leaves.
- A message that is not a trajectory point ends the server's program. The connection stays open and silent.
"""

from __future__ import annotations

import asyncio
import contextlib
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mocks.shared.arm_device import ArmDevice
from mocks.shared.clock import CellClock
from mocks.shared.sockets import Endpoint, Servers
from mocks.world.robots import Counting

EVERY_S = 0.1  # the state server waits so long between two states
QUICKEST_S = 0.002  # on the wall, however fast the cell's clock runs
MOST_POINTS = 100
SKIP_DEG = 0.1
FASTEST_DEG_S = 250.0
NO_AXIS = 9e6  # an external axis that is not there, m
START, LAST, STOP = -1, -3, -4


def i32(*values: int) -> bytes:
    return np.asarray(values, dtype="<i4").tobytes()


def f32(*values: float) -> bytes:
    return np.asarray(values, dtype="<f4").tobytes()


def message(kind: int, communication: int, reply: int, body: bytes = b"") -> bytes:
    """Return a whole message: length of the rest, header, body."""
    return i32(12 + len(body), kind, communication, reply) + body


@dataclass(frozen=True)
class Point:
    """A point of a trajectory: joints in deg, duration in s."""

    sequence: int
    joints_deg: tuple[float, ...]
    duration_s: float
    wants_reply: bool


def point(data: bytes) -> Point | None:
    """Parse a message behind its length as a point; None for any other."""
    if len(data) != 64:
        return None
    kind, communication, _, sequence = (int(v) for v in np.frombuffer(data[:16], dtype="<i4"))
    numbers = [float(v) for v in np.frombuffer(data[16:], dtype="<f4")]
    if kind != 11:
        return None
    return Point(sequence, tuple(np.degrees(numbers[:6]).tolist()), numbers[11], communication == 2)


class SimpleMessageServers:
    """The two servers and the motion task of one controller."""

    def __init__(self, arm: ArmDevice, clock: CellClock, counting: Counting) -> None:
        self.arm = arm
        self.clock = clock
        self.counting = counting
        self.received: list[Point] = []
        self.throttle_s = 0.05  # until the motion task looks for a trajectory again
        self._one_motion = asyncio.Lock()
        self._one_state = asyncio.Lock()
        self._points: list[Point] = []
        self._task: asyncio.Task[None] | None = None
        self._restarted = asyncio.Event()

    def restart(self) -> None:
        """Start the programs of the controller again, as a person does at the pendant."""
        self._restarted.set()
        self._restarted = asyncio.Event()

    async def listen(self, servers: Servers, port: int) -> list[Endpoint]:
        """Start both servers, the state server two ports above the motion server.

        Raises
        ------
        OSError
            A port is taken.
        """
        one = await servers.listen_around({0: self.serve_motion, 2: self.serve_state}, port)
        names = {"abb-simple": one, "abb-simple-state": one + 2}
        return [Endpoint(name, "simple_message", number) for name, number in names.items()]

    # -- servers ------------------------------------------------------------------------------------------

    async def serve_motion(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        async with self._one_motion:
            while True:
                length = int(np.frombuffer(await reader.readexactly(4), dtype="<i4")[0])
                got = point(await reader.readexactly(length)) if 0 <= length <= 1024 else None
                if got is None:
                    await self._restarted.wait()  # the program has stopped with an error
                    return
                await self._take(got)
                if got.wants_reply:
                    writer.write(message(11, 3, 1))
                    await writer.drain()

    async def serve_state(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        async with self._one_state:
            while True:
                writer.write(self._joints())
                await writer.drain()
                writer.write(self._status())
                await writer.drain()
                await asyncio.sleep(max(EVERY_S / self.clock.time_scale, QUICKEST_S))

    def _joints(self) -> bytes:
        joints = (math.radians(q) for q in self.counting.counted(self.arm.joints_deg()))
        return message(10, 1, 0, i32(0) + f32(*joints, *[NO_AXIS] * 4))

    def _status(self) -> bytes:
        arm = self.arm
        mode = {"auto": 2, "manual": 1, "manual_full": 1}[arm.mode]
        in_error = arm.hung and not arm.emergency_stop
        possible = arm.motors_on and not arm.hung and not arm.emergency_stop
        flags = (arm.motors_on, arm.emergency_stop, 50027 * in_error, in_error, arm.moving, mode, possible)
        return message(13, 1, 0, i32(*(int(flag) for flag in flags)))

    # -- motion -------------------------------------------------------------------------------------------

    async def _take(self, got: Point) -> None:
        self.received.append(got)
        if got.sequence == START:
            self._points = [got]
        elif got.sequence == STOP:
            self._points = []
            await self._carry_out([])
        elif len(self._points) < MOST_POINTS:
            self._points.append(got)
        if got.sequence == LAST:
            await self._carry_out(self._points)

    async def _carry_out(self, points: Sequence[Point]) -> None:
        """Replace the current trajectory by a new one, also by an empty one."""
        if self._task is not None:
            self._task.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await self._task
            self.arm.halt()
        self._task = asyncio.create_task(self._follow(list(points))) if points else None

    async def _follow(self, points: Sequence[Point]) -> None:
        arm = self.arm
        await self.clock.wait(self.throttle_s, asyncio.Event())
        for i, each in enumerate(points):
            here = self.counting.counted(arm.joints_deg())
            far = max(abs(a - b) for a, b in zip(each.joints_deg, here, strict=True))
            if (i == 0 and far < SKIP_DEG) or far == 0.0:
                continue
            if not arm.can_move:
                return
            if not arm.within_limits(each.joints_deg):
                arm.supervise()
                return
            rate = min(FASTEST_DEG_S, far / max(each.duration_s, 1e-3))
            goal = self.counting.to_model(each.joints_deg)
            arm.start(goal, rate_deg_s=rate, tool_mm_s=math.inf)
            while arm.moving:
                arm.changed.clear()
                await self.clock.wait(arm.left_s, arm.changed)
                if not arm.can_move:
                    arm.supervise()
                    return
