"""Puts a report together: numbers in words, figures, and the template."""

from __future__ import annotations

import json
from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from acquisition.loop import FollowedUp
from acquisition.verification import Verification
from calib.dataset import Dataset
from calib.diagnose.carry import CarryOver
from calib.diagnose.diagnosis import Diagnosis
from calib.held_out import errors_on
from calib.identification import Identification
from calib.kinematics import Array
from calib.model import RobotModel
from calib.statistics import ErrorStatistics, statistics_of
from service import wording
from service.parameters import Row, rows_of
from service.patched import Patched
from service.report import (
    drawing,
    errors,
    follow_up,
    panels,
    scatter,
    scope,
    trust,
    verification,
)
from service.report.findings import DRAWN, effect_of, power_of, structure_of
from service.report.residuals import Sample


def diagnosis_report(
    diagnosis: Diagnosis,
    document: Mapping[str, Any],
    carried: CarryOver | None = None,
    patched: Patched | None = None,
    *,
    verified: Verification | None = None,
    followed_up: FollowedUp | None = None,
) -> str:
    """The report of a diagnosis as HTML. `document` is its JSON, of which the report carries a copy.

    patched: a residual map, where one was asked for; verified: what the robot did with corrected targets, where they
    were driven; followed_up: how what was ambiguous at first was settled.
    """
    dataset, final = diagnosis.dataset, diagnosis.final
    found = tuple(f.effect for f in diagnosis.effects)
    sample = Sample.of(dataset, final)
    measured = _held_out(
        dataset,
        {
            "base model": (diagnosis.base.model, diagnosis.base.estimate, drawing.BEFORE),
            "with the effects found": (final.model, final.estimate, drawing.AFTER),
        },
    )
    tables = [
        _error_table(
            "On validation readings of this data set",
            wording.holdout_in_words(dataset.header.holdout),
            {
                "Nominal robot, placed by its base": diagnosis.error_nominal,
                "Identified base model": diagnosis.error_before,
                "With the effects found": diagnosis.error_after,
            },
        )
    ]
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
    effects = [effect_of(f, sample, dataset, number) for number, f in enumerate(diagnosis.effects)]
    joints = [panels.of_joint(sample, k, found) for k in range(1, final.model.robot.joints + 1)]
    return _render(
        dataset,
        final,
        document,
        kind="Diagnosis",
        verdict=wording.VERDICT_NAMES[diagnosis.verdict],
        verdict_key=diagnosis.verdict,
        sentence=wording.verdict_in_words(diagnosis),
        headline=_headline(diagnosis.error_before, diagnosis.error_after, len(found)),
        error_tables=[table for table in tables if table["rows"]],
        figures=_error_figures(measured),
        joints=Markup(scatter.joints_figure(joints)),
        effects=effects,
        error_after=diagnosis.error_after,
        groups=[
            (group, [effects[diagnosis.effects.index(f)] for f in members])
            for group, members in wording.by_group(diagnosis.effects)
        ],
        follow_up=follow_up.section_of(diagnosis.follow_up),
        middle=follow_up.middle_step_of(followed_up, diagnosis),
        patch=None if patched is None else _patch(patched),
        structure=[structure_of(s, i, dataset, sample) for i, s in enumerate(diagnosis.structure)],
        power=power_of(diagnosis.power),
        p_lack_of_fit=wording.chance(diagnosis.p_lack_of_fit),
        notes=diagnosis.notes,
        verification=verification.section_of(diagnosis, verified),
    )


def identification_report(
    dataset: Dataset,
    found: Identification,
    nominal: RobotModel,
    placed: Array,
    document: Mapping[str, Any],
) -> str:
    """The report of an identification alone as HTML; `placed` is the estimate of the nominal robot in its place."""
    measured = _held_out(
        dataset,
        {
            "nominal robot": (nominal, placed, drawing.BEFORE),
            "identified": (found.model, found.estimate, drawing.AFTER),
        },
    )
    before, after = [statistics_of(e.distances) for e in measured] or [None, None]
    table = _error_table(
        "On validation readings of this data set",
        wording.holdout_in_words(dataset.header.holdout),
        {"Nominal robot, placed by its base": before, "Identified": after},
    )
    sample = Sample.of(dataset, found)
    joints = [panels.of_joint(sample, k, ()) for k in range(1, found.model.robot.joints + 1)]
    return _render(
        dataset,
        found,
        document,
        kind="Identification",
        verdict="Identified",
        verdict_key="identified",
        sentence="Parameters of the base model; nothing was searched for beyond them. "
        + wording.gain_in_words(before, after),
        headline=_headline(before, after, None),
        error_tables=[table] if table["rows"] else [],
        figures=_error_figures(measured),
        joints=Markup(scatter.joints_figure(joints)),
        effects=[],
        error_after=None,
        groups=[],
        follow_up=None,
        middle=None,
        patch=None,
        structure=[],
        power=[],
        p_lack_of_fit=None,
        notes=(),
        verification=None,
    )


def _render(dataset: Dataset, found: Identification, document: Mapping[str, Any], **parts: Any) -> str:
    environment = Environment(
        loader=PackageLoader("service"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"mm": wording.millimetres, "chance": wording.chance}
    return environment.get_template("report.html.j2").render(
        dataset=dataset,
        robot=found.model.robot,
        simulated=dataset.header.simulated,
        now=datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
        fit_count=len(found.readings.rows),
        held_count=int(dataset.validation_rows.sum()),
        holdout=wording.holdout_in_words(dataset.header.holdout),
        error_kind=wording.error_kind(dataset),
        scope=scope.scope_of(dataset),
        trust=trust.trust_of(dataset, found),
        parameters=[_parameter(row) for row in rows_of(found, base_model_only=True)],
        noise_scale=found.noise_scale,
        freedom=found.degrees_of_freedom,
        faulty=found.faulty_rows,
        relabelled=found.relabelled_rows,
        warnings=wording.grouped(found.warnings),
        closing=wording.CLOSING,
        drawn=DRAWN,
        document=_embedded(document),
        **parts,
    )


def _held_out(dataset: Dataset, models: Mapping[str, tuple[RobotModel, Array, str]]) -> list[errors.Errors]:
    """Distances of every model on the measured validation readings; empty where there are none."""
    rows = dataset.validation_rows
    if not rows.any():
        return []
    return [
        errors.Errors(name, errors_on(dataset, rows, model, estimate), colour)
        for name, (model, estimate, colour) in models.items()
    ]


def _error_figures(measured: list[errors.Errors]) -> dict[str, Markup] | None:
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


def _headline(
    before: ErrorStatistics | None, after: ErrorStatistics | None, effects: int | None
) -> list[tuple[str, str, str]]:
    """The three figures at the top: (number, unit, what it is)."""
    if before is None or after is None:
        return []
    change = after.rms / before.rms - 1.0 if before.rms > 0.0 else 0.0
    last = (f"{change:+.0%}".replace("-", "−"), "", "change of the held-out RMS error")
    first = (wording.millimetres(before.rms), "mm", "RMS before" if effects is not None else "RMS nominal")
    return [first, (wording.millimetres(after.rms), "mm", "RMS after"), last]


def _patch(patched: Patched) -> dict[str, Any]:
    table = _error_table(
        "Without and with the patch",
        "validation readings of this data set",
        {"With the effects found": patched.without, "The same with the patch": patched.with_it},
    )
    return {"told": wording.patch_in_words(patched.patch), "table": table if table["rows"] else None}


def _parameter(row: Row) -> dict[str, Any]:
    shown: dict[str, Any] = {
        "name": row.name,
        "unit": row.unit,
        "nominal": "" if row.nominal is None else f"{row.nominal:.4f}",
        "dropped": row.change is None,
        "confounded_with": ", ".join(row.confounded_with),
    }
    if row.change is not None and row.std is not None and row.value is not None:
        change, uncertainty = wording.with_uncertainty(row.change, wording.COVERAGE * row.std)
        places = len(uncertainty.partition(".")[2])
        shown |= {"change": change.replace("-", "−"), "uncertainty": uncertainty}
        shown["value"] = f"{row.value:.{places}f}".replace("-", "−")
        shown["nominal"] = shown["nominal"].replace("-", "−")
    return shown


def _embedded(document: Mapping[str, Any]) -> Markup:
    """The JSON for a script element: nothing in it may end the element or start a comment."""
    text = json.dumps(document, allow_nan=False, ensure_ascii=False)
    for character in "<>&\u2028\u2029":
        text = text.replace(character, f"\\u{ord(character):04x}")
    return Markup(text)
