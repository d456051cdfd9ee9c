"""From cell and campaign files over the simulated cell's sockets to an identification.

The record and the data set are steps between them.
"""

from __future__ import annotations

import csv
import threading
from pathlib import Path

import numpy as np
import pytest

from acquisition import Event, Run, export, read_campaign, read_cell, read_status
from acquisition.errors import RecordError
from calib import identify, read_dataset
from drivers import SafetyStop
from tests.drivers.waiting import PATIENCE_S, in_thread, until
from tests.end_to_end.simulated import campaign_file, cell_file, simulated_cell

SCALE = 500.0


def test_measured_exported_identified(tmp_path: Path) -> None:
    file = cell_file(tmp_path, time_scale=SCALE)
    cell = read_cell(file)
    campaign = read_campaign(campaign_file(tmp_path, calibration=40, validation=10, warm_up_s=600.0))
    with simulated_cell(file) as simulated, Run.create(tmp_path / "r", cell, campaign, simulated=True) as run:
        with pytest.raises(RecordError, match="no reading"):
            export(tmp_path / "r", tmp_path / "early.csv")
        outcome = run.execute(simulated.devices(cell))
        assert (outcome.state.value, outcome.error) == ("succeeded", None)
        status = run.status()
        truth = simulated.do("state")
    assert status.simulated
    assert status.done == status.total == 50 * 3 + 6
    assert read_status(tmp_path / "r") == status
    assert truth["readings"] == status.total + 3  # not one shot was wasted
    out = export(tmp_path / "r", tmp_path / "data.csv")
    dataset = read_dataset(out)
    assert len(dataset) == status.total
    assert dataset.header.world == "nominal"
    assert dataset.header.noise.station_mm == pytest.approx((2400.0, -900.0, 350.0), abs=40.0)
    assert set(dataset.sets) == {"calibration", "reference", "validation"}
    assert np.all(np.diff(dataset.conditions.time) > 0.0)
    assert dataset.conditions.time[0] > 600.0
    away = np.degrees(dataset.conditions.joints - dataset.conditions.previous)
    length = np.abs(away)
    assert length == pytest.approx(np.tile(length[:, :1], 6), abs=1e-6)  # every joint comes from as far
    assert np.all((length > 5.0 - 1e-6) & (length < 15.0 + 1e-6))
    assert np.ptp(length) > 1.0
    assert np.array_equal(np.sign(away), dataset.conditions.side)
    assert np.all(np.isfinite(dataset.conditions.temperature))
    found = identify(dataset)
    assert 0.9 < found.noise_scale < 1.12
    assert found.converged
    held = dataset.validation_rows
    miss = np.linalg.norm(found.predict(dataset.conditions.take(held)) - dataset.points[held], axis=1)
    assert np.sqrt(np.mean(miss**2)) < 0.08


def test_stock_dialect_records_what_was_commanded(tmp_path: Path) -> None:
    file = cell_file(tmp_path, time_scale=SCALE)
    cell = read_cell(file)
    campaign = read_campaign(
        campaign_file(tmp_path, calibration=3, validation=1, warm_up_s=0.0, reference_every=0)
    )
    with (
        simulated_cell(file, "--dialect", "open_abb") as simulated,
        Run.create(tmp_path / "r", cell, campaign, simulated=True) as run,
    ):
        outcome = run.execute(simulated.devices(cell))
        assert outcome.state.value == "succeeded", outcome
    with export(tmp_path / "r", tmp_path / "data.csv").open(encoding="utf-8") as lines:
        rows = list(csv.DictReader(lines))
    assert len(rows) == 12
    for row in rows:
        for k in range(1, 7):
            commanded, read = float(row[f"j{k}_deg"]), float(row[f"j{k}_read_deg"])
            assert round(commanded, 4) == commanded
            assert abs(commanded - read) <= 0.0051
            away = (commanded - float(row[f"prev{k}_deg"])) * int(row[f"approach{k}"])
            assert 5.0 - 1e-9 <= away <= 15.0 + 1e-9


def test_emergency_stop_then_resume(tmp_path: Path) -> None:
    file = cell_file(tmp_path, time_scale=SCALE)
    cell = read_cell(file)
    campaign = read_campaign(campaign_file(tmp_path, calibration=4, validation=1, warm_up_s=0.0))
    with simulated_cell(file) as simulated, Run.create(tmp_path / "r", cell, campaign, simulated=True) as run:

        def press(event: Event) -> None:
            if event.kind == "reading" and event.data["target"] == "T2":
                simulated.do("estop")

        outcome = run.execute(simulated.devices(cell), on_event=press)
        assert isinstance(outcome.error, SafetyStop)
        assert (outcome.state.value, outcome.exit_code) == ("paused", 5)
        simulated.do("restart")
        run.resume(by="anna")
        assert run.execute(simulated.devices(cell)).state.value == "succeeded"
        assert run.status().done == run.status().total


def test_stop_reaches_the_robot_in_mid_move(tmp_path: Path) -> None:
    """A move at 1 deg/s takes most of a minute in real time.

    The order goes over the background connection. A benchmark measures how soon it is received.
    """
    file = cell_file(tmp_path, time_scale=1.0)
    text = file.read_text("utf-8")
    assert "speed_deg_s = 20.0" in text
    file.write_text(text.replace("speed_deg_s = 20.0", "speed_deg_s = 1.0"), "utf-8")
    cell = read_cell(file)
    campaign = read_campaign(campaign_file(tmp_path, samples=1, warm_up_s=0.0))
    with simulated_cell(file) as simulated, Run.create(tmp_path / "r", cell, campaign, simulated=True) as run:
        moving = threading.Event()
        done = in_thread(
            lambda: run.execute(
                simulated.devices(cell),
                on_event=lambda event: moving.set() if event.kind == "world_frame" else None,
            )
        )
        assert moving.wait(PATIENCE_S)
        until(lambda: simulated.do("state")["moving"])
        problems = run.stop(by="anna")
        still = simulated.do("state")
        assert problems == []
        assert not still["moving"]
        assert max(map(abs, still["joints_deg"])) < 20.0  # it stands where it was on its way
        outcome = done.result(PATIENCE_S)
        assert (outcome.state.value, outcome.exit_code) == ("stopped", 130)
        assert simulated.do("state")["joints_deg"] == still["joints_deg"]
        assert run.status().done == 0
