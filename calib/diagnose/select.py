"""The choice of effects: forward, swap, backward, with joint refits on the exact chain between.

Forward steps are taken on the linearised model, some at a time, then everything is refitted together and the
scanned orders are refined. When nothing more enters, effects that no longer pass by themselves leave, and those
that another candidate explains better are swapped; then forward again, until nothing changes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from calib.array import Array
from calib.data.dataset import Dataset
from calib.diagnose.claims import against_own_noise, chance_by_pose
from calib.diagnose.null import Chance
from calib.diagnose.refine import refine
from calib.effects import Survey, offers
from calib.fit.identification import Identification
from calib.fit.identify import Progress, carry, fit_plain, silent
from calib.fit.least_squares import Linearisation, find_dependent
from calib.model.effect import Effect
from calib.model.model import Design
from calib.scan.evidence import CLAIM, p_value
from calib.scan.harmonics import one_order
from calib.scan.scores import Score, Scores
from calib.scan.space import Space

MOST_EFFECTS = 60
_ROUNDS = 60
_PATIENCE = 2  # rounds without a better model before the best so far is kept
_MANY = 12  # with more effects than this, one round without a better model is enough
_LEAST_SHARE = 0.004  # of what is left: an effect that explains less is not worth a name, however sure
_BESIDE_CURVES = 0.01  # the same where curves of gears have taken the most away already
_STEPS = 30  # Gauss-Newton steps between choices: a model that is not fitted to its end is compared with none
_PASSED_OVER = 8  # candidates that are looked at when the best of them fails beside the noise along it
_SWAP_MARGIN = 1.0  # evidence that a rival must gain to take an effect's place


@dataclass(frozen=True)
class Selection:
    """The model with the effects that were chosen, and those effects alone.

    crowded: the search was given up, since it had found as many waves of gears as it was to find.
    """

    fitted: Identification
    effects: tuple[Effect, ...]
    crowded: bool = False


def select(
    dataset: Dataset,
    start: Identification,
    *,
    progress: Progress = silent,
    most: int = MOST_EFFECTS,
    crowd: float = math.inf,
) -> Selection:
    """Choose effects for the readings of `start`, beside those its model holds already; so many waves are a crowd."""
    library = offers(Survey.of(start, dataset))
    chosen = tuple(e for e in start.model.effects if e.group != "base model")
    fitted = start
    seen = {labels(chosen)}
    best = Selection(start, chosen)
    lowest, waited = math.inf, 0
    for _ in range(_ROUNDS):
        space = Space.of(fitted)
        scores = Scores(library, space)
        total = _total(space, scores, chosen)
        if total < lowest and fitted.converged and not any(space.forbids(effect) for effect in chosen):
            best, lowest, waited = Selection(fitted, chosen), total, 0
        else:
            waited += 1
        proposal = _forward(scores, chosen, most, progress, chance_by_pose(scores))
        if sum("order" in effect.shape for effect in proposal) >= crowd:
            return Selection(fitted, proposal, crowded=True)
        if proposal == chosen:
            proposal = _swap(space, scores, _backward(space, scores, chosen))
        if labels(proposal) in seen or waited > (_PATIENCE if len(chosen) <= _MANY else 1):
            break
        seen.add(labels(proposal))
        fitted, chosen = _settle(dataset, fitted, proposal)
        seen.add(labels(chosen))
    return best


def _total(space: Space, scores: Scores, chosen: tuple[Effect, ...]) -> float:
    """The extended BIC of a model, up to a constant, by which rounds of changes are compared."""
    tries = sum(math.log(scores.multiplicity_of(effect)) for effect in chosen)
    parameters = space.basis.shape[1]
    return space.rows * math.log(space.rss) + parameters * math.log(space.rows) + 2.0 * tries


def labels(chosen: tuple[Effect, ...]) -> frozenset[str]:
    """The labels of some effects."""
    return frozenset(effect.label for effect in chosen)


def refit(dataset: Dataset, fitted: Identification, chosen: tuple[Effect, ...]) -> Identification:
    """Everything together on the exact chain: the base model of `fitted` and the chosen effects."""
    base = tuple(e for e in fitted.model.effects if e.group == "base model")
    model = replace(fitted.model, effects=(*base, *chosen))
    estimate = carry(fitted.model, fitted.estimate, model)
    at = Linearisation(Design(model, fitted.readings.conditions), fitted.readings.observed, estimate)
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
    dataset: Dataset, fitted: Identification, chosen: tuple[Effect, ...]
) -> tuple[Identification, tuple[Effect, ...]]:
    """Refit, refine what was scanned, refit."""
    fitted = refit(dataset, fitted, chosen)
    space = Space.of(fitted)
    refined = refine(space, chosen)
    if refined == chosen:
        return fitted, chosen
    return refit(dataset, fitted, refined), refined


def candidates(scores: Scores, chosen: tuple[Effect, ...]) -> list[Score]:
    """The best of every family that is not in the model already."""
    found = [scores.best_of(index) for index in range(len(scores.families))]
    return [score for score in found if score.freedom > 0 and not _present(scores, score.effect, chosen)]


def _present(scores: Scores, effect: Effect, chosen: tuple[Effect, ...]) -> bool:
    """Whether an effect, or a harmonic that the measured range cannot distinguish from it, is chosen already."""
    return effect.label in labels(chosen) or any(one_order(scores.space, effect, other) for other in chosen)


def _forward(
    scores: Scores, chosen: tuple[Effect, ...], most: int, progress: Progress, chance: Chance | None
) -> tuple[Effect, ...]:
    """Add effects one by one; half as many as there are, at least four, before everything is refitted.

    chance: what the scan makes of the residual as it is now. Later is too late: enough effects take up whatever the
    poses have of their own, and leave a residual beside which all of them look sure.
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
    """Let directions enter the linearised model. Returns the wider basis."""
    scores.move(new[: scores.space.size], new.T @ scores.space.held, enters=True)
    return np.column_stack([basis, new])


def _p_beside(scores: Scores, basis: Array, new: Array, best: Score) -> float:
    """Chance of the gain of a candidate whose own directions are `new`, beside the linearised model of a basis."""
    space = scores.space
    both = np.column_stack([basis, new])
    left = (space.held - both @ (both.T @ space.held))[: space.size]
    counts = against_own_noise(space, new[: space.size], left)
    return p_value(best.gain, best.freedom, scores.rss, scores.freedom, best.multiplicity, counts)


def _new_directions(space: Space, basis: Array, effect: Effect) -> Array:
    """(size + a, p) what an effect adds to the basis of a linearised model, orthonormal."""
    columns = np.zeros((len(basis), len(effect.parameters)))
    columns[: space.size] = space.effect_columns(effect)
    columns = columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    for _ in range(2):  # once is not enough where little of a column is left
        columns = columns - basis @ (basis.T @ columns)
    u, s, _ = np.linalg.svd(columns, full_matrices=False)
    return np.asarray(u[:, s > 1e-3], dtype=np.float64)


def leave_one_out(space: Space, scores: Scores, effect: Effect) -> tuple[Scores, float, int]:
    """Scores with one effect taken out of the model, what it alone explains, and its number of columns."""
    directions, coefficients = space.own_direction(effect)
    without = scores.copy()
    without.move(directions, coefficients, enters=False)
    return without, float(coefficients @ coefficients), len(coefficients)


def _backward(space: Space, scores: Scores, chosen: tuple[Effect, ...]) -> tuple[Effect, ...]:
    """Drop what physics forbids, and the weaker half of the effects that no longer pass by themselves (the others may
    pass without them)."""
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
    """Put better explanations in the place of effects, wherever there are any."""
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
