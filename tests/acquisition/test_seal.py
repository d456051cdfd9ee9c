"""One number changed inside the file of a record, in a way that SQLite does not see.

These would catch: a checksum that leaves a column out, one that is not checked on export, resume, verification or
merge, and one that holds for a row of another record. They would also catch older records that can no longer be read.
"""

from __future__ import annotations

import sqlite3
import struct
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from acquisition import Run, export, read_status
from acquisition.errors import DamagedRecord
from acquisition.record import FILE, export_together
from acquisition.record.seal import checksum
from acquisition.record.verification import expected_temperature, first_reading_s, read_landings
from tests.acquisition.fakes import Bench, JumpingClock, SeatingOperator, a_campaign, a_cell, devices_of

BLOCKS = [{"set": "calibration", "count": 6, "targets": ["T1", "T2"]}]
READING = "SELECT max(id) FROM attempt WHERE kind = 'measure' AND status = 'good'"
TRIGGERS = (
    "attempt_closed",
    "plan_fixed",
    "campaign_fixed",
    "device_fixed",
    "replaced_once",
    "measured_stays",
)


@pytest.fixture(scope="module")
def measured(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """A record in mid-campaign, so that it can be resumed, exported and verified."""
    folder = tmp_path_factory.mktemp("sealed")
    bench = Bench(a_cell())
    with Run.create(folder, bench.cell, a_campaign(block=BLOCKS), simulated=True) as run:
        bench.faults[20] = run.pause
        assert run.execute(devices_of(bench, SeatingOperator(bench)), JumpingClock()).state.value == "paused"
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@pytest.fixture
def record(measured: dict[str, bytes], tmp_path: Path) -> Path:
    folder = tmp_path / "r"
    folder.mkdir()
    for name, content in measured.items():
        (folder / name).write_bytes(content)
    return folder


def change(record: Path, sql: str) -> None:
    """Change the record like a faulty disk, without any trigger."""
    with closing(sqlite3.connect(record / FILE, isolation_level=None)) as db:
        for trigger in TRIGGERS:
            db.execute(f"DROP TRIGGER {trigger}")
        db.executescript(sql)


USES: list[Callable[[Path], object]] = [
    lambda record: export(record, record / "out.csv"),
    lambda record: export_together([record, record], record / "out.csv"),
    Run.open,
    read_landings,
    first_reading_s,
    lambda record: expected_temperature(record, 0.0, 100.0),
]


def test_a_double_flipped_on_the_disk(record: Path) -> None:
    """One bit of x, in the bytes of the file; the page is sound to SQLite."""
    with closing(sqlite3.connect(record / FILE)) as db:
        number, x = db.execute(f"SELECT id, world_x_mm FROM attempt WHERE id = ({READING})").fetchone()
    content = (record / FILE).read_bytes()
    assert content.count(struct.pack(">d", x)) == 1
    place = content.index(struct.pack(">d", x)) + 3
    (record / FILE).write_bytes(content[:place] + bytes([content[place] ^ 4]) + content[place + 1 :])
    with closing(sqlite3.connect(record / FILE)) as db:
        assert db.execute("PRAGMA integrity_check").fetchone()[0] == "ok"
        assert (
            0.0
            < abs(db.execute(f"SELECT world_x_mm FROM attempt WHERE id = {number}").fetchone()[0] - x)
            < 50
        )
    for use in USES:
        with pytest.raises(DamagedRecord, match=f"reading {number} no longer agrees") as caught:
            use(record)
        assert str(record / FILE) in caught.value.message
        assert f"truepose campaign rescue {record}" in caught.value.what_to_do
        assert caught.value.exit_code == 2


def test_every_column_is_covered(record: Path) -> None:
    """Change each value of a reading, its arrival, its plan, its devices and its campaign alone."""
    with closing(sqlite3.connect(record / FILE)) as db:
        db.row_factory = sqlite3.Row
        reading = dict(db.execute(f"SELECT * FROM attempt WHERE id = ({READING})").fetchone())
        rows = {
            ("attempt", reading["id"]): reading,
            ("attempt", reading["arrival"]): one(db, "attempt", reading["arrival"]),
            ("pose", reading["pose"]): one(db, "pose", reading["pose"]),
            ("device", 1): one(db, "device", 1),
        }
        for (table, _), row in rows.items():
            (campaign,) = db.execute("SELECT id FROM campaign").fetchone()
            assert row["checksum"] == checksum(campaign, table, row)
            for name, value in row.items():
                if name != "checksum":
                    other = row | {name: changed(value)}
                    assert checksum(campaign, table, other) != row["checksum"], (table, name)
            assert checksum("another campaign", table, row) != row["checksum"]


def one(db: sqlite3.Connection, table: str, number: int) -> dict[str, Any]:
    return dict(db.execute(f"SELECT * FROM {table} WHERE id = ?", (number,)).fetchone())


def changed(value: Any) -> Any:
    """The least that may happen to it."""
    if isinstance(value, float):
        return struct.unpack(">d", (int.from_bytes(struct.pack(">d", value), "big") ^ 1).to_bytes(8, "big"))[
            0
        ]
    if isinstance(value, str | bytes):
        return value[:-1] if value else None if isinstance(value, str) else b"\0"
    return 1 if value is None else value + 1


@pytest.mark.parametrize(
    ("sql", "words"),
    [
        ("UPDATE attempt SET checksum = NULL WHERE id = (SELECT max(id) FROM attempt)", "reading"),
        ("UPDATE attempt SET read_deg = replace(read_deg, '1', '2') WHERE id = 4", "arrival 4"),
        ("UPDATE pose SET joints_deg = replace(joints_deg, '1', '2') WHERE id = 7", "planned reading 7"),
        ("UPDATE pose SET status = 'skipped' WHERE id = 9", "planned reading 9"),
        ("UPDATE pose SET replaced_by = 9 WHERE id = 8", "planned reading 8"),
        ("UPDATE device SET serial = '2' WHERE id = 1", "device 1"),
        (
            "UPDATE campaign SET cell = replace(cell, '110', '910')",
            "what the campaign was begun with no longer",
        ),
        (
            "UPDATE campaign SET world = replace(world, '1', '2')",
            "what the campaign was begun with no longer",
        ),
    ],
)
def test_a_changed_row_is_refused_and_named(record: Path, sql: str, words: str) -> None:
    change(record, sql)
    with pytest.raises(DamagedRecord, match=words):
        Run.open(record)


@pytest.mark.parametrize(
    ("sql", "words"),
    [
        ("UPDATE campaign SET state = 'pausen'", "holds the state 'pausen'"),
        ("UPDATE campaign SET cell = replace(cell, '110', '910')", "holds a cell or a campaign that is not"),
        ("UPDATE event SET data = substr(data, 2)", "holds an event that is damaged"),
    ],
)
def test_a_status_that_cannot_be_told_is_refused(record: Path, sql: str, words: str) -> None:
    change(record, f"PRAGMA ignore_check_constraints = ON; DROP TRIGGER event_fixed; {sql}")
    with pytest.raises(DamagedRecord, match=words):
        read_status(record)


def test_a_planned_pose_that_was_changed_is_not_driven_to(record: Path) -> None:
    """The plan was checked when the record was created, and would not be checked again."""
    change(record, "UPDATE pose SET joints_deg = '[1.0,2.0,3.0,4.0,5.0,6.0]' WHERE status = 'planned'")
    with pytest.raises(DamagedRecord, match="planned reading"):
        Run.open(record)


def test_a_row_of_another_record(record: Path, tmp_path: Path) -> None:
    """The journal of another record in the same folder may bring in its pages, which are valid."""
    change(record, "UPDATE campaign SET id = 'another'")
    with pytest.raises(DamagedRecord):
        Run.open(record)
