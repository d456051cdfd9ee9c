"""`truepose calibrate`: from a nominal robot to a verified one, over the sockets of simulated devices.

These would catch: a motion that nobody confirmed, a calibration that cannot go on after a crash, one that writes over
files of others, and an accuracy that cannot be reached and is said to be only after an hour.
"""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from acquisition import read_status
from acquisition.loop import LoopEnded, calibration_campaign, close_loop, rehearsal
from acquisition.record import FILE
from drivers.errors import AcquisitionError
from tests.drivers.waiting import PATIENCE_S, until
from tests.end_to_end.simulated import ROOT, stepped_cell, truepose
from tests.service.test_http_support import served

SCALE = 500.0


@pytest.fixture(scope="module")
def cell(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("cell")
    rehearsal.write_files(folder, 3, "backlash:j4", SCALE, calibration=34, validation=8)
    return folder / "cell.toml"


def test_the_plan_alone_says_poses_minutes_and_accuracy(cell: Path, tmp_path: Path) -> None:
    asked = ("calibrate", str(cell), "--accuracy", "0.06", "--plan-only", "--record", str(tmp_path / "out"))
    shown = truepose(*asked, "--json", "-")
    assert shown.returncode == 0, shown.stderr
    outlook = json.loads(shown.stdout)
    assert outlook["format"] == "truepose-outlook/1"
    assert 15 <= outlook["poses"] <= 30
    assert outlook["floor_mm"] < outlook["limit_mm"] <= 0.06
    parts = (outlook[f"{part}_minutes"] for part in ("warm_up", "measuring", "verification"))
    assert outlook["minutes"] == pytest.approx(sum(parts))
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--accuracy", "0.02"), "cannot be reached"),
        (("--minutes", "3"), "minutes are too short"),
        (("--zone", "x=5000:6000"), "larger"),
        (("--zone", "x=1"), "--zone"),
        (("--zone", "x=5:1"), "lower limit first"),
        ((), "nobody is at this terminal"),  # a real cell, and standard input is no terminal
    ],
)
def test_what_cannot_begin_is_said_before_anything_is_written(
    cell: Path, tmp_path: Path, options: tuple[str, ...], words: str
) -> None:
    refused = truepose("calibrate", str(cell), *options, "--record", str(tmp_path / "out"))
    assert refused.returncode != 0
    assert words in refused.stderr
    assert "Traceback" not in refused.stderr
    assert not (tmp_path / "out").exists()


def test_it_goes_on_after_the_program_was_killed(cell: Path, tmp_path: Path) -> None:
    folder = tmp_path / "out"
    command = [
        "calibrate",
        str(cell),
        "--simulate",
        "--accuracy",
        "0.06",
        "--poses",
        "4",
        "--record",
        str(folder),
    ]
    for record, readings in (("campaign1", 8), ("campaign2", 6)):
        killed = subprocess.Popen(
            [sys.executable, "-m", "service.cli", *command],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            cwd=ROOT,
        )
        until(lambda place=folder / record, least=readings: _done(place) >= least)
        killed.send_signal(signal.SIGKILL)
        killed.wait(PATIENCE_S)
    before = read_status(folder / "campaign1")
    last = truepose(*command, "--json", str(tmp_path / "result.json"))
    assert last.returncode == 0, last.stderr
    assert read_status(folder / "campaign1").version == before.version  # what was finished is used as it is
    result: dict[str, Any] = json.loads((tmp_path / "result.json").read_text("utf-8"))
    assert result["accuracy"]["reached"]
    verified = result["verification"]
    assert verified["poses"] == 4
    assert verified["error_verified_mm"]["rms"] < 0.1 * verified["error_uncorrected_mm"]["rms"]
    for name in ("model.json", "report.html", "certificate.xml", "targets.csv", "data.csv"):
        assert (folder / name).stat().st_size
    again = truepose(*command)
    assert again.returncode != 0
    assert "finished calibration" in again.stderr
    other = truepose(*command[:-1], str(folder), "--accuracy", "0.07")
    assert other.returncode != 0


def _done(record: Path) -> int:
    try:
        return read_status(record).done if (record / FILE).is_file() else 0
    except AcquisitionError:  # it is just being made
        return 0


def test_a_file_of_another_program_is_not_replaced(cell: Path, tmp_path: Path) -> None:
    (tmp_path / "report.html").write_text("mine")
    refused = truepose("calibrate", str(cell), "--simulate", "--record", str(tmp_path))
    assert refused.returncode != 0
    assert (tmp_path / "report.html").read_text() == "mine"
    assert not (tmp_path / "campaign1").exists()


def _refusing(asked: list[str]) -> Callable[[str], bool]:
    def confirm(motion: str) -> bool:
        asked.append(motion)
        return False

    return confirm


def test_corrected_targets_are_driven_only_with_leave(cell: Path, tmp_path: Path) -> None:
    """A person who says no keeps all that was measured."""
    asked: list[str] = []
    the_cell, _ = rehearsal.write_files(tmp_path, 3, "backlash:j4", 1.0, calibration=34, validation=8)
    campaign, _ = calibration_campaign(the_cell, accuracy_mm=0.1)
    with stepped_cell(the_cell) as equipment, pytest.raises(LoopEnded):
        close_loop(replace(equipment, confirm=_refusing(asked)), campaign, tmp_path, poses=4)
    assert len(asked) == 1
    assert (tmp_path / "data.csv").is_file()
    assert not (tmp_path / "campaign2").exists()


def test_over_http_it_rests_until_a_person_lets_corrected_targets_be_driven(
    cell: Path, tmp_path: Path
) -> None:
    with served(tmp_path / "record", "--cell", str(cell), "--simulate") as service:
        client = service.client
        asked = {"accuracy_mm": 0.1, "poses": 4}
        dry = client.post("/loops", json=asked)
        assert dry.status_code == 202, dry.text
        assert dry.json()["outlook"]["poses"] >= 15
        assert "minutes at the cell" in dry.json()["reason"]
        wrong = client.post("/loops", json={"accuracy_mm": 0.01})
        assert wrong.status_code in (400, 409, 422), wrong.text
        assert "cannot be reached" in wrong.text
        assert client.post("/loops", json={"minutes": 10.0, "campaign_id": "x"}).status_code == 422
        lease = {"Lease-Id": service.lease("anna")["lease_id"]}
        begun = client.post("/loops", json=asked | {"dry_run": False}, headers=lease)
        assert begun.status_code == 202, begun.text
        path = f"/loops/{begun.json()['id']}"
        paused = service.until(path, "paused", "failed", "succeeded")
        assert paused["state"] == "paused", paused
        assert "corrected targets" in paused["reason"]
        assert len(paused["runs"]) == 1
        first = client.get(f"/runs/{paused['runs'][0]}").json()
        assert first["accuracy"]["reached"]
        assert first["accuracy"]["history"]
        assert client.post(f"{path}/resume", headers=lease).status_code == 202
        done = service.until(path, "succeeded", "failed", "stopped")
    assert done["state"] == "succeeded", done
    assert done["result"]["accuracy"]["reached"]
    assert done["result"]["verification"]["ratio"] < 3.0
