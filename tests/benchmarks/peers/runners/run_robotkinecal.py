"""Runner of robotkinecal: product of exponentials, four numbers per joint.

The target's position is free as well, and the base is among the numbers.
"""
# pyright: reportMissingImports=false

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import roboticstoolbox as rtb
from case import Case, Predict, answer_cases
from robotkinecal import SerialRobotKineCal


def prepare(case: Case) -> Callable[[], Predict]:
    """The calibration of the nominal robot with the readings set; m."""
    np.random.seed(1)  # noqa: NPY002 - its basis of the parameters is drawn from the global generator
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "arm.urdf"
        path.write_text(case.urdf(), encoding="utf-8")
        robot = rtb.ERobot.URDF(str(path))
    calibration = SerialRobotKineCal(robot, ee_name="tool")
    calibration.set_observations(list(case.joints), list(case.measured / 1e3))

    def solve() -> Predict:
        calibration.solve()
        last = calibration.N_JOINTS + 1
        return lambda joints: np.array([1e3 * calibration.forward_kinematics(last, q).t for q in joints])

    return solve


if __name__ == "__main__":
    answer_cases({"solve": prepare}, ("robotkinecal", "roboticstoolbox-python", "numpy"))
