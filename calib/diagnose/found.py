"""Results of a diagnosis for each effect: size, uncertainty, held-out error and power.

*Shapes.* A scan fixes a shape constant s, and the covariance of the amplitudes holds for that value only. With the
derivative d = (dX/ds) b of the readings by the constant as an additional column of the Jacobian J,

    var(s) = v / |P d|^2,    cov(b) += g var(s) g',    g = -(J'J)^-1 J'd,

v the variance of the noise and P the projection on the residual space of the model. A moment of change has no
derivative: its interval contains the change points with 95 % of the posterior probability, and ends at readings of the
fit. Whole orders of a wave are exact.

*Power.* A = X'PX is the information of the readings on an effect's columns after the model, and s the noise. An effect
of amplitudes b increases the reduction of the squared residuals by b'A b / s^2. A claim needs a reduction that chance
reaches once in 500 sets, corrected for all tries, and more if the noise along the effect is larger than elsewhere. The
stated size is for the direction of b that is least visible. Source: noncentral chi-square, Johnson, Kotz and
Balakrishnan ch. 29.

*Held-out misfit.* With the whitened residual r of held-out readings, columns J, the covariance C of the parameters and
the noise s of the fit, r' (I + J C J' / s^2)^-1 r / s^2 is a chi-square over the rows held out. An excess is neither
noise nor uncertainty of the model. It decides nothing. Sources: Rao 1973, 4a.7, and Woodbury 1950.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc, chndtr, chndtrinc, fdtri, gammaincinv

from calib.array import Array
from calib.data.dataset import Dataset
from calib.diagnose.select import STRETCHES, EffectEvidence
from calib.effects import Survey, offers
from calib.fit.held_out import errors_by
from calib.fit.identification import IdentificationFit
from calib.fit.readings import linearised, readings_of
from calib.fit.statistics import ErrorStatistics, statistics_of
from calib.model.effect import Effect
from calib.model.model import BoundModel, conditional
from calib.scan.families import Harmonics, Shapes, Steps
from calib.scan.scores import ABSORBED, CLAIM, Family, Scores, Space, bounds_of, impossible
from calib.units import to_display

COVERAGE = 2.0  # k of the expanded uncertainty, about 95 %


@dataclass(frozen=True)
class DiagnosedEffect:
    """Effect that was found, with the evidence for it.

    Attributes
    ----------
    values, covariance : array of shape (p,) and (p, p)
        Amplitudes and their covariance, internal units.
    index : str or None
        Id of the reading at which a step happened.
    shape_std : mapping of str to float
        Standard errors of the scanned constants, by name as in `Effect.shape`.
    between : (str, str) or None
        Ids of the last reading before a step and of the first after it, with a probability of 95 %.
    """

    effect: Effect
    evidence: EffectEvidence
    values: Array
    covariance: Array
    index: str | None
    shape_std: Mapping[str, float] = field(default_factory=dict)
    between: tuple[str, str] | None = None

    @cached_property
    def amplitude(self) -> tuple[float, float, str]:
        """Size, standard error and unit, as from `Effect.amplitude`."""
        return self.effect.amplitude(self.values, self.covariance)

    @property
    def confirmed(self) -> bool:
        """Whether the size exceeds its expanded uncertainty."""
        value, std, _ = self.amplitude
        return abs(value) > COVERAGE * std

    @property
    def usual(self) -> float | None:
        """Usual size in the unit of the amplitude.

        None if the library states none, as for a curve of a gear, whose sizes the readings determine.
        """
        same = [p for p in self.effect.parameters if p.unit == self.amplitude[2]]
        if self.effect.is_curve or any(p.size is None or p.centre is not None for p in same):
            return None
        return math.hypot(*(p.size for p in same if p.size is not None))

    @property
    def beyond_usual(self) -> bool:
        """Whether the size exceeds the usual one, so that a technician should look for its cause."""
        return self.usual is None or abs(self.amplitude[0]) > self.usual

    @property
    def impossible(self) -> bool:
        """Whether the values are physically impossible, such as a negative compliance.

        The uncertainty is not considered.
        """
        bounds = bounds_of(self.effect)
        return bounds is not None and bool(impossible(bounds, self.values, np.zeros(len(self.values))))


def resized(found: DiagnosedEffect, fitted: IdentificationFit) -> DiagnosedEffect:
    """Return a finding with the values from another fit."""
    effect = next(e for e in fitted.model.effects if e.label == found.effect.label)
    positions = fitted.model.positions(effect)
    return replace(
        found,
        effect=effect,
        values=fitted.estimate[positions],
        covariance=fitted.covariance[np.ix_(positions, positions)],
    )


_NUDGE = 1e-3  # relative change of a constant for its derivative
_COVERED = 0.95


def with_shapes(
    dataset: Dataset, fitted: IdentificationFit, found: Sequence[DiagnosedEffect]
) -> list[DiagnosedEffect]:
    """Add the uncertainty of the scanned shapes to the findings, and to their amplitudes.

    The model of `fitted` must include the effects.
    """
    if not any(each.effect.shape and not each.effect.is_curve for each in found):
        return list(found)
    space = Space.of(fitted)
    offered = offers(Survey.of(fitted, dataset))
    families = [next((f for f in offered if f.made(each.effect)), None) for each in found]
    found = [
        replace(each, between=_between(dataset, space, family, each.effect))
        if isinstance(family, Steps)
        else each
        for each, family in zip(found, families, strict=True)
    ]
    shaped = [
        (i, name, derivative)
        for i, (each, family) in enumerate(zip(found, families, strict=True))
        for name, derivative in _derivative(space, family, each.effect)
    ]
    if not shaped:
        return found
    columns = np.column_stack([derivative for _, _, derivative in shaped])
    left = columns - space.basis_of_readings @ (space.basis_of_readings.T @ columns)
    noise = max(fitted.noise_scale, 1.0) ** 2
    shapes = noise * np.linalg.pinv(left.T @ left, hermitian=True)
    carried = -space.covariance @ (space.columns.T @ columns)
    spread = np.sqrt(np.diag(shapes))
    for j, (i, name, _) in enumerate(shaped):
        at = fitted.model.positions(found[i].effect)
        found[i] = replace(
            found[i],
            covariance=found[i].covariance + carried[at] @ shapes @ carried[at].T,
            shape_std={name: float(spread[j])},
        )
    return found


def _derivative(space: Space, family: Family | None, effect: Effect) -> list[tuple[str, Array]]:
    """Return the name of an effect's shape constant and the derivative (size,) of the readings.

    The list is empty if the readings determine no constant.
    """
    if isinstance(family, Shapes):
        name = family.key
    elif isinstance(family, Harmonics) and not float(effect.shape["order"]).is_integer():
        name = "order"
    else:
        return []
    step = _NUDGE * effect.shape[name]
    more, less = (space.effect_columns(family.at(effect.shape[name] + h)) for h in (step, -step))
    values = space.fitted.estimate[space.fitted.model.positions(effect)]
    return [(name, (more - less) @ values / (2.0 * step))]


def _between(dataset: Dataset, space: Space, family: Steps, effect: Effect) -> tuple[str, str] | None:
    """Return the ids of the last reading before a step and of the first after it.

    The step lies between them with a probability of 95 %.
    """
    order = space.fitted.readings.conditions.order
    scores = Scores([replace(family, scanned=len(family.every))], space)
    scores.move(*space.own_direction(effect), enters=False)
    gain = scores.gains(0)[0][: len(family.every)]
    noise = max(space.rss / max(space.freedom, 1), 1e-300)
    weight = np.exp(0.5 * (gain - gain.max()) / noise)
    likely = np.argsort(-weight)
    kept = likely[: int(np.searchsorted(np.cumsum(weight[likely]) / weight.sum(), _COVERED)) + 1]
    ranks = [*family.every[kept].tolist(), effect.shape["rank"]]
    before = order[order < min(ranks)]
    if not len(before) or not math.isfinite(max(ranks)):
        return None
    ids = [
        dataset.reading_id[int(np.flatnonzero(dataset.conditions.order == rank)[0])]
        for rank in (before.max(), max(ranks))
    ]
    return str(ids[0]), str(ids[1])


POWER = 0.95
_ABSURD = 100.0  # multiple of the usual size that no robot has: the readings cannot show the effect
_QUANTILES = 32  # quantiles of the noise along an effect


@dataclass(frozen=True)
class DetectableEffect:
    """Smallest detectable size of an effect, in `unit`; None if these readings cannot show it."""

    label: str
    size: float | None
    unit: str


def visible(scores: Scores) -> tuple[DetectableEffect, ...]:
    """Compute the smallest detectable size of every effect of the library.

    For a scan it is the median over its places.
    """
    found = []
    for index, family in enumerate(scores.families):
        places = len(family.raw)
        effect = family.effect(places // 2)
        units = [parameter.unit for parameter in effect.parameters]
        first = [i for i, unit in enumerate(units) if unit == units[0]]
        least = _least(scores.a[index][:, first][:, :, first], family.raw[:, first])
        needed = _needed(len(units), scores.freedom, scores.multiplicity(index, places // 2))
        typical = float(np.median(least))
        size = np.sqrt(needed * scores.noise / typical) if typical > 0.0 else None
        shown = None if size is None else to_display(float(size), units[0])
        usual = effect.parameters[0].size
        if shown is not None and usual is not None and shown > _ABSURD * usual:
            shown = None
        found.append(DetectableEffect(family.label, shown, units[0]))
    return tuple(found)


def _least(a: Array, raw: Array) -> Array:
    """Compute the smallest eigenvalue (places,) of A (places, p, p) in directions not absorbed.

    Directions that the model absorbs do not count; 0 if it absorbs all.
    """
    values = np.linalg.eigvalsh(a)
    counts = values > ABSORBED * np.max(raw, axis=1, keepdims=True)
    return np.where(counts.any(axis=1), np.min(np.where(counts, values, np.inf), axis=1), 0.0)


@lru_cache(maxsize=256)
def _needed(columns: int, freedom: int, tries: int) -> float:
    """Compute the noncentrality at which `columns` columns are claimed with `POWER`."""
    # Imported here, since it would add half a second to the start of a service
    from scipy.optimize import root_scalar

    limit = columns * float(fdtri(columns, max(freedom - columns, 1), 1.0 - CLAIM / tries))
    least = float(chndtrinc(limit, columns, 1.0 - POWER))
    likely = (np.arange(_QUANTILES) + 0.5) / _QUANTILES
    # The sum of every column over all stretches is zero, since its explained part is removed
    along = 2.0 * gammaincinv(0.5 * columns * (STRETCHES - 1), likely) / (columns * STRETCHES)
    limits = limit * np.maximum(along, 1.0)

    def missed(size: float) -> float:
        return float(np.mean(chndtr(limits, columns, size))) - (1.0 - POWER)

    highest = 2.0 * float(limits[-1]) + 4.0 * least
    return float(root_scalar(missed, bracket=(least, highest), xtol=1e-3 * least).root)


_CHANCE = 1e-3  # false-alarm rate of the test
_NOTICED = 1.1  # ratio to the expectation from which the misfit is reported


@dataclass(frozen=True)
class HeldOutTest:
    """Ratio of the held-out error to its expectation, and its p-value."""

    times: float
    p_value: float

    @property
    def real(self) -> bool:
        """Whether the excess is significant, and large enough to be reported."""
        return self.p_value < _CHANCE and self.times > _NOTICED


def surprise_of(
    dataset: Dataset, found: IdentificationFit, faulty: NDArray[np.bool_] | None = None
) -> HeldOutTest | None:
    """Test the error of the validation rows, which took no part in the model.

    Rows of the mask `faulty` (n,) are left out, since they are no valid readings. Returns None if nothing was held out.
    """
    rows = dataset.validation_rows if faulty is None else dataset.validation_rows & ~faulty
    if not rows.any():
        return None
    readings = readings_of(dataset, rows, found.model, found.estimate)
    if readings.observed.count == 0:
        return None
    spread = np.sqrt(np.diag(found.covariance))
    known = spread > 0.0
    size, noise = spread[known], max(found.noise_scale, 1.0)
    gram, shared, square = np.zeros((len(size), len(size))), np.zeros(len(size)), 0.0
    for _, residual, columns in linearised(found.model, readings, found.estimate):
        scaled, left = columns[:, known] * (size / noise), residual.ravel() / noise
        gram += scaled.T @ scaled
        shared += scaled.T @ left
        square += float(left @ left)
    correlation = found.covariance[np.ix_(known, known)] / (size[:, None] * size)
    inner = np.linalg.solve(np.eye(len(size)) + gram @ correlation, shared)
    square -= float(shared @ correlation @ inner)
    count = readings.observed.count
    # Readings of one visit share its rest position: unless that is declared, they are one observation
    apart = 1.0
    if readings.observed.shared is None:
        apart = len(np.unique(readings.conditions.visit)) / len(readings.rows)
    return HeldOutTest(math.sqrt(max(square, 0.0) / count), float(chdtrc(count * apart, square * apart)))


def estimate_without(found: IdentificationFit, effect: Effect) -> Array:
    """Compute the estimate (m,) with one effect zero and the others adapted to first order."""
    return conditional(found.model, found.estimate, found.covariance, (effect,))[0]


def errors_without(
    dataset: Dataset, found: IdentificationFit, effects: Sequence[Effect]
) -> list[ErrorStatistics | None]:
    """Compute the position error on validation rows without each of some effects.

    The errors are None if nothing was held out.
    """
    rows = dataset.validation_rows
    if not rows.any():
        return [None] * len(effects)
    design = BoundModel(found.model, dataset.conditions.take(rows))
    return [
        statistics_of(errors_by(design, dataset, rows, estimate_without(found, effect))) for effect in effects
    ]
