"""Messages of ROS-Industrial's `simple_message` as its abb_driver packs them on an IRC5.

They are little-endian:

    u32 length of what follows | i32 type | i32 communication | i32 reply | body
    JOINT (10)            length 56   i32 0, 10 f32: six joints rad, four external axes m
    JOINT_TRAJ_PT (11)    length 64   i32 sequence, 10 f32 as above, f32 velocity, f32 duration s
      its reply           length 12   no body
    STATUS (13)           length 40   7 i32: drives, e-stop, error code, in error, in motion, mode, motion possible

Source: ros-industrial/abb_driver, `rapid/ROS_messages.sys`, `ROS_motionServer.mod` and `ROS_stateServer.mod`. No
message has a number, a time or a checksum; `drivers.abb.simple` decides whether it is accepted.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from dataclasses import dataclass

from drivers.errors import (
    EmergencyStop,
    EnableLost,
    NotReady,
    ProtectiveStop,
    ProtocolError,
    WrongMode,
)

JOINTS = 6
START, END, STOP = -1, -3, -4  # sequence of a point: first, last, and stop and discard
JOINT_LENGTH, STATUS_LENGTH, REPLY_LENGTH = 56, 40, 12
SUCCESS, FAILURE = 1, 2
_JOINT, _TRAJ_PT, _STATUS = 10, 11, 13
_TOPIC, _REQUEST, _REPLY = 1, 2, 3
_STATE = struct.Struct("<I4i10f" + "I10i")
_POINT = struct.Struct("<I4i12f")
_ANSWER = struct.Struct("<I3i")
STATE_SIZE, ANSWER_SIZE = _STATE.size, _ANSWER.size
_WIDEST_RAD = math.radians(1000.0)  # no joint of any ABB arm turns further
_TRISTATE = {-1: None, 0: False, 1: True}
_MODES = {-1: "unknown", 1: "manual", 2: "auto"}


@dataclass(frozen=True, slots=True)
class Flags:
    """The controller state in a STATUS message; None if the controller does not know."""

    mode: str
    motors_on: bool | None
    emergency_stop: bool | None
    moving: bool | None
    motion_possible: bool | None
    in_error: bool | None
    error_code: int


@dataclass(frozen=True, slots=True)
class AbbState:
    """A JOINT message and the STATUS after it.

    `joints_rad` (6,) and `external` (4,) are as received.
    """

    joints_rad: tuple[float, ...]
    external: tuple[float, ...]
    flags: Flags
    raw: bytes

    @property
    def joints_deg(self) -> tuple[float, ...]:
        return tuple(math.degrees(q) for q in self.joints_rad)

    @property
    def resolution_deg(self) -> float:
        """The resolution of a float32 at the largest joint angle, deg; 1.4e-5 deg at 180 deg."""
        _, exponent = math.frexp(max(map(abs, self.joints_rad)))
        return math.degrees(math.ldexp(1.0, exponent - 24))


def parse_state(raw: bytes) -> AbbState:
    """Parse a JOINT and a STATUS message, STATE_SIZE bytes.

    Raises
    ------
    ProtocolError
        The bytes are not these messages, or a value is out of range.
    """
    if len(raw) != STATE_SIZE:
        raise ProtocolError("joints and status of a wrong length", raw=raw)
    values = _STATE.unpack(raw)
    if values[:4] != (JOINT_LENGTH, _JOINT, _TOPIC, 0):
        raise ProtocolError("not a JOINT message", raw=raw)
    if values[15:19] != (STATUS_LENGTH, _STATUS, _TOPIC, 0):
        raise ProtocolError("JOINT is not followed by STATUS: lost bytes, or too old an abb_driver", raw=raw)
    joints, external = values[5 : 5 + JOINTS], values[11:15]
    drives, e_stop, code, error, motion, mode, possible = values[19:]
    if not all(abs(q) < _WIDEST_RAD for q in joints):  # a NaN fails as well
        raise ProtocolError("joint angle out of range", raw=raw)
    if not {drives, e_stop, error, motion, possible} <= _TRISTATE.keys() or mode not in _MODES:
        raise ProtocolError("status out of range", raw=raw)
    flags = Flags(
        mode=_MODES[mode],
        motors_on=_TRISTATE[drives],
        emergency_stop=_TRISTATE[e_stop],
        moving=_TRISTATE[motion],
        motion_possible=_TRISTATE[possible],
        in_error=_TRISTATE[error],
        error_code=code,
    )
    return AbbState(joints, external, flags, raw)


def encode_point(
    sequence: int, joints_rad: Sequence[float], external: Sequence[float], duration_s: float
) -> bytes:
    """Encode a JOINT_TRAJ_PT that requests a reply. The controller does not use its velocity."""
    return _POINT.pack(64, _TRAJ_PT, _REQUEST, 0, sequence, *joints_rad, *external, 0.0, duration_s)


def parse_reply(raw: bytes) -> bool:
    """Check whether the controller accepted a JOINT_TRAJ_PT.

    Raises
    ------
    ProtocolError
        The message is not the reply to it.
    """
    if len(raw) != ANSWER_SIZE:
        raise ProtocolError("reply of a wrong length", raw=raw)
    length, kind, communication, reply = _ANSWER.unpack(raw)
    if (length, kind, communication) != (REPLY_LENGTH, _TRAJ_PT, _REPLY) or reply not in (SUCCESS, FAILURE):
        raise ProtocolError("answer to another question, or not an answer", raw=raw)
    return reply == SUCCESS


def raise_if_unfit(state: AbbState, device: str, command: str) -> None:
    """Check that a state allows motion.

    A value that the controller does not know counts as bad.

    Raises
    ------
    EmergencyStop
        The emergency stop is pressed.
    WrongMode
        The mode is not automatic, or the motors are off before a move.
    EnableLost, ProtectiveStop
        The motors went off, or motion became impossible, during a move.
    NotReady
        Motion is not possible before a move.
    """
    flags, where, moving = state.flags, {"device": device, "command": command}, command == "move_to"
    if flags.emergency_stop:
        raise EmergencyStop("emergency stop pressed", **where, raw=state.raw)
    if flags.mode != "auto":
        raise WrongMode(f"controller in mode {flags.mode}", **where, raw=state.raw)
    if not flags.motors_on:
        kind = EnableLost if moving else WrongMode
        raise kind("motors off", **where, raw=state.raw)
    if flags.in_error or not flags.motion_possible or flags.emergency_stop is None:
        number = f", error {flags.error_code}" if flags.in_error else ""
        kind = ProtectiveStop if moving else NotReady
        raise kind(
            f"controller says that motion is not possible{number}",
            **where,
            raw=state.raw,
            what_to_do="Start all three ROS programs on the controller, the motion task too, then confirm.",
        )
