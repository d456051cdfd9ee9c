"""The scatter of the joints that a model leaves: what it lacks, as the readings of its own fit show it.

A law that a model does not hold, a wave of a gear say, moves the joints of a pose alike in every reading there: of ten
poses with three targets each it is drawn ten times, not in ninety rows, and most of it is taken on by the parameters.
With r the whitened residual, Z the columns of all that was estimated or is left open, P the covariance of their priors
and W the columns of the joints of every pose,

    r ~ N(0, H^-1 + s^2 W W'),    H = (I + Z P Z')^-1,    W'H W = U a U',
    2 log L(s) = sum s^2 (u'W'H r)^2 / (1 + s^2 a) - log(1 + s^2 a).

Taken is the mean of s^2 by L and by how much gears are off as a rule. Source: Patterson and Thompson 1971 (restricted
likelihood).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from calib.arm.robot import Robot
from calib.array import Array
from calib.model.effect import Effect, effect
from calib.model.regressors import Constant
from calib.units import DEG

_USUAL = 0.02 * DEG  # scatter of joints whose gears are as usual: half-normal
_TRIED = np.linspace(0.0, 4.0 * _USUAL, 401)
_POSES = 100  # more hardly sharpen it


def joints_apart(robot: Robot) -> Effect:
    """Every joint off by itself: the derivatives of a reading by them."""
    acts = {f"j{k}": ("", None, [(slot, Constant())]) for k, slot in enumerate(robot.joint_slots, start=1)}
    return effect("scatter", "transmission", "robot", "The joints scatter.", acts)


def by_pose(columns: Array, pose: NDArray[np.int64], part: NDArray[np.int64], steps: Array) -> Array:
    """(k c, m + N P) columns (k c, m + N) of the readings `part` (c,), of which the last N, of joints, stand apart for
    each of P poses; pose (n,): of all readings; steps (N,): of a joint, so that a slide scatters as many mm as others
    deg."""
    known, at = np.unique(pose, return_inverse=True)
    taken = np.unique(np.linspace(0, len(known) - 1, _POSES).astype(np.int64))
    mine = np.tile(at[part], len(columns) // len(part))[:, None] == taken
    joints = columns[:, -len(steps) :] * steps
    apart = (mine[:, :, None] * joints[:, None, :]).reshape(len(columns), -1)
    return np.column_stack([columns[:, : -len(steps)], apart])


def likely_scatter(shown: Array, along: Array) -> float:
    """The scatter s, rad, by W'H W (w, w) and W'H r (w,)."""
    values, vectors = np.linalg.eigh(shown)
    values, square = np.maximum(values, 0.0)[:, None], ((vectors.T @ along) ** 2)[:, None]
    share = _TRIED**2 / (1.0 + _TRIED**2 * values)
    twice = np.sum(square * share - np.log1p(_TRIED**2 * values), axis=0) - (_TRIED / _USUAL) ** 2
    weight = np.exp(0.5 * (twice - twice.max()))
    return float(np.sqrt(weight @ _TRIED**2 / weight.sum()))
