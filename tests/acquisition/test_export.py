"""Content of an exported record.

Readings that count, those that do not and why, places of the instrument, and events.
"""

from __future__ import annotations

import csv
import json
from contextlib import closing
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from acquisition.record.export import export, export_events, table_of
from acquisition.record.store import RecordStore
from acquisition.run.run import Run
from calib.data.read import read_dataset
from drivers.interfaces import Answer
from tests.acquisition.fakes import Bench, JumpingClock, SeatingOperator, a_campaign, a_cell, devices_of

BLOCKS = [{"set": "calibration", "count": 12, "targets": ["T1", "T2"]}]


def measured(folder: Path, *, redo: bool = False, move: bool = False, accuracy: str = "unknown") -> Path:
    """Return a finished record.

    With `redo`, the reading before T2 was measured again; with `move`, the tracker moved.
    """
    bench, clock = Bench(a_cell(instrument__one_smr=redo, robot__absolute_accuracy=accuracy)), JumpingClock()
    answers = [Answer.CONFIRM] * 4 + [Answer.REDO] if redo else []
    with closing(Run.create(folder, bench.cell, a_campaign(block=BLOCKS), simulated=True)) as run:
        if move:
            bench.faults[12] = run.pause
            run.execute(devices_of(bench), clock)
            bench.tracker.origin[:] += [40.0, -30.0, 5.0]
            run.resume()
        outcome = run.execute(devices_of(bench, SeatingOperator(bench, answers)), clock)
    assert outcome.state.value == "succeeded"
    assert ("moved" in outcome.reason) == move
    return folder


def rows(path: Path) -> list[dict[str, str]]:
    with open(path, encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def test_a_reading_that_was_done_again_stays_but_does_not_count(tmp_path: Path) -> None:
    out = export(measured(tmp_path / "r", redo=True), tmp_path / "out.csv")
    again = [row for row in rows(out) if row["status"] != "ok"]
    assert [(row["status"], row["tool_target"]) for row in again] == [("rejected:by the operator", "T1")]
    assert again[0]["x_mm"] != ""
    assert len(rows(out)) == 2 * 12 + 1
    assert "station" not in rows(out)[0]
    assert read_dataset(out).header.simulated  # as the record was
    assert int(read_dataset(out).usable.sum()) == 2 * 12


def test_whether_the_controller_corrects_goes_with_the_readings(tmp_path: Path) -> None:
    assert (
        read_dataset(export(measured(tmp_path / "r"), tmp_path / "a.csv")).header.absolute_accuracy
        == "unknown"
    )
    record = measured(tmp_path / "off", accuracy="off")
    assert read_dataset(export(record, tmp_path / "b.csv")).header.absolute_accuracy == "off"


def test_the_data_set_in_memory_is_the_one_in_the_files(tmp_path: Path) -> None:
    record = measured(tmp_path / "r", redo=True)
    unwritten, written = table_of(record).dataset(), read_dataset(export(record, tmp_path / "out.csv"))
    assert not unwritten.path.exists()
    assert unwritten.sha256 == written.sha256
    assert unwritten.header == written.header
    assert unwritten.reading_id == written.reading_id
    for name in ("sets", "status", "points", "lengths"):
        np.testing.assert_array_equal(getattr(unwritten, name), getattr(written, name))
    for name in ("joints", "previous", "time", "temperature", "target"):
        np.testing.assert_array_equal(getattr(unwritten.conditions, name), getattr(written.conditions, name))


def test_every_pose_says_where_the_robot_came_from(tmp_path: Path) -> None:
    for row in rows(export(measured(tmp_path / "r"), tmp_path / "out.csv")):
        for k in range(1, 7):
            way = float(row[f"j{k}_deg"]) - float(row[f"prev{k}_deg"])
            assert way * float(row[f"approach{k}"]) > 1.0


def test_stations_are_told_apart(tmp_path: Path) -> None:
    found = rows(export(measured(tmp_path / "r", move=True), tmp_path / "out.csv"))
    stations = [row["station"] for row in found]
    assert stations == sorted(stations)
    assert set(stations) == {"1", "2"}


def test_events_as_json_lines(tmp_path: Path) -> None:
    record = measured(tmp_path / "r", redo=True)
    count = export_events(record, tmp_path / "events.jsonl")
    events = [json.loads(line) for line in (tmp_path / "events.jsonl").read_text("utf-8").splitlines()]
    assert [event["id"] for event in events] == list(range(1, count + 1))
    assert [event["kind"] for event in events[:2]] == ["created", "state"]
    assert events[-1]["data"]["state"] == "succeeded"
    assert sum(event["kind"] == "measure_again" for event in events) == 1


@pytest.mark.parametrize("weakness", ["", "open_abb moves on a request at once"])
def test_what_the_wire_could_not_see_is_in_record_and_data_set(tmp_path: Path, weakness: str) -> None:
    bench = Bench(a_cell())
    devices = devices_of(bench, SeatingOperator(bench))
    devices.robot.weakness = weakness  # type: ignore[attr-defined]
    with closing(Run.create(tmp_path / "r", bench.cell, a_campaign(block=BLOCKS), simulated=True)) as run:
        assert run.execute(devices, JumpingClock()).state.value == "succeeded"
        reported = {
            event.data["role"]: event.data["weakness"] for event in run.events() if event.kind == "connected"
        }
    assert reported == {"robot": weakness, "instrument": ""}
    header = read_dataset(export(tmp_path / "r", tmp_path / "out.csv")).header
    assert header.unprotected == (f"robot: {weakness}" if weakness else "")
    assert header.unknown_keys == ()


def test_a_data_set_says_when_it_was_measured_and_by_whom(tmp_path: Path) -> None:
    folder = measured(tmp_path / "r", move=True)
    with closing(RecordStore.open(folder)) as store:
        for who in ("anna", "watchdog of anna", "bert", "anna"):
            store.command("pause", by=who)
        began, ended = [
            datetime.fromtimestamp(utc, UTC).strftime("%Y-%m-%d %H:%M UTC")
            for utc in store.database.query(
                "SELECT min(began_utc), max(ended_utc) FROM attempt WHERE kind = 'measure'"
            )[0]
        ]
    occasion = read_dataset(export(folder, tmp_path / "out.csv")).header.occasion
    assert occasion is not None
    assert (occasion.began, occasion.ended) == (began, ended)
    assert occasion.operators[-2:] == ("anna", "bert")
