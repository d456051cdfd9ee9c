"""Commands that take a model with carried terms.

They report the omitted terms with their cost, and judge both models.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from calib import read_dataset, save_model
from mocks.campaign import make_campaign, write_campaign
from service.cli import main
from tests.calib.carrying import carrying

STEP, JOINT = "carried:d5:time:2", "carried:theta4:angle:1"
TABLE = "target_id,j1_deg,j2_deg,j3_deg,j4_deg,j5_deg,j6_deg\na,10,20,-30,40,50,60\nb,10,20,65,40,50,60\n"


@pytest.fixture(scope="module")
def cell(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("cell")
    write_campaign(make_campaign(seed=53, n=160, n_validation=40, effects=[]), folder)
    save_model(folder / "m.json", carrying(read_dataset(folder / "data.csv"))[1])
    (folder / "t.csv").write_text(TABLE, encoding="utf-8")
    return folder


def result(tmp_path: Path, *arguments: str) -> dict[str, Any]:
    assert main([*arguments, "--json", str(tmp_path / "r.json")]) == 0
    return json.loads((tmp_path / "r.json").read_text("utf-8"))


def test_compensate_marks_targets_and_says_what_it_leaves_out(
    cell: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    ask = ("compensate", str(cell / "m.json"), str(cell / "t.csv"), str(tmp_path / "o.csv"))
    whole = result(tmp_path, *ask)
    shown = capsys.readouterr()
    assert whole["carried_left_out"] == [STEP]
    assert 0.05 < whole["carried_loss_mm"]["rms"] < 0.3
    assert STEP in shown.err
    inside, outside = whole["targets"]
    assert (inside["outside_measured_range"], outside["outside_measured_range"]) == ([], ["joint 3"])
    assert "outside measured range: joint 3" in outside["notes"][-1]
    assert outside["radius_95_mm"] > inside["radius_95_mm"] > 0.0
    first = (tmp_path / "o.csv").read_text("utf-8")
    named = result(tmp_path, *ask, "--named-only")
    assert sorted(named["carried_left_out"]) == sorted([STEP, JOINT])
    assert [t["outside_measured_range"] for t in named["targets"]] == [[], []]
    assert (tmp_path / "o.csv").read_text("utf-8") != first


def test_export_says_what_it_leaves_out(cell: Path, tmp_path: Path) -> None:
    ask = ("export", str(cell / "m.json"), str(tmp_path / "o.urdf"), "--as", "urdf")
    whole, named = result(tmp_path, *ask), result(tmp_path, *ask, "--named-only")
    assert whole["carried_left_out"] == [STEP]
    assert f"{JOINT}.size" in whole["left_out"]  # no constant of a table
    assert len(named["carried_left_out"]) == 2
    assert f"{JOINT}.size" not in named["left_out"]


def test_validate_judges_with_and_without_carried_terms(cell: Path, tmp_path: Path) -> None:
    told = result(tmp_path, "validate", str(cell / "data.csv"), "--model", str(cell / "m.json"))
    rms = {each["model"]: each["position_mm"]["rms"] for each in told["judgements"]}
    assert list(rms) == ["nominal robot, placed", "m", "m, named causes only"]
    assert rms["m"] != rms["m, named causes only"]
