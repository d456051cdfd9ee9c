"""Diagnosis: identify, search for effects, refit, and judge on held-out readings.

The choice of effects, the refits and the rejection of rows use calibration rows only. Validation rows are predicted at
the end, by the nominal robot in its place, by the base model, and by the model with the effects. `carry_over` judges
the result on another data set of the same robot.

Effects are cross-validated within a data set: each is judged on blocks of readings that the fit has not used.

The readings are cut into blocks of time, which are regions too if the poses follow a path. With H the hat matrix of
the linearised fit, the residual of a fit without block B is, in that block,

    e_B = (I - H_BB)^-1 r_B,        H = Q Q',

so no fit is repeated. Removing an effect from the model removes its direction q from H and returns its share c to the
residual: H - q q', r + q c. Its gain in a block is the decrease of |e_B|^2 when the model includes it.
A random hold-out is optimistic, since every held-out reading has neighbours in the fit. Source: Christensen, Pearson &
Johnson 1992 (case deletion by blocks). Roberts et al. 2017 (reason for blocks).
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from calib.array import Array
from calib.data.dataset import Dataset
from calib.diagnose.carried import CarriedTerm, Shares, competed, readings_back, with_terms
from calib.diagnose.curves import MANY_WAVES, GearCurveFit, beside, gears_to_carry, with_gears
from calib.diagnose.follow_up import FollowUp, follow_up, next_measurements, remarks_of
from calib.diagnose.found import (
    DetectableEffect,
    DiagnosedEffect,
    HeldOutTest,
    errors_without,
    resized,
    surprise_of,
    visible,
    with_shapes,
)
from calib.diagnose.pursuit import PursuitResult
from calib.diagnose.select import (
    MOST_EFFECTS,
    EffectEvidence,
    EffectSelection,
    chance_by_pose,
    judge,
    refit,
    select,
)
from calib.diagnose.structure import (
    ALARM,
    NOISY,
    SUSPECT,
    ResidualStructure,
    each_pose,
    left_over,
    p_beyond_repeats,
    p_lack_of_fit,
    together,
)
from calib.effects import Survey, offers
from calib.errors import DataError
from calib.fit import robust
from calib.fit.held_out import HeldOutFaults, all_readings, errors_on, held_out_faults
from calib.fit.identification import IdentificationFit
from calib.fit.identify import Progress, carry, fit, fit_again, identify, silent, within_type
from calib.fit.least_squares import DroppedParameter, Linearisation, find_dependent, solve
from calib.fit.placing import base_model_of, place_nominal
from calib.fit.readings import FitReadings, readings_of
from calib.fit.statistics import ErrorStatistics, statistics_of, worse
from calib.fit.type_prior import TypeFit, TypePrior, centred
from calib.model.base_model import named_in
from calib.model.effect import Effect
from calib.model.model import BoundModel, ModelStructure
from calib.scan.scores import CLAIM, Scores, Space, p_value
from calib.units import percent

BLOCKS = 8
_FEWEST = 8  # readings per block
_DEALS = 4  # stretches that are dealt to each block
_KNOWN = 1e-9  # keeps a parameter solvable that only one block determines


def in_type(
    dataset: Dataset, fitted: IdentificationFit, beside: TypeFit, found: list[DiagnosedEffect], *, refit: bool
) -> tuple[IdentificationFit, list[DiagnosedEffect]]:
    """Fit the robot with its type prior and the effects found; return fit and findings.

    The argument `beside` is the type fit of the base model. Pass `refit=False` if the model includes curves of gears,
    whose sizes the readings determine: then all values stay as the base model had them.
    """
    if not refit:
        return replace(fitted, beside=beside, warnings=(*beside.warnings(), *fitted.warnings)), found
    base = base_model_of(dataset)
    usual = {p.name: p for e in (*base.effects, *(f.effect for f in found)) for p in e.parameters}

    def again(model: ModelStructure) -> IdentificationFit:
        return fit_again(dataset, fitted, model)

    spoken_for = named_in(base.effects, dataset.header.priors)
    wanted = frozenset(beside.prior.shares) - frozenset(beside.open) - spoken_for
    model = centred(fitted.model, beside.prior, wanted)
    final = within_type(again(model), TypeFit(beside.prior, open=beside.open), usual, again)
    return final, [resized(f, final) for f in found]


Verdict = Literal["complete", "excess_noise", "attributed", "ambiguous", "unexplained"]
_SCREENINGS = 3
_MOST_RIVALS = 5  # rivals of one effect that the follow-up poses distinguish
_MOST_PAIRS = 12
_MANY_FAULTS = 0.02  # share of held-out readings that are faulty, beyond which nothing is called complete
_HARM = 0.02  # share by which the held-out error must be smaller without an effect that does harm


@dataclass(frozen=True)
class DiagnosisFit:
    """Result of a diagnosis: effects, and the errors before and after on validation rows."""

    dataset: Dataset
    base: IdentificationFit
    final: IdentificationFit
    nominal: ModelStructure
    nominal_estimate: Array
    effects: tuple[DiagnosedEffect, ...]
    verdict: Verdict
    structure: tuple[ResidualStructure, ...]
    p_lack_of_fit: float
    error_nominal: ErrorStatistics | None
    error_before: ErrorStatistics | None
    error_named: ErrorStatistics | None  # with the named effects, without the carried terms
    error_after: ErrorStatistics | None
    notes: tuple[str, ...]
    follow_up: FollowUp | None  # what to measure next; None if nothing is ambiguous
    # The smallest detectable size of every effect of the library
    power: tuple[DetectableEffect, ...]
    harmful: tuple[str, ...]  # effects without which the held-out error would be smaller
    surprise: HeldOutTest | None  # held-out error compared with the expectation from noise and parameters
    carried: tuple[
        CarriedTerm, ...
    ]  # the terms of the final model without a name, the one that explains most first
    withdrawn: tuple[str, ...]  # names that the search found and that carried terms explain better
    shares: Shares
    held_out_faults: HeldOutFaults  # held-out readings that are faulty
    back: tuple[str, ...]  # rejected readings that came back, since they cluster
    seconds: float

    @property
    def agrees(self) -> bool | None:
        """Whether held-out readings agree with the final model; None without any."""
        return None if self.surprise is None else not self.surprise.real

    @property
    def gain(self) -> tuple[ErrorStatistics | None, ErrorStatistics | None]:
        """Held-out errors of the nominal robot in its place and of the final model.

        Faulty readings are left out.
        """
        rows = self.dataset.validation_rows & ~self.held_out_faults.rows
        nominal = errors_on(self.dataset, rows, self.nominal, self.nominal_estimate)
        return statistics_of(nominal), self.held_out_faults.error_without

    @property
    def worse_than_nominal(self) -> bool:
        """Whether the final model has a larger held-out error than the nominal robot in its place."""
        nominal, found = self.gain
        return worse(found, nominal)

    @property
    def by_repeats(self) -> bool:
        """Whether the verdict uses the noise of repeated visits instead of the declared one."""
        return self.p_lack_of_fit < NOISY and self.verdict in ("complete", "attributed", "ambiguous")

    @property
    def causes_known(self) -> bool:
        """Whether the effects found explain the readings and do not only imitate another law."""
        return self.verdict not in ("unexplained", "excess_noise")

    @property
    def confirmed(self) -> tuple[DiagnosedEffect, ...]:
        """Effects whose size exceeds its expanded uncertainty."""
        return tuple(found for found in self.effects if found.confirmed)

    @property
    def next_measurements(self) -> tuple[str, ...]:
        """Recommended next measurements as sentences; empty if the causes are known."""
        if self.causes_known:
            return ()
        return next_measurements((left.where, left.acts_on) for left in self.structure)

    @property
    def held_out(self) -> FitReadings | None:
        """Readings of the validation set for the final model; None without any."""
        rows = self.dataset.validation_rows
        return readings_of(self.dataset, rows, self.final.model, self.final.estimate) if rows.any() else None

    @property
    def stretch(self) -> float | None:
        """Held-out error divided by the residual of the fit on its own points; see `surprise`."""
        observed = self.final.readings.observed
        held_out = self.held_out_faults.error_without
        if held_out is None or observed.points is None or observed.lengths is not None:
            return None
        design = BoundModel(self.final.model, self.final.readings.conditions)
        left = observed.points - design.frames(self.final.estimate, ()).p
        return held_out.rms / float(np.sqrt(np.mean(np.sum(left**2, axis=0))))


def diagnose(
    dataset: Dataset,
    *,
    most: int = MOST_EFFECTS,
    prior: TypePrior | None = None,
    progress: Progress = silent,
) -> DiagnosisFit:
    """Find the effects that the base model of a data set lacks.

    The argument `prior` is the prior of the robot type.

    Raises
    ------
    DataError
        The base model cannot be identified, or the prior belongs to another type.
    """
    begin = time.perf_counter()
    base = identify(dataset, prior=prior, progress=progress)
    nominal, nominal_estimate = place_nominal(dataset, base_model_of(dataset))
    selection, curves = _search(dataset, base, most, progress)
    progress("weighing rivals of every effect")
    selection, space, named, power = _judged(dataset, selection)
    searched, chosen = selection.effects, PursuitResult()
    readings, back = readings_back(dataset, selection.fitted)
    if curves is None:
        progress("comparing names with everything that left-out readings confirm")
        chosen, holding = competed(base, readings, dataset.conditions, searched)
        if len(holding) < len(searched):
            fitted = _arrived(dataset, refit(dataset, selection.fitted, holding))
            selection, space = EffectSelection(fitted, holding), Space.of(fitted)
            labels = {e.label for e in holding}
            named = [resized(f, fitted) for f in named if f.effect.label in labels]
    named = with_shapes(dataset, selection.fitted, named)
    structure = _structure(dataset, space)
    if curves is not None:
        curves = beside(selection.fitted, curves.sizes)
    elif structure and not chosen.choices:
        curves = with_gears(dataset, selection.fitted, gears_to_carry(base, dataset), progress=progress)
        space = space if curves is None else Space.of(curves.held)
        structure = structure if curves is None else _structure(dataset, space)
    final = selection.fitted if curves is None else curves.fitted
    if base.beside is not None:
        final, named = in_type(dataset, final, base.beside, named, refit=curves is None)
    layers = with_terms(dataset, final, readings, chosen)
    structure = layers.places(structure) if layers.terms else structure
    of_gears = [] if curves is None else [_curve(curves, curve) for curve in curves.curves.values()]
    found = sorted([*of_gears, *named], key=lambda f: -f.evidence.explained_variance)
    faults = held_out_faults(dataset, layers.fitted)
    surprise = surprise_of(dataset, layers.fitted, faults.rows)
    rows = dataset.validation_rows
    return DiagnosisFit(
        dataset=dataset,
        base=base,
        final=layers.fitted,
        nominal=nominal,
        nominal_estimate=nominal_estimate,
        effects=tuple(found),
        verdict=_verdict(found, structure, fits=_fits(space), holds=_holds(surprise, faults)),
        structure=tuple(structure),
        p_lack_of_fit=p_lack_of_fit(space),
        error_nominal=statistics_of(errors_on(dataset, rows, nominal, nominal_estimate)),
        error_before=statistics_of(errors_on(dataset, rows, base.model, base.estimate)),
        error_named=statistics_of(errors_on(dataset, rows, final.model, final.estimate)),
        error_after=statistics_of(errors_on(dataset, rows, layers.fitted.model, layers.fitted.estimate)),
        notes=(*_notes(dataset), *remarks_of(dataset, layers.fitted)),
        follow_up=_follow_up(dataset, selection.fitted, named),
        power=power,
        harmful=_harmful(dataset, layers.fitted, found),
        surprise=surprise,
        held_out_faults=faults,
        carried=layers.terms,
        withdrawn=tuple(e.label for e in searched if all(e.label != f.effect.label for f in found)),
        shares=Shares.of(base, final, layers.fitted),
        back=tuple(dataset.reading_id[i] for i in back) if layers.terms else (),
        seconds=time.perf_counter() - begin,
    )


def _search(
    dataset: Dataset, base: IdentificationFit, most: int, progress: Progress
) -> tuple[EffectSelection, GearCurveFit | None]:
    """Find effects that stay when readings are screened again, and the curves fitted with them."""
    progress("searching")
    joints = gears_to_carry(base, dataset)
    selection = _screened(
        dataset, EffectSelection(base, ()), most, MANY_WAVES if joints else math.inf, progress
    )
    if not selection.crowded:
        return selection, None
    carried = with_gears(dataset, base, joints, progress=progress)
    if carried is None:
        return _screened(dataset, EffectSelection(base, ()), most, math.inf, progress), None
    progress("searching on what the curves leave")
    held = carried.held
    names = tuple(e for e in held.model.effects if e.group != "base model")
    start = EffectSelection(refit(dataset, held, names), names)
    return _screened(dataset, start, most, math.inf, progress), carried


def _screened(
    dataset: Dataset, selection: EffectSelection, most: int, crowd: float, progress: Progress
) -> EffectSelection:
    """Search and screen the readings again until they stay the same."""
    dropped = selection.fitted.dropped
    for _ in range(_SCREENINGS):
        selection = select(dataset, selection.fitted, progress=progress, most=most, crowd=crowd)
        if not selection.effects or selection.crowded:
            break
        progress("screening readings again with the effects in the model")
        screened = _screen(dataset, dropped, selection)
        unchanged = screened.faulty_rows == selection.fitted.faulty_rows
        selection = replace(selection, fitted=screened)
        if unchanged:
            break
    return selection


def _judged(
    dataset: Dataset, selection: EffectSelection
) -> tuple[EffectSelection, Space, list[DiagnosedEffect], tuple[DetectableEffect, ...]]:
    """Judge every effect, strongest first.

    Physically impossible effects are removed first, one at a time. Then effects without evidence after the last refit,
    or without gain on left-out blocks, are removed, weakest first.
    """
    while True:
        fitted = _arrived(dataset, selection.fitted)
        selection = replace(selection, fitted=fitted)
        space = Space.of(fitted)
        forbidden = [effect for effect in selection.effects if space.forbids(effect)]
        if forbidden:
            kept = tuple(e for e in selection.effects if e is not forbidden[0])
            selection = EffectSelection(refit(dataset, fitted, kept), kept)
            continue
        scores = Scores(offers(Survey.of(fitted, dataset)), space)
        chance = chance_by_pose(scores) if selection.effects else None
        found = [_found(dataset, space, scores, effect, selection.effects) for effect in selection.effects]
        if chance is not None:
            found = [replace(f, evidence=f.evidence.at_most_as_sure_as(chance)) for f in found]
        found.sort(key=lambda f: -f.evidence.explained_variance)
        carried = carried_gains(space, selection.effects, Blocks.random_blocks(space)).sum(axis=1)
        idle = {e.label for e, gain in zip(selection.effects, carried, strict=True) if gain <= 0.0}
        weak = [f for f in found if f.evidence.p_value > CLAIM or f.effect.label in idle]
        if not weak:
            return selection, space, found, visible(scores)
        gone = weak[len(weak) // 2 :]
        kept = tuple(e for e in selection.effects if all(e is not f.effect for f in gone))
        selection = EffectSelection(refit(dataset, fitted, kept), kept)


def _arrived(dataset: Dataset, fitted: IdentificationFit) -> IdentificationFit:
    """Let a fit converge: between choices it takes only a few steps, too few for large effects."""
    return fitted if fitted.converged else fit_again(dataset, fitted, fitted.model)


def _screen(
    dataset: Dataset, dropped: tuple[DroppedParameter, ...], selection: EffectSelection
) -> IdentificationFit:
    """Fit the chosen model to all readings again, including those that the base model rejected."""
    model = selection.fitted.model
    readings = readings_of(dataset, dataset.fit_rows, model, selection.fitted.estimate)
    return fit(dataset, model, readings, selection.fitted.estimate, settled=dropped)


def _found(
    dataset: Dataset, space: Space, scores: Scores, effect: Effect, chosen: tuple[Effect, ...]
) -> DiagnosedEffect:
    fitted = space.fitted
    positions = fitted.model.positions(effect)
    index = None
    if "rank" in effect.shape:
        row = int(np.flatnonzero(dataset.conditions.order == effect.shape["rank"])[0])
        index = dataset.reading_id[row]
    return DiagnosedEffect(
        effect=effect,
        evidence=judge(space, scores, effect, chosen),
        values=fitted.estimate[positions],
        covariance=fitted.covariance[np.ix_(positions, positions)],
        index=index,
    )


def _curve(carried: GearCurveFit, curve: Effect) -> DiagnosedEffect:
    """Judge the curve of a gear by its own contribution; it has no rivals."""
    fitted = carried.fitted
    positions = fitted.model.positions(curve)
    values, covariance = fitted.estimate[positions], fitted.covariance[np.ix_(positions, positions)]
    noise = max(fitted.noise_scale, 1.0) ** 2
    gain = noise * float(values @ np.linalg.solve(covariance, values))
    columns = max(round(float(carried.determined[positions].sum())), 1)
    rss = float(np.sum(fitted.residual**2)) + gain
    rows = fitted.readings.observed.count
    return DiagnosedEffect(
        effect=curve,
        evidence=EffectEvidence(
            candidates={curve.label: 1.0},
            effects={curve.label: curve},
            delta_bic=rows * float(np.log(rss / (rss - gain))) - columns * float(np.log(rows)),
            p_value=p_value(
                gain, columns, rss, fitted.degrees_of_freedom + columns, fitted.model.robot.joints
            ),
            explained_variance=gain / rss,
        ),
        values=values,
        covariance=covariance,
        index=None,
    )


def _follow_up(dataset: Dataset, final: IdentificationFit, found: list[DiagnosedEffect]) -> FollowUp | None:
    """Find poses that distinguish the members of every class, strongest effects first."""
    effects = tuple(f.effect for f in found)
    pairs = [
        (f.effect, f.evidence.effects[label])
        for f in found
        if not f.evidence.certain
        for label in list(f.evidence.candidates)[:_MOST_RIVALS]
        if label != f.effect.label
    ][:_MOST_PAIRS]
    rivals = {
        (effect.label, rival.label): refit(
            dataset, final, tuple(rival if e is effect else e for e in effects)
        )
        for effect, rival in pairs
    }
    return follow_up(final, rivals) if rivals else None


def _structure(dataset: Dataset, space: Space) -> list[ResidualStructure]:
    """Find structure along drivers, in the place of rejected readings, or in each pose.

    The tests along drivers include the readings that the fit left out.
    """
    alarm = ALARM if p_lack_of_fit(space) >= NOISY else SUSPECT
    readings, out = all_readings(dataset, space.fitted)
    if not out.any():
        return left_over(space, alarm) or each_pose(space)
    whole = Space.of(replace(space.fitted, readings=readings))
    return [*left_over(whole, alarm), *together(whole, out)] or each_pose(space)


def _fits(space: Space) -> bool:
    """Check that noise explains the residual: the declared noise, or that of repeated readings."""
    repeats = p_beyond_repeats(space)
    return p_lack_of_fit(space) >= NOISY or (repeats is not None and repeats >= NOISY)


def _verdict(
    found: list[DiagnosedEffect], structure: list[ResidualStructure], *, fits: bool, holds: bool
) -> Verdict:
    """Return the verdict: nothing is certain if noise or held-out readings contradict it."""
    if structure:
        return "unexplained"
    if not fits:
        return "excess_noise"
    if any(not f.evidence.certain for f in found):
        return "ambiguous"
    if not holds:
        return "excess_noise"
    return "attributed" if found else "complete"


def _holds(surprise: HeldOutTest | None, faults: HeldOutFaults) -> bool:
    """Check that the held-out error is as expected, and that few held-out readings are faulty."""
    many = len(faults.faults) > _MANY_FAULTS * max(faults.error_without.n if faults.error_without else 0, 1)
    return not (many or (surprise is not None and surprise.real))


def _harmful(dataset: Dataset, final: IdentificationFit, found: list[DiagnosedEffect]) -> tuple[str, ...]:
    """List effects that increase the held-out error; they stay, as validation decides nothing."""
    whole = statistics_of(errors_on(dataset, dataset.validation_rows, final.model, final.estimate))
    if whole is None:
        return ()
    effects = [f.effect for f in found]
    without = dict(zip((e.label for e in effects), errors_without(dataset, final, effects), strict=True))
    return tuple(label for label, e in without.items() if e is not None and e.rms < (1.0 - _HARM) * whole.rms)


def _notes(dataset: Dataset) -> tuple[str, ...]:
    """List effects that these readings cannot show: not found does not mean absent."""
    conditions = dataset.conditions.take(dataset.fit_rows)
    notes = []
    axes = dataset.header.robot.axes
    if dataset.weightless:
        joints = ", ".join(axes[k - 1].upper() for k in dataset.weightless)
        notes.append(
            f"Gravity is not modelled, since no masses are known: no gear, play or stiffness of {joints} is named, "
            "because sag looks like them. Give [[loads]] in the header, or the mass of the arm with "
            "'truepose robot import --mass'."
        )
    one_sided = [
        axis.upper() for axis, side in zip(axes, conditions.side.T, strict=True) if np.all(side == side[0])
    ]
    if one_sided:
        joints = ", ".join(one_sided)
        notes.append(
            f"Backlash of {joints} is invisible: every reading arrived from one side. It is not absent."
        )
    if not dataset.arrivals_told:
        notes.append(
            "The order of the rows was taken for the way of the robot: the file has neither approach1 .. nor "
            "prev1_deg ... Where it went over points between, backlash and settling look like noise. With these "
            "columns they are found where they are."
        )
    untimed = int(np.sum(~np.isfinite(dataset.conditions.time)))
    if untimed:
        notes.append(
            f"{untimed} of {len(dataset)} rows carry no time (t_s): what moved or crept between two of them, drift of "
            "the instrument and warming up were not looked for as causes; terms of the order of the rows may be "
            "carried. With the times such causes are found, and rows of several files come into their order."
        )
    cold = int(np.sum(~np.isfinite(dataset.conditions.temperature)))
    if cold:
        notes.append(
            f"{cold} of {len(dataset)} rows carry no temperature (t_air_c): thermal growth was not looked for. With "
            "the temperature of the air at every reading it is found, and corrected on warmer and colder days."
        )
    elif np.ptp(conditions.temperature) < 0.2:
        notes.append("The air temperature hardly moved: thermal growth is invisible here, not absent.")
    if len({int(t) for t in conditions.target}) == 1:
        notes.append("One tool target only: a shifted and a tilted tool look the same.")
    return tuple(notes)


@dataclass(frozen=True)
class CarryOver:
    """Errors on the validation rows of the other data set, mm."""

    name: str
    base: ErrorStatistics | None
    frozen: ErrorStatistics | None
    refitted: ErrorStatistics | None

    @property
    def finding(self) -> str:
        """Carry-over as a sentence; empty if the other set has no validation rows."""
        if self.base is None or self.frozen is None or self.refitted is None:
            return ""
        frozen, refitted = (1.0 - errors.rms / self.base.rms for errors in (self.frozen, self.refitted))
        if frozen <= 0.0:
            said = (
                f"Frozen as found, the effects do not carry over: they raise the error by {percent(-frozen)}."
            )
        else:
            said = f"Frozen as found, the effects take {percent(frozen)} of the base model's error away."
        if refitted <= 0.0:
            return f"{said} Fitted anew, their amplitudes do not help either."
        return f"{said} With their amplitudes fitted anew they take {percent(refitted)} away."


def carry_over(diagnosis: DiagnosisFit, other: Dataset) -> CarryOver:
    """Judge the effects of `diagnosis` on another data set of the same robot.

    Raises
    ------
    DataError
        The data set is of another robot.
    """
    if other.header.robot.name != diagnosis.dataset.header.robot.name:
        raise DataError(
            f"is of the robot '{other.header.robot.name}', not '{diagnosis.dataset.header.robot.name}'.",
            do="Give another data set of the same robot.",
            file=other.path,
            key="robot",
        )
    own = identify(other)
    found = (*(f.effect for f in diagnosis.effects), *(t.effect for t in diagnosis.carried))
    effects = tuple(e for e in found if _carries(e))
    effects = (*(e for e in effects if not e.is_curve), *(e for e in effects if e.is_curve))
    base = base_model_of(other)
    model = replace(base, effects=(*base.effects, *effects))
    placed, placed_estimate = place_nominal(other, base)
    start = carry(placed, placed_estimate, model)
    final = diagnosis.final.model
    for effect in model.effects:
        if effect.owner == "robot":
            for parameter in effect.parameters:
                if parameter.name in final.index:
                    start[model.index[parameter.name]] = diagnosis.final.estimate[final.index[parameter.name]]
    mounting = [i for e in model.effects if e.owner == "mounting" for i in model.positions(e)]
    frozen = _fit(other, model, start, mounting, own)
    refitted = _fit(other, model, start, range(len(start)), own)
    rows = other.validation_rows
    return CarryOver(
        name=other.name,
        base=statistics_of(errors_on(other, rows, own.model, own.estimate)),
        frozen=statistics_of(errors_on(other, rows, model, frozen)),
        refitted=statistics_of(errors_on(other, rows, model, refitted)),
    )


def _carries(effect: Effect) -> bool:
    """Check if an effect applies to other sessions: gears and mounting do, drifts do not.

    Drifts, steps and temperatures belong to one session. An effect that tilts or loads the arm shares its columns with
    the compliances, which would absorb a part of it if it were left out.
    """
    if effect.is_carried:
        return effect.is_usable and effect.owner == "robot"
    return effect.owner != "instrument" and effect.group != "thermal" and "rank" not in effect.shape


def _fit(
    other: Dataset, model: ModelStructure, start: Array, free: list[int] | range, own: IdentificationFit
) -> Array:
    """Fit the `free` parameters to the readings that agree with the other set's own base model."""
    belongs = np.zeros(len(other), dtype=bool)
    belongs[own.readings.rows] = True
    readings = readings_of(other, belongs, model, start)
    design = BoundModel(model, readings.conditions)
    observed = readings.observed
    # The sizes from evidence limit the gear curves in directions that these readings do not determine.
    others = replace(model, effects=tuple(e for e in model.effects if not e.is_curve))
    active = np.ones(len(start), dtype=bool)
    count = len(others.parameters)
    active[:count], dropped = find_dependent(
        Linearisation(BoundModel(others, readings.conditions), observed, start[:count])
    )
    allowed = np.zeros(len(start), dtype=bool)
    allowed[list(free)] = True
    at = Linearisation(design, observed, start)
    for _ in range(2):
        at = solve(at, active & allowed, dropped, scale=robust.noise_scale(at.residual, observed.freedom)).at
    return at.estimate


@dataclass(frozen=True)
class Blocks:
    """Block of each reading (n,), and the number of blocks."""

    of_reading: NDArray[np.int64]
    count: int

    @classmethod
    def of(cls, space: Space, count: int = BLOCKS) -> Blocks:
        """Build blocks of equal length in the order of the readings."""
        order = space.fitted.readings.conditions.order
        n = len(order)
        count = max(2, min(count, n // _FEWEST))
        rank = np.argsort(np.argsort(order))
        return cls(rank * count // n, count)

    @classmethod
    def random_blocks(cls, space: Space) -> Blocks:
        """Deal short stretches of whole poses, in the order of their first visit, to the blocks.

        No pose is in two blocks, and no block contains all readings that show a step.
        """
        conditions = space.fitted.readings.conditions
        pose = conditions.pose
        first = np.full(int(pose.max()) + 1, np.inf)
        np.minimum.at(first, pose, conditions.order)
        rank = np.argsort(np.argsort(first, kind="stable"), kind="stable")
        return cls((rank * (_DEALS * BLOCKS) // len(first) % BLOCKS)[pose], BLOCKS)


def carried_gains(space: Space, effects: tuple[Effect, ...], blocks: Blocks) -> Array:
    """Compute the gain (effects, blocks) of each effect on each left-out block.

    The gain is the decrease of the squared error, whitened for declared noise. It is negative if the effect does harm
    to readings that it was not fitted to.
    """
    shape = space.residual.shape
    data, whole = space.residual.ravel(), space.basis_of_readings
    own = [space.own_coordinates(effect) for effect in effects]
    gains = np.zeros((len(effects), blocks.count))
    for b in range(blocks.count):
        rows = np.broadcast_to(blocks.of_reading == b, shape).ravel()
        q, r = whole[rows], data[rows]
        gram = q.T @ q
        with_all = _left_out(gram, q.T @ r, float(r @ r))
        for i, (t, c) in enumerate(own):
            # without the effect: basis coordinates lose span(t); the residual gains q t c
            back = q @ (t @ c)
            without = r + back
            keep = np.eye(len(gram)) - t @ t.T
            gains[i, b] = (
                _left_out(keep @ gram @ keep, keep @ (q.T @ without), float(without @ without)) - with_all
            )
    return gains


def _left_out(gram: Array, shared: Array, square: float) -> float:
    """Compute |e_B|^2 from Q_B'Q_B, Q_B'r_B and r_B'r_B without e = r + Q (I - G)^-1 Q'r."""
    x = np.linalg.solve((1.0 + _KNOWN) * np.eye(len(gram)) - gram, shared)
    return square + 2.0 * float(shared @ x) + float(x @ gram @ x)
