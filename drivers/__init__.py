"""Drivers of robots and measuring instruments, one subpackage per maker.

`drivers.interfaces` defines the methods that every driver has, `drivers.registry` lists the drivers, and each maker's
`declaration` states the options and properties of its devices. Errors are in `drivers.errors`.
"""

from __future__ import annotations

from drivers.abb.arm import AbbArm
from drivers.abb.conversation import AbbDeadlines
from drivers.abb.simple import AbbSimpleArm
from drivers.abb.simple_stream import AbbSimpleDeadlines
from drivers.creaform.ctrack import CTrack
from drivers.deadlines import InstrumentDeadlines
from drivers.declaration import InstrumentDriver, NumbersOption, Option, RobotDriver, TextOption
from drivers.details import Details
from drivers.dh_numbers import DhNumbers
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
    LeftOut,
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
    TargetNotSeen,
    Unmeasurable,
    WrongMode,
)
from drivers.fanuc.arm import FanucArm, FanucRmiArm
from drivers.fanuc.controller import FanucDeadlines
from drivers.faro.ion import FaroTracker
from drivers.interfaces import (
    Answer,
    Asking,
    Device,
    HandGuided,
    Identity,
    InstrumentStatus,
    JointReading,
    LengthMeter,
    LengthReading,
    OperatedByPerson,
    Operator,
    PointMeter,
    PointReading,
    PoseMeter,
    PoseReading,
    Prompt,
    Reading,
    ReportsWeakness,
    RobotArm,
    RobotStatus,
    Sample,
    SpeedLimited,
    Streaming,
    Typed,
    TypedEntry,
)
from drivers.leica.at960 import LeicaTracker
from drivers.leica.emscon import EmsconTracker
from drivers.link import WireLog, WireSink
from drivers.manual.arm import ManualArm
from drivers.manual.meter import ManualMeter
from drivers.operator import RehearsalOperator, RemoteOperator, TerminalOperator, UnknownPrompt
from drivers.registry import (
    INSTRUMENTS,
    ROBOTS,
    installed,
    instrument_driver,
    open_instrument,
    open_robot,
    robot_driver,
)
from drivers.renishaw.b5r import BallbarTest, read_b5r
from drivers.renishaw.qc20w import Qc20w
from drivers.ur.arm import UrArm
from drivers.ur.deadlines import UrDeadlines
from drivers.ur.secondary import Factory
from drivers.yaskawa.arm import YaskawaArm
from drivers.yaskawa.hses import YaskawaDeadlines

__all__ = [
    "INSTRUMENTS",
    "ROBOTS",
    "AbbArm",
    "AbbDeadlines",
    "AbbSimpleArm",
    "AbbSimpleDeadlines",
    "AcquisitionError",
    "Answer",
    "Asking",
    "BallbarTest",
    "BeamBroken",
    "Busy",
    "CTrack",
    "CannotStop",
    "CommandRefused",
    "ConfigError",
    "Details",
    "Device",
    "DhNumbers",
    "EmergencyStop",
    "EmsconTracker",
    "EnableLost",
    "Factory",
    "FanucArm",
    "FanucDeadlines",
    "FanucRmiArm",
    "FaroTracker",
    "HandGuided",
    "Identity",
    "InstrumentDeadlines",
    "InstrumentDriver",
    "InstrumentStatus",
    "JointLimit",
    "JointReading",
    "LeftOut",
    "LeicaTracker",
    "LengthMeter",
    "LengthReading",
    "LinkError",
    "LinkLost",
    "LinkTimeout",
    "ManualArm",
    "ManualMeter",
    "MotionStopped",
    "NoOperator",
    "NoisyMeasurement",
    "NotArmed",
    "NotReached",
    "NotReady",
    "NumbersOption",
    "OperatedByPerson",
    "Operator",
    "Option",
    "OutOfRange",
    "PointMeter",
    "PointReading",
    "PoseMeter",
    "PoseReading",
    "Prompt",
    "ProtectiveStop",
    "ProtocolError",
    "Qc20w",
    "Reading",
    "Refused",
    "RehearsalOperator",
    "RemoteOperator",
    "ReportsWeakness",
    "RobotArm",
    "RobotDriver",
    "RobotStatus",
    "SafetyStop",
    "Sample",
    "SpeedLimited",
    "Streaming",
    "TargetNotSeen",
    "TerminalOperator",
    "TextOption",
    "Typed",
    "TypedEntry",
    "UnknownPrompt",
    "Unmeasurable",
    "UrArm",
    "UrDeadlines",
    "WireLog",
    "WireSink",
    "WrongMode",
    "YaskawaArm",
    "YaskawaDeadlines",
    "installed",
    "instrument_driver",
    "open_instrument",
    "open_robot",
    "read_b5r",
    "robot_driver",
]
