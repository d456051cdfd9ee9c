"""A path on the simulated UR5 and AT960: recorded, exported and aligned, killed and stopped.

The simulators sample 8 times as fast as real devices do, so that a path of half a minute takes some seconds.
"""

from __future__ import annotations

import json
import sqlite3
import subprocess
import sys
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from acquisition import Event, Run, read_campaign, read_cell
from acquisition.record import FILE, RecordStore
from acquisition.record.streams import read_stream
from drivers import RehearsalOperator
from mocks.cell import Cell as SimulatedCell
from mocks.cell_file import read_cell as read_mock_cell
from service.cli import main
from service.simulated_cell import SimulatedDevices, simulated_cell
from tests.drivers.waiting import PATIENCE_S, until
from tests.end_to_end.simulated import ROOT

EXAMPLE = ROOT / "examples" / "ur5_leica"
CHILD = Path(__file__).with_name("campaign_child.py")
MIDDLE = (40.0, -105.0, 100.0, -85.0, -90.0, 0.0)
WAYPOINTS = 9


def files(folder: Path, rest_s: float = 1.5) -> list[str]:
    """The example's cell with no hidden effect, and a short path about one posture."""
    text = (EXAMPLE / "path_cell.toml").read_text("utf-8")
    assert "effects = []" in text
    text = text.replace("effects = []", 'effects = ["none"]')
    (folder / "cell.toml").write_text(text, "utf-8")
    rng = np.random.default_rng(5)
    joints = np.round(MIDDLE + rng.uniform(-25.0, 25.0, (WAYPOINTS, 6)), 3).tolist()
    (folder / "campaign.toml").write_text(
        'format = "truepose-campaign/1"\nsettle_s = 1.0\nsamples = 5\n[[block]]\nkind = "path"\n'
        f'select = "list"\ntargets = ["T1"]\nrest_s = {rest_s}\njoints_deg = {json.dumps(joints)}\n',
        "utf-8",
    )
    return [str(folder / "cell.toml"), str(folder / "campaign.toml")]


def rows(record: Path, sql: str) -> list[tuple[Any, ...]]:
    with closing(sqlite3.connect(record / FILE)) as db:
        return db.execute(sql).fetchall()


def test_a_path_is_recorded_exported_and_aligned(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The unknown clocks of the simulated devices are found within the stated uncertainty."""
    record, out = tmp_path / "record", tmp_path / "out.csv"
    assert main(["campaign", "run", *files(tmp_path), "--record", str(record), "--simulate"]) == 0
    assert f"waypoint {WAYPOINTS} of {WAYPOINTS}, samples: robot " in capsys.readouterr().err
    with RecordStore.reading(record) as store:
        ((attempt,),) = rows(record, "SELECT id FROM attempt WHERE id IN (SELECT attempt FROM chunk)")
        assert isinstance(attempt, int)
        streams = {role: read_stream(store, attempt, role) for role in ("robot", "instrument")}
    for role, period_s in (("robot", 0.008), ("instrument", 0.1)):
        stream = streams[role]
        steps = np.diff(stream.device_t_s)
        assert np.median(steps) == pytest.approx(period_s, rel=1e-3)
        # what is missing by the clock is what was counted as lost
        assert np.array_equal(np.round(steps / period_s) - 1, stream.lost[1:])
        assert np.all(np.diff(stream.arrived_t_s) >= 0.0)
        assert not stream.doubted.any()
    assert main(["campaign", "export", str(record), str(out), "--streams", "--json", "-"]) == 0
    (path,) = json.loads(capsys.readouterr().out)["paths"]
    assert path["complete"] is True
    assert path["samples"]["robot"] == len(streams["robot"].device_t_s)
    aligned = [
        "--robot",
        "ur5",
        "--tool",
        "55",
        "0",
        "169.5",
        "--holdout",
        "0",
        "--json",
        str(tmp_path / "a.json"),
    ]
    assert main(["align", path["robot"], path["tracker"], str(tmp_path / "set.csv"), *aligned]) == 0
    clocks = json.loads((tmp_path / "a.json").read_text("utf-8"))["clocks"]
    true = SimulatedCell(read_mock_cell(tmp_path / "cell.toml"), devices=("ur", "leica"))
    robot, tracker = true.ur_clock, true.leica.bridge.clock
    rate = (1.0 + robot.rate) / (1.0 + tracker.rate) - 1.0
    at = clocks["at_tracker_s"]
    offset = robot.offset_s + (1.0 + robot.rate) * (at - tracker.offset_s) / (1.0 + tracker.rate) - at
    assert clocks["u_offset_s"] < 0.002
    assert abs(clocks["offset_s"] - offset) < 3.0 * clocks["u_offset_s"]
    assert abs(clocks["rate_ppm"] - 1e6 * rate) < 3.0 * clocks["u_rate_ppm"]


@pytest.fixture
def simulated(tmp_path: Path) -> Iterator[SimulatedDevices]:
    files(tmp_path)
    with simulated_cell(read_cell(tmp_path / "cell.toml")) as devices:
        yield devices


def test_a_killed_program_loses_less_than_a_second(simulated: SimulatedDevices, tmp_path: Path) -> None:
    """Every earlier chunk is still in the record; the path is driven again from its beginning."""
    record = tmp_path / "record"
    paths = [str(tmp_path / name) for name in ("record", "cell.toml", "campaign.toml")]
    command = [sys.executable, str(CHILD), "create", *paths, json.dumps(simulated.ports)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, env={"PYTHONPATH": str(ROOT)}) as child:
        until(lambda: (record / FILE).exists() and len(chunks(record)) > 3)
        before = chunks(record)
        child.kill()
        child.communicate(timeout=PATIENCE_S)
    with Run.open(record) as run:  # looks at every checksum
        assert run.status().state == "paused"
        after = chunks(record)
        assert after[: len(before)] == before
        ((status,),) = rows(record, "SELECT status FROM attempt WHERE id IN (SELECT attempt FROM chunk)")
        assert status == "died"
        # the record says how much of each stream it has
        (died,) = rows(record, "SELECT data FROM event WHERE kind = 'attempt_died'")
        ends = rows(record, "SELECT role, sum(samples), max(until_t_s) FROM chunk GROUP BY role")
        kept = json.loads(died[0])["streams"]
        assert {role: (end["samples"], end["until_t_s"]) for role, end in kept.items()} == {
            role: (samples, until_t_s) for role, samples, until_t_s in ends
        }
        # The controller's watchdog ends the motion, and a person would look before going on.
        until(lambda: not moving(simulated, run))
        run.resume(by="anna")
        outcome = run.execute(simulated.open(run.cell, RehearsalOperator()))
        assert outcome.state.value == "succeeded", outcome.reason
    first, second = rows(
        record,
        "SELECT attempt.status, min(chunk.first), count(DISTINCT chunk.role) FROM chunk JOIN attempt "
        "ON attempt.id = chunk.attempt GROUP BY attempt.id ORDER BY attempt.id",
    )
    assert (first, second) == (("died", 0, 2), ("good", 0, 2))


def moving(simulated: SimulatedDevices, run: Run) -> bool | None:
    robot = simulated.open(run.cell).robot
    robot.connect()
    try:
        return robot.status().moving
    finally:
        robot.disconnect()


def chunks(record: Path) -> list[tuple[Any, ...]]:
    try:
        return rows(record, "SELECT id, role, first, samples, data FROM chunk ORDER BY id")
    except sqlite3.Error:  # not yet made
        return []


def test_a_stop_in_the_middle_of_a_path(simulated: SimulatedDevices, tmp_path: Path) -> None:
    """The motion stops, and the streams are closed and marked as incomplete.

    Nothing moves until the run is resumed.
    """
    cell, campaign = read_cell(tmp_path / "cell.toml"), read_campaign(tmp_path / "campaign.toml")
    run = Run.create(tmp_path / "record", cell, campaign, simulated=True)

    def stop_it(event: Event) -> None:
        if event.kind == "waypoint" and event.data["waypoint"] == 3:
            assert run.stop(by="anna") == []

    with run:
        outcome = run.execute(simulated.open(run.cell), on_event=stop_it)
        assert outcome.state.value == "stopped"
        ((status, error),) = rows(
            run.folder, "SELECT status, error FROM attempt WHERE id IN (SELECT attempt FROM chunk)"
        )
        assert status == "failed"
        assert "left its path after waypoint 3 of 9" in str(error)
        path = run.status().path
        assert path is not None
        assert (path["waypoint"], path["of"]) == (3, WAYPOINTS)
        kept = dict(rows(run.folder, "SELECT role, sum(samples) FROM chunk GROUP BY role"))
        assert all(kept[role] >= count for role, count in path["samples"].items())
    assert moving(simulated, run) is False
