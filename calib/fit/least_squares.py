"""Gauss-Newton on the exact chain, with priors, weights and named rank deficiency.

minimise  sum_i w_i |W_i (measured_i - predicted_i(x))|^2  +  s^2 sum_j ((x_j - mean_j) / size_j)^2
          +  s^2 sum_k t_k(x)^2

w_i is a weight per reading. mean_j is zero, nominal, unless robots of the type share another
(`calib.fit.type_prior`); t_k are the distances between balls of one body (`calib.model.model`),
measurements like a declared position.

s is the noise scale. If the readings are noisier than declared, the prior counts for more against them.
If they are better than declared, it counts for less, so that readings without noise come back as they
are. A prior that is a measurement, of a base target, keeps its weight relative to the declared noise. A
parameter that takes the place of others, which the readings cannot distinguish from it, has their sizes
added to its own (`usual_sizes`).

Steps are solved on scaled columns; a step that does not lower the cost is damped.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import get_lapack_funcs

from calib.arm.kinematics import Frames
from calib.array import Array
from calib.data.conditions import row_keys
from calib.fit.ending import FitTermination
from calib.model.model import BoundModel, ModelStructure, ties
from calib.model.observations import Observations

MAX_ITERATIONS = 50
CONVERGED = 0.02  # length of a step in standard errors of the estimate
LEAST_NOISE = 0.01  # of the declared noise: below it the prior weakens no further
_MOVES_NOTHING = 1e-6  # whitened displacement, over all readings, for a parameter of its usual size
_STRAINED = 10.0  # usual sizes by which a parameter may move to make up for the usual size of another
_IRRELEVANT, _ROW = (
    1e-4,
    0.1,
)  # of the cost, or of that of one row: a damped step that lowers it by less is the last
_DAMPING = -10, 5  # powers of ten, of the square of a column
_DEPENDENT = 1e-7  # share of a column left when those before it are projected out


@dataclass(frozen=True)
class DroppedParameter:
    """A parameter that the readings cannot determine, and those with which it is confounded.

    `stand_ins` are the parameters that take its place, and how far each moves for one unit of it, in
    internal units.
    """

    name: str
    confounded_with: tuple[str, ...]
    stand_ins: tuple[tuple[str, float], ...] = ()


class Linearisation:
    """Readings as a model sees them at an estimate (m,).

    Chain, residual and derivative are each computed once.
    """

    def __init__(
        self, design: BoundModel, observed: Observations, estimate: Array, passed: Frames | None = None
    ) -> None:
        """Bind a model to observations at an estimate.

        `passed` is the chain at the estimate, with the axes of the design's slots, if it is already known.
        """
        self.design, self.observed, self.estimate, self._passed = design, observed, estimate, passed

    @cached_property
    def frames(self) -> Frames:
        """The chain, with the axes of every slot on which a parameter acts."""
        if self._passed is not None:
            return self._passed
        return self.design.frames(self.estimate, self.design.slots)

    @cached_property
    def residual(self) -> Array:
        """Whitened residual, shape (k, n)."""
        return self.observed.residual(self.frames)

    @cached_property
    def columns(self) -> Array:
        """Whitened derivative of the prediction, shape (k n, m)."""
        return jacobian(self.design, self.observed, self.frames)

    @cached_property
    def tied(self) -> tuple[Array, Array]:
        """Distances between balls of one body: whitened residual (q,) and its derivative (q, m)."""
        return ties(self.design.model, self.estimate)


@dataclass(frozen=True)
class Solution:
    """The end of Gauss-Newton. Arrays of m parameters; covariances are for noise as declared (scale 1)."""

    at: Linearisation
    active: NDArray[np.bool_]  # (m,)
    triangle: Array  # (active, active) R with R'R the normal matrix, in units of `size`
    size: Array  # (active,)
    columns: Array  # (k n, active) whitened, weighted Jacobian of the last step
    prior: Array  # (m,) weight of the prior of every parameter, 0 where there is none
    tied: Array  # (q, m) weighted derivative of the distances between balls of one body
    iterations: int
    ending: FitTermination

    @property
    def estimate(self) -> Array:
        """Parameter values, shape (m,), internal units."""
        return self.at.estimate

    @property
    def residual(self) -> Array:
        """Whitened, unweighted residual, shape (k, n)."""
        return self.at.residual

    @cached_property
    def root(self) -> Array:
        """Root of the covariance: a matrix whose product with its transpose is the covariance.

        Its shape is (active, active).
        """
        return _back(self.triangle, np.eye(len(self.size))) / self.size[:, None]

    @cached_property
    def covariance(self) -> Array:
        """Covariance of the estimate, shape (m, m); 0 for parameters that were not fitted."""
        out = np.zeros((len(self.active), len(self.active)))
        out[np.ix_(self.active, self.active)] = self.root @ self.root.T
        return out

    @property
    def given(self) -> float:
        """Number of parameters that priors and ball distances determine instead of the readings."""
        share = np.diag(self.covariance) * self.prior**2
        return float(share.sum() + np.sum((self.tied @ self.covariance) * self.tied))

    def standardised(self) -> Array:
        """Compute the standardised lengths of the residuals, shape (n,).

        They hold for noise as declared, in the metric of each residual's spread, I - H, where H is the
        reading's block of the hat matrix. A fit pulls itself to its readings, most to those that lie
        alone. Each length is chi distributed with as many degrees of freedom as the reading has rows.
        """
        k, n = self.residual.shape
        hat = (self.columns @ self.root).reshape(k, n, -1).transpose(1, 0, 2)
        left = np.eye(k) - hat @ hat.transpose(0, 2, 1)
        solved = np.linalg.solve(left, self.residual.T[:, :, None])[:, :, 0]
        return np.sqrt(np.maximum(np.sum(self.residual.T * solved, axis=1), 0.0))


def jacobian(design: BoundModel, observed: Observations, frames: Frames) -> Array:
    """Compute the whitened derivative of the prediction, shape (k n, m)."""
    columns = design.columns(observed.columns(frames, design.slots))
    if observed.shared is None:
        return columns
    by_visit = observed.by_visit(columns.T.reshape(-1, *observed.whiten.shape[1:]))
    return by_visit.reshape(len(by_visit), -1).T


def triangular_factor(matrix: Array) -> Array:
    """Compute the factor R of a matrix (rows, m) = QR, shape (min(rows, m), m).

    Householder reflections make it safe for dependent columns.
    """
    rows, m = matrix.shape
    return np.triu(_GEQRF(matrix)[0][: min(rows, m)])


def orthonormal(matrix: Array) -> tuple[Array, Array]:
    """Q (rows, m) and R (m, m) of a tall matrix, columns of about equal length.

    Cholesky of the Gram matrix, twice: as accurate as Householder up to a condition number of 10^7 and several
    times faster, since all work is matrix products. Beyond it, Householder. Source: Yamamoto et al. 2015.
    """
    try:
        first = np.linalg.cholesky(matrix.T @ matrix).T
        q = matrix @ np.linalg.inv(first)
        second = np.linalg.cholesky(q.T @ q).T
    except np.linalg.LinAlgError:
        q, r = np.linalg.qr(matrix)
        return q, r
    return q @ np.linalg.inv(second), second @ first


def _normal_factor(gram: Array, columns: Array, tied: Array, prior: Array, size: Array) -> Array:
    """Compute R (m, m) with R'R = gram, scaled by `size`.

    An error in R only slows Gauss-Newton, which uses the true residual. If rounding makes gram
    indefinite, R comes from reflections of the columns, ties and priors from which gram was computed.
    """
    try:
        return np.asarray(np.linalg.cholesky(gram).T, dtype=np.float64)
    except np.linalg.LinAlgError:
        return triangular_factor(np.vstack([columns / size, tied / size, np.diag(prior / size)]))


def find_dependent(
    start: Linearisation, settled: tuple[DroppedParameter, ...] | None = None
) -> tuple[NDArray[np.bool_], tuple[DroppedParameter, ...]]:
    """Find the parameters that the readings determine: mask (m,), and the dropped ones by name.

    A column that those before it explain to one part in 10^7 is dropped. Base and tool are examined
    first. Of a confounded group they stay, and then the parameters that come first in the model. There
    is one exception. If a parameter would have to move by ten times its usual size to make up for the
    usual size of another, that other one is kept. This is the exchange of a strong rank-revealing QR (Gu
    and Eisenstat 1996).

    A prior that is a measurement (base targets known to 0.05 mm) counts as one: the readings and it
    together determine the parameters. The same holds for every usual size if different readings have
    fewer numbers than the model has parameters. A parameter dropped then would be no redundancy of the
    arm, and an arm that is fixed to nominal there fits nothing.

    With `settled`, the decisions for the base model are kept, and only the parameters of effects are
    examined.
    """
    model = start.design.model
    parameters = model.parameters
    names = [p.name for p in parameters]
    of_base = [e.group == "base model" for e in model.effects for _ in e.parameters]
    before = {} if settled is None else {drop.name: drop for drop in settled}
    columns, held = start.columns, model.measured
    if not _enough_numbers(start, len(parameters)):
        held = held | np.isfinite(model.prior_std)
    if held.any():
        columns = np.vstack([columns, np.diag(1.0 / model.prior_std)[held]])
    if model.spans:
        columns = np.vstack([columns, start.tied[1]])
    scale = np.linalg.norm(columns, axis=0)
    usual = np.where(np.isfinite(model.prior_std), model.prior_std, model.unit)
    seen = scale * usual > _MOVES_NOTHING
    # Parameters without a usual size (base, tool) first: among confounded ones those with a size are dropped, since
    # their nominal value is a good guess of them and a rough start is not.
    order = sorted(range(len(names)), key=lambda j: parameters[j].size is not None)
    settled_ones = {j for j in order if settled is not None and of_base[j] and names[j] not in before}
    dropped = {j: before[names[j]] for j in order if of_base[j] and names[j] in before}
    dropped |= {j: DroppedParameter(names[j], ()) for j in order if not seen[j] and j not in dropped}
    kept = [j for j in order if j not in dropped]
    may_go = np.isfinite(model.prior_std) & ~model.measured
    may_go[list(settled_ones)] = False
    # Whitened displacement for the usual size of those that may be given up
    reach = np.full(len(names), np.inf)
    reach[may_go] = scale[may_go] * model.prior_std[may_go]
    whole, place = triangular_factor(columns[:, kept] / scale[kept]), {j: i for i, j in enumerate(kept)}
    triangle, gone = whole, list[int]()
    while (at := _first_dependent(triangle, [j in settled_ones for j in kept])) is not None:
        share = np.abs(_shares(triangle[:at, :at], triangle[:at, at]))
        # how far, in its usual sizes, each of them would have to go for the usual size of this one
        strain = share * reach[kept[at]] / reach[kept[:at]] if may_go[kept[at]] else 0.0 * share
        out = int(np.argmax(strain)) if np.max(strain, initial=0.0) > _STRAINED else at
        triangle = _without(triangle, out)
        gone.append(kept.pop(out))
    if gone:
        both = triangular_factor(whole[:, [place[j] for j in (*kept, *gone)]])
        shares = _shares(both[: len(kept), : len(kept)], both[: len(kept), len(kept) :])
        for j, share in zip(gone, shares.T, strict=True):
            weight = np.abs(share)
            heaviest = np.argsort(-weight)[:6]
            heavy = heaviest[weight[heaviest] > 0.05 * weight.max()]
            moves = share * scale[j] / scale[kept]
            dropped[j] = DroppedParameter(
                names[j],
                tuple(names[kept[i]] for i in heavy),
                tuple((names[kept[i]], float(moves[i])) for i in np.flatnonzero(weight > _DEPENDENT)),
            )
    active = np.zeros(len(names), dtype=bool)
    active[kept] = True
    return active, tuple(dropped[j] for j in order if j in dropped)


def _without(triangle: Array, out: int) -> Array:
    """Compute the factor R of the columns of R (m, m) without one of them.

    The rows above that column stay, those behind are factored again.
    """
    left = np.concatenate((triangle[:, :out], triangle[:, out + 1 :]), axis=1)
    if out == left.shape[1]:
        return left[:out]
    behind = triangular_factor(left[out:, out:])
    left[out : out + len(behind), out:] = behind
    return left[: min(left.shape)]


def _enough_numbers(at: Linearisation, count: int) -> bool:
    """Test whether different readings have at least `count` numbers.

    Readings differ in their poses, targets, base targets or series.
    """
    c, freedom = at.design.conditions, at.observed.freedom
    if (int(c.pose.max()) + 1) * int(freedom.min()) >= count:  # different poses alone have
        return True
    places = row_keys(np.column_stack([c.joints, c.target, c.anchor, c.series]).astype(np.float64))
    first: dict[bytes, int] = {}
    for place, rows in zip(places, freedom.tolist(), strict=True):
        first.setdefault(place, rows)
    return sum(first.values()) >= count


def _shares(before: Array, column: Array) -> Array:
    """Compute how much of each earlier column explains a column, shape (a,).

    For b columns the shape is (a, b). The earlier columns may be dependent among themselves.
    """
    if np.all(np.abs(np.diag(before)) >= _DEPENDENT):
        return _back(before, column)
    return np.asarray(np.linalg.lstsq(before, column, rcond=None)[0], dtype=np.float64)


def _first_dependent(triangle: Array, kept: list[bool]) -> int | None:
    """Find the first column of R (m, m) that earlier columns explain; None if there is none.

    The columns have length 1. The remainder of a column is on the diagonal. Columns that are `kept` are
    never dropped; behind one that is explained, the diagonal may be smaller than the remainder.
    """
    left = np.zeros(triangle.shape[1])
    left[: min(triangle.shape)] = np.abs(np.diag(triangle))
    for j in np.flatnonzero(left < _DEPENDENT):
        if not kept[j]:
            return int(j)
    return None


def usual_sizes(model: ModelStructure, dropped: Sequence[DroppedParameter]) -> Array:
    """Compute the standard deviations of the parameters' priors, shape (m,), internal units.

    They are infinite without a prior. A parameter is fitted to its own error and to that of all dropped
    ones for which it makes up, so their variances add up. A prior that is a measurement does not change.
    """
    variance = model.prior_std**2
    for drop in dropped:
        for name, move in drop.stand_ins:
            if move != 0.0 and not model.measured[model.index[name]]:
                variance[model.index[name]] += (move * model.prior_std[model.index[drop.name]]) ** 2
    return np.sqrt(variance)


def solve(
    start: Linearisation,
    active: NDArray[np.bool_],
    dropped: Sequence[DroppedParameter] = (),
    *,
    weights: Array | None = None,
    scale: float = 1.0,
    max_iterations: int = MAX_ITERATIONS,
    tolerance: float = CONVERGED,
) -> Solution:
    """Minimise from a start over the `active` parameters (m,).

    A solution that did not converge says so.

    Parameters
    ----------
    start : Linearisation
        Readings as the model sees them at the start.
    active : array of bool, shape (m,)
        Parameters to solve for.
    dropped : sequence of DroppedParameter, optional
        Parameters that the readings cannot determine, for which others make up.
    weights : array of shape (n,), optional
        Weight of each reading. Default: 1.
    scale : float, optional
        Noise scale s for the prior.
    max_iterations : int, optional
        Most iterations.
    tolerance : float, optional
        Length of the last step, in standard errors of the estimate.
    """
    root = None if weights is None else np.sqrt(weights)
    model = start.design.model
    weight = np.where(model.measured, max(scale, 1.0), max(scale, LEAST_NOISE))
    prior = np.where(active, weight / usual_sizes(model, dropped), 0.0)
    held, mean = prior[active], model.prior_mean
    worth = max(
        scale, 1.0
    )  # of a distance between balls: it keeps its worth as a prior that is a measurement does
    at, cost = start, _cost(start, root, prior, mean, worth)
    iterations, ending = 0, FitTermination.ROUNDS
    small = tolerance * max(scale, 1.0)
    triangle, size = np.eye(len(held)), np.ones(len(held))
    damped: int | None = None  # power of ten of the damping that the last step needed
    power: int | None = None
    columns = np.zeros((at.residual.size, len(held)))
    while iterations < max_iterations and ending is FitTermination.ROUNDS:
        iterations += 1
        columns, weighted = at.columns, at.residual
        if not active.all():
            columns = columns[:, active]
        if root is not None:
            columns, weighted = columns * np.tile(root, len(weighted))[:, None], weighted * root
        left, tied = worth * at.tied[0], worth * at.tied[1][:, active]
        gram = columns.T @ columns + tied.T @ tied
        gram.ravel()[:: len(gram) + 1] += held**2
        size = np.sqrt(gram.diagonal())
        triangle = _normal_factor(gram / (size[:, None] * size), columns, tied, held, size)
        right = (columns.T @ weighted.ravel() - held**2 * (at.estimate - mean)[active] + tied.T @ left) / size
        scaled = _back(triangle, _back(triangle, right, 1))
        change = float(np.linalg.norm(triangle @ scaled))
        for tried in _steps(scaled, triangle, right, damped if change > max(scale, 1.0) else None):
            power, trial_step = tried
            trial = at.estimate.copy()
            trial[active] += trial_step / size
            there = Linearisation(start.design, start.observed, trial)
            cost_there = _cost(there, root, prior, mean, worth)
            # what a step so small promises drowns in the rounding of the cost, which then cannot judge it
            if cost_there <= cost * (1.0 + 1e-12) or change < small or change**2 < 1e-12 * cost:
                break
        else:
            ending = FitTermination.NO_DESCENT
            break
        # A flat direction, of which the readings say nothing, may be followed without end: only the cost counts there.
        damped = None if power is None else max(power - 1, _DAMPING[0])
        settled = damped is not None and cost - cost_there < max(
            _IRRELEVANT * cost, 0.1 * max(scale, 1.0) ** 2
        )
        at, cost = there, cost_there
        if change < small or settled:
            ending = FitTermination.CONVERGED
    return Solution(at, active, triangle, size, columns, prior, worth * at.tied[1], iterations, ending)


def _steps(
    scaled: Array, triangle: Array, right: Array, damped: int | None
) -> Iterator[tuple[int | None, Array]]:
    """Yield the Gauss-Newton step on scaled columns, then damped steps, each shorter.

    Each comes with the power of ten of its damping, or None. If damping was needed before, only damped
    steps are yielded.

    A nearly flat direction makes the Gauss-Newton step so long that the chain is no longer linear along
    it, and a fraction of it is too short everywhere else. Damping (R'R + m I, columns of length 1)
    leaves flat directions alone. Source: Marquardt 1963.
    """
    if damped is None:
        yield None, scaled
    values, axes = np.linalg.eigh(triangle.T @ triangle)
    along = axes.T @ right
    least = max(
        _DAMPING[0], math.floor(math.log10(max(float(values[0]), 1e-300)))
    )  # below it nothing is damped
    for power in range(least if damped is None else damped, _DAMPING[1]):
        yield power, axes @ (along / (np.maximum(values, 0.0) + 10.0**power))


_TRTRS, _GEQRF = get_lapack_funcs(("trtrs", "geqrf"), dtype=np.float64)


def _back(triangle: Array, right: Array, trans: int = 0) -> Array:
    """Solve R x = right, or R' x = right.

    Raises
    ------
    LinAlgError
        R is singular.
    """
    if not triangle.size:  # nothing is free, as if base and tool are known and nothing more is requested
        return right
    found, singular = _TRTRS(triangle, right, trans=trans)
    if singular:
        raise np.linalg.LinAlgError("a triangular factor is singular")
    return found


def _cost(at: Linearisation, root: Array | None, prior: Array, mean: Array, worth: float) -> float:
    weighted = (at.residual if root is None else at.residual * root).ravel()
    strained, tied = prior * (at.estimate - mean), worth * at.tied[0]
    return float(weighted @ weighted + strained @ strained + tied @ tied)
