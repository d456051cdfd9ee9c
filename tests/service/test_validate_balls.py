"""A ballbar judges the model of a tracker, which does not know its balls.

These would catch: a judged distance that takes part in placing the balls, balls that are placed for one robot only, a
tracker's model that a ballbar cannot judge, and fronts that place the balls differently.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fastapi.testclient import TestClient

import truepose
from calib.data import read_dataset
from calib.fit import errors_on
from calib.saved import load_model
from mocks.campaign import make_campaign
from service import job_folder
from service.cli import main
from service.http.access.roles import ServiceSettings, Tokens
from service.http.app import create_app
from service.results.judgement.validation import LoadedModel, ValidationRequest
from service.results.judgement.validation import validate as validated
from tests.benchmarks.nests import example, header_of, legs_of, truth_of
from tests.calib.campaigns import Row, write_files
from tests.service.test_http_orders import Here

SEED = 5
TOKENS = Tokens("only-for-the-tests-of-balls", "only-to-look-at-the-tests-of-balls")
_CELL, _VISITS = example()
ROWS = legs_of(truth_of(_CELL, SEED), _CELL, _VISITS[::4])
# Joints that come to rest within 0.0008 deg, a metre away, and the tracker's calibration
NEAR_NOISE_MM = 0.03
FREE = {"base_targets": "free", "tool_targets_u_mm": 0.05}
U_MM = {"base_targets_u_mm": 0.3, "tool_targets_u_mm": 0.05}


@pytest.fixture(scope="module")
def tracker(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Tracker data of the arm that the ballbar measures, and its model tracker.json."""
    folder = tmp_path_factory.mktemp("tracker")
    campaign = make_campaign(
        _CELL.robot.model.name,
        SEED,
        200,
        20,
        [],
        targets=_CELL.tool.targets,
        tool_mass_kg=_CELL.tool.mass_kg,
        tool_cog_mm=_CELL.tool.cog_mm,
    )
    data = write_files(folder, campaign.rows, campaign.header, "tracker")
    assert main(["identify", str(data), "--model", str(folder / "tracker.json")]) == 0
    return data


def legs(folder: Path, rows: list[Row], **header: Any) -> Path:
    return write_files(folder, rows, header_of(_CELL, _CELL.nests, _CELL.tool.targets, **header), "legs")


def judging(which: int | None = None, *, off_mm: float = 0.0) -> list[Row]:
    """All legs as validation rows, one of them with an error."""
    return [
        row | {"set": "validation", "length_mm": row["length_mm"] + (off_mm if k == which else 0.0)}
        for k, row in enumerate(ROWS)
    ]


def validate(legs: Path, tracker: Path, *options: str) -> dict[str, Any]:
    out = legs.with_suffix(".json")
    model = tracker.with_suffix(".json")
    assert main(["validate", str(legs), "--model", str(model), *options, "--json", str(out)]) == 0
    return json.loads(out.read_text("utf-8"))


@pytest.mark.parametrize("header", [FREE, U_MM, {"world": "free"}], ids=["free", "u_mm", "world"])
def test_a_ballbar_judges_the_model_of_a_tracker(
    header: dict[str, Any], tracker: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Also where the header takes cups for exact that are 0.3 mm off."""
    document = validate(legs(tmp_path, judging(), **header), tracker)
    nominal, judged = document["judgements"]
    assert judged["length_mm"]["rms"] < NEAR_NOISE_MM
    assert nominal["length_mm"]["rms"] > 20.0 * judged["length_mm"]["rms"]
    assert nominal["length_mm"]["n"] == judged["length_mm"]["n"]
    placed = document["balls"]
    assert (placed["by"], placed["distances"] + judged["length_mm"]["n"]) == ("half", len(ROWS))
    assert placed["distances"] == pytest.approx(len(ROWS) / 2, abs=6)
    assert document["placed"]
    assert f"{placed['distances']} distances (half of the poses" in " ".join(capsys.readouterr().out.split())


def test_calibration_rows_place_the_balls_where_there_are_any(tracker: Path, tmp_path: Path) -> None:
    rows = [row | {"set": "validation" if k % 12 < 6 else "calibration"} for k, row in enumerate(ROWS)]
    document = validate(legs(tmp_path, rows, **FREE), tracker)
    assert document["balls"] == {"by": "calibration", "distances": 54}
    assert document["judgements"][1]["length_mm"]["n"] == len(ROWS) - 54
    assert document["judgements"][1]["length_mm"]["rms"] < NEAR_NOISE_MM


def test_a_judged_distance_places_nothing(tracker: Path, tmp_path: Path) -> None:
    """One that is off by 5 mm changes its own error and no other."""
    read = LoadedModel(load_model(tracker.with_suffix(".json")), tracker)
    own = validated(read_dataset(legs(tmp_path / "own", judging(), **FREE)), read, ValidationRequest())
    judged = np.flatnonzero(own.dataset.validation_rows)
    off = judging(int(judged[0]), off_mm=5.0)
    other = validated(read_dataset(legs(tmp_path / "off", off, **FREE)), read, ValidationRequest())
    assert np.array_equal(other.dataset.sets, own.dataset.sets)
    assert len(own.models) == 2
    for name in own.models:
        dataset, model, estimate = own.models[name]
        before = errors_on(dataset, dataset.validation_rows, model, estimate)
        dataset, model, estimate = other.models[name]
        after = errors_on(dataset, dataset.validation_rows, model, estimate)
        assert after[1:] == pytest.approx(before[1:], abs=1e-9)
        assert abs(after[0] - before[0]) > 3.0


def test_both_models_of_a_comparison_are_placed_alike(tracker: Path, tmp_path: Path) -> None:
    data = legs(tmp_path, [*ROWS], **U_MM)
    assert main(["identify", str(data), "--model", str(tmp_path / "own.json")]) == 0
    document = validate(legs(tmp_path, judging(), **U_MM), tracker, "--compare", str(tmp_path / "own.json"))
    nominal, judged, own = (each["length_mm"]["rms"] for each in document["judgements"])
    assert max(judged, own) < NEAR_NOISE_MM < nominal
    alone = tmp_path / "alone.json"
    words = ["validate", str(data.with_name("legs.csv")), "--model", str(tmp_path / "own.json")]
    assert main([*words, "--json", str(alone)]) == 0
    assert json.loads(alone.read_text("utf-8"))["balls"] is None  # it knows its balls
    assert main([*words, "--place", "--json", str(alone)]) == 0
    assert json.loads(alone.read_text("utf-8"))["balls"]["by"] == "half"


def test_all_rows_flatter(tracker: Path, tmp_path: Path) -> None:
    document = validate(legs(tmp_path, judging(), **FREE), tracker, "--all")
    assert document["judgements"][1]["length_mm"]["n"] == len(ROWS)
    assert any("among those judged" in text for text in document["warnings"])


def test_too_few_distances_are_refused(
    tracker: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    of_b3 = [row for row in judging() if row["base_target"] == "B3"]
    others = [row for row in judging() if row["base_target"] != "B3"]
    for rows, said in (
        (others + of_b3[:6], "base target 'B3' has"),
        (
            [row | {"set": "calibration"} for row in ROWS[:36]] + judging()[36:],
            "open where the base target 'B2' is",
        ),
    ):
        data = legs(tmp_path, rows, **FREE)
        assert main(["validate", str(data), "--model", str(tracker.with_suffix(".json"))]) == 2
        assert said in capsys.readouterr().err


def test_the_report_shows_the_judged_half(tracker: Path, tmp_path: Path) -> None:
    report = tmp_path / "r.html"
    document = validate(legs(tmp_path, judging(), **FREE), tracker, "--report", str(report))
    assert f"{document['judgements'][1]['length_mm']['rms']:.3f}" in report.read_text("utf-8")


@pytest.fixture
def here(tracker: Path, tmp_path: Path) -> Iterator[Here]:
    settings = ServiceSettings(record=tmp_path / "record", tokens=TOKENS, cell=_CELL)
    with TestClient(create_app(settings), base_url="http://127.0.0.1/api/v1") as client:
        client.headers |= {"Authorization": f"Bearer {TOKENS.operator}"}
        yield Here(client, tmp_path / "record", tracker)


def test_three_fronts_judge_alike(here: Here, tracker: Path, tmp_path: Path) -> None:
    data = legs(tmp_path, judging(), **U_MM)
    files = {"csv": data.read_bytes(), "toml": data.with_suffix(".toml").read_bytes()}
    dataset = here.client.post("/datasets", files=files).json()["id"]
    served = here.done("/validations", dataset_id=dataset, model_id=here.model)["result"]
    model = here.record / "identifications" / here.model / job_folder.MODEL
    out = tmp_path / "v.json"
    assert main(["validate", str(data), "--model", str(model), "--json", str(out)]) == 0
    by_command = json.loads(out.read_text("utf-8"))
    assert {**served, "data": None} == {**by_command, "data": None}
    in_python = truepose.validate(truepose.load(model), data).result
    assert in_python.balls is not None
    assert in_python.balls.model_dump() == by_command["balls"]
    assert in_python.judgements[1].error.rms == by_command["judgements"][1]["length_mm"]["rms"]
