"""`truepose campaign`, `mock` and `serve` in a shell: exit codes, streams, Ctrl-C.

Runs without an operator are tested too.
"""

from __future__ import annotations

import gc
import json
import os
import pty
import signal
import sqlite3
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import pytest
from jsonschema import Draft202012Validator

from calib.data.read import read_dataset
from drivers import FanucArm
from service.cli import main
from service.http.access.connections import is_loopback
from service.private import make_secret
from tests.drivers.waiting import PATIENCE_S, until
from tests.service.test_http_support import ROOT

EXAMPLE = ROOT / "examples" / "irb120_faro" / "cell.toml"
CAMPAIGN = """
format = "truepose-campaign/1"
settle_s = {settle_s}
samples = 5
[[block]]
set = "calibration"
count = {count}
select = "random"
"""


def files(
    folder: Path,
    *,
    count: int = 3,
    one_smr: bool = False,
    time_scale: float = 500.0,
    settle_s: float = 0.5,
) -> list[str]:
    """A cell and a campaign, as the arguments of `campaign run`."""
    text = EXAMPLE.read_text("utf-8").replace("time_scale = 200.0", f"time_scale = {time_scale}")
    if one_smr:
        text = text.replace("one_smr = false", "one_smr = true")
    (folder / "cell.toml").write_text(text, "utf-8")
    (folder / "campaign.toml").write_text(CAMPAIGN.format(count=count, settle_s=settle_s), "utf-8")
    return [str(folder / "cell.toml"), str(folder / "campaign.toml"), "--record", str(folder / "record")]


@contextmanager
def started(*arguments: str, stdin: int = subprocess.DEVNULL) -> Iterator[subprocess.Popen[str]]:
    """Run `truepose` in a separate process and kill it when the block ends."""
    with subprocess.Popen(
        [sys.executable, "-m", "service.cli", *arguments],
        stdin=stdin,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=ROOT,
    ) as process:
        try:
            yield process
        finally:
            process.kill()


def test_poses_that_only_judge_are_exported(tmp_path: Path) -> None:
    arguments, out = files(tmp_path), tmp_path / "out.csv"
    plan = tmp_path / "campaign.toml"
    text = plan.read_text("utf-8").replace('"calibration"', '"validation"').replace('select = "random"\n', "")
    plan.write_text(text, "utf-8")
    assert main(["campaign", "run", *arguments, "--simulate"]) == 0
    assert main(["campaign", "export", str(tmp_path / "record"), str(out)]) == 0
    assert int(read_dataset(out).validation_rows.sum()) == 9


def test_run_status_export(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    record, out = tmp_path / "record", tmp_path / "out.csv"
    arguments = files(tmp_path)
    assert main(["campaign", "run", *arguments, "--simulate", "--json", str(tmp_path / "r.json")]) == 0
    shown = capsys.readouterr()
    assert "succeeded, 9 of 9 readings, SIMULATED" in shown.out
    assert "nest N3 measured\n" in shown.err
    assert "9 of 9 readings" in shown.err
    assert "\x1b" not in shown.err
    document = json.loads((tmp_path / "r.json").read_text("utf-8"))
    assert (document["format"], document["state"], document["exit_code"]) == (
        "truepose-run/1",
        "succeeded",
        0,
    )
    assert main(["campaign", "status", str(record), "--json", "-"]) == 0
    assert json.loads(capsys.readouterr().out)["done"] == 9
    assert main(["campaign", "export", str(record), str(out)]) == 0
    assert len(read_dataset(out)) == 9
    capsys.readouterr()
    for words, code, message in (
        (
            ["run", *arguments, "--simulate"],
            2,
            "holds this campaign already. Continue it (truepose campaign resume",
        ),
        (["resume", str(record)], 2, "Add --simulate"),
        (["resume", str(record), "--simulate"], 1, "finished; nothing to resume"),
        (["status", str(tmp_path)], 2, "there is no record"),
        (["export", str(tmp_path), str(out)], 2, "there is no record"),
        (["export", str(record), str(tmp_path / "out")], 2, "Let it end in .csv"),
    ):
        assert main(["campaign", *words]) == code
        complaint = capsys.readouterr().err
        assert message in complaint
        assert "Traceback" not in complaint


def test_an_unsafe_pose_ends_with_5_before_anything_is_made(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = files(tmp_path)
    text = (
        (tmp_path / "campaign.toml").read_text("utf-8").replace("count = 3", "joints_deg = [[0,99,0,0,0,0]]")
    )
    (tmp_path / "campaign.toml").write_text(text.replace('"random"', '"list"'), "utf-8")
    assert main(["campaign", "run", *arguments, "--simulate"]) == 5
    assert "nothing has moved" in capsys.readouterr().err
    assert not (tmp_path / "record").exists()


def test_without_a_terminal_a_prompt_ends_with_4_and_says_what_is_needed(tmp_path: Path) -> None:
    with started("campaign", "run", *files(tmp_path, one_smr=True), "--simulate") as process:
        _, complaint = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 4, complaint
    assert "needs an operator: Seat the SMR in N1 and press confirm." in complaint
    assert "campaign resume" in complaint


def test_a_real_cell_that_does_not_answer_ends_with_4(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = files(tmp_path)
    text = (tmp_path / "cell.toml").read_text("utf-8")
    for url in ("tcp://192.168.125.1:5000", "tcp://127.0.0.1:5701"):
        text = text.replace(url, "tcp://127.0.0.1:1")
    (tmp_path / "cell.toml").write_text(text, "utf-8")
    assert main(["campaign", "run", *arguments]) == 4
    assert "start the program that listens there" in capsys.readouterr().err


@pytest.mark.parametrize(("times", "state"), [(1, "paused"), (2, "stopped")])
def test_ctrl_c_pauses_twice_stops_and_it_can_go_on(tmp_path: Path, times: int, state: str) -> None:
    """The robot settles for two minutes if the second Ctrl-C must come before the pause.

    The time is real time.
    """
    scale, settle_s, count = (1.0, 120.0, 8) if times == 2 else (50.0, 0.5, 40)
    arguments = files(tmp_path, count=count, time_scale=scale, settle_s=settle_s)
    record = tmp_path / "record"
    with started("campaign", "run", *arguments, "--simulate", "--json", "-") as process:
        assert process.stderr is not None
        for line in process.stderr:
            if "nest N3 measured" in line:
                break
        if times == 2:
            until(lambda: in_record(record, "SELECT 1 FROM attempt WHERE kind = 'arrive'"))
        else:
            until(lambda: in_record(record, "SELECT 1 FROM attempt WHERE arrival AND status = 'good'"))
        process.send_signal(signal.SIGINT)
        if times == 2:
            until(lambda: in_record(record, "SELECT verb FROM command") == [("pause",)])
            process.send_signal(signal.SIGINT)
        out, complaint = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 130, complaint
    document = json.loads(out)
    assert document["state"] == state
    assert document["done"] < document["total"]
    assert "campaign resume" in complaint
    assert "Ctrl-C once more stops the robot now." in complaint
    if times == 1:  # at once, and not at its end
        with started("campaign", "resume", str(record), "--simulate") as process:
            assert process.stderr is not None
            next(line for line in process.stderr if "of 120 readings" in line)


def in_record(record: Path, query: str) -> list[tuple[object, ...]]:
    """Query the record of a campaign that another process runs."""
    with closing(sqlite3.connect(f"file:{record / 'record.sqlite3'}?mode=ro", uri=True)) as database:
        return database.execute(query).fetchall()


def test_ctrl_c_at_a_prompt_ends_cleanly(tmp_path: Path) -> None:
    """The thread that still waits for a line must not make the interpreter abort."""
    master, slave = pty.openpty()
    with started("campaign", "run", *files(tmp_path, one_smr=True), "--simulate", stdin=slave) as process:
        assert process.stderr is not None
        for line in process.stderr:
            if "Seat the SMR in N1" in line:
                break
        process.send_signal(signal.SIGINT)
        _, complaint = process.communicate(timeout=PATIENCE_S)
    os.close(master)
    os.close(slave)
    assert process.returncode == 130, complaint
    assert "Fatal" not in complaint


def test_mock_forwards_lines_and_signals(tmp_path: Path) -> None:
    files(tmp_path)
    with started("mock", "cell", str(tmp_path / "cell.toml")) as process:
        assert process.stdout is not None
        ends = [json.loads(process.stdout.readline()) for _ in range(4)]
        assert {end["device"] for end in ends} >= {"abb", "faro"}
        assert all(end["port"] > 0 for end in ends)
        process.send_signal(signal.SIGINT)
        assert process.wait(PATIENCE_S) == 0


def test_mock_speaks_the_dialect_that_is_named() -> None:
    """A stock Fanuc, as fanucpy moves it, needs no cell file.

    A wrong dialect name lists the right ones.
    """
    with started("mock", "fanuc", "--dialect", "mappdk") as process:
        assert process.stdout is not None
        ends = {end["device"]: end for end in (json.loads(process.stdout.readline()) for _ in range(5))}
        assert ends["fanuc-logger"]["protocol"] == "mappdk"
        arm = FanucArm(f"tcp://127.0.0.1:{ends['fanuc']['port']}")
        arm.connect()
        assert arm.weakness  # moves on one request
        arm.disconnect()
        process.send_signal(signal.SIGINT)
        assert process.wait(PATIENCE_S) == 0
    with started("mock", "ur", "--dialect", "mappdk") as process:
        _, complaint = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 2
    assert "polyscope-3.8, polyscope-5.11" in complaint


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("nobody",), "key 'NAME': 'nobody' is not simulated. Name abb, abb-simple, fanuc, fanuc-rmi, ur"),
        (("cell",), "key 'CELL.toml': needs a cell file. Give it: truepose mock cell CELL.toml"),
        (("cell", "nowhere.toml"), "nowhere.toml: there is no such file"),
    ],
)
def test_what_is_not_simulated_is_named(
    arguments: tuple[str, ...], says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["mock", *arguments]) == 2
    assert capsys.readouterr().err.startswith(f"truepose: {says}")


@pytest.mark.parametrize("host", ["0.0.0.0", "::", "192.168.1.5", "cell-pc"])
def test_serving_a_network_without_a_token_is_refused(
    host: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("TRUEPOSE_TOKEN", raising=False)
    assert main(["serve", "--host", host]) == 5
    assert "refused to listen" in capsys.readouterr().err
    assert not is_loopback(host)


@pytest.mark.parametrize("host", ["", " ", "0", "0x0", "127.1", "127.0.0.1/8"])
def test_what_is_no_address_is_not_listened_on(
    host: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The system takes an empty host, or 0, for every address of the computer.

    A token does not help.
    """
    monkeypatch.setenv("TRUEPOSE_TOKEN", "a-token-of-sixteen-or-more")
    assert main(["serve", "--host", host, "--port", "1", "--record", "/dev/null/x"]) == 2
    assert "--host" in capsys.readouterr().err


@pytest.mark.parametrize("token", ["short", "with spaces in the middle of it", "tökentökentökentöken"])
def test_a_token_that_is_none_is_refused(
    token: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    make_secret(tmp_path / "token", token)
    assert main(["serve", "--token-file", str(tmp_path / "token")]) == 2
    assert "not a usable token" in capsys.readouterr().err


@pytest.mark.parametrize("host", ["127.0.0.1", "localhost", "::1", "[::1]", "127.1.2.3"])
def test_loopback(host: str) -> None:
    assert is_loopback(host)


def test_a_service_that_does_not_start_leaves_the_collection_of_garbage_on(tmp_path: Path) -> None:
    assert main(["serve", "--cell", str(tmp_path / "none.toml"), "--record", str(tmp_path / "record")]) == 2
    assert gc.isenabled()


def test_serve_simulated_needs_a_cell(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["serve", "--simulate"]) == 2
    assert "--cell" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("file", "count", "wrong", "needed"),
    [("campaign", 8, {"samples": 0}, "block"), ("cell", 8, {"fixture": [{"name": "a"}]}, "robot")],
)
def test_the_schema_for_editors_takes_every_example_and_marks_mistakes(
    file: str,
    count: int,
    wrong: dict[str, Any],
    needed: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    out = tmp_path / "schema.json"
    assert main([file, "schema", str(out)]) == 0
    schema = json.loads(out.read_text("utf-8"))
    assert main([file, "schema"]) == 0
    assert json.loads(capsys.readouterr().out) == schema
    takes = Draft202012Validator(schema).is_valid
    examples = [
        tomllib.loads(path.read_text("utf-8"))
        for path in sorted((ROOT / "examples").glob("*/*.toml"))
        if f"truepose-{file}/1" in path.read_text("utf-8")
    ]
    assert len(examples) >= count
    for table in examples:
        assert takes(table)
        assert not takes(table | {"surprise": 1})
        assert not takes(table | wrong)
        assert not takes({key: value for key, value in table.items() if key != needed})
    assert main([file, "schema", str(tmp_path / "none" / "x.json")]) == 2
