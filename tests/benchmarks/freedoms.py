"""Arms with other freedoms than six: inverse kinematics on 10,000 poses. Corrected targets: `machines`."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

from calib import Robot, forward
from calib.arm.inverse_kinematics import arm_of
from calib.array import Array
from tests.benchmarks.clock import line, seconds
from tests.calib.level import built, random_postures
from tests.calib.test_inverse_kinematics_arms import CRX, XARM, apart

POSES = 10_000
ARMS = ("scara", "scara-dh", "palletizer", "seven", "track")


def run() -> bool:
    """Print the table."""
    with tempfile.TemporaryDirectory() as folder:
        reached = [_inverse(name, Path(folder)) for name in ARMS]
    for robot, name in ((CRX, "crx"), (XARM, "xarm")):
        joints = np.random.default_rng(1).uniform(-np.pi, np.pi, (1000, 6))
        reached.append(_judged(robot, name, joints, 0.005))
    return all(reached)


def _inverse(name: str, folder: Path) -> bool:
    robot, coupling = built(name, folder)
    return _judged(robot, name, random_postures(robot, coupling, POSES, 1), 0.0)


def _judged(robot: Robot, name: str, joints: Array, missed: float) -> bool:
    arm, poses = arm_of(robot), forward(robot, joints)
    found = arm.solve(poses, joints)
    own = np.where(found.valid, apart(robot, found.joints, joints[:, None]), np.inf).min(axis=1)
    count = int(np.sum(own > 1e-6))
    rows, _ = np.nonzero(found.valid)
    stands = forward(robot, found.joints[found.valid])
    residual = float(np.max(np.linalg.norm((stands - poses[rows])[:, :3, 3], axis=1)))
    good = count <= missed * len(joints), residual < 1e-9
    line(f"inverse {name}: branches missed of {len(joints)}", str(count), f"<= {missed:.1%}", good[0])
    line(f"inverse {name}: residual, mm", f"{residual:.1e}", "< 1e-09", good[1])
    each = seconds(lambda: arm.solve(poses[:1000], joints[:1000]), 1) / min(1000, len(joints))
    print(f"    {found.valid.sum(axis=1).mean():.1f} branches a pose, {1e6 * each:.0f} us a pose")
    return all(good)
