"""Builder of reports from text, figures and the template."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from datetime import UTC, datetime
from functools import cache
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined, Template
from markupsafe import Markup

from acquisition.loop import FollowUpResult
from acquisition.record import Verification
from calib.array import Array
from calib.comparison import RegressionComparison
from calib.compensate import Bounds, refuse_unlikely
from calib.data import Dataset
from calib.diagnose import CarryOver, DiagnosisFit
from calib.effects import words_of
from calib.errors import DataError
from calib.fit import ErrorStatistics, IdentificationFit, errors_on, left_out, statistics_of
from calib.model import Effect, ModelStructure
from calib.saved import CalibratedModel, as_saved, save_model
from service import wording
from service.exports import listed
from service.report import certificate, front, scope
from service.report.certificate import CertificateParties
from service.report.figures import drawing, errors, panels, scatter
from service.report.figures.residuals import PlotSample
from service.report.sections import (
    ballbar,
    follow_up_section,
    judged,
    ladder,
    regression,
    repeats,
    trust,
    verification,
)
from service.report.sections.findings import DRAWN, effects_of, power_of, structure_of
from service.results.common import ParameterResponse
from service.results.judgement.acceptance import NAMES, RULE, AcceptanceResult
from service.results.judgement.validation import ValidationOutcome
from service.results.models import positions
from service.results.models.diagnosed import PatchResult
from service.results.models.parameters import rows_of
from service.results.models.regressed import RegressionResult
from service.results.shape import document_of

_HEADING = re.compile(r"<h2>(.*?)</h2>")
_LEFT_OUT_SHOWN = 30  # readings, largest errors first
_ABSENT: Mapping[str, Any] = {
    **dict.fromkeys(("ladder", "error_tables", "effects", "groups", "structure", "power", "notes"), ()),
    **dict.fromkeys(("unconfirmed", "carried", "next_measurements"), ()),
    "causes_known": True,
    "exports": None,
    **dict.fromkeys(("figures", "error_after", "follow_up", "middle", "patch", "p_lack_of_fit", "misfit")),
    **dict.fromkeys(("verification", "regression", "acceptance", "repeats", "judged", "ballbar")),
    **dict.fromkeys(("trust", "joints", "fit_count")),
    **dict.fromkeys(("left_out", "relabelled", "positions", "warnings"), ()),
}
"""What the template shows only where a report gives it; a name that it does not know is refused."""


def diagnosis_report(
    diagnosis: DiagnosisFit,
    document: Mapping[str, Any],
    carried: CarryOver | None = None,
    patched: PatchResult | None = None,
    *,
    verified: Verification | None = None,
    followed_up: FollowUpResult | None = None,
    acceptance: AcceptanceResult | None = None,
    model_sha256: str | None = None,
    parties: CertificateParties | None = None,
) -> str:
    """Build the report of a diagnosis as HTML.

    Parameters
    ----------
    document : mapping
        The JSON of the diagnosis; the report contains a copy.
    patched : PatchResult, optional
        A residual map, if one was requested.
    verified : Verification, optional
        Readings of corrected targets, if the robot was driven to them.
    followed_up : FollowUpResult, optional
        The measurements that settled the first ambiguities.
    acceptance : AcceptanceResult, optional
        Results for the limits, if limits were given.
    model_sha256 : str, optional
        Hash of a saved model, to avoid making its file again.
    parties : CertificateParties, optional
        Laboratory, customer, place and who signs, for the first page.
    """
    dataset, final = diagnosis.dataset, diagnosis.final
    found = tuple(f.effect for f in diagnosis.effects)
    sample = PlotSample.of(dataset, final)
    models = {
        "nominal robot": (diagnosis.nominal, diagnosis.nominal_estimate, drawing.NOMINAL),
        "base model": (diagnosis.base.model, diagnosis.base.estimate, drawing.BEFORE),
    }
    if found or diagnosis.carried:  # otherwise the last model is the base model again
        models["with the effects found"] = (final.model, final.estimate, drawing.AFTER)
    measured = _held_out(dataset, models)
    tables = []
    if carried is not None:
        tables.append(
            _error_table(
                f"Carried over to {carried.name}",
                f"another series of the same robot; its own validation readings. {carried.finding}",
                {
                    "Its own base model": carried.base,
                    "Effects frozen as found here": carried.frozen,
                    "Amplitudes fitted anew": carried.refitted,
                },
            )
        )
    effects = effects_of(diagnosis, sample)
    joints = _joints(sample, final.model, found)
    rungs = ladder.ladder_of(
        {
            ladder.NOMINAL: diagnosis.error_nominal,
            ladder.BASE: diagnosis.error_before,
            ladder.EFFECTS: diagnosis.error_named if found else None,  # otherwise the base model again
            ladder.CARRIED: diagnosis.error_after if diagnosis.carried else None,
        },
        None if verified is None else verified.verified,
    )
    exports = _exports(final, diagnosis)
    page = front.of_diagnosis(
        diagnosis,
        rungs,
        effects,
        sample,
        space=judged.in_space(dataset, models),
        acceptance=acceptance,
        verified=verified,
        likely=exports is None or exports["refused"] is None,
    )
    return _render(
        dataset,
        final,
        document,
        model_sha256 or (save_model(None, final, diagnosis) if final.converged else None),
        page,
        kind="Diagnosis",
        parties=parties,
        exports=exports,
        verdict=wording.VERDICT_NAMES[diagnosis.verdict],
        verdict_key=_colour_of(diagnosis),
        sentence=wording.verdict_in_words(diagnosis),
        ladder=rungs,
        error_tables=[table for table in tables if table["rows"]],
        figures=_error_figures(measured),
        judged=judged.section_of(dataset, models, measured),
        joints=joints,
        effects=effects,
        error_after=diagnosis.error_after,
        groups=[
            (group, [effects[diagnosis.confirmed.index(f)] for f in members])
            for group, members in wording.by_group(diagnosis.confirmed)
        ],
        causes_known=diagnosis.causes_known,
        unconfirmed=wording.unconfirmed(diagnosis.effects),
        carried=wording.stated_carried(diagnosis.carried),
        next_measurements=diagnosis.next_measurements,
        follow_up=follow_up_section.section_of(diagnosis.follow_up),
        middle=follow_up_section.middle_step_of(followed_up, diagnosis),
        patch=None if patched is None else _patch(patched),
        structure=[structure_of(s, i, dataset, sample) for i, s in enumerate(diagnosis.structure)],
        power=power_of(diagnosis.power),
        p_lack_of_fit=wording.chance(diagnosis.p_lack_of_fit),
        misfit=diagnosis.surprise,
        notes=diagnosis.notes,
        verification=verification.section_of(verified),
        acceptance=acceptance,
        repeats=repeats.section_of(dataset, final.model, final.estimate),
        ballbar=ballbar.section_of(dataset, models),
    )


def identification_report(
    dataset: Dataset,
    found: IdentificationFit,
    nominal: ModelStructure,
    placed: Array,
    document: Mapping[str, Any],
    acceptance: AcceptanceResult | None = None,
    model_sha256: str | None = None,
    preliminary: CalibratedModel | None = None,
    parties: CertificateParties | None = None,
) -> str:
    """Build the report of an identification as HTML.

    Parameters
    ----------
    placed : array
        Estimate of the nominal robot in its place.
    model_sha256 : str, optional
        Hash of the model; None if the fit did not converge.
    preliminary : CalibratedModel, optional
        A model of stage 1, for the section of the ballbar.
    parties : CertificateParties, optional
        Laboratory, customer, place and who signs, for the first page.
    """
    models = {
        "nominal robot": (nominal, placed, drawing.NOMINAL),
        "identified": (found.model, found.estimate, drawing.AFTER),
    }
    measured = _held_out(dataset, models)
    before, after = [statistics_of(e.distances) for e in measured] or [None, None]
    joints = _joints(PlotSample.of(dataset, found), found.model, ())
    rungs = ladder.ladder_of({ladder.NOMINAL: before, ladder.BASE: after})
    page = front.of_identification(
        rungs, judged.in_space(dataset, models), acceptance, converged=bool(found.converged)
    )
    return _render(
        dataset,
        found,
        document,
        model_sha256,
        page,
        kind="Identification",
        parties=parties,
        exports=_exports(found),
        verdict="Identified",
        verdict_key="identified",
        sentence="Parameters of the base model; nothing was searched for beyond them. "
        + wording.gain_in_words(before, after),
        ladder=rungs,
        acceptance=acceptance,
        repeats=repeats.section_of(dataset, found.model, found.estimate),
        figures=_error_figures(measured),
        judged=judged.section_of(dataset, models, measured),
        joints=joints,
        ballbar=ballbar.section_of(dataset, _with(preliminary, models)),
    )


def validation_report(validated: ValidationOutcome) -> str:
    """Build the report of a saved model on the validation rows of a data set, as HTML."""
    dataset, rows = validated.dataset, validated.dataset.validation_rows
    measured, section = judged_in(validated)
    drawn = {each.name: (*validated.models[each.name][1:], each.colour) for each in measured}
    space = judged.in_space(dataset, dict(list(drawn.items())[:2]))
    return _render(
        dataset,
        None,
        document_of(validated.result),
        validated.model_sha256,
        front.of_validation(validated, space),
        kind="Validation",
        verdict="Judged",
        verdict_key="identified",
        sentence=f"Model {measured[1].name}; nothing was fitted to these readings. "
        + wording.gain_in_words(*(statistics_of(each.distances) for each in measured[:2])),
        scope=scope.scope_of(dataset, rows),
        ladder=ladder.ladder_of({each.name: statistics_of(each.distances) for each in measured}),
        acceptance=validated.acceptance,
        repeats=repeats.section_of(*validated.models[measured[1].name]),
        figures=_error_figures(measured),
        judged=section,
        warnings=validated.result.warnings,
        ballbar=ballbar.section_of(dataset, drawn),
    )


def judged_in(validated: ValidationOutcome) -> tuple[list[errors.ErrorSample], dict[str, Any]]:
    """Return the errors of every model on the validation rows, with their pictures and table.

    Arrows are drawn for the first two models.
    """
    colours = (drawing.NOMINAL, drawing.AFTER, drawing.FITTED, drawing.BEFORE)
    dataset = validated.dataset
    measured = [
        errors.ErrorSample(name, errors_on(under, dataset.validation_rows, model, estimate), colour)
        for colour, (name, (under, model, estimate)) in zip(colours, validated.models.items(), strict=False)
    ]
    drawn = {each.name: (*validated.models[each.name][1:], each.colour) for each in measured[:2]}
    return measured, judged.section_of(dataset, drawn, measured)


def _colour_of(diagnosis: DiagnosisFit) -> str:
    """Return the class of the verdict's box.

    It is a warning if held-out readings are worse with the effects found than without.
    """
    return "not_carried" if wording.is_lost(diagnosis) else diagnosis.verdict


def _with(preliminary: CalibratedModel | None, models: ballbar.Models) -> ballbar.Models:
    """Return the models in the order of a campaign: nominal, preliminary, final."""
    if preliminary is None:
        return models
    first, *others = models.items()
    between = (preliminary.model, preliminary.estimate, drawing.FITTED)
    return dict([first, ("preliminary (stage 1)", between), *others])


def regression_report(
    comparison: RegressionComparison, result: RegressionResult, model_sha256: str | None = None
) -> str:
    """Build the report of a regression as HTML.

    It has the panel of its comparison, and the model that it is based on, with the hash.
    """
    asked = comparison.asked.predictor
    assert asked.found is not None  # of the requested predictors only the nominal robot has none
    dataset, found = comparison.dataset, asked.found
    joints = _joints(PlotSample.of(dataset, found), found.model, ())
    sentence = " ".join(regression.foremost(result.findings, asked.name))
    return _render(
        dataset,
        found,
        document_of(result),
        model_sha256,
        front.of_regression(sentence),
        kind="Regression",
        verdict="Compared",
        verdict_key="identified",
        sentence=sentence,
        joints=joints,
        regression=regression.section_of(comparison, result),
    )


def _joints(sample: PlotSample, model: ModelStructure, found: tuple[Effect, ...]) -> Markup:
    """Draw one panel of residuals per joint, with the lines of the effects found."""
    return Markup(
        scatter.joints_figure([panels.of_joint(sample, k, found) for k in range(1, model.robot.joints + 1)])
    )


@cache
def _template() -> Template:
    """Compiled once: that takes a twelfth of the time of a report."""
    environment = Environment(
        loader=PackageLoader(__name__.partition(".report")[0]),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {
        "mm": wording.millimetres,
        "chance": wording.chance,
        "capitalize_first": _begun,
        "words": words_of,
        "with_contents": _with_contents,
    }
    return environment.get_template("report.html.j2")


def _render(
    dataset: Dataset,
    found: IdentificationFit | None,
    document: Mapping[str, Any],
    model_sha256: str | None,
    page: front.FrontPage,
    *,
    parties: CertificateParties | None = None,
    **parts: Any,
) -> str:
    """Render a report as HTML; a report that only judges has no fit in `found`."""
    fitted = {} if found is None else _of_fit(dataset, found)
    parties = parties or CertificateParties()
    return _template().render(
        dataset=dataset,
        robot=dataset.header.robot,
        simulated=dataset.header.simulated,
        simulated_words=wording.SIMULATED,
        now=datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
        held_count=int(dataset.validation_rows.sum()),
        holdout=wording.holdout_of(dataset),
        error_kind=wording.error_kind(dataset),
        paper=certificate.paper_of(dataset, document, model_sha256),
        closing=wording.CLOSING,
        drawn=DRAWN,
        most_dots=scatter.MOST_DOTS,
        acceptance_names=NAMES,
        acceptance_rule=RULE,
        document=_embedded(document),
        front=page.shown(dataset),
        who=front.who_of(dataset, parties, fitted=fitted.get("fit_count")),
        laboratory=front.clipped(parties.stated("laboratory"), front.ENTRY),
        responsible=front.clipped(parties.stated("responsible"), front.ENTRY),
        model_sha256=model_sha256,
        **{**_ABSENT, **fitted, **parts},
    )


def _with_contents(details: Markup) -> tuple[Markup, list[tuple[str, Markup]]]:
    """Give every heading of the details an id; also return ids and headings, for the table of contents."""
    titles = _HEADING.findall(details)
    names = iter([f"section-{number}" for number in range(1, len(titles) + 1)])
    text = _HEADING.sub(lambda found: f'<h2 id="{next(names)}">{found[1]}</h2>', details)
    return Markup(text), [(f"section-{k}", Markup(title)) for k, title in enumerate(titles, start=1)]


def _exports(found: IdentificationFit, diagnosis: DiagnosisFit | None = None) -> dict[str, Any] | None:
    """Return the remaining error of every format of an export, or why there is none.

    None if the model cannot be saved.
    """
    if not found.converged:
        return None
    saved = as_saved(found, diagnosis)
    try:
        refuse_unlikely(saved.model, saved.estimate, saved.usual, Bounds(), coupling=saved.coupling)
        return {"listed": listed(*saved.for_use(), ""), "refused": None}
    except DataError as error:
        return {"listed": None, "refused": f"None is written: the model {error.what} {error.do}"}


def _of_fit(dataset: Dataset, found: IdentificationFit) -> dict[str, Any]:
    """Return the template values of a fit: its readings, parameters and trust."""
    return {
        "fit_count": len(found.readings.rows),
        "scope": scope.scope_of(dataset),
        "trust": trust.trust_of(dataset, found),
        "parameters": [_parameter(row) for row in rows_of(found, base_model_only=True)],
        "positions": positions.rows_of(found),
        "position_headings": positions.HEADINGS,
        "noise_scale": found.noise_scale,
        "freedom": found.degrees_of_freedom,
        "left_out": sorted(left_out(dataset, found), key=lambda row: -row.error_mm),
        "left_out_shown": _LEFT_OUT_SHOWN,
        "relabelled": found.relabelled_rows,
        "warnings": wording.grouped(found.warnings),
    }


def _held_out(
    dataset: Dataset, models: Mapping[str, tuple[ModelStructure, Array, str]]
) -> list[errors.ErrorSample]:
    """Return the distances of every model on the measured validation readings.

    The list is empty without such readings.
    """
    rows = dataset.validation_rows
    if not rows.any():
        return []
    return [
        errors.ErrorSample(name, errors_on(dataset, rows, model, estimate), colour)
        for name, (model, estimate, colour) in models.items()
    ]


def _error_figures(measured: list[errors.ErrorSample]) -> dict[str, Markup] | None:
    if not measured:
        return None
    return {
        "histogram": Markup(errors.histogram(measured)),
        "cumulative": Markup(errors.cumulative(measured)),
    }


def _error_table(title: str, holdout: str, rows: Mapping[str, ErrorStatistics | None]) -> dict[str, Any]:
    return {
        "title": title,
        "holdout": holdout,
        "rows": [(name, e) for name, e in rows.items() if e is not None],
    }


def _patch(patched: PatchResult) -> dict[str, Any]:
    table = _error_table(
        "Without and with the patch",
        "validation readings of this data set",
        {"With the effects found": patched.without, "The same with the patch": patched.with_it},
    )
    return {"words": wording.patch_in_words(patched.patch), "table": table if table["rows"] else None}


def _begun(text: str) -> str:
    """Return a text with a capital letter in front; names inside it stay as they are."""
    return text[:1].upper() + text[1:]


def _parameter(row: ParameterResponse) -> dict[str, Any]:
    shown: dict[str, Any] = {
        "name": row.name,
        "unit": row.unit,
        "nominal": "" if row.nominal is None else f"{row.nominal:.4f}",
        "dropped": row.absolute is None,
        "confounded_with": ", ".join(row.confounded_with),
    }
    if row.absolute is not None and row.absolute_std is not None:
        _, uncertainty = wording.with_uncertainty(row.absolute, wording.COVERAGE * row.absolute_std)
        places = len(uncertainty.partition(".")[2])
        shown["uncertainty"] = uncertainty
        for name, x in (("value", row.absolute), ("change", row.change_from_nominal)):
            # + 0.0: what rounds to nothing has no sign
            shown[name] = "" if x is None else f"{round(x, places) + 0.0:.{places}f}".replace("-", "−")
        shown["nominal"] = shown["nominal"].replace("-", "−")
    return shown


def _embedded(document: Mapping[str, Any]) -> Markup:
    """Return JSON for a script element; nothing in it may end the element or open a comment."""
    text = json.dumps(document, allow_nan=False, ensure_ascii=False)
    for character in "<>&\u2028\u2029":
        text = text.replace(character, f"\\u{ord(character):04x}")
    return Markup(text)
