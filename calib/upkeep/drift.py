"""The method of the control chart: the next check is due before drift and scatter together leave what is permitted.

A straight line through the values, weighted by their uncertainty, predicts later ones:

    y(x) = a + b x,    u(x)^2 = [1 x] C [1 x]' + between^2,

with C the covariance of a and b, and between^2 what the values scatter about the line beyond their own u. Due is the
x at which |y(x) - target| + 2 u(x) reaches the permitted error. That sum is convex in x, so it is reached once.

Source: ILAC-G24:2022 / OIML D 10:2022, 6.3 (drift and dispersion from the plot, the interval from both); the line is
that of a weighted least squares.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import root_scalar

from calib.array import Array
from calib.errors import DataError
from calib.upkeep.check import Step, Unit
from calib.upkeep.staircase import refuse_intervals, refuse_permitted


@dataclass(frozen=True)
class Drift:
    """first: interval until two checks say how fast the value drifts; permitted: largest error from `target`, in the
    unit of the values; shortest, longest: intervals. Intervals are days, or hours of use inside `InUse`.

    Raises DataError for values that make no method.
    """

    first: float
    permitted: float
    target: float = 0.0
    shortest: float = 7.0
    longest: float = 1825.0

    def __post_init__(self) -> None:
        refuse_intervals(self.first, self.shortest, self.longest)
        refuse_permitted(self.permitted)

    def interval(self, steps: Sequence[Step], unit: Unit) -> tuple[float, str]:
        """Interval after the last of some steps, oldest first, and why, without an end. Raises DataError for values
        without any uncertainty of which there are two."""
        last = steps[-1]
        if len({step.x for step in steps}) < 2:
            return self.first, f"one check shows no drift: the interval is the first, {unit.of(self.first)}"
        x = np.array([step.x for step in steps]) - last.x
        line, covariance, between = _line(
            x, np.array([s.value for s in steps]), np.array([s.u / 2.0 for s in steps])
        )

        def room(ahead: float) -> float:
            at = np.array([1.0, ahead])
            u = np.sqrt(at @ covariance @ at + between)
            return self.permitted - abs(float(line @ at) - self.target) - 2.0 * float(u)

        told = f"the value drifts by {line[1]:+.2g} (U {2.0 * np.sqrt(covariance[1, 1]):.1g}) per {unit.one}"
        if room(0.0) <= 0.0:
            return (
                self.shortest,
                f"{told} and may be beyond the {self.permitted:g} permitted already: {unit.of(self.shortest)}",
            )
        if room(self.longest) > 0.0:
            return (
                self.longest,
                f"{told} and stays within the {self.permitted:g} permitted: the longest, {unit.of(self.longest)}",
            )
        reached = float(root_scalar(room, bracket=(0.0, self.longest)).root)
        interval = max(reached, self.shortest)
        return interval, (
            f"{told} and may reach the {self.permitted:g} permitted {unit.of(reached)} after the last check"
        )


def _line(x: Array, values: Array, u: Array) -> tuple[Array, Array, float]:
    """Line (a, b) through values (n,) with standard uncertainties u (n,), its covariance, and the variance between
    values beyond u: of the residuals over their freedom. Raises DataError where nothing says how sure they are."""
    design = np.column_stack([np.ones_like(x), x])
    freedom = len(x) - 2
    left = values - design @ np.linalg.lstsq(design, values, rcond=None)[0]
    between = max(float(left @ left) / freedom - float(np.mean(u**2)), 0.0) if freedom else 0.0
    variance = between + u**2
    if np.any(variance <= 0.0):
        raise DataError("is 0, and nothing else says how sure the values are.", do="Give U.", key="u")
    weighed = design / np.sqrt(variance)[:, None]
    covariance: Array = np.asarray(np.linalg.inv(weighed.T @ weighed), dtype=np.float64)
    return covariance @ weighed.T @ (values / np.sqrt(variance)), covariance, between
