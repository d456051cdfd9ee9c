"""The number of poses that suffices with the prior of the robot's type.

What the type shares (`calib.prior`) is information that is there before the first pose: one row a parameter, 1 /
spread^2. The poses are chosen without it, since a robot that lies outside its type is known by its readings alone; they
are then taken away, the one that costs least first, until the largest U with the prior is that of all of them without.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.array import Array
from calib.fit.of_type import TypePrior
from calib.selection.curve import Curve, curve_of
from calib.selection.exchange import Indices
from calib.selection.information import Candidates
from calib.units import to_internal


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
