"""Campaigns on a simulated cell whose program is killed repeatedly, and their final records."""

from __future__ import annotations

import json
import os
import random
import sqlite3
import subprocess
import sys
import threading
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path

from acquisition.errors import RecordError
from acquisition.record.database import FILE
from acquisition.run.run import Run
from tests.end_to_end.simulated import ROOT, SimulatedCell, simulated_cell

CHILD = Path(__file__).with_name("campaign_child.py")


@dataclass
class Tally:
    """Acknowledged readings of the program, and the content of its record.

    `shots` counts the measurements of the simulated instrument.
    """

    killed: int = 0
    acknowledged: list[int] = field(default_factory=list)
    shots: int = 0
    good: int = 0
    lost: int = 0
    twice: int = 0
    unknown: int = 0
    left: int = 0
    sound: bool = True
    ending: str = ""


def kill_and_resume(folder: Path, kills: int, most_readings: int, chance: random.Random) -> Tally:
    """Measure a campaign to its end with a program that is killed `kills` times on the way.

    The campaign is `folder`/campaign.toml in `folder`/cell.toml. Each program may take at most `most_readings`
    readings, and is killed at a moment between or within them. About every fifth is killed by the clock alone, perhaps
    at its start.
    """
    tally = Tally()
    record, verb = folder / "record", "create"
    with simulated_cell(folder / "cell.toml") as simulated:
        while not tally.ending:
            child = _start(verb, folder, simulated)
            if tally.killed < kills:
                lines = _killed(child, chance, most_readings)
                tally.killed += 1
            else:
                lines = child.communicate()[0].splitlines(keepends=True)
            tally.acknowledged += [int(line.split()[1]) for line in lines if line.startswith("reading")]
            tally.ending = "".join(line for line in lines if not line.startswith(("reading", "running")))
            if not _exists(record):
                continue
            verb = "resume"
            if not tally.ending:
                _comes_back_at_rest(record)
            tally.shots = simulated.do("state")["readings"]
            _look(record, tally)
    return tally


def _start(verb: str, folder: Path, simulated: SimulatedCell) -> subprocess.Popen[str]:
    paths = [str(folder / name) for name in ("record", "cell.toml", "campaign.toml")]
    with open(folder / "complaints.txt", "a", encoding="utf-8") as complaints:
        return subprocess.Popen(
            [sys.executable, str(CHILD), verb, *paths, json.dumps(simulated.ports)],
            stdout=subprocess.PIPE,
            stderr=complaints,
            text=True,
            env=os.environ | {"PYTHONPATH": str(ROOT)},
        )


def _killed(child: subprocess.Popen[str], chance: random.Random, most_readings: int) -> list[str]:
    assert child.stdout is not None
    lines: list[str] = []
    if chance.random() < 0.2:
        threading.Event().wait(chance.uniform(0.0, 2.0))
    else:
        wanted = chance.randrange(1, most_readings + 1)  # the line that says it runs, nests, and some poses
        while len(lines) < wanted and (line := child.stdout.readline()):
            lines.append(line)
        threading.Event().wait(chance.uniform(0.0, 0.06))
    child.kill()
    lines += child.stdout.readlines()  # what it had acknowledged before it died
    child.wait()
    child.stdout.close()
    return [line for line in lines if line.endswith("\n")]


def _exists(record: Path) -> bool:
    """Report whether the record was created before the kill; otherwise it is created again."""
    try:
        Run.open(record).close()
    except RecordError:
        return False
    return True


def _comes_back_at_rest(record: Path) -> None:
    with Run.open(record) as run:
        assert run.status().state in ("ready", "paused", "succeeded")


def _look(record: Path, tally: Tally) -> None:
    """Count what is lost, twice or unknown, after every life."""
    with closing(sqlite3.connect(record / FILE)) as db:
        good = db.execute(
            "SELECT id, pose FROM attempt WHERE kind = 'measure' AND status = 'good'"
        ).fetchall()
        attempts = db.execute("SELECT count(*) FROM attempt WHERE kind = 'measure'").fetchone()[0]
        opened = db.execute("SELECT count(*) FROM attempt WHERE status = 'open'").fetchone()[0]
        tally.left = db.execute(
            "SELECT count(*) FROM pose WHERE status NOT IN ('measured', 'skipped')"
        ).fetchone()[0]
        tally.sound &= db.execute("PRAGMA integrity_check").fetchone()[0] == "ok"
    tally.good = len(good)
    tally.lost = len(set(tally.acknowledged) - {attempt for attempt, _ in good})
    tally.twice = len(good) - len({pose for _, pose in good})
    tally.unknown = opened + max(0, tally.shots - attempts)
