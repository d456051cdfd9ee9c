"""The null distribution of the residuals: the same residuals with random signs for whole poses.

Readings of one pose share its repeatability and what the model lacks there, and real residuals have tails; neither is
in an F test that takes every row for itself. The residuals of a pose keep their sizes and what they have in common,
only their common sign is drawn, and what the model absorbs is taken out again:

    r* = (I - QQ') (w o (I - B)^-1/2 r),      w = +1 or -1 for each pose,

B the blocks of QQ' that belong to one pose: where few poses carry a fit it hides most of their errors, and would hide
them once more. The data are compared as the fit left them, which it did once.

A test looks at many places; what counts is how large the largest of all is by chance. That is known from some 200
draws, and beyond them its logarithm is taken to fall as straight as it does among them. Sources: Davidson and
Flachaire 2008 (wild bootstrap, clusters: Cameron et al. 2008); Bell and McCaffrey 2002 (B); Westfall and Young 1993
(the smallest of many p-values); Pickands 1975 (exponential tail).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.array import Array
from calib.scan.space import Space

DRAWS, _FEWEST_DRAWS = 199, 59
_MOST_NUMBERS = 4_000_000  # of the drawn residuals: 32 MB
_TERMS = 40  # of the series of (1 - b)^-1/2: to 1 % where the fit hides 90 % of an error
_CLIP = 3.0
_TAIL = 0.2  # share of the draws from which the tail is taken


def draws(space: Space, *, clipped: bool = False, most: int = DRAWS) -> Array:
    """(size, 1 + B) the residuals with all signs as they are, then as chance would have them; B up to `most`, fewer
    where readings are many. clipped: readings far larger than most count as three times the median, so that a few of
    them neither make structure nor hide it."""
    pose = space.fitted.readings.conditions.pose
    count = int(np.clip(_MOST_NUMBERS // space.size, _FEWEST_DRAWS, most))
    signs = np.ones((pose.max() + 1, 1 + count))
    signs[:, 1:] = np.random.default_rng(0).choice((-1.0, 1.0), signs[:, 1:].shape)
    errors, residual = _errors(space, pose), space.residual
    if clipped:
        length = np.linalg.norm(errors, axis=0)
        kept = np.minimum(1.0, _CLIP * np.median(length) / np.maximum(length, 1e-300))
        errors, residual = errors * kept, residual * kept
    drawn = errors[:, :, None] * signs[pose]
    drawn[:, :, 0] = residual  # the fit hides its part of the draws as it did of the data, once
    drawn = drawn.reshape(space.size, 1 + count)
    basis = space.basis_of_readings
    return drawn - basis @ (basis.T @ drawn)


def _errors(space: Space, pose: NDArray[np.int64]) -> Array:
    """(k, n) (I - B)^-1/2 r by its series: residuals as large as the errors behind them."""
    k, n = space.residual.shape
    basis = space.basis_of_readings.reshape(k, n, -1)
    order = np.argsort(pose, kind="stable")
    first = np.searchsorted(pose[order], np.arange(pose.max() + 1))
    term = space.residual
    total = term.copy()
    for j in range(1, _TERMS):
        shared = np.einsum("kna,kn->na", basis, term)
        of_pose = np.add.reduceat(shared[order], first, axis=0)
        term = (2.0 * j - 1.0) / (2.0 * j) * np.einsum("kna,na->kn", basis, of_pose[pose])
        total += term
    return total


@dataclass(frozen=True)
class Chance:
    """The largest -log p of every draw, over all places of a test; p as the test itself has it."""

    largest: Array  # (B,) ascending

    @classmethod
    def of(cls, log_p: Array) -> Chance:
        """The chances given log p (places, B) of the draws; every place counts in full, so p may exceed 1."""
        return cls(np.sort(-np.min(log_p, axis=0)))

    def p_value(self, log_p: float) -> float:
        """Chance that the largest of all places is so large, from the log p of one."""
        count = len(self.largest)
        start = int((1.0 - _TAIL) * count)
        threshold = float(self.largest[start])
        if -log_p <= threshold:
            return (1.0 + float(np.sum(self.largest >= -log_p))) / (1.0 + count)
        mean = max(float(np.mean(self.largest[start:] - threshold)), 1e-3)
        return _TAIL * float(np.exp((threshold + log_p) / mean))
