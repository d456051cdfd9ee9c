"""Gear orders: the error of a joint repeats every turn, so it is a Fourier series of whole orders.

    error(theta) = sum_n a_n cos(n theta) + b_n sin(n theta),    n = 1..100

Wheels that run eccentrically, teeth, bearings and the motor's side each add a few orders; together they are one curve
of the gear. Every amplitude is held to a usual size, one for each half octave of orders, which the readings themselves
say (`calib.diagnose.carriers`): where they say nothing the curve stays near zero, also at angles that no reading had.
Source: MacKay 1992 (sizes by evidence).
"""

from __future__ import annotations

import math
from collections.abc import Collection

import numpy as np

from calib.array import Array
from calib.effects.kind import Kind
from calib.model.effect import Effect, Written, effect
from calib.model.regressors import Cosine, GearCurve, Sine

# Cycles a turn: up to the reducer's ratio, beyond which the waves are few and `periodic` names them
HIGHEST = 100

_MOST = 0.9  # of a curve's mean square


KINDS = (
    Kind(
        "gear_orders",
        words="gear of joint {joint}, over a turn",
        check=(
            "Look where the curve of joint {joint} is steep, and measure it again after a year: "
            "a curve that grows is wear, one that has kept can be corrected for."
        ),
        apart=(),
    ),
)


def half_octave(order: float) -> int:
    """The half octave in which an order lies: 0 from 1, 1 from 1.41, 2 from 2, and so on."""
    return int(2.0 * math.log2(order) + 1e-9)


BANDS = half_octave(HIGHEST) + 1


def mostly(sizes: Array) -> tuple[int, int]:
    """The first and last order that hold most of the curve's square, by the sizes (BANDS,) of its half octaves."""
    share = np.cumsum([float(sizes[half_octave(n)]) ** 2 for n in range(1, HIGHEST + 1)])
    low, high = np.searchsorted(share / share[-1], ((1.0 - _MOST) / 2.0, (1.0 + _MOST) / 2.0))
    return int(low) + 1, int(high) + 1


def gear_orders(joint: int, sizes: Array, without: Collection[int] = ()) -> Effect:
    """Curve of `joint` over all whole orders but those of `without`; parameters cosN and sinN, deg.

    sizes: (BANDS,) usual size of the amplitudes of every half octave, deg.
    """
    orders = [n for n in range(1, HIGHEST + 1) if n not in without]
    slot, acts = f"theta{joint}", dict[str, Written]()
    low, high = mostly(sizes)
    for n in orders:
        size = float(sizes[half_octave(n)])
        acts[f"cos{n}"] = ("deg", size, [(slot, Cosine(joint, float(n)))])
        acts[f"sin{n}"] = ("deg", size, [(slot, Sine(joint, float(n)))])
    return effect(
        f"gear_orders:j{joint}",
        "transmission",
        "robot",
        f"Joint {joint}: gear error over a turn, RMS, mostly orders {low} to {high}.",
        acts,
        {"mostly_from": float(low), "mostly_to": float(high)},
    )


def curve_of(joint: int, effect: Effect, values: Array) -> GearCurve:
    """The curve of a joint's gear orders with their values (p,), internal units."""
    amplitudes = np.zeros(HIGHEST + 1, dtype=complex)
    for parameter, value in zip(effect.parameters, values, strict=True):
        kind, order = parameter.short[:3], int(parameter.short[3:])
        amplitudes[order] += value if kind == "cos" else -1j * value
    return GearCurve(joint, tuple(amplitudes.tolist()))
