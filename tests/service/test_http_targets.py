"""Targets corrected over HTTP: the command line's numbers, refusals that name the target."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from service.cli import main
from tests.service.campaigns import write_data
from tests.service.test_http_support import Served, problem, served

TABLE = """target_id,note,j1_deg,j2_deg,j3_deg,j4_deg,j5_deg,j6_deg
a,"first, near",10,20,-30,40,50,60
b,,-20,30,-10,-40,-50,0
"""
POSE = {
    "target_id": "p",
    "x_mm": 350.0,
    "y_mm": 80.0,
    "z_mm": 400.0,
    "rot_w": 0.25881904510252074,
    "rot_x": 0.0,
    "rot_y": 0.9659258262890683,
    "rot_z": 0.0,
    "config": "front/up/noflip",
}


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_data(tmp_path_factory.mktemp("data"), n=60)


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    with served(tmp_path_factory.mktemp("record")) as running:
        yield running


@pytest.fixture(scope="module")
def path(service: Served, data: Path) -> str:
    """Return the path of the targets of a model with backlash in joint 4."""
    files = {"csv": data.read_bytes(), "toml": data.with_suffix(".toml").read_bytes()}
    dataset = service.client.post("/datasets", files=files).json()["id"]
    job = service.client.post("/diagnoses", json={"dataset_id": dataset}).json()["id"]
    assert service.until(f"/diagnoses/{job}", "succeeded", "failed")["state"] == "succeeded"
    return f"/models/{job}/targets"


def corrected(service: Served, path: str, **body: Any) -> dict[str, Any]:
    answer = service.client.post(path, json=body)
    assert answer.status_code == 200, answer.text
    return answer.json()


def test_a_table_is_corrected_as_on_the_command_line(
    service: Served, path: str, data: Path, tmp_path: Path
) -> None:
    told = corrected(service, path, csv=TABLE, conditions="side=below,temperature=23")
    (tmp_path / "t.csv").write_text(TABLE, "utf-8")
    model, out = tmp_path / "m.json", tmp_path / "o.csv"
    assert main(["diagnose", str(data), "--model", str(model)]) == 0
    options = ["--conditions", "side=below,temperature=23"]
    assert main(["compensate", str(model), str(tmp_path / "t.csv"), str(out), *options]) == 0
    assert told["csv"] == out.read_text("utf-8")
    assert (told["corrected"], told["refused"], told["format"]) == (2, 0, "truepose-compensation/1")
    assert 0.1 < told["largest_move_mm"] < 20.0
    rows = list(csv.DictReader(io.StringIO(told["csv"])))
    assert [row["note"] for row in rows] == ["first, near", ""]
    assert told["rows"][0]["target_id"] == "a"
    assert told["rows"][0]["j1_deg"] == float(rows[0]["j1_deg"]) != 10.0


def test_named_only_is_taken_and_what_is_left_out_is_said(service: Served, path: str) -> None:
    """Answer the same, and say so, for a model that carries nothing."""
    whole, named = (corrected(service, path, csv=TABLE, named_only=only) for only in (False, True))
    assert whole["csv"] == named["csv"]
    assert (named["carried_left_out"], named["carried_loss_mm"]) == ([], None)
    assert {t["radius_95_mm"] is None for t in named["targets"]} == {False}
    assert [t["outside_measured_range"] for t in named["targets"]] == [[], []]
    export = service.client.get(path.replace("/targets", "/exports/urdf"), params={"named_only": True}).json()
    assert (export["carried_left_out"], export["carried_loss_mm"]) == ([], None)


def test_json_targets_and_back(service: Served, path: str) -> None:
    rows = [row | {"note": row["note"] or "-"} for row in csv.DictReader(io.StringIO(TABLE))]
    numbers = [{k: float(v) if k.endswith("_deg") else v for k, v in row.items()} for row in rows]
    by_table = corrected(service, path, csv=TABLE)
    by_json = corrected(service, path, targets=numbers)
    for name in (f"j{k}_deg" for k in range(1, 7)):
        assert [row[name] for row in by_json["rows"]] == [row[name] for row in by_table["rows"]]
    ids = ("target_id", "note")
    there = [
        {k: v for k, v in row.items() if k not in ids} | {"target_id": row["target_id"]}
        for row in by_json["rows"]
    ]
    back = corrected(service, path, targets=there, inverse=True)
    for row, number in zip(back["rows"], numbers, strict=True):
        assert row["j3_deg"] == pytest.approx(number["j3_deg"], abs=1e-6)
    assert back["direction"] == "actual to nominal"


def test_a_pose_is_corrected_with_its_tool(service: Served, path: str) -> None:
    plain = corrected(service, path, targets=[POSE])
    tool = corrected(service, path, targets=[POSE], tool="0,0,100,0,0,0")
    assert plain["rows"][0]["config"] == "front/up/noflip"
    assert plain["rows"][0]["x_mm"] != tool["rows"][0]["x_mm"]


def test_what_cannot_be_corrected_is_named(service: Served, path: str) -> None:
    far = POSE | {"target_id": "far", "x_mm": 3000.0}
    told = problem(service.client.post(path, json={"targets": [POSE, far]}), 422)
    assert told["code"] == 8111
    assert [each["target"] for each in told["targets"]] == ["far"]
    assert "far" in told["detail"]
    kept = corrected(service, path, targets=[POSE, far], keep_refused=True)
    assert (kept["corrected"], kept["refused"]) == (1, 1)
    assert kept["rows"][1]["x_mm"] == 3000.0


@pytest.mark.parametrize(
    ("body", "words"),
    [
        ({}, "give either csv or targets"),
        ({"csv": TABLE, "targets": [POSE]}, "give either csv or targets"),
        ({"targets": [{"j1_deg": 1.0}]}, "target_id"),
        ({"targets": [{"target_id": "a", "j1_deg": 1.0}]}, "j2_deg"),
        ({"targets": [{"target_id": None}]}, "null"),
        ({"targets": [{"target_id": "\ud800"}]}, "not valid text"),
        ({"csv": "\ud800"}, "unicode"),
        ({"csv": TABLE.replace("-30", "nan")}, "line 2"),
        ({"csv": TABLE.replace("-30", "x")}, "line 2: column 'j3_deg'"),
        ({"csv": TABLE, "conditions": "side=left"}, "side"),
        ({"csv": TABLE, "conditions": "sides=below"}, "sides=below"),
        ({"csv": TABLE, "tool": "1,2,3"}, "tool"),
        ({"csv": TABLE, "inverse": 1}, "inverse"),
        ({"csv": "x"}, "target_id"),
        ({"csv": "target_id,j1_deg\n"}, "j2_deg"),
    ],
)
def test_bad_requests_name_the_place(service: Served, path: str, body: dict[str, Any], words: str) -> None:
    text = json.dumps(body).encode("utf-8", "surrogatepass")
    answer = service.client.post(path, content=text, headers={"Content-Type": "application/json"})
    assert words in problem(answer, 422)["detail"]


def test_a_model_that_is_not_there_is_404(service: Served) -> None:
    problem(service.client.post("/models/nothing/targets", json={"csv": TABLE}), 404)
