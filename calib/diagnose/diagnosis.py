"""Diagnosis from end to end: identify, search, refit, judge on readings that took no part.

The choice, the refit and the screening of rows see calibration rows only. Validation rows are predicted at the
end, by the nominal robot in its place, by the base model, and by the model with the effects.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from calib.dataset import Dataset
from calib.diagnose.claims import chance_by_pose
from calib.diagnose.classes import Evidence, judge
from calib.diagnose.curves import with_curves
from calib.diagnose.evidence import CLAIM, p_value
from calib.diagnose.follow_up import FollowUp, Rival, follow_up
from calib.diagnose.power import Visible, visible
from calib.diagnose.scan import Scores
from calib.diagnose.select import MOST_EFFECTS, Selection, refit, select
from calib.diagnose.space import Space
from calib.diagnose.structure import NOISY, Structure, left_over, p_beyond_repeats, p_lack_of_fit
from calib.effects import Survey, offers
from calib.effects.effect import Effect
from calib.held_out import errors_on
from calib.identification import Identification
from calib.identify import Progress, fit, identify, silent
from calib.kinematics import Array
from calib.model import Design, RobotModel
from calib.placing import base_model_of, place_nominal
from calib.readings import readings_of
from calib.statistics import ErrorStatistics, statistics_of

Verdict = Literal["complete", "excess_noise", "attributed", "ambiguous", "unexplained"]
_SCREENINGS = 3
_MOST_RIVALS = 5  # of an effect, and of all of them together, for which poses are sought that tell them apart
_MOST_PAIRS = 12


@dataclass(frozen=True)
class Found:
    """One effect that was found, with what speaks for it."""

    effect: Effect
    evidence: Evidence
    values: Array  # (p,) internal units
    covariance: Array  # (p, p)
    index: str | None  # reading at which a step happened


@dataclass(frozen=True)
class Diagnosis:
    """The result: what the base model lacked, and the error before and after on validation rows."""

    dataset: Dataset
    base: Identification
    final: Identification
    nominal: RobotModel
    nominal_estimate: Array
    effects: tuple[Found, ...]
    verdict: Verdict
    structure: tuple[Structure, ...]
    p_lack_of_fit: float
    error_nominal: ErrorStatistics | None
    error_before: ErrorStatistics | None
    error_after: ErrorStatistics | None
    notes: tuple[str, ...]
    follow_up: FollowUp | None  # what to measure next; None where nothing is ambiguous
    power: tuple[
        Visible, ...
    ]  # the smallest size of everything looked for that these readings would have shown
    seconds: float

    @property
    def stretch(self) -> float | None:
        """Held-out error over what the fit leaves on its own points: far above 1 the model extrapolates there."""
        observed = self.final.readings.observed
        if self.error_after is None or observed.points is None or observed.lengths is not None:
            return None
        design = Design(self.final.model, self.final.readings.conditions)
        left = observed.points - design.frames(self.final.estimate, ()).p
        return self.error_after.rms / float(np.sqrt(np.mean(np.sum(left**2, axis=0))))


def diagnose(dataset: Dataset, *, most: int = MOST_EFFECTS, progress: Progress = silent) -> Diagnosis:
    """Find what the base model of a data set lacks. Raises DataError when it cannot even be identified."""
    begin = time.perf_counter()
    base = identify(dataset, progress=progress)
    nominal, nominal_estimate = place_nominal(dataset, base_model_of(dataset))
    progress("searching")
    selection = Selection(base, ())
    for _ in range(_SCREENINGS):
        selection = select(dataset, selection.fitted, progress=progress, most=most)
        if not selection.effects:
            break
        progress("screening readings again with the effects in the model")
        screened = _screen(dataset, base, selection)
        unchanged = screened.faulty_rows == selection.fitted.faulty_rows
        selection = replace(selection, fitted=screened)
        if unchanged:
            break
    progress("weighing rivals of every effect")
    selection, space, named, power = _judged(dataset, selection)
    final, found = selection.fitted, list(named)
    structure = left_over(space)
    curved = with_curves(dataset, selection, structure, progress=progress)
    if curved.effects != selection.effects:
        final = curved.fitted
        space = Space.of(final)
        structure = left_over(space)
        found += [_curve(space, effect) for effect in curved.effects[len(selection.effects) :]]
    chance = p_lack_of_fit(space)
    rows = dataset.validation_rows
    return Diagnosis(
        dataset=dataset,
        base=base,
        final=final,
        nominal=nominal,
        nominal_estimate=nominal_estimate,
        effects=tuple(found),
        verdict=_verdict(found, structure, _fits(space, chance)),
        structure=tuple(structure),
        p_lack_of_fit=chance,
        error_nominal=statistics_of(errors_on(dataset, rows, nominal, nominal_estimate)),
        error_before=statistics_of(errors_on(dataset, rows, base.model, base.estimate)),
        error_after=statistics_of(errors_on(dataset, rows, final.model, final.estimate)),
        notes=_notes(dataset),
        follow_up=_follow_up(dataset, selection.fitted, named),
        power=power,
        seconds=time.perf_counter() - begin,
    )


def _judged(
    dataset: Dataset, selection: Selection
) -> tuple[Selection, Space, list[Found], tuple[Visible, ...]]:
    """Every effect with its evidence, strongest first. Those that the last refit left without any go, weakest first;
    before them, one at a time, those that it left where physics forbids them."""
    while True:
        fitted = selection.fitted
        space = Space.of(fitted)
        forbidden = [effect for effect in selection.effects if space.forbids(effect)]
        if forbidden:
            kept = tuple(e for e in selection.effects if e is not forbidden[0])
            selection = Selection(refit(dataset, fitted, kept), kept)
            continue
        scores = Scores(offers(Survey.of(fitted, dataset)), space)
        chance = chance_by_pose(scores) if selection.effects else None
        found = [_found(dataset, space, scores, effect, selection.effects) for effect in selection.effects]
        if chance is not None:
            found = [replace(f, evidence=f.evidence.at_most_as_sure_as(chance)) for f in found]
        found.sort(key=lambda f: -f.evidence.explained_variance)
        weak = [f for f in found if f.evidence.p_value > CLAIM]
        if not weak:
            return selection, space, found, visible(scores)
        gone = weak[len(weak) // 2 :]
        kept = tuple(e for e in selection.effects if all(e is not f.effect for f in gone))
        selection = Selection(refit(dataset, fitted, kept), kept)


def _screen(dataset: Dataset, base: Identification, selection: Selection) -> Identification:
    """Fit the chosen model to all readings again, those included that the base model could not place."""
    model = selection.fitted.model
    readings = readings_of(dataset, dataset.fit_rows, model, selection.fitted.estimate)
    return fit(dataset, model, readings, selection.fitted.estimate, settled=base.dropped)


def _found(
    dataset: Dataset, space: Space, scores: Scores, effect: Effect, chosen: tuple[Effect, ...]
) -> Found:
    fitted = space.fitted
    positions = fitted.model.positions(effect)
    index = None
    if "rank" in effect.shape:
        row = int(np.flatnonzero(dataset.conditions.order == effect.shape["rank"])[0])
        index = dataset.reading_id[row]
    return Found(
        effect=effect,
        evidence=judge(space, scores, effect, chosen),
        values=fitted.estimate[positions],
        covariance=fitted.covariance[np.ix_(positions, positions)],
        index=index,
    )


def _curve(space: Space, curve: Effect) -> Found:
    """A curve beside the named effects: what it explains that they do not; it has no rivals."""
    _, coefficients = space.own_direction(curve)
    gain, columns = float(coefficients @ coefficients), len(coefficients)
    rss, freedom = space.rss + gain, space.freedom + columns
    positions = space.fitted.model.positions(curve)
    return Found(
        effect=curve,
        evidence=Evidence(
            candidates={curve.label: 1.0},
            effects={curve.label: curve},
            delta_bic=space.rows * float(np.log(rss / space.rss)) - columns * float(np.log(space.rows)),
            p_value=p_value(gain, columns, rss, freedom, space.fitted.model.robot.joints),
            explained_variance=gain / rss,
        ),
        values=space.fitted.estimate[positions],
        covariance=space.fitted.covariance[np.ix_(positions, positions)],
        index=None,
    )


def _follow_up(dataset: Dataset, final: Identification, found: list[Found]) -> FollowUp | None:
    """Poses that would tell the members of every class apart; the weightiest rivals of the strongest effects first."""
    effects = tuple(f.effect for f in found)
    pairs = [
        (f.effect, f.evidence.effects[label])
        for f in found
        if not f.evidence.certain
        for label in list(f.evidence.candidates)[:_MOST_RIVALS]
        if label != f.effect.label
    ][:_MOST_PAIRS]
    rivals = [
        Rival(
            effect.label,
            rival.label,
            refit(dataset, final, tuple(rival if e is effect else e for e in effects)),
        )
        for effect, rival in pairs
    ]
    return follow_up(final, rivals) if rivals else None


def _fits(space: Space, chance: float) -> bool:
    """Whether noise leaves so much: noise as declared or, where readings repeat, as they show it."""
    repeats = p_beyond_repeats(space)
    return chance >= NOISY or (repeats is not None and repeats >= NOISY)


def _verdict(found: list[Found], structure: list[Structure], fits: bool) -> Verdict:
    """No cause is told for certain, and no class, where more is left than noise explains."""
    if structure:
        return "unexplained"
    if not fits:
        return "excess_noise"
    if any(not f.evidence.certain for f in found):
        return "ambiguous"
    return "attributed" if found else "complete"


def _notes(dataset: Dataset) -> tuple[str, ...]:
    """What these readings cannot show, so that nobody takes silence for absence."""
    conditions = dataset.conditions.take(dataset.fit_rows)
    notes = []
    one_sided = [k + 1 for k, side in enumerate(conditions.side.T) if np.all(side == side[0])]
    if one_sided:
        joints = ", ".join(f"J{k}" for k in one_sided)
        notes.append(
            f"Backlash of {joints} is invisible: every reading arrived from one side. It is not absent."
        )
    untimed = int(np.sum(~np.isfinite(dataset.conditions.time)))
    if untimed:
        notes.append(
            f"{untimed} of {len(dataset)} rows carry no time (t_s): drift of the instrument was not looked for."
        )
    cold = int(np.sum(~np.isfinite(dataset.conditions.temperature)))
    if cold:
        notes.append(
            f"{cold} of {len(dataset)} rows carry no temperature (t_air_c): thermal growth was not looked for."
        )
    elif np.ptp(conditions.temperature) < 0.2:
        notes.append("The air temperature hardly moved: thermal growth is invisible here, not absent.")
    if len({int(t) for t in conditions.target}) == 1:
        notes.append("One tool target only: a shifted and a tilted tool look the same.")
    return tuple(notes)
