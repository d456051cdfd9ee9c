"""Selection of poses to measure: a D-optimal core, and poses that fill every joint's range.

The core is the exchange's selection. If it leaves out a part of a joint's range, candidates that fill the gap are fixed
in the list. The core then loses the poses that cost least, and is exchanged again around the fixed poses. At most a
fifth of the list is used for filling (`share`). The efficiency is given with and without filling. The list keeps the
order in which the candidates were drawn: a random order of visits.

**Observability indices.** O1 to O5 of a Jacobian describe how well poses determine parameters, in one number each.
With the singular values s_1 >= ... >= s_m of the Jacobian of n poses: O1 = (s_1 ... s_m)^(1/m) / sqrt(n),
O2 = s_m / s_1, O3 = s_m, O4 = s_m^2 / s_1, O5 = 1 / sum(1 / s_i). O1 ranks selections the same in any units of the
parameters. O2 to O5 do not, so their columns must be scaled.
Sources: Borm and Menq 1991 (O1), Driels and Pathre 1990 (O2), Nahvi et al. 1994 (O3), Nahvi and Hollerbach 1996
(O4), Sun and Hollerbach 2008 (O5), and Nubiola 2.5.2.

**Prior of the type.** With a prior of the robot's type (`calib.prior`) fewer poses suffice. The prior is information
that exists before the first pose: one row per parameter, 1 / spread^2. The poses are chosen without it, since a robot
that lies outside its type is known by its readings alone. They are then removed, the one that costs least first, until
the largest U with the prior is that of all of them without.

**Curve.** The uncertainty of predictions depends on the number of poses, and from some number on more poses bring
little. The selection is shortened repeatedly by the pose whose loss costs least, and lengthened by the candidate that
adds most. For every count U = 2 sqrt(largest eigenvalue of X C X' + R). Here C is the inverse information of the
poses so far, X the derivative of a target, and R its covariance from the repeatability of the robot. U (k = 2, along
the worst direction) describes where the robot will be if the model is complete. No calibration lowers R.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.array import Array
from calib.errors import DataError
from calib.fit.identification import expanded
from calib.fit.least_squares import DroppedParameter
from calib.fit.type_prior import TypePrior
from calib.selection import coverage
from calib.selection.exchange import (
    STARTS,
    Indices,
    best_of_starts,
    exchange,
    greedy,
    log_det,
    optimum,
    without_least,
)
from calib.selection.information import Candidates, Setup
from calib.selection.pose_rows import PoseRows
from calib.units import DEG, to_display, to_internal

STEP = 10  # poses
WORTH = 0.02  # share by which STEP more poses must lower the largest U
_BEYOND = 2.0  # end of the curve, as a multiple of the selection
_PLACES = 1000  # poses at which U is predicted


@dataclass(frozen=True)
class ObservabilityIndices:
    """Observability indices O1 to O5; larger is better for all."""

    o1: float
    o2: float
    o3: float
    o4: float
    o5: float


def observability(jacobian: Array, poses: int) -> ObservabilityIndices:
    """Compute the observability indices of a Jacobian.

    All are 0 if it does not determine the parameters.

    Parameters
    ----------
    jacobian : array of shape (rows, m)
        Jacobian of all poses, columns scaled for O2 to O5.
    poses : int
        Number of poses.

    Raises
    ------
    DataError
        There are fewer rows than columns, or a number is not finite.
    """
    rows, m = jacobian.shape
    if rows < m or m == 0:
        raise DataError(f"the Jacobian has {rows} rows for {m} parameters.", do="Give at least as many rows.")
    if not np.all(np.isfinite(jacobian)):
        raise DataError("the Jacobian has a number that is not finite.", do="Leave that pose out.")
    s = np.linalg.svd(jacobian, compute_uv=False)
    if s[-1] <= np.finfo(np.float64).eps * rows * s[0]:
        return ObservabilityIndices(0.0, 0.0, 0.0, 0.0, 0.0)
    return ObservabilityIndices(
        o1=float(np.exp(np.mean(np.log(s))) / np.sqrt(poses)),
        o2=float(s[-1] / s[0]),
        o3=float(s[-1]),
        o4=float(s[-1] ** 2 / s[0]),
        o5=float(1.0 / np.sum(1.0 / s)),
    )


SHARE = 0.2  # share of the poses that may be used for filling
OFF_AXIS_MM = 20.0  # a target nearer to the axis of the last joint hardly sees it turn
_HARDLY = 0.5  # share of a parameter's usual size


@dataclass(frozen=True)
class Choice:
    """Poses selected among N candidates.

    Attributes
    ----------
    selection : array of int, shape (n,)
        Indices of the poses, ascending.
    filling : tuple of int
        Indices of the poses that fill ranges.
    efficiency, efficiency_core : float
        Efficiency of the list, and of the core with as many poses and no filling, relative to the continuous bound.
    gap : float
        Gap of the bound, as in `Optimum`.
    std : array of shape (m,)
        Predicted standard errors of the parameters, internal units.
    """

    selection: Indices
    filling: tuple[int, ...]
    efficiency: float
    efficiency_core: float
    gap: float
    observability: ObservabilityIndices
    std: Array
    dropped: tuple[DroppedParameter, ...]
    warnings: tuple[str, ...]


def choose(
    setup: Setup,
    candidates: Candidates,
    count: int,
    *,
    share: float = SHARE,
    starts: int = STARTS,
    seed: int = 0,
) -> Choice:
    """Select `count` poses; the same seed gives the same list.

    Parameters
    ----------
    share : float, optional
        Largest part of the list that fills ranges; 0 for a D-optimal list.
    starts : int, optional
        Number of exchanges, of which the best is used.

    Raises
    ------
    DataError
        The share is not from 0 to 1, or `exchange.select` would refuse the candidates.
    """
    if not 0.0 <= share <= 1.0:
        raise DataError(f"is {share}.", do="Give a share from 0 to 1.", key="share")
    blocks = PoseRows.of(candidates.rows)
    best = optimum(blocks)
    core = best_of_starts(blocks, best, count, starts=starts, seed=seed)
    cells = coverage.cells_of(candidates.joints)
    selection, fixed = core, []
    # A pose that leaves for a filling one can leave another bin empty: repeat until nothing is missing.
    while (wanted := coverage.missing(cells, selection)).any():
        more = coverage.filling(cells, wanted, int(share * count) - len(fixed), best.sensitivity)
        if not more:
            break
        fixed += more
        shorter = without_least(blocks, np.union1d(selection, fixed), count, fixed=fixed)
        selection = exchange(blocks, shorter, fixed=fixed)
    rows = candidates.rows[selection].reshape(-1, candidates.rows.shape[-1])
    spread = np.sqrt(np.diag(np.linalg.inv(rows.T @ rows))) * candidates.unit
    return Choice(
        selection=selection,
        filling=tuple(sorted(fixed)),
        efficiency=best.efficiency(log_det(blocks, selection), count),
        efficiency_core=best.efficiency(log_det(blocks, core), count),
        gap=best.gap,
        observability=observability(rows, count),
        std=spread,
        dropped=candidates.dropped,
        warnings=(
            *_of_targets(setup),
            *_of_ranges(candidates, coverage.missing(cells, selection)),
            *_of_parameters(candidates, spread),
        ),
    )


def _of_targets(setup: Setup) -> list[str]:
    off = [name for name, (x, y, _) in setup.targets.items() if np.hypot(x, y) >= OFF_AXIS_MM]
    if len(off) >= 2:
        return []
    return [
        f"Of the targets measured ({', '.join(setup.targets)}) {f'only {off[0]}' if off else 'none'} lies"
        f" {OFF_AXIS_MM:g} mm or more off the axis of joint {setup.robot.joints}: measure two that do, or an offset"
        " of the tool and a tilt of it look the same."
    ]


def _of_ranges(candidates: Candidates, empty: coverage.Mask) -> list[str]:
    low, high = (edge / DEG for edge in (candidates.joints.min(axis=0), candidates.joints.max(axis=0)))
    return [
        f"Joint {k + 1} has no pose from {low[k] + b * width:.0f} to {low[k] + (b + 1) * width:.0f} deg."
        for k, b in np.argwhere(empty)
        for width in [(high[k] - low[k]) / empty.shape[1]]
    ]


def _of_parameters(candidates: Candidates, std: Array) -> list[str]:
    return [
        f"{p.name} will hardly be seen: a standard error of {to_display(s, p.unit):.2g} {p.unit} where"
        f" {p.size:g} {p.unit} is usual."
        for p, s in zip(candidates.parameters, std, strict=True)
        if p.size is not None and to_display(s, p.unit) > _HARDLY * p.size
    ]


@dataclass(frozen=True)
class Curve:
    """Uncertainty U against the number of poses; arrays of equal length, mm.

    Attributes
    ----------
    largest, mean : array
        Largest and mean U over the workspace.
    of_model : array
        Largest U without the repeatability.
    """

    counts: NDArray[np.int64]
    largest: Array
    mean: Array
    of_model: Array

    def at(self, count: int) -> float:
        """Return the largest U with `count` poses, mm.

        Raises
        ------
        ValueError
            The count is not on the curve.
        """
        return float(self.largest[self.counts.tolist().index(count)])

    def enough(self, worth: float = WORTH) -> int | None:
        """Return the first count after which a step lowers the largest U by less than `worth`.

        None if it is beyond the curve.
        """
        gain = 1.0 - self.largest[1:] / self.largest[:-1]
        return next((int(n) for n, g in zip(self.counts, gain, strict=False) if g < worth), None)

    def reaches(self, wanted: float) -> int | None:
        """Return the first count whose largest U is at most `wanted`, mm; None beyond the curve."""
        return next((int(n) for n, u in zip(self.counts, self.largest, strict=True) if u <= wanted), None)


def curve_of(
    candidates: Candidates,
    selection: Indices,
    step: int = STEP,
    prior: Array | None = None,
    beyond: float = _BEYOND,
) -> Curve:
    """Compute the curve around a selection.

    Parameters
    ----------
    selection : array of int
        Poses at the centre of the curve.
    step : int, optional
        Difference of two counts. The counts include that of the selection, and begin near the smallest sufficient one.
    prior : array of shape (m,), optional
        Information on every parameter from robots of the type, in units of the columns.
    beyond : float, optional
        End of the curve, as a multiple of the selection.
    """
    blocks = PoseRows.of(candidates.rows)
    least = -(-blocks.parameters // blocks.width) + 1
    count = len(selection)
    below = range(count, least - 1, -step)
    above = range(count + step, min(int(beyond * count), blocks.poses) + 1, step)
    designs = {count: selection}
    for n in below[1:]:
        designs[n] = without_least(blocks, designs[n + step], n)
    for n in above:
        designs[n] = greedy(blocks, designs[n - step], n)
    places = slice(0, _PLACES)  # candidates come in random order
    points, repeatability = candidates.points[places], candidates.repeatability[places].reshape(-1, 3, 3)
    points = points.reshape(-1, 3, points.shape[-1])
    counts = np.array(sorted(designs), dtype=np.int64)
    largest, mean, of_model = np.zeros((3, len(counts)))
    for i, n in enumerate(counts):
        rows = candidates.rows[designs[int(n)]]
        rows = rows.reshape(-1, rows.shape[-1])
        information = rows.T @ rows + (0.0 if prior is None else np.diag(prior))
        spread = points @ np.linalg.inv(np.linalg.cholesky(information)).T
        of_parameters = spread @ spread.transpose(0, 2, 1)
        u = expanded(of_parameters + repeatability)
        largest[i], mean[i], of_model[i] = u.max(), u.mean(), expanded(of_parameters).max()
    return Curve(counts, largest, mean, of_model)


@dataclass(frozen=True)
class BesideType:
    """Curve with the prior of the type, and the number of poses that the prior saves.

    Attributes
    ----------
    count : int
        Number of poses without the prior.
    u_mm : float
        Largest U of these, mm.
    reached : int or None
        Number of poses that reach this U with the prior; None if the prior saves none.
    known : tuple of str
        Parameters for which the type has a prior.
    """

    curve: Curve
    count: int
    u_mm: float
    reached: int | None
    known: tuple[str, ...]

    @property
    def in_words(self) -> str:
        """Number of poses as a sentence."""
        if self.reached is None or self.reached >= self.count:
            return f"With the prior the U of {self.count} poses still takes {self.count} of them."
        return (
            f"{self.reached} of {self.count} poses reach, with the prior, the largest U of {self.count} without it "
            f"({self.u_mm:.4f} mm)."
        )


def information_of(candidates: Candidates, prior: TypePrior) -> Array:
    """Compute the information (m,) of the type prior on every parameter.

    It is in units of the candidates' columns, and 0 for a parameter without a prior.
    """
    return np.array(
        [
            (unit / to_internal(prior.shares[p.name].spread, p.unit)) ** 2
            if p.name in prior.shares and prior.shares[p.name].unit == p.unit
            else 0.0
            for p, unit in zip(candidates.parameters, candidates.unit, strict=True)
        ]
    )


def beside_type(candidates: Candidates, selection: Indices, without: Curve, prior: TypePrior) -> BesideType:
    """Compute how many poses of a selection the prior of a type saves."""
    known = information_of(candidates, prior)
    count = len(selection)
    wanted = without.at(count)
    fine = curve_of(candidates, selection, 1, known, beyond=1.0)
    curve = curve_of(candidates, selection, prior=known)
    names = tuple(p.name for p, k in zip(candidates.parameters, known, strict=True) if k > 0.0)
    return BesideType(curve, count, wanted, fine.reaches(wanted), names)
