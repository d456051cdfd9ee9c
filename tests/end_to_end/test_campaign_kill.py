"""`kill -9` at random moments of a campaign on a simulated cell: nothing acknowledged is lost, nothing is twice.

The children acknowledge a reading by a line on their standard output, written after the reading is durable.
`TRUEPOSE_KILLS` sets how often (20).
"""

from __future__ import annotations

import os
import random
import sqlite3
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from acquisition.database import FILE
from acquisition.export import export
from acquisition.run import Run
from calib.dataset import read_dataset
from tests.end_to_end.simulated import ROOT, SimulatedCell, campaign_file, cell_file, simulated_cell

KILLS = int(os.environ.get("TRUEPOSE_KILLS", "20"))
POSES = 12 + 2 * KILLS  # some are left for the last child, which is not killed
CHILD = Path(__file__).with_name("campaign_child.py")


def start(verb: str, folder: Path, simulated: SimulatedCell) -> subprocess.Popen[str]:
    paths = [str(folder / name) for name in ("record", "cell.toml", "campaign.toml")]
    return subprocess.Popen(
        [sys.executable, str(CHILD), verb, *paths, simulated.url("abb"), simulated.url("faro")],
        stdout=subprocess.PIPE,
        text=True,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
    )


def lines_until_killed(child: subprocess.Popen[str], chance: random.Random) -> list[str]:
    """Let it take some readings, then kill it at a moment between or within them."""
    assert child.stdout is not None
    lines: list[str] = []
    wanted = chance.randrange(1, 9)  # the line that says it runs, nests, and some poses
    while len(lines) < wanted and (line := child.stdout.readline()):
        lines.append(line)
    threading.Event().wait(chance.uniform(0.0, 0.06))
    child.kill()
    lines += child.stdout.readlines()  # what it had acknowledged before it died
    child.wait()
    child.stdout.close()
    return [line for line in lines if line.endswith("\n")]


@pytest.mark.timeout(120 + 6 * KILLS)
def test_kill_at_random_moments(tmp_path: Path) -> None:
    cell_file(tmp_path, time_scale=400.0)
    campaign_file(tmp_path, calibration=POSES, validation=2, warm_up_s=0.0, samples=20)
    chance = random.Random(6)
    acknowledged: list[int] = []
    killed, outcome, verb = 0, "", "create"
    with simulated_cell(tmp_path / "cell.toml") as simulated:
        while not outcome:
            child = start(verb, tmp_path, simulated)
            if killed < KILLS:
                lines = lines_until_killed(child, chance)
                killed += 1
            else:
                lines = child.communicate()[0].splitlines(keepends=True)
            acknowledged += [int(line.split()[1]) for line in lines if line.startswith("reading")]
            outcome = "".join(line for line in lines if not line.startswith(("reading", "running")))
            verb = "resume" if (tmp_path / "record" / FILE).exists() else "create"
            if not outcome:
                comes_back_paused(tmp_path / "record")
            look(tmp_path / "record", acknowledged, killed)
        shots = simulated.do("state")["readings"]
    assert outcome.startswith("succeeded"), outcome
    assert killed == KILLS, "the campaign was over before every kill: make it longer"
    db = sqlite3.connect(tmp_path / "record" / FILE)
    count = dict(db.execute("SELECT status, count(*) FROM attempt WHERE kind = 'measure' GROUP BY status"))
    left = db.execute("SELECT count(*) FROM pose WHERE status NOT IN ('measured', 'skipped')").fetchone()[0]
    db.close()
    assert left == 0
    assert count["good"] <= shots <= sum(count.values())  # every shot ever taken is known by its attempt
    dataset = read_dataset(export(tmp_path / "record", tmp_path / "data.csv"))
    assert len(dataset) == len(set(dataset.reading_id)) >= 3 * (POSES + 2)


def comes_back_paused(record: Path) -> None:
    with Run.open(record) as run:
        assert run.status().state in ("ready", "paused")


def look(record: Path, acknowledged: list[int], killed: int) -> None:
    db = sqlite3.connect(record / FILE)
    good = db.execute("SELECT id, pose FROM attempt WHERE kind = 'measure' AND status = 'good'").fetchall()
    died = db.execute("SELECT count(*) FROM attempt WHERE status = 'died'").fetchone()[0]
    opened = db.execute("SELECT count(*) FROM attempt WHERE status = 'open'").fetchone()[0]
    check = db.execute("PRAGMA integrity_check").fetchone()[0]
    db.close()
    assert set(acknowledged) <= {attempt for attempt, _ in good}
    assert len({pose for _, pose in good}) == len(good)
    assert died <= killed
    assert opened == 0
    assert check == "ok"
