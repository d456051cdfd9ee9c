"""The primary client interface of a UR controller, TCP 30001: states, messages, URScript.

Every controller has it, PolyScope X too. States come at 10 Hz. Packages have the form of `drivers.ur.secondary`. A
state consists of three sub-packages: 0 modes, 1 joints, 3 masterboard with the safety mode. It has no speeds of the
targets, so those of the joints are taken, and a state while the arm speeds up is not confirmed. Its clock counts
microseconds (not documented; `truepose doctor` sees a clock of another rate).

Messages report errors (`C210A0`), run-time exceptions of a program, and texts. C210 is the answer to a program from
a client that may only read: the controller is in local control. When a person switches it there, it drops the
connections to this port, and those made afterwards may only read.

Sources: Universal Robots, "Primary and secondary interfaces" (docs.universal-robots.com), "Remote control via TCP/IP".
For the layouts of messages and masterboard, and for C210, UniversalRobots/Universal_Robots_Client_Library
`src/primary`. For local control, UniversalRobots/Universal_Robots_ROS_Driver issue 459.
"""

from __future__ import annotations

import logging
import re
import struct
from contextlib import suppress
from dataclasses import dataclass

from drivers.errors import LinkError, LinkTimeout, ProtocolError, WrongMode
from drivers.link import TcpLink
from drivers.ur.script_port import ScriptPort
from drivers.ur.secondary import MESSAGE, STATE, read_package, split_packages
from drivers.ur.software import PRIMARY, Software, where_remote
from drivers.ur.state import JOINTS, PAUSED, PLAYING, STOPPED, UrState, check_state

_LOG = logging.getLogger(__name__)

_MODES, _JOINTS, _MASTERBOARD = 0, 1, 3
_MODES_LAYOUT = ">Q7BbB2d"  # clock, flags, robot mode, control mode, speed fraction, speed scaling
_JOINT_LAYOUT = ">3d4fB"  # actual, target, actual speed; current, voltage, two temperatures; mode
_SAFETY_MODE = 60  # offset in the content of the masterboard, software 3 and later
_TEXT, _ERROR, _EXCEPTION = 0, 6, 10
_ONLY_READS = "C210"
_MOST_PACKAGES = 50
_WORD = "truepose asks"
_QUESTION = f'sec truepose():\n  textmsg("{_WORD}")\nend\n'  # runs beside any program, and cannot move


def parse_robot_state(content: bytes) -> UrState | None:
    """Parse the content of a state package, None if it lacks joints, modes or masterboard.

    Raises
    ------
    ProtocolError
        A sub-package has a wrong length, or a value is out of range.
    """
    parts = dict(split_packages(content))
    if not {_MODES, _JOINTS, _MASTERBOARD} <= set(parts):
        return None
    modes, joints, board = parts[_MODES], parts[_JOINTS], parts[_MASTERBOARD]
    size = struct.calcsize(_JOINT_LAYOUT)
    if (
        len(modes) < struct.calcsize(_MODES_LAYOUT)
        or len(joints) < JOINTS * size
        or len(board) <= _SAFETY_MODE
    ):
        raise ProtocolError("state of a wrong length", raw=content[:64])
    clock_us, *flags, robot_mode, _, _, speed_share = struct.unpack_from(_MODES_LAYOUT, modes)
    if not set(flags) <= {0, 1}:
        raise ProtocolError("a flag that is neither 0 nor 1", raw=content[:64])
    *_, running, paused = flags
    rows = zip(*(struct.unpack_from(_JOINT_LAYOUT, joints, i * size) for i in range(JOINTS)), strict=True)
    actual, target, speed, _, _, temperature, *_ = rows
    state = UrState(
        t_s=clock_us * 1e-6,
        target_rad=target,
        actual_rad=actual,
        target_rad_s=speed,
        actual_rad_s=speed,
        robot_mode=robot_mode,
        safety_mode=board[_SAFETY_MODE],
        runtime_state=PAUSED if paused else PLAYING if running else STOPPED,
        echo=None,
        raw=content,
        temperatures_c=temperature,
        speed_share=speed_share,
    )
    check_state(state)
    return state


@dataclass(frozen=True, slots=True)
class ControllerMessage:
    """A message of the controller, with the code of an error, such as `C210`, or no code."""

    text: str
    code: str = ""
    is_fault: bool = False


def parse_message(content: bytes) -> ControllerMessage | None:
    """Parse a text, an error or an exception of a program; return None for other messages.

    Raises
    ------
    ProtocolError
        The message has a wrong length.
    """
    if len(content) < 10:
        raise ProtocolError("message of a wrong length", raw=content)
    kind, body = content[9], content[10:]
    layout = {_TEXT: ">", _ERROR: ">iiiII", _EXCEPTION: ">ii"}.get(kind)
    if layout is None:
        return None
    if len(body) < struct.calcsize(layout):
        raise ProtocolError("message of a wrong length", raw=content)
    numbers = struct.unpack_from(layout, body)
    # A terminal would obey control characters.
    text = re.sub(r"[^ -~]+", " ", body[struct.calcsize(layout) :].decode("latin-1")).strip()
    if kind == _TEXT:
        return ControllerMessage(text)
    if kind == _EXCEPTION:
        return ControllerMessage(f"the program failed in line {numbers[0]}: {text}", is_fault=True)
    code = f"C{numbers[0]}"
    return ControllerMessage(f"{code}A{numbers[1]} {text}".strip(), code, is_fault=True)


def in_local_control(software: Software | None, raw: bytes = b"") -> WrongMode:
    """Return the error of a controller that takes no programs."""
    return WrongMode(
        "the controller is in local control: it ignores every program that is sent, a stop too",
        raw=raw,
        what_to_do=where_remote(software),
    )


class Primary(ScriptPort):
    """Port 30001."""

    name = "primary"
    service = PRIMARY

    def _next(self, link: TcpLink, command: str, *, sent: bool = False) -> UrState:
        for _ in range(_MOST_PACKAGES):
            kind, content = self._package(link, command)
            if kind == MESSAGE:
                self._hear(content, sent=sent)
            elif kind == STATE and (state := parse_robot_state(content)) is not None:
                return state
        raise LinkTimeout("no joints among the states", device=self.device, command=command)

    def takes_programs(self) -> bool | None:
        """Check whether the controller runs programs sent here; None if it does not report it.

        A secondary program writes one line, which comes back. It runs in parallel to a program, cannot move the arm and
        sets nothing.
        """
        with suppress(LinkError), self._connection("remote control?") as link:
            self._next(link, "remote control?")
            link.send(_QUESTION.encode("ascii"), command="remote control?", send_s=self.deadlines.send_s)
            end = link.clock() + self.deadlines.reply_s
            while link.clock() < end:
                kind, content = self._package(link, "remote control?")
                message = parse_message(content) if kind == MESSAGE else None
                if message is not None and message.code == _ONLY_READS:
                    return False
                if message is not None and _WORD in message.text:
                    return True
        return None

    def _package(self, link: TcpLink, command: str) -> tuple[int, bytes]:
        return read_package(link, command, self.deadlines.reply_s)

    def _hear(self, content: bytes, *, sent: bool) -> None:
        """Log a fault that the controller reports.

        Raises
        ------
        WrongMode
            The controller is in local control and refused the program that was sent.
        """
        message = parse_message(content)
        if message is None or not message.is_fault:
            return
        _LOG.warning("%s says: %s", self.device, message.text)
        if sent and message.code == _ONLY_READS:
            raise in_local_control(None, content)
