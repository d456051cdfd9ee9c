"""`truepose demo` in a separate process, over sockets, to its end or to Ctrl-C."""

from __future__ import annotations

import csv
import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from acquisition import read_status
from service.cli import main
from tests.drivers.waiting import PATIENCE_S

FILES = "report.html diagnosis.json predictions.csv data.csv data.toml model.json targets.csv cell.toml campaign.toml"


def start(*arguments: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", "service.cli", "demo", "--time-scale", "400", *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )


def test_the_whole_loop(tmp_path: Path) -> None:
    out = tmp_path / "out"
    with start(
        "--seed", "2", "--effect", "backlash:j5", "--out", str(out), "--json", str(tmp_path / "d.json")
    ) as demo:
        shown, progress = demo.communicate(timeout=PATIENCE_S)
    assert demo.returncode == 0, progress
    document = json.loads((tmp_path / "d.json").read_text("utf-8"))
    assert document["hidden"] == ["backlash:j5"]
    assert [e["label"] for e in document["effects"]] == ["backlash:j5"]
    verified = document["verification"]
    assert verified["error_verified_mm"]["rms"] < 0.1 * verified["error_uncorrected_mm"]["rms"]
    assert verified["ratio"] < 1.4
    assert (verified["poses"], verified["error_verified_mm"]["n"]) == (20, 60)
    for words in ("Joint 5 has play", "verified on the robot", "Now revealed", "found.", "report.html"):
        assert words in shown
    assert all((out / name).is_file() for name in FILES.split())
    report = (out / "report.html").read_text("utf-8")
    assert "Verified on the robot" in report
    assert "SIMULATED" in report
    for device, words in (("abb", ">"), ("faro", "MEASURE")):
        lines = [json.loads(line) for line in (out / f"wire_{device}.log").read_text("utf-8").splitlines()]
        assert len(lines) > 200
        assert all(line["device"].startswith(device) for line in lines)
        assert any(words in line["data"] or words == line["dir"] for line in lines)
    with (out / "targets.csv").open(encoding="utf-8") as lines:
        assert len(list(csv.DictReader(lines))) == 20


def test_an_ambiguous_start_is_followed_up(tmp_path: Path) -> None:
    out = tmp_path / "out"
    words = ("--narrow", "--effect", "periodic:j5:n2", "--seed", "1", "--out", str(out))
    with start(*words) as demo:
        shown, progress = demo.communicate(timeout=PATIENCE_S)
    assert demo.returncode == 0, progress
    document = json.loads((out / "diagnosis.json").read_text("utf-8"))
    assert document["verdict"] == "attributed"
    assert [e["label"] for e in document["effects"]] == ["periodic:j5:n2"]
    step = document["followed_up"]
    assert (step["verdict_before"], step["poses"], step["readings"]) == ("ambiguous", 12, 12)
    assert "periodic:j5:n2" in step["effects_before"][0]["candidates"]
    assert document["error_after_mm"]["rms"] < 0.6 * step["error_before_follow_up_mm"]["rms"]
    assert document["verification"]["ratio"] < 1.4
    for words_shown in ("The first readings could not decide", "name periodic:j5:n2", "found."):
        assert words_shown in shown
    assert "how it was settled" in (out / "report.html").read_text("utf-8")
    assert all((out / name).is_file() for name in ("data1.csv", "data_follow_up.csv", "data.csv"))


def test_a_narrow_start_needs_the_devices(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["demo", "--narrow", "--in-memory", "--out", str(tmp_path / "out")]) == 2
    assert "--narrow: needs the devices" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_interrupted_it_ends_cleanly_and_can_be_started_again(tmp_path: Path) -> None:
    out = tmp_path / "out"
    with start("--out", str(out)) as demo:
        assert demo.stderr is not None
        line = ""
        while "readings" not in line:
            line = demo.stderr.readline()
            assert line, "it ended before its first reading"
        os.kill(demo.pid, signal.SIGINT)
        _, rest = demo.communicate(timeout=PATIENCE_S)
    assert demo.returncode == 130
    assert "Traceback" not in rest
    assert read_status(out / "campaign1").state == "paused"


def test_a_record_of_a_real_robot_is_not_thrown_away(tmp_path: Path) -> None:
    (tmp_path / "out" / "campaign1").mkdir(parents=True)
    with start("--out", str(tmp_path / "out")) as demo:
        _, errors = demo.communicate(timeout=PATIENCE_S)
    assert demo.returncode == 2, errors
    assert (tmp_path / "out" / "campaign1").is_dir()


def test_in_memory_needs_no_devices(tmp_path: Path) -> None:
    out = tmp_path / "out"
    with start("--in-memory", "--seed", "3", "--out", str(out)) as demo:
        shown, errors = demo.communicate(timeout=PATIENCE_S)
    assert demo.returncode == 0, errors
    for words in ("Now revealed", "periodic:j1:n101", "report.html"):
        assert words in shown
    for name in ("report.html", "diagnosis.json", "predictions.csv", "data.csv", "truth.json"):
        assert (out / name).is_file()
    assert "SIMULATED" in (out / "report.html").read_text("utf-8")
    assert not (out / "wire_abb.log").exists()
