"""D-optimal selection of poses by exchange: n of N candidates with the largest determinant.

Each start is greedy. Then each pose is replaced by the best of all candidates, until no replacement improves the
determinant of the information (Fedorov 1972, in the order of Cook and Nachtsheim 1980). Nubiola 2.5.2 removes and adds
poses likewise.

Let M be the information of the selection and X_j (k, m) the rows of a pose. Adding the pose multiplies det M by
det(I + B_j), B_j = X_j M^-1 X_j', and removing it by det(I - B_j). A pose that enters or leaves changes M by rank k,
and so B of every candidate by V V', with V = X_j M^-1 X_i' L and L L' = (I +- B_i)^-1. This takes one matrix product
and k x k algebra for all N at once, without a decomposition for each candidate.

**Bound.** The continuous D-optimal design over the candidates is a certified upper bound for every selection.
Weights w_i >= 0 of sum one replace the choice of poses, and maximise log det sum w_i X_i'X_i. The steps are
multiplicative, w_i <- w_i (d_i / m)^power with d_i = tr(M^-1 X_i'X_i) (Silvey, Titterington and Torsney 1978).
Candidates that belong to no optimum according to Harman and Pronzato (2007) are left out. For any weights,
log det M + m log(max d_i / m), with the maximum over all candidates, is an upper bound for every design (trace and
determinant of M^-1/2 M' M^-1/2). The value is therefore a bound after any number of steps.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.array import Array
from calib.errors import DataError
from calib.selection.pose_rows import PoseRows

Indices = NDArray[np.int64]
STARTS = 32
_SHORT = 300  # candidates for the starts; the best start then uses all
_SHORT_PER_POSE = 5
_GAIN = 1e-9  # an exchange that raises log det by less is not made
_PASSES = 100
_FAINT = 1e-4  # share of a pose's average information: stabilises the first poses of a start
_GRAIN = 1e-9  # least share of its information that a leaving pose leaves behind
TOLERANCE = 3e-4  # how far the bound may lie above the optimum, as a share of det^(1/m)
_STEPS = 5000
_POWER = 1.9  # 1 is the classic step; nearly twice its length converges as safely and faster
_EVERY = 10


def select(rows: Array, count: int, *, starts: int = STARTS, seed: int = 0) -> Indices:
    """Find a D-optimal selection: the best of `starts` exchanges.

    No candidate is taken twice. The same seed gives the same selection.

    Parameters
    ----------
    rows : array of shape (N, k, m)
        Whitened Jacobian rows of N candidates, any units of the parameters.

    Returns
    -------
    array of int, shape (count,)
        Indices, ascending.

    Raises
    ------
    DataError
        There are fewer candidates than `count`, fewer rows than parameters, or parameters that the candidates cannot
        determine.
    """
    blocks = PoseRows.of(rows)
    return best_of_starts(blocks, optimum(blocks), count, starts=starts, seed=seed)


def best_of_starts(
    blocks: PoseRows, best: Optimum, count: int, *, starts: int = STARTS, seed: int = 0
) -> Indices:
    """Find the best selection of several starts, for prepared blocks and their optimum.

    The starts choose among the candidates with the highest sensitivity at the continuous optimum, because good
    selections are found there. The best of them is then exchanged against all candidates.
    """
    _refuse(blocks, count, starts)
    short = np.argsort(-best.sensitivity, kind="stable")[: max(_SHORT, _SHORT_PER_POSE * count)]
    short = np.sort(short)
    few = blocks.take(short)
    drawn = min(count, 1 + blocks.parameters // blocks.width)
    rng = np.random.default_rng(seed)
    found = []
    for start in range(starts):
        random = rng.choice(few.poses, drawn if start else 0, replace=False)
        found.append(exchange(few, greedy(few, list(random), count)))
    winner = max(found, key=lambda each: log_det(few, each))
    return exchange(blocks, short[winner])


def log_det(blocks: PoseRows, selection: Indices) -> float:
    """Compute log det of the information of a selection, in the blocks' scale; -inf if singular."""
    sign, value = np.linalg.slogdet(blocks.information(selection))
    return float(value) if sign > 0 else -np.inf


def greedy(blocks: PoseRows, chosen: Sequence[int] | Indices, count: int) -> Indices:
    """Add the best candidates one by one to `chosen`; return `count` in total, ascending."""
    faint = _FAINT / blocks.poses * np.eye(blocks.parameters)
    selection = [int(i) for i in chosen]
    state = SelectionState.of(blocks, blocks.information(np.array(selection, dtype=np.int64)) + faint)
    while len(selection) < count:
        gain = state.gains()
        gain[selection] = -np.inf
        selection.append(int(np.argmax(gain)))
        state = state.changed(selection[-1], +1.0)
    return np.sort(np.array(selection, dtype=np.int64))


def without_least(blocks: PoseRows, selection: Indices, count: int, *, fixed: Sequence[int] = ()) -> Indices:
    """Remove the poses that cost least until `count` are left; return them ascending.

    The poses `fixed` stay.
    """
    left = np.asarray(selection, dtype=np.int64)
    while len(left) > count:
        few = blocks.take(left)
        b = SelectionState.of(few, few.information()).b.transpose(2, 0, 1)
        keeps = np.linalg.det(np.eye(blocks.width) - b)  # share of the determinant that stays
        keeps[np.isin(left, fixed)] = -np.inf
        left = np.delete(left, np.argmax(keeps))
    return np.sort(left)


def exchange(blocks: PoseRows, selection: Indices, *, fixed: Sequence[int] | Indices = ()) -> Indices:
    """Improve a selection by exchanges until none raises its determinant.

    The poses `fixed` stay. The indices are returned ascending.

    Raises
    ------
    DataError
        The initial selection does not determine the parameters.
    """
    selection = selection.copy()
    free = np.flatnonzero(~np.isin(selection, fixed))
    if not np.isfinite(log_det(blocks, selection)):
        raise DataError(
            "the first selection does not determine the parameters.", do="Start from a better one."
        )
    for _ in range(_PASSES):
        # computed again for each pass, so that rounding does not add up
        state = SelectionState.of(blocks, blocks.information(selection))
        swapped = False
        for place in free:
            without = state.changed(selection[place], -1.0)
            gain = without.gains()
            gain[np.delete(selection, place)] = -np.inf
            best = int(np.argmax(gain))
            if gain[best] > gain[selection[place]] + _GAIN:
                state = without.changed(best, +1.0)
                selection[place] = best
                swapped = True
        if not swapped:
            break
    return np.sort(selection)


def _refuse(blocks: PoseRows, count: int, starts: int) -> None:
    if starts < 1:
        raise DataError(f"is {starts}.", do="Give one start or more.", key="starts")
    if count > blocks.poses:
        raise DataError(
            f"{count} poses are requested from {blocks.poses} candidates.",
            do="Draw more candidates.",
            key="count",
        )
    if count * blocks.width < blocks.parameters:
        raise DataError(
            f"{count} poses have {count * blocks.width} rows for {blocks.parameters} parameters.",
            do=f"Select at least {-(-blocks.parameters // blocks.width)} poses, or free fewer parameters.",
            key="count",
        )


@dataclass(frozen=True)
class SelectionState:
    """State of a selection in an exchange.

    Attributes
    ----------
    inverse : array of shape (m, m)
        M^-1.
    b : array of shape (k, k, N)
        B_j = X_j M^-1 X_j' of every candidate.
    """

    blocks: PoseRows
    inverse: Array
    b: Array

    @classmethod
    def of(cls, blocks: PoseRows, information: Array) -> SelectionState:
        """Compute the state from the information M (m, m), without updates."""
        x = blocks.columns
        inverse = np.asarray(np.linalg.inv(information), dtype=np.float64)
        y = (inverse @ x.reshape(len(x), -1)).reshape(x.shape)
        return cls(blocks, inverse, np.einsum("man,mbn->abn", x, y))

    def gains(self) -> Array:
        """Compute log det(I + B_j), shape (N,): the gain of adding each candidate.

        All candidates are eliminated at once.
        """
        rest = self.b.copy()
        k = len(rest)
        rest[range(k), range(k)] += 1.0
        product = np.ones(rest.shape[2])
        for p in range(k):
            product *= rest[p, p]
            below = rest[p + 1 :, p]
            rest[p + 1 :, p + 1 :] -= below[:, None] * (below / rest[p, p])[None]
        return np.log(product)

    def changed(self, pose: int, sign: float) -> SelectionState:
        """Update the state after one pose entered (+1) or left (-1)."""
        x = self.blocks.columns
        values, directions = np.linalg.eigh(self.b[:, :, pose])
        # The only pose in some direction leaves a small share of itself behind, until the next pass.
        factor = directions / np.sqrt(np.maximum(1.0 + sign * values, _GRAIN))
        u = self.inverse @ x[:, :, pose] @ factor
        v = (u.T @ x.reshape(len(x), -1)).reshape(-1, *x.shape[1:])
        b = self.b.copy()
        for each in v:
            b -= sign * each[:, None] * each[None]
        return SelectionState(self.blocks, self.inverse - sign * u @ u.T, b)


@dataclass(frozen=True)
class Optimum:
    """Continuous optimum of N candidates.

    Attributes
    ----------
    weights : array of shape (N,)
        Weight of each candidate.
    sensitivity : array of shape (N,)
        d_i; at the optimum m for a candidate with weight, and less for others.
    log_det : float
        Certified bound, in the blocks' scale.
    gap : float
        max d_i / m - 1, by which det^(1/m) of the bound may exceed the optimum.
    """

    weights: Array
    sensitivity: Array
    log_det: float
    gap: float

    def efficiency(self, log_det: float, count: int) -> float:
        """Compute the efficiency of `count` poses from log det M, relative to the bound.

        It is (det(M / count) / det of the bound)^(1/m). Its square root is the ratio of the two O1.
        """
        m = self.sensitivity @ self.weights  # tr(M^-1 M)
        return float(np.exp((log_det - self.log_det) / m) / count)


def optimum(blocks: PoseRows, tolerance: float = TOLERANCE) -> Optimum:
    """Compute the continuous optimum to a gap of `tolerance`.

    It stops after a fixed number of steps; `gap` states the gap that was reached.
    """
    m = blocks.parameters
    left = np.arange(blocks.poses)
    few = blocks
    weights = np.full(blocks.poses, 1.0 / blocks.poses)
    for step in range(_STEPS):
        ratio = few.sensitivity(few.information(weights=weights)) / m
        gap = float(ratio.max()) - 1.0
        if gap < tolerance:
            break
        weights = weights * ratio**_POWER
        if step % _EVERY == 0:
            possible = ratio > 1.0 + gap / 2.0 - np.sqrt(gap * (4.0 + gap - 4.0 / m)) / 2.0
            left, weights, few = left[possible], weights[possible], few.take(possible)
        weights = weights / weights.sum()
    full = np.zeros(blocks.poses)
    full[left] = weights
    information = blocks.information(weights=full)
    sensitivity = blocks.sensitivity(information)
    excess = float(sensitivity.max()) / m
    log_det = float(np.linalg.slogdet(information)[1]) + m * float(np.log(excess))
    return Optimum(full, sensitivity, log_det, excess - 1.0)
