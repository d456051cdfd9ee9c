"""`truepose mock ur`, and a small campaign of the simulated UR5 through the command line."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from calib.data.read import read_dataset
from drivers import UrArm
from service.cli import main
from tests.drivers.waiting import PATIENCE_S
from tests.end_to_end.simulated import ROOT

EXAMPLE = ROOT / "examples" / "ur5_leica" / "cell.toml"
CAMPAIGN = """
format = "truepose-campaign/1"
settle_s = 1.0
samples = 5
[[block]]
set = "calibration"
count = 6
select = "random"
"""


def test_mock_ur_prints_a_line_per_endpoint() -> None:
    command = [sys.executable, "-m", "service.cli", "mock", "ur"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=ROOT) as process:
        assert process.stdout is not None
        ends = [json.loads(process.stdout.readline()) for _ in range(5)]
        arm = UrArm(f"tcp://127.0.0.1:{ends[0]['port']}")
        arm.connect()
        identity = arm.identify()
        arm.disconnect()
        process.send_signal(signal.SIGTERM)
        process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 0
    assert identity.model == "UR5"
    assert [(end["device"], end["protocol"], end["port"] - ends[0]["port"]) for end in ends[:4]] == [
        ("ur", "rtde", 0),
        ("ur-realtime", "realtime", -1),
        ("ur-secondary", "secondary", -2),
        ("ur-dashboard", "dashboard", -5),
    ]


def test_campaign_of_a_ur5(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The cell of the example with a FARO in place of its tracker."""
    text = EXAMPLE.read_text("utf-8")
    for old, new in (
        ('driver = "leica"', 'driver = "faro"'),
        ("time_scale = 200.0", "time_scale = 500.0"),
        ("effects = []", 'effects = ["none"]'),
    ):
        assert old in text
        text = text.replace(old, new)
    (tmp_path / "cell.toml").write_text(text, "utf-8")
    (tmp_path / "campaign.toml").write_text(CAMPAIGN, "utf-8")
    record, out = str(tmp_path / "record"), tmp_path / "out.csv"
    files = [str(tmp_path / "cell.toml"), str(tmp_path / "campaign.toml"), "--record", record]
    assert main(["campaign", "run", *files, "--simulate"]) == 0
    assert "succeeded, 6 of 6 readings, SIMULATED" in capsys.readouterr().out
    assert main(["campaign", "export", record, str(out)]) == 0
    dataset = read_dataset(out)
    assert len(dataset) == 6
    away = np.degrees(dataset.conditions.joints - dataset.conditions.previous)
    length = np.abs(away)
    assert length == pytest.approx(np.tile(length[:, :1], 6), abs=1e-6)  # every joint comes from as far
    assert np.all((length > 5.0 - 1e-6) & (length < 15.0 + 1e-6))
    assert np.ptp(length) > 1.0
    read = np.loadtxt(out, delimiter=",", skiprows=1, usecols=_columns(out, "j{}_read_deg"))
    commanded = np.loadtxt(out, delimiter=",", skiprows=1, usecols=_columns(out, "j{}_deg"))
    assert np.max(np.abs(read - commanded)) < 1e-3
    assert np.any(read != commanded)


def _columns(file: Path, name: str) -> list[int]:
    header = file.read_text("utf-8").splitlines()[0].split(",")
    return [header.index(name.format(i)) for i in range(1, 7)]
