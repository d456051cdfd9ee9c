"""Regressors of effects: functions of the conditions with one value for each reading.

A regressor is a small frozen object with `evaluate(conditions) -> (n,)` (or a plain 1.0 for a constant).
Its fields are its shape: joint, harmonic order, change point, time constant. Joints count from 1. If a
picture of it has a separate axis, `drawn_over` returns that axis.

Joints that slide have smooth curves over the travel, and the travel times the warmth of the air.
Regressors of gravity are torques about the joints and moments that bend the arm, with the loads of the
readings.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, ClassVar, Protocol

import numpy as np

from calib.array import Array
from calib.data.conditions import Conditions
from calib.model.axis import Axis, unit_of
from calib.model.carried_regressors import Held, HeldPair, OfTime
from calib.units import DEG


@dataclass(frozen=True)
class Torque:
    """Gravity torque about a joint, N.mm."""

    joint: int

    def evaluate(self, conditions: Conditions) -> Array:
        """Evaluate the torque, shape (n,), N.mm."""
        return conditions.torque[:, self.joint - 1]

    def drawn_over(self, conditions: Conditions) -> Axis:
        """Return the torque itself."""
        return Axis(f"gravity torque of joint {self.joint}, N·m", self.evaluate(conditions) / 1000.0)


@dataclass(frozen=True)
class TorqueCubed:
    """Third power of the gravity torque about a joint, (N.mm)^3."""

    joint: int

    def evaluate(self, conditions: Conditions) -> Array:
        """Evaluate the cubed torque, shape (n,), (N.mm)^3."""
        return conditions.torque[:, self.joint - 1] ** 3

    def drawn_over(self, conditions: Conditions) -> Axis:
        """Return the torque, of which it is a function."""
        return Torque(self.joint).drawn_over(conditions)


@dataclass(frozen=True)
class TorqueSign:
    """Sign of the gravity torque about a joint, smoothed as tanh(torque / width); width in N.mm."""

    joint: int
    width: float

    def evaluate(self, conditions: Conditions) -> Array:
        """Evaluate the smoothed sign, shape (n,), from -1 to 1."""
        return np.tanh(conditions.torque[:, self.joint - 1] / self.width)

    def drawn_over(self, conditions: Conditions) -> Axis:
        """Return the torque, of which it is a function."""
        return Torque(self.joint).drawn_over(conditions)


@dataclass(frozen=True)
class LoadTorque:
    """Torque about a joint of a load on the last link.

    `mass_kg` is its mass; x, y, z are its mass x centre in that link, kg mm.
    """

    joint: int
    mass_kg: float
    x: float
    y: float
    z: float

    def evaluate(self, conditions: Conditions) -> Array:
        """Evaluate the torque, shape (n,), N.mm."""
        return conditions.unit_load[:, self.joint - 1] @ np.array([self.mass_kg, self.x, self.y, self.z])


@dataclass(frozen=True)
class GravityMoment:
    """Gravity moment at a joint about one axis (0, 1, 2) of the frame just before it turns."""

    joint: int
    axis: int

    def evaluate(self, conditions: Conditions) -> Array:
        """Evaluate the moment, shape (n,), N.mm."""
        return conditions.moment[:, self.joint - 1, self.axis]

    def drawn_over(self, conditions: Conditions) -> Axis:
        """Return the moment itself."""
        return Axis(f"gravity moment at joint {self.joint}, N·m", self.evaluate(conditions) / 1000.0)


@dataclass(frozen=True)
class MomentBehind:
    """Gravity moment at a joint about the x axis behind it.

    That axis has turned by theta + `zero` (rad) about z.
    """

    joint: int
    zero: float

    def evaluate(self, conditions: Conditions) -> Array:
        """Evaluate the moment, shape (n,), N.mm."""
        theta, moment = conditions.joints[:, self.joint - 1] + self.zero, conditions.moment[:, self.joint - 1]
        return np.cos(theta) * moment[:, 0] + np.sin(theta) * moment[:, 1]

    def drawn_over(self, conditions: Conditions) -> Axis:
        """Return the moment itself."""
        return Axis(f"gravity moment at joint {self.joint}, N·m", self.evaluate(conditions) / 1000.0)


@dataclass(frozen=True)
class Overturning:
    """Gravity moment of the whole arm about one axis (0, 1, 2) of the base."""

    axis: int

    def evaluate(self, conditions: Conditions) -> Array:
        """Evaluate the moment, shape (n,), N.mm."""
        return conditions.overturning[:, self.axis]


@dataclass(frozen=True)
class HalfSines:
    """Sine of `count` half waves over the travel of a joint that slides, from low to high, mm."""

    joint: int
    count: int
    low: float
    high: float

    def evaluate(self, conditions: Conditions) -> Array:
        """Evaluate the wave, shape (n,), from -1 to 1."""
        return np.sin(_phase(self, conditions))

    def drawn_over(self, conditions: Conditions) -> Axis:
        """Return the position along the axis."""
        return Axis.angle(self.joint, conditions)


@dataclass(frozen=True)
class HalfCosines:
    """Cosine of `count` half waves over the travel of a joint that slides, from low to high, mm."""

    joint: int
    count: int
    low: float
    high: float

    def evaluate(self, conditions: Conditions) -> Array:
        """Evaluate the wave, shape (n,), from -1 to 1."""
        return np.cos(_phase(self, conditions))

    def drawn_over(self, conditions: Conditions) -> Axis:
        """Return the position along the axis."""
        return Axis.angle(self.joint, conditions)


@dataclass(frozen=True)
class WarmTravel:
    """Place of a joint that slides, mm, times the air temperature above `reference_c`, K."""

    joint: int
    reference_c: float

    def evaluate(self, conditions: Conditions) -> Array:
        """Evaluate the product, shape (n,), mm K."""
        return conditions.joints[:, self.joint - 1] * (conditions.temperature - self.reference_c)


def _phase(wave: HalfSines | HalfCosines, conditions: Conditions) -> Array:
    """Compute the phase of a wave over the travel, shape (n,), rad.

    It grows from 0 at the low end of the travel to pi times the number of half waves at the high one.
    """
    along = (conditions.joints[:, wave.joint - 1] - wave.low) / (wave.high - wave.low)
    return np.pi * wave.count * along


class Regressor(Protocol):
    """Interface of regressors: a frozen dataclass with one value for each reading."""

    __dataclass_fields__: ClassVar[dict[str, Any]]

    def evaluate(self, conditions: Conditions) -> Array | float:
        """Evaluate the regressor: values (n,), or a float that holds for every reading."""
        ...


@dataclass(frozen=True)
class Constant:
    """Constant regressor: 1 for every reading."""

    def evaluate(self, conditions: Conditions) -> float:
        """Return 1.0."""
        return 1.0


@dataclass(frozen=True)
class InSeries:
    """Indicator of one series: 1 for its readings, 0 elsewhere.

    A series has one set-up of base and instrument.
    """

    series: str

    def evaluate(self, conditions: Conditions) -> Array:
        """Evaluate the indicator, shape (n,), 0 or 1."""
        return (conditions.series == conditions.series_names.index(self.series)).astype(np.float64)


@dataclass(frozen=True)
class OnTarget:
    """Indicator of one tool target in one series: 1 for its readings, 0 elsewhere."""

    series: str
    target: str

    def evaluate(self, conditions: Conditions) -> Array:
        """Evaluate the indicator, shape (n,), 0 or 1."""
        if self.target not in conditions.target_names:
            return np.zeros(len(conditions))
        of_target = conditions.target == conditions.target_names.index(self.target)
        return of_target * InSeries(self.series).evaluate(conditions)


@dataclass(frozen=True)
class ToAnchor:
    """Indicator of one base target: 1 for the distances to it, 0 elsewhere."""

    anchor: str

    def evaluate(self, conditions: Conditions) -> Array:
        """Evaluate the indicator, shape (n,), 0 or 1."""
        if self.anchor not in conditions.anchor_names:
            return np.zeros(len(conditions))
        return (conditions.anchor == conditions.anchor_names.index(self.anchor)).astype(np.float64)


@dataclass(frozen=True)
class JointAngle:
    """theta of a joint, rad; of one that slides, its place along its axis, mm."""

    joint: int

    def evaluate(self, conditions: Conditions) -> Array:
        """Evaluate the position, shape (n,), rad or mm."""
        return conditions.joints[:, self.joint - 1]

    def drawn_over(self, conditions: Conditions) -> Axis:
        """Return the angle itself."""
        return Axis.angle(self.joint, conditions)


@dataclass(frozen=True)
class Beam:
    """A coordinate (0, 1, 2) of the vector from the station to the target, mm.

    `station_mm` is that coordinate of the station in the world.
    """

    axis: int
    station_mm: float

    def evaluate(self, conditions: Conditions) -> Array:
        """Evaluate the coordinate, shape (n,), mm."""
        return conditions.point[:, self.axis] - self.station_mm


@dataclass(frozen=True)
class LastMove:
    """The angle by which a joint turned in its last move, rad; how far it slid, mm."""

    joint: int

    def evaluate(self, conditions: Conditions) -> Array:
        """Evaluate the move, shape (n,), rad or mm."""
        return conditions.joints[:, self.joint - 1] - conditions.previous[:, self.joint - 1]

    def drawn_over(self, conditions: Conditions) -> Axis:
        """Return the move itself."""
        unit = unit_of(self.joint, conditions)
        return Axis(
            f"last move of joint {self.joint}, {unit}",
            self.evaluate(conditions) / (1.0 if unit == "mm" else DEG),
        )


@dataclass(frozen=True)
class Cosine:
    """cos(order x theta of a joint); order in cycles per turn."""

    joint: int
    order: float

    def evaluate(self, conditions: Conditions) -> Array:
        """Evaluate the cosine, shape (n,)."""
        return np.cos(self.order * conditions.joints[:, self.joint - 1])

    def drawn_over(self, conditions: Conditions) -> Axis:
        """Return the angle."""
        return Axis.angle(self.joint, conditions, cycles=self.order)


@dataclass(frozen=True)
class Sine:
    """sin(order x theta of a joint); order in cycles per turn."""

    joint: int
    order: float

    def evaluate(self, conditions: Conditions) -> Array:
        """Evaluate the sine, shape (n,)."""
        return np.sin(self.order * conditions.joints[:, self.joint - 1])

    def drawn_over(self, conditions: Conditions) -> Axis:
        """Return the angle."""
        return Axis.angle(self.joint, conditions, cycles=self.order)


@dataclass(frozen=True)
class GearCurve:
    """The curve of a gear as it was found, rad.

    amplitudes[n] = a - i b of a cos(n theta) + b sin(n theta).
    """

    joint: int
    amplitudes: tuple[complex, ...]

    def evaluate(self, conditions: Conditions) -> Array:
        """Evaluate the curve, shape (n,), rad."""
        turn = np.exp(1j * conditions.joints[:, self.joint - 1])
        total = np.zeros(len(turn), dtype=np.complex128)
        for amplitude in reversed(self.amplitudes):  # Horner's rule
            total = total * turn + amplitude
        return np.real(total)


@dataclass(frozen=True)
class ApproachSide:
    """Side from which a joint arrived: +1 from below, -1 from above."""

    joint: int

    def evaluate(self, conditions: Conditions) -> Array:
        """Evaluate the side, shape (n,), +1 or -1."""
        return conditions.side[:, self.joint - 1]

    def drawn_over(self, conditions: Conditions) -> Axis:
        """Return the angle, with a separate curve for each side."""
        return Axis.angle(self.joint, conditions, sided=True)


@dataclass(frozen=True)
class LoadedSide:
    """Side from which a joint arrived times the size of the gravity torque about it, N.mm."""

    joint: int

    def evaluate(self, conditions: Conditions) -> Array:
        """Evaluate the product, shape (n,), N.mm, positive from below."""
        at = self.joint - 1
        return conditions.side[:, at] * np.abs(conditions.torque[:, at])


@dataclass(frozen=True)
class Time:
    """Seconds since the start of the campaign, or since `start_s` after it."""

    start_s: float = 0.0

    def evaluate(self, conditions: Conditions) -> Array:
        """Evaluate the time, shape (n,), s."""
        return conditions.time - self.start_s

    def drawn_over(self, conditions: Conditions) -> Axis:
        """Return the time itself."""
        return Axis("time, h", conditions.time / 3600.0)


@dataclass(frozen=True)
class WarmUpRegressor:
    """Warm-up law 1 - exp(-t / time_constant_s), t from the start of the campaign."""

    time_constant_s: float

    def evaluate(self, conditions: Conditions) -> Array:
        """Evaluate the law, shape (n,), from 0 to 1."""
        return -np.expm1(-conditions.time / self.time_constant_s)

    def drawn_over(self, conditions: Conditions) -> Axis:
        """Return the time, of which it is a function."""
        return Time().drawn_over(conditions)


@dataclass(frozen=True)
class StepAt:
    """Step: 0 before the reading of rank `order`, 1 from it on."""

    order: int

    def evaluate(self, conditions: Conditions) -> Array:
        """Evaluate the step, shape (n,), 0 or 1."""
        return (conditions.order >= self.order).astype(np.float64)

    def drawn_over(self, conditions: Conditions) -> Axis:
        """Return the rank of the readings."""
        return Axis("reading, in order of time", conditions.order + 1.0)


@dataclass(frozen=True)
class CreepBetween:
    """Ramp: 0 before the reading of rank `order`, 1 from that of rank `until` on.

    It grows in proportion between.
    """

    order: int
    until: int

    def evaluate(self, conditions: Conditions) -> Array:
        """Evaluate the ramp, shape (n,), from 0 to 1."""
        return np.clip((conditions.order - self.order) / (self.until - self.order), 0.0, 1.0)

    def drawn_over(self, conditions: Conditions) -> Axis:
        """Return the rank of the readings."""
        return StepAt(self.order).drawn_over(conditions)


@dataclass(frozen=True)
class Temperature:
    """Air temperature above `reference_c`, K."""

    reference_c: float

    def evaluate(self, conditions: Conditions) -> Array:
        """Evaluate the temperature difference, shape (n,), K."""
        return conditions.temperature - self.reference_c

    def drawn_over(self, conditions: Conditions) -> Axis:
        """Return the temperature itself."""
        return Axis("air temperature, °C", conditions.temperature)


# By the names in model files, which do not depend on the names of the classes
KINDS = {
    "Constant": Constant,
    "InSeries": InSeries,
    "OnTarget": OnTarget,
    "ToAnchor": ToAnchor,
    "JointAngle": JointAngle,
    "Torque": Torque,
    "TorqueCubed": TorqueCubed,
    "TorqueSign": TorqueSign,
    "LoadTorque": LoadTorque,
    "Moment": GravityMoment,
    "MomentBehind": MomentBehind,
    "Overturning": Overturning,
    "Beam": Beam,
    "LastMove": LastMove,
    "Cosine": Cosine,
    "Sine": Sine,
    "HalfSines": HalfSines,
    "HalfCosines": HalfCosines,
    "WarmTravel": WarmTravel,
    "Side": ApproachSide,
    "LoadedSide": LoadedSide,
    "Time": Time,
    "WarmUp": WarmUpRegressor,
    "StepAt": StepAt,
    "CreepBetween": CreepBetween,
    "Temperature": Temperature,
    "Held": Held,
    "HeldPair": HeldPair,
    "OfTime": OfTime,
}
_NAMES = {kind: name for name, kind in KINDS.items()}


def to_json(regressor: Regressor) -> dict[str, Any]:
    """Convert a regressor to a plain dictionary of its kind and its shape."""
    kind = type(regressor)
    return {"kind": _NAMES.get(kind, kind.__name__), **asdict(regressor)}


def from_json(table: dict[str, Any]) -> Regressor:
    """Read the regressor that `to_json` wrote.

    Raises
    ------
    KeyError
        This version does not know the kind.
    """
    shape: dict[str, Any] = {
        key: tuple(value) if isinstance(value, list) else value
        for key, value in table.items()
        if key != "kind"
    }
    return KINDS[table["kind"]](**shape)
