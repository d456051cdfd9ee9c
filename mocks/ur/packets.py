"""Packets of the UR streams on 30003, 30002 and 30001.

Written from the maker's sheets, not from the driver. A packet of 30003 (software 3.14) has 1140 bytes. Fields
are at their place in the sheet, each a double. The streams on 30002 and 30001 have packages of sub-packages, `>IB` size
and type, with the version message first; the one on 30001 has messages between its states.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass

REALTIME_BYTES = 1140
UPTIME_S = 1e6
_FIELDS = {  # offset of the first double
    "time": 4,
    "q_target": 12,
    "qd_target": 60,
    "q_actual": 252,
    "qd_actual": 300,
    "motor_temperatures": 692,
    "controller_timer": 740,
    "robot_mode": 756,
    "joint_modes": 764,
    "safety_mode": 812,
    "speed_scaling": 940,
    "v_main": 972,
    "program_state": 1052,
    "safety_status": 1108,
}


@dataclass(frozen=True)
class Dh:
    """DH numbers as the controller keeps them: rad and m."""

    theta: Sequence[float]
    a: Sequence[float]
    d: Sequence[float]
    alpha: Sequence[float]


def realtime_packet(**fields: float | Sequence[float]) -> bytes:
    """Return one packet of the real-time interface; fields that are not given are 0."""
    packet = bytearray(REALTIME_BYTES)
    struct.pack_into(">I", packet, 0, REALTIME_BYTES)
    for name, value in fields.items():
        numbers = [value] if isinstance(value, (int, float)) else value
        struct.pack_into(f">{len(numbers)}d", packet, _FIELDS[name], *numbers)
    return bytes(packet)


def package(kind: int, content: bytes) -> bytes:
    return struct.pack(">IB", len(content) + 5, kind) + content


def version_message(software: tuple[int, int, int, int]) -> bytes:
    """Message 20, version: time stamp, source, type 3, project name, version, date of the build."""
    name = b"URControl"
    content = struct.pack(">QbB", 0, -2, 3) + bytes([len(name)]) + name
    return package(20, content + struct.pack(">BBii", *software) + b"01-01-2026, 00:00:00")


def configuration(robot_type: int, limits_rad: Sequence[tuple[float, float]], nominal: Dh) -> bytes:
    """Sub-package 6."""
    limits = [bound for pair in limits_rad for bound in pair]
    speeds = [3.14, 40.0] * 6
    defaults = [1.05, 1.4, 0.25, 1.2, 0.5]
    dh = [*nominal.a, *nominal.d, *nominal.alpha, *nominal.theta]
    numbers = [*limits, *speeds, *defaults, *dh]
    return package(6, struct.pack(f">{len(numbers)}d4i", *numbers, 1, 1, robot_type, 0))


def kinematics(calibrated: Dh, checksum: Sequence[int] | None = None) -> bytes:
    """Sub-package 5 of software 3.6 and later."""
    numbers = [*calibrated.theta, *calibrated.a, *calibrated.d, *calibrated.alpha]
    if checksum is None:
        checksum = [int(abs(n) * 1e9) % 2**32 for n in numbers[6:12]]
    return package(5, struct.pack(">6I24dI", *checksum, *numbers, 0))


def _ticks(at_s: float) -> int:
    """Return microseconds of a controller that was switched on some days ago."""
    return int((at_s + UPTIME_S) * 1e6)


def mode_data(
    at_s: float,
    robot_mode: int,
    *,
    running: bool,
    paused: bool,
    emergency: bool,
    protective: bool,
    speed: float,
) -> bytes:
    """Return sub-package 0 with the modes of the robot.

    It has a time stamp (microseconds), five flags of the arm, program running, paused, mode, control mode and speeds.
    """
    flags = [True, True, robot_mode == 7, emergency, protective, running, paused]
    return package(0, struct.pack(">Q7?2B3dB", _ticks(at_s), *flags, robot_mode, 0, speed, speed, 1.0, 0))


def joint_data(actual: Sequence[float], target: Sequence[float], speed: Sequence[float]) -> bytes:
    """Return sub-package 1: angles, speed, current, voltage, temperatures and mode per joint."""
    rows = zip(actual, target, speed, strict=True)
    return package(1, b"".join(struct.pack(">3d4fB", *row, 0.1, 48.0, 30.0, 0.0, 253) for row in rows))


def masterboard_data(safety_mode: int) -> bytes:
    """Return sub-package 3, without the interface to an injection moulding machine.

    Inputs and outputs, then temperature, voltage and currents, safety mode, reduced mode, the interface, and five
    values of an e-Series.
    """
    board = struct.pack(">2I2B2d2b2d4f", 0, 0, 0, 0, 0.0, 0.0, 0, 0, 0.0, 0.0, 25.0, 48.0, 0.5, 0.1)
    return package(3, board + struct.pack(">3BI3B", safety_mode, 0, 0, 0, 0, 0, 0))


def message(at_s: float, kind: int, body: bytes) -> bytes:
    """Return a message of the controller: time stamp, source, type and body."""
    return package(20, struct.pack(">QbB", _ticks(at_s), -2, kind) + body)


def error_message(at_s: float, code: int, argument: int, text: str) -> bytes:
    """Return an error message, `C{code}A{argument}`: level 2 (warning), and data of no meaning."""
    return message(at_s, 6, struct.pack(">3i2I", code, argument, 2, 1, 0) + text.encode())


def exception_message(at_s: float, line: int, text: str) -> bytes:
    """Return the message of an exception in a program."""
    return message(at_s, 10, struct.pack(">2i", line, 1) + text.encode())
