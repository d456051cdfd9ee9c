"""`truepose history` and `truepose fleet migrate`.

Stored documents are returned as tables, JSON, pictures and exit codes.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import pytest

from calib.errors import DataError
from calib.upkeep import Staircase
from fleet.store import FleetStore, RobotKey, utc_now
from service.cli import main
from service.results.history import due_of, text_of, trends_of
from service.results.robots import DueDateRequest, told_robots
from tests.fleet.documents import BEGAN, ROBOT, model, of

SERIAL = "120-4711"
DAY = "2026-03-02 09:15 UTC"


@pytest.fixture
def write(tmp_path: Path) -> Callable[..., Path]:
    """Documents as the commands write them, as short as they may be."""

    def written(name: str, table: dict[str, Any], day: str = DAY, serial: str = SERIAL) -> Path:
        device = [{"role": "robot", "model": "IRB 120", "serial": serial}]
        about = {"robot": "abb-irb120", "device": device, "measured": {"began": day, "ended": day}}
        path = tmp_path / name
        path.write_text(json.dumps(table | about), encoding="utf-8")
        return path

    return written


def model_of(value: float) -> dict[str, Any]:
    entry = {"name": "d1", "value": value, "std": 0.005, "unit": "mm", "nominal": 0.0, "owner": "robot"}
    return {"format": "truepose-model/1", "program": "truepose 0.1.0", "parameters": [entry]}


def watch_of(error: float, verdict: str = "unchanged") -> dict[str, Any]:
    return {
        "format": "truepose-watch/1",
        "verdict": verdict,
        "in_words": "",
        "advice": "Nothing." if verdict == "unchanged" else "Re-zero joint 4 by 0.031 deg.",
        "causes": []
        if verdict == "unchanged"
        else [
            {
                "label": "joint_step:j4",
                "weight": 1.0,
                "in_words": "Joint 4 lost its zero.",
                "size": {"value": 0.031, "u": 0.004, "unit": "deg"},
            }
        ],
        "error_mm": {"n": 20, "rms": error, "max": 2 * error, "u": 0.01},
        "model": "model.json",
        "data_sha256": "0" * 64,
        "false_alarms": 0.01,
    }


@pytest.fixture
def address(tmp_path: Path) -> str:
    return f"sqlite:///{tmp_path}/store.sqlite3"


@pytest.fixture
def ask(address: str, tmp_path: Path) -> Callable[..., tuple[int, dict[str, Any]]]:
    """Run a command of `history` on one store; its exit code and JSON."""

    def asked(*arguments: str) -> tuple[int, dict[str, Any]]:
        out = tmp_path / "out.json"
        out.unlink(missing_ok=True)
        code = main(["history", *arguments, "--store", address, "--json", str(out)])
        return code, json.loads(out.read_text("utf-8")) if out.exists() else {}

    return asked


def test_what_is_put_in_is_shown_in_the_order_of_time(
    ask: Callable[..., tuple[int, dict[str, Any]]],
    write: Callable[..., Path],
    capsys: pytest.CaptureFixture[str],
) -> None:
    files = [
        write("v.json", watch_of(0.4, "changed"), "2026-04-01 08:00 UTC"),
        write("m.json", model_of(1.5)),
    ]
    code, document = ask("add", *map(str, files), "--cell", "seven")
    assert code == 0
    assert [each["state"] for each in document["added"]] == ["new", "new"]
    assert ask("add", str(files[1]))[1]["added"][0]["state"] == "known"
    _, robots = ask("robots")
    assert robots["robots"] == [
        {
            "serial": SERIAL,
            "model": "abb-irb120",
            "cells": ["seven"],
            "documents": {"model": 1, "watch": 1},
            "last_measured": "2026-04-01T08:00:00Z",
            "retired": False,
        }
    ]
    capsys.readouterr()
    _, history = ask("show", SERIAL)
    kinds = [(each["kind"], each["verdict"]) for each in history["history"]]
    assert kinds == [("model", None), ("watch", "changed")]
    assert history["history"][1]["causes"][0]["u"] == 0.004
    said = capsys.readouterr().out
    assert "joint_step:j4" in said
    assert "Last advice (2026-04-01): Re-zero joint 4 by 0.031 deg." in said


def test_a_document_is_known_by_its_format_wherever_that_is(
    ask: Callable[..., tuple[int, dict[str, Any]]], write: Callable[..., Path]
) -> None:
    """Other programs write the members in another order."""
    table = watch_of(0.4)
    late = {"notes": ["a sentence" * 100]} | {k: v for k, v in table.items() if k != "format"}
    file = write("v.json", late | {"format": table["format"]})
    code, document = ask("add", str(file))
    assert (code, [each["state"] for each in document["added"]]) == (0, ["new"])


def test_a_contradiction_ends_with_3_and_both_are_kept(
    ask: Callable[..., tuple[int, dict[str, Any]]], write: Callable[..., Path]
) -> None:
    ask("add", str(write("one.json", watch_of(0.1))))
    code, document = ask("add", str(write("two.json", watch_of(0.2))))
    assert code == 3
    (found,) = document["added"]
    assert found["state"] == "conflict"
    assert len(found["contradicts"]) == 1
    _, history = ask("show", SERIAL)
    assert [each["contradicts_another"] for each in history["history"]] == [True, True]


def test_a_trend_with_limits_and_its_picture(
    ask: Callable[..., tuple[int, dict[str, Any]]], write: Callable[..., Path], tmp_path: Path
) -> None:
    for month, value in enumerate((1.500, 1.503, 1.498, 1.501, 1.700), start=1):
        ask("add", str(write(f"{month}.json", model_of(value), f"2026-0{month}-01 08:00 UTC")))
    for ending, begins in (("png", b"\x89PNG"), ("svg", b"<?xml")):
        picture = tmp_path / f"p.{ending}"
        code, document = ask("trend", SERIAL, "d1", "--picture", str(picture))
        assert code == 0
        assert picture.read_bytes().startswith(begins)
    (trend,) = document["trends"]
    assert [each["value"] for each in trend["values"]] == [1.5, 1.503, 1.498, 1.501, 1.7]
    assert None not in [each["limits"] for each in trend["values"]]
    low, high = trend["values"][-1]["limits"]
    assert low < 1.5 < high < 1.7
    assert any("The value of 2026-05-01 is 1.7" in each for each in trend["signals"])
    _, everything = ask("trend", SERIAL)
    assert [each["parameter"] for each in everything["trends"]] == ["d1"]
    assert "1.7" in (tmp_path / "p.svg").read_text("utf-8")


def test_one_value_has_no_chart(
    ask: Callable[..., tuple[int, dict[str, Any]]],
    write: Callable[..., Path],
    capsys: pytest.CaptureFixture[str],
) -> None:
    ask("add", str(write("m.json", model_of(1.5))))
    _, document = ask("trend", SERIAL, "d1")
    assert document["trends"][0]["values"][0]["limits"] is None
    assert "no control chart: One value" in capsys.readouterr().err


def test_values_in_different_units_are_no_trend(address: str) -> None:
    entry = {"name": "d1", "value": 1.0, "std": 0.1, "unit": "deg"}
    with FleetStore.open(address) as store:
        store.add(model({"d1": 1.0}))
        store.add(of("model", {"format": "truepose-model/1", "parameters": [entry]}, day=1))
        with pytest.raises(DataError, match="deg and in mm"):
            trends_of(store, ROBOT, "d1")


def error_at(store: FleetStore, robot: RobotKey, day: float, value: float) -> None:
    store.add(of("watch", watch_of(value), robot=robot, day=day))


def test_those_that_are_due_first_come_first(address: str) -> None:
    """Good checks make the interval of the staircase longer, and a bad one makes it shorter."""
    good, bad, never = (RobotKey(serial, "irb120") for serial in ("1", "2", "3"))
    way, now = Staircase(100.0, permitted=0.3), BEGAN + timedelta(days=101)
    with FleetStore.open(address) as store:
        for robot in (good, bad):
            error_at(store, robot, 0.0, 0.1)
        error_at(store, good, 100.0, 0.1)
        error_at(store, bad, 100.0, 0.5)
        store.add(model({"d1": 1.0}, robot=never))
        found = due_of(store, way, now)
    assert [each.known.robot for each in found] == [never, bad, good]
    unknown, soon, late = found
    assert unknown.due is not None
    assert unknown.overdue(now)
    assert "never checked" in unknown.because
    assert soon.due is not None
    assert late.due is not None
    assert soon.due.date < BEGAN + timedelta(days=150)
    assert late.due.date == BEGAN + timedelta(days=100 + 110)  # 100 days and a tenth
    assert not late.overdue(now)
    assert soon.error is not None
    assert soon.error.value == 0.5


def test_what_has_changed_is_due_now_until_it_is_calibrated(address: str) -> None:
    """It is due regardless of the date that follows from the errors.

    This holds at the command line and in the service.
    """
    way, now = Staircase(100.0, permitted=0.3), BEGAN + timedelta(days=20)
    asked = DueDateRequest(permitted_mm=None)
    with FleetStore.open(address) as store:
        store.add(model({"d1": 1.0}))
        store.add(of("watch", watch_of(0.1, "changed"), day=10.0))
        (found,) = due_of(store, way, now)
    assert found.due is not None
    assert (found.due.date, found.overdue(now)) == (BEGAN + timedelta(days=10), True)
    assert found.because.startswith("Now: the last watch found it changed.")
    (line,) = told_robots(address, asked)["robots"]
    assert line["due"] == {"date": text_of(found.due.date), "overdue": True, "because": found.because}
    with FleetStore.open(address) as store:
        store.add(model({"d1": 1.1}, day=15.0))
        (mended,) = due_of(store, way, now)
    assert mended.due is not None
    assert not mended.overdue(now)
    assert (
        told_robots(address, asked)["robots"][0]["due"]["date"] is None
    )  # nobody has said what is permitted


def test_a_check_that_is_yet_to_come_is_no_date_for_one_robot_alone(address: str) -> None:
    with FleetStore.open(address) as store:
        error_at(store, ROBOT, 10.0, 0.1)
        error_at(store, RobotKey("2", "irb120"), 0.0, 0.1)
        wrong, right = due_of(store, Staircase(100.0, permitted=0.3), BEGAN + timedelta(days=1))
    assert wrong.due is None
    assert "yet to come" in wrong.because
    assert right.due is not None


def test_a_robot_that_is_used_more_is_due_earlier(
    ask: Callable[..., tuple[int, dict[str, Any]]], address: str, tmp_path: Path
) -> None:
    busy, idle, unread = (RobotKey(serial, "irb120") for serial in ("1", "2", "3"))
    with FleetStore.open(address) as store:
        for robot in (busy, idle, unread):
            for day in (0.0, 100.0):
                error_at(store, robot, day, 0.1)
    table = tmp_path / "hours.csv"
    rows = [("1", 0), ("1", 2400), ("2", 500), ("2", 700)]
    ends = [f"{BEGAN - timedelta(days=10):%Y-%m-%d}", f"{BEGAN + timedelta(days=110):%Y-%m-%dT%H:%M}"]
    lines = [f"{serial},{ends[i % 2]},{hours}" for i, (serial, hours) in enumerate(rows)]
    table.write_text("\n".join(["serial,at,hours", *lines]) + "\n", encoding="utf-8")
    found = {
        each["serial"]: each for each in ask("due", "--permitted", "0.3", "--hours", str(table))[1]["robots"]
    }
    assert found["3"]["due"] is None
    assert "hours of use" in found["3"]["because"]
    days = {
        serial: (datetime.fromisoformat(found[serial]["due"]) - BEGAN).total_seconds() / 86400.0 - 100.0
        for serial in ("1", "2")
    }
    # 2,000 hours at 20 hours a day, and at less than two: then two years are the longest
    assert days["1"] == pytest.approx(2200.0 / 20.0, rel=0.01)
    assert days["2"] == 730.0
    table.write_text("serial,at,hours\n1,yesterday,5\n", encoding="utf-8")
    assert ask("due", "--permitted", "0.3", "--hours", str(table))[0] == 2


def test_due_ends_with_3_where_one_is_overdue(
    ask: Callable[..., tuple[int, dict[str, Any]]], write: Callable[..., Path]
) -> None:
    ask("add", str(write("v.json", watch_of(0.1), "2020-01-01 08:00 UTC")))
    code, document = ask("due", "--permitted", "0.3")
    assert code == 3
    assert document["robots"][0]["overdue"] is True
    assert document["robots"][0]["due"] == "2020-06-29T08:00:00Z"  # 180 days
    for method in ("staircase", "drift"):
        code, _ = ask(
            "due",
            "--permitted",
            "0.3",
            "--method",
            method,
            "--first",
            "36500",
            "--longest",
            "36500",
        )
        assert code == 0


def test_one_serial_number_of_two_types(
    ask: Callable[..., tuple[int, dict[str, Any]]], address: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with FleetStore.open(address) as store:
        store.add_all([model({"d1": 1.0}), model({"d1": 2.0}, robot=RobotKey(SERIAL, "irb1600"))])
    assert ask("show", SERIAL)[0] == 2
    assert "--model" in capsys.readouterr().err
    assert ask("show", SERIAL, "--model", "irb1600")[1]["model"] == "irb1600"


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("show", "nobody"), "has nothing of a robot 'nobody'"),
        (("trend", SERIAL, "nothing"), "There are d1"),
        (("trend", SERIAL, "--picture", "p.svg"), "picture of one parameter"),
        (("trend", SERIAL, "d1", "--picture", "p.gif"), ".svg or .png"),
        (("add", "missing.json"), "there is no such file"),
        (("add", "."), "is not the record"),
        (("due", "--permitted", "0.3", "--first", "5"), "shortest"),
    ],
)
def test_what_cannot_be_done_is_said(
    ask: Callable[..., tuple[int, dict[str, Any]]],
    address: str,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    arguments: tuple[str, ...],
    said: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    with FleetStore.open(address) as store:
        store.add(model({"d1": 1.0}))
    capsys.readouterr()
    assert ask(*arguments)[0] == 2
    told = capsys.readouterr().err
    assert said in told
    assert "Traceback" not in told


def test_a_file_that_is_none_of_ours_keeps_nothing_of_the_others(
    ask: Callable[..., tuple[int, dict[str, Any]]], write: Callable[..., Path], tmp_path: Path
) -> None:
    (tmp_path / "notes.json").write_text("{}", encoding="utf-8")
    assert ask("add", str(write("m.json", model_of(1.0))), str(tmp_path / "notes.json"))[0] == 2
    assert ask("robots")[0] == 2  # there is still no store, and asking makes none


def test_the_store_of_a_cell_lies_beside_what_it_serves(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    write: Callable[..., Path],
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("TRUEPOSE_STORE", raising=False)
    assert main(["history", "robots"]) == 2
    assert "no history here yet" in capsys.readouterr().err
    assert not (tmp_path / "truepose-record").exists()
    assert main(["history", "add", str(write("m.json", model_of(1.0)))]) == 0
    kept = tmp_path / "truepose-record" / "history.sqlite3"
    assert kept.is_file()
    assert kept.stat().st_mode & 0o077 == 0
    assert main(["history", "robots"]) == 0


def test_a_server_that_is_away_ends_a_command_with_4(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    address = f"postgresql://anna:secret@/plant?host={tmp_path}"
    for command in (["history", "robots", "--store", address], ["fleet", "migrate", address]):
        assert main(command) == 4
        told = capsys.readouterr().err
        assert "does not answer" in told
        assert "secret" not in told
        assert "Traceback" not in told


def test_migrate_makes_the_tables_once(address: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["fleet", "migrate", address]) == 0
    assert "before: none" in capsys.readouterr().out
    assert main(["fleet", "migrate", address]) == 0
    assert "this version already" in capsys.readouterr().out
    assert main(["fleet", "migrate", address, "--roles"]) == 2


def test_who_needs_care_comes_first_and_who_is_retired_comes_last(
    address: str, ask: Callable[..., tuple[int, dict[str, Any]]]
) -> None:
    today = (utc_now() - BEGAN) / timedelta(days=1)
    said = {"a": (0.1, "changed"), "b": (0.2, "changed"), "c": (0.5, "unchanged"), "e": (0.1, "unchanged")}
    with FleetStore.open(address) as store:
        store.add(of("watch", watch_of(0.1), robot=RobotKey("d", "irb120"), day=-3000.0))  # long overdue
        for name, (error, verdict) in said.items():
            store.add(of("watch", watch_of(error, verdict), robot=RobotKey(name, "irb120"), day=today - 1.0))
        store.add(of("watch", watch_of(0.9, "changed"), robot=RobotKey("f", "irb120"), day=-20_000.0))
    asked = DueDateRequest(permitted_mm=0.3)
    assert ask("retire", "f", "--because", "its controller was exchanged")[0] == 0
    told = told_robots(address, asked)
    assert [each["serial"] for each in told["robots"]] == ["b", "a", "c", "d", "e", "f"]
    assert [each["needs_care"] for each in told["robots"]] == [True] * 4 + [False] * 2
    assert told["need_care"] == 4
    assert told["robots"][-1]["state"] == "retired"
    assert told["robots"][-1]["doubtful_date"].startswith("1971")  # a clock without a battery
    assert "f" not in [each["serial"] for each in ask("due", "--permitted", "0.3")[1]["robots"]]
    with FleetStore.open(address) as store:  # it is measured again
        store.add(of("watch", watch_of(0.1), robot=RobotKey("f", "irb120"), day=today + 0.001))
    assert told_robots(address, asked)["robots"][-1]["state"] == "unchanged"
    with FleetStore.open(address) as store:  # of a clock that was ahead, whose day is still to come
        store.add(of("watch", watch_of(0.1), robot=RobotKey("a", "irb120"), day=today + 9000.0))
    assert ask("retire", "a", "--because", "scrapped")[0] == 0
    assert told_robots(address, asked)["robots"][-1]["state"] == "retired"
