"""Opening a record, as its owner or as a second reader.

An old version, a newer one, a full disk, and the list of open records.
"""

from __future__ import annotations

import hashlib
import sqlite3
import subprocess
import sys
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import pytest

from acquisition import read_status
from acquisition.errors import RecordError, RecordInUse, StorageError
from acquisition.record import FILE, RecordStore, sha256_of
from acquisition.record.schema import SCRIPT
from tests.acquisition.fakes import new_store


def test_one_owner_and_readers_beside_it(tmp_path: Path) -> None:
    store = new_store(tmp_path)
    with pytest.raises(RecordInUse) as caught:
        RecordStore.open(tmp_path)
    assert caught.value.exit_code == 4
    status = read_status(tmp_path)
    assert (status.state, status.done, status.total) == ("ready", 0, 5)
    store.close()
    RecordStore.open(tmp_path).close()


def test_a_run_whose_program_was_killed_is_not_shown_as_running(tmp_path: Path) -> None:
    """Otherwise a person would wait at an arm for a campaign that no program runs any more.

    Reading the status changes nothing.
    """
    store = new_store(tmp_path)
    store.start()
    assert read_status(tmp_path).state == "running"
    version = store.version
    store.close()  # the end of a process gives up the lock, and writes nothing
    for _ in range(2):
        left = read_status(tmp_path)
        assert (left.state, left.state_code, left.version) == ("paused", 4, version)
        assert "ended in mid-campaign" in left.reason
    (tmp_path / "owner.lock").unlink()
    assert read_status(tmp_path).state == "paused"
    assert not (tmp_path / "owner.lock").exists()


def test_a_file_is_no_record(tmp_path: Path) -> None:
    file = tmp_path / "record.csv"
    file.write_text("a,b\n")
    for look in (read_status, RecordStore.open, lambda folder: RecordStore.open(folder, writer=False)):
        with pytest.raises(RecordError, match="there is no record") as caught:
            look(file)
        assert caught.value.exit_code == 2


@pytest.mark.parametrize("look", [read_status, sha256_of])
def test_what_is_written_after_a_look_by_the_same_program_survives(
    tmp_path: Path, look: Callable[[Path], object]
) -> None:
    """A process that closes a file releases all locks of the process on it.

    The next reader of the record then seemed to be the last user of the journal and removed it. All later entries of
    the run were lost with the run.
    """
    store = new_store(tmp_path)
    look(tmp_path)
    assert "after the look" not in seen_by_another_process(tmp_path)
    store.add_event("after the look")
    assert "after the look" in seen_by_another_process(tmp_path)
    store.close()


def test_the_hash_of_a_record_is_that_of_its_file_once_it_is_closed(tmp_path: Path) -> None:
    store = new_store(tmp_path / "record")
    file = tmp_path / "record" / FILE
    store.add_event("in the journal")
    while_open = sha256_of(tmp_path / "record")
    store.close()
    assert while_open == sha256_of(tmp_path / "record") == hashlib.sha256(file.read_bytes()).hexdigest()
    file.write_bytes(b"this is not a database at all" * 100)
    assert sha256_of(tmp_path / "record") == sha256_of(tmp_path / "nowhere") == ""


def seen_by_another_process(folder: Path) -> str:
    """Return the kinds of the stored events, as after the end of a killed process."""
    asked = "import sqlite3, sys; print(sqlite3.connect(sys.argv[1]).execute('SELECT kind FROM event').fetchall())"
    command = [sys.executable, "-c", asked, str(folder / FILE)]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout


def test_refuses_no_record_two_records_and_a_newer_one(tmp_path: Path) -> None:
    with pytest.raises(RecordError, match="no record"):
        RecordStore.open(tmp_path / "nowhere")
    with pytest.raises(RecordError, match="no record"):
        RecordStore.open(tmp_path)
    new_store(tmp_path).close()
    with pytest.raises(RecordError, match="already"):
        new_store(tmp_path)
    db = sqlite3.connect(tmp_path / FILE)
    db.execute("PRAGMA user_version = 99")
    db.close()
    for writer in (True, False):
        with pytest.raises(RecordError, match="newer version"):
            RecordStore.open(tmp_path, writer=writer)
    (tmp_path / "half").mkdir()  # the program ended while it made the record
    with closing(sqlite3.connect(tmp_path / "half" / FILE)) as half:
        half.executescript(SCRIPT)
    with pytest.raises(RecordError, match="holds no campaign"):
        RecordStore.open(tmp_path / "half")
    new_store(tmp_path / "half").close()
    (tmp_path / "junk").mkdir()
    (tmp_path / "junk" / FILE).write_bytes(b"this is not a database at all" * 100)
    with pytest.raises(StorageError):
        RecordStore.open(tmp_path / "junk")
    with pytest.raises(RecordError, match="already"):
        new_store(tmp_path / "junk")
    (tmp_path / "file").touch()
    with pytest.raises(StorageError, match="cannot be written"):
        new_store(tmp_path / "file" / "record")
