"""Drivers: from bytes on a wire to a reading, one flat file per maker. `drivers.interfaces` has the verbs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, TypeVar

from drivers.abb import AbbArm
from drivers.abb_conversation import AbbDeadlines
from drivers.errors import (
    AcquisitionError,
    BeamBroken,
    Busy,
    CannotStop,
    CommandRefused,
    ConfigError,
    EmergencyStop,
    EnableLost,
    JointLimit,
    LinkError,
    LinkLost,
    LinkTimeout,
    MotionStopped,
    NoisyMeasurement,
    NoOperator,
    NotArmed,
    NotReached,
    NotReady,
    OutOfRange,
    ProtectiveStop,
    ProtocolError,
    Refused,
    SafetyStop,
    StorageError,
    TargetNotSeen,
    Unmeasurable,
    WrongMode,
)
from drivers.faro import FaroDeadlines, FaroTracker
from drivers.interfaces import (
    Answer,
    Device,
    Identity,
    InstrumentStatus,
    JointReading,
    Operator,
    PointMeter,
    PointReading,
    Prompt,
    RobotArm,
    RobotStatus,
)
from drivers.link import WireLog, WireSink
from drivers.operator import RehearsalOperator, RemoteOperator, TerminalOperator, UnknownPrompt

_T = TypeVar("_T")

ROBOTS: Mapping[str, Callable[..., RobotArm]] = {"abb": AbbArm}
INSTRUMENTS: Mapping[str, Callable[..., PointMeter]] = {"faro": FaroTracker}


def open_robot(driver: str, url: str, **options: Any) -> RobotArm:
    """A robot by the name of its driver, not yet connected. Raises ConfigError."""
    return _make("robot", ROBOTS, driver, url, options)


def open_instrument(driver: str, url: str, **options: Any) -> PointMeter:
    """An instrument by the name of its driver, not yet connected. Raises ConfigError."""
    return _make("instrument", INSTRUMENTS, driver, url, options)


def _make(
    kind: str, table: Mapping[str, Callable[..., _T]], name: str, url: str, options: Mapping[str, Any]
) -> _T:
    if name not in table:
        raise ConfigError(f"{kind} driver {name!r} unknown; there are {', '.join(sorted(table))}")
    try:
        return table[name](url, **options)
    except TypeError as error:
        raise ConfigError(f"{kind} driver {name!r}: {error}") from error


__all__ = [
    "INSTRUMENTS",
    "ROBOTS",
    "AbbArm",
    "AbbDeadlines",
    "AcquisitionError",
    "Answer",
    "BeamBroken",
    "Busy",
    "CannotStop",
    "CommandRefused",
    "ConfigError",
    "Device",
    "EmergencyStop",
    "EnableLost",
    "FaroDeadlines",
    "FaroTracker",
    "Identity",
    "InstrumentStatus",
    "JointLimit",
    "JointReading",
    "LinkError",
    "LinkLost",
    "LinkTimeout",
    "MotionStopped",
    "NoOperator",
    "NoisyMeasurement",
    "NotArmed",
    "NotReached",
    "NotReady",
    "Operator",
    "OutOfRange",
    "PointMeter",
    "PointReading",
    "Prompt",
    "ProtectiveStop",
    "ProtocolError",
    "Refused",
    "RehearsalOperator",
    "RemoteOperator",
    "RobotArm",
    "RobotStatus",
    "SafetyStop",
    "StorageError",
    "TargetNotSeen",
    "TerminalOperator",
    "UnknownPrompt",
    "Unmeasurable",
    "WireLog",
    "WireSink",
    "WrongMode",
    "open_instrument",
    "open_robot",
]
