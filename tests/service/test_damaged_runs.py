"""One damaged record among others.

The service starts, lists the record with the part that can be saved, and runs everything else.
These would catch: a service that does not start, a list that fails or leaves the run out, and a refusal that names no
rescue.
"""

from __future__ import annotations

import errno
import os
import shutil
import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager
from functools import partial
from pathlib import Path

import pytest

from acquisition import LeaseDeadline
from acquisition.errors import DamagedRecord, RecordError
from acquisition.record.database import FILE
from acquisition.run.run import Run
from service.http.runs import dry_runs
from service.http.runs.run_manager import RunManager
from service.http.wire import problems
from service.http.work.stored_documents import readable
from service.http.work.workers import Workers
from tests.acquisition.fakes import Bench, JumpingClock, a_campaign, a_cell, devices_of
from tests.acquisition.test_rescue import BLOCKS, DAMAGES, READINGS, Files, make, put

RUNS = ("20260101-000000-aaaaaa", "20260101-000001-bbbbbb", "20260101-000002-cccccc")


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Files:
    folder = make(tmp_path_factory.mktemp("whole") / "r")
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@contextmanager
def opened(folder: Path) -> Iterator[RunManager]:
    bench = Bench(a_cell())
    with (
        closing(Workers(1, waiting=0)) as workers,
        closing(RunManager(folder, lambda cell: devices_of(bench), workers, simulated=True)) as book,
    ):
        yield book


def three_runs(whole: Files, folder: Path) -> Path:
    folder.mkdir()
    for name in RUNS:
        put(whole, folder / name)
    return folder / RUNS[1]


def emptied(record: Path) -> None:
    (record / FILE).write_bytes(b"")


@pytest.mark.parametrize("damage", [*DAMAGES, "emptied", "a cell that is none"])
def test_the_rest_goes_on(whole: Files, tmp_path: Path, damage: str) -> None:
    record = three_runs(whole, tmp_path / "runs")
    made = DAMAGES | {"emptied": emptied, "a cell that is none": lose_the_cell}
    made[damage](record)
    with opened(tmp_path / "runs") as book:
        listed = {document["id"]: document for document in readable(book.ids(), book.document)}
        assert sorted(listed) == sorted(RUNS)
        bad = listed[RUNS[1]]
        assert bad["state"] == "failed"
        assert bad["damaged"]
        assert str(record) in bad["reason"]
        assert f"{bad['done']} of {bad['total']} reading" in bad["reason"]
        if damage in ("a bit flipped", "no events", "garbage in the header"):
            assert bad["total"] == READINGS
            assert bad["done"] == READINGS - (damage == "a bit flipped")
        if damage != "emptied":
            assert f"truepose campaign rescue {record}" in bad["reason"]
            with pytest.raises(DamagedRecord) as caught:
                book.get(RUNS[1])
            assert problems.of_error(caught.value)["status"] == 422
        assert book.document(RUNS[1]) == bad
        for name in (RUNS[0], RUNS[2]):
            assert listed[name]["state"] == "paused"
            assert listed[name]["done"] == READINGS
        book.get(RUNS[0]).stop(by="anna")
        assert book.document(RUNS[0])["state"] == "stopped"


def test_a_record_of_an_older_version_is_listed_and_stays_as_it_is(whole: Files, tmp_path: Path) -> None:
    record = three_runs(whole, tmp_path / "runs")
    with closing(sqlite3.connect(record / FILE)) as db:
        db.execute("PRAGMA user_version = 4")
    before = (record / FILE).read_bytes()
    with opened(tmp_path / "runs") as book:
        listed = {document["id"]: document for document in readable(book.ids(), book.document)}
        assert sorted(listed) == sorted(RUNS)
        assert listed[RUNS[1]]["state"] == "failed"
        assert "is a record of version 4" in listed[RUNS[1]]["reason"]
        assert "can be saved" not in listed[RUNS[1]]["reason"]
        with pytest.raises(RecordError, match="version 4"):
            book.get(RUNS[1])
    assert (record / FILE).read_bytes() == before


def lose_the_cell(record: Path) -> None:
    with closing(sqlite3.connect(record / FILE, isolation_level=None)) as db:
        db.execute("DROP TRIGGER campaign_fixed")
        db.execute("UPDATE campaign SET cell = 'no cell'")


def test_damage_that_comes_while_the_service_runs(whole: Files, tmp_path: Path) -> None:
    record = three_runs(whole, tmp_path / "runs")
    with opened(tmp_path / "runs") as book:
        assert book.document(RUNS[1])["state"] == "paused"
        shutil.copyfile(__file__, record / FILE)
        listed = {document["id"]: document for document in readable(book.ids(), book.document)}
        assert listed[RUNS[1]]["damaged"]
        assert len(listed) == 3


def test_a_folder_that_may_not_be_looked_into_and_a_huge_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    closed, huge = (tmp_path / "runs" / name for name in RUNS[:2])
    closed.mkdir(parents=True)
    huge.mkdir()
    with (huge / FILE).open("wb") as file:
        file.truncate(64 * 2**30)  # bytes that nobody has written take no room
    stat = Path.stat

    def forbidden(path: Path, **more: bool) -> os.stat_result:
        if closed in path.parents:
            raise PermissionError(13, "Permission denied", str(path))
        return stat(path, **more)

    monkeypatch.setattr(Path, "stat", forbidden)
    with opened(tmp_path / "runs") as book:
        listed = {document["id"]: document for document in readable(book.ids(), book.document)}
    assert sorted(listed) == sorted(RUNS[:2])
    assert "Permission denied" in listed[RUNS[0]]["reason"]
    assert "does not begin as a database does" in listed[RUNS[1]]["reason"]


def test_a_dry_run_that_is_damaged_while_the_service_runs(tmp_path: Path) -> None:
    record = tmp_path / "runs" / RUNS[0]
    record.mkdir(parents=True)
    with opened(tmp_path / "runs") as book:
        (record / dry_runs.FILE).write_bytes(b'{"id": ')
        (listed,) = readable(book.ids(), book.document)
        assert (listed["state"], listed["damaged"]) == ("failed", True)
        assert dry_runs.FILE in listed["reason"]


def test_a_run_that_was_cut_off_is_paused_as_before(whole: Files, tmp_path: Path) -> None:
    three_runs(whole, tmp_path / "runs")
    with Run.open(tmp_path / "runs" / RUNS[0]) as run:
        bench = Bench(run.cell)
        bench.faults[6] = lambda: (
            shutil.copytree(run.folder, tmp_path / "runs" / "20260101-000003-dddddd") and None
        )
        run.resume()
        run.execute(devices_of(bench), JumpingClock())
    with opened(tmp_path / "runs") as book:
        cut_off = book.document("20260101-000003-dddddd")
        assert (cut_off["state"], cut_off.get("damaged")) == ("paused", None)


def test_a_half_made_record_is_listed_and_moves_nothing(tmp_path: Path) -> None:
    (tmp_path / "runs" / RUNS[0]).mkdir(parents=True)
    with opened(tmp_path / "runs") as book:
        assert readable(book.ids(), book.document) == []  # a folder without a record
    with Run.create(tmp_path / "runs" / RUNS[1], a_cell(), a_campaign(block=BLOCKS), simulated=True):
        pass
    with opened(tmp_path / "runs") as book:
        assert [document["state"] for document in readable(book.ids(), book.document)] == ["ready"]


@pytest.mark.parametrize("dry", [True, False])
def test_a_run_that_cannot_be_created_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, *, dry: bool
) -> None:
    def full(folder: Path, *_: object, **__: object) -> None:
        folder.mkdir()
        (folder / FILE).touch()
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    cell, campaign = a_cell(), a_campaign(block=BLOCKS)
    monkeypatch.setattr(Workers, "call", lambda self, keep, folder, *more: full(folder))
    monkeypatch.setattr(Run, "create", full)
    with opened(tmp_path / "runs") as book:
        order = partial(book.check, cell, {}, "")
        if not dry:
            order = partial(book.start, cell, (campaign, []), "", LeaseDeadline("anna", 60.0))
        with pytest.raises(OSError, match="No space"):
            order()
        assert list((tmp_path / "runs").iterdir()) == []
