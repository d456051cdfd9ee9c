"""The ladder at the head of a report: every model once, with the error that a step removes."""

from __future__ import annotations

import html
import re
from dataclasses import replace

import pytest

from acquisition.record import Verification
from calib.data import read_dataset
from calib.diagnose import DiagnosisFit, diagnose
from calib.fit import ErrorStatistics
from service.report import diagnosis_report
from service.report.sections.ladder import BASE, EFFECTS, HELD_OUT, NOMINAL, VERIFIED, ladder_of
from service.results.models.diagnosed import DiagnosisOutcome
from tests.service.campaigns import write_data


def errors(rms: float, n: int = 40) -> ErrorStatistics:
    return ErrorStatistics(n=n, rms=rms, mean=0.9 * rms, p95=1.7 * rms, max=2.5 * rms)


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> DiagnosisFit:
    """The diagnosis of a robot that hides no effect."""
    return diagnose(read_dataset(write_data(tmp_path_factory.mktemp("sound"), effects=(), n=60)))


def table_of(page: str) -> str:
    found = re.search(r'<table class="ladder">.*?</table>', page, re.DOTALL)
    assert found is not None
    return html.unescape(found[0])


def test_every_step_is_counted_from_the_rung_above() -> None:
    rungs = ladder_of(
        {NOMINAL: errors(0.663), BASE: errors(0.0652), EFFECTS: errors(0.0651)}, errors(0.08, 12)
    )
    assert [r.name for r in rungs] == [NOMINAL, BASE, EFFECTS, VERIFIED]
    assert [r.step for r in rungs] == ["", "−0.598 mm (−90\u00a0%)", "none", "+0.015 mm (+23\u00a0%)"]
    assert [r.errors.n for r in rungs] == [40, 40, 40, 12]
    assert [r.judged == HELD_OUT for r in rungs] == [True, True, True, False]


def test_nothing_held_out_is_no_ladder() -> None:
    assert ladder_of({NOMINAL: None, BASE: None}) == []


def test_a_report_opens_with_the_robot_as_found_and_names_every_model_once(sound: DiagnosisFit) -> None:
    assert sound.effects == ()
    assert sound.error_nominal is not None
    page = diagnosis_report(sound, DiagnosisOutcome(sound).document())
    ladder = table_of(page)
    assert f"{sound.error_nominal.rms:.3f}</td>" in ladder
    assert page.index(f"{sound.error_nominal.rms:.3f} mm</span>") < page.index('<table class="ladder">')
    assert (page.count(NOMINAL), page.count(BASE), page.count(EFFECTS)) == (1, 1, 0)


def test_the_verified_robot_is_the_last_rung(sound: DiagnosisFit) -> None:
    driven = Verification(
        uncorrected=errors(0.7, 12),
        verified=errors(0.0234, 12),
        floor_mm=0.02,
        poses=12,
        refused=(),
        nests_off_mm=0.0,
        approach="from below",
    )
    page = diagnosis_report(sound, DiagnosisOutcome(sound).document(), verified=driven)
    last = table_of(page).split("<tr")[-1]
    assert VERIFIED in last
    assert "0.023</td>" in last
    without = diagnosis_report(
        sound, DiagnosisOutcome(sound).document(), verified=replace(driven, uncorrected=None)
    )
    assert (page.count("Driven uncorrected"), without.count("Driven uncorrected")) == (1, 0)
    assert page.count(NOMINAL) == 1


def test_without_held_out_readings_there_is_no_ladder(sound: DiagnosisFit) -> None:
    unjudged = replace(sound, error_nominal=None, error_before=None, error_after=None)
    page = diagnosis_report(unjudged, DiagnosisOutcome(unjudged).document())
    assert 'class="ladder"' not in page
    assert "nothing here was judged" in page
