"""Damaged files of records, after faults of disks, people and other programs.

They are refused by name, and saved if they are readable. These would catch: a traceback, a record that is written to,
and a reading that is saved wrong. They would also catch a readable reading that is lost, and a foreign file that is
removed.
"""

from __future__ import annotations

import os
import shutil
import sqlite3
import struct
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import pytest

from acquisition import Event, Run, export, read_status
from acquisition.errors import DamagedRecord, RecordError, RecordInUse, StorageError
from acquisition.record import FILE, RecordStore, rescue, salvage
from calib import read_dataset
from drivers import ConfigError
from service.cli import main
from tests.acquisition.fakes import Bench, JumpingClock, SeatingOperator, a_campaign, a_cell, devices_of
from tests.service.campaigns import read_rows

BLOCKS = [{"set": "calibration", "count": 40, "targets": ["T1"]}]
READINGS = 33  # of poses, when it is paused
PAGE = 4096
Files = dict[str, bytes]


def make(folder: Path, seed: int = 3) -> Path:
    bench = Bench(a_cell())
    with Run.create(folder, bench.cell, a_campaign(block=BLOCKS, seed=seed), simulated=True) as run:

        def heard(event: Event) -> None:
            if event.kind == "reading" and run.status().done == READINGS:
                run.pause()

        assert (
            run.execute(devices_of(bench, SeatingOperator(bench)), JumpingClock(), heard).state.value
            == "paused"
        )
    return folder


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Files:
    folder = make(tmp_path_factory.mktemp("whole") / "r")
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@pytest.fixture
def record(whole: Files, tmp_path: Path) -> Path:
    return put(whole, tmp_path / "r")


def put(files: Files, folder: Path) -> Path:
    folder.mkdir()
    for name, content in files.items():
        (folder / name).write_bytes(content)
    return folder


def page_of(record: Path, table: str) -> int:
    """Find the page of a leaf of a table in the file, by a value in the leaf."""
    column = {"attempt": "began_utc", "event": "utc"}[table]
    with closing(sqlite3.connect(record / FILE)) as db:
        rows = db.execute(f"SELECT {column} FROM {table} ORDER BY id").fetchall()
    return (record / FILE).read_bytes().index(struct.pack(">d", rows[len(rows) // 2][0])) // PAGE


def zeroed(record: Path, table: str) -> None:
    page = page_of(record, table)
    with (record / FILE).open("r+b") as file:
        file.seek(page * PAGE)
        file.write(bytes(PAGE))


def cut(record: Path, share: float) -> None:
    os.truncate(record / FILE, int((record / FILE).stat().st_size * share))


def garbage(record: Path, length: int) -> None:
    with (record / FILE).open("r+b") as file:
        file.write(b"\xa5" * length)


def folder_instead(record: Path) -> None:
    (record / FILE).unlink()
    (record / FILE).mkdir()


def without(table: str) -> Callable[[Path], None]:
    def drop(record: Path) -> None:
        with closing(sqlite3.connect(record / FILE, isolation_level=None)) as db:
            for (trigger,) in db.execute("SELECT name FROM sqlite_master WHERE type = 'trigger'").fetchall():
                db.execute(f"DROP TRIGGER {trigger}")
            db.execute(f"DROP TABLE {table}")

    return drop


def foreign(record: Path) -> None:
    (record / FILE).unlink()
    with closing(sqlite3.connect(record / FILE)) as db:
        db.executescript(
            "CREATE TABLE invoices (id INTEGER); INSERT INTO invoices VALUES (7); PRAGMA user_version = 3;"
        )


def flipped(record: Path) -> None:
    """One bit of the y of one reading."""
    with closing(sqlite3.connect(record / FILE)) as db:
        (y,) = db.execute(
            "SELECT world_y_mm FROM attempt WHERE arrival IS NOT NULL AND status = 'good'"
        ).fetchone()
    content = bytearray((record / FILE).read_bytes())
    content[content.index(struct.pack(">d", y)) + 4] ^= 16
    (record / FILE).write_bytes(content)


DAMAGES: dict[str, Callable[[Path], None]] = {
    "cut in the middle": lambda record: cut(record, 0.5),
    "cut to a few bytes": lambda record: cut(record, 0.0003),
    "a page of attempts zeroed": lambda record: zeroed(record, "attempt"),
    "a page of events zeroed": lambda record: zeroed(record, "event"),
    "garbage in the header": lambda record: garbage(record, 100),
    "garbage in the first page": lambda record: garbage(record, PAGE),
    "a folder in its place": folder_instead,
    "no attempts": without("attempt"),
    "no events": without("event"),
    "a foreign database": foreign,
    "a bit flipped": flipped,
}


@pytest.mark.parametrize("damage", DAMAGES, ids=str)
def test_it_is_refused_by_name_and_left_as_it_is(record: Path, damage: str, tmp_path: Path) -> None:
    DAMAGES[damage](record)
    before = contents(record)
    uses: list[Callable[[], object]] = [lambda: Run.open(record), lambda: export(record, tmp_path / "o.csv")]
    for use in uses:
        with pytest.raises(DamagedRecord) as caught:
            use()
        assert str(record / FILE) in caught.value.message
        assert f"truepose campaign rescue {record}" in caught.value.what_to_do
    with pytest.raises(RecordError, match="already"):  # nor is it taken away for a new one
        make(record)
    assert contents(record) == before


def contents(record: Path) -> Files:
    """Return the contents of the files, without the files that readers add."""
    return {
        p.name: p.read_bytes()
        for p in record.iterdir()
        if p.is_file() and not p.name.endswith(("-shm", "-wal"))
    }


LEAST = {
    "a page of attempts zeroed": READINGS // 2,
    "a page of events zeroed": READINGS,
    "garbage in the header": READINGS,
    "no events": READINGS,
    "a bit flipped": READINGS - 1,
    "cut in the middle": 0,
    "no attempts": 0,
}


@pytest.mark.parametrize("damage", LEAST, ids=str)
def test_what_is_rescued_is_right_and_what_is_lost_is_said(
    record: Path, whole: Files, damage: str, tmp_path: Path
) -> None:
    true = readings(put(whole, tmp_path / "true"))
    DAMAGES[damage](record)
    before = contents(record)
    rescued = rescue(record, tmp_path / "out")
    assert contents(record) == before
    assert LEAST[damage] <= rescued.saved <= rescued.measured <= READINGS == len(true)
    assert rescued.lost or rescued.saved == READINGS
    found = readings(tmp_path / "out") if rescued.saved else {}
    good = {name: row for name, row in found.items() if row["status"] == "ok"}
    assert len(good) == rescued.saved
    assert all(row == true[name] for name, row in good.items())
    assert {row["status"] for row in found.values()} <= {"ok", "rejected:damaged"}
    with Run.open(tmp_path / "out") as run:
        assert run.status().state == "paused"
        assert run.status().reason.startswith("Rescued: ")
        assert run.events()[-1].kind == "rescued"


@pytest.mark.parametrize("damage", sorted(set(DAMAGES) - set(LEAST)), ids=str)
def test_where_cell_and_campaign_are_gone_only_a_copy_helps(
    record: Path, damage: str, tmp_path: Path
) -> None:
    DAMAGES[damage](record)
    with pytest.raises(StorageError, match=str(record)) as caught:
        rescue(record, tmp_path / "out")
    assert "put back a copy" in caught.value.what_to_do.lower()
    assert not (tmp_path / "out").exists()


def readings(record: Path) -> dict[str, dict[str, str]]:
    return {row["reading_id"]: row for row in read_rows(export(record, record.with_suffix(".csv")))}


def test_a_flipped_reading_stays_as_rejected(record: Path, tmp_path: Path) -> None:
    flipped(record)
    rescued = rescue(record, tmp_path / "out.csv")
    rows = read_rows(tmp_path / "out.csv")
    (bad,) = [row for row in rows if row["status"] != "ok"]
    assert bad["status"] == "rejected:damaged"
    assert bad["x_mm"] == ""
    assert rescued.saved == len(rows) - 1 == int(read_dataset(tmp_path / "out.csv").usable.sum())
    assert rescued.lost[0] == f"reading {bad['reading_id']} no longer agrees with its checksum"


def test_a_rescued_campaign_goes_on(record: Path, tmp_path: Path) -> None:
    zeroed(record, "attempt")
    rescue(record, tmp_path / "out")
    with Run.open(tmp_path / "out") as run:
        bench = Bench(run.cell)
        run.resume(by="anna")
        assert run.execute(devices_of(bench, SeatingOperator(bench)), JumpingClock()).exit_code == 0
        assert run.status().done == 40


def test_the_journal_of_another_record(record: Path, whole: Files, tmp_path: Path) -> None:
    """A journal is replayed even if it belongs to another record.

    Its readings must not be taken for readings of this record.
    """
    other = make(tmp_path / "other", seed=9)
    with closing(sqlite3.connect(other / FILE, isolation_level=None)) as db:
        db.execute("PRAGMA wal_autocheckpoint = 0")
        db.execute("UPDATE prompt SET reason = reason")
        db.execute("DROP TRIGGER attempt_closed")
        db.execute("UPDATE attempt SET world_x_mm = world_x_mm + 1 WHERE world_x_mm IS NOT NULL")
        shutil.copyfile(other / f"{FILE}-wal", record / f"{FILE}-wal")
    with pytest.raises((DamagedRecord, ConfigError)):
        Run.open(record)
    assert rescue(record, tmp_path / "out").saved == READINGS  # without the journal it is whole
    assert readings(tmp_path / "out") == readings(put(whole, tmp_path / "true"))


def test_an_empty_file_beside_its_journal_is_not_opened(record: Path) -> None:
    """SQLite would take the journal away, which may hold the latest readings."""
    (record / FILE).write_bytes(b"")
    (record / f"{FILE}-wal").write_bytes(b"latest readings")
    for use in (Run.open, read_status):
        with pytest.raises(DamagedRecord, match="is empty, its journal is not"):
            use(record)
    with pytest.raises(RecordError, match="already"):
        make(record)
    assert (record / f"{FILE}-wal").read_bytes() == b"latest readings"


def test_an_empty_file_holds_no_campaign(record: Path) -> None:
    (record / FILE).write_bytes(b"")
    with pytest.raises(RecordError, match="holds no campaign"):
        read_status(record)


def test_no_right_to_read(record: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Tests may run as a user who may read everything: the system is made to refuse."""
    allowed = os.access
    monkeypatch.setattr(os, "access", lambda path, mode: path != record / FILE and allowed(path, mode))
    with pytest.raises(StorageError, match=r"record.sqlite3: cannot be read \(Permission denied\)") as caught:
        read_status(record)
    assert "right to read" in caught.value.what_to_do


def test_what_may_not_be_rescued(record: Path, tmp_path: Path) -> None:
    with pytest.raises(RecordError, match="is the damaged record itself"):
        rescue(record, tmp_path / "r" / ".")
    with pytest.raises(RecordError, match="there is no record"):
        rescue(tmp_path / "nowhere", tmp_path / "out")
    make(tmp_path / "there")
    with pytest.raises(RecordError, match="already"):
        rescue(record, tmp_path / "there")
    with closing(RecordStore.open(record)), pytest.raises(RecordInUse):
        rescue(record, tmp_path / "out")


def test_a_whole_record_loses_nothing(record: Path, tmp_path: Path) -> None:
    assert salvage(record).damaged == dict.fromkeys(("pose", "attempt", "device", "chunk"), frozenset())
    rescued = rescue(record, tmp_path / "out")
    assert rescued.lost == ()
    assert read_rows(export(tmp_path / "out", tmp_path / "a.csv")) == read_rows(
        export(record, tmp_path / "b.csv")
    )


def test_at_the_command_line(record: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    flipped(record)
    for line in (
        ["campaign", "export", str(record), str(tmp_path / "o.csv")],
        ["campaign", "resume", str(record), "--simulate"],
    ):
        assert main(line) == 2
        shown = capsys.readouterr().err
        assert str(record / FILE) in shown.replace("\n", "")
        assert "truepose campaign rescue" in shown
    assert main(["campaign", "rescue", str(record), "--json", str(tmp_path / "r.json")]) == 0
    shown = capsys.readouterr()
    assert f"{READINGS - 1} of {READINGS} readings saved" in shown.out
    assert "no longer agrees with its checksum" in shown.err
    assert main(["campaign", "export", str(tmp_path / "r-rescued"), str(tmp_path / "o.csv")]) == 0
    assert main(["campaign", "rescue", str(record)]) == 2  # it is there already
