"""Files in a folder as documents.

These would catch: a file of another program that is sent, and one of ours that is sent twice or never. They would also
catch a document under the wrong robot or time, and one bad file that stops the rest.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import acquisition
from acquisition import Run
from drivers.interfaces import Identity
from fleet.outbox import FILE, CellFolder, Outbox, collect, read_data
from fleet.store import Document, RobotKey, dataset_texts
from service.results.robots import read_record
from tests.acquisition.fakes import Bench, JumpingClock, a_campaign, a_cell, devices_of
from tests.fleet.test_outbox import NOW

CELL = CellFolder("cell-1")
TRIED = CellFolder("cell-1", simulated=True)
DEVICE = [{"role": "instrument", "serial": "X1"}, {"role": "robot", "maker": "ABB", "serial": "120-7"}]
MODEL: dict[str, Any] = {
    "format": "truepose-model/1",
    "robot": "abb-irb120",
    "parameters": [],
    "simulated": False,
    "device": DEVICE,
    "measured": {"began": "2026-03-02 09:15 UTC", "ended": "2026-03-02 10:00 UTC"},
}


@pytest.fixture
def outbox(tmp_path: Path) -> Iterator[Outbox]:
    with Outbox(tmp_path / FILE) as opened:
        yield opened


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    made = tmp_path / "records"
    made.mkdir()
    return made


def write(file: Path, table: Mapping[str, Any]) -> None:
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(json.dumps(table), encoding="utf-8")


def look(folder: Path, outbox: Outbox, cell: CellFolder = CELL) -> tuple[int, list[str]]:
    said: list[str] = []
    return collect(folder, cell, outbox, lambda: NOW, said.append, read_record), said


def waiting(outbox: Outbox) -> list[Document]:
    return [outbox.document(entry.hash) for entry in outbox.entries("waiting")]


def test_results_are_taken_byte_for_byte_each_once(folder: Path, outbox: Outbox) -> None:
    write(folder / "model.json", MODEL)
    write(folder / "jobs" / "7" / "verdict.json", MODEL | {"format": "truepose-watch/1", "data_sha256": "ab"})
    data = {"robot": "ur5", "devices": [{"role": "robot", "serial": "2015"}]}
    write(folder / "d.json", {"format": "truepose-diagnosis/1", "data": data})
    write(folder / "copy" / "model.json", MODEL)
    assert look(folder, outbox) == (3, [])
    assert look(folder, outbox) == (0, [])
    found = {document.kind: document for document in waiting(outbox)}
    assert set(found) == {"model", "watch", "diagnosis"}
    assert found["model"].content == (folder / "model.json").read_bytes()
    assert found["model"].robot == RobotKey("120-7", "abb-irb120")
    assert found["model"].measured_at.isoformat() == "2026-03-02T09:15:00+00:00"
    assert found["diagnosis"].robot == RobotKey("2015", "ur5")
    assert found["watch"].cell == "cell-1"


def test_a_watch_that_is_judged_otherwise_contradicts_the_first(folder: Path, outbox: Outbox) -> None:
    verdict = MODEL | {"format": "truepose-watch/1", "data_sha256": "ab", "false_alarms": 0.01}
    write(folder / "1.json", verdict | {"verdict": "unchanged"})
    write(folder / "2.json", verdict | {"verdict": "changed"})
    write(folder / "3.json", verdict | {"verdict": "changed", "false_alarms": 0.05})
    write(folder / "4.json", verdict | {"verdict": "changed", "data_sha256": "cd"})
    look(folder, outbox)
    one, other, rate, data = [document.identity for document in waiting(outbox)]
    assert one == other
    assert len({one, rate, data}) == 3


def test_what_is_not_ours_is_left(folder: Path, outbox: Outbox) -> None:
    write(folder / "package.json", {"format": "npm"})
    write(folder / "cell.json", {"format": "truepose-something/1"})
    (folder / "table.csv").write_text("a,b\n", encoding="utf-8")
    (folder / "other.csv").write_text("a,b\n", encoding="utf-8")
    (folder / "other.toml").write_text("format = 'another'\n", encoding="utf-8")
    (folder / "binary.json").write_bytes(bytes(range(256)))
    write(folder / ".trash" / "model.json", MODEL)
    assert look(folder, outbox) == (0, [])


@pytest.mark.parametrize(
    ("table", "word"),
    [
        (MODEL | {"device": []}, "serial"),
        (MODEL | {"device": [{"role": "robot", "serial": "a"}, {"role": "robot", "serial": "b"}]}, "several"),
        (MODEL | {"simulated": True}, "simulated"),
        (MODEL | {"robot": ""}, "model"),
        (MODEL | {"robot": "x" * 500}, "model"),
    ],
)
def test_one_that_cannot_be_sent_is_told_once_and_stops_nothing(
    folder: Path, outbox: Outbox, table: dict[str, Any], word: str
) -> None:
    write(folder / "a.json", table)
    write(folder / "b.json", MODEL)
    (folder / "cut.json").write_text('{"format": "truepose-model/1", "par', encoding="utf-8")
    taken, said = look(folder, outbox)
    assert taken == 1
    assert len(said) == 2
    assert word in said[0]
    assert "cut.json" in said[1]
    assert [path.name for path, _ in outbox.not_taken()] == ["a.json", "cut.json"]
    assert look(folder, outbox) == (0, [])


def test_a_file_is_looked_at_again_when_it_or_what_is_asked_has_changed(folder: Path, outbox: Outbox) -> None:
    file = folder / "model.json"
    write(file, MODEL | {"device": [], "simulated": True})
    assert look(folder, outbox)[0] == 0
    assert look(folder, outbox, TRIED)[0] == 0
    assert look(folder, outbox, CellFolder("cell-1", "120-9", simulated=True))[0] == 1
    assert waiting(outbox)[0].robot.serial == "120-9"
    write(file, MODEL)
    os.utime(file, ns=(1, 1))
    assert look(folder, outbox)[0] == 1
    outbox.look_again()
    assert look(folder, outbox)[0] == 0
    assert outbox.not_taken() == []


def a_record(folder: Path, *, serial: str = "120-7", fail: bool = False) -> Path:
    """A campaign of six poses on fakes."""
    bench = Bench(a_cell())
    bench.who["robot"] = Identity("ABB", "IRB 120", serial, "1", "none")
    blocks = [{"set": "calibration", "count": 6, "targets": ["T1"]}]
    record = folder / "campaign-1"
    with closing(Run.create(record, bench.cell, a_campaign(block=blocks), simulated=True)) as run:
        if fail:
            bench.faults = {3: run.pause}
        run.execute(devices_of(bench), JumpingClock())
    return record


def test_a_finished_record_is_a_data_set_and_a_campaign(folder: Path, outbox: Outbox) -> None:
    record = a_record(folder)
    assert look(folder, outbox, TRIED) == (2, [])
    data, campaign = waiting(outbox)
    assert (data.kind, campaign.kind) == ("dataset", "campaign")
    assert data.robot == campaign.robot == RobotKey("120-7", "abb-irb120")
    summary = json.loads(campaign.content)
    assert (summary["state"], summary["simulated"], summary["datasets"]) == ("succeeded", True, [data.hash])
    # The data set that a person exports is the same document.
    out = acquisition.export(record, record / "mine.csv")
    assert dataset_texts(data.content) == (
        out.read_text("utf-8"),
        out.with_suffix(".toml").read_text("utf-8"),
    )
    assert look(folder, outbox, TRIED) == (0, [])
    # Somebody mends a reading by hand: another statement of the same hours.
    out.write_text(out.read_text("utf-8").replace("ok", "rejected:by hand", 1), "utf-8")
    assert look(folder, outbox, TRIED)[0] == 1
    mended = waiting(outbox)[-1]
    assert mended.identity == data.identity
    assert mended.hash != data.hash
    # Robots that report no serial number may be measured in the same minute: neither contradicts the other.
    header = out.with_suffix(".toml")
    header.write_text(header.read_text("utf-8").replace('serial = "120-7"\n', ""), "utf-8")
    ours, theirs = (read_data(out, replace(TRIED, serial=serial))[0] for serial in ("7", "8"))
    assert (ours.hash, ours.identity == theirs.identity) == (theirs.hash, False)


def test_a_record_is_not_sent_before_its_end_nor_as_a_real_one(folder: Path, outbox: Outbox) -> None:
    record = a_record(folder, fail=True)
    assert look(folder, outbox, TRIED) == (0, [])
    with closing(Run.open(record)) as run:
        bench = Bench(a_cell())
        bench.who["robot"] = Identity("ABB", "IRB 120", "120-7", "1", "none")
        run.resume()
        run.execute(devices_of(bench), JumpingClock())
    taken, said = look(folder, outbox)
    assert taken == 0
    assert f"{record}: is of a simulated robot" in said[0]
    assert look(folder, outbox, TRIED)[0] == 2


def test_a_damaged_record_stops_nothing(folder: Path, outbox: Outbox) -> None:
    record = a_record(folder)
    write(folder / "z.json", MODEL)
    for file in record.glob("record.sqlite3*"):
        file.write_bytes(b"damaged" * 1000)
    taken, said = look(folder, outbox, TRIED)
    assert taken == 1
    assert len(said) == 1
