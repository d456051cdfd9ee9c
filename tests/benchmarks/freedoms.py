"""Arms with other freedoms than six: inverse kinematics on 10,000 poses, and corrected targets driven on a true arm.

The true arm is the slow second chain with errors of its own. 60 readings with noise are fitted by least squares on the
calibrated chain, 60 new targets corrected by that model, driven on the true arm and read with the same noise. The
floor is what noise and the scatter of the fit alone would show there; wanted is 1.2 of it.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares

from calib.arm.inverse_kinematics import arm_of
from calib.arm.kinematics import forward
from calib.arm.robot import Robot
from calib.array import Array
from calib.compensate import Calibrated, correct
from calib.model.stated import StatedConditions
from tests.benchmarks.clock import line, seconds
from tests.calib.level import built, random_postures
from tests.calib.test_compensate_freedoms import errant, landing, wide
from tests.calib.test_inverse_kinematics_arms import CRX, XARM, apart

POSES, READINGS, NOISE_MM = 10_000, 60, 0.03
ARMS = ("scara", "scara-dh", "palletizer", "seven", "track")
WANTED = 1.2


def run() -> bool:
    """Print the table."""
    with tempfile.TemporaryDirectory() as folder:
        reached = [_inverse(name, Path(folder)) for name in ARMS]
        reached += [_driven(name, Path(folder)) for name in ARMS]
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


def _driven(name: str, folder: Path) -> bool:
    robot, coupling = built(name, folder)
    limits, stated, rng = wide(robot), StatedConditions(), np.random.default_rng(2)
    model, truth, slots = errant(robot, 1)
    joints = random_postures(robot, coupling, READINGS, 3)
    read = landing(robot, joints, slots)[:, :3, 3] + rng.normal(0.0, NOISE_MM, (READINGS, 3))
    # Weak priors of some times the usual size: what the readings do not determine stays near nominal.
    size = np.where(truth == 0.0, 1e-12, 5.0 * np.maximum(np.abs(truth), 1e-5))

    def off(share: Array) -> Array:
        reached = Calibrated(model, share * size, stated, "T1").poses(joints)[:, :3, 3]
        return np.concatenate([((reached - read) / NOISE_MM).ravel(), share])

    fit = least_squares(off, np.zeros(len(truth)), method="lm", x_scale=1.0)
    estimate = fit.x * size
    targets = random_postures(robot, coupling, READINGS, 4)
    done = correct(model, estimate, targets, stated, target="T1", limits=limits, coupling=coupling)
    good = done.good
    wanted = landing(robot, targets[good], {})[:, :3, 3]
    noise = rng.normal(0.0, NOISE_MM, wanted.shape)
    driven, plain = (landing(robot, there, slots)[:, :3, 3] for there in (done.joints[good], targets[good]))
    # The scatter of the fit at the targets: trace(G (J'J)^-1 G') by differences.
    spread = np.linalg.inv(fit.jac.T @ fit.jac)
    here = Calibrated(model, estimate, stated, "T1").poses(targets[good])[:, :3, 3]
    columns = [
        (Calibrated(model, estimate + 1e-4 * size * one, stated, "T1").poses(targets[good])[:, :3, 3] - here)
        / 1e-4
        for one in np.eye(len(truth))
    ]
    moved = np.stack(columns, axis=-1)
    fitted = np.einsum("nik,kl,nil->n", moved, spread, moved).mean()
    floor = float(np.sqrt(3.0 * NOISE_MM**2 + fitted))

    def rms(points: Array) -> float:
        return float(np.sqrt(np.mean(np.sum((points + noise - wanted) ** 2, axis=1))))

    ratio = rms(driven) / floor
    line(
        f"driven {name}: {rms(plain):.3f} -> {rms(driven):.4f} mm, {int(good.sum())} of {READINGS} targets",
        f"{ratio:.2f}",
        f"<= {WANTED}",
        ratio <= WANTED,
    )
    left = np.degrees(done.left.askew[good])
    print(f"    left to the arm: {np.max(left):.3f} deg at most")
    return ratio <= WANTED and int(good.sum()) >= 0.9 * READINGS
