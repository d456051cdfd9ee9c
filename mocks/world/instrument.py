"""Hidden effects of the instrument, which change the point that the tracker shows.

The group is instrument. t is the time since the start of the campaign; a drift is given per hour.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from mocks.world.arm import Sight
from mocks.world.draw import Material
from mocks.world.effect import Effect, Values
from mocks.world.transforms import turn

HOUR_S = 3600.0


def elapsed_hours(m: Material, departure: str) -> Callable[[float], float]:
    """Return the function of time by which a drift grows, in h.

    It is t, or sqrt(t t_end) for "sqrt_drift". Both agree at the end of the campaign.
    """
    end_s = m.session.duration_s
    if departure == "sqrt_drift":
        return lambda t_s: math.sqrt(max(0.0, t_s) * end_s) / HOUR_S
    return lambda t_s: t_s / HOUR_S


def drift_translation(m: Material, departure: str = "textbook") -> Effect:
    """Move the instrument's frame by v t; vx, vy, vz in mm/h."""
    hours = elapsed_hours(m, departure)
    names = ("vx", "vy", "vz")

    def act(sight: Sight, p: Values) -> None:
        sight.point = sight.point + hours(sight.state.t_s) * np.array([p[name] for name in names])

    amplitudes = {name: 0.1 * v for name, v in zip(names, m.direction(3), strict=True)}
    return Effect(m.label, "instrument", act, amplitudes, dict.fromkeys(names, "mm/h"), shape=departure)


def drift_rotation(m: Material, departure: str = "textbook") -> Effect:
    """Turn the instrument's frame about the station by w t; wx, wy, wz in deg/h."""
    hours = elapsed_hours(m, departure)
    names = ("wx", "wy", "wz")

    def act(sight: Sight, p: Values) -> None:
        angle = [math.radians(p[name]) * hours(sight.state.t_s) for name in names]
        beam = sight.point - sight.station
        sight.point = sight.point + (turn(angle)[:3, :3] - np.eye(3)) @ beam

    amplitudes = {name: 0.003 * v for name, v in zip(names, m.direction(3), strict=True)}
    return Effect(m.label, "instrument", act, amplitudes, dict.fromkeys(names, "deg/h"), shape=departure)


def sqrt_drift(m: Material) -> Effect:
    """Departure: a drift like sqrt(t), fast at first."""
    if m.label == "drift_rotation":
        return drift_rotation(m, "sqrt_drift")
    return drift_translation(m, "sqrt_drift")


def tracker_scale(m: Material) -> Effect:
    """Every distance too long by s ppm: s (p - station)."""

    def act(sight: Sight, p: Values) -> None:
        sight.point = sight.point + 1e-6 * p["s"] * (sight.point - sight.station)

    return Effect(m.label, "instrument", act, {"s": 10.0 * m.sign()}, {"s": "ppm"})
