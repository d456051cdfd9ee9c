"""The queue file of an outbox.

These would catch: an entry that `put` had taken and a power cut or a killed process undoes, and a content that leaves
before its acknowledgement. They would also catch a document that is taken twice, and a full disk or a damaged file that
ends in a traceback.
"""

from __future__ import annotations

import random
import signal
import sqlite3
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest

from calib.errors import DataError
from fleet.outbox import FILE, LARGEST, Outbox
from fleet.store import Document
from tests.acquisition.platter import Disk, Mark, Platter, connect, mark_of
from tests.fleet import documents

NOW = datetime(2026, 3, 2, 12, 0, tzinfo=UTC)
MARKS = ("SELECT count(*) FROM entry", "SELECT count(*) FROM entry WHERE content IS NULL")


@contextmanager
def on(disk: Disk, rewrite: Callable[[str], str] = lambda sql: sql) -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sqlite3, "connect", connect(disk, rewrite, MARKS))
        yield


def a_week(file: Path) -> None:
    """Documents come in, and some are acknowledged."""
    with Outbox(file) as outbox:
        for day in range(30):
            document = documents.model({"d1": 0.1 * day, "padding": day}, day=day)
            assert outbox.put(document, NOW)
            if day % 3 == 0:
                outbox.acknowledged(document.hash, NOW)


def after_the_cut(files: dict[str, bytes], folder: Path) -> Mark:
    folder.mkdir()
    for name, content in files.items():
        (folder / name).write_bytes(content)
    with Outbox(folder / FILE) as outbox:  # as the sender opens it the next morning
        for entry in outbox.entries("waiting"):
            assert outbox.document(entry.hash).hash == entry.hash
    with closing(sqlite3.connect(folder / FILE)) as db:
        assert db.execute("PRAGMA integrity_check").fetchone()[0] == "ok"
        return mark_of(lambda sql: db.execute(sql).fetchone()[0], MARKS)


def lost_by_cuts(disk: Disk, folder: Path) -> tuple[int, int]:
    """Cuts after every commit and in between; how many there were, and how many lost a commit."""
    chance, platter = random.Random(1), Platter()
    durable: Mark = (0, 0)
    cuts = lost = 0
    for i, op in enumerate(disk.ops):
        platter.take(op)
        if op.kind == "commit":
            durable = op.mark
        if op.kind == "commit" or chance.random() < 0.1:
            cuts += 1
            found = after_the_cut(platter.cut(chance), folder / str(i))
            lost += any(has < had for has, had in zip(found, durable, strict=True))
    return cuts, lost


def test_no_entry_is_lost_by_a_power_cut(tmp_path: Path) -> None:
    disk = Disk()
    (tmp_path / "cell").mkdir()
    with on(disk):
        a_week(tmp_path / "cell" / FILE)
    cuts, lost = lost_by_cuts(disk, tmp_path)
    assert cuts > 60
    assert lost == 0


def test_without_the_sync_of_the_folder_entries_are_lost(tmp_path: Path) -> None:
    """The disk of this test does forget: with FULL instead of EXTRA, the same cuts undo commits."""
    disk = Disk()
    (tmp_path / "cell").mkdir()
    with on(disk, lambda sql: sql.replace("synchronous = EXTRA", "synchronous = FULL")):
        a_week(tmp_path / "cell" / FILE)
    assert lost_by_cuts(disk, tmp_path)[1] > 10


_KILLED = """
import sys
from pathlib import Path
from fleet.outbox import Outbox
from tests.fleet import documents
from tests.fleet.test_outbox import NOW
with Outbox(Path(sys.argv[1])) as outbox:
    for day in range(10**6):
        document = documents.model({"d1": day}, day=day)
        outbox.put(document, NOW)
        print(document.hash, flush=True)
"""


def test_what_was_taken_in_survives_kill_9(tmp_path: Path) -> None:
    said: list[str] = []
    with subprocess.Popen(
        [sys.executable, "-c", _KILLED, str(tmp_path / FILE)], stdout=subprocess.PIPE, encoding="ascii"
    ) as process:
        assert process.stdout is not None
        while len(said) < 20:
            line = process.stdout.readline()
            assert line
            said.append(line.strip())
        process.send_signal(signal.SIGKILL)
        said += [line.strip() for line in process.stdout if line.endswith("\n")]
    with Outbox(tmp_path / FILE) as outbox:
        kept = [entry.hash for entry in outbox.entries("waiting")]
        assert kept[: len(said)] == said
        assert len(kept) - len(said) <= 1  # the one that was in hand
        assert all(outbox.document(each).hash == each for each in kept)


def test_the_same_content_is_taken_once_and_comes_out_as_it_was(tmp_path: Path) -> None:
    document = documents.model({"d1": 0.25})
    with Outbox(tmp_path / FILE) as outbox:
        assert outbox.put(document, NOW)
        assert not outbox.put(document, NOW)
        (entry,) = outbox.entries("waiting")
        assert (entry.hash, entry.size, entry.robot) == (
            document.hash,
            len(document.content),
            document.robot,
        )
        assert outbox.document(entry.hash) == document


def test_a_content_stays_until_its_acknowledgement_and_is_known_for_good(tmp_path: Path) -> None:
    one, other = documents.model({"d1": 1.0}), documents.model({"d1": 2.0}, day=1)
    with Outbox(tmp_path / FILE) as outbox:
        outbox.put(one, NOW)
        outbox.put(other, NOW)
        outbox.tried(one.hash, "nobody answered")
        outbox.set_aside(other.hash, "not wanted", NOW)
    with Outbox(tmp_path / FILE) as outbox:
        assert outbox.document(one.hash) == one
        assert outbox.document(other.hash) == other
        assert [(e.tries, e.said) for e in outbox.entries("waiting", "aside")] == [
            (1, "nobody answered"),
            (1, "not wanted"),
        ]
        outbox.acknowledged(one.hash, NOW)
        with pytest.raises(KeyError):
            outbox.document(one.hash)
        assert not outbox.put(one, NOW)
        assert outbox.entries("waiting") == []
        outbox.set_aside(one.hash, "too late", NOW)  # what the server has is not set aside
        assert [entry.hash for entry in outbox.entries("sent")] == [one.hash]
        assert outbox.retry(other.hash, NOW)
        assert not outbox.retry(other.hash, NOW)
        assert [entry.hash for entry in outbox.entries("waiting")] == [other.hash]


def test_a_full_disk_is_a_refusal_and_nothing_that_was_there_is_lost(tmp_path: Path) -> None:
    first = documents.model({"d1": 1.0})
    with Outbox(tmp_path / FILE) as outbox:
        outbox.put(first, NOW)
        pages = outbox._connection.execute("PRAGMA page_count").fetchone()[0]
        outbox._connection.execute(f"PRAGMA max_page_count = {pages}")  # SQLite's own full disk
        large = Document(
            "model", first.robot, "cell-1", "large", NOW, b'{"format": "' + b"x" * 100_000 + b'"}'
        )
        with pytest.raises(DataError, match="the disk is full") as refused:
            outbox.put(large, NOW)
        assert "Make room" in refused.value.do
        outbox._connection.execute(f"PRAGMA max_page_count = {pages + 100}")
        assert outbox.put(large, NOW)
        assert [entry.hash for entry in outbox.entries("waiting")] == [first.hash, large.hash]


def test_what_no_server_takes_is_not_taken_in(tmp_path: Path) -> None:
    large = Document("dataset", documents.ROBOT, "cell-1", "large", NOW, b"x" * (LARGEST + 1))
    with Outbox(tmp_path / FILE) as outbox, pytest.raises(DataError, match="at most 32"):
        outbox.put(large, NOW)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"this is no database" * 100, "damaged"),
        (b"SQLite format 3\0" + b"\xff" * 4000, "damaged|cannot be used"),
    ],
)
def test_a_file_that_is_no_outbox_is_refused_and_left_as_it_is(
    tmp_path: Path, content: bytes, words: str
) -> None:
    file = tmp_path / FILE
    file.write_bytes(content)
    with pytest.raises(DataError, match=words):
        Outbox(file)
    assert file.read_bytes() == content


def test_a_file_of_a_newer_version_is_refused(tmp_path: Path) -> None:
    Outbox(tmp_path / FILE).close()
    with closing(sqlite3.connect(tmp_path / FILE)) as db:
        db.execute("PRAGMA user_version = 9")
    with pytest.raises(DataError, match="newer version"):
        Outbox(tmp_path / FILE)


def test_two_programs_have_it_open(tmp_path: Path) -> None:
    document: Any = documents.model({"d1": 1.0})
    with Outbox(tmp_path / FILE) as one, Outbox(tmp_path / FILE) as other:
        one.put(document, NOW)
        assert [entry.hash for entry in other.entries("waiting")] == [document.hash]
        other.acknowledged(document.hash, NOW)
        assert one.entries("waiting") == []
