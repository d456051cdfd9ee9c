"""Branches of the inverse kinematics, by which validation groups its readings."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib import forward, load_robot
from calib.array import Array
from calib.units import DEG
from calib.validation.judge import branches


class TestBranches:
    """Branches agree with obvious poses and with two signs.

    The signs are those of theta_5 and of the Jacobian's determinant.
    """

    @pytest.mark.parametrize("name", ["abb-irb120", "fanuc-lrmate200ic"])
    def test_anthropomorphic_arms(self, name: str) -> None:
        degrees = {
            "front/up/noflip": (0, 0, 0, 0, 30, 0),
            "front/up/flip": (70, 10, 20, 10, -30, 50),
            "front/down/noflip": (0, 100, -109, 0, 30, 0),
            "back/up/noflip": (0, -90, -40, 0, 40, 0),
        }
        joints = np.array(list(degrees.values()), dtype=float) * DEG
        assert branches(load_robot(name), joints) == list(degrees)

    @pytest.mark.parametrize("name", ["ur5", "ur10"])
    def test_urs(self, name: str) -> None:
        """Elbow by sin theta_3, wrist by sin theta_5, front by the reach a2 c2 + a3 c23 + d5 s234."""
        rng = np.random.default_rng(3)
        robot = load_robot(name)
        joints = rng.uniform(-np.pi, np.pi, (400, 6))
        q2, q23, q234 = joints[:, 1], joints[:, 1:3].sum(axis=1), joints[:, 1:4].sum(axis=1)
        reach = robot.a[1] * np.cos(q2) + robot.a[2] * np.cos(q23) + robot.d[4] * np.sin(q234)
        found = branches(robot, joints)
        assert found is not None
        words = np.array([word.split("/") for word in found])
        assert np.array_equal(words[:, 0] == "front", reach < 0.0)  # as at the zero pose, where it is a2 + a3
        assert np.array_equal(words[:, 1] == "up", np.sin(joints[:, 2]) > 0.0)
        assert np.array_equal(words[:, 2] == "noflip", np.sin(joints[:, 4]) > 0.0)

    @pytest.mark.parametrize("name", ["abb-irb120", "fanuc-lrmate200ic", "ur10"])
    def test_the_determinant_changes_sign_with_every_branch(self, name: str) -> None:
        robot = load_robot(name)
        joints = np.random.default_rng(8).uniform(-3.0, 3.0, (300, 6))
        found = branches(robot, joints)
        assert found is not None
        odd = np.array(
            [sum(word in ("back", "down", "flip") for word in name.split("/")) % 2 for name in found]
        )
        sign = np.sign(np.linalg.det(_jacobian(robot.name, joints)))
        assert len(set(zip(odd.tolist(), sign.tolist(), strict=True))) == 2

    def test_other_arms_have_no_such_branch(self) -> None:
        robot = load_robot("ur5")
        assert (
            branches(replace(robot, d=robot.d[:5], a=robot.a[:5], theta=robot.theta[:5]), np.zeros((1, 5)))
            is None
        )
        skew = replace(robot, a=(*robot.a[:4], 40.0, robot.a[5]))  # axes 5 and 6 pass each other
        assert branches(skew, np.zeros((1, 6))) is None


def _jacobian(name: str, joints: Array) -> Array:
    """Compute the Jacobian of the nominal flange pose by central differences, (n, 6, 6).

    Units are metres and rad.
    """
    robot, h = load_robot(name), 1e-5
    out = np.zeros((len(joints), 6, 6))
    for k in range(6):
        step = h * np.eye(6)[k]
        ahead, behind = forward(robot, joints + step), forward(robot, joints - step)
        out[:, :3, k] = (ahead[:, :3, 3] - behind[:, :3, 3]) / (2e3 * h)
        turn = Rotation.from_matrix(ahead[:, :3, :3] @ behind[:, :3, :3].transpose(0, 2, 1))
        out[:, 3:, k] = turn.as_rotvec() / (2.0 * h)
    return out
