"""Simulated ABB IRC5 on the wire: stock open_abb (`stock`) or the CALSRV superset.

Written from the description of the protocol, not from the driver. These faults are kept on purpose:

- Stock reads up to the first `#` of one receive and drops the rest.
- A corrupt request is answered with the code of the request before and 0.
- An emergency stop, a supervision stop or a limit leaves the connection open and silent.
- A second client is accepted by the network and never answered.
- The read-back has 2 decimals (superset 5).

In the superset, codes below 100 are answered byte for byte as by open_abb.
"""

from __future__ import annotations

import asyncio
import time
from contextlib import suppress
from typing import NoReturn

from mocks.shared.arm_device import ArmDevice, Outcome
from mocks.shared.clock import CellClock
from mocks.shared.silence import silence
from mocks.shared.sockets import drop
from mocks.world.robots import Robot

MODES = {"auto": 1, "manual": 2, "manual_full": 3}
LOG_EVERY_S = 0.1
BAD, RANGE, STOPPED, MODE, INTERRUPTED, OTHER_TARGET, LIMITS_UNTOLD, UNKNOWN = 1, 2, 3, 4, 5, 6, 7, 9


def fletcher(text: str) -> int:
    """Return two running sums of the characters, modulo 251, as one number."""
    sums = [0, 0]
    for character in text:
        sums[0] = (sums[0] + ord(character)) % 251
        sums[1] = (sums[1] + sums[0]) % 251
    return sums[1] * 256 + sums[0]


class AbbController:
    """Two RAPID tasks: `serve_main` (5000) and `serve_background` (5001)."""

    def __init__(self, arm: ArmDevice, clock: CellClock, robot: Robot, *, stock: bool = False) -> None:
        self.arm = arm
        self.clock = clock
        self.robot = robot
        self.stock = stock
        self.serial = "120-500000"
        self.lose_first_reply = False
        self.limits_told = (
            True  # False: their names in the configuration are not those that the program reads
        )
        self.speed = [100.0, 50.0]  # mm/s, deg/s: what open_abb starts with
        self._one_main = asyncio.Lock()
        self._one_background = asyncio.Lock()
        self._main_writer: asyncio.StreamWriter | None = None
        self._last_code = 0
        self._kept: tuple[list[float], int] | None = (
            None  # the target of the last 201, and the sum of that request
        )
        self._watchdog_s = 0.0
        self._settle_s = 0.0
        self._last_word = time.monotonic()  # of the client
        self._stop_asked = False
        self._watchdog_acted = False
        self._restarted = asyncio.Event()

    # -- connections --------------------------------------------------------------------------------------

    async def serve_main(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        async with self._one_main:
            self._main_writer = writer
            self._kept = None
            forget = self.lose_first_reply
            rest = b""
            try:
                while data := await reader.read(1024):
                    self._last_word = time.monotonic()
                    if self.stock:
                        requests = [data[:80].split(b"#")[0] + b"#" if b"#" in data[:80] else data[:80]]
                    else:
                        *whole, rest = (rest + data).split(b"#")
                        requests = [request + b"#" for request in whole]
                    for request in requests:
                        reply = await self._main_reply(request.decode("latin-1").strip())
                        if reply is None:
                            return
                        if forget:
                            forget = False
                            continue
                        writer.write(reply.encode())
                        await writer.drain()
            finally:
                self._main_writer = None

    async def serve_background(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        async with self._one_background:
            if self.stock:
                await self._log(writer)
                return
            rest = b""
            while data := await reader.read(1024):
                self._last_word = time.monotonic()
                *whole, rest = (rest + data).split(b"#")
                for request in whole:
                    writer.write(self._background_reply(request.decode("latin-1").strip() + " #").encode())
                    await writer.drain()

    async def restart(self) -> None:
        """Emergency stop released and program pointer set to main: the connection is reset."""
        self.arm.restart()
        self._restarted.set()
        self._restarted = asyncio.Event()
        if self._main_writer is not None:
            await drop(self._main_writer, reset=True)

    async def _dead(self) -> NoReturn:
        """Read and answer nothing until the stopped program is started again."""
        await self._restarted.wait()
        raise ConnectionResetError("program pointer to main")

    async def _log(self, writer: asyncio.StreamWriter) -> None:
        """Push log records without end marks, as LOGGER does.

        Records `# 0` are positions (not simulated, zeros); records `# 1` are joints.
        """
        stamp = "11-21-2026 12:00:00"
        while True:
            joints = " ".join(f"{q:.2f}" for q in self.joints_deg())
            t = self.clock.now()
            writer.write(f"# 0 {stamp} {t:.2f} 0.0 0.0 0.0 1.000 0.000 0.000 0.000 ".encode())
            writer.write(f"# 1 {stamp} {t:.2f} {joints} ".encode())
            await writer.drain()
            await asyncio.sleep(LOG_EVERY_S)

    def joints_deg(self) -> tuple[float, ...]:
        """Return the current joint angles of the arm, as the controller counts them, deg."""
        return self.robot.counting.counted(self.arm.joints_deg())

    # -- requests -----------------------------------------------------------------------------------------

    @staticmethod
    def _words(request: str) -> tuple[int, list[float]] | None:
        words = request.split()
        if not words or words[-1] != "#":
            return None
        try:
            return int(words[0]), [float(word) for word in words[1:-1]]
        except (ValueError, IndexError):
            return None

    async def _main_reply(self, request: str) -> str | None:
        if self.arm.hung:
            await self._dead()
        parsed = self._words(request)
        if parsed is None:
            if not self.stock and self._last_code >= 200:
                return f"{self._last_code} 0 {BAD} 0 #\n"
            return f"{self._last_code} 0 "
        code, values = parsed
        self._last_code = code
        if code >= 200:
            if self.stock:
                return f"{code} 0 "
            return await self._numbered(code, values, background=False, text=request)
        if code == 99:
            return None
        good, data = await self._open_abb(code, values)
        return f"{code} {int(good)} {data}"

    async def _open_abb(self, code: int, values: list[float]) -> tuple[bool, str]:
        wanted = {0: (0,), 2: (6,), 3: (0,), 4: (0,), 6: (7,), 7: (7,), 8: (2, 4), 9: (4,), 98: (0,)}
        if len(values) not in wanted.get(code, ()) or (code in (2, 6, 7, 8, 9) and not self.stock):
            return False, ""
        if code == 2:
            legal = self.arm.within_limits(values) and self.arm.can_move
            if not legal:
                self.arm.supervise()
            if not legal or await self._move(values) is not Outcome.ARRIVED:
                await self._dead()  # the task stops; the reply never comes
            return True, ""
        if code == 3:  # the cell has no forward kinematics of the controller: origin, identity
            return True, "0.00 0.00 0.00 1.000 0.000 0.000 0.000"
        if code == 4:
            return True, " ".join(f"{q:.2f}" for q in self.joints_deg())
        if code == 8:
            self.speed = values[:2]
        if code == 98:
            return True, f"{self.serial}*6.08.0134*{self.robot.shown}"
        return True, ""

    async def _numbered(self, code: int, values: list[float], *, background: bool, text: str = "") -> str:
        if code == 200:
            return "200 1 CAL 2 5 #\n" if not values else f"200 0 {BAD} 0 #\n"
        wanted = {201: 7, 202: 1, 203: 1, 204: 1, 205: 1, 206: 2, 207: 1, 208: 4, 209: 2}
        number = int(values[0]) if values else 0
        if code not in wanted or (background and code in (201, 206, 208, 209)):
            return f"{code} 0 {UNKNOWN} {number} #\n"
        if len(values) != wanted[code] or not 1 <= number <= 9999:
            return f"{code} 0 {BAD} {number} #\n"
        data = ""
        if code == 201:
            self._kept = None
            if not self.limits_told:
                return f"{code} 0 {LIMITS_UNTOLD} {number} #\n"
            if not self.arm.within_limits(values[1:]):
                return f"{code} 0 {RANGE} {number} #\n"
            self._kept = values[1:], fletcher(text)
            data = " ".join(f"{q:.5f}" for q in values[1:]) + " "
        elif code == 209:
            error = await self._go(int(values[1]))
            if error:
                return f"{code} 0 {error} {number} #\n"
        elif code == 202:
            if not background and self._settle_s:
                await self.clock.wait(self._settle_s, asyncio.Event())
            data = " ".join(f"{q:.5f}" for q in self.joints_deg()) + " "
        elif code == 203:
            data = "0.0000 0.0000 0.0000 "
        elif code == 204:
            data = "1.000000 0.000000 0.000000 0.000000 0 0 0 0 "
        elif code == 205:
            arm = self.arm
            flags = [arm.motors_on, arm.emergency_stop, arm.moving, arm.hung]
            data = f"{MODES[arm.mode]} 1 " + " ".join(str(int(flag)) for flag in flags) + " "
        elif code == 206:
            self._settle_s = values[1]
        elif code == 207:
            self._stop_asked = True
            self.arm.halt()
        elif code == 208:
            if min(values[2:]) <= 0:
                return f"{code} 0 {BAD} {number} #\n"
            self._watchdog_s, self.speed = values[1] / 1000, values[2:]
            data = f"{values[1]:.0f} {values[2]:.1f} {values[3]:.1f} "
        return f"{code} 1 {number} {data}#\n"

    def _background_reply(self, request: str) -> str:
        parsed = self._words(request)
        if parsed is None:
            return f"0 0 {BAD} 0 #\n"
        coroutine = self._numbered(*parsed, background=True)
        try:
            coroutine.send(None)  # nothing that the background task answers ever waits
        except StopIteration as done:
            return done.value
        raise RuntimeError("background request waited")

    # -- motion -------------------------------------------------------------------------------------------

    async def _go(self, proof: int) -> int:
        kept, self._kept = self._kept, None  # one go, one move
        if kept is None or kept[1] != proof:
            return OTHER_TARGET
        arm = self.arm  # at reduced speed a hand holds the enabling device as long as the motors are on
        if arm.mode == "manual_full" or not arm.motors_on or arm.emergency_stop or arm.hung:
            return MODE
        outcome = await self._move(kept[0])
        if outcome is Outcome.DEAD:
            await self._dead()
        if outcome is Outcome.STOPPED:
            return STOPPED if self._watchdog_acted else INTERRUPTED
        return 0

    async def _move(self, target: list[float]) -> Outcome:
        arm, mode = self.arm, self.arm.mode
        self._stop_asked = self._watchdog_acted = False
        arm.start(
            self.robot.counting.to_model(target),
            rate_deg_s=max(self.speed[1], 0.1),
            tool_mm_s=max(self.speed[0], 0.1),
        )
        guard = asyncio.create_task(self._guard()) if self._watchdog_s else None
        try:
            while True:
                arm.changed.clear()
                if arm.hung:
                    return Outcome.DEAD
                if self._stop_asked or self._watchdog_acted:
                    return Outcome.STOPPED
                if not arm.motors_on or arm.mode != mode:
                    arm.motors_on = False
                    arm.supervise()
                    return Outcome.DEAD
                if not arm.moving:
                    return Outcome.ARRIVED
                await self.clock.wait(arm.left_s, arm.changed)
        finally:
            if guard is not None:
                guard.cancel()
                with suppress(asyncio.CancelledError):
                    await guard

    async def _guard(self) -> None:
        """Watchdog: stops the arm when no word came from the client for too long."""
        await silence(self._watchdog_s, lambda: self._last_word)
        self._watchdog_acted = True
        self.arm.halt()
