"""Simulated Remote Motion Interface (RMI) of a Fanuc: JSON lines on two ports.

Written from the packet definitions of the maker's ROS 2 driver and from reports of owners, not from our driver. The
first port answers `FRC_Connect`, the second serves the session. These properties are kept on purpose:

- One session at a time. A second `FRC_Connect` is refused (RMIT-026), or, as on a CRX-10iA, answered with a port at
  which nothing answers (`second` is "silent").
- Instructions need `FRC_Initialize`, numbers without a gap, and an end of FINE for the last one, which otherwise waits
  for the next. Eight may be under way. An answer comes when the robot has carried the instruction out.
- A wrong number or field puts RMI on hold until `FRC_Reset`; instructions that the program has already are carried out.
- A lost connection leaves RMI_MOVE running, so that `FRC_Initialize` of the next session fails until `FRC_Abort`.
  `FRC_Disconnect` aborts it.
- An alarm pauses RMI_MOVE, and `FRC_SystemFault` comes without a question.
"""

from __future__ import annotations

import asyncio
import json
import time
from collections import deque
from collections.abc import Awaitable, Callable, Mapping
from typing import Any

from mocks.fanuc.controller import MAX_DEG_S, End, FanucController
from mocks.shared.sockets import Endpoint, Servers

Packet = dict[str, Any]

AHEAD = 8  # instructions that the controller takes
RUNNING, PAUSED, ABORTED = 0, 1, 2  # ProgramStatus
_RMIT = 2556928
SERVO_OFF, PENDANT, NOT_RUNNING, NOT_PAUSED, NO_RESET, UNKNOWN, FAILED, STATE = (
    _RMIT + number for number in (7, 8, 9, 10, 12, 13, 14, 15)
)
VALUE, POSITION, HOLD, CONNECTED, BUSY, SEQUENCE, SPEED_TYPE, SPEED, TERM_TYPE = (
    _RMIT + number for number in (21, 23, 24, 26, 28, 29, 30, 31, 32)
)
SELECTED = 7015
_ALARMS = {
    (11, 1): "SRVO-001 Operator panel E-stop",
    (11, 4): "SRVO-004 Fence open",
    (11, 50): "SRVO-050 Collision Detect alarm",
    (15, 17): "MOTN-017 Limit error",
    (24, 42): "SYST-042 DEADMAN defeated",
}


class RmiServer:
    """RMI of one controller.

    Attributes
    ----------
    version
        Major and minor version. Below 6, `FRC_Reset` is unknown and a status has no override.
    second
        "refused" or "silent": what happens to a second client.
    checks_numbers
        System variable $RMI_CFG.$Chk_seqID; without it a status has no NextSequenceID.
    keeps_numbers
        Whether the count of instructions continues after `FRC_Initialize`.
    override
        General override, %.
    selected
        Whether RMI_MOVE is selected on the pendant.
    single_step
        Whether the pendant is in single step mode.
    """

    def __init__(self, controller: FanucController) -> None:
        self.controller = controller
        self.version: tuple[int, int] = (9, 0)
        self.second = "refused"
        self.checks_numbers, self.keeps_numbers = True, False
        self.override = 100
        self.selected = self.single_step = False
        self.session_port = 0
        self.running, self.program, self.hold = False, ABORTED, False
        self.expected = 1
        self.frames = {"UFrameNumber": 0, "UToolNumber": 1}
        self._taken: asyncio.StreamWriter | None = None
        self._queue: deque[Packet] = deque()
        self._more, self._go_on = asyncio.Event(), asyncio.Event()
        self._task: asyncio.Task[None] | None = None
        self._begun = time.monotonic()

    async def listen(self, servers: Servers, port: int) -> list[Endpoint]:
        """Listen for `FRC_Connect` at `port`, 0 for a free one, and for sessions at a free one.

        Raises
        ------
        OSError
            The port is taken.
        """
        door = await servers.listen(self.serve_door, port)
        self.session_port = await servers.listen(self.serve_session)
        return [
            Endpoint("fanuc-rmi", "rmi", door),
            Endpoint("fanuc-rmi-session", "rmi-session", self.session_port),
        ]

    def orders(self) -> dict[str, Callable[[Packet], Awaitable[None] | None]]:
        """Orders of the back door: send a packet, which ends the session if it is FRC_Terminate."""
        return {"rmi_push": self._push}

    async def _push(self, order: Packet) -> None:
        writer, packet = self._taken, order["packet"]
        if writer is None:
            raise ValueError("no client is connected")
        self._say(packet)
        await writer.drain()
        if packet.get("Communication") == "FRC_Terminate":
            writer.close()

    # -- connections --------------------------------------------------------------------------------------

    async def serve_door(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Answer `FRC_Connect`; the connection ends with the answer."""
        packet = _parsed(await reader.readline())
        if packet.get("Communication") != "FRC_Connect":
            answer: Packet = {"Command": "Unknown", "ErrorID": UNKNOWN}
        else:
            full = self._taken is not None and self.second == "refused"
            answer = {
                "Communication": "FRC_Connect",
                "ErrorID": CONNECTED if full else 0,
                "PortNumber": 0 if full else self.session_port,
                "MajorVersion": self.version[0],
                "MinorVersion": self.version[1],
            }
        writer.write(_line(answer))
        await writer.drain()

    async def serve_session(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Serve the only client; another one is never answered."""
        if self._taken is not None:
            await reader.read(-1)
            return
        self._taken = writer
        try:
            while line := await reader.readline():
                packet = _parsed(line)
                if "Instruction" in packet:
                    self._instruct(packet)
                else:
                    self._say(self._obey(packet))
                await writer.drain()
                if packet.get("Communication") == "FRC_Disconnect":
                    return
        finally:
            self._taken = None

    def _say(self, packet: Packet) -> None:
        if self._taken is not None:
            self._taken.write(_line(packet))

    # -- commands -----------------------------------------------------------------------------------------

    def _obey(self, packet: Packet) -> Packet:
        kind = "Communication" if "Communication" in packet else "Command"
        name = str(packet.get(kind))
        table: dict[str, Callable[[Packet], int | Packet]] = {
            "FRC_Disconnect": self._disconnect,
            "FRC_Initialize": self._initialize,
            "FRC_Abort": self._abort,
            "FRC_Pause": self._pause,
            "FRC_Continue": self._continue,
            "FRC_GetStatus": self._status,
            "FRC_ReadJointAngles": self._joints,
            "FRC_ReadCartesianPosition": self._position,
            "FRC_ReadError": self._read_error,
            "FRC_SetOverRide": self._set_override,
            "FRC_SetUFrameUTool": self._set_frames,
            "FRC_GetUFrameUTool": lambda _: dict(self.frames),
        }
        if self.version[0] >= 6:
            table["FRC_Reset"] = self._reset
        if name not in table or (kind == "Communication") != (name == "FRC_Disconnect"):
            return {"Command": "Unknown", "ErrorID": UNKNOWN}
        answer = table[name](packet)
        error, fields = (answer, {}) if isinstance(answer, int) else (0, answer)
        return {kind: name, "ErrorID": error, **fields}

    def _disconnect(self, _: Packet) -> int:
        if self.running:
            self._abort({})
        return 0

    def _initialize(self, _: Packet) -> int | Packet:
        arm = self.controller.arm
        if self.running:
            return STATE
        if self.hold:
            return HOLD
        if self.selected:
            return SELECTED
        if arm.mode != "auto":
            return PENDANT
        if not self.controller.fit:
            return SERVO_OFF
        if not self.keeps_numbers:
            self.expected = 1
        self.running, self.program = True, RUNNING
        self._queue.clear()
        self._task = asyncio.get_running_loop().create_task(self._run())
        return {"GroupMask": 1}

    def _abort(self, _: Packet) -> int:
        if not self.running:
            return FAILED
        self.controller.stop()
        if self._task is not None:
            self._task.cancel()
            self._task = None
        self._queue.clear()
        self.running, self.program = False, ABORTED
        return 0

    def _pause(self, _: Packet) -> int:
        if not self.running:
            return NOT_RUNNING
        self.program = PAUSED
        self._go_on.clear()
        self.controller.stop()
        return 0

    def _continue(self, _: Packet) -> int:
        if not self.running or self.program != PAUSED:
            return NOT_PAUSED
        self.program = RUNNING
        self._go_on.set()
        return 0

    def _reset(self, _: Packet) -> int:
        if self.controller.arm.emergency_stop:
            return NO_RESET
        self.hold = False
        return 0

    def _status(self, _: Packet) -> Packet:
        arm = self.controller.arm
        shown = {
            "ServoReady": int(arm.motors_on and not arm.emergency_stop and not arm.hung),
            "TPMode": int(arm.mode != "auto"),
            "RMIMotionStatus": int(self.running),
            "ProgramStatus": self.program,
            "SingleStepMode": int(self.single_step),
            "NumberUTool": 10,
            "NumberUFrame": 9,
        }
        if self.checks_numbers:
            shown["NextSequenceID"] = self.expected
        return shown if self.version[0] < 6 else shown | {"Override": self.override}

    def _time_tag(self) -> int:
        return int(1000 * (time.monotonic() - self._begun))

    def _joints(self, packet: Packet) -> Packet:
        angles = (*self.controller.joints_deg(), 0.0, 0.0, 0.0)
        named = {f"J{i}": round(q, 3) for i, q in enumerate(angles, start=1)}
        return {"TimeTag": self._time_tag(), "JointAngle": named, "Group": packet.get("Group", 1)}

    def _position(self, packet: Packet) -> Packet:
        places = zip("XYZWPR", self.controller.pose(), strict=True)
        configuration = dict.fromkeys(("Front", "Up", "Left", "Flip", "Turn4", "Turn5", "Turn6"), 0)
        return {
            "TimeTag": self._time_tag(),
            "Configuration": {**self.frames, **configuration},
            "Position": {name: round(value, 3) for name, value in places}
            | dict.fromkeys(("Ext1", "Ext2", "Ext3"), 0.0),
            "Group": packet.get("Group", 1),
        }

    def _read_error(self, packet: Packet) -> Packet:
        alarm = self.controller.current_alarm()
        texts = ["No Error"] if alarm == (0, 0) else [_ALARMS.get(alarm, "SYST-001 Other")]
        if alarm == (11, 1):  # the newest comes first, and it is not the reason
            texts.insert(0, "SRVO-289 SFIN off")
        keys = ("ErrorData", *(f"ErrorData{i}" for i in range(2, 6)))
        shown = dict(zip(keys, texts[: packet.get("Count", 1)], strict=False))
        return ({"Count": packet["Count"]} if "Count" in packet else {}) | shown

    def _set_override(self, packet: Packet) -> int:
        value = packet.get("Value")
        if not isinstance(value, int) or not 1 <= value <= 100:
            return _RMIT + 5
        self.override = value
        return 0

    def _set_frames(self, packet: Packet) -> int:
        self.frames.update({key: int(packet.get(key, old)) for key, old in self.frames.items()})
        return 0

    # -- instructions -------------------------------------------------------------------------------------

    def _instruct(self, packet: Packet) -> None:
        """Take an instruction, or answer it at once with the reason why not."""
        error = self._refused(packet)
        if error:
            self._done(packet, error)
            return
        self.expected += 1
        self._queue.append(packet)
        self._more.set()

    def _refused(self, packet: Packet) -> int:
        if not self.running:
            return NOT_RUNNING
        if self.hold:
            return HOLD
        if len(self._queue) >= AHEAD:
            return BUSY
        error = _wrong(packet)
        if not error and self.checks_numbers and packet.get("SequenceID") != self.expected:
            error = SEQUENCE
        self.hold = bool(error)
        return error

    def _done(self, packet: Packet, error: int) -> None:
        name = packet["Instruction"] if error != UNKNOWN else "Unknown"
        self._say({"Instruction": name, "ErrorID": error, "SequenceID": packet.get("SequenceID", 0)})

    async def _run(self) -> None:
        """Carry out RMI_MOVE: one instruction after the other."""
        while True:
            packet = await self._next()
            if packet["Instruction"] == "FRC_WaitTime":
                await self.controller.clock.wait(float(packet["Time"]), asyncio.Event())
            elif packet["Instruction"] in _MOTIONS and not await self._carried_out(packet):
                self._queue.clear()
                self.program = PAUSED
                self._say({"Communication": "FRC_SystemFault", "SequenceID": packet["SequenceID"]})
                return
            self._queue.popleft()
            self._done(packet, 0)

    async def _next(self) -> Packet:
        """Wait for the next instruction; a motion without FINE waits for another."""
        while not self._queue or (len(self._queue) == 1 and self._queue[0].get("TermType", "FINE") != "FINE"):
            self._more.clear()
            await self._more.wait()
        return self._queue[0]

    async def _carried_out(self, packet: Packet) -> bool:
        """Move, on after each pause; False if an alarm ended it."""
        here = self.controller.joints_deg()
        angles = packet["JointAngle"]
        relative = packet["Instruction"] == "FRC_JointRelativeJRep"
        target = [angles[f"J{i}"] + relative * q for i, q in enumerate(here, start=1)]
        while True:
            if not self.controller.within_limits(target):
                self.controller.raise_alarm(15, 17)
                return False
            percent = _percent(packet, self.controller.joints_deg(), target) * self.override / 100.0
            end = await self.controller.move(target, percent)
            if end is End.ARRIVED:
                return True
            if end is not End.STOPPED:
                return False
            if asyncio.current_task() is not self._task:  # aborted; `wait_for` may have swallowed the end
                raise asyncio.CancelledError
            await self._go_on.wait()


_MOTIONS = ("FRC_JointMotionJRep", "FRC_JointRelativeJRep")
_OTHERS = {"FRC_WaitTime": "Time", "FRC_SetUFrame": "FrameNumber", "FRC_SetUTool": "ToolNumber"}


def _wrong(packet: Packet) -> int:
    """Return the ErrorID of a field that is wrong, 0 if none is."""
    name = packet["Instruction"]
    if name in _OTHERS:
        return 0 if isinstance(packet.get(_OTHERS[name]), int | float) else VALUE
    if name not in _MOTIONS:
        return UNKNOWN
    angles = packet.get("JointAngle")
    known = isinstance(angles, Mapping) and all(
        isinstance(angles.get(f"J{i}"), int | float) for i in range(1, 7)
    )
    speed, kind = packet.get("Speed"), packet.get("SpeedType")
    if not known:
        return POSITION
    if kind not in ("Percent", "mSec"):
        return SPEED_TYPE
    if not isinstance(speed, int | float) or not 0 < speed <= (100 if kind == "Percent" else 65535):
        return SPEED
    return 0 if packet.get("TermType") in ("FINE", "CNT") else TERM_TYPE


def _percent(packet: Packet, here: tuple[float, ...], target: list[float]) -> float:
    """Return the speed of a motion, % of the joints' largest; `mSec` states its duration."""
    if packet["SpeedType"] == "Percent":
        return float(packet["Speed"])
    full_s = max(abs(b - a) / top for a, b, top in zip(here, target, MAX_DEG_S, strict=True))
    return min(100.0, 1e5 * full_s / packet["Speed"])


def _parsed(line: bytes) -> Packet:
    """Return the packet in a line, empty if it is none."""
    try:
        packet = json.loads(line)
    except ValueError:
        return {}
    return packet if isinstance(packet, dict) else {}


def _line(packet: Packet) -> bytes:
    return json.dumps(packet).encode() + b"\r\n"
