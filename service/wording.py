"""Texts of numbers and findings, the same on the terminal, in the report and on the page."""

from __future__ import annotations

import math
from collections.abc import Sequence

from calib.data import Dataset
from calib.diagnose import (
    ACTS_ON,
    COVERAGE,
    EACH_POSE,
    TOGETHER,
    CarriedTerm,
    DiagnosedEffect,
    DiagnosisFit,
    HeldOutTest,
    ResidualStructure,
    Shares,
)
from calib.effects import check_of
from calib.fit import ErrorStatistics, HeldOutFaults
from calib.regression import Patch
from calib.units import percent
from service import effect_names

GROUPS = ("transmission", "structure", "frames and tool", "instrument", "thermal", "procedure")
MANY = 6  # effects above which lists are ordered by group
_CARRIED = 8  # carried terms that are stated one by one
_FAULTS_SHOWN = 8  # faulty held-out readings that are listed
_STRETCHED = 1.5
_AS_DECLARED = 0.001  # p-value of lack of fit; from this value on, the noise is as declared

HOLDOUTS = {
    "random": "random rows of the same series: flatters, since the neighbours of every row took part in the fit",
    "block": "whole time blocks of the same series",
    "as measured": "the validation rows that the data set names",
}
OWNERS = {"robot": "the robot", "mounting": "the mounting of base or tool", "instrument": "the instrument"}
CLOSING = (
    "That these tests detect nothing is no verdict of acceptance: that is given against limits alone. "
    "This report relates only to this robot, this set-up and these readings."
)


POSITION_ERROR = "Position error"


def error_kind(dataset: Dataset) -> str:
    """Name the quantity to which the errors of a data set refer: position or distance."""
    return POSITION_ERROR if dataset.pointed.any() else "Error of the distance"


def holdout_in_words(kind: str) -> str:
    """Describe the kind of hold-out on which the results are based."""
    return HOLDOUTS.get(kind, kind)


def holdout_of(dataset: Dataset) -> str:
    """Describe what a data set holds out."""
    kind = dataset.header.holdout
    return holdout_in_words(kind) if dataset.validation_rows.any() else "none of its readings"


SIMULATED = "SIMULATED: these readings come from a simulated robot and instrument, not from a real one."


def with_uncertainty(value: float, uncertainty: float) -> tuple[str, str]:
    """Format a value and its uncertainty, both to the second significant digit of the latter."""
    if not (math.isfinite(uncertainty) and uncertainty > 0.0):
        return f"{value:.4g}", "0"
    decimals = 1 - math.floor(math.log10(uncertainty))
    rounded = round(uncertainty, decimals)
    decimals = 1 - math.floor(math.log10(rounded)) if rounded > 0.0 else decimals
    places = max(decimals, 0)
    # + 0.0: a value that rounds to zero has no sign
    return f"{round(value, decimals) + 0.0:.{places}f}", f"{rounded:.{places}f}"


def two_figures(value: float) -> str:
    """Format a size to two significant digits, up to six digits without exponent: 530."""
    return f"{float(f'{value:.2g}'):g}"


def counted(count: int, what: str) -> str:
    """Return a count with its noun, such as "1 reading" or "3 readings"."""
    return f"{count} {what}" if count == 1 else f"{count} {what}s"


def chance(p: float) -> str:
    """Format a p-value; a value below 1e-12 is only reported as such."""
    if p < 1e-12:
        return "< 1e-12"
    return f"{p:.2g}"


def millimetres(value: float) -> str:
    """Format a length in mm with three decimals, from 10 mm with two."""
    return f"{value:.3f}" if abs(value) < 10.0 else f"{value:.2f}"


def amplitude(found: DiagnosedEffect) -> tuple[str, str, str]:
    """Format the size of an effect, its expanded uncertainty (k = 2) and its unit."""
    value, spread, unit = found.amplitude
    return (*with_uncertainty(value, COVERAGE * spread), unit)


def usual_size(found: DiagnosedEffect) -> str:
    """Format the usual size of an effect with its unit; empty if none is known."""
    return "" if found.usual is None else f"{found.usual:.2g} {found.amplitude[2]}"


_SHAPES = {"time_constant_s": ("time constant", "s"), "order": ("order", "per turn")}


def shape_of(found: DiagnosedEffect) -> str:
    """Format the shape of an effect that was scanned.

    That is a time constant or an order with its uncertainty (k = 2), or the moment of a change.
    """
    if found.between is not None:
        return f"between readings {found.between[0]} and {found.between[1]} (95\u00a0%)"
    if found.index is not None:
        return f"from reading {found.index} on"
    parts = []
    for name, std in found.shape_std.items():
        words, unit = _SHAPES.get(name, (name, ""))
        value, uncertainty = with_uncertainty(found.effect.shape[name], COVERAGE * std)
        parts.append(f"{words} {value} ± {uncertainty} {unit}".rstrip())
    return ", ".join(parts)


IMPOSSIBLE = "This value is physically impossible: another effect is imitated by it."


def advice_on(found: DiagnosedEffect, *, causes_known: bool) -> str:
    """Return the check that a technician should make for an effect.

    The text is empty if the causes are not known, or if the size is impossible, usual or not confirmed.
    """
    if not causes_known or found.impossible or not (found.confirmed and found.beyond_usual):
        return ""
    return check_of(found.effect.label)


def unconfirmed(found: Sequence[DiagnosedEffect]) -> str:
    """List the effects that are smaller than their uncertainty in one sentence; empty if none."""
    listed = [
        f"{each.effect.label} {value} ± {uncertainty} {unit}"
        for each in found
        if not each.confirmed
        for value, uncertainty, unit in [amplitude(each)]
    ]
    return f"Not confirmed (smaller than the uncertainty U): {'; '.join(listed)}." if listed else ""


def sentence_of(found: DiagnosedEffect) -> str:
    """Describe one effect in a sentence: meaning, size, and its shape or start."""
    value, uncertainty, unit = amplitude(found)
    text = f"{found.effect.meaning.rstrip('.')}: {value} ± {uncertainty} {unit} (k = {COVERAGE:g})"
    shape = shape_of(found)
    text += f", {shape}." if shape else "."
    return f"{text} {IMPOSSIBLE}" if found.impossible else text


def rivals_of(found: DiagnosedEffect) -> list[tuple[str, float]]:
    """List the rival explanations of an effect with weights of at least 1 %, heaviest first."""
    return [
        (label, w)
        for label, w in found.evidence.candidates.items()
        if label != found.effect.label and w >= 0.01
    ]


def carried_in_words(term: CarriedTerm) -> str:
    """Describe place, condition and size of a carried term in a sentence that claims no cause."""
    value, std, unit = term.effect.amplitude(term.values, term.covariance)
    size, uncertainty = with_uncertainty(value, COVERAGE * std)
    share = f"{share_in_words(term.explained)} of what the named effects leave"
    if term.between is not None:
        where = f"{term.place[:1].upper()}{term.place[1:]} changed by"
        when = f" between readings {term.between[0]} and {term.between[1]}"
    else:
        where, when = f"An error of {term.place} follows {term.condition}, with a size of", ""
    return f"{where} {size} ± {uncertainty} {unit}{when} (k = {COVERAGE:g}): {share}."


def stated_carried(terms: Sequence[CarriedTerm]) -> list[str]:
    """Describe the largest carried terms that exceed their uncertainty, one sentence each.

    A last sentence counts the other terms of the model.
    """
    stated = [term for term in terms if exceeds(term)][:_CARRIED]
    others = len(terms) - len(stated)
    rest = f"{counted(others, 'other term')} of the model, smaller or within U: no single one is a finding."
    return [*(carried_in_words(term) for term in stated), *([rest] if others else [])]


def exceeds(term: CarriedTerm) -> bool:
    """Return whether the size of a carried term exceeds its expanded uncertainty."""
    value, std, _ = term.effect.amplitude(term.values, term.covariance)
    return abs(value) > COVERAGE * std


def shares_in_words(shares: Shares, *, causes_known: bool) -> str:
    """Describe the parts of the squared error that the base model leaves, in one sentence."""
    named = (
        "explained by a named cause"
        if causes_known
        else "taken up by effects that may only imitate its cause"
    )
    return (
        f"Of the squared error that the base model leaves, {percent(shares.named)} is {named}, "
        f"{percent(shares.carried)} is carried without a cause, and {percent(shares.noise)} is noise."
    )


def by_group(found: Sequence[DiagnosedEffect]) -> list[tuple[str, list[DiagnosedEffect]]]:
    """Group the effects in the order of GROUPS; up to MANY effects form one unnamed group."""
    if len(found) <= MANY:
        return [("", list(found))]
    groups = {group: [f for f in found if f.effect.group == group] for group in GROUPS}
    return [(group, members) for group, members in groups.items() if members]


def patch_in_words(patch: Patch) -> str:
    """Describe the gain of a residual map on periods to which it was not fitted."""
    change = patch.block_rms_with / patch.block_rms_without - 1.0 if patch.block_rms_without > 0.0 else 0.0
    text = (
        "A smooth map of what no named effect explains: a patch, not a cause, and nothing beyond the measured poses. "
        f"On stretches of time left out of it, what is left changes by {100.0 * change:+.0f}\u00a0%, from "
        f"{millimetres(patch.block_rms_without)} to {millimetres(patch.block_rms_with)} mm RMS."
    )
    return text + ("" if patch.worth_it else " That is not worth having: leave it out.")


def gain_in_words(before: ErrorStatistics | None, after: ErrorStatistics | None) -> str:
    """Describe the change of the held-out error in a sentence; empty if nothing was held out."""
    if before is None or after is None:
        return ""
    change = after.rms / before.rms - 1.0 if before.rms > 0.0 else 0.0
    if abs(change) < 0.005:
        return f"The held-out error stays at {millimetres(after.rms)} mm RMS."
    verb = "falls" if change < 0.0 else "rises"
    return (
        f"The held-out error {verb} by {percent(abs(change))}, from {millimetres(before.rms)} to "
        f"{millimetres(after.rms)} mm RMS (n = {after.n})."
    )


def share_in_words(share: float) -> str:
    """Format a share in percent with one decimal; a small share never reads 0.0 %."""
    return "less than 0.1\u00a0%" if share < 0.0005 else percent(share, 1)


def structure_in_words(left: ResidualStructure) -> str:
    """Describe one place where structure remains, with its p-value."""
    share, sure = share_in_words(left.explained_variance), f"(p {chance(left.p_value)})"
    if left.acts_on == ACTS_ON:
        return f"The readings left out lie together: {left.where} explains {share} of which they are {sure}."
    return f"Structure is left: {left.where} explains {share} of what is left {sure}."


_OF_TWO = (
    "overturning moment",
    "direction of the tool",
    "direction of view",
)  # places that depend on two quantities, in addition to pairs of angles


def structure_caption(left: ResidualStructure) -> str:
    """Return the caption of the picture that shows remaining structure."""
    if left.acts_on == ACTS_ON:
        return f"The readings that were left out among the others, over {left.where}: gross errors would lie anywhere."
    means = "rings are means with their expanded uncertainty (k = 2)"
    if left.where.startswith("region"):
        return (
            "What is left in the workspace: means of neighbouring readings as arrows, many times their size."
        )
    if left.where == TOGETHER:
        of_what = (
            f"the error of {left.acts_on}" if left.acts_on.startswith("joint ") else "its parts in the world"
        )
        return (
            f"What is left over {left.where}: means of {of_what} over the three angles that tell most of it, in "
            "squares of two, one map for each third of the readings by the other."
        )
    if left.where.endswith(" angles") or left.where in _OF_TWO:
        return f"What is left over {left.where}: means of its three parts in the world, in squares of both quantities."
    if left.where == EACH_POSE:
        return (
            "What is left at the poses that were visited again, those with the largest errors of their own first: "
            f"{means} over their visits."
        )
    if left.where == "tool target":
        return f"What is left at every tool target, its three parts in the world: {means}."
    axes = "along the axes of the tool" if "side of the tool" in left.where else "in the world"
    return f"What is left over {left.where}, its three parts {axes}, one dot a reading; {means}."


def verdict_in_words(diagnosis: DiagnosisFit) -> str:
    """Describe the verdict of a diagnosis in plain sentences, with the gain of its effects."""
    names = [found.effect.label for found in diagnosis.confirmed]
    listed = effect_names.listed(diagnosis.confirmed)
    found = f"Found {counted(len(names), 'effect')} that the base model lacks: {listed}."
    if not names:
        found = "Effects were added to the model, but none of them exceeds its uncertainty."
    imitated = f" It may only be imitated by: {listed}." if names else ""
    before, after, lost = diagnosis.error_before, diagnosis.error_after, is_lost(diagnosis)
    surprised = diagnosis.surprise is not None and diagnosis.surprise.real
    where = "; ".join(f"{s.where}, acting on {s.acts_on}" for s in diagnosis.structure[:2])
    noise = "noise" if names else "the noise"
    if diagnosis.by_repeats:
        noise = f"the noise that visits of the same pose show, {diagnosis.final.noise_scale:.2g} times the declared"
    beyond = (
        f"The readings scatter {diagnosis.final.noise_scale:.2f} times as much as declared. No structure shows where "
        "it comes from: the noise is larger than declared, or a law outside the library is at work."
    )
    if diagnosis.p_lack_of_fit >= _AS_DECLARED:
        beyond = "The model explains the readings of the fit to the noise, but not all of those that were held out."
    head = {
        "complete": f"Nothing was found: the base model explains these readings to {noise}. "
        "The report lists how large an effect of each kind must be to show in them.",
        "excess_noise": beyond + imitated,
        "attributed": found + ("" if lost or surprised else f" Nothing else is left beyond {noise}."),
        "ambiguous": f"{found} These poses cannot say which member of a class it is; "
        "the weights of all members are listed.",
        "unexplained": f"Structure is left that no effect explains ({where})."
        + (imitated or " No effect of the library fits."),
    }[diagnosis.verdict]
    gain, warning = (
        gain_in_words(before, after),
        _not_carried(lost, diagnosis.harmful, len(diagnosis.effects)),
    )
    shares = ""
    if diagnosis.effects or diagnosis.carried:
        shares = shares_in_words(diagnosis.shares, causes_known=diagnosis.causes_known or not names)
    parts = [warning, gain, head, shares] if lost else [warning, head, shares, gain]
    contradicted = surprised and diagnosis.verdict not in ("unexplained", "excess_noise")
    parts.insert(0 if contradicted else len(parts), _held_out_against(diagnosis.stretch, diagnosis.surprise))
    parts.append(held_out_faults_in_words(diagnosis.held_out_faults))
    return " ".join(part for part in parts if part)


def is_lost(diagnosis: DiagnosisFit) -> bool:
    """Return whether held-out readings are worse with the effects found than without."""
    before, after = diagnosis.error_before, diagnosis.error_after
    return bool(diagnosis.effects) and before is not None and after is not None and after.rms > before.rms


def doubts_of(diagnosis: DiagnosisFit) -> list[str]:
    """List in sentences what held-out readings say against a diagnosis."""
    said = (
        _not_carried(is_lost(diagnosis), diagnosis.harmful, len(diagnosis.effects)),
        _held_out_against(None, diagnosis.surprise),
        held_out_faults_in_words(diagnosis.held_out_faults),
    )
    return [text for text in said if text]


def held_out_faults_in_words(found: HeldOutFaults) -> str:
    """Describe the held-out readings that fit another tool target or are gross errors.

    The text is empty if there are none.
    """
    if not found.faults:
        return ""
    exchanged = [f for f in found.faults if f.fits is not None]
    gross = [f for f in found.faults if f.fits is None]
    said = []
    if exchanged:
        listed = ", ".join(f"{f.reading_id} ({f.target}: fits {f.fits})" for f in exchanged[:_FAULTS_SHOWN])
        more = f" and {len(exchanged) - _FAULTS_SHOWN} more" if len(exchanged) > _FAULTS_SHOWN else ""
        said.append(f"{counted(len(exchanged), 'held-out reading')} of another tool target: {listed}{more}.")
    if gross:
        listed = ", ".join(f"{f.reading_id} ({f.error_mm:.2f} mm)" for f in gross[:_FAULTS_SHOWN])
        more = f" and {len(gross) - _FAULTS_SHOWN} more" if len(gross) > _FAULTS_SHOWN else ""
        said.append(f"{counted(len(gross), 'held-out reading')} with a gross error: {listed}{more}.")
    if found.error_without is not None:
        said.append(f"Without them the held-out error is {found.error_without.rms:.3f} mm RMS.")
    return " ".join(said)


def _not_carried(lost: bool, harmful: Sequence[str], count: int) -> str:
    """Describe the evidence of held-out readings against the effects found; empty if none."""
    if lost:
        which = "The effects found do" if count > 1 else "The effect found does"
        return f"{which} not carry over to the held-out readings."
    if not harmful:
        return ""
    listed = ", ".join(harmful[:3]) + (f" and {len(harmful) - 3} more" if len(harmful) > 3 else "")
    which = "it makes" if len(harmful) == 1 else "each makes"
    return f"Held-out readings speak against {listed}: {which} their error larger."


def _held_out_against(stretch: float | None, surprise: HeldOutTest | None) -> str:
    """Compare the held-out error with its expected value in a sentence.

    The text is empty if the error is not conspicuous.
    """
    if surprise is not None and surprise.real:
        return (
            f"The held-out readings miss by {two_figures(surprise.times)} times what noise and the uncertainty of the "
            "parameters let expect: the model does not hold there, or some of those readings are faulty."
        )
    if stretch is None or stretch < _STRETCHED:
        return ""
    return (
        f"It is {stretch:.1f} times what the fit leaves on its own readings, which the uncertainty of the parameters "
        "lets expect: more readings make it smaller, most of all near those that were held out."
    )


def grouped(warnings: Sequence[str], most: int | None = None) -> list[str]:
    """Merge three or more warnings that differ only in their first word into one sentence.

    At most `most` of the names are listed.
    """
    by_rest: dict[str, list[str]] = {}
    for text in warnings:
        name, _, rest = text.partition(" ")
        by_rest.setdefault(rest, []).append(name)
    out = []
    for rest, names in by_rest.items():
        if len(names) < 3:
            out += [f"{name} {rest}" for name in names]
            continue
        listed = names if most is None or len(names) <= most else [*names[:most], f"{len(names) - most} more"]
        out.append(f"Each of {', '.join(listed[:-1])} and {listed[-1]} {rest}")
    return out


VERDICT_NAMES = {
    "complete": "Complete",
    "excess_noise": "Excess noise",
    "attributed": "Attributed",
    "ambiguous": "Ambiguous",
    "unexplained": "Partly unexplained",
}
