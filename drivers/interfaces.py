"""The interfaces of devices: small protocols, one per capability, and the types of their answers.

Methods are blocking and idempotent: `move_to` is absolute and `measure` is a whole measurement, so asking again
after a fault is safe. Nothing moves on `connect`. `stop` halts motion (it does not disconnect), may be called
from any thread while another method is pending, and disarms. Every method raises only errors of `drivers.errors`
and ends within its named deadline. Degrees, millimetres, seconds, degrees Celsius, hectopascals.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from enum import Enum
from typing import Protocol, runtime_checkable


@dataclass(frozen=True, slots=True)
class Identity:
    """The identity of the device at an address. `simulated` is None where the protocol does not say.

    `alias`: another unique name, known also where the serial number is not.
    """

    maker: str
    model: str
    serial: str
    firmware: str
    protocol: str
    simulated: bool | None = None
    alias: str = field(default="", repr=False)


@dataclass(frozen=True, slots=True)
class JointReading:
    """Joint angles as the controller reports them (deg), with the resolution of its reply (deg)."""

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
    """State of an instrument in the words of its protocol (OFF, WARMING, READY, BUSY, ERROR, ESTOP)."""

    state: str
    t_air_c: float | None = None
    pressure_hpa: float | None = None
    humidity_percent: float | None = None
    raw: bytes = b""


@dataclass(frozen=True, slots=True)
class PointReading:
    """An averaged point in the instrument's own frame (mm).

    `std_mm`: standard deviation of single samples per axis; `t_s`: device clock at the end of the average
    (s); `age_s`: how old the average was when it was sent (s).
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

    `rot_wxyz`: unit quaternion, scalar first and not negative, that turns vectors of the target's frame into
    the instrument's (or the reference's) frame; `rot_std_mrad`: scatter of single frames about any axis;
    `visible_tool` and `visible_base`: reflective targets seen on the target's body and on the reference.
    """

    rot_wxyz: tuple[float, float, float, float]
    rot_std_mrad: float
    visible_tool: int
    visible_base: int


@dataclass(frozen=True, slots=True)
class LengthReading:
    """An averaged length between the centres of two balls (mm).

    `length_mm` is the bar's calibrated length at the temperature of the reading plus the deviation that the
    sensor shows, less its zero: `deviation_mm` and `zero_mm` are what went into it.
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
    """A sample of a stream: joints (deg) of a robot, a point (mm, own frame) of an instrument.

    `t_s`: device clock (s); `number`: how the device counts its samples, None where it does not; `doubt`: why this
    sample is not trusted, empty where it is.
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

    names: of the numbers, in their order; shown: the expected text of the display, empty where unknown; needed: False
    where CONFIRM alone means that the display shows the expected text.
    """

    names: tuple[str, ...]
    unit: str
    shown: tuple[str, ...] = ()
    needed: bool = True


@dataclass(frozen=True, slots=True)
class Prompt:
    """A question to a person. `expects`: the answers that make sense, in the order shown; `picture`: its name.

    entry: numbers that are typed with CONFIRM; None: none.
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
    """A device that says which errors its protocol cannot detect, in a sentence; empty: none. Once connected."""

    @property
    def weakness(self) -> str: ...


def weakness_of(device: Device) -> str:
    """The errors that the protocol of a connected device cannot detect, in a sentence; empty: none."""
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
    """Measures the position of a target by its name; `near_mm` points the beam there first (own frame)."""

    def measure(
        self, target: str, *, samples: int = 100, near_mm: Sequence[float] | None = None
    ) -> PointReading: ...
    def stop(self) -> None: ...
    def status(self) -> InstrumentStatus: ...


@runtime_checkable
class PoseMeter(Device, Protocol):
    """Measures point and orientation of a target by its name. Every PoseMeter is a PointMeter as well."""

    def measure(
        self, target: str, *, samples: int = 100, near_mm: Sequence[float] | None = None
    ) -> PoseReading: ...
    def stop(self) -> None: ...
    def status(self) -> InstrumentStatus: ...


@runtime_checkable
class LengthMeter(Device, Protocol):
    """Measures the length between a ball on the tool and a ball on the base, both by name.

    `zero` reads the sensor in its calibrator (mm) and takes that as the zero of later readings. `build`: a person has
    built the bar to another length (mm); it is disarmed, and arming compares the length with its calibration.
    """

    def measure(self, target: str, *, base_target: str, samples: int = 100) -> LengthReading: ...
    def zero(self) -> float: ...
    def build(self, nominal_mm: float) -> None: ...
    def stop(self) -> None: ...
    def status(self) -> InstrumentStatus: ...


@runtime_checkable
class Streaming(Protocol):
    """A robot or an instrument that sends samples while the robot moves (`streams` of its declaration).

    The samples of a robot flow beside `move_to`, over a connection of their own; an instrument answers nothing else
    meanwhile, and sends the target that it measured last. The iterator yields None when nothing has come for a moment,
    so that its reader can do other work; it raises LinkError, and MotionStopped after `stop`.
    """

    def stream(self, rate_hz: float) -> AbstractContextManager[Iterator[Sample | None]]: ...


@runtime_checkable
class SpeedLimited(Protocol):
    """A robot that can be recorded in motion at a lower speed for a while; never above the speeds it was opened
    with."""

    def at_speed(self, speed_deg_s: float) -> AbstractContextManager[None]: ...


@runtime_checkable
class OperatedByPerson(Protocol):
    """A device that a person operates. It asks the person through `ask`."""

    def attend(self, ask: Asking) -> None: ...


@runtime_checkable
class HandGuided(Protocol):
    """A robot that a person drives: `move_over` shows the whole path, over postures (deg) to the last one."""

    def move_over(self, over_deg: Sequence[Sequence[float]], joints_deg: Sequence[float]) -> JointReading: ...


@runtime_checkable
class Operator(Protocol):
    """A person behind a terminal, a page or a test."""

    def ask(self, prompt: Prompt) -> Answer | Typed: ...
