"""The report: its content, its independence of other files, and names that stay names."""

from __future__ import annotations

import html
import json
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from acquisition.loop.loop import FollowUpResult
from calib.data.read import read_dataset
from calib.diagnose.diagnosis import DiagnosisFit, diagnose
from calib.effects import check_of
from calib.units import DEG
from service import wording
from service.cli import main
from service.report import diagnosis_report
from service.report.figures.errors import ErrorSample, common_bins
from service.report.figures.panels import of_effect
from service.report.figures.residuals import MDEG, PlotSample
from service.report.scope import scope_of
from service.report.sections.follow_up_section import middle_step_in_words
from service.report.sections.judged import stretches
from service.results.cell.loop_results import FollowUpResponse
from service.results.models.diagnosed import DiagnosisOutcome
from service.results.shape import document_of
from tests.service.campaigns import edit_rows, edit_text, write_data, write_narrow_data

HOSTILE = "<script>alert(1)</script>"


@pytest.fixture(scope="module")
def diagnosis(tmp_path_factory: pytest.TempPathFactory) -> DiagnosisFit:
    return diagnose(read_dataset(write_data(tmp_path_factory.mktemp("report"))))


@pytest.fixture(scope="module")
def narrow(tmp_path_factory: pytest.TempPathFactory) -> DiagnosisFit:
    return diagnose(read_dataset(write_narrow_data(tmp_path_factory.mktemp("narrow"))))


@pytest.fixture(scope="module")
def page(diagnosis: DiagnosisFit) -> str:
    return diagnosis_report(diagnosis, DiagnosisOutcome(diagnosis).document())


class Elements(HTMLParser):
    """Collects start tags with attributes, and that every element is closed."""

    VOID = ("meta", "link", "br", "img", "input", "hr")

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.open: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def test_the_report_asks_nobody_for_anything(page: str) -> None:
    elements = Elements(page)
    for tag, attributes in elements.tags:
        assert tag not in ("link", "img", "iframe", "object")
        for name in ("src", "href", "xlink:href", "action", "srcset"):
            assert (attributes.get(name) or "#").startswith("#")
    assert not re.search(r"url\((?!#)", page)
    assert "@import" not in page
    assert [a.get("type") for tag, a in elements.tags if tag == "script"] == ["application/json"]


def test_the_report_is_well_formed_and_its_ids_are_its_own(page: str) -> None:
    elements = Elements(page)
    assert elements.open == []
    ids = [a["id"] for _, a in elements.tags if "id" in a]
    assert len(ids) == len(set(ids))
    targets = {a["xlink:href"] for _, a in elements.tags if "xlink:href" in a}
    assert targets <= {f"#{name}" for name in ids}
    pictures = [a for tag, a in elements.tags if tag == "svg"]
    assert len(pictures) == 10  # three of them on the first page
    assert all(a.get("role") == "img" and a.get("aria-label") for a in pictures)


def test_every_effect_is_said_in_one_sentence(page: str, diagnosis: DiagnosisFit) -> None:
    (found,) = diagnosis.effects
    sentence = wording.sentence_of(found)
    assert re.fullmatch(r"Joint 4 has play: .*: -?0\.\d+ ± 0\.\d+ deg \(k = 2\)\.", sentence)
    assert html.escape(sentence).replace(" -", " −") in page


def test_the_report_says_what_a_reader_must_know(page: str, diagnosis: DiagnosisFit) -> None:
    data = diagnosis.dataset
    text = html.unescape(page)
    for piece in (
        data.sha256,
        data.header.instrument,
        wording.verdict_in_words(diagnosis),
        wording.holdout_in_words("as measured"),
        wording.CLOSING,
        "mean 0.0",
        "both sides on every joint",
        "dropped: confounded with",
        *wording.grouped(diagnosis.final.warnings),
        *diagnosis.notes,
    ):
        assert piece in text
    assert "SIMULATED" in text
    assert DiagnosisOutcome(diagnosis).document()["simulated"] is True


def test_the_report_says_what_to_check_and_what_it_is_worth(page: str, diagnosis: DiagnosisFit) -> None:
    (found,) = diagnosis.effects
    text = html.unescape(page)
    assert check_of(found.effect.label) in text
    after = diagnosis.error_after
    assert after is not None
    assert re.search(rf"\d\.\d\d\d mm without it, {wording.millimetres(after.rms)} mm with it", text)
    assert "What to measure next" not in text
    assert "patch" not in text


def test_many_effects_are_listed_by_group() -> None:
    found = [
        SimpleNamespace(effect=SimpleNamespace(label=str(i), group=group))
        for i, group in enumerate(["thermal", "transmission", "instrument", "transmission"] * 2)
    ]
    few: Any = found[:4]
    assert wording.by_group(few) == [("", few)]
    many: Any = found
    groups = wording.by_group(many)
    assert [name for name, _ in groups] == ["transmission", "instrument", "thermal"]
    assert [each.effect.label for each in groups[0][1]] == ["1", "3", "5", "7"]


def test_the_middle_step_is_told(diagnosis: DiagnosisFit, narrow: DiagnosisFit) -> None:
    assert narrow.follow_up is not None
    step = FollowUpResult(narrow, narrow.follow_up, 12)
    text = html.unescape(
        diagnosis_report(
            diagnosis,
            DiagnosisOutcome(diagnosis).document() | document_of(FollowUpResponse.of(step)),
            followed_up=step,
        )
    )
    assert "What was ambiguous, and how it was settled" in text
    classes = " or ".join(narrow.effects[0].evidence.candidates)
    assert f"could not decide: {classes}. 12 poses were chosen" in text
    assert "(12 readings); with them the readings name backlash:j4." in text
    assert narrow.error_after is not None
    assert f"{narrow.error_after.rms:.3f}</td>" in text
    assert Elements(text).open == []


def test_what_stays_ambiguous_is_said(narrow: DiagnosisFit) -> None:
    assert narrow.follow_up is not None
    sentence = middle_step_in_words(FollowUpResult(narrow, narrow.follow_up, 12), narrow)
    assert (
        f"the readings still cannot distinguish {narrow.effects[0].effect.label} from its rivals" in sentence
    )


def test_the_copy_for_programs_is_the_document(page: str, diagnosis: DiagnosisFit) -> None:
    found = re.search(r'<script type="application/json" id="truepose-result">(.*?)</script>', page, re.DOTALL)
    assert found is not None
    assert json.loads(found[1]) == json.loads(json.dumps(DiagnosisOutcome(diagnosis).document()))


def test_before_and_after_share_their_bins() -> None:
    random = np.random.default_rng(1)
    for factor in (2.0, 30.0):
        before = ErrorSample("before", factor * random.rayleigh(0.05, 300), "#000000")
        after = ErrorSample("after", random.rayleigh(0.05, 200), "#000000")
        edges, ratio = common_bins([before, after])
        assert ratio == (factor > 10.0)
        assert np.all(np.diff(edges) > 0.0)
        assert edges[-1] >= max(before.distances.max(), after.distances.max())


def test_bins_survive_errors_of_zero() -> None:
    edges, _ = common_bins(
        [ErrorSample("a", np.zeros(5), "#000000"), ErrorSample("b", np.ones(5), "#000000")]
    )
    assert np.all(np.diff(edges) > 0.0)


def test_readings_follow_the_law_that_is_drawn_through_them(diagnosis: DiagnosisFit) -> None:
    (found,) = diagnosis.effects
    panel = of_effect(PlotSample.of(diagnosis.dataset, diagnosis.final), found.effect)
    assert panel.side is not None
    gap = float(found.values[0]) / MDEG
    for side in (1.0, -1.0):
        mine = panel.clear & (panel.side == side)
        mean = np.average(panel.y[mine], weights=1.0 / panel.sd[mine] ** 2)
        assert mean == pytest.approx(0.5 * gap * side, rel=0.1)


def test_names_cannot_break_out_of_the_page(tmp_path: Path) -> None:
    data = write_data(tmp_path)
    edit_text(data.with_suffix(".toml"), '"faro-ion"', f"'{HOSTILE}'")

    def spoil(rows: list[dict[str, str]]) -> None:
        row = next(row for row in rows if row["set"] == "calibration")
        row.update(reading_id=HOSTILE, x_mm=str(float(row["x_mm"]) + 50.0))

    edit_rows(data, spoil)
    report = tmp_path / "report.html"
    assert main(["diagnose", str(data), "--report", str(report), "--json", str(tmp_path / "r.json")]) == 0
    page = report.read_text("utf-8")
    assert HOSTILE in json.loads((tmp_path / "r.json").read_text("utf-8"))["faulty_rows"]
    assert HOSTILE not in page
    assert page.count(html.escape(HOSTILE)) >= 2
    assert [a.get("type") for tag, a in Elements(page).tags if tag == "script"] == ["application/json"]


def test_an_identification_has_a_report_too(tmp_path: Path) -> None:
    report = tmp_path / "report.html"
    assert main(["identify", str(write_data(tmp_path)), "--report", str(report)]) == 0
    page = report.read_text("utf-8")
    assert Elements(page).open == []
    assert "Identification of abb-irb120" in page


def test_a_report_says_that_there_are_no_validation_rows_and_calls_simulated_only_what_is(
    tmp_path: Path,
) -> None:
    data = write_data(tmp_path)
    edit_rows(data, lambda rows: [row.update(set="calibration") for row in rows])
    edit_text(data.with_suffix(".toml"), "simulated = true", "simulated = false")
    report, document = tmp_path / "report.html", tmp_path / "report.json"
    assert main(["diagnose", str(data), "--report", str(report), "--json", str(document)]) == 0
    page = report.read_text("utf-8")
    assert "holds no measured validation readings" in page
    assert "SIMULATED" not in page
    assert json.loads(document.read_text("utf-8"))["simulated"] is False


def test_every_kind_of_effect_has_its_picture(tmp_path: Path) -> None:
    """Effects that a diagnosis alone offers, as found; the others: `test_report_pictures.py`."""
    effects = ("base_shift", "periodic:j1:n101", "tool_shift")
    result = diagnose(read_dataset(write_data(tmp_path, effects=effects, n=200)))
    assert sorted(found.effect.label for found in result.effects) == list(effects)
    sample = PlotSample.of(result.dataset, result.final)
    for found in result.effects:
        panel = of_effect(sample, found.effect)
        assert np.all(np.isfinite(panel.y))
        assert np.all(np.isfinite(panel.x))
        assert panel.x_label
        assert panel.y_label
    Elements(diagnosis_report(result, DiagnosisOutcome(result).document()))


def test_a_wire_without_checksums_is_named(tmp_path: Path) -> None:
    data = write_data(tmp_path)
    plain = read_dataset(data)
    header = data.with_suffix(".toml")
    header.write_text('unprotected = "robot: <moves> at once"\n' + header.read_text("utf-8"), "utf-8")
    scope = dict(scope_of(read_dataset(data)))
    assert scope["Not protected against damage on the wire"] == "robot: <moves> at once"
    assert len(scope_of(plain)) == len(scope) - 1


def test_the_scope_says_from_which_side_and_for_how_long(tmp_path: Path) -> None:
    data = read_dataset(write_data(tmp_path))
    sides, time = np.ones_like(data.conditions.side), np.zeros(len(data.conditions.time))
    time[np.flatnonzero(data.fit_rows)[-1]] = 7200.0
    noise = replace(data.header.noise, repeatability=DEG / 500.0)
    header = replace(data.header, noise=noise)
    scope = dict(
        scope_of(replace(data, conditions=replace(data.conditions, side=sides, time=time), header=header))
    )
    assert scope["Side of approach"] == "; ".join(f"J{k} from below" for k in range(1, 7))
    assert scope["Time"] == "0.0 to 2.0 h"
    assert "2 mdeg a joint" in scope["Declared noise (1 sigma)"]


def test_the_line_over_time_ends_where_measuring_paused() -> None:
    """Two evenings of 60 readings per hour are shuffled.

    A line over the night would show unmeasured values.
    """
    hours = np.random.default_rng(2).permutation(np.concatenate([np.arange(60), 1440 + np.arange(60)]) / 60.0)
    pieces = stretches(hours)
    assert [(min(hours[p[0]]), max(hours[p[-1]]) < 2.0) for p in pieces] == [(0.0, True), (24.0, False)]
    assert sorted(np.concatenate([rows for piece in pieces for rows in piece])) == list(range(120))
    assert len(stretches(hours[hours < 2.0])) == 1
