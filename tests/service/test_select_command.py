"""`truepose select`: the list of poses, the document, and what is refused."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from acquisition import read_campaign, read_cell
from acquisition.check import check_plan
from acquisition.plan import make_plan
from service.cli import main

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
        (["--targets", "T1,T9"], "'T9' is no target"),
        (["--groups", "base,wings"], "'wings' is no group"),
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
