"""Selection of named effects, and classes of effects that explain the readings equally well.

*Search.* Forward steps are taken on the linearised model, several at a time. Then everything is refitted together, and
scanned constants (orders, time constants, change points) are refined between the places of the scan. When nothing more
enters, effects that are no longer significant by themselves are removed, and effects that another candidate explains
better are swapped. The search then continues forward until nothing changes.

*Chance.* If poses repeat or are few, the largest of all candidates at all places of their scans is taken on each of
the residuals drawn at random (`calib.diagnose.structure`). A claim must exceed those, in addition to its F test. An F
test also assumes equal noise in all directions, which errors from a law outside the library violate. A gain is
therefore compared with the residual along the direction in which the effect acts, by pose, and by stretch of time.
Sources: White 1980, Newey and West 1987 (variance of an estimate with unequal or lasting noise).

*Classes.* Each effect of the model is removed in turn. Every label whose entry in its place costs less than 6 in
evidence belongs to its class, with weight exp(-delta/2), normalised. A candidate with 95 % of the weight is certain;
with less the class is ambiguous. An alias, whose columns contain the whole effect on these readings, costs nothing,
because no reading distinguishes the two, regardless of their labels and numbers of columns.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import fdtrc

from calib.array import Array
from calib.data.dataset import Dataset
from calib.diagnose.structure import NullDistribution, draws
from calib.effects import Survey, offers
from calib.fit.identification import IdentificationFit
from calib.fit.identify import Progress, carry, fit_plain, silent
from calib.fit.least_squares import Linearisation, find_dependent
from calib.model.effect import Effect
from calib.model.model import BoundModel
from calib.scan.families import one_order
from calib.scan.scores import ABSORBED, CLAIM, CLASS_WIDTH, Score, Scores, Space, gain_of, p_value

_FEW = 150  # with fewer poses, rows alone do not determine the significance of a claim
STRETCHES = 16  # stretches of the campaign that show lasting errors


def chance_by_pose(scores: Scores) -> NullDistribution | None:
    """Compute the chance of a gain with poses as the units.

    Returns None if there are many poses, each with one reading.
    """
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
    return NullDistribution.of(np.array(log_p))


def _gains(a: Array, b: Array, raw: Array) -> tuple[Array, Array]:
    """Compute the gains b'A^-1 b for A (places, p, p) and b (places, p, B).

    Returns the gains (places, B), and the number (places,) of columns that count.
    """
    scale = 1.0 / np.sqrt(np.maximum(raw, 1e-300))
    values, vectors = np.linalg.eigh(a * scale[:, :, None] * scale[:, None, :])
    counts = values > ABSORBED
    weights = np.where(counts, 1.0 / np.sqrt(np.where(counts, values, 1.0)), 0.0)
    along = (vectors * weights[:, None, :]).transpose(0, 2, 1) @ (b * scale[:, :, None])
    return np.sum(along**2, axis=1), counts.sum(axis=1)


def _log_p(gain: Array, columns: Array, square: Array, freedom: int) -> Array:
    """Compute the log of the F test's p for gains (B,) with `columns` (B,) columns.

    The squared residuals are `square` (B,).
    """
    left = np.maximum(freedom - columns, 1)
    ratio = (gain / np.maximum(columns, 1)) / (np.maximum(square - gain, 1e-300) / left)
    with np.errstate(divide="ignore"):  # -inf on underflow
        return np.where(columns > 0, np.log(fdtrc(np.maximum(columns, 1), left, ratio)), 0.0)


def against_own_noise(space: Space, directions: Array, left: Array) -> float:
    """Return a factor, at most 1, for the gain along directions (size, p) of an effect.

    The directions are orthonormal. The factor is below 1 if the residual (size,) of the whole model is larger along
    them than elsewhere.
    """
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


def refine(space: Space, chosen: tuple[Effect, ...]) -> tuple[Effect, ...]:
    """Refine the orders, constants and change points of the chosen effects.

    Effects that were not scanned are unchanged.
    """
    if not any(effect.shape for effect in chosen):
        return chosen
    offered = offers(_survey(space))
    made_by = {i: family for i, effect in enumerate(chosen) for family in offered if family.made(effect)}
    refined = list(chosen)
    for kind in dict.fromkeys(type(family) for family in made_by.values()):
        own = {i: family for i, family in made_by.items() if type(family) is kind}
        better = kind.refine(space, [(family, chosen[i]) for i, family in own.items()])
        for i, effect in zip(own, better, strict=True):
            refined[i] = effect
    # Orders that met are one effect, or a pair of large amplitudes that cancel: the first, the stronger, keeps it.
    return tuple(
        effect
        for i, effect in enumerate(refined)
        if not any(one_order(space, effect, earlier) for earlier in refined[:i])
    )


def _survey(space: Space) -> Survey:
    model = space.fitted.model
    curves = frozenset(curve.joint for curve in model.curves)
    return Survey(model.robot, space.fitted.readings.conditions, curves=curves)


MOST_EFFECTS = 60
_ROUNDS = 60
_PATIENCE = 2  # rounds without a better model before the best so far is kept
_MANY = 12  # with more effects than this, one round without a better model is enough
_LEAST_SHARE = 0.004  # least share of the residual that a named effect explains, at any significance
_BESIDE_CURVES = 0.01  # the same if curves of gears have explained most already
_STEPS = 30  # Gauss-Newton steps between choices: a model that is not fitted to its end is compared with none
_PASSED_OVER = 8  # candidates that are tried if the best fails against the noise along it
_SWAP_MARGIN = 1.0  # evidence that a rival must gain to take an effect's place


@dataclass(frozen=True)
class EffectSelection:
    """Model with the chosen effects, and those effects alone.

    Attributes
    ----------
    crowded : bool
        Whether the search stopped because it had found the maximum number of waves of gears.
    """

    fitted: IdentificationFit
    effects: tuple[Effect, ...]
    crowded: bool = False


def select(
    dataset: Dataset,
    start: IdentificationFit,
    *,
    progress: Progress = silent,
    most: int = MOST_EFFECTS,
    crowd: float = math.inf,
) -> EffectSelection:
    """Choose effects for the readings of `start`, in addition to those of its model.

    The search stops at `crowd` waves.
    """
    library = offers(Survey.of(start, dataset))
    chosen = tuple(e for e in start.model.effects if e.group != "base model")
    fitted = start
    seen = {labels(chosen)}
    best = EffectSelection(start, chosen)
    lowest, waited = math.inf, 0
    for _ in range(_ROUNDS):
        space = Space.of(fitted)
        scores = Scores(library, space)
        total = _total(space, scores, chosen)
        if total < lowest and fitted.converged and not any(space.forbids(effect) for effect in chosen):
            best, lowest, waited = EffectSelection(fitted, chosen), total, 0
        else:
            waited += 1
        proposal = _forward(scores, chosen, most, progress, chance_by_pose(scores))
        if sum("order" in effect.shape for effect in proposal) >= crowd:
            return EffectSelection(fitted, proposal, crowded=True)
        if proposal == chosen:
            proposal = _swap(space, scores, _backward(space, scores, chosen))
        if labels(proposal) in seen or waited > (_PATIENCE if len(chosen) <= _MANY else 1):
            break
        seen.add(labels(proposal))
        fitted, chosen = _settle(dataset, fitted, proposal)
        seen.add(labels(chosen))
    return best


def _total(space: Space, scores: Scores, chosen: tuple[Effect, ...]) -> float:
    """Compute the extended BIC of a model, up to a constant, to compare rounds of changes."""
    tries = sum(math.log(scores.multiplicity_of(effect)) for effect in chosen)
    parameters = space.basis.shape[1]
    return space.rows * math.log(space.rss) + parameters * math.log(space.rows) + 2.0 * tries


def labels(chosen: tuple[Effect, ...]) -> frozenset[str]:
    """Return the labels of some effects."""
    return frozenset(effect.label for effect in chosen)


def refit(dataset: Dataset, fitted: IdentificationFit, chosen: tuple[Effect, ...]) -> IdentificationFit:
    """Fit the base model of `fitted` and the chosen effects together on the exact chain."""
    base = tuple(e for e in fitted.model.effects if e.group == "base model")
    model = replace(fitted.model, effects=(*base, *chosen))
    estimate = carry(fitted.model, fitted.estimate, model)
    at = Linearisation(BoundModel(model, fitted.readings.conditions), fitted.readings.observed, estimate)
    active, dropped = find_dependent(at, fitted.dropped)
    return fit_plain(
        dataset,
        model,
        fitted.readings,
        estimate,
        active,
        dropped,
        fitted.faulty_rows,
        fitted.relabelled_rows,
        _STEPS,
    )


def _settle(
    dataset: Dataset, fitted: IdentificationFit, chosen: tuple[Effect, ...]
) -> tuple[IdentificationFit, tuple[Effect, ...]]:
    """Refit, refine the scanned constants, and refit."""
    fitted = refit(dataset, fitted, chosen)
    space = Space.of(fitted)
    refined = refine(space, chosen)
    if refined == chosen:
        return fitted, chosen
    return refit(dataset, fitted, refined), refined


def candidates(scores: Scores, chosen: tuple[Effect, ...]) -> list[Score]:
    """Return the best of every family that is not in the model already."""
    found = [scores.best_of(index) for index in range(len(scores.families))]
    return [score for score in found if score.freedom > 0 and not _present(scores, score.effect, chosen)]


def _present(scores: Scores, effect: Effect, chosen: tuple[Effect, ...]) -> bool:
    """Check if an effect, or a harmonic that the range cannot distinguish, is chosen already."""
    return effect.label in labels(chosen) or any(one_order(scores.space, effect, other) for other in chosen)


def _forward(
    scores: Scores, chosen: tuple[Effect, ...], most: int, progress: Progress, chance: NullDistribution | None
) -> tuple[Effect, ...]:
    """Add effects one by one, half as many as there are and at least four, without a refit.

    The distribution `chance` is for the current residual. Computed later it would be wrong: a sufficient number of
    effects absorbs the errors of single poses, and leaves a residual against which all of them look certain.
    """
    basis, wider = scores.space.basis, chosen
    share = _BESIDE_CURVES if scores.space.fitted.model.curves else _LEAST_SHARE
    while len(wider) < min(most, len(chosen) + max(4, len(chosen) // 2)):
        for best in sorted(candidates(scores, wider), key=lambda score: -score.evidence)[:_PASSED_OVER]:
            if best.gain < share * scores.rss:
                return wider
            new = _new_directions(scores.space, basis, best.effect)
            p = _p_beside(scores, basis, new, best)
            if chance is not None:
                p = max(p, chance.p_value(math.log(max(p, 1e-300))))
            if p <= CLAIM:
                break
        else:
            return wider
        wider = (*wider, best.effect)
        progress(f"effect {len(wider)}: {best.effect.label}")
        basis = _enter(scores, basis, new)
    return wider


def _enter(scores: Scores, basis: Array, new: Array) -> Array:
    """Let directions enter the linearised model; return the wider basis."""
    scores.move(new[: scores.space.size], new.T @ scores.space.held, enters=True)
    return np.column_stack([basis, new])


def _p_beside(scores: Scores, basis: Array, new: Array, best: Score) -> float:
    """Compute the chance of a candidate's gain in addition to the linearised model of a basis.

    The candidate adds the directions `new`.
    """
    space = scores.space
    both = np.column_stack([basis, new])
    left = (space.held - both @ (both.T @ space.held))[: space.size]
    counts = against_own_noise(space, new[: space.size], left)
    return p_value(best.gain, best.freedom, scores.rss, scores.freedom, best.multiplicity, counts)


def _new_directions(space: Space, basis: Array, effect: Effect) -> Array:
    """Return the orthonormal directions (size + a, p) that an effect adds to a basis."""
    columns = np.zeros((len(basis), len(effect.parameters)))
    columns[: space.size] = space.effect_columns(effect)
    columns = columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    for _ in range(2):  # once is not enough if little of a column is left
        columns = columns - basis @ (basis.T @ columns)
    u, s, _ = np.linalg.svd(columns, full_matrices=False)
    return np.asarray(u[:, s > 1e-3], dtype=np.float64)


def leave_one_out(space: Space, scores: Scores, effect: Effect) -> tuple[Scores, float, int]:
    """Remove one effect from the model.

    Returns the scores without it, its own gain, and its number of columns.
    """
    directions, coefficients = space.own_direction(effect)
    without = scores.copy()
    without.move(directions, coefficients, enters=False)
    return without, float(coefficients @ coefficients), len(coefficients)


def _backward(space: Space, scores: Scores, chosen: tuple[Effect, ...]) -> tuple[Effect, ...]:
    """Drop physically impossible effects, and the weaker half of those no longer significant.

    The others may be significant without them.
    """
    failing = []
    allowed = tuple(effect for effect in chosen if not space.forbids(effect))
    for effect in allowed:
        directions, coefficients = space.own_direction(effect)
        gain, columns = float(coefficients @ coefficients), len(coefficients)
        tries = scores.multiplicity_of(effect)
        counts = against_own_noise(space, directions, space.residual.ravel())
        chance = p_value(gain, columns, scores.rss + gain, scores.freedom + columns, tries, counts)
        if chance > CLAIM:
            failing.append((chance, -gain, effect.label))
    weaker = {label for _, _, label in sorted(failing, reverse=True)[: (len(failing) + 1) // 2]}
    return tuple(effect for effect in allowed if effect.label not in weaker)


def _swap(space: Space, scores: Scores, chosen: tuple[Effect, ...]) -> tuple[Effect, ...]:
    """Replace effects by better explanations."""
    out = list(chosen)
    for i, effect in enumerate(chosen):
        if effect.label not in labels(tuple(out)):
            continue
        without, gain, _ = leave_one_out(space, scores, effect)
        own = without.own(effect, gain)
        others = tuple(other for j, other in enumerate(out) if j != i)
        rivals = [
            score for score in candidates(without, others) if not one_order(space, score.effect, effect)
        ]
        best = max(rivals, key=lambda score: score.evidence, default=None)
        if best is not None and best.evidence > own + _SWAP_MARGIN:
            out[i] = best.effect
    return tuple(out)


CERTAIN = 0.95
# Share of an effect that an alias may fail to reproduce: rounding of angles, no reading shows it
_TWIN = 1e-4
_FIT_WIDTH = 30.0  # loss of fit beyond which the evidence of an order is not computed


@dataclass(frozen=True)
class EffectEvidence:
    """Evidence for one effect of the model, with all others in the model."""

    candidates: dict[str, float]  # label -> weight, heaviest first
    effects: dict[str, Effect]  # label -> the candidate itself
    delta_bic: float
    p_value: float
    explained_variance: float

    def at_most_as_sure_as(self, chance: NullDistribution) -> EffectEvidence:
        """Raise the p-value to that of the whole scan by chance, if that is larger."""
        log_p = math.log(max(self.p_value, 1e-300))
        return replace(self, p_value=max(self.p_value, min(1.0, chance.p_value(log_p))))

    @property
    def certain(self) -> bool:
        """Whether one candidate has at least 95 % of the weight."""
        return max(self.candidates.values()) >= CERTAIN


def judge(space: Space, scores: Scores, effect: Effect, chosen: tuple[Effect, ...]) -> EffectEvidence:
    """Find the class of one effect and the evidence for it.

    The `scores` are those of the whole model.
    """
    without, gain, columns = leave_one_out(space, scores, effect)
    tries = scores.multiplicity_of(effect)
    counts = against_own_noise(space, space.own_direction(effect)[0], space.residual.ravel())
    own = without.own(effect, gain)
    twins = _twins(without, effect)
    costs, effects = {effect.label: 0.0}, {effect.label: effect}
    others = tuple(other for other in chosen if other is not effect)
    for score in (*candidates(without, others), *_near_rivals(without), *twins):
        label = score.effect.label
        if score.freedom == 0 or label in {other.label for other in others}:
            continue
        # A rival that the linearised model prefers lost against the effect when both were refitted.
        cost = max(own - score.evidence, 0.0)
        if score.freedom <= columns or score in twins:
            # No more complex, or an alias, and it fits as well: what is usual must not decide alone.
            fit = without.space.rows * math.log(
                max(without.rss - score.gain, 1e-300) / max(without.rss - gain, 1e-300)
            )
            cost = min(cost, max(fit, 0.0))
        if cost < min(CLASS_WIDTH, costs.get(label, math.inf)) and not _same(without, effect, score.effect):
            costs[label], effects[label] = cost, score.effect
    best = min(costs.values())
    weights = {label: math.exp(-0.5 * (cost - best)) for label, cost in costs.items()}
    total = sum(weights.values())
    ranked = sorted(weights, key=lambda label: -weights[label])
    return EffectEvidence(
        candidates={label: weights[label] / total for label in ranked},
        effects={label: effects[label] for label in ranked},
        delta_bic=own,
        p_value=p_value(gain, columns, without.rss, without.freedom, tries, counts),
        explained_variance=gain / without.rss,
    )


def _twins(scores: Scores, effect: Effect) -> list[Score]:
    """Find candidates whose columns contain all that the effect does here.

    The columns are taken after projection on the residual space of the other effects. Families without aliases are
    skipped.
    """
    directions, coefficients = scores.space.own_direction(effect)
    does: Array = directions @ (coefficients / np.linalg.norm(coefficients))
    found = []
    for index, family in enumerate(scores.families):
        if not family.twins:
            continue
        shared = family.shared(scores.space, does[:, None])[:, :, 0]
        share, _ = gain_of(scores.a[index], shared, family.raw)
        place = int(np.argmax(share))
        gain, freedom = scores.gains(index)
        if share[place] > 1.0 - _TWIN and freedom[place] > 0:
            found.append(scores.at(index, place, float(gain[place]), int(freedom[place])))
    return found


def _near_rivals(scores: Scores) -> list[Score]:
    """Find separate rivals that are nearly as good as the best of their family.

    These are whole orders of a joint, neighbours that a short range confuses, and creeps instead of a step.
    """
    found = []
    for index, family in enumerate(scores.families):
        if not family.rivals.any():
            continue
        gain, freedom = scores.gains(index)
        left = np.maximum(scores.rss - gain, 1e-300)
        near = scores.space.rows * np.log(left / left.min()) < _FIT_WIDTH
        found += [
            scores.at(index, int(i), float(gain[i]), int(freedom[i]))
            for i in np.flatnonzero(near & family.rivals)
        ]
    return found


def _same(scores: Scores, one: Effect, other: Effect) -> bool:
    """Check if a place of the scan is the chosen effect; two whole orders always differ."""
    if one.label == other.label:
        return True
    both_whole = all(float(e.shape.get("order", 0.5)).is_integer() for e in (one, other))
    return not both_whole and one_order(scores.space, one, other)
