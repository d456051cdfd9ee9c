"""A campaign of validation poses alone: planned, measured, exported, and judged against a saved model.

These would catch: a campaign that needs calibration poses, readings of it that enter a fit, a report without its
pictures, and a command that does not say what comes next.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from acquisition import Run, checked_plan, read_campaign, read_cell
from calib import identify, read_dataset
from calib.saved import save_model
from service.cli import main
from tests.acquisition.fakes import Bench, JumpingClock, a_campaign, a_cell, devices_of
from tests.end_to_end.simulated import ROOT

EXAMPLE = ROOT / "examples" / "irb120_faro"
CELL = a_cell()


def recorded(folder: Path, kind: str, count: int, seed: int) -> Path:
    """The record of a campaign on fakes without errors."""
    block = {"set": kind, "count": count}
    with Run.create(folder, CELL, a_campaign(block=[block], seed=seed), simulated=True) as run:
        devices = devices_of(Bench(CELL))
        assert run.execute(devices, JumpingClock()).state.value == "succeeded"
    return folder


def test_it_is_exported_and_judged(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = recorded(tmp_path / "night1", "calibration", 30, 1)
    assert main(["campaign", "export", str(before), str(tmp_path / "night1.csv")]) == 0
    assert "Next: truepose validate" not in capsys.readouterr().err
    save_model(tmp_path / "m.json", identify(read_dataset(tmp_path / "night1.csv")))
    judge, data = recorded(tmp_path / "judge", "validation", 25, 2), tmp_path / "more.csv"
    assert main(["campaign", "export", str(judge), str(data)]) == 0
    assert f"Next: truepose validate {data}" in capsys.readouterr().err
    assert not read_dataset(data).fit_rows.any()
    out, report, picture = (tmp_path / name for name in ("v.json", "r.html", "p.svg"))
    words = ["validate", str(data), "--model", str(tmp_path / "m.json"), "--json", str(out)]
    assert main([*words, "--report", str(report), "--picture", str(picture)]) == 0
    nominal, model = json.loads(out.read_text("utf-8"))["judgements"]
    assert model["position_mm"]["n"] == nominal["position_mm"]["n"] == read_dataset(data).usable.sum()
    assert model["position_mm"]["rms"] < 0.01
    html = report.read_text("utf-8")
    assert html.count("<svg") >= 4  # histogram, cumulative, arrows in space, over time
    assert picture.read_text("utf-8") in html


def test_the_example_holds_nothing_that_is_fitted() -> None:
    campaign = read_campaign(EXAMPLE / "judge.toml")
    poses = [v for v in checked_plan(read_cell(EXAMPLE / "cell.toml"), campaign) if v.kind == "pose"]
    assert len(poses) == 1000
    assert {v.set for v in poses} == {"validation"}
    assert len(np.unique([v.joints_deg for v in poses], axis=0)) == 1000
