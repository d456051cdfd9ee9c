"""`truepose calibrate` with a ballbar: the example's cell, over the sockets of simulated devices.

These would catch: a calibration that does not survive a kill, cups that were touched and forgotten, and errors of
lengths that are shown as errors of positions.
"""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from acquisition import read_status
from acquisition.record import FILE, RecordStore
from drivers.errors import AcquisitionError
from tests.drivers.waiting import PATIENCE_S, until
from tests.end_to_end.simulated import ROOT, truepose
from tests.service.test_http_support import served

SOURCE = ROOT / "examples" / "lrmate_ballbar" / "cell.toml"
POSES = "4"


@pytest.fixture(scope="module")
def cell(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("cell") / "cell.toml"
    text = SOURCE.read_text("utf-8")
    assert "time_scale = 200.0" in text
    file.write_text(text.replace("time_scale = 200.0", "time_scale = 1000.0"), "utf-8")
    return file


def test_the_plan_alone_says_hands_and_minutes(cell: Path, tmp_path: Path) -> None:
    asked = ("calibrate", str(cell), "--plan-only", "--record", str(tmp_path / "out"))
    shown = truepose(*asked, "--accuracy", "0.06", "--json", str(tmp_path / "outlook.json"))
    assert shown.returncode == 0, shown.stderr
    outlook = json.loads((tmp_path / "outlook.json").read_text("utf-8"))
    assert outlook["targets"] == 6
    assert outlook["mountings"] > 6 * outlook["poses"]
    assert str(outlook["mountings"]) in shown.stdout
    refused = truepose(*asked, "--accuracy", "0.01")
    assert refused.returncode != 0
    assert "cannot be reached" in refused.stderr
    assert not (tmp_path / "out").exists()


def _done(record: Path) -> int:
    try:
        return read_status(record).done if (record / FILE).is_file() else 0
    except AcquisitionError:  # it is just being made
        return 0


def test_it_goes_on_after_the_program_was_killed(cell: Path, tmp_path: Path) -> None:
    folder = tmp_path / "out"
    command = ["calibrate", str(cell), "--simulate", "--accuracy", "0.06", "--poses", POSES]
    command += ["--record", str(folder)]
    for record, readings in (("campaign1", 30), ("campaign2", 4)):
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
    result = json.loads((tmp_path / "result.json").read_text("utf-8"))
    assert result["accuracy"]["reached"]
    verified = result["verification"]
    assert verified["of_lengths"]
    assert verified["poses"] == int(POSES)
    assert verified["error_verified_mm"]["n"] == 3 * int(POSES)
    assert verified["error_verified_mm"]["rms"] < 0.03
    assert verified["error_uncorrected_mm"] is None
    assert verified["nests_off_mm"] is None
    for text in (last.stdout, (folder / "report.html").read_text("utf-8")):
        assert "not of positions" in " ".join(text.split())
    assert "lengths along the ballbar" in (folder / "certificate.xml").read_text("utf-8")
    with RecordStore.reading(folder / "campaign1") as store:
        (taught,) = store.data_of_events("taught")
        assert {each.status for each in store.plan()} <= {"measured", "skipped"}
    assert taught["poses"] == 10  # the first stances are planned again from where the cups are
    for name in ("model.json", "targets.csv", "data.csv"):
        assert (folder / name).stat().st_size


def test_over_http_it_rests_until_a_person_lets_corrected_targets_be_driven(
    cell: Path, tmp_path: Path
) -> None:
    with served(tmp_path / "record", "--cell", str(cell), "--simulate") as service:
        client = service.client
        asked = {"accuracy_mm": 0.1, "poses": int(POSES)}
        dry = client.post("/loops", json=asked)
        assert dry.status_code == 202, dry.text
        assert dry.json()["outlook"]["mountings"] > 90
        wrong = client.post("/loops", json={"accuracy_mm": 0.001})
        assert wrong.status_code in (400, 409, 422), wrong.text
        assert "cannot be reached" in wrong.text
        lease = {"Lease-Id": service.lease("anna")["lease_id"]}
        begun = client.post("/loops", json=asked | {"dry_run": False}, headers=lease)
        assert begun.status_code == 202, begun.text
        path = f"/loops/{begun.json()['id']}"
        paused = service.until(path, "paused", "failed", "succeeded")
        assert paused["state"] == "paused", paused
        assert "corrected targets" in paused["reason"]
        assert client.post(f"{path}/resume", headers=lease).status_code == 202
        done = service.until(path, "succeeded", "failed", "stopped")
    assert done["state"] == "succeeded", done
    assert done["result"]["accuracy"]["reached"]
    assert done["result"]["verification"]["of_lengths"]
