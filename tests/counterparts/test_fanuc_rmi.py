"""Test the simulated RMI with two third-party clients that move it."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from mocks.cell import CellThread
from mocks.cell_file import CellFile
from tests.counterparts.environments import FANUC_RMI, FANUC_UCL, Environment
from tests.drivers.waiting import PATIENCE_S

FAST = CellFile(robot="fanuc-lrmate200ic", time_scale=10_000.0, effects=("none",))
ROOT = Path(__file__).parents[2]
PORT = 16001  # fanuc-ucl connects to no other


def said_by(environment: Environment, peer: str, *arguments: object) -> list[Any]:
    command = [str(environment.python), str(Path(__file__).parent / peer), *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=PATIENCE_S)
    assert done.returncode == 0, done.stderr
    return [json.loads(line) for line in done.stdout.splitlines()]


@FANUC_RMI.needed()
def test_fanuc_rmi_moves_the_simulator() -> None:
    with CellThread(FAST, devices=("fanuc-rmi",)) as cell:
        ports = cell.port("fanuc-rmi"), cell.port("fanuc-rmi-session")
        answers = said_by(FANUC_RMI, "fanuc_rmi_peer.py", *ports)
        assert cell.cell is not None
        assert not cell.cell.fanuc.rmi.running
        assert cell.cell.fanuc.rmi.override == 50
    for i, joints in enumerate(answers):
        assert joints == pytest.approx([10.0 * i, 20.0, -30.5, 40.0, -45.125, 3.0 * i], abs=0.0006)
    assert len(answers) == 5


@FANUC_UCL.needed()
def test_fanuc_ucl_moves_the_simulator_through_points_that_do_not_end_fine() -> None:
    command = [sys.executable, "-m", "mocks", "fanuc-rmi", "--port", str(PORT), "--time-scale", "10000"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=ROOT) as simulator:
        try:
            assert simulator.stdout is not None
            if not simulator.stdout.readline():
                pytest.skip(f"port {PORT} is taken")
            (answer,) = said_by(FANUC_UCL, "fanuc_ucl_peer.py")
        finally:
            simulator.terminate()
    assert answer["numbers"] == [1, 2, 3, 4]
    assert answer["joints"][:6] == pytest.approx([30.0, 20.0, -30.5, 40.0, -45.125, 9.0], abs=0.0006)
    assert answer["states"] == [1, 0, 1]
    assert "RMI Command Fail" in answer["refused"]  # RMIT-014
