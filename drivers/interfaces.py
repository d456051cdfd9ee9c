"""The interfaces of devices: one small protocol per capability, and their answer types.

Methods are blocking and idempotent: `move_to` is absolute and `measure` is a whole measurement, so repeating a call
after a fault is safe. Nothing moves on `connect`. `stop` halts motion (it does not disconnect), may be called from any
thread while another method is pending, and disarms. Every method raises only errors of `drivers.errors` and ends within
its named deadline. Degrees, millimetres, seconds, degrees Celsius, hectopascals.

**Joints read back** are checked as precisely as the protocol reports them. A reading of a campaign is stored with the
commanded angles, so the controller must have reached them. A move has ended at its target if every joint is read back
within half the resolution of the reply, plus the largest error of a servo at rest. Otherwise it counts as
`NotReached` (docs/decisions/0016).

The largest error of a servo is taken from the data sheets: twice the pose repeatability (ISO 9283) over the reach.

- IRB 120: 0.01 mm over 580 mm, 0.002 deg
- LR Mate 200iC: 0.02 mm over 704 mm, 0.003 deg
- UR5: 0.1 mm over 850 mm, 0.013 deg

An arm that held its joints less well could not have its stated repeatability. Not tried on a controller.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from enum import Enum
from typing import Protocol, runtime_checkable

from drivers.dh_numbers import ControllerCalibration


@dataclass(frozen=True, slots=True)
class Identity:
    """The identity of the device at an address.

    Attributes
    ----------
    simulated
        Whether it is a simulator; None if the protocol does not report it.
    alias
        Another unique name, which may be known if the serial number is not.
    calibration
        The calibration that a robot's controller calculates with, None if it does not report it.
    """

    maker: str
    model: str
    serial: str
    firmware: str
    protocol: str
    simulated: bool | None = None
    alias: str = field(default="", repr=False)
    calibration: ControllerCalibration | None = field(default=None, repr=False)


@dataclass(frozen=True, slots=True)
class JointReading:
    """Joint angles from the controller (deg), with the resolution of its reply (deg)."""

    joints_deg: tuple[float, ...]
    resolution_deg: float
    raw: bytes = b""


@dataclass(frozen=True, slots=True)
class RobotStatus:
    """State of the controller; None means that this dialect does not report it."""

    mode: str  # "auto", "manual", "unknown", or "reduced": manual, moves slowly while the enabling device is held
    motors_on: bool | None
    emergency_stop: bool | None
    moving: bool | None
    error_number: int | None = None
    raw: bytes = b""


@dataclass(frozen=True, slots=True)
class InstrumentStatus:
    """State of an instrument in the terms of its protocol.

    The states are OFF, WARMING, READY, BUSY, ERROR and ESTOP.
    """

    state: str
    t_air_c: float | None = None
    pressure_hpa: float | None = None
    humidity_percent: float | None = None
    raw: bytes = b""


@dataclass(frozen=True, slots=True)
class PointReading:
    """An averaged point in the instrument's own frame, mm.

    Attributes
    ----------
    std_mm
        Standard deviation of single samples per axis, mm.
    t_s
        Device clock at the end of the average, s.
    age_s
        Age of the average when it was sent, s.
    """

    target: str
    xyz_mm: tuple[float, float, float]
    std_mm: tuple[float, float, float]
    samples: int
    t_s: float
    age_s: float
    t_air_c: float | None = None
    pressure_hpa: float | None = None
    humidity_percent: float | None = None
    mode: str = ""
    face: str = ""
    raw: bytes = b""


@dataclass(frozen=True, slots=True, kw_only=True)
class PoseReading(PointReading):
    """An averaged pose: its point, and the orientation of the target's own frame.

    Attributes
    ----------
    rot_wxyz
        Unit quaternion, scalar first and not negative. It turns vectors of the target's frame into the instrument's (or
        the reference's) frame.
    rot_std_mrad
        Scatter of single frames about any axis, mrad.
    visible_tool, visible_base
        Number of visible reflective targets on the target's body and on the reference.
    """

    rot_wxyz: tuple[float, float, float, float]
    rot_std_mrad: float
    visible_tool: int
    visible_base: int


@dataclass(frozen=True, slots=True)
class LengthReading:
    """An averaged length between the centres of two balls (mm).

    `length_mm` is the bar's calibrated length at the temperature of the reading plus the deviation that the sensor
    shows, less its zero; `deviation_mm` and `zero_mm` are these two values.
    """

    target: str
    base_target: str
    length_mm: float
    std_mm: float
    deviation_mm: float
    zero_mm: float
    samples: int
    t_s: float
    age_s: float
    t_air_c: float | None = None
    battery_percent: float | None = None
    raw: bytes = b""


Reading = PointReading | LengthReading

"""What an instrument answers; a PoseReading is a PointReading with a turn."""


@dataclass(frozen=True, slots=True)
class Sample:
    """A sample of a stream: joints (deg) of a robot, or a point (mm, own frame).

    Attributes
    ----------
    t_s
        Device clock, s.
    number
        The device's count of its samples; None if it does not count.
    doubt
        Reason why this sample is not trusted; empty if it is.
    """

    t_s: float
    values: tuple[float, ...]
    number: int | None = None
    doubt: str = ""


class Answer(Enum):
    """The answers of an operator to a prompt."""

    CONFIRM = "confirm"
    SKIP = "skip"
    REDO = "redo"
    PAUSE = "pause"
    ABORT = "abort"


@dataclass(frozen=True, slots=True)
class TypedEntry:
    """Numbers that a person reads off a display and types with CONFIRM.

    Attributes
    ----------
    names
        Names of the numbers, in order.
    shown
        Expected text of the display; empty if unknown.
    needed
        Whether the numbers must be typed; if not, CONFIRM alone means that the display shows the expected text.
    """

    names: tuple[str, ...]
    unit: str
    shown: tuple[str, ...] = ()
    needed: bool = True


@dataclass(frozen=True, slots=True)
class Prompt:
    """A question to a person.

    Attributes
    ----------
    expects
        The answers that make sense, in the order shown.
    picture
        Name of its picture.
    entry
        Numbers that are typed with CONFIRM; None if there are none.
    """

    id: str
    text: str
    expects: tuple[Answer, ...] = field(default=(Answer.CONFIRM, Answer.SKIP, Answer.REDO, Answer.ABORT))
    picture: str | None = None
    entry: TypedEntry | None = None


@dataclass(frozen=True, slots=True)
class Typed:
    """CONFIRM with the text that a person typed."""

    text: str


Asking = Callable[[str, TypedEntry, str], str]

"""Puts words, what is to be typed and the name of a picture to a person: what was typed, empty for CONFIRM alone.

Raises LeftOut where they skip it, NoOperator, and what unwinds the caller.
"""


@runtime_checkable
class Device(Protocol):
    """The methods that every device has."""

    name: str
    unverified_on_hardware: bool

    def connect(self) -> None: ...
    def disconnect(self) -> None: ...
    def identify(self) -> Identity: ...
    def arm(self) -> None: ...
    def disarm(self) -> None: ...


@runtime_checkable
class ReportsWeakness(Protocol):
    """A device that states which errors its protocol cannot detect.

    `weakness` is a sentence, or empty. It is valid after `connect`.
    """

    @property
    def weakness(self) -> str: ...


def weakness_of(device: Device) -> str:
    """Return a sentence on the errors that the protocol of a connected device cannot detect.

    It is empty if there are none.
    """
    return device.weakness if isinstance(device, ReportsWeakness) else ""


@runtime_checkable
class RobotArm(Device, Protocol):
    """A robot that moves to joint angles (deg). `can_stop` is valid once connected."""

    @property
    def can_stop(self) -> bool: ...
    def move_to(self, joints_deg: Sequence[float]) -> JointReading: ...
    def position(self) -> JointReading: ...
    def stop(self) -> None: ...
    def status(self) -> RobotStatus: ...


@runtime_checkable
class PointMeter(Device, Protocol):
    """An instrument that measures the position of a target by its name.

    `near_mm` points the beam there first (own frame).
    """

    def measure(
        self, target: str, *, samples: int = 100, near_mm: Sequence[float] | None = None
    ) -> PointReading: ...
    def stop(self) -> None: ...
    def status(self) -> InstrumentStatus: ...


@runtime_checkable
class PoseMeter(Device, Protocol):
    """An instrument that measures point and orientation of a target by its name.

    Every PoseMeter is a PointMeter as well.
    """

    def measure(
        self, target: str, *, samples: int = 100, near_mm: Sequence[float] | None = None
    ) -> PoseReading: ...
    def stop(self) -> None: ...
    def status(self) -> InstrumentStatus: ...


@runtime_checkable
class LengthMeter(Device, Protocol):
    """An instrument that measures the length between a ball on the tool and one on the base.

    Both are given by name. `zero` reads the sensor in its calibrator (mm), and the value is the zero of later readings.
    `build` is called when a person has built the bar to another length (mm). It disarms; arming compares the length
    with its calibration.
    """

    def measure(self, target: str, *, base_target: str, samples: int = 100) -> LengthReading: ...
    def zero(self) -> float: ...
    def build(self, nominal_mm: float) -> None: ...
    def stop(self) -> None: ...
    def status(self) -> InstrumentStatus: ...


@runtime_checkable
class Streaming(Protocol):
    """A robot or an instrument that sends samples while the robot moves.

    The `streams` of its declaration is then True. The samples of a robot flow in parallel with `move_to`, over a
    separate connection. An instrument answers no other question meanwhile, and sends the target that it measured last.
    The iterator yields None when no sample has come for a moment, so that its reader can do other work; it raises
    LinkError, and MotionStopped after `stop`.
    """

    def stream(self, rate_hz: float) -> AbstractContextManager[Iterator[Sample | None]]: ...


@runtime_checkable
class SpeedLimited(Protocol):
    """A robot that can be recorded in motion at a lower speed for a while.

    It is never faster than the speeds with which it was opened.
    """

    def at_speed(self, speed_deg_s: float) -> AbstractContextManager[None]: ...


@runtime_checkable
class OperatedByPerson(Protocol):
    """A device that a person operates; it asks the person through `ask`."""

    def attend(self, ask: Asking) -> None: ...


@runtime_checkable
class HandGuided(Protocol):
    """A robot that a person drives.

    `move_over` shows the whole path, over postures (deg) to the last one.
    """

    def move_over(self, over_deg: Sequence[Sequence[float]], joints_deg: Sequence[float]) -> JointReading: ...


@runtime_checkable
class Operator(Protocol):
    """A person behind a terminal, a page or a test."""

    def ask(self, prompt: Prompt) -> Answer | Typed: ...


def apart_deg(one: Sequence[float], other: Sequence[float]) -> float:
    """Return the largest difference of a joint, in the unit of the arguments."""
    return max(abs(a - b) for a, b in zip(one, other, strict=True))


def is_there(reading: JointReading, target_deg: Sequence[float], hold_deg: float) -> bool:
    """Check whether the read-back allows that every joint is within `hold_deg` of its target."""
    return apart_deg(reading.joints_deg, target_deg) <= hold_deg + reading.resolution_deg / 2
