"""First page of a report: the answer, on one sheet that can be filed and signed.

Every figure is one of the result. What was not measured is stated as such, or is a line to be filled in by hand.
"""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from markupsafe import Markup

from acquisition.record import Verification, individual_of
from calib.data import Dataset
from calib.diagnose import DiagnosedEffect, DiagnosisFit
from calib.fit import ErrorStatistics
from calib.units import percent
from service import effect_names, wording
from service.report.certificate import CertificateParties
from service.report.figures import panels, scatter, structure
from service.report.figures.residuals import PlotSample
from service.report.figures.space_picture import ErrorsInSpace
from service.report.scope import scope_of
from service.report.sections import judged, ladder
from service.report.sections.verification import NEARLY
from service.results.judgement.acceptance import AcceptanceResult
from service.results.judgement.validation import SummaryShown, ValidationOutcome

Step = tuple[str, ErrorStatistics | SummaryShown]
Advice = tuple[str, str]

# What has room on the page; all of it is in the sections.
_MEMBERS, _OTHERS, _DOUBTS, _ADVICE, _LIMITS, _STEPS = 4, 2, 2, 3, 3, 5
ENTRY, _NAME, _DOUBT, _ADVISED, _SENTENCE = 44, 44, 200, 130, 420  # characters
_PICTURE = (4.0, 2.3)  # inches
_SHORT = {
    ladder.NOMINAL: "As found (nominal robot)",
    ladder.BASE: "Standard calibration",
    ladder.EFFECTS: "With what was found",
    ladder.CARRIED: "With terms of unknown cause",
    ladder.VERIFIED: "Measured, with corrected targets",
}
_FOUND = {
    "complete": "No further cause: a standard calibration explains these readings",
    "attributed": "Nothing that exceeds its uncertainty",
    "ambiguous": "Nothing that exceeds its uncertainty",
    "unexplained": "There is a pattern that no known cause explains",
    "excess_noise": "There is more error than the declared noise, and no known cause for it",
}


@dataclass(frozen=True)
class FrontCause:
    """The cause as the first page shows it, or why there is none."""

    eyebrow: str
    title: str
    said: tuple[str, ...]
    members: tuple[tuple[str, str], ...] = ()  # causes that look alike, with their weights
    check: str = ""
    picture: Markup | None = None
    wide: bool = False  # whether the picture has several panels


@dataclass(frozen=True)
class FrontPage:
    """Content of the first page.

    Attributes
    ----------
    steps : sequence of (str, errors)
        Models and their errors on the same readings, the robot as found first, mm.
    verified : Verification or None
        Errors of the robot, if it was driven to corrected targets.
    doubts : sequence of str
        What speaks against the result, in sentences.
    advice : sequence of (str, str)
        What to do next, the most urgent first.
    """

    title: str
    steps: Sequence[Step]
    cause: FrontCause | None
    doubts: Sequence[str]
    advice: Sequence[Advice]
    acceptance: AcceptanceResult | None = None
    verified: Verification | None = None
    space: ErrorsInSpace | None = None

    def shown(self, dataset: Dataset) -> dict[str, Any]:
        """Return the values of the template."""
        first, last = (self.steps[0][1], self.steps[-1][1]) if self.steps else (None, None)
        rungs = [(name, errors, errors is last) for name, errors in self.steps]
        said, proof = _said(first, last, dataset), _proof(self.verified, dataset, judged=bool(self.steps))
        if not self.steps and self.verified is not None and self.verified.uncorrected is not None:
            # nothing was kept aside, because new targets were driven
            first, last, said, proof = self.verified.uncorrected, self.verified.verified, proof, ""
            rungs.append(("Measured, uncorrected", first, False))
        if self.verified is not None:
            rungs.append((_SHORT[ladder.VERIFIED], self.verified.verified, True))
        largest = max((_known(errors.rms) for _, errors, _ in rungs), default=0.0) or 1.0
        doubts = [clipped(doubt, _DOUBT) for doubt in self.doubts[:_DOUBTS]]
        if more := len(self.doubts) - len(doubts):
            doubts.append(f"And {more} more: see the sections.")
        criteria = () if self.acceptance is None else self.acceptance.criteria
        return {
            "title": self.title,
            "answer": None if first is None or last is None else _pair(first.rms, last.rms),
            "said": said,
            "proof": proof,
            "rungs": [
                (clipped(name, _NAME), f"{100.0 * _known(errors.rms) / largest:.1f}", errors.rms, best)
                for name, errors, best in rungs[-_STEPS:]
                if errors.rms is not None
            ],
            "space": None
            if self.space is None or not self.steps or len(doubts) > 1
            else _space(self.space, self.steps),
            "cause": self.cause,
            "doubts": doubts,
            "advice": [(title, clipped(text, _ADVISED)) for title, text in self.advice[:_ADVICE]],
            "verdict": None if self.acceptance is None else self.acceptance.verdict,
            "criteria": criteria[:_LIMITS],
            "more_criteria": max(len(criteria) - _LIMITS, 0),
        }


def of_diagnosis(
    diagnosis: DiagnosisFit,
    rungs: Sequence[ladder.LadderStep],
    effects: Sequence[dict[str, Any]],
    sample: PlotSample,
    *,
    space: ErrorsInSpace | None,
    acceptance: AcceptanceResult | None,
    verified: Verification | None,
    likely: bool,
) -> FrontPage:
    """Build the page of a diagnosis, with the proof of a closed loop if there is one.

    `rungs` and `effects` are those of the detailed sections; `likely` states whether the corrections are of a
    usual size.
    """
    doubts = wording.doubts_of(diagnosis)
    if not diagnosis.final.converged:
        doubts.insert(0, "The fit did not converge: its figures mean nothing.")
    if verified is not None and verified.ratio > NEARLY:
        doubts.append("On the robot the correction does not reach what the readings allow.")
    return FrontPage(
        "Robot calibration report",
        [(_SHORT[rung.name], rung.errors) for rung in rungs if rung.judged == ladder.HELD_OUT],
        _cause(diagnosis, effects, sample),
        doubts,
        _advice(diagnosis, acceptance, verified, likely=likely),
        acceptance,
        verified,
        space,
    )


def of_identification(
    rungs: Sequence[ladder.LadderStep],
    space: ErrorsInSpace | None,
    acceptance: AcceptanceResult | None,
    *,
    converged: bool,
) -> FrontPage:
    """Build the page of an identification, which looks for no cause."""
    doubts = [] if converged else ["The fit did not converge: its figures mean nothing."]
    cause = FrontCause(
        "The cause",
        "Not looked for",
        ("A standard calibration was fitted. Whether the robot has a further fault was not examined.",),
    )
    advice = [
        *_by_limits(acceptance),
        ("Look for the cause", "truepose diagnose examines the same readings."),
    ]
    if rungs:
        advice.append(_PROVE)
    else:
        advice.append(_JUDGE)
    steps = [(_SHORT[rung.name], rung.errors) for rung in rungs]
    return FrontPage("Robot calibration report", steps, cause, doubts, advice, acceptance, space=space)


def of_validation(validated: ValidationOutcome, space: ErrorsInSpace | None) -> FrontPage:
    """Build the page of a model judged on readings to which nothing was fitted."""
    result = validated.result
    doubts = [text for text in result.warnings if not text.startswith("SIMULATED")]
    (_, nominal), *others = [(each.model, each.error) for each in result.judgements]
    steps = [(_SHORT[ladder.NOMINAL], nominal), *((f"Model {name}", error) for name, error in others)]
    worse = _known(steps[1][1].rms) > _known(steps[0][1].rms)
    advice = [*_by_limits(validated.acceptance)]
    advice.append(
        ("Do not use this model here", "On these readings it is worse than the nominal robot.")
        if worse
        else ("Run corrected programs", "truepose compensate corrects programs and targets with this model.")
    )
    advice.append(_PROVE)
    # The answer is that of the judged model; others of the same result follow below it
    ordered = [steps[0], *steps[2:], steps[1]]
    return FrontPage(
        "Robot validation report", ordered, None, doubts, advice, validated.acceptance, space=space
    )


def of_regression(sentence: str) -> FrontPage:
    """Build the page of a comparison, which has no error before and after."""
    cause = FrontCause("The finding", "Regression beside identification", (clipped(sentence, _SENTENCE),))
    return FrontPage("Robot regression report", (), cause, (), (_PROVE,))


def who_of(dataset: Dataset, parties: CertificateParties, *, fitted: int | None) -> list[tuple[str, str]]:
    """Return the entries of the header; an unstated value is empty, to fill in by hand.

    `fitted` is the number of readings in the fit; None if nothing was fitted.
    """
    header = dataset.header
    robot, instrument = (
        [each for each in map(individual_of, header.devices) if each.role == role]
        for role in ("robot", "instrument")
    )
    air = dict(scope_of(dataset, dataset.usable))["Air temperature"]
    occasion, held = header.occasion, int(dataset.validation_rows.sum())
    days = [] if occasion is None else [occasion.began[:10], occasion.ended[:10]]
    entries = [
        ("Customer", parties.stated("customer")),
        ("Robot", _named(robot) or f"{header.robot.name} ({header.robot.maker})"),
        ("Robot serial number", _each(device.serial for device in robot)),
        ("Controller software", _each(device.firmware for device in robot)),
        ("Place", parties.stated("city")),
        ("Instrument", _named(instrument) or header.instrument),
        ("Its serial number", _each(device.serial for device in instrument)),
        ("Its certificate, valid until", ""),
        ("Measured on", " to ".join(dict.fromkeys(days))),
        ("Measured by", "" if occasion is None else ", ".join(occasion.operators)),
        ("Air", "" if air == "not recorded" else air),
        (
            "Readings",
            f"{held} that judge" if fitted is None else f"{fitted} + {held} kept aside",
        ),
    ]
    return [(what, clipped(value, ENTRY)) for what, value in entries]


def clipped(text: str, most: int) -> str:
    """Shorten a text to whole sentences, or to whole words if the first is too long.

    The rest is in the sections.
    """
    if len(text) <= most:
        return text
    end = text.rfind(". ", 0, most - 2)
    if end > most // 2:
        return f"{text[: end + 1]} …"
    words = textwrap.shorten(text, most, placeholder=" …")
    return words if len(words) > most // 2 else f"{text[: most - 1]}…"


def _named(devices: Sequence[Any]) -> str:
    return _each(f"{each.maker} {each.model}".strip() for each in devices)


def _each(texts: Any) -> str:
    return ", ".join(dict.fromkeys(text for text in texts if text))


def _known(value: float | None) -> float:
    return 0.0 if value is None else value


def _pair(before: float | None, after: float | None) -> tuple[str, str] | None:
    """Format two errors, mm, with the same decimals: two, or more where these would round too much."""
    if before is None or after is None:
        return None
    least = min(before, after)
    digits = 2 if least >= 0.03 else 3 if least >= 0.003 else 4
    return f"{before:.{digits}f}", f"{after:.{digits}f}"


def _said(
    before: ErrorStatistics | SummaryShown | None,
    after: ErrorStatistics | SummaryShown | None,
    dataset: Dataset,
) -> str:
    if before is None or after is None or before.rms is None or after.rms is None:
        return (
            "Not judged: no readings were kept aside, so no error is known on readings that took no part in the "
            "calibration."
        )
    change = after.rms / before.rms - 1.0 if before.rms > 0.0 else 0.0
    what = "less" if change < 0.0 else "MORE: it is worse than before"
    return (
        f"{wording.error_kind(dataset)} (RMS) before and after, on {wording.counted(after.n, 'reading')} that took no "
        f"part in the calibration: {percent(abs(change))} {what}."
    )


def _proof(verified: Verification | None, dataset: Dataset, *, judged: bool) -> str:
    """Return what the robot itself showed with corrected targets, or that it was not tried."""
    if verified is None:
        predicted = "Predicted by the model. " if judged else ""
        return f"{predicted}Not verified on the robot: no corrected target was driven and measured."
    robot = "simulated robot" if dataset.header.simulated else "robot"
    before, after = verified.uncorrected, verified.verified
    figures = f"{wording.millimetres(after.rms)} mm"
    of = " of lengths along the ballbar, not of positions" if verified.of_lengths else ""
    if before is not None:
        figures = f"{wording.millimetres(before.rms)} → {figures}"
    return (
        f"Measured on the {robot} with corrected targets at {wording.counted(verified.poses, 'new pose')}: {figures} "
        f"RMS{of}."
    )


def _space(space: ErrorsInSpace, steps: Sequence[Step]) -> dict[str, Any]:
    times = judged.enlargement(space.wanted_enlargement)
    before, after = steps[0][1].max, steps[-1][1].max
    figures = [wording.millimetres(_known(value)) for value in (before, after)]
    pictures = space.pictures(
        times,
        (
            f"Errors before around the arm, the largest {figures[0]} mm",
            f"Errors after around the arm, the largest {figures[1]} mm",
        ),
    )
    return {
        "times": f"{times:g}",
        "pictures": [Markup(picture) for picture in pictures],
        "largest": figures,
    }


def _cause(diagnosis: DiagnosisFit, effects: Sequence[dict[str, Any]], sample: PlotSample) -> FrontCause:
    found = diagnosis.confirmed
    if not (found and diagnosis.causes_known):
        left = diagnosis.structure[0] if diagnosis.structure and not diagnosis.causes_known else None
        picture = None if left is None else structure.picture_of(left, 0, diagnosis.dataset, sample)
        return FrontCause(
            "The cause" if diagnosis.causes_known else "Not explained",
            _FOUND[diagnosis.verdict],
            (clipped(wording.verdict_in_words(diagnosis), _SENTENCE),),
            picture=None if picture is None else Markup(picture),
            wide=True,
        )
    first, shown = found[0], effects[0]
    members = shown["members"]
    said = [
        shown["sentence"] if len(members) == 1 else f"If it is {members[0][0]}: {shown['sentence']}",
        f"It moves the tool by {wording.millimetres(shown['displacement'])} mm RMS over these poses and explains "
        f"{percent(shown['share'])} of what the model without it leaves."
        + (
            ""
            if len(members) > 1 or shown["rivals"]
            else " No other known cause explains these readings as well."
        ),
    ]
    if len(found) > 1:
        said.append(f"Besides: {effect_names.listed(found[1:], _OTHERS)}.")
    if diagnosis.carried:
        said.append(
            "The model also carries terms whose cause is not known, because left-out readings confirm them."
        )
    title = members[0][0][:1].upper() + members[0][0][1:]
    if len(members) > 1:
        title = f"One of {len(members)} causes that look alike"
    return FrontCause(
        "The cause" if len(found) == 1 else f"The largest of {len(found)} causes",
        title,
        tuple(clipped(text, _SENTENCE // 2) for text in said),
        tuple((words, percent(weight)) for words, _, weight in members[:_MEMBERS])
        if len(members) > 1
        else (),
        shown["check"] or (_usual(first) if len(members) == 1 else ""),
        Markup(scatter.effect_figure(panels.of_effect(sample, first.effect), "cause", *_PICTURE)),
    )


def _usual(found: DiagnosedEffect) -> str:
    if found.beyond_usual or found.impossible:
        return ""
    return f"Nothing: the size is usual (up to {wording.usual_size(found)})."


_CORRECT = (
    "Run corrected programs",
    "truepose compensate corrects them. What a file for another program leaves: see the last section.",
)
_UNLIKELY = (
    "Look at the size of the correction",
    "It is so large that corrections are refused unless you allow more: see the last section.",
)
_PROVE = (
    "Prove it on the robot",
    "Drive corrected targets at new poses and measure them. Until then the figures are predictions.",
)
_JUDGE = (
    "Keep readings aside",
    "Measure poses that take no part in the fit (set = validation): only they tell the error after calibration.",
)


def _advice(
    diagnosis: DiagnosisFit,
    acceptance: AcceptanceResult | None,
    verified: Verification | None,
    *,
    likely: bool,
) -> list[Advice]:
    """List what to do next, the most urgent first."""
    out: list[Advice] = []
    usable = diagnosis.final.converged and not diagnosis.worse_than_nominal
    if not usable:
        out.append(
            (
                "Do not use this model",
                "It would not make the robot more accurate: look at the warnings and the readings left out.",
            )
        )
    out += _by_limits(acceptance)
    if faults := diagnosis.held_out_faults.faults:
        out.append(
            (
                "Look at faulty readings",
                f"{wording.counted(len(faults), 'reading')} kept aside cannot be right.",
            )
        )
    if diagnosis.follow_up is not None:
        poses = wording.counted(len(diagnosis.follow_up.joints), "more pose")
        out.append(
            (
                f"Measure {poses}",
                "They tell apart the causes that look alike; diagnose --follow-up writes the campaign.",
            )
        )
        out += [("What no pose can show", text) for text in diagnosis.follow_up.procedures[:1]]
    out += [("Measure again", text) for text in diagnosis.next_measurements[:2]]
    checks = [
        effect_names.name_of(found)
        for found in diagnosis.confirmed
        if wording.advice_on(found, causes_known=diagnosis.causes_known)
    ]
    if checks:
        out.append((f"Check: {checks[0]}", "A correction hides such an error. It does not repair it."))
    if not diagnosis.dataset.validation_rows.any() and verified is None:
        out.append(_JUDGE)
    if usable and (acceptance is None or acceptance.verdict != "rejected"):
        out.append(_CORRECT if likely else _UNLIKELY)
    if verified is None and usable:
        out.append(_PROVE)
    out.append(
        (
            "Check again",
            "After a collision, a repair or a new tool, and as often as your rules ask: truepose watch.",
        )
    )
    return out


def _by_limits(acceptance: AcceptanceResult | None) -> list[Advice]:
    if acceptance is None or acceptance.verdict == "accepted":
        return []
    if acceptance.verdict == "rejected":
        return [("Do not release the robot", "An error is beyond its limit.")]
    return [("Measure more poses", "The error is too near its limit to decide.")]
