"""The SIMULATED label on every way from a record to a program.

These would catch an output that passes for a real robot's. A corrected program is the one file without the label,
because only its numbers may change; the label is printed with it.
"""

from __future__ import annotations

import json
import tomllib
from contextlib import closing
from pathlib import Path

import pytest

from acquisition.run.run import Run
from calib.data.read import read_dataset
from service.cli import main
from tests.acquisition.fakes import Bench, JumpingClock, SeatingOperator, a_campaign, a_cell, devices_of

BLOCKS = [
    {"set": "calibration", "count": 24, "targets": ["T1", "T2"]},
    {"set": "validation", "count": 8, "targets": ["T1"]},
]
TARGETS = "target_id,j1_deg,j2_deg,j3_deg,j4_deg,j5_deg,j6_deg\nP1,10,20,-30,40,50,60\n"


def recorded(folder: Path, *, simulated: bool) -> Path:
    bench = Bench(a_cell())
    with closing(Run.create(folder, bench.cell, a_campaign(block=BLOCKS), simulated=simulated)) as run:
        outcome = run.execute(devices_of(bench, SeatingOperator(bench)), JumpingClock())
    assert outcome.state.value == "succeeded", outcome.reason
    return folder


@pytest.mark.parametrize("simulated", [True, False])
def test_the_label_is_at_every_end_and_at_none_of_a_real_one(
    simulated: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    at = {
        name: str(tmp_path / name)
        for name in (
            "one",
            "two",
            "out.csv",
            "m.json",
            "r.html",
            "c.xml",
            "d.json",
            "p.csv",
            "t.csv",
            "u.csv",
        )
    }
    for name in ("one", "two"):
        recorded(tmp_path / name, simulated=simulated)

    def said(*arguments: str) -> str:
        capsys.readouterr()
        assert main(list(arguments)) == 0, arguments
        told = capsys.readouterr()
        return told.out + told.err

    def labelled(text: str) -> bool:
        return "SIMULATED" in text

    said("campaign", "export", at["one"], at["out.csv"], "--with", at["two"])
    assert tomllib.loads((tmp_path / "out.toml").read_text("utf-8")).get("simulated", False) is simulated
    assert read_dataset(Path(at["out.csv"])).header.simulated is simulated

    told = said(
        "identify", at["out.csv"], "--model", at["m.json"], "--report", at["r.html"], "--dcc", at["c.xml"]
    )
    assert labelled(told) is simulated
    for name in ("r.html", "c.xml"):
        assert labelled((tmp_path / name).read_text("utf-8")) is simulated, name
    assert json.loads((tmp_path / "m.json").read_text("utf-8"))["simulated"] is simulated

    told = said(
        "diagnose", at["out.csv"], "--most", "0", "--predictions", at["p.csv"], "--json", at["d.json"]
    )
    assert labelled(told) is simulated
    assert json.loads((tmp_path / "d.json").read_text("utf-8"))["simulated"] is simulated
    heading, *rows = (tmp_path / "p.csv").read_text("utf-8").splitlines()
    assert len(rows) == 2 * 8
    assert heading.endswith(",simulated") is simulated
    assert all(row.endswith(",yes") is simulated for row in rows)

    assert labelled(said("validate", at["out.csv"], "--model", at["m.json"])) is simulated
    for kind in ("urdf", "dh-csv", "dh-md", "mastering", "abb-frames", "abb-offsets"):
        out = tmp_path / f"model.{kind}"
        assert labelled(said("export", at["m.json"], str(out), "--as", kind)) is simulated, kind
        assert ("simulated" in out.read_text("utf-8").lower()) is simulated, kind
    Path(at["t.csv"]).write_text(TARGETS, "utf-8")
    assert labelled(said("compensate", at["m.json"], at["t.csv"], at["u.csv"])) is simulated
