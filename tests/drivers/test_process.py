"""The cell as a separate process: a JSON line per endpoint, end, exit codes, back door."""

from __future__ import annotations

import json
import signal
import socket
import subprocess
import sys
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from drivers import AbbArm, FanucArm, FaroTracker, ProtocolError, Qc20w, UrArm, YaskawaArm
from mocks.__main__ import DEVICES, ROBOTS
from mocks.cell import CellThread
from mocks.cell_file import CellFile
from mocks.dialects import DIALECTS, speak
from mocks.yaskawa.controller import MAX_DEG_S, PULSES_PER_DEG
from tests.drivers.waiting import PATIENCE_S

CELL = """
format = "truepose-cell/1"
[robot]
model = "abb-irb120"
[instrument]
station_mm = [2400.0, -900.0, 350.0]
[world]
nests = { N1 = [0,0,0], N2 = [600,0,0], N3 = [0,600,0] }
[tool]
targets = { T1 = [0,0,125], T2 = [75,93.675,215], T3 = [150,0,125] }
mass_kg = 2.7
cog_mm = [50,25,100]
[simulation]
seed = 3
time_scale = 10000.0
effects = ["backlash:j4"]
"""


def run(*arguments: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-W", "error", "-m", "mocks", *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def test_cell_process(tmp_path: Path) -> None:
    file = tmp_path / "cell.toml"
    file.write_text(CELL, encoding="utf-8")
    with run("cell", str(file)) as process:
        assert process.stdout is not None
        ends = {(end := json.loads(process.stdout.readline()))["device"]: end for _ in range(4)}
        assert {name: end["protocol"] for name, end in ends.items()} == {
            "abb": "calsrv",
            "abb-background": "calsrv",
            "faro": "mbp1",
            "backdoor": "jsonl",
        }
        assert ends["abb-background"]["port"] == ends["abb"]["port"] + 1
        arm = AbbArm(f"tcp://127.0.0.1:{ends['abb']['port']}")
        tracker = FaroTracker(f"tcp://127.0.0.1:{ends['faro']['port']}")
        arm.connect()
        tracker.connect()
        arm.arm()
        tracker.arm()
        arm.move_to((10, 20, 30, 40, 50, 60))
        reading = tracker.measure("T1")
        with socket.create_connection(("127.0.0.1", ends["backdoor"]["port"]), timeout=PATIENCE_S) as door:
            lines = door.makefile("rw")
            answers = []
            for order in (
                {"do": "truth"},
                {"do": "state"},
                {"do": "nonsense"},
                {"do": "seat", "target": "T9"},
            ):
                lines.write(json.dumps(order) + "\n")
                lines.flush()
                answers.append(json.loads(lines.readline()))
            lines.close()
        assert [effect["label"] for effect in answers[0]["effects"]] == ["backlash:j4"]
        assert reading.xyz_mm == pytest.approx(answers[1]["targets_tracker_mm"]["T1"], abs=0.3)
        assert not answers[2]["ok"]
        assert not answers[3]["ok"]
        process.send_signal(signal.SIGTERM)
        out, err = process.communicate(timeout=PATIENCE_S)
        arm.disconnect()
        tracker.disconnect()
    assert (process.returncode, out, err) == (0, "", "")


@pytest.mark.parametrize(("name", "count"), [("abb", 3), ("faro", 2)])
def test_single_device(name: str, count: int) -> None:
    with run(name) as process:
        assert process.stdout is not None
        ends = [json.loads(process.stdout.readline()) for _ in range(count)]
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=PATIENCE_S)
    assert ends[0]["device"] == name
    assert process.returncode == 0


@pytest.mark.parametrize(
    "text", ["", "format = 'other/1'", "format = ", CELL.replace("backlash:j4", "nonsense:j9")]
)
def test_wrong_cell_file(tmp_path: Path, text: str) -> None:
    file = tmp_path / "cell.toml"
    file.write_text(text, encoding="utf-8")
    with run("cell", str(file)) as process:
        _, err = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 2
    assert err.startswith("truepose mock: ")


def test_stock_and_seed_and_taken_port() -> None:
    with run("abb", "--dialect", "open_abb", "--seed", "5", "--time-scale", "50") as process:
        assert process.stdout is not None
        end = json.loads(process.stdout.readline())
        assert end["protocol"] == "open_abb"
        with run("abb", "--port", str(end["port"])) as other:
            _, err = other.communicate(timeout=PATIENCE_S)
        assert other.returncode == 1
        assert "truepose mock:" in err
        process.send_signal(signal.SIGTERM)
        process.communicate(timeout=PATIENCE_S)


def test_a_simulator_of_datagrams_prints_its_address() -> None:
    with run("yaskawa") as process:
        assert process.stdout is not None
        end = json.loads(process.stdout.readline())
        assert end["url"] == f"udp://127.0.0.1:{end['port']}"
        arm = YaskawaArm(end["url"], pulses_per_deg=PULSES_PER_DEG, max_deg_s=MAX_DEG_S)
        arm.connect()
        assert arm.identify().model == "GP7"
        arm.disconnect()
        process.send_signal(signal.SIGTERM)
        process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 0


@pytest.mark.parametrize(("dialect", "protocol"), [("omnicore", "rws2"), ("irc5-rws1", "rws1")])
def test_an_abb_with_its_web_services(dialect: str, protocol: str) -> None:
    with run("abb", "--dialect", dialect) as process:
        assert process.stdout is not None
        ends = {(end := json.loads(process.stdout.readline()))["device"]: end for _ in range(4)}
        assert ends["abb-rws"]["protocol"] == protocol
        assert ends["abb"]["query"] == ends["abb-rws"]["query"]
        arm = AbbArm(f"tcp://127.0.0.1:{ends['abb']['port']}?{ends['abb']['query']}")
        if protocol == "rws1":
            with pytest.raises(ProtocolError, match="RobotWare 6"):
                arm.connect()
        else:
            arm.connect()
        arm.disconnect()
        process.send_signal(signal.SIGTERM)
        assert process.communicate(timeout=PATIENCE_S)[1] == ""


def test_every_simulator_has_dialects() -> None:
    assert set(DIALECTS) == set(DEVICES)


@pytest.mark.parametrize(
    ("driver", "device", "dialect", "weak", "firmware"),
    [
        (AbbArm, "abb", "calsrv", False, ""),
        (AbbArm, "abb", "open_abb", True, ""),
        (FanucArm, "fanuc", "mappdk-cal", False, ""),
        (FanucArm, "fanuc", "mappdk", True, ""),
        (UrArm, "ur", "polyscope-3.8", True, "3.8"),
        (UrArm, "ur", "polyscope-3.15", False, "3.15"),
        (UrArm, "ur", "polyscope-5.11", False, "5.11"),
        (FaroTracker, "faro", "mbp1", False, ""),
        (FaroTracker, "faro", "mbp1-plain", True, ""),
        (partial(Qc20w, nominal_mm=300.0), "qc20w", "mbp1-plain", True, ""),
    ],
)
def test_the_driver_meets_the_dialect(
    driver: Any, device: str, dialect: str, weak: bool, firmware: str
) -> None:
    file = CellFile(robot=ROBOTS.get(device, "abb-irb120"), time_scale=10_000.0, effects=("none",))
    with CellThread(file, devices=(device,)) as cell:
        assert cell.cell is not None
        speak(cell.cell, dialect)
        met = driver(cell.url(device))
        met.connect()
        assert bool(met.weakness) == weak
        assert met.identify().firmware.startswith(firmware)
        met.disconnect()
