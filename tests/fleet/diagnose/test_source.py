"""Sources of data sets, the computing program, and addresses.

References must mean the same to every process.
"""

from __future__ import annotations

import hashlib
import re
from pathlib import Path

import pytest

from calib.errors import DataError
from fleet.diagnose import for_workers, in_files, in_store
from fleet.diagnose.batch import DatasetMismatch, DatasetSource, opened
from fleet.diagnose.call import exposed
from fleet.diagnose.changes import fingerprint, release, this_program
from fleet.store import Document, FleetStore, dataset_content
from tests.fleet.diagnose.sets import good
from tests.fleet.documents import BEGAN, ROBOT


def stored(store: FleetStore, data: Path, identity: str = "one", header: str = "") -> str:
    """Put a data set into the store; its hash."""
    text = header or data.with_suffix(".toml").read_text("utf-8")
    content = dataset_content(data.read_text("utf-8"), text)
    return store.add(Document("dataset", ROBOT, "cell-1", identity, BEGAN, content)).hash


def test_files_have_the_hash_of_the_stores_document(tmp_path: Path) -> None:
    data = good(tmp_path, "a")
    with FleetStore.open(f"sqlite:///{tmp_path}/s.sqlite3") as store:
        kept = stored(store, data)
        (of_files,), (of_store,) = in_files([data]), in_store(store)
        assert of_files.hash == of_store.hash == kept
        for source in (of_files, of_store):
            with opened(source, store) as dataset:
                assert dataset.fit_rows.sum() == 40
    data.write_bytes(data.read_bytes().replace(b"\n", b"\r\n"))  # as another system keeps it
    assert in_files([data])[0].hash == kept


def test_whatever_decides_a_result_is_in_the_hash(tmp_path: Path) -> None:
    data = good(tmp_path, "a")
    header, own = data.with_suffix(".toml"), tmp_path / "own.toml"
    seen = {in_files([data])[0].hash}
    for file, text in (
        (data, data.read_text("utf-8") + "\n"),
        (header, header.read_text("utf-8").replace('"abb-irb120"', '"own.toml"')),
        (own, 'format = "truepose-robot/1"'),
        (own, 'format = "truepose-robot/2"'),
        (header, "robot = \x00"),
        (data, "\udcff"),
    ):
        file.write_text(text, "utf-8", errors="surrogateescape")
        seen.add(in_files([data])[0].hash)
    header.unlink()
    seen.add(in_files([data])[0].hash)
    assert len(seen) == 8


def test_folders_are_searched_and_a_content_counts_once(tmp_path: Path) -> None:
    below = tmp_path / "deep" / "er"
    below.mkdir(parents=True)
    first, second = good(tmp_path, "a"), good(below, "b")
    (below / "notes.csv").write_text("no header beside it", "utf-8")
    for end in (".csv", ".toml"):
        (tmp_path / f"copy{end}").write_bytes(first.with_suffix(end).read_bytes())
    assert [each.path for each in in_files([second, tmp_path])] == [str(second), str(first)]
    with pytest.raises(DataError, match="no data set"):
        in_files([tmp_path / "deep" / "er", _empty(tmp_path)])
    with pytest.raises(DataError, match="no such file"):
        in_files([tmp_path / "nowhere.csv"])


def _empty(folder: Path) -> Path:
    (folder / "empty").mkdir()
    return folder / "empty"


def test_files_that_are_others_now_are_not_read(tmp_path: Path) -> None:
    data = good(tmp_path, "a")
    (source,) = in_files([data])
    with FleetStore.open(f"sqlite:///{tmp_path}/s.sqlite3") as store:
        data.write_text(data.read_text("utf-8") + "\n", "utf-8")
        with pytest.raises(DatasetMismatch, match="changed since"), opened(source, store):
            pass
        data.unlink()
        with pytest.raises(DatasetMismatch, match="cannot be read here"), opened(source, store):
            pass


@pytest.mark.parametrize("robot", ["own.toml", "/etc/own.toml", "..\\\\own"])
def test_a_header_that_was_sent_opens_no_file_of_this_computer(tmp_path: Path, robot: str) -> None:
    data = good(tmp_path, "a")
    header = data.with_suffix(".toml").read_text("utf-8").replace('"abb-irb120"', f'"{robot}"')
    with FleetStore.open(f"sqlite:///{tmp_path}/s.sqlite3") as store:
        source = DatasetSource(stored(store, data, header=header), "a")
        with pytest.raises(DataError, match="names a file"), opened(source, store):
            pass


def test_a_program_is_its_version_and_what_it_computes_with(tmp_path: Path) -> None:
    assert re.fullmatch(r"\d+\.\d+\.\d+\+[0-9a-f]{12}", this_program())
    assert release(this_program()) + "+" == this_program()[:-12]
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / "law.py").write_bytes(b"x = 1\ny = 2\n")
    (tmp_path / "arm.toml").write_bytes(b"a = 1\n")
    first = fingerprint(tmp_path)
    (tmp_path / "notes.txt").write_bytes(b"decides nothing")
    (tmp_path / "a" / "law.py").write_bytes(b"x = 1\r\ny = 2\r\n")
    assert fingerprint(tmp_path) == first
    for name, content in (("a/law.py", b"x = 1\ny = 3\n"), ("arm.toml", b"a = 2\n"), ("b.py", b"")):
        (tmp_path / name).write_bytes(content)
        last, first = first, fingerprint(tmp_path)
        assert last != first


def test_the_fingerprint_moves_with_a_line_between_files(tmp_path: Path) -> None:
    (tmp_path / "a.py").write_bytes(b"x = 1\n")
    (tmp_path / "b.py").write_bytes(b"y = 1\n")
    first = fingerprint(tmp_path)
    (tmp_path / "a.py").write_bytes(b"x = 1\ny = 1\n")
    (tmp_path / "b.py").write_bytes(b"")
    assert fingerprint(tmp_path) != first


@pytest.mark.parametrize(
    ("address", "open_way"),
    [
        ("tcp://127.0.0.1:8786", False),
        ("localhost:8786", False),
        ("tcp://[::1]:8786", False),
        ("tls://10.0.0.5:8786", False),
        ("tcp://10.0.0.5:8786", True),
        ("10.0.0.5:8786", True),
        ("plant-server:8786", True),
    ],
)
def test_an_open_way_to_a_scheduler_is_seen(address: str, open_way: bool) -> None:
    assert exposed(address) is open_way


def test_a_file_of_this_computer_is_no_store_for_workers_elsewhere(tmp_path: Path) -> None:
    assert for_workers("sqlite:///s.sqlite3", "") == f"sqlite:///{Path('s.sqlite3').absolute()}"
    assert for_workers("sqlite:///s.sqlite3", "tcp://127.0.0.1:1").endswith("s.sqlite3")
    there = "postgresql://user:secret@host/name"
    assert for_workers(there, "tls://10.0.0.5:8786") == there
    with pytest.raises(DataError, match="workers elsewhere"):
        for_workers("sqlite:///s.sqlite3", "tls://10.0.0.5:8786")


def test_the_hash_is_that_of_the_content(tmp_path: Path) -> None:
    data = good(tmp_path, "a")
    texts = (data.read_text("utf-8"), data.with_suffix(".toml").read_text("utf-8"))
    assert in_files([data])[0].hash == hashlib.sha256(dataset_content(*texts)).hexdigest()
