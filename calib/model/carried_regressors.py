"""Regressors of carried terms, which keep their value beyond the measured range.

A carried term improves predictions without a known cause, so its continuation beyond the measured range
is unknown. There it keeps its value, and neighbouring targets on both sides of the border get the same
correction.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from calib.array import Array
from calib.data.conditions import Conditions
from calib.model.axis import Axis

QUANTITIES: Mapping[str, Callable[[Conditions, int], Array]] = {
    "angle": lambda c, k: c.joints[:, k],
    "torque": lambda c, k: c.torque[:, k],
    "move": lambda c, k: c.joints[:, k] - c.previous[:, k],
    "air": lambda c, _: c.temperature,
}
"""Recorded quantities by name: rad or mm, N.mm, rad or mm, degC; of the joint with index k where they belong to one."""

_NAMES = {
    "angle": "joint {}",
    "torque": "the gravity torque of joint {}",
    "move": "the last move of joint {}",
    "air": "the air temperature",
}

LAWS: Mapping[str, Callable[[Array], Array]] = {
    "linear": lambda x: x,
    "cubic": lambda x: x**3,
    "sign": np.tanh,
    "cosine": np.cos,
    "sine": np.sin,
    "window": lambda x: np.where(np.abs(x) < 0.5, np.cos(np.pi * x) ** 2, 0.0),
}
"""Laws by name, functions of x = rate x (quantity - centre)."""

WHEN_USED = ("angle", "torque", "air")
"""The quantities that are known when a model is used, not only while it is fitted."""


@dataclass(frozen=True)
class Held:
    """A law of one quantity that keeps its value beyond `low` and `high`.

    These are the borders of the measured range.

    Attributes
    ----------
    joint : int
        Joint, from 1; 0 for a quantity without a joint.
    rate : float
        Cycles per turn of a wave, otherwise the inverse of the quantity's scale.
    centre, low, high : float
        In the unit of the quantity.
    """

    quantity: str
    joint: int
    law: str
    rate: float
    centre: float
    low: float
    high: float

    def evaluate(self, conditions: Conditions) -> Array:
        """Evaluate the law, shape (n,)."""
        values = np.clip(QUANTITIES[self.quantity](conditions, self.joint - 1), self.low, self.high)
        return LAWS[self.law](self.rate * (values - self.centre))

    def beyond(self, conditions: Conditions) -> dict[str, Array]:
        """Return the distance (n,) beyond the measured range, by name of the quantity.

        It is a share of the width of the range, 0 within it.
        """
        values = QUANTITIES[self.quantity](conditions, self.joint - 1)
        name = _NAMES[self.quantity].format(conditions.axis_names[self.joint - 1].removeprefix("j"))
        return {name: _beyond(values, self.low, self.high)}

    def drawn_over(self, conditions: Conditions) -> Axis:
        """Return the quantity itself."""
        if self.quantity == "angle":
            cycles = self.rate if self.law in ("cosine", "sine") else 0.0
            return Axis.angle(self.joint, conditions, cycles=cycles)
        values = QUANTITIES[self.quantity](conditions, self.joint - 1)
        if self.quantity == "torque":
            return Axis(f"gravity torque of joint {self.joint}, N·m", values / 1000.0)
        if self.quantity == "move":
            return Axis(f"last move of joint {self.joint}, rad", values)
        return Axis("air temperature, °C", values)


@dataclass(frozen=True)
class HeldPair:
    """A wave of two joint angles together, both held at the borders of the measured range.

    It is cos or sin of (rate x angle + other_rate x other angle).
    """

    joint: int
    other: int
    law: str
    rate: float
    other_rate: float
    low: float
    high: float
    other_low: float
    other_high: float

    def evaluate(self, conditions: Conditions) -> Array:
        """Evaluate the wave, shape (n,), from -1 to 1."""
        one = np.clip(conditions.joints[:, self.joint - 1], self.low, self.high)
        other = np.clip(conditions.joints[:, self.other - 1], self.other_low, self.other_high)
        return LAWS[self.law](self.rate * one + self.other_rate * other)

    def beyond(self, conditions: Conditions) -> dict[str, Array]:
        """Return the distances (n,) beyond the measured ranges, by name of each joint.

        They are shares of the width of the range, 0 within it.
        """
        one = Held("angle", self.joint, self.law, self.rate, 0.0, self.low, self.high)
        other = Held("angle", self.other, self.law, self.other_rate, 0.0, self.other_low, self.other_high)
        return one.beyond(conditions) | other.beyond(conditions)


@dataclass(frozen=True)
class OfTime:
    """A function of the time since the start of the campaign, s.

    It is linear between `times`, constant before and after. Steps, drifts, slow waves and air that acts
    late are all of this kind: they are known during the campaign only. `clock` is "time", or "order" if
    the readings carry no times and `times` are their ranks, which change just as slowly.
    """

    times: tuple[float, ...]
    values: tuple[float, ...]
    clock: str = "time"

    def evaluate(self, conditions: Conditions) -> Array:
        """Evaluate the function, shape (n,); NaN if a reading has no time."""
        return np.interp(getattr(conditions, self.clock), self.times, self.values)

    def beyond(self, conditions: Conditions) -> dict[str, Array]:
        """Return the distance (n,) beyond the measured time.

        It is a share of the campaign, 0 within it.
        """
        return {"the time": _beyond(getattr(conditions, self.clock), self.times[0], self.times[-1])}

    def drawn_over(self, conditions: Conditions) -> Axis:
        """Return the time."""
        if self.clock == "order":
            return Axis("reading, in order of time", conditions.order + 1.0)
        return Axis("time, h", conditions.time / 3600.0)


def _beyond(values: Array, low: float, high: float) -> Array:
    return np.maximum(np.maximum(low - values, values - high), 0.0) / max(high - low, 1e-12)
