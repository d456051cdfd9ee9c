"""Test a tool that never turns: its position and the base cannot be distinguished.

The same holds for the last links, and they need not be distinguished.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from calib.arm.kinematics import forward
from calib.arm.robot import load_robot
from calib.array import Array
from calib.data import read_dataset
from calib.fit import base_model_of, errors_on, identify, place_nominal
from calib.fit.ending import FitTermination
from calib.units import DEG
from tests.calib.campaigns import write_files

NOISE_MM = 0.02
TOOL = np.array([35.0, -20.0, 140.0])
HEADER = {
    "format": "truepose-dataset/1",
    "robot": "abb-irb120",
    "instrument": "tracker",
    "world": "free",
    "noise": {"kind": "isotropic", "sigma_mm": NOISE_MM},
    "tool_targets": {"T1": [0.0, 0.0, 0.0]},
    "model": {"fit": ["base", "geometry", "parallel_twist", "compliance", "tool"]},
}


def still(kind: str, n: int, rng: np.random.Generator) -> Array:
    """Draw joints (n, 6), rad, by which the nominal tool keeps its direction.

    Joint 5 cancels the turns of joints 2 and 3.
    """
    first = rng.uniform(-25.0, 25.0, n) * (kind != "plane")
    second, third = rng.uniform(-20.0, 30.0, n), rng.uniform(-25.0, 15.0, n)
    if kind == "line":
        third = np.linspace(-20.0, 10.0, n)
        second = 10.0 - 0.4 * third
    fifth = 60.0 - second - third
    return np.column_stack([first, second, third, 0.0 * first, fifth, 0.0 * first]) * DEG


@pytest.mark.parametrize("kind", ["surface", "plane", "line"])
@pytest.mark.parametrize("n", [60, 250])
def test_the_fit_ends_and_is_no_worse_than_the_nominal_robot(kind: str, n: int, tmp_path: Path) -> None:
    rng = np.random.default_rng(n)
    robot = load_robot("abb-irb120")
    joints = still(kind, n, rng)
    true = forward(robot, joints + rng.normal(0.0, 2e-4, 6))
    points = true[:, :3, 3] + true[:, :3, :3] @ (TOOL + rng.normal(0.0, 0.3, 3))
    turn, shift = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]), (900.0, -300.0, 150.0)
    points = points @ turn.T + shift + rng.normal(0.0, NOISE_MM, points.shape)
    rows = [
        {"reading_id": str(i + 1), "set": "validation" if i % 5 == 2 else "calibration"}
        | {f"j{k + 1}_deg": float(joints[i, k] / DEG) for k in range(6)}
        | {"tool_target": "T1"}
        | {f"{axis}_mm": float(points[i, k]) for k, axis in enumerate("xyz")}
        for i in range(n)
    ]
    data = read_dataset(write_files(tmp_path, rows, HEADER))
    nominal, placed = place_nominal(data, base_model_of(data))
    found = identify(data)
    assert found.ending is FitTermination.CONVERGED
    assert np.max(np.abs(list(found.model.targets["main"]["T1"]))) < 2000.0, "the start ran away"
    before, after = (
        float(np.sqrt(np.mean(errors_on(data, data.validation_rows, model, x) ** 2)))
        for model, x in ((nominal, placed), (found.model, found.estimate))
    )
    assert before < 1.0
    assert after <= 1.05 * before
    told = " ".join(found.warnings).replace(",", " ").split()
    names = [parameter.name for parameter in found.model.parameters]
    loose = [
        name
        for name, std in zip(names, found.standard_errors, strict=True)
        if std > (5.0 if name[-1] in "xyz" and name[-2] == "." else np.inf)
    ]
    assert any(name.startswith("T1.") for name in told), "what the tool's place trades against is named"
    assert len(loose) != 1
    assert set(loose) <= set(told)
