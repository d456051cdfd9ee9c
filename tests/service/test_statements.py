"""Statements of a diagnosis in terminal, report, JSON and Python.

These would catch: advice as if an unknown cause were known, and effects below their uncertainty stated as found. They
would also catch tool and base values that count from a hidden start, and a verdict whose sentence is missing from some
presentations.
"""

from __future__ import annotations

import html
import io
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console

import truepose
from calib.data import read_dataset
from calib.diagnose import CarriedTerm, DetectableEffect, DiagnosisFit, ResidualStructure, Shares, diagnose
from calib.fit import IdentificationFit, identify
from calib.model import BoundModel
from calib.robot_file import RobotFileMistake, RobotFileVerdict
from calib.units import to_internal
from service import wording
from service.printed import tables
from service.printed.robot_tables import verdict_lines
from service.report import diagnosis_report
from service.report.sections.findings import power_of
from service.results.models.diagnosed import DiagnosisOutcome, DiagnosisResult
from service.results.models.parameters import absolutes, rows_of
from tests.service.campaigns import write_data

LEFT = (ResidualStructure("joint 3 angle", 1e-9, 0.4, "joint 3"),)


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_data(tmp_path_factory.mktemp("statements"))


@pytest.fixture(scope="module")
def known(data: Path) -> DiagnosisFit:
    return diagnose(read_dataset(data))


def unexplained(known: DiagnosisFit) -> DiagnosisFit:
    return replace(known, verdict="unexplained", structure=LEFT)


def with_size(known: DiagnosisFit, value: float, std: float) -> DiagnosisFit:
    """The diagnosis with an effect of this size and standard error, deg."""
    (found,) = known.effects
    size, spread = to_internal(value, "deg"), to_internal(std, "deg")
    return replace(
        known, effects=(replace(found, values=np.array([size]), covariance=np.array([[spread**2]])),)
    )


def printed(diagnosis: DiagnosisFit) -> str:
    written = io.StringIO()
    console = Console(width=200, file=written)
    for each in tables.diagnosis(diagnosis, None, None):
        console.print(each)
    return written.getvalue()


def everywhere(diagnosis: DiagnosisFit) -> dict[str, str]:
    """The presentations of a diagnosis as text."""
    document = DiagnosisOutcome(diagnosis).document()
    DiagnosisResult.model_validate(document)
    page = diagnosis_report(diagnosis, document).partition('<script type="application/json"')[0]
    return {"terminal": printed(diagnosis), "report": html.unescape(page)}


def test_the_sentence_of_the_verdict_is_in_every_presentation(known: DiagnosisFit, data: Path) -> None:
    sentence = wording.verdict_in_words(known)
    document = DiagnosisOutcome(known).document()
    assert document["finding"] == sentence
    assert sentence in everywhere(known)["report"]
    assert " ".join(sentence.split()) in " ".join(everywhere(known)["terminal"].split())
    assert truepose.Diagnosis(DiagnosisOutcome(known)).sentence == sentence


def test_a_known_cause_has_rivals_and_advice(known: DiagnosisFit) -> None:
    (found,) = known.effects
    check = wording.advice_on(found, causes_known=True)
    assert check
    for text in everywhere(known).values():
        assert check in " ".join(text.split())
        assert "none" in text
        assert "mitated" not in text
        assert "What to measure next" not in text
    assert DiagnosisOutcome(known).document()["next_measurements"] == []


@pytest.mark.parametrize("verdict", ["unexplained", "excess_noise"])
def test_an_unknown_cause_is_imitated_and_gets_no_advice(verdict: Any, known: DiagnosisFit) -> None:
    left = replace(unexplained(known), verdict=verdict)
    check = wording.advice_on(known.effects[0], causes_known=True)
    for name, text in everywhere(left).items():
        assert "mitated by" in text, name
        assert check not in " ".join(text.split())
        assert "none: no other effect" not in text
        assert "rivals" not in text.lower() or name == "report"
        for advice in left.next_measurements:
            assert advice in " ".join(text.split())
    document = DiagnosisOutcome(left).document()
    (effect,) = document["effects"]
    assert (effect["check"], effect["imitates"]) == ("", True)
    assert "joint 3 alone" in document["next_measurements"][0]
    assert "imitated by" in document["finding"]
    python = truepose.Diagnosis(DiagnosisOutcome(left))
    assert python.next_measurements == left.next_measurements
    assert bool(python.effects["imitates"].all())
    assert "Imitated by" in python._repr_html_()


def test_what_is_smaller_than_its_uncertainty_is_listed_apart(known: DiagnosisFit) -> None:
    faint = with_size(known, 0.3, 0.395)
    assert "backlash" not in wording.verdict_in_words(faint)
    assert "play of joint 4" not in wording.verdict_in_words(faint)
    for text in everywhere(faint).values():
        assert "Not confirmed (smaller than the uncertainty U): backlash:j4 0.30 ± 0.79 deg." in text
        assert "What to check" not in text
    (effect,) = DiagnosisOutcome(faint).document()["effects"]
    assert (effect["confirmed"], effect["check"]) == (False, "")


@pytest.mark.parametrize(("size", "advised"), [(0.09, False), (0.11, True)])
def test_advice_is_given_beyond_the_usual_size_only(size: float, advised: bool, known: DiagnosisFit) -> None:
    found = with_size(known, size, 0.001)
    (effect,) = DiagnosisOutcome(found).document()["effects"]
    assert effect["usual_size"] == pytest.approx(0.1)
    assert bool(effect["check"]) == advised
    texts = everywhere(found)
    assert ("What to check" in texts["terminal"]) == advised
    assert ("Check." in texts["report"]) == advised
    for text in texts.values():
        assert "0.1 deg" in text


def test_a_negative_size_that_cannot_be_is_remarked(known: DiagnosisFit) -> None:
    negative = with_size(known, -0.2, 0.01)
    (effect,) = DiagnosisOutcome(negative).document()["effects"]
    assert (effect["impossible"], effect["check"]) == (True, "")
    for text in everywhere(negative).values():
        assert wording.IMPOSSIBLE in text


def test_the_moment_and_the_constant_are_printed_with_their_uncertainty(known: DiagnosisFit) -> None:
    (found,) = known.effects
    step = replace(known, effects=(replace(found, index="247", between=("227", "247")),))
    warm = replace(
        known,
        effects=(
            replace(
                found,
                effect=replace(found.effect, shape={"time_constant_s": 833.0}),
                shape_std={"time_constant_s": 100.0},
            ),
        ),
    )
    for text in everywhere(step).values():
        assert "between readings 227 and 247" in text
    for text in everywhere(warm).values():
        assert "time constant 830 ± 200 s" in text
    (effect,) = DiagnosisOutcome(step).document()["effects"]
    assert effect["between"] == [227, 247]
    (effect,) = DiagnosisOutcome(warm).document()["effects"]
    assert effect["shape_std"] == {"time_constant_s": 100.0}


def test_shares_and_carried_terms_are_in_every_presentation(known: DiagnosisFit) -> None:
    (found,) = known.effects
    moved = CarriedTerm(
        replace(found.effect, group="carried", terms=(replace(found.effect.terms[0], slot="d5"),)),
        found.values,
        found.covariance,
        0.75,
        1e-9,
        "time",
        ("189", "231"),
    )
    carried = replace(unexplained(known), carried=(moved,), shares=Shares(0.25, 0.5, 0.25))
    sentence = wording.carried_in_words(moved)
    assert sentence.startswith("The offset d5 changed by")
    assert "between readings 189 and 231" in sentence
    assert "75.0\u00a0% of what the named effects leave" in sentence
    for text in everywhere(carried).values():
        assert " ".join(sentence.split()) in " ".join(text.replace("−", "-").split())
        assert "50\u00a0% is carried without a cause" in text.replace("\n", " ")
    document = DiagnosisOutcome(carried).document()
    assert document["shares"] == {"named": 0.25, "carried": 0.5, "noise": 0.25}
    assert document["carried"][0]["finding"] == sentence
    faint = replace(moved, covariance=100.0**2 * moved.covariance)
    (only, rest) = wording.stated_carried([moved, faint, faint])
    assert only == sentence
    assert rest.startswith("2 other terms")
    follows = wording.carried_in_words(replace(moved, between=None))
    assert follows.startswith("An error of the offset d5 follows time")


def with_tool(data: Path) -> IdentificationFit:
    """The base model with base and tool targets free, which start where they fit best."""
    dataset = read_dataset(data)
    dataset = replace(dataset, header=replace(dataset.header, world="free"))
    return identify(dataset, groups=[*dataset.header.groups, "tool"])


def test_absolute_values_predict_what_the_model_predicts(data: Path) -> None:
    """A model without start values gives the same points, so no value is left in a hidden start."""
    found = with_tool(data)
    model, conditions = found.model, found.readings.conditions
    zero = {s: dict.fromkeys(targets, (0.0, 0.0, 0.0)) for s, targets in model.targets.items()}
    bare = replace(model, placements={}, targets=zero, turns={})
    value = absolutes(model, found.estimate, found.covariance)
    rows = {row.name: row for row in rows_of(found)}
    estimate = np.array(
        [
            to_internal(
                value[p.name][0] - ((rows[p.name].nominal or 0.0) if rows[p.name].owner == "robot" else 0.0),
                p.unit,
            )
            for p in model.parameters
        ]
    )
    np.testing.assert_allclose(
        BoundModel(bare, conditions).predict(estimate), found.predict(conditions), atol=1e-6
    )


def test_parameters_show_value_nominal_and_change(data: Path) -> None:
    found = with_tool(data)
    dataset = read_dataset(data)
    shown = {p.name: p.model_dump() for p in rows_of(found)}
    (target, stated), *_ = dataset.header.targets.items()
    for axis, nominal in zip("xyz", stated, strict=True):
        each = shown[f"{target}.{axis}"]
        assert each["nominal"] == nominal
        assert abs(each["absolute"] - nominal) < 5.0
        assert each["change_from_nominal"] == pytest.approx(each["absolute"] - nominal)
    assert shown["base.x"]["nominal"] is None
    assert shown["base.x"]["change_from_nominal"] is None
    links = [
        p for p in shown.values() if p["nominal"] is not None and p["owner"] == "robot" and not p["dropped"]
    ]
    for each in links:
        assert each["absolute"] == pytest.approx(each["nominal"] + each["value"])
    plain = identify(dataset)
    (base, *_) = rows_of(plain)
    assert (base.name, base.nominal) == ("base.x", 0.0)  # the world is given
    assert base.change_from_nominal == base.absolute
    frame = truepose.identify(data).parameters
    for row in rows_of(plain):
        if row.absolute is not None:
            assert frame.loc[row.name, "absolute"] == pytest.approx(row.absolute)


def test_the_uncertainty_of_a_turned_base_is_turned_with_it(data: Path) -> None:
    found = identify(read_dataset(data))
    (series,) = found.model.targets
    assert found.model.robot.base == "thesis"  # a turn about z leaves d_1 as it is
    quarter = np.array(
        [[0.0, -1.0, 0.0, 10.0], [1.0, 0.0, 0.0, 20.0], [0.0, 0.0, 1.0, 30.0], [0.0, 0.0, 0.0, 1.0]]
    )
    turned = replace(found.model, placements={series: quarter})
    at = {name: found.model.index[f"base.{name}"] for name in ("x", "y", "z")}
    estimate, covariance = np.zeros(len(found.estimate)), np.zeros_like(found.covariance)
    estimate[at["x"]] = 1.0
    covariance[at["x"], at["x"]] = 0.25
    value = absolutes(turned, estimate, covariance)
    assert value["base.x"] == pytest.approx((10.0, 0.0), abs=1e-6)
    assert value["base.y"] == pytest.approx((21.0, 0.5), abs=1e-6)
    assert value["base.rz"][0] == pytest.approx(90.0)


def test_no_share_is_zero_and_what_cannot_show_is_said_so() -> None:
    assert "less than 0.1" in wording.structure_in_words(
        ResidualStructure("region of the workspace", 1e-6, 0.0)
    )
    assert "0.1\u00a0%" in wording.structure_in_words(
        ResidualStructure("region of the workspace", 1e-6, 0.001)
    )
    seen, hidden = power_of(
        [
            DetectableEffect("backlash:j4", 0.004, "deg"),
            DetectableEffect("backlash:j5", None, "deg"),
            DetectableEffect("encoder_scale:j1", None, "ppm"),
        ]
    )
    assert (seen["least"], seen["most"]) == ("0.004", "these readings cannot show it")
    assert hidden["least"] == "these readings cannot show it"


def test_no_mistake_is_printed_twice() -> None:
    mistakes = tuple(
        RobotFileMistake(what, (f"line {i}",)) for i, what in enumerate(["sign of alpha1", "base", "base"])
    )
    verdict = RobotFileVerdict(20, mistakes, 5.0, 0.1, 1000.0, False)
    lines = list(verdict_lines(verdict))
    assert len([line for line in lines if "base" in line]) == 1
    assert "    line 1" in lines
    assert "    line 2" in lines
