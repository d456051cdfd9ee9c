"""The simulated Fanuc as a separate process, alone and in a cell: a JSON line per endpoint."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from drivers import FanucArm, FanucDeadlines
from tests.drivers.waiting import PATIENCE_S

CELL = """
format = "truepose-cell/1"
[robot]
model = "fanuc-lrmate200ic"
driver = "fanuc"
[instrument]
driver = "faro"
[simulation]
time_scale = 10000.0
effects = ["none"]
"""


@pytest.mark.parametrize(("whole_cell", "stock"), [(True, True), (False, False)])
def test_endpoints(tmp_path: Path, whole_cell: bool, stock: bool) -> None:
    file = tmp_path / "cell.toml"
    file.write_text(CELL, encoding="utf-8")
    chosen = ["cell", str(file)] if whole_cell else ["fanuc", "--time-scale", "10000"]
    command = [
        sys.executable,
        "-W",
        "error",
        "-m",
        "mocks",
        *chosen,
        *(["--dialect", "mappdk"] if stock else []),
    ]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        ends: dict[str, dict[str, Any]] = {}
        while "backdoor" not in ends:
            end = json.loads(process.stdout.readline())
            ends[end["device"]] = end
        protocols = {name: end["protocol"] for name, end in ends.items()}
        assert protocols == {
            "fanuc": "mappdk",
            "fanuc-logger": "mappdk" if stock else "mappdk-cal",
            "fanuc-modbus-hmi": "modbus-hmi",
            "fanuc-modbus-io": "modbus-io",
            "backdoor": "jsonl",
        } | ({"faro": "mbp1"} if whole_cell else {})
        arm = FanucArm(f"tcp://127.0.0.1:{ends['fanuc']['port']}", deadlines=FanucDeadlines(gap_s=0.001))
        arm.connect()
        arm.arm()
        reached = arm.move_to((10.0, 0.0, 200.0, 0.0, 0.0, 0.0))  # within a Fanuc's count of joint 3 only
        assert reached.joints_deg[2] == 200.0
        arm.disconnect()
        process.send_signal(signal.SIGTERM)
        out, err = process.communicate(timeout=PATIENCE_S)
    assert (process.returncode, out, err) == (0, "", "")
