"""Cause of a change: its size, fitted through the exact chain, and its sentences."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from calib.array import Array
from calib.effects import kind_of
from calib.model.effect import Effect
from calib.units import to_display, to_internal
from calib.watch.whitened_readings import WhitenedReadings

_STEPS = 10
_NEAR = 0.01  # standard errors that a last step may move
_SHOWN = 0.1  # least share of the readings in the information on a parameter


@dataclass(frozen=True)
class Size:
    """Size of a change: value and expanded uncertainty U (k = 2) in `unit`."""

    value: float
    u: float
    unit: str

    def __str__(self) -> str:
        digits = 3 if self.u <= 0.0 else max(0, 1 - int(np.floor(np.log10(self.u))))
        return f"{self.value:.{digits}f} {self.unit} (U {self.u:.{digits}f})"


@dataclass(frozen=True)
class Cause:
    """Cause of a change, fitted to readings.

    Attributes
    ----------
    values : array of shape (p,)
        Parameter values, internal units.
    covariance : array of shape (p, p)
        Covariance of the values.
    left : array of shape (q,)
        Whitened residual that the cause does not explain.
    gain : float
        Reduction of the sum of squares.
    evidence : float
        Logarithm of the Bayes factor.
    size : Size
        Size for display.
    """

    effect: Effect
    values: Array
    covariance: Array
    left: Array
    gain: float
    evidence: float
    size: Size

    @property
    def label(self) -> str:
        """Label of the effect."""
        return self.effect.label

    @property
    def changed(self) -> str:
        """Sentence that describes the change."""
        return kind_of(self.label).changed_of(self.label, str(self.size))

    @property
    def remedy(self) -> str:
        """Remedy for the cause, with its size but without the uncertainty."""
        digits = str(self.size).partition(" (")[0]
        return kind_of(self.label).remedy_of(self.label, digits)


def fitted(seen: WhitenedReadings, effect: Effect, whiten: Array, mean: Array | None = None) -> Cause:
    """Fit a cause to the whitened readings, with its usual sizes as a weak prior.

    The usual size of a lone parameter decides how likely it is, but not how large. Otherwise a scale that is usually
    within 10 ppm and is now 60 ppm would be reported as 35 ppm, with a U that does not reach the truth.

    A cause that shifts and turns is as likely to have shifted only. Its values are the mean of both fits, weighted by
    their evidence: turns that are only noise would move the robot where nothing was measured.

    Parameters
    ----------
    whiten : array of shape (q, q)
        Whitening matrix, from `WhitenedReadings.spread`.
    mean : array of shape (q,), optional
        Mean residual of several watches, whitened by noise only. It is small, so the derivative explains it instead of
        the exact chain.
    """
    units = np.array([p.unit for p in effect.parameters])
    whole = _fit(seen, effect, whiten, mean, units != "")
    if len(units) == 1:
        return _freed(seen, whole, whiten, mean)
    if np.all(units == units[0]):
        return whole
    shifted = _fit(seen, effect, whiten, mean, units == units[0])
    share = float(expit(shifted.evidence - whole.evidence))
    apart = shifted.values - whole.values
    values = whole.values + share * apart
    covariance = (
        share * shifted.covariance
        + (1.0 - share) * whole.covariance
        + share * (1.0 - share) * np.outer(apart, apart)
    )
    return replace(
        whole, values=values, covariance=covariance, size=size_of(seen, effect, values, covariance)
    )


def _freed(seen: WhitenedReadings, cause: Cause, whiten: Array, mean: Array | None) -> Cause:
    """Remove the pull of the usual size from a cause with one parameter; keep gain and evidence."""
    p = cause.effect.parameters[0]
    kept = 1.0 - cause.covariance[0, 0] / to_internal(p.size or 1.0, p.unit) ** 2
    if kept < _SHOWN:  # no reading shows it
        return cause
    values, covariance = cause.values / kept, cause.covariance / kept
    columns = whiten @ seen.columns[seen.causes.index(cause.effect)]
    left = (
        whiten @ seen.exact(cause.effect, values)
        if mean is None
        else cause.left + columns @ (cause.values - values)
    )
    size = size_of(seen, cause.effect, values, covariance)
    return replace(cause, values=values, covariance=covariance, left=left, size=size)


def _fit(
    seen: WhitenedReadings, effect: Effect, whiten: Array, mean: Array | None, free: NDArray[np.bool_]
) -> Cause:
    """Fit a cause with the parameters that `free` (p,) marks; the others stay zero."""
    prior = np.array([to_internal(p.size or 1.0, p.unit) for p in effect.parameters])
    columns = (whiten @ seen.columns[seen.causes.index(effect)]) * free
    values = np.zeros(len(prior))
    start = left = whiten @ (seen.residual if mean is None else mean)
    normal = columns.T @ columns + np.diag(prior**-2.0)
    covariance: Array = np.asarray(np.linalg.inv(normal), dtype=np.float64) * np.outer(free, free)
    for _ in range(_STEPS):
        step = covariance @ (columns.T @ left - values / prior**2)
        values = values + step
        left = whiten @ seen.exact(effect, values) if mean is None else start - columns @ values
        if np.max(np.abs(step[free]) / np.sqrt(np.diag(covariance)[free])) < _NEAR:
            break
    scaled = columns * prior
    occam = np.linalg.slogdet(np.eye(len(prior)) + scaled.T @ scaled)[1]
    gain = float(start @ start - left @ left)
    return Cause(
        effect,
        values,
        covariance,
        left,
        gain,
        0.5 * (gain - float(np.sum((values / prior) ** 2)) - float(occam)),
        size_of(seen, effect, values, covariance),
    )


def size_of(seen: WhitenedReadings, effect: Effect, values: Array, covariance: Array) -> Size:
    """Return the size of a cause for display.

    A cause that moves the tool or the base is given by the displacement of the measured targets, mm, RMS over the
    readings. Any other cause is given by its parameter, or by the amplitude of its parameters of one unit.
    """
    if effect.label.endswith("_shift"):
        moves = seen.displacement(effect)
        there = moves @ values
        count = len(there) / 3.0
        size = float(np.sqrt(there @ there / count))
        along = moves.T @ there / (count * max(size, 1e-12))
        return Size(size, 2.0 * float(np.sqrt(along @ covariance @ along)), "mm")
    value, spread, unit = effect.amplitude(values, covariance)
    return Size(value, 2.0 * spread, unit)


def in_display(effect: Effect, values: Array, covariance: Array) -> list[dict[str, float | str]]:
    """List the parameters of a cause with their expanded uncertainty, in display units."""
    return [
        {
            "name": p.short,
            "value": to_display(float(v), p.unit),
            "u": 2.0 * to_display(float(s), p.unit),
            "unit": p.unit,
        }
        for p, v, s in zip(effect.parameters, values, np.sqrt(np.diag(covariance)), strict=True)
    ]
