"""`truepose campaign` as a person uses it.

Refusals before anything moves, prompts that no pipe can answer, progress on a terminal, the event log, and an
instrument that is moved.
"""

from __future__ import annotations

import ctypes
import json
import os
import pty
import re
import shutil
import signal
import sqlite3
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from acquisition.record import FILE, RecordStore
from service.cli import main
from service.printed.terminal import duration
from tests.acquisition.stage import Stage
from tests.drivers.waiting import PATIENCE_S
from tests.service.campaigns import edit_text
from tests.service.test_campaign_commands import files, started
from tests.service.test_http_support import ROOT

Output = pytest.CaptureFixture[str]


def events_of(record: Path) -> int:
    """Return the number of events in a record."""
    store = RecordStore.open(record, writer=False)
    try:
        return store.version
    finally:
        store.close()


@pytest.fixture(scope="module")
def measured(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with cell.toml, campaign.toml and the record of it, measured."""
    folder = tmp_path_factory.mktemp("measured")
    assert main(["campaign", "run", *files(folder), "--simulate"]) == 0
    return folder


@pytest.fixture
def again(measured: Path, tmp_path: Path) -> tuple[Path, list[str]]:
    """Return a copy of the measured record, and the words that would run its campaign again."""
    shutil.copytree(measured, tmp_path, dirs_exist_ok=True)
    record = tmp_path / "record"
    words = ["run", str(tmp_path / "cell.toml"), str(tmp_path / "campaign.toml"), "--record", str(record)]
    return record, [*words, "--simulate"]


def refused(words: list[str], code: int, message: str, capsys: Output) -> None:
    capsys.readouterr()
    assert main(["campaign", *words]) == code
    shown = capsys.readouterr()
    assert message in shown.err
    assert shown.err.count("truepose:") == 1  # one sentence, no simulator started before it


@pytest.mark.parametrize(
    ("file", "old", "new", "message"),
    [
        ("campaign.toml", "count = 3", "count = 4", "was begun with another campaign than the file says now"),
        ("cell.toml", "table_z_mm = 20.0", "table_z_mm = 30.0", "was begun with another cell than"),
    ],
)
def test_what_was_edited_after_it_began_needs_a_new_folder(
    again: tuple[Path, list[str]], file: str, old: str, new: str, message: str, capsys: Output
) -> None:
    record, words = again
    edit_text(record.parent / file, old, new)
    before = events_of(record)
    refused(words, 2, message, capsys)
    assert events_of(record) == before


@pytest.mark.parametrize(
    ("old", "new", "code", "message"),
    [
        (
            'select = "random"',
            'select = "random"\ntargets = ["T9"]',
            2,
            "campaign.toml: block 1 measures target 'T9', the cell has T1",
        ),
        (
            'count = 3\nselect = "random"',
            'select = "list"\njoints_deg = [[0, 2, 0, 0, 30, 0]]',
            5,
            "campaign.toml: the approach point of pose 1 of block 1 (calibration): joint 2 at -3 deg",
        ),
        ("samples = 5", "sample = 5", 2, "campaign.toml, key 'sample'"),
        ("samples = 5", "samples = many", 2, "campaign.toml"),
    ],
)
def test_a_campaign_that_cannot_be_is_refused_and_leaves_nothing(
    tmp_path: Path, old: str, new: str, code: int, message: str, capsys: Output
) -> None:
    words = files(tmp_path)
    edit_text(tmp_path / "campaign.toml", old, new)
    refused(["run", *words, "--simulate"], code, message, capsys)
    assert not (tmp_path / "record").exists()


def test_a_file_is_no_folder(tmp_path: Path, capsys: Output) -> None:
    words = files(tmp_path)
    (tmp_path / "record").write_text("mine", "utf-8")
    refused(["run", *words, "--simulate"], 2, "is a file. Name a new folder.", capsys)
    assert (tmp_path / "record").read_text("utf-8") == "mine"


@pytest.mark.parametrize("verb", ["resume", "status", "export", "events", "restation"])
def test_a_record_of_a_newer_version_is_left_alone(
    again: tuple[Path, list[str]], verb: str, capsys: Output
) -> None:
    record, _ = again
    with sqlite3.connect(record / FILE) as connection:
        connection.execute("PRAGMA user_version = 99")
    connection.close()
    before = (record / FILE).read_bytes()
    more = {"resume": ["--simulate"], "export": [str(record.parent / "out.csv")]}.get(verb, [])
    refused([verb, str(record), *more], 2, "newer version", capsys)
    assert (record / FILE).read_bytes() == before


@contextmanager
def bound_by_permissions() -> Iterator[None]:
    """Take CAP_DAC_OVERRIDE from root, who could otherwise write everywhere.

    Nothing changes for other users.
    """
    libc = ctypes.CDLL(None, use_errno=True)
    header = (ctypes.c_uint32 * 2)(0x20080522, 0)  # _LINUX_CAPABILITY_VERSION_3, this thread
    before = (ctypes.c_uint32 * 6)()  # twice: effective, permitted, inheritable
    assert libc.capget(header, before) == 0, os.strerror(ctypes.get_errno())
    bound = (ctypes.c_uint32 * 6)(before[0] & ~(1 << 1), *before[1:])
    assert libc.capset(header, bound) == 0, os.strerror(ctypes.get_errno())
    try:
        yield
    finally:
        assert libc.capset(header, before) == 0, os.strerror(ctypes.get_errno())


@pytest.fixture(scope="module")
def paused(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the record of a campaign that needed an operator when no operator was present."""
    folder = tmp_path_factory.mktemp("paused")
    assert main(["campaign", "run", *files(folder, one_smr=True), "--simulate"]) == 4
    return folder / "record"


@pytest.mark.parametrize("verb", ["run", "resume", "restation"])
def test_a_disk_that_cannot_be_written_is_told_before_anything_moves(
    tmp_path: Path, request: pytest.FixtureRequest, verb: str, capsys: Output
) -> None:
    closed = tmp_path / "closed"
    closed.mkdir()
    record = closed / "record"
    if verb == "run":
        words = [verb, *files(tmp_path)[:2], "--record", str(record), "--simulate"]
    else:
        shutil.copytree(request.getfixturevalue("paused"), record)
        words = [verb, str(record), *(["--simulate"] if verb == "resume" else [])]
    places = [closed, *closed.rglob("*")]
    modes = [place.stat().st_mode for place in places]
    capsys.readouterr()
    try:
        for place, mode in zip(places, modes, strict=True):
            place.chmod(mode & 0o555)
        with bound_by_permissions():
            code = main(["campaign", *words])
    finally:
        for place, mode in zip(places, modes, strict=True):
            place.chmod(mode)
    complaint = capsys.readouterr().err
    assert code == 1, complaint
    assert re.search(
        r"cannot be written \(Permission denied\)|attempt to write a readonly database", complaint
    )
    assert "correct its permissions" in complaint
    assert "simulators" not in complaint


def closed_pipe() -> int:
    reading, writing = os.pipe()
    os.close(writing)
    return reading


def full_pipe() -> int:
    reading, writing = os.pipe()
    os.write(writing, b"confirm\n" * 20)
    os.close(writing)
    return reading


@pytest.mark.parametrize("stdin", [closed_pipe, full_pipe])
def test_a_pipe_never_answers_a_prompt(
    tmp_path: Path, stdin: Callable[[], int], monkeypatch: pytest.MonkeyPatch, capsys: Output
) -> None:
    arguments = files(tmp_path, one_smr=True)
    with os.fdopen(stdin()) as pipe:
        monkeypatch.setattr(sys, "stdin", pipe)
        code = main(["campaign", "run", *arguments, "--simulate", "--json", "-"])
    shown = capsys.readouterr()
    assert code == 4, shown.err
    assert "needs an operator: Seat the SMR in N1 and press confirm." in shown.err
    document = json.loads(shown.out)
    assert (document["state"], document["done"], document["exit_code"]) == ("paused", 0, 4)


def test_on_a_terminal_one_line_tells_how_far_and_how_long_still(tmp_path: Path) -> None:
    master, slave = pty.openpty()
    words = [
        sys.executable,
        "-m",
        "service.cli",
        "campaign",
        "run",
        *files(tmp_path, time_scale=50.0),
        "--simulate",
    ]
    env = os.environ | {"TERM": "xterm", "COLUMNS": "100"}
    with subprocess.Popen(
        words, stdin=slave, stdout=subprocess.DEVNULL, stderr=slave, env=env, cwd=ROOT
    ) as process:
        os.close(slave)
        shown = b""
        try:
            while piece := os.read(master, 4096):
                shown += piece
        except OSError:  # the other end was closed
            pass
        assert process.wait(PATIENCE_S) == 0
    os.close(master)
    steps = re.sub(r"\x1b\[[0-9;?]*[a-zA-Z]", "", shown.decode("utf-8"))
    assert re.search(r"\d of 9 readings, \d+ s left \(\d+ s\)", steps)
    assert "\n" not in steps[steps.index("of 9 readings") : steps.rindex("of 9 readings")]


@pytest.mark.parametrize(
    ("seconds", "words"),
    [(0.2, "0 s"), (99.4, "99 s"), (100.0, "2 min"), (5999.0, "100 min"), (6000.0, "1.7 h"), (1e5, "27.8 h")],
)
def test_durations(seconds: float, words: str) -> None:
    assert duration(seconds) == words


def test_the_event_log_is_json_lines(measured: Path, tmp_path: Path, capsys: Output) -> None:
    record, out = measured / "record", tmp_path / "events.jsonl"
    capsys.readouterr()
    assert main(["campaign", "events", str(record)]) == 0
    text = capsys.readouterr().out
    rows = [json.loads(line) for line in text.splitlines()]
    assert [event["id"] for event in rows] == list(range(1, len(rows) + 1))
    assert sum(event["kind"] == "reading" for event in rows) == 9 + 3
    assert main(["campaign", "events", str(record), str(out)]) == 0
    assert out.read_text("utf-8") == text
    refused(["events", str(record), str(record / FILE)], 2, "OUT.jsonl", capsys)


def test_a_new_station_is_noted_while_it_is_paused_and_refused_while_it_runs(
    tmp_path: Path, capsys: Output
) -> None:
    """The campaign keeps running until its question is answered."""
    record, (master, slave) = str(tmp_path / "record"), pty.openpty()
    words = ["campaign", "run", *files(tmp_path, one_smr=True), "--simulate"]
    with started(*words, stdin=slave) as process:
        assert process.stderr is not None
        for line in process.stderr:
            if "Seat the SMR in N1" in line:
                break
        refused(["restation", record], 4, "Press Ctrl-C there", capsys)
        refused(["finish", record], 4, "Press Ctrl-C there", capsys)
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=PATIENCE_S)
    os.close(master)
    os.close(slave)
    assert process.returncode == 130
    assert main(["campaign", "move-instrument", record, "--reason", "a forklift", "--json", "-"]) == 0
    assert json.loads(capsys.readouterr().out)["state"] == "paused"
    assert main(["campaign", "events", record]) == 0
    assert '"reason": "a forklift"' in capsys.readouterr().out.splitlines()[-1]
    refused(["restation", str(tmp_path / "nothing")], 2, "there is no record", capsys)


def test_a_paused_campaign_is_finished_and_exported(tmp_path: Path, capsys: Output) -> None:
    stage = Stage(tmp_path / "record")
    stage.bench.faults[11] = stage.run.pause  # while its second target is measured
    stage.execute()
    stage.run.close()
    record = str(stage.folder)
    assert main(["campaign", "finish", record, "--reason", "it is enough", "--json", "-"]) == 0
    shown = json.loads(capsys.readouterr().out)
    assert (shown["state"], shown["finished_early"]["reason"]) == ("succeeded", "it is enough")
    assert (shown["finished_early"]["measured"], shown["finished_early"]["total"]) == (2, 5)
    assert main(["campaign", "resume", record, "--simulate"]) == 1
    assert main(["campaign", "finish", record]) == 0  # it is already


def test_a_campaign_without_readings_or_at_its_end_is_not_finished(
    again: tuple[Path, list[str]], tmp_path: Path, capsys: Output
) -> None:
    refused(["finish", str(again[0])], 1, "nothing is left to finish", capsys)
    stage = Stage(tmp_path / "other")
    stage.run.close()
    refused(["finish", str(stage.folder)], 1, "nothing to fit", capsys)
