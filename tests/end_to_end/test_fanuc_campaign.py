"""A campaign on a Fanuc cell.

The controller's angles go over the wire and into the data set, and the data set gives the model's angles.
"""

from __future__ import annotations

import csv
from pathlib import Path

import pytest

from acquisition import Run, export, read_campaign, read_cell
from acquisition.loop import close_loop
from calib import read_dataset
from tests.end_to_end.fits import rms_held_out
from tests.end_to_end.simulated import campaign_file, cell_file, stepped_cell


def fanuc_cell(folder: Path) -> Path:
    """The example's cell with an LR Mate in the place of the IRB 120."""
    path = cell_file(folder, time_scale=1.0)
    text = path.read_text(encoding="utf-8")
    for old, new in (
        ('model = "abb-irb120"', 'model = "fanuc-lrmate200ic"'),
        ('driver = "abb"', 'driver = "fanuc"'),
        ("tcp://192.168.125.1:5000", "tcp://192.168.125.1:18735"),
        (
            "[-80, 70], [-150, 150], [-90, 90], [-180, 180]]",
            "[-120, 60], [-150, 150], [-90, 90], [-180, 180]]",
        ),
    ):
        assert old in text
        text = text.replace(old, new)
    path.write_text(text, encoding="utf-8")
    return path


def test_measured_exported_identified(tmp_path: Path) -> None:
    cell = read_cell(fanuc_cell(tmp_path))
    campaign = read_campaign(
        campaign_file(tmp_path, calibration=14, validation=4, warm_up_s=0.0, reference_every=0)
    )
    with stepped_cell(cell) as equipment, Run.create(tmp_path / "r", cell, campaign, simulated=True) as run:
        outcome = run.execute(equipment.devices, equipment.clock)
    assert (outcome.state.value, outcome.error) == ("succeeded", None)
    out = export(tmp_path / "r", tmp_path / "data.csv")
    with out.open(encoding="utf-8") as lines:
        rows = list(csv.DictReader(lines))
    assert len(rows) == 18 * 3
    for row in rows:
        for k in range(1, 7):
            assert float(row[f"j{k}_read_deg"]) == pytest.approx(float(row[f"j{k}_deg"]), abs=0.0006)
    dataset = read_dataset(out)
    assert dataset.header.coupling == "fanuc-j23"
    assert rms_held_out(dataset) < 0.1


def test_the_loop_is_closed_on_coupled_joints(tmp_path: Path) -> None:
    """Two joints of the controller turn joint 3 of the model.

    Its backlash is found and corrected on the robot.
    """
    path = fanuc_cell(tmp_path)
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace('effects = ["none"]', 'effects = ["backlash:j3"]'), encoding="utf-8")
    cell = read_cell(path)
    campaign = read_campaign(campaign_file(tmp_path, calibration=30, validation=10, warm_up_s=0.0))
    with stepped_cell(cell) as equipment:
        result = close_loop(equipment, campaign, tmp_path / "loop", poses=6)
    assert [found.effect.label for found in result.diagnosis.effects] == ["backlash:j3"]
    assert result.verification.uncorrected is not None
    assert result.verification.uncorrected.rms > 1.0
    assert result.verification.ratio < 1.25
