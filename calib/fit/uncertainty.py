"""The uncertainty of a prediction: the covariance of the parameters propagated to the tool point, C_p = J C J'.

It is small near the readings and large where the model extrapolates: a joint that was never loaded, a corner that was
never measured. It contains what the readings did not determine, not what the model lacks. Source: GUM, first-order
propagation.

A carried term keeps its value beyond the measured range, where nothing confirms it. There its whole prior size is
added, in proportion up to a quarter of the width of the range beyond it, along the motion of its slot.
"""

from __future__ import annotations

import numpy as np

from calib.array import Array
from calib.data.conditions import Conditions
from calib.model.model import Design, RobotModel

_AT_ONCE = 1200  # points whose columns are in memory at a time
_UNKNOWN_BEYOND = (
    0.25  # of the measured width: from there on nothing is known of a carried term but its prior size
)
_CONTAINED = 0.95
_NODES = 32


def predict_with_covariance(
    model: RobotModel, estimate: Array, covariance: Array, conditions: Conditions
) -> tuple[Array, Array]:
    """Points (n, 3), mm, and their covariances (n, 3, 3), mm2, from the covariance (m, m) of the estimate."""
    n = len(conditions)
    points, spread = np.empty((n, 3)), np.empty((n, 3, 3))
    for part in np.array_split(np.arange(n), max(-(-n // _AT_ONCE), 1)):
        design = Design(model, conditions.take(part))
        frames = design.frames(estimate, design.slots)
        columns = design.point_columns(frames).reshape(3, len(part), -1)
        points[part] = np.broadcast_to(frames.p, (3, len(part))).T
        spread[part] = np.einsum("anm,bnm->nab", columns @ covariance, columns, optimize=True)
        if beyond := _beyond(design):
            moves = frames.velocities(tuple(beyond))
            for move, variance in zip(moves, beyond.values(), strict=True):
                spread[part] += np.einsum("an,bn,n->nab", move, move, variance)
    return points, spread


def _beyond(design: Design) -> dict[str, Array]:
    """Slot -> (n,) variance of what carried terms may do to it beyond the measured range, internal units.

    A term with the value 0 at the border may be anything beyond it: each effect counts with its full amplitude.
    """
    model, found = design.model, dict[str, Array]()
    for effect in model.effects:
        distance = np.array([*effect.beyond(design.conditions).values()])
        if not distance.any():
            continue
        grown = np.minimum(distance.max(axis=0) / _UNKNOWN_BEYOND, 1.0) ** 2
        for slot in dict.fromkeys(term.slot for term in effect.terms):
            terms = [t for t in effect.terms if t.slot == slot]
            size = [(model.prior_std[model.index[t.parameter]] * t.weight) ** 2 for t in terms]
            values = [t.regressor.evaluate(design.conditions) ** 2 for t in terms]
            amplitude = sum(s * v for s, v in zip(size, values, strict=True))
            variance = grown * np.maximum(amplitude, np.mean(size))
            found[slot] = found.get(slot, 0.0) + variance
    return found


def expanded(covariance: Array) -> Array:
    """(n,) expanded uncertainty U of points with covariances (n, 3, 3): k = 2 along their worst direction, mm.

    This sphere contains 74 to 95 % of the points; `radius_95` contains 95 %.
    """
    largest = np.linalg.eigvalsh(covariance)[:, -1]
    return 2.0 * np.sqrt(np.maximum(largest, 0.0))


def radius_95(covariance: Array) -> Array:
    """(n,) radius of the sphere that contains 95 % of points with covariances (n, 3, 3), mm; exact to 1e-3 of it.

    The distance along the worst axis is integrated over Gauss-Legendre nodes, the other two over all directions of
    their plane, where what remains is exponential; the radius follows by bisection.
    """
    values = np.maximum(np.linalg.eigvalsh(covariance), 0.0)
    largest = values[:, 2]
    shares = values[:, :2] / np.where(largest > 0.0, largest, 1.0)[:, None]
    low, high = np.full(len(values), 1.9), np.full(len(values), 2.8)  # the radius in standard deviations
    for _ in range(20):
        radius = 0.5 * (low + high)
        outside = _contained(radius, shares) < _CONTAINED
        low, high = np.where(outside, radius, low), np.where(outside, high, radius)
    return 0.5 * (low + high) * np.sqrt(largest)


_X, _WEIGHT = np.polynomial.legendre.leggauss(_NODES)
_TURNS = (np.arange(16) + 0.5) * np.pi / 32.0  # a quarter turn; the plane is symmetric


def _contained(radius: Array, shares: Array) -> Array:
    """(n,) share of points within a radius (n,), of variances shares (n, 2) and 1."""
    along = radius[:, None] * np.sin(
        0.5 * np.pi * _X
    )  # dense at the ends, where the plane shrinks to nothing
    step = radius[:, None] * np.cos(0.5 * np.pi * _X) * 0.5 * np.pi * _WEIGHT
    left = np.maximum(radius[:, None] ** 2 - along**2, 0.0)
    # in the whitened plane the square of the distance is exponential in every direction
    plane = np.maximum(shares[:, :1] * np.cos(_TURNS) ** 2 + shares[:, 1:] * np.sin(_TURNS) ** 2, 1e-12)
    within = -np.expm1(-0.5 * left[:, :, None] / plane[:, None, :]).mean(axis=2)
    return np.sum(step * np.exp(-0.5 * along**2) * within, axis=1) / np.sqrt(2.0 * np.pi)
