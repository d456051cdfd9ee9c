"""Equivalence classes: the other candidates that explain the readings as well as an effect, and their weights.

Each effect of the model is taken out in turn. Every label whose entry in its place costs less than 6 in evidence
belongs to its class, with weight exp(-delta/2), normalised. A candidate with 95 % of the weight is certain; with less
the class is ambiguous. A twin, whose columns contain the whole effect on these readings, costs nothing, because no
reading distinguishes the two, whatever their labels and numbers of columns.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from calib.array import Array
from calib.diagnose.claims import against_own_noise
from calib.diagnose.null import Chance
from calib.diagnose.select import candidates, leave_one_out
from calib.model.effect import Effect
from calib.scan.evidence import CLASS_WIDTH, p_value
from calib.scan.harmonics import one_order
from calib.scan.scores import Score, Scores, gain_of
from calib.scan.space import Space

CERTAIN = 0.95
# Share of what an effect does that a twin may fail to do: rounding of angles, no reading shows it
_TWIN = 1e-4
_FIT_WIDTH = 30.0  # by how much worse an order may fit before its evidence is not even worked out


@dataclass(frozen=True)
class Evidence:
    """The evidence for one effect of the model, with all others in the model."""

    candidates: dict[str, float]  # label -> weight, heaviest first
    effects: dict[str, Effect]  # label -> the candidate itself
    delta_bic: float
    p_value: float
    explained_variance: float

    def at_most_as_sure_as(self, chance: Chance) -> Evidence:
        """The evidence with the p-value that the whole scan has by chance, where that is larger."""
        log_p = math.log(max(self.p_value, 1e-300))
        return replace(self, p_value=max(self.p_value, min(1.0, chance.p_value(log_p))))

    @property
    def certain(self) -> bool:
        """Whether one candidate has at least 95 % of the weight."""
        return max(self.candidates.values()) >= CERTAIN


def judge(space: Space, scores: Scores, effect: Effect, chosen: tuple[Effect, ...]) -> Evidence:
    """The class of one effect and the evidence for it. `scores` are those of the whole model."""
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
            # No more complex, or a twin, and it fits as well: what is usual must not decide alone.
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
    return Evidence(
        candidates={label: weights[label] / total for label in ranked},
        effects={label: effects[label] for label in ranked},
        delta_bic=own,
        p_value=p_value(gain, columns, without.rss, without.freedom, tries, counts),
        explained_variance=gain / without.rss,
    )


def _twins(scores: Scores, effect: Effect) -> list[Score]:
    """Candidates whose columns, by what the rest of the model leaves of them, hold all that the effect does here.

    Families without twins are not looked at.
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
    """Every rival of its own that is nearly as good as the best of its family: whole orders of a joint, neighbours that
    a short range confuses, and creeps beside a step."""
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
    """Whether a place of the scan is the chosen effect again: two whole orders are always two explanations."""
    if one.label == other.label:
        return True
    both_whole = all(e.shape.get("order", 0.5).is_integer() for e in (one, other))
    return not both_whole and one_order(scores.space, one, other)
