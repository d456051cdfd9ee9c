"""`truepose select`: the list of poses, the document, and its refusals."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from acquisition import read_campaign, read_cell
from acquisition.campaign.plan import check_plan, make_plan
from calib.array import Array
from calib.selection import Candidates, Setup
from service.cli import main
from service.results.cell import selected as select_module

CELL = Path(__file__).parents[2] / "examples" / "irb120_faro" / "cell.toml"
CAMPAIGN = """
format = "truepose-campaign/1"
approach = { offset_deg = -5.0, sides = "one" }
[[block]]
select = "file"
file = "poses.csv"
"""


def select(folder: Path, *arguments: str) -> int:
    return main(
        [
            "select",
            str(CELL),
            "--out",
            str(folder / "poses.csv"),
            "--from",
            "300",
            "--count",
            "30",
            *arguments,
        ]
    )


def test_list_is_measured_by_a_campaign(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert select(tmp_path, "--json", str(tmp_path / "r.json")) == 0
    (tmp_path / "campaign.toml").write_text(CAMPAIGN, "utf-8")
    cell = read_cell(CELL)
    visits = make_plan(cell, read_campaign(tmp_path / "campaign.toml"))
    check_plan(cell, visits)
    document = json.loads((tmp_path / "r.json").read_text("utf-8"))
    assert document["format"] == "truepose-selection/1"
    assert [list(v.joints_deg) for v in visits if v.kind == "pose"] == document["poses_deg"]
    assert len(document["poses_deg"]) == 30
    assert (tmp_path / "poses.csv").read_text("utf-8").startswith("target_id,j1_deg,j2_deg,")
    assert document["candidates"] == 300
    assert 0.8 < document["efficiency"] <= document["efficiency_without_filling"] < 1.0
    assert document["dropped"] == [{"name": "d3", "confounded_with": ["d2"]}]
    assert document["uncertainty"]["poses"] == [10, 20, 30, 40, 50, 60]
    shown = capsys.readouterr().out
    for words in ("O1 .. O5", "of the continuous D-optimal bound", "Predicted U", "d3 was dropped"):
        assert words in shown


def test_same_seed_same_list(tmp_path: Path) -> None:
    texts = []
    for seed in ("1", "1", "2"):
        assert select(tmp_path, "--seed", seed, "--targets", "T2", "--count", "20") == 0
        texts.append((tmp_path / "poses.csv").read_text("utf-8"))
    assert texts[0] == texts[1] != texts[2]


def test_targets_groups_and_share_are_heeded(tmp_path: Path) -> None:
    out = str(tmp_path / "r.json")
    assert (
        select(tmp_path, "--targets", "T1", "--groups", "base, compliance", "--share", "0", "--json", out)
        == 0
    )
    document = json.loads(Path(out).read_text("utf-8"))
    assert document["targets"] == ["T1"]
    assert {p["name"] for p in document["parameters"]} == {
        *(f"base.{axis}" for axis in ("x", "y", "z", "rx", "ry", "rz")),
        *(f"c{k}" for k in range(2, 6)),
    }
    assert [d["name"] for d in document["dropped"]] == ["c6"]
    assert document["filling"] == []
    assert document["warnings"]


def test_wanted_uncertainty(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert select(tmp_path, "--wanted-u", "0.05") == 0
    assert "mm takes" in capsys.readouterr().out
    assert select(tmp_path, "--wanted-u", "0.001") == 3
    captured = capsys.readouterr()
    assert "is not reached with 60 poses" in captured.out
    assert "above the 0.001 mm asked for" in captured.err
    assert (tmp_path / "poses.csv").is_file()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--targets", "T1,T9"], "'T9' is not a target"),
        (["--groups", "base,wings"], "'wings' is not a group"),
        (["--groups", ","], "nothing to select for"),
        (["--targets", ","], "nothing to select for"),
        (["--count", "5"], "5 poses have 30 rows for 31 parameters"),
        (["--count", "301"], "only 300 random poses"),
        (["--out", str(CELL)], "would be written over"),
        (["--out", "/nowhere/at/all.csv"], "folder does not exist"),
    ],
)
def test_refusals(
    arguments: list[str], words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert select(tmp_path, *arguments) == 2
    assert words in " ".join(capsys.readouterr().err.split())
    assert not (tmp_path / "poses.csv").exists()


def test_poses_of_a_ballbar_are_not_chosen(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    cell = CELL.parents[1] / "lrmate_ballbar" / "cell.toml"
    assert main(["select", str(cell), "--count", "10", "--out", str(tmp_path / "poses.csv")]) == 2
    shown = " ".join(capsys.readouterr().err.split())
    assert "key 'instrument.driver': the qc20w measures distances" in shown
    assert "kind = 'hexapod'" in shown
    assert not (tmp_path / "poses.csv").exists()


def test_a_robot_that_counts_otherwise_is_judged_by_its_model_angles(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Joint 3 of a Fanuc counts from the horizontal.

    The list has the robot's angles, but the results are those of the model angles.
    """
    text = CELL.read_text("utf-8").replace('"abb-irb120"', '"fanuc-lrmate200ic"').replace('"abb"', '"fanuc"')
    (tmp_path / "cell.toml").write_text(text.replace("[-80, 70]", "[-120, 60]"), "utf-8")
    judged: list[Candidates] = []

    def candidates_of(setup: Setup, joints: Array) -> Candidates:
        judged.append(real(setup, joints))
        return judged[-1]

    real = select_module.candidates_of
    monkeypatch.setattr(select_module, "candidates_of", candidates_of)
    some = [
        "--from",
        "200",
        "--count",
        "30",
        "--out",
        str(tmp_path / "p.csv"),
        "--json",
        str(tmp_path / "r.json"),
    ]
    assert main(["select", str(tmp_path / "cell.toml"), *some]) == 0
    poses = np.radians(json.loads((tmp_path / "r.json").read_text("utf-8"))["poses_deg"])
    found = judged[0].joints
    for pose in poses:
        (at,) = np.flatnonzero(np.isclose(found[:, :2], pose[:2]).all(axis=1))
        assert found[at, 2] == pytest.approx(-pose[1] - pose[2])
        np.testing.assert_allclose(found[at, 3:], -pose[3:])
