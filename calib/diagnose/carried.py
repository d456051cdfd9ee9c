"""Two layers of a diagnosed model: named effects, and carried terms without a known cause.

A carried term is an effect of the group "carried": a slot of the chain times a condition, with a size by evidence. The
left-out readings confirm it, so it improves predictions. Its label is no cause, since two halves of the same readings
choose different terms. Named effects and terms compete in one pursuit from the base model (`calib.diagnose.pursuit`),
in which a named effect has a small advantage over columns that do the same. A named effect is withdrawn

  - if it does not enter, or is not significant together with all that entered;
  - if terms of the same condition remain that explain more than a tenth as much as the effect: then the condition is
    right, but the law or the place is not.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calib.array import Array
from calib.data.conditions import Conditions
from calib.data.dataset import Dataset
from calib.diagnose.dictionary import CONDITIONS, Entry, OfClock, bound, held, step_at
from calib.diagnose.pursuit import HOLDS, LEASH, PursuitResult, PursuitTerm, parts, pursue
from calib.diagnose.structure import TOGETHER, ResidualStructure
from calib.fit.held_out import all_readings
from calib.fit.identification import IdentificationFit
from calib.fit.identify import carry, leaving_out
from calib.fit.readings import FitReadings
from calib.model.carried_regressors import OfTime
from calib.model.effect import Effect, EffectTerm, Owner, Parameter
from calib.model.model import BoundModel
from calib.model.regressors import CreepBetween, Regressor, StepAt, Temperature, Time, WarmUpRegressor
from calib.units import to_display

_WINDOWS = np.radians((6.0, 12.0, 24.0))
_FEWEST_TOGETHER = 3  # poses
_BY_CHANCE = 1e-3
_ROUNDS = 3  # Gauss-Newton steps of the final fit: the terms are small
_REMAINS = 0.1  # share of what a name explains that other terms of its condition may explain
_NEAR, _MOST_AVERAGED = 60, 8  # change points to either side of a step, and steps that are averaged over them
_MOST_PLACES = 8
_BY_ROWS = "order of the rows"
_SURE = 0.95  # confidence of the interval for the moment of a change


@dataclass(frozen=True)
class CarriedTerm:
    """Carried term of a model.

    Attributes
    ----------
    explained : float
        Share of the squared error left by the named effects that the term explained when it entered.
    condition : str
        Condition that the term follows, named as in `ResidualStructure.where`.
    between : (str, str) or None
        For a step, ids of the readings before and after the change, which lies between them with 95 % confidence.
    """

    effect: Effect
    values: Array  # (p,) internal units
    covariance: Array  # (p, p)
    explained: float
    p_value: float
    condition: str
    between: tuple[str, str] | None = None

    @property
    def slot(self) -> str:
        """Slot of the chain on which the term acts."""
        return self.effect.terms[0].slot

    @property
    def place(self) -> str:
        """Slot as text, named as in `ResidualStructure.acts_on`."""
        kind, number = self.slot.rstrip("0123456789"), self.slot.lstrip("abcdefghijklmnopqrstuvwxyz")
        body = self.slot.partition(".")[0]
        words = {"theta": f"joint {number}", "d": f"the offset {self.slot}", "a": f"the length {self.slot}"}
        words |= {"alpha": f"the twist {self.slot}", "beta": f"the twist {self.slot}"}
        if body.startswith("bearing"):
            return f"the bearing of joint {body.removeprefix('bearing')}"
        return words.get(kind, {"base": "the base", "tool": "the tool"}.get(body, self.slot))


@dataclass(frozen=True)
class Shares:
    """Shares of the squared error that the base model leaves; they add up to 1.

    The parts are explained by named effects, explained by carried terms, and noise.
    """

    named: float
    carried: float
    noise: float

    @classmethod
    def of(cls, base: IdentificationFit, named: IdentificationFit, final: IdentificationFit) -> Shares:
        """Compute the shares on the readings of the final fit."""
        conditions, observed = final.readings.conditions, final.readings.observed
        squares = [
            float(np.sum(observed.residual(BoundModel(fit.model, conditions).frames(fit.estimate, ())) ** 2))
            for fit in (base, named, final)
        ]
        whole, beside, left = max(squares[0], 1e-300), min(squares[1], squares[0]), min(squares[1:])
        left = min(left, beside)
        return cls((squares[0] - beside) / whole, (beside - left) / whole, left / whole)


@dataclass(frozen=True)
class Layers:
    """Fit with carried terms, and these terms in descending order of their explained share."""

    fitted: IdentificationFit
    terms: tuple[CarriedTerm, ...]

    def places(self, left: Sequence[ResidualStructure]) -> list[ResidualStructure]:
        """List the places of structure, each condition once, largest explained share first.

        They come from the carried terms, and from the structure `left` that tests found after the named effects.
        """
        own = [
            ResidualStructure(t.condition, t.p_value, t.explained, t.place) for t in self.terms[:_MOST_PLACES]
        ]
        found: dict[str, ResidualStructure] = {}
        for place in sorted([*own, *left], key=lambda s: (s.where == TOGETHER, -s.explained_variance)):
            found.setdefault(place.where, place)
        return list(found.values())


def competed(
    base: IdentificationFit, readings: FitReadings, everywhere: Conditions, named: tuple[Effect, ...]
) -> tuple[PursuitResult, tuple[Effect, ...]]:
    """Let terms and named effects compete in a pursuit from the base model.

    If no number of terms pays, all named effects are kept: the readings then show no more than the search for effects
    did. A term that entered under a withdrawn name stays as a carried term, because left-out readings confirm it.

    Parameters
    ----------
    everywhere : Conditions
        Conditions of all rows that must be predicted.

    Returns
    -------
    chosen : PursuitResult
        Choice of the pursuit.
    holding : tuple of Effect
        Named effects that are kept.
    """
    chosen = pursue(base, readings, everywhere, named)
    if not chosen.choices:
        return chosen, named
    entered = {c.entry.effect.label: c for c in chosen.choices if c.entry.effect is not None}
    terms = chosen.carried(named=entered)
    return chosen, tuple(e for e in named if e.label in entered and _holds(e, entered, terms))


def _holds(name: Effect, entered: Mapping[str, PursuitTerm], terms: Sequence[PursuitTerm]) -> bool:
    """Check that a named effect is significant and explains its condition.

    The other named effects of the condition count with it.
    """
    own = _conditions_of(name)
    named = sum(
        c.explained for c in entered.values() if c.entry.effect and own & _conditions_of(c.entry.effect)
    )
    others = (
        c for c in terms if not (name.wave and c.entry.kind == "gear")
    )  # a gear has waves of many orders
    remains = sum(c.explained for c in others if own & _conditions_of_entry(c.entry))
    return entered[name.label].log_p < np.log(HOLDS) and remains <= _REMAINS * named


def _conditions_of(effect: Effect) -> set[str | int]:
    """Return the conditions that an effect follows: "time", "air", or the numbers of joints."""
    found: set[str | int] = set()
    for term in effect.terms:
        if isinstance(term.regressor, StepAt | CreepBetween | Time | WarmUpRegressor | OfTime):
            found.add("time")
        elif isinstance(term.regressor, Temperature):
            found.add("air")
        found.update(
            getattr(term.regressor, key) for key in ("joint", "other") if hasattr(term.regressor, key)
        )
    return found


def _kind(effect: Effect) -> str:
    """Return the kind of entry for the first condition that an effect follows."""
    own = _conditions_of(effect)
    return "time" if "time" in own else "air" if "air" in own else "joint" if own else "constant"


def _condition(entry: Entry, clock: str) -> str:
    """Name the condition of an entry as in `ResidualStructure.where`.

    Without times only the order of the rows is known.
    """
    kind, joints = entry.kind, list(entry.joints)
    if entry.effect is not None:
        kind = _kind(entry.effect)
        joints = sorted(c for c in _conditions_of(entry.effect) if isinstance(c, int))
    return _BY_ROWS if kind == "time" and clock == "order" else CONDITIONS[kind].format(*joints)


def _conditions_of_entry(entry: Entry) -> set[str | int]:
    if entry.effect is not None:
        return _conditions_of(entry.effect)
    return {*entry.joints} or {"air" if entry.kind == "late air" else entry.kind}


def with_terms(
    dataset: Dataset, named: IdentificationFit, readings: FitReadings, chosen: PursuitResult
) -> Layers:
    """Fit the base model, the named effects and the carried terms together on the exact chain."""
    carried = chosen.carried(named={e.label for e in named.model.effects})
    if not carried:
        return Layers(named, ())
    if len(readings.rows) > len(named.readings.rows):  # some rejected readings came back
        back = {dataset.reading_id[row] for row in readings.rows}
        named = leaving_out(named, readings, tuple(name for name in named.faulty_rows if name not in back))
    known = np.unique(getattr(readings.conditions, chosen.clock))
    effects, moments = [], []
    for number, choice in enumerate(carried, start=1):
        moment = None
        if choice.entry.effect is not None:
            effects.append(_unnamed(choice, number, readings.conditions, chosen.clock))
            moments.append(None)
            continue
        functions = [bound(f, known, chosen.clock) for f in choice.entry.functions]
        if choice.entry.at is not None:
            where = int(np.searchsorted(known, choice.entry.at))
            moment = (known[where], known[min(where + 1, len(known) - 1)])
            if sum(m is not None for m in moments) < _MOST_AVERAGED:
                function, moment = _averaged(
                    named, readings, chosen, [c.entry for c in carried if c is not choice], choice, known
                )
                functions = [function]
        moments.append(moment)
        effects.append(_effect(named, choice, number, functions))
    fitted = _fitted(named, readings, effects, chosen.kappa)
    left = float(
        np.sum(
            readings.observed.residual(
                BoundModel(named.model, readings.conditions).frames(named.estimate, ())
            )
            ** 2
        )
    )
    terms = []
    for effect, choice, moment in zip(effects, carried, moments, strict=True):
        at = fitted.model.positions(effect)
        terms.append(
            CarriedTerm(
                effect,
                fitted.estimate[at],
                fitted.covariance[np.ix_(at, at)],
                min(choice.explained / left, 1.0),
                float(np.exp(min(choice.log_p, 0.0))),
                _condition(choice.entry, chosen.clock),
                None if moment is None else _between(dataset, readings, chosen.clock, moment),
            )
        )
    return Layers(fitted, tuple(sorted(terms, key=lambda t: -t.explained)))


def _effect(
    named: IdentificationFit, choice: PursuitTerm, number: int, functions: Sequence[Regressor]
) -> Effect:
    entry = choice.entry
    unit = "deg" if named.model.chain.slots[entry.slot].turns else "mm"
    label = f"carried:{entry.slot}:{entry.kind.replace(' ', '_')}:{number}"
    names = [f"{label}.{'ab'[i]}" for i in range(len(functions))] if len(functions) > 1 else [f"{label}.size"]
    owner: Owner = "mounting" if entry.slot.partition(".")[0] in ("base", "tool") else "robot"
    return Effect(
        label,
        "carried",
        owner,
        f"{entry.slot} follows {entry.condition}, for no known cause.",
        tuple(Parameter(n, unit, to_display(s, unit)) for n, s in zip(names, choice.sizes, strict=True)),
        tuple(EffectTerm(name, entry.slot, 1.0, f) for name, f in zip(names, functions, strict=True)),
    )


def _unnamed(choice: PursuitTerm, number: int, conditions: Conditions, clock: str) -> Effect:
    """Turn a named effect into a carried term.

    Its drivers keep the value at the border of the measured range beyond that range.
    """
    named = choice.entry.effect
    assert named is not None
    label = f"carried:{named.terms[0].slot}:{CONDITIONS[_kind(named)].split()[0]}:{number}"
    return replace(
        named,
        label=label,
        group="carried",
        meaning=f"{named.terms[0].slot} follows {_condition(choice.entry, clock)}, for no known cause.",
        parameters=tuple(
            Parameter(f"{label}.{p.short}", p.unit, to_display(size, p.unit))
            for p, size in zip(named.parameters, choice.sizes, strict=True)
        ),
        terms=tuple(
            replace(
                t,
                parameter=f"{label}.{t.parameter.rpartition('.')[2]}",
                regressor=held(t.regressor, conditions, clock),
            )
            for t in named.terms
        ),
    )


def _averaged(
    named: IdentificationFit,
    readings: FitReadings,
    chosen: PursuitResult,
    others: Sequence[Entry],
    step: PursuitTerm,
    known: Array,
) -> tuple[Regressor, tuple[float, float]]:
    """Average a step over its possible moments; return also the interval with 95 % of them."""
    assert step.entry.at is not None
    here = int(np.searchsorted(known, step.entry.at))
    low, high = max(here - _NEAR, 0), min(here + _NEAR, len(known) - 1)
    moments = known[low:high]
    steps = [replace(step.entry, functions=(step_at(float(t)),)) for t in moments]
    active = np.diag(named.covariance) > 0.0
    count = int(active.sum())
    size = count + sum(e.width for e in others)
    gram, right = np.zeros((size, size)), np.zeros(size)
    shared, own, at_steps = np.zeros((len(steps), size)), np.zeros(len(steps)), np.zeros(len(steps))
    square = 0.0
    for part in parts(named, readings):
        beside = part.of_entries(others, known, chosen.clock)
        columns = np.column_stack([part.columns[:, active], beside.T])
        moving, left = part.of_entries(steps, known, chosen.clock), part.residual.ravel()
        gram += columns.T @ columns
        right += columns.T @ left
        shared += moving @ columns
        own += np.sum(moving**2, axis=1)
        at_steps += moving @ left
        square += float(left @ left)
    scale = np.sqrt(np.diag(gram) + np.r_[named.prior[active] ** 2, np.zeros(size - count)])
    gram = gram / np.outer(scale, scale)
    ridge = np.r_[(named.prior[active] / scale[:count]) ** 2 + LEASH**2, np.full(size - count, 1e-9)]
    solved = np.linalg.solve(gram + np.diag(ridge), np.column_stack([(shared / scale).T, right / scale]))
    left_own = np.maximum(own - np.sum((shared / scale) * solved[:, :-1].T, axis=1), 1e-12 * own)
    gain = (at_steps - (shared / scale) @ solved[:, -1]) ** 2 / left_own
    rss = square - float((right / scale) @ solved[:, -1]) - float(gain.max())
    noise = max(rss / max(readings.observed.count - size - 1, 1), 1e-300) * chosen.kappa**2
    likely = np.exp((gain - gain.max()) / (2.0 * noise)) * np.diff(known[low : high + 1])
    share = np.cumsum(likely) / likely.sum()
    first, last = np.searchsorted(share, (0.5 * (1.0 - _SURE), 0.5 * (1.0 + _SURE)))
    times = np.r_[known[low], known[low + 1 : high + 1]]
    law = OfClock(lambda u: np.asarray(np.interp(u, times, np.r_[0.0, share])))
    function = bound(law, known, chosen.clock)
    return function, (float(known[low + first]), float(known[min(low + int(last) + 1, len(known) - 1)]))


def _between(
    dataset: Dataset, readings: FitReadings, clock: str, moment: tuple[float, float]
) -> tuple[str, str]:
    """Return the ids of the last reading up to an interval, and of the first from its end."""
    times, rows = getattr(dataset.conditions, clock), readings.rows
    before = rows[times[rows] <= moment[0]]
    after = rows[times[rows] >= moment[1]]
    first = before[np.argmax(times[before])] if len(before) else rows[0]
    last = after[np.argmin(times[after])] if len(after) else rows[-1]
    return dataset.reading_id[first], dataset.reading_id[last]


def _fitted(
    named: IdentificationFit, readings: FitReadings, effects: Iterable[Effect], kappa: float
) -> IdentificationFit:
    """Fit the model and the terms together.

    A ridge ties the model to its own fit, and evidence limits each term. The noise is that of the left-out blocks: the
    noise of the residual times kappa.
    """
    model = named.model.append(*effects)
    start = carry(named.model, named.estimate, model)
    estimate, count = start, len(named.estimate)
    active = np.r_[np.diag(named.covariance) > 0.0, np.ones(len(start) - count, dtype=bool)]
    scale = max(named.noise_scale, 1e-9)
    covariance, residual, freedom = named.covariance, named.residual, named.degrees_of_freedom
    weight, base = np.r_[named.prior, np.zeros(len(start) - count)], np.flatnonzero(active) < count
    for _ in range(_ROUNDS):
        weight[count:] = scale / model.prior_std[count:]
        gram, right = np.zeros((len(base), len(base))), np.zeros(len(base))
        for part in parts(replace(named, model=model, estimate=estimate), readings):
            columns = part.columns[:, active]
            gram += columns.T @ columns
            right += columns.T @ part.residual.ravel()
        held = weight[active] ** 2
        size = np.sqrt(np.diag(gram) + held)
        leash = np.where(base, LEASH * size, 0.0) ** 2
        inverse = np.linalg.inv((gram + np.diag(held + leash)) / np.outer(size, size)) / np.outer(size, size)
        right -= held * (estimate - model.prior_mean)[active] + leash * (estimate - start)[active]
        estimate = estimate.copy()
        estimate[active] += inverse @ right
        residual = readings.observed.residual(BoundModel(model, readings.conditions).frames(estimate, ()))
        freedom = readings.observed.count - round(float(np.sum(1.0 - (held + leash) * np.diag(inverse))))
        scale = float(np.sqrt(np.sum(residual**2) / max(freedom, 1)))
        covariance = np.zeros((len(start), len(start)))
        covariance[np.ix_(active, active)] = inverse * max(scale * kappa, 1.0) ** 2
    return replace(
        named,
        model=model,
        estimate=estimate,
        covariance=covariance,
        prior=weight,
        readings=readings,
        residual=residual,
        noise_scale=scale * kappa,
        degrees_of_freedom=freedom,
    )


def readings_back(dataset: Dataset, fitted: IdentificationFit) -> tuple[FitReadings, NDArray[np.int64]]:
    """Add rejected readings that are not accidental to the readings of a fit.

    Rejected readings that cluster in a window of one joint beyond chance show a place where the model fails.

    Returns
    -------
    readings : FitReadings
        Readings of the fit with those that came back.
    back : array of int
        Rows of the latter in the data set.
    """
    # Imported here, since it would add half a second to the start of a service
    from scipy.stats import hypergeom

    readings, out = all_readings(dataset, fitted)
    joints, pose = readings.conditions.joints, readings.conditions.pose
    back, rejected = np.zeros(len(out), dtype=bool), np.flatnonzero(out)
    for angle in joints.T if len(rejected) >= _FEWEST_TOGETHER else ():
        for width in _WINDOWS:
            if np.ptp(angle) <= 3.0 * width:
                continue
            low = angle[rejected][:, None]
            within = (angle >= low) & (angle <= low + width)
            gone = within & out
            chance = hypergeom.sf(gone.sum(axis=1) - 1, len(out), len(rejected), within.sum(axis=1))
            chance = chance * len(rejected) * len(_WINDOWS) * joints.shape[1]
            for together in gone[chance < _BY_CHANCE]:
                if len(np.unique(pose[together])) >= _FEWEST_TOGETHER:
                    back |= together
    return (readings.take(~out | back) if back.any() else fitted.readings), readings.rows[back]
