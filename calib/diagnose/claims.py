"""The significance of an effect where rows are dependent or few: the whole scan is repeated on randomised residuals.

Where poses repeat, or several targets are read in one, the rows of a pose share its repeatability; where poses are few,
the tails of the residual count. Then the largest of all candidates at all places of their scans is taken on each of
the drawn residuals (`calib.diagnose.null`), and a claim must exceed those, not only its F test.

An F test also takes the noise for equal in all directions. What a law outside the library leaves is not: play that a
load closes leaves errors of one joint alone, and the best of three thousand waves of that joint looks sure beside the
little that is left elsewhere. So a gain is measured against what is left along the very direction in which the effect
acts, pose by pose, and stretch by stretch in time: beside a drift that no law describes every step looks sure. Sources:
White 1980, Newey and West 1987 (variance of an estimate where noise is not alike, or lasts).
"""

from __future__ import annotations

import math

import numpy as np
from scipy.special import fdtrc

from calib.array import Array
from calib.diagnose.null import Chance, draws
from calib.scan.scores import ABSORBED, Scores
from calib.scan.space import Space

_FEW = 150  # poses below which rows alone do not say how sure a claim is
STRETCHES = 16  # of the campaign, by which what lasts is known


def chance_by_pose(scores: Scores) -> Chance | None:
    """The chance of a gain with poses as the units; None where poses are many, each with one reading."""
    space = scores.space
    pose = space.fitted.readings.conditions.pose
    count = int(pose.max()) + 1
    if count >= _FEW and count == len(pose):
        return None
    drawn = draws(space)[:, 1:]
    square = np.sum(drawn**2, axis=0)
    log_p = []
    for index, family in enumerate(scores.families):
        gain, columns = _gains(scores.a[index], family.shared(space, drawn), family.raw)
        tries = np.array([scores.multiplicity(index, place) for place in range(len(gain))])
        for alike in np.unique(tries):
            of = tries == alike
            best = np.argmax(gain[of], axis=0)
            log_p.append(
                _log_p(
                    np.take_along_axis(gain[of], best[None], axis=0)[0],
                    columns[of][best],
                    square,
                    scores.freedom,
                )
                + math.log(alike)
            )
    return Chance.of(np.array(log_p))


def _gains(a: Array, b: Array, raw: Array) -> tuple[Array, Array]:
    """(places, B) gains b'A^-1 b for A (places, p, p) and b (places, p, B), and (places,) columns that count."""
    scale = 1.0 / np.sqrt(np.maximum(raw, 1e-300))
    values, vectors = np.linalg.eigh(a * scale[:, :, None] * scale[:, None, :])
    counts = values > ABSORBED
    weights = np.where(counts, 1.0 / np.sqrt(np.where(counts, values, 1.0)), 0.0)
    along = (vectors * weights[:, None, :]).transpose(0, 2, 1) @ (b * scale[:, :, None])
    return np.sum(along**2, axis=1), counts.sum(axis=1)


def _log_p(gain: Array, columns: Array, square: Array, freedom: int) -> Array:
    """log of the F test's p for gains (B,) with so many columns (B,), of residual squares (B,)."""
    left = np.maximum(freedom - columns, 1)
    ratio = (gain / np.maximum(columns, 1)) / (np.maximum(square - gain, 1e-300) / left)
    with np.errstate(divide="ignore"):  # beyond what a float holds: -inf
        return np.where(columns > 0, np.log(fdtrc(np.maximum(columns, 1), left, ratio)), 0.0)


def against_own_noise(space: Space, directions: Array, left: Array) -> float:
    """Factor, at most 1, of the gain along orthonormal directions (size, p) of an effect, where what the whole model
    leaves (size,) is larger along them than elsewhere."""
    k, n = space.residual.shape
    conditions = space.fitted.readings.conditions
    acting = (directions * left[:, None]).reshape(k, n, -1).sum(axis=0)
    in_time = np.argsort(np.argsort(conditions.order, kind="stable"), kind="stable")
    square = max(
        float(np.sum(np.array([np.bincount(group, column) for column in acting.T]) ** 2))
        for group in (conditions.pose, in_time * STRETCHES // n)
    )
    along = square / max(float(np.sum(directions**2)), 1e-300)
    return min(1.0, float(left @ left) / space.rows / max(along, 1e-300))
