"""Faults of storage and ownership during a campaign.

Disk full, disk broken, record locked, two programs on one record or one robot, a calendar that jumps. The campaign
pauses with a reason, and nothing that was acknowledged is lost.
"""

from __future__ import annotations

import os
import random
import sqlite3
import subprocess
import sys
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import apsw
import pytest

from acquisition import Event, ExecutionOutcome, Run
from acquisition.errors import ClockJumped, RecordTaken, RobotInUse, StorageError
from acquisition.record import FILE
from acquisition.record.database import LOCK
from tests.acquisition.fakes import Bench, JumpingClock, SeatingOperator, a_campaign, a_cell, devices_of
from tests.acquisition.platter import Disk, Op, connect

ROOT = Path(__file__).parents[2]


class Stage:
    """Run on fakes that records its notifications."""

    def __init__(self, folder: Path, *, simulated: bool = True, url: str = "tcp://127.0.0.1:5000") -> None:
        self.folder = folder
        self.bench = Bench(a_cell(robot__url=url))
        self.run = Run.create(folder, self.bench.cell, a_campaign(), simulated=simulated)
        self.clock = JumpingClock()
        self.reported: list[int] = []

    def execute(self, run: Run | None = None) -> ExecutionOutcome:
        def heard(event: Event) -> None:
            if event.kind == "reading":
                self.reported.append(event.data["attempt"])

        devices = devices_of(self.bench, SeatingOperator(self.bench))
        return (run or self.run).execute(devices, self.clock, heard)

    def kept(self) -> list[int]:
        """Good readings as another program finds them in the file, which must be sound."""
        with closing(sqlite3.connect(self.folder / FILE)) as db:
            assert db.execute("PRAGMA integrity_check").fetchone()[0] == "ok"
            assert db.execute("SELECT count(*) FROM pose WHERE status = 'planned'").fetchone()[0] == 0
            rows = db.execute(
                "SELECT id, pose FROM attempt WHERE kind = 'measure' AND status = 'good' ORDER BY id"
            ).fetchall()
        assert len({pose for _, pose in rows}) == len(rows)
        return [row[0] for row in rows]

    def finish(self) -> None:
        """Resumed by a person it gets to its end, with every reading that was ever acknowledged."""
        self.run.resume(by="anna")
        assert self.execute().state.value == "succeeded"
        assert self.run.status().done == self.run.status().total == 5
        self.run.close()
        assert set(self.reported) <= set(self.kept())


@pytest.mark.parametrize("kind", ["write", "sync"])
@pytest.mark.parametrize("seed", range(12))
def test_a_disk_that_fails_at_any_moment(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str, seed: int
) -> None:
    """Full at any write, broken at any sync, for as long as the campaign lasts.

    A reading whose sync failed was not acknowledged, yet may be found whole the next time: then it counts.
    """
    chance = random.Random(seed)
    disk = Disk()
    monkeypatch.setattr(sqlite3, "connect", connect(disk))
    stage = Stage(tmp_path)
    left = chance.randrange(120 if kind == "write" else 30)  # within the campaign

    def fail(op: Op) -> None:
        nonlocal left
        if op.kind == kind:
            left -= 1
            if left < 0:
                raise apsw.FullError("disk is full") if kind == "write" else apsw.IOError("sync failed")

    disk.before = fail
    try:
        outcome = stage.execute()
        assert outcome.state.value == "paused"
        assert isinstance(outcome.error, StorageError)
        assert outcome.error.what_to_do in stage.run.status().reason
        assert stage.run.status().state == "paused"
    except StorageError:
        assert stage.bench.log == []  # it could not even be started
    stage.run.pause()  # obeyed, not noted
    disk.before = lambda op: None
    monkeypatch.undo()
    stage.run.close()
    stage.run = Run.open(tmp_path)
    if stage.run.status().state == "ready":
        assert stage.execute().state.value == "succeeded"
        stage.run.close()
        assert set(stage.reported) <= set(stage.kept())
    else:
        stage.finish()


def test_stopping_a_robot_needs_no_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    disk = Disk()
    monkeypatch.setattr(sqlite3, "connect", connect(disk))
    stage = Stage(tmp_path)
    problems: list[object] = []

    def full(op: Op) -> None:
        raise apsw.FullError("disk is full")

    def stop() -> None:
        disk.before = full
        problems.extend(stage.run.stop(by="anna"))

    stage.bench.faults[9] = stop
    outcome = stage.execute()
    assert stage.bench.calls == 9  # nothing moved after it
    assert outcome.state.value == "paused"  # it may not say "stopped", the record does not know it
    assert outcome.error is not None
    assert "disk is full" in outcome.reason
    assert problems == []  # what could not be stopped
    disk.before = lambda op: None
    monkeypatch.undo()
    stage.finish()


@pytest.mark.parametrize("call", [5, 8, 9, 10, 11, 14])
def test_a_record_locked_by_another_program(tmp_path: Path, call: int) -> None:
    stage = Stage(tmp_path)
    stage.run._store.database.script("PRAGMA busy_timeout = 20")  # the patience of a test
    browser = sqlite3.connect(tmp_path / FILE, isolation_level=None)
    stage.bench.faults[call] = lambda: void(browser.execute("BEGIN IMMEDIATE"))
    outcome = stage.execute()
    assert outcome.state.value == "paused"
    assert isinstance(outcome.error, StorageError)
    assert "locked" in outcome.reason
    assert "database browser" in outcome.reason
    browser.execute("ROLLBACK")
    browser.close()
    stage.finish()


def test_a_second_program_is_refused_before_any_device(tmp_path: Path) -> None:
    stage = Stage(tmp_path)
    second = [
        "import pathlib, sys",
        "from acquisition.errors import RecordInUse",
        "from acquisition.run import Run",
        "try: Run.open(pathlib.Path(sys.argv[1]))",
        "except RecordInUse as error: sys.exit(40 + error.exit_code)",
    ]
    codes: list[int] = []

    def come() -> None:
        command = [sys.executable, "-c", "\n".join(second), str(tmp_path)]
        codes.append(
            subprocess.run(command, env=os.environ | {"PYTHONPATH": str(ROOT)}, check=False).returncode
        )

    stage.bench.faults[9] = come
    assert stage.execute().state.value == "succeeded"
    assert codes == [44]
    stage.run.close()
    assert stage.kept() == stage.reported


@pytest.mark.parametrize("call", range(5, 17))
def test_a_record_taken_past_its_lock(tmp_path: Path, call: int) -> None:
    """A network disk may have no locks: the first program pauses, no reading is doubled or lost."""
    stage = Stage(tmp_path)
    others: list[Run] = []

    def come() -> None:
        (tmp_path / LOCK).unlink()
        others.append(Run.open(tmp_path))

    stage.bench.faults[call] = come
    outcome = stage.execute()
    assert outcome.state.value == "paused"
    assert isinstance(outcome.error, RecordTaken)
    assert stage.bench.calls <= call + 1  # at most the verb that was under way
    with pytest.raises(RecordTaken):
        stage.run.resume()
    stage.run.close()
    (stage.run,) = others
    assert stage.run.status().state == "paused"
    stage.finish()


def test_two_campaigns_and_one_robot(tmp_path: Path) -> None:
    url = f"tcp://{tmp_path.name}:5000"  # no other test has this robot
    first, second = (Stage(tmp_path / name, simulated=False, url=url) for name in "ab")
    refused: list[str] = []

    def come() -> None:
        with pytest.raises(RobotInUse) as caught:
            second.execute()
        refused.append(caught.value.message)
        assert caught.value.exit_code == 4

    first.bench.faults[9] = come
    assert first.execute().state.value == "succeeded"
    assert [each.partition(" (")[0] for each in refused] == [f"another campaign moves the robot at {url}"]
    assert second.bench.log == []
    assert second.run.status().state == "ready"
    assert second.execute().state.value == "succeeded"  # now that the robot is free
    first.run.close()
    second.run.close()


# -- the calendar -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("step_s", [-7200.0, -6.0, 6.0, 86400.0 * 365])
def test_a_calendar_that_jumps_pauses_and_time_never_goes_back(tmp_path: Path, step_s: float) -> None:
    stage = Stage(tmp_path)
    stage.bench.faults[10] = jump(stage.clock, step_s)
    outcome = stage.execute()
    assert outcome.state.value == "paused"
    assert isinstance(outcome.error, ClockJumped)
    assert f"{step_s:+.0f} s" in outcome.reason
    assert stage.bench.calls == 10  # the reading in hand is kept, nothing moves after it
    stage.finish()
    with closing(Run.open(tmp_path)) as run:
        times = [event.t_s for event in run.events() if event.t_s is not None]
    assert times == sorted(times)
    assert times[-1] >= max(0.0, step_s)  # a computer that slept has caught up


def test_a_calendar_that_slews_is_no_matter(tmp_path: Path) -> None:
    stage = Stage(tmp_path)
    for call in range(5, 17):
        stage.bench.faults[call] = jump(stage.clock, 0.9)
    assert stage.execute().state.value == "succeeded"
    stage.run.close()


def test_a_calendar_set_back_while_the_record_rests(tmp_path: Path) -> None:
    stage = Stage(tmp_path)
    stage.bench.faults[10] = stage.run.pause
    stage.execute()
    stage.clock.calendar -= 86400.0
    last = max(event.t_s for event in stage.run.events() if event.t_s is not None)
    seen = stage.run.status().version
    stage.run.resume()
    assert stage.execute().state.value == "succeeded"
    later = [event.t_s for event in stage.run.events(after=seen + 1) if event.t_s is not None]
    assert min(later) >= last
    stage.run.close()


def jump(clock: JumpingClock, step_s: float) -> Callable[[], None]:
    def happen() -> None:
        clock.calendar += step_s

    return happen


def void(_: object) -> None:
    """A fault answers nothing."""


def _removed(folder: Path) -> None:
    (folder / FILE).unlink()


def _replaced(folder: Path) -> None:
    (folder / "copy").write_bytes((folder / FILE).read_bytes())
    (folder / "copy").replace(folder / FILE)


def _moved(folder: Path) -> None:
    folder.rename(folder.with_name("elsewhere"))


def _journal_removed(folder: Path) -> None:
    (folder / f"{FILE}-wal").unlink()


def _cut(folder: Path) -> None:
    os.truncate(folder / FILE, 0)


def _journal_cut(folder: Path) -> None:
    os.truncate(folder / f"{FILE}-wal", 0)


@pytest.mark.parametrize("harm", [_removed, _replaced, _moved, _journal_removed, _cut, _journal_cut])
@pytest.mark.parametrize("after", [1, 3])
def test_a_record_that_is_taken_away_under_a_run_pauses_it(
    tmp_path: Path, harm: Callable[[Path], None], after: int
) -> None:
    """No reading is acknowledged into a missing file.

    The run can still be queried and stopped.
    """
    stage = Stage(tmp_path / "record")
    read = 0

    def heard(event: Event) -> None:
        nonlocal read
        read += event.kind == "reading"
        if event.kind == "reading" and read == after:
            harm(stage.folder)

    outcome = stage.run.execute(devices_of(stage.bench, SeatingOperator(stage.bench)), stage.clock, heard)
    assert outcome.state.value == "paused"
    assert isinstance(outcome.error, StorageError)
    assert FILE in outcome.reason
    assert read == after, "a reading was acknowledged into a file that is not there"
    stage.run.pause(by="anna")
    if harm is not _journal_cut:  # which leaves nothing of a record so young that could be told
        assert stage.run.status().state == "paused"
    stage.run.close()
