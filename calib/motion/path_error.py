"""Errors of a moving robot along and across its path, by speed, static and dynamic.

An error is measured minus predicted, at the joints that the robot reported for that instant. One part of
the nominal arm's error is static and depends on the posture only: geometry, deflection and gears, as
fitted. The rest is dynamic: bending under acceleration, the instrument's own lag, joints reported late.

The clocks were set by this same error. A lag that is the same at all speeds (along = lag x speed) is
therefore part of their offset, and only its change with speed is seen here. ISO 9283, 8.2, judges a path
by its largest distances; this table by RMS and maximum.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.array import Array
from calib.motion.alignment import Aligned

_BINS = 5
_FEWEST = 20


@dataclass(frozen=True)
class SpeedBandErrors:
    """Errors of `count` samples between two speeds, mm/s, in mm.

    `nominal_` are errors of the nominal arm in its place, `static_` its static part, and the others the
    dynamic rest. `along_mean` is below zero if points come late; `lag_ms` is the time by which they do,
    ms, beyond the offset of the clocks.
    """

    slowest: float
    fastest: float
    count: int
    nominal_along_rms: float
    nominal_across_rms: float
    static_along_rms: float
    static_across_rms: float
    along_mean: float
    along_rms: float
    across_rms: float
    across_max: float
    lag_ms: float


def by_speed(aligned: Aligned, slow_mm_s: float) -> list[SpeedBandErrors]:
    """Compute errors in bands of equal numbers of samples above `slow_mm_s`.

    Samples with a weight of zero (gross errors) are excluded.
    """
    moving = (aligned.speed >= slow_mm_s) & (aligned.weight > 0.0)
    speed = aligned.speed[moving]
    if len(speed) < _FEWEST:
        return []
    direction = aligned.velocity[moving] / speed[:, None]
    along, across = split(aligned.moving[moving], direction)
    nominal_along, nominal_across = split(aligned.nominal[moving], direction)
    static_along, static_across = split((aligned.nominal - aligned.moving)[moving], direction)
    edges = np.quantile(speed, np.linspace(0.0, 1.0, min(_BINS, len(speed) // _FEWEST) + 1))
    which = np.clip(np.searchsorted(edges, speed, side="right") - 1, 0, len(edges) - 2)
    return [
        SpeedBandErrors(
            slowest=float(edges[k]),
            fastest=float(edges[k + 1]),
            count=int(here.sum()),
            nominal_along_rms=_rms(nominal_along[here]),
            nominal_across_rms=_rms(nominal_across[here]),
            static_along_rms=_rms(static_along[here]),
            static_across_rms=_rms(static_across[here]),
            along_mean=float(along[here].mean()),
            along_rms=_rms(along[here]),
            across_rms=_rms(across[here]),
            across_max=float(across[here].max()),
            lag_ms=-1e3 * float(np.sum(along[here] * speed[here]) / np.sum(speed[here] ** 2)),
        )
        for k in range(len(edges) - 1)
        if (here := which == k).any()
    ]


def split(error: Array, direction: Array) -> tuple[Array, Array]:
    """Split errors (k, 3) by unit vectors (k, 3).

    Returns the signed component along each, and the length of the rest, both (k,).
    """
    along = np.sum(error * direction, axis=1)
    return along, np.linalg.norm(error - along[:, None] * direction, axis=1)


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))
