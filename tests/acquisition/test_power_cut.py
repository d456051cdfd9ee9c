"""Power cuts below SQLite, after every commit and within every write.

No commit is lost, and no record is damaged. A campaign on fakes runs over a disk that logs the orders of SQLite
(`platter`). Then the power is cut on paper, hundreds of times, and the remaining files are opened as a person would
open them the next morning.
`TRUEPOSE_CUTS` sets how often between commits (300).
"""

from __future__ import annotations

import os
import random
import sqlite3
import tempfile
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import pytest

from acquisition import Run
from acquisition.record import FILE
from drivers import Answer, BeamBroken, LinkLost
from tests.acquisition.fakes import Bench, JumpingClock, SeatingOperator, a_campaign, a_cell, devices_of
from tests.acquisition.platter import Disk, Mark, Platter, connect, mark_of

CUTS = int(os.environ.get("TRUEPOSE_CUTS", "300"))
COMMITS = 300
MEMORY = Path("/dev/shm")


@pytest.fixture
def folder() -> Iterator[Path]:
    """Yield a folder in memory if possible.

    The disk is simulated here, so the test need not wait for a real one.
    """
    with tempfile.TemporaryDirectory(dir=MEMORY if MEMORY.is_dir() else None) as name:
        yield Path(name)


@contextmanager
def on(disk: Disk, rewrite: Callable[[str], str] = lambda sql: sql) -> Iterator[None]:
    """Records opened within the block lie on this disk."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sqlite3, "connect", connect(disk, rewrite))
        yield


def a_long_campaign(folder: Path) -> None:
    """Run a campaign of about seventy poses with faults, prompts, a pause and a resume."""
    bench = Bench(a_cell(instrument__one_smr=True))
    clock = JumpingClock()
    blocks = [{"set": "calibration", "count": 30, "targets": ["T1", "T2", "T3"]}]
    operator = SeatingOperator(bench, [Answer.CONFIRM] * 4 + [Answer.REDO, Answer.CONFIRM, Answer.CONFIRM])
    with closing(Run.create(folder, bench.cell, a_campaign(block=blocks), simulated=True)) as run:
        bench.faults = {30: run.pause, **{n: fault_of(n) for n in (50, 75, 90)}}
        assert run.execute(devices_of(bench, operator), clock).state.value == "paused"
    bench.seated = None
    with closing(Run.open(folder)) as run:
        run.resume()
        assert run.execute(devices_of(bench, operator), clock).state.value == "succeeded"


def fault_of(number: int) -> Callable[[], None]:
    def fault() -> None:
        raise LinkLost("lost") if number % 2 else BeamBroken("broken")

    return fault


def after_the_cut(files: dict[str, bytes], folder: Path) -> tuple[Mark, str] | None:
    """Return the content of the record and its state after opening.

    The result is None if the record never came into being.
    """
    folder.mkdir()
    for name, content in files.items():
        (folder / name).write_bytes(content)
    if FILE not in files:
        return None
    with closing(sqlite3.connect(folder / FILE)) as db:
        version = db.execute("PRAGMA user_version").fetchone()[0]
        assert db.execute("PRAGMA integrity_check").fetchone()[0] == "ok"
        if version == 0 or not db.execute("SELECT count(*) FROM campaign").fetchone()[0]:
            return None  # the power failed while it was made
        assert db.execute("PRAGMA foreign_key_check").fetchall() == []
        holds = mark_of(lambda sql: db.execute(sql).fetchone()[0])
        twice = db.execute(
            "SELECT count(*) - count(DISTINCT pose) FROM attempt WHERE kind = 'measure' AND status = 'good'"
        ).fetchone()[0]
        ids = db.execute("SELECT count(*), max(id) FROM event").fetchone()
    assert twice == 0
    assert ids[0] == ids[1]  # no gap in what was told
    with Run.open(folder) as run:
        return holds, run.status().state


def cut_everywhere(disk: Disk, folder: Path, chance: random.Random) -> tuple[int, int, int]:
    """Commits, cuts, and how many cuts lost a commit."""
    between = set(chance.sample(range(len(disk.ops)), CUTS))
    platter, durable = Platter(), None
    commits = cuts = lost = 0
    for i, op in enumerate(disk.ops):
        platter.take(op)
        if op.kind == "commit":
            commits, durable = commits + 1, op.mark
        if op.kind == "commit" or i in between:
            cuts += 1
            found = after_the_cut(platter.cut(chance), folder / str(i))
            if durable is None:
                continue
            if found is None or any(has < had for has, had in zip(found[0], durable, strict=True)):
                lost += 1
            else:
                assert found[1] in ("ready", "paused", "succeeded")
    return commits, cuts, lost


def test_no_commit_is_lost_by_a_power_cut(folder: Path) -> None:
    disk = Disk()
    with on(disk):
        a_long_campaign(folder / "record")
    commits, cuts, lost = cut_everywhere(disk, folder, random.Random(1))
    assert commits >= COMMITS
    assert cuts >= commits + CUTS / 2
    assert lost == 0


@pytest.mark.whole
def test_without_syncs_commits_are_lost(folder: Path) -> None:
    """The disk of this test does lose data: the same cuts lose commits with NORMAL, not FULL."""
    disk = Disk()
    with on(disk, lambda sql: sql.replace("synchronous = FULL", "synchronous = NORMAL")):
        a_long_campaign(folder / "record")
    assert cut_everywhere(disk, folder, random.Random(1))[2] > COMMITS / 3
