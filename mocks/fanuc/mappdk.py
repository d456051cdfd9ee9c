"""Simulated KAREL servers of a Fanuc on TCP 18735 and 18736: stock MAPPDK or our superset.

Written from the description of the protocol, not from the driver. Stock is MAPPDK as fanucpy brings it. These
properties are kept on purpose:

- Commands are recognised by their first letters only, and answers have no end mark.
- One client per port. A second is accepted by the network and never greeted.
- A stock move runs with CNT and is answered while the arm still runs out.
- A move that an alarm pauses is never answered. The second port continues to answer.

Ours (`stock` False) knows `calname`, `calstat`, `calstop` and `calbeat` on the second port. On the first port
it moves in two steps: `calset` with the target, then `calgo` with the checksum that the client has of that
request. It ends moves FINE and answers every one.
"""

from __future__ import annotations

import asyncio
import re
import time

from mocks.fanuc.controller import End, FanucController

_SLOTS = 9  # joint values in an answer; missing axes are `none`
_VALUE_CHARS = 14
_FIRST_FIELD = len("movej:")
_SET = re.compile(r"calset:(\d{4}):(\d{4})" + r":([+-]\d{6}\.\d{6})" * 6)
_GO = re.compile(r"calgo:(\d{4}):(\d{3})")
_OTHER_TARGET = 5
_ENDS = {End.ARRIVED: 0, End.STOPPED: 1, End.SILENT: 3, End.UNFIT: 4}


def total(text: str) -> int:
    """Return the sum of the character codes modulo 1000."""
    so_far = 0
    for character in text:
        so_far = (so_far + ord(character)) % 1000
    return so_far


def sealed(text: str) -> str:
    """Return an answer of our own commands: its text, its sum, an end mark."""
    return f"{text},k={total(text):03d};"


class MappdkServer:
    """Two KAREL tasks: `serve_main` and `serve_logger`."""

    def __init__(self, controller: FanucController, *, stock: bool = False) -> None:
        self.controller = controller
        self.stock = stock
        self._one_main = asyncio.Lock()
        self._one_logger = asyncio.Lock()
        self._kept: tuple[int, list[float], int] | None = None  # speed, target and sum of the last calset

    async def serve_main(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        async with self._one_main:
            self._kept = None
            await self._serve(reader, writer, second=False)

    async def serve_logger(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        async with self._one_logger:
            await self._serve(reader, writer, second=True)

    async def _serve(
        self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter, *, second: bool
    ) -> None:
        writer.write(b"0:success")
        await writer.drain()
        while line := await reader.readline():
            command = line.decode("latin-1").strip()
            if command == "exit":
                writer.write(b"0:success")
                await writer.drain()
                return
            writer.write((await self._answer(command, second=second)).encode())
            await writer.drain()

    async def _answer(self, command: str, *, second: bool) -> str:
        if second:
            self.controller.last_word = time.monotonic()
        if command.startswith("curpos"):
            pose = zip("xyzwpr", self.controller.pose(), strict=True)
            return "0:" + ",".join(f"{axis}={value:8.3f}" for axis, value in pose)
        if command.startswith("curjpos"):
            joints = [f"{q:8.3f}" for q in self.controller.joints_deg()]
            return "0:" + ",".join(f"j={value}" for value in [*joints, *["none"] * (_SLOTS - len(joints))])
        if command.startswith("movej") and self.stock:
            return await self._move(command)
        if command.startswith("calset") and not second and not self.stock:
            return self._keep(command)
        if command.startswith("calgo") and not second and not self.stock:
            return await self._go(command)
        if command.startswith("cal") and second and not self.stock:
            return self._ours(command)
        return "1:wrong-command"

    async def _move(self, command: str) -> str:
        """movej:VVVV:AAAA:CCC:M:N: and N values of 14 characters."""
        at = _FIRST_FIELD
        fields = []
        for width in (4, 4, 3, 1, 1):
            fields.append(command[at : at + width])
            at += width + 1
        try:
            velocity, _, _, _, count = (int(field) for field in fields)
            values = [
                float(command[i : i + _VALUE_CHARS])
                for i in range(at, at + count * (_VALUE_CHARS + 1), _VALUE_CHARS + 1)
            ]
        except ValueError:
            return "1:error-in-joint-values"
        if len(values) != 6:
            return "1:error-in-joint-values"
        if not self.controller.within_limits(values):
            return "1:position-is-not-reachable"
        if await self.controller.move(values, velocity, cnt=True) is not End.ARRIVED:
            self.controller.arm.supervise()
            await self.controller.until_restart()
        return "0:success"

    def _keep(self, command: str) -> str:
        """Keep the target of a calset request and show it back.

        The request is `calset:NNNN:VVVV:` and six values of 14 characters.
        """
        self._kept = None
        found = _SET.fullmatch(command)
        if not found or not 1 <= int(found[2]) <= 100:
            return "1:error-in-joint-values"
        values = [float(text) for text in found.groups()[2:]]
        if not self.controller.within_limits(values):
            return "1:position-is-not-reachable"
        self._kept = int(found[2]), values, total(command)
        return sealed(f"0:c={found[1]},v={found[2]}" + "".join(f",j={value:14.6f}" for value in values))

    async def _go(self, command: str) -> str:
        """calgo:NNNN:SSS: one go, one move."""
        kept, self._kept = self._kept, None
        found = _GO.fullmatch(command)
        if not found:
            return "1:wrong-command"
        if kept is None or kept[2] != int(found[2]):
            return sealed(f"0:c={found[1]},r={_OTHER_TARGET}")
        return sealed(f"0:c={found[1]},r={_ENDS[await self.controller.move(kept[1], kept[0])]}")

    def _ours(self, command: str) -> str:
        words = command.split(":")
        if len(words) < 2 or len(words[1]) != 4 or not words[1].isdecimal():
            return "1:wrong-command"
        arm, head = self.controller.arm, f"0:c={words[1]}"
        if words[0] == "calname":
            return sealed(f"{head},v=2,{self.controller.robot.shown},V7.70P")
        if words[0] == "calstat":
            flags = (arm.mode == "auto", arm.motors_on, arm.emergency_stop, arm.moving)
            bits = ",".join(f"{name}={int(flag)}" for name, flag in zip("apem", flags, strict=True))
            facility, number = self.controller.current_alarm()
            return sealed(f"{head},{bits},n={1000 * facility + number:05d}")
        if words[0] == "calstop":
            self.controller.stop()
            return sealed(head)
        if words[0] == "calbeat" and len(words) == 3 and words[2].isdecimal():
            self.controller.beat_s = int(words[2]) / 1000
            return sealed(f"{head},w={int(words[2]):05d}")
        return "1:wrong-command"
