"""Acceptance: limits with guard bands, the same verdict in HTML, JSON and exit code."""

from __future__ import annotations

import html
import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib.data import Dataset, read_dataset
from calib.fit import base_model_of, errors_on, place_nominal
from service.cli import main
from service.results.judgement.acceptance import (
    RULE,
    AcceptanceLimits,
    AcceptanceResult,
    AcceptanceShown,
    Criterion,
    Verdict,
    decide,
)
from tests.service.campaigns import edit_rows, write_data


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_data(tmp_path_factory.mktemp("acceptance"), effects=(), n=60)


def held(dataset: Dataset, limits: AcceptanceLimits) -> AcceptanceResult:
    """Place the nominal robot and judge it by the limits."""
    nominal, placed = place_nominal(dataset, base_model_of(dataset))
    return decide(limits, dataset, dataset.validation_rows, nominal, placed, "nominal")


def uncertainty(dataset: Dataset, limits: AcceptanceLimits) -> float:
    (criterion,) = held(dataset, limits).criteria
    return criterion.uncertainty


@pytest.mark.parametrize(
    ("limit", "verdict"),
    [
        (0.13, "accepted"),
        (0.125, "accepted"),
        (0.11, "not_decided"),
        (0.09, "not_decided"),
        (0.07, "rejected"),
    ],
)
def test_the_guard_band_decides(limit: float, verdict: Verdict) -> None:
    assert Criterion("rms", 0.1, limit, 0.025, "").verdict == verdict


def test_one_rejected_figure_rejects_and_all_must_be_accepted() -> None:
    good, open_, bad = (Criterion("rms", 0.1, limit, 0.02, "") for limit in (0.2, 0.11, 0.05))
    assert AcceptanceResult("m", 9, (good, good)).verdict == "accepted"
    assert AcceptanceResult("m", 9, (good, open_)).verdict == "not_decided"
    assert AcceptanceResult("m", 9, (bad, open_)).verdict == "rejected"


def test_the_uncertainty_of_an_rms_is_that_of_its_poses(data: Path) -> None:
    dataset, limits = read_dataset(data), AcceptanceLimits(0.1, None)
    nominal, placed = place_nominal(dataset, base_model_of(dataset))
    squares = errors_on(dataset, dataset.validation_rows, nominal, placed) ** 2
    n = len(squares)
    by_hand = (
        2.045 * squares.std(ddof=1) / math.sqrt(n) / (2.0 * math.sqrt(squares.mean()))
    )  # t of 29, delta method
    assert n == 30
    assert uncertainty(dataset, limits) == pytest.approx(by_hand, rel=0.1)
    assert uncertainty(dataset, limits) == uncertainty(dataset, limits)


def test_reading_a_pose_again_makes_no_rms_surer(data: Path, tmp_path: Path) -> None:
    (tmp_path / "data.toml").write_bytes(data.with_suffix(".toml").read_bytes())
    (tmp_path / "data.csv").write_bytes(data.read_bytes())

    def thrice(rows: list[dict[str, str]]) -> None:
        again = [row for row in rows if row["set"] == "validation"] * 2
        rows += [{**row, "reading_id": str(10_000 + i)} for i, row in enumerate(again)]

    edit_rows(tmp_path / "data.csv", thrice)
    more, limits = read_dataset(tmp_path / "data.csv"), AcceptanceLimits(0.1, None)
    assert more.validation_rows.sum() == 90
    assert uncertainty(more, limits) == pytest.approx(uncertainty(read_dataset(data), limits), rel=1e-6)


def test_a_single_pose_decides_nothing(data: Path) -> None:
    dataset = read_dataset(data)
    first = np.flatnonzero(dataset.validation_rows)[0]
    sets = np.where(np.arange(len(dataset)) == first, "validation", "calibration")
    found = held(replace(dataset, sets=sets), AcceptanceLimits(1e6, None))
    assert found.verdict == "not_decided"
    assert AcceptanceShown.model_validate(found).criteria[0].expanded_uncertainty_mm is None


def test_the_largest_error_is_as_sure_as_its_noisiest_reading(data: Path) -> None:
    dataset = read_dataset(data)
    own = dataset.u_point.copy()
    own[dataset.validation_rows] = 0.01
    own[np.flatnonzero(dataset.validation_rows)[3]] = (0.01, 0.04, 0.01)
    found = held(replace(dataset, u_point=own), AcceptanceLimits(None, 0.1)).criteria[0]
    assert found.uncertainty == pytest.approx(0.08)
    nominal, placed = place_nominal(dataset, base_model_of(dataset))
    assert found.figure == errors_on(dataset, dataset.validation_rows, nominal, placed).max()


def test_identify_says_its_verdict_everywhere(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    result, report = tmp_path / "r.json", tmp_path / "r.html"
    asked = ["identify", str(data), "--json", str(result), "--report", str(report)]
    assert main([*asked, "--accept-rms", "5", "--accept-max", "9"]) == 0
    found = json.loads(result.read_text("utf-8"))
    rms, largest = found["acceptance"]["criteria"]
    assert (found["acceptance"]["verdict"], found["acceptance"]["rule"]) == ("accepted", RULE)
    assert rms["figure_mm"] == pytest.approx(found["error_identified_mm"]["rms"])
    assert largest["figure_mm"] == pytest.approx(found["error_identified_mm"]["max"])
    page = html.unescape(report.read_text("utf-8"))
    assert "<b>Accepted</b>: identified base model, 30 readings" in page
    assert RULE in page
    assert "bootstrap over 30 whole poses" in page
    capsys.readouterr()
    assert main([*asked, "--accept-rms", f"{rms['figure_mm']:.6f}"]) == 3  # within U of the limit
    assert json.loads(result.read_text("utf-8"))["acceptance"]["verdict"] == "not_decided"
    assert "Not decided" in report.read_text("utf-8")
    shown = capsys.readouterr()
    assert "Acceptance: Not decided" in shown.out
    assert "truepose: not decided: RMS error" in shown.err


def test_validate_judges_a_model_by_its_limits(data: Path, tmp_path: Path) -> None:
    model, result = tmp_path / "m.json", tmp_path / "v.json"
    assert main(["identify", str(data), "--model", str(model)]) == 0
    asked = ["validate", str(data), "--model", str(model), "--json", str(result)]
    assert main([*asked, "--accept-max", "9"]) == 0
    found = json.loads(result.read_text("utf-8"))
    assert found["acceptance"]["criteria"][0]["figure_mm"] == found["judgements"][1]["position_mm"]["max"]
    assert main([*asked, "--accept-max", "0.0001"]) == 3
    assert json.loads(result.read_text("utf-8"))["acceptance"]["verdict"] == "rejected"


@pytest.mark.parametrize("command", ["identify", "diagnose", "validate"])
@pytest.mark.parametrize(("option", "value"), [("--accept-rms", "0"), ("--accept-max", "nan")])
def test_a_limit_that_is_none_is_refused(
    command: str, option: str, value: str, data: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([command, str(data), option, value]) == 2
    assert option in capsys.readouterr().err


def test_limits_without_readings_to_judge_by_are_refused(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "data.toml").write_bytes(data.with_suffix(".toml").read_bytes())
    (tmp_path / "data.csv").write_bytes(data.read_bytes())
    edit_rows(tmp_path / "data.csv", lambda rows: [row.update(set="calibration") for row in rows])
    for command in ("identify", "diagnose"):
        assert main([command, str(tmp_path / "data.csv"), "--accept-max", "1"]) == 2
        assert "no measured validation rows" in capsys.readouterr().err
    assert main(["validate", str(data), "--accept-rms", "1"]) == 2
    assert "--model" in capsys.readouterr().err
