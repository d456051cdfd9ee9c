"""The number of poses that suffices with the prior of the robot's type.

What the type shares (`calib.prior`) is information that is there before the first pose: one row a parameter, 1 /
spread^2. The poses are chosen without it, since a robot that lies outside its type is known by its readings alone; they
are then taken away, the one that costs least first, until the largest U with the prior is that of all of them without.

The uncertainty of predictions against the number of poses, and the number from which more poses bring little.

The selection is shortened by the pose whose loss costs least, again and again, and lengthened by the candidate that
adds most; for every count U = 2 sqrt(largest eigenvalue of X C X' + R): C the inverse information of the poses so
far, X the derivative of a target, R its covariance by the repeatability of the robot. U (k = 2, along the worst
direction) is where the robot will be by a model that is complete; R is what no calibration lowers.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.array import Array
from calib.fit.of_type import TypePrior
from calib.fit.uncertainty import expanded
from calib.selection.exchange import Indices, greedy, without_least
from calib.selection.information import Candidates
from calib.selection.pose_rows import PoseRows
from calib.units import to_internal

STEP = 10  # poses

WORTH = 0.02  # share by which STEP more poses must lower the largest U

_BEYOND = 2.0  # the curve ends at so many times the selection

_PLACES = 1000  # poses at which U is predicted


@dataclass(frozen=True)
class Curve:
    """U against the number of poses; arrays of equal length, mm.

    largest, mean: U over the workspace; of_model: the largest without the repeatability.
    """

    counts: NDArray[np.int64]
    largest: Array
    mean: Array
    of_model: Array

    def at(self, count: int) -> float:
        """The largest U with so many poses, mm. Raises ValueError for a count that is not on the curve."""
        return float(self.largest[self.counts.tolist().index(count)])

    def enough(self, worth: float = WORTH) -> int | None:
        """The first count after which one step lowers the largest U by less than `worth`; None beyond the curve."""
        gain = 1.0 - self.largest[1:] / self.largest[:-1]
        return next((int(n) for n, g in zip(self.counts, gain, strict=False) if g < worth), None)

    def reaches(self, wanted: float) -> int | None:
        """The first count whose largest U is at most `wanted`, mm; None beyond the curve."""
        return next((int(n) for n, u in zip(self.counts, self.largest, strict=True) if u <= wanted), None)


def curve_of(
    candidates: Candidates,
    selection: Indices,
    step: int = STEP,
    prior: Array | None = None,
    beyond: float = _BEYOND,
) -> Curve:
    """The curve around a selection: counts `step` apart through its own, from just enough to `beyond` times as many.

    prior: (m,) information that robots of the type bring on every parameter, in units of the columns
    (`calib.selection.fewer`).
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
    """The curve with the prior, and the number of poses that reach with it the largest U of `count` without; mm.

    reached: None where the prior makes it no fewer. known: parameters of the model that the type says something of.
    """

    curve: Curve
    count: int
    u_mm: float
    reached: int | None
    known: tuple[str, ...]

    @property
    def in_words(self) -> str:
        """The number in a sentence."""
        if self.reached is None or self.reached >= self.count:
            return f"With the prior the U of {self.count} poses still takes {self.count} of them."
        return (
            f"{self.reached} of {self.count} poses reach, with the prior, the largest U of {self.count} without it "
            f"({self.u_mm:.4f} mm)."
        )


def information_of(candidates: Candidates, prior: TypePrior) -> Array:
    """(m,) information on every parameter of the candidates, in units of their columns; 0 where the type has no
    prior."""
    return np.array(
        [
            (unit / to_internal(prior.shares[p.name].spread, p.unit)) ** 2
            if p.name in prior.shares and prior.shares[p.name].unit == p.unit
            else 0.0
            for p, unit in zip(candidates.parameters, candidates.unit, strict=True)
        ]
    )


def beside_type(candidates: Candidates, selection: Indices, without: Curve, prior: TypePrior) -> BesideType:
    """The poses that the prior of a type saves of a selection whose curve without it is known."""
    known = information_of(candidates, prior)
    count = len(selection)
    wanted = without.at(count)
    fine = curve_of(candidates, selection, 1, known, beyond=1.0)
    curve = curve_of(candidates, selection, prior=known)
    names = tuple(p.name for p, k in zip(candidates.parameters, known, strict=True) if k > 0.0)
    return BesideType(curve, count, wanted, fine.reaches(wanted), names)
