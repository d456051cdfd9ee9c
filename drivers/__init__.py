"""Drivers: from bytes on a wire to a reading, one flat file per maker. `drivers.interfaces` has the verbs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, TypeVar

from drivers.abb import AbbArm
from drivers.abb_conversation import AbbDeadlines
from drivers.abb_simple import AbbSimpleArm
from drivers.abb_simple_stream import AbbSimpleDeadlines
from drivers.b5r import BallbarTest, read_b5r
from drivers.ctrack import CTrack
from drivers.emscon import EmsconDeadlines, EmsconTracker
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
from drivers.fanuc import FanucArm
from drivers.fanuc_controller import FanucDeadlines
from drivers.faro import FaroTracker
from drivers.interfaces import (
    Answer,
    Device,
    Identity,
    InstrumentStatus,
    JointReading,
    LengthMeter,
    LengthReading,
    Operator,
    PointMeter,
    PointReading,
    PoseMeter,
    PoseReading,
    Prompt,
    RobotArm,
    RobotStatus,
)
from drivers.leica import LeicaTracker
from drivers.link import WireLog, WireSink
from drivers.mbp_session import MbpDeadlines
from drivers.operator import RehearsalOperator, RemoteOperator, TerminalOperator, UnknownPrompt
from drivers.qc20w import Qc20w
from drivers.ur import UrArm
from drivers.ur_deadlines import UrDeadlines
from drivers.ur_secondary import DhNumbers, Factory

_T = TypeVar("_T")

ROBOTS: Mapping[str, Callable[..., RobotArm]] = {
    "abb": AbbArm,
    "abb-simple": AbbSimpleArm,
    "fanuc": FanucArm,
    "ur": UrArm,
}
INSTRUMENTS: Mapping[str, Callable[..., PointMeter]] = {
    "ctrack": CTrack,
    "emscon": EmsconTracker,
    "faro": FaroTracker,
    "leica": LeicaTracker,
}
LENGTH_METERS: Mapping[str, Callable[..., LengthMeter]] = {"qc20w": Qc20w}


def open_robot(driver: str, url: str, **options: Any) -> RobotArm:
    """A robot by the name of its driver, not yet connected. Raises ConfigError."""
    return _make("robot", ROBOTS, driver, url, options)


def open_instrument(driver: str, url: str, **options: Any) -> PointMeter:
    """An instrument by the name of its driver, not yet connected. Raises ConfigError."""
    return _make("instrument", INSTRUMENTS, driver, url, options)


def open_length_meter(driver: str, url: str, **options: Any) -> LengthMeter:
    """A ballbar by the name of its driver, not yet connected. Raises ConfigError."""
    return _make("length meter", LENGTH_METERS, driver, url, options)


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
    "LENGTH_METERS",
    "ROBOTS",
    "AbbArm",
    "AbbDeadlines",
    "AbbSimpleArm",
    "AbbSimpleDeadlines",
    "AcquisitionError",
    "Answer",
    "BallbarTest",
    "BeamBroken",
    "Busy",
    "CTrack",
    "CannotStop",
    "CommandRefused",
    "ConfigError",
    "Device",
    "DhNumbers",
    "EmergencyStop",
    "EmsconDeadlines",
    "EmsconTracker",
    "EnableLost",
    "Factory",
    "FanucArm",
    "FanucDeadlines",
    "FaroTracker",
    "Identity",
    "InstrumentStatus",
    "JointLimit",
    "JointReading",
    "LeicaTracker",
    "LengthMeter",
    "LengthReading",
    "LinkError",
    "LinkLost",
    "LinkTimeout",
    "MbpDeadlines",
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
    "PoseMeter",
    "PoseReading",
    "Prompt",
    "ProtectiveStop",
    "ProtocolError",
    "Qc20w",
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
    "UrArm",
    "UrDeadlines",
    "WireLog",
    "WireSink",
    "WrongMode",
    "open_instrument",
    "open_length_meter",
    "open_robot",
    "read_b5r",
]
