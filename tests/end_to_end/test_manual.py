"""Whole campaigns with a robot driven by hand, and with an instrument read by a person.

These would catch: planned angles filed instead of those of the pendant, and an unannounced approach. They would also
catch a point that is expected at a wrong place of the robot, and a slip of the hand that goes into the record.
"""

from __future__ import annotations

import csv
import json
import tomllib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from acquisition import Cell, Run, campaign_from, export
from acquisition.cell import cell_from
from acquisition.record import RecordStore
from acquisition.record.readings import drift_of
from calib import read_dataset
from calib.diagnose import diagnose
from calib.text import read_toml
from tests.calib.machines import TRACK
from tests.end_to_end.fits import rms_held_out
from tests.end_to_end.simulated import ROOT, campaign_file, stepped_cell

EXAMPLE = ROOT / "examples" / "manual"
ABB = {"driver": "abb", "url": "tcp://127.0.0.1:5000", "resolution_deg": None, "within_deg": None}
FARO = {"driver": "faro", "url": "tcp://127.0.0.1:5701", "unit": None}


def a_cell(robot: dict[str, object], instrument: dict[str, object]) -> Cell:
    _, table = read_toml(EXAMPLE / "cell.toml")
    for name, changes in (("robot", robot), ("instrument", instrument)):
        merged = table[name] | changes
        table[name] = {key: value for key, value in merged.items() if value is not None}
    return cell_from(table, "cell.toml")


@pytest.mark.parametrize(
    ("robot", "instrument"),
    [({}, FARO), (ABB, {"unit": "in"})],
    ids=["robot by hand", "instrument by hand"],
)
def test_a_campaign_by_hand_is_measured_and_identified(
    tmp_path: Path, robot: dict[str, object], instrument: dict[str, object]
) -> None:
    cell = a_cell(robot, instrument)
    _, table = read_toml(campaign_file(tmp_path, calibration=14, validation=4, warm_up_s=0.0))
    campaign = campaign_from(table | {"reference_every": 10}, "campaign.toml")
    with stepped_cell(cell) as equipment, Run.create(tmp_path / "r", cell, campaign, simulated=True) as run:
        outcome = run.execute(equipment.devices, equipment.clock)
        met = {event.data["role"]: event.data for event in run.events() if event.kind == "connected"}
        typed = [event for event in run.events() if event.kind == "answer" and event.data.get("typed")]
        told_of = [event.data for event in run.events() if event.kind == "reading"]
    assert (outcome.state.value, outcome.error) == ("succeeded", None)
    assert len(typed) > 20
    by_hand = robot == {}
    assert met["robot"]["can_stop"] != by_hand
    assert ("moved by hand: Stop does not reach it" in met["robot"]["weakness"]) == by_hand
    out = export(tmp_path / "r", tmp_path / "data.csv")
    with out.open(encoding="utf-8") as lines:
        rows = list(csv.DictReader(lines))
    store = RecordStore.open(tmp_path / "r", writer=False)
    with_plan = {
        row["id"]: json.loads(row["joints_deg"]) for row in store.database.query("SELECT * FROM pose")
    }
    planned = {round(q, 3) for joints in with_plan.values() for q in joints}
    drift = drift_of(store)
    store.close()
    assert drift is not None
    assert drift.most_mm < 0.6  # robot errors over half a degree; 5 mm where the joints are not looked at
    at_reference = [each for each in told_of if each["set"] == "reference" and each["target"] == "T1"]
    strip = np.array([each["as_planned_mm"] for each in at_reference])  # what the page draws
    assert np.linalg.norm(strip - strip[0], axis=1).max() <= drift.most_mm + 1e-9
    if by_hand:
        raw = np.array([each["world_mm"] for each in at_reference])
        assert np.linalg.norm(raw - raw[0], axis=1).max() > 2.0 * drift.most_mm
    assert [each["as_planned_mm"] for each in told_of if each["set"] == "nest"] == [None] * 3
    told = [float(row[f"j{k}_deg"]) for row in rows for k in range(1, 7)]
    shown = [float(row[f"j{k}_read_deg"]) for row in rows for k in range(1, 7)]
    if by_hand:
        assert told == shown
        assert np.mean([q in planned for q in told]) < 0.1
        np.testing.assert_allclose(told, np.round(told, 2), atol=1e-9)  # what a pendant can show
    dataset = read_dataset(out)
    assert rms_held_out(dataset) < 0.1


def a_scara(folder: Path) -> dict[str, object]:
    return {"model": "yaskawa-sg650", "limits_deg": [[-130, 130], [-140, 140], [-200, -5], [-180, 180]]}


def on_a_track(folder: Path) -> dict[str, object]:
    (folder / "own.toml").write_text(TRACK, encoding="utf-8")
    turning = [[-90, 90], [-60, 60], [-100, 40], [-150, 150], [-100, 100], [-180, 180]]
    return {"model": str(folder / "own.toml"), "limits_deg": [[500, 2500], *turning]}


@pytest.mark.parametrize(("machine", "slide"), [(a_scara, "j3"), (on_a_track, "e1")])
def test_joints_that_slide_are_driven_by_hand_and_their_play_is_named(
    tmp_path: Path, machine: Callable[[Path], dict[str, object]], slide: str
) -> None:
    """From the prompt to the diagnosis; catches mm sent as deg, and a record of another place than the pendant's."""
    described = a_cell(machine(tmp_path) | {"table_z_mm": -1500.0, "within_deg": None}, FARO)
    simulation = {"seed": 3, "effects": [f"slide_backlash:{slide}"], "effect_size": 5.0}
    cell = cell_from(tomllib.loads(described.source) | {"simulation": simulation}, "cell.toml")
    _, table = read_toml(campaign_file(tmp_path, calibration=40, validation=6, warm_up_s=0.0))
    table |= {"reference_every": 0, "approach": {"offset_deg": -5.0, "sides": "both"}}
    campaign = campaign_from(table, "campaign.toml")
    with stepped_cell(cell) as equipment, Run.create(tmp_path / "r", cell, campaign, simulated=True) as run:
        outcome = run.execute(equipment.devices, equipment.clock)
        asked = [event.data["text"] for event in run.events() if event.kind == "prompt"]
    assert (outcome.state.value, outcome.error) == ("succeeded", None)
    assert any(f"{slide.upper()} " in text and " mm" in text for text in asked)
    out = export(tmp_path / "r", tmp_path / "data.csv")
    dataset = read_dataset(out)
    assert f"{slide}_mm" in out.read_text(encoding="utf-8").splitlines()[0]
    diagnosis = diagnose(dataset)
    assert [each.effect.label for each in diagnosis.effects] == [f"slide_backlash:{slide}"]
    assert diagnosis.final.noise_scale == pytest.approx(1.0, abs=0.2)
