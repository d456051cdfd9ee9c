"""The simulated Fanuc moved by fanucpy, which nobody here wrote."""

from __future__ import annotations

import json
import math
import subprocess
from pathlib import Path

import pytest

from mocks.cell import CellThread
from mocks.cell_file import CellFile
from tests.counterparts.environments import FANUCPY
from tests.drivers.waiting import PATIENCE_S

FAST = CellFile(robot="fanuc-lrmate200ic", time_scale=10_000.0, effects=("none",))


@FANUCPY.needed()
def test_fanucpy_moves_the_simulator() -> None:
    with CellThread(FAST, stock=True, devices=("fanuc",)) as cell:
        peer = [str(FANUCPY.python), str(Path(__file__).parent / "fanucpy_peer.py"), str(cell.port("fanuc"))]
        said = subprocess.run(peer, capture_output=True, text=True, check=True, timeout=PATIENCE_S).stdout
    answers = [json.loads(line) for line in said.splitlines()]
    assert len(answers) == 10
    for i, (joints, pose) in enumerate(answers):
        assert joints == pytest.approx([10.0 * i, 20.0, -30.5, 40.0, -45.125, 3.0 * i], abs=0.0006)
        assert math.hypot(*pose[:2]) == pytest.approx(
            math.hypot(*answers[0][1][:2]), abs=0.01
        )  # joint 1 turns
        assert math.degrees(math.atan2(pose[1], pose[0])) - math.degrees(
            math.atan2(answers[0][1][1], answers[0][1][0])
        ) == pytest.approx(10.0 * i, abs=0.001)
