"""The simulated UR controller read by ur-rtde, which nobody here wrote, while our driver moves it."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from drivers import UrArm
from tests.counterparts.environments import UR_RTDE
from tests.drivers.waiting import PATIENCE_S

ROOT = Path(__file__).parents[2]
PORT = 30004  # the only one that it knows


@UR_RTDE.needed()
@pytest.mark.parametrize("dialect", ["polyscope-3.15", "polyscope-x"])
def test_ur_rtde_reads_what_our_driver_moves(dialect: str) -> None:
    """PolyScope X has neither dashboard nor port 30003; the driver sends programs to 30001."""
    options = ["--port", str(PORT), "--time-scale", "1000", "--dialect", dialect]
    command = [sys.executable, "-m", "mocks", "ur", *options]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=ROOT) as simulator:
        try:
            assert simulator.stdout is not None
            if not simulator.stdout.readline():
                pytest.skip(f"port {PORT} is taken")
            _watch_moves()
        finally:
            simulator.terminate()


def _watch_moves() -> None:
    arm = UrArm(f"tcp://127.0.0.1:{PORT}")
    arm.connect()
    arm.arm()
    command = [str(UR_RTDE.python), str(Path(__file__).parent / "ur_rtde_peer.py")]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as peer:
        assert peer.stdin is not None
        assert peer.stdout is not None
        for i in range(5):
            goal = (10.0 * i, -90.0 - i, 20.5, -30.25, 40.0, 3.0 * i)
            reached = arm.move_to(goal).joints_deg
            peer.stdin.write("\n")
            peer.stdin.flush()
            actual, target, robot_mode, safety_mode = json.loads(peer.stdout.readline())
            assert np.degrees(actual) == pytest.approx(reached, abs=1e-9)
            assert np.degrees(target) == pytest.approx(goal, abs=1e-6)
            assert (robot_mode, safety_mode) == (7, 1)
        peer.stdin.close()
        assert peer.wait(PATIENCE_S) == 0
    arm.disconnect()
