"""Test the moments of gravity, and the points on which scale acts.

These would catch: a moment about another origin or in other axes than those in which a bearing tilts, an
overturning moment of half the arm, and a load whose torque is not linear in mass and centre. They would also catch
a validation reading that moves its own expected point, and a robot that is placed in the wrong world.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib.arm.kinematics import gravity_torques, statics
from calib.arm.robot import Load, Robot, load_robot
from calib.array import Array
from calib.data.read import read_dataset
from calib.fit.placing import base_model_of
from calib.model.model import StatedConditions, conditions_at
from mocks.campaign import make_campaign
from mocks.world import ROBOTS
from tests.calib.campaigns import dataset_of, move_rows, write_files
from tests.calib.chain import chain

GRAVITY = (0.4, -1.3, -9.6)  # a tilted robot: every joint is loaded, joint 1 too
STEP = 1e-30


def random_joints(robot: Robot, n: int) -> Array:
    return np.random.default_rng(3).uniform(-2.0, 2.0, (n, robot.joints))


def slope(robot: Robot, joints: Array, slot: str) -> float:
    """-dU / d slot of all loads, by the slow chain and complex steps."""
    total = 0.0
    for load in robot.loads:
        k = load.link
        short = replace(robot, alpha=robot.alpha[:k], a=robot.a[:k], theta=robot.theta[:k], d=robot.d[:k])
        place = chain(short, joints[:k], {slot: 1j * STEP}, load.cog_mm)[:3, 3]
        total += load.mass_kg * float(np.dot(GRAVITY, place.imag)) / STEP
    return total


@pytest.mark.parametrize("name", sorted(ROBOTS))
def test_moments_are_slopes_of_the_potential_energy(name: str) -> None:
    robot = load_robot(name)
    joints = random_joints(robot, 5)
    got = statics(robot, joints, gravity=GRAVITY)
    size = np.abs(got.moment).max()
    np.testing.assert_array_equal(got.torque, gravity_torques(robot, joints, gravity=GRAVITY))
    for i, q in enumerate(joints):
        for k in range(1, robot.joints + 1):
            expected = [slope(robot, q, slot) for slot in (f"bearing{k}.rx", f"bearing{k}.ry", f"theta{k}")]
            np.testing.assert_allclose(got.moment[i, k - 1], expected, rtol=0.0, atol=1e-10 * size)
        expected = [slope(robot, q, f"frame.{axis}") for axis in ("rx", "ry", "rz")]
        np.testing.assert_allclose(got.overturning[i], expected, rtol=0.0, atol=1e-10 * size)


@pytest.mark.parametrize("name", sorted(ROBOTS))
def test_the_torque_of_a_load_is_linear_in_mass_and_centre(name: str) -> None:
    robot = load_robot(name)
    joints = random_joints(robot, 5)
    tool = Load(robot.joints, 1.7, (12.0, -30.0, 88.0))
    whole = gravity_torques(robot, joints, (*robot.loads, tool), GRAVITY)
    got = statics(robot, joints, gravity=GRAVITY)
    share = got.unit_load @ (tool.mass_kg * np.array([1.0, *tool.cog_mm]))
    np.testing.assert_allclose(got.torque + share, whole, rtol=0.0, atol=1e-9 * np.abs(whole).max())
    assert np.abs(share).max(axis=0).min() > 10.0


def test_without_loads_nothing_pulls() -> None:
    robot = load_robot("ur10")
    got = statics(robot, random_joints(robot, 3), ())
    assert not got.moment.any()
    assert not got.overturning.any()
    assert np.abs(got.unit_load).max() > 1.0


class TestExpectedPoints:
    """Scale acts on the nominal robot in its place, which no reading moves by itself."""

    campaign = make_campaign(seed=9, n=40, n_validation=20, effects=[])

    def test_near_what_was_measured_wherever_the_world_is(self, tmp_path: Path) -> None:
        rows = [dict(row) for row in self.campaign.rows]
        pose = np.eye(4)
        pose[:3, :3] = [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
        pose[:3, 3] = [5000.0, -2000.0, 900.0]
        move_rows(rows, pose)
        header = {**self.campaign.header, "world": "free"}
        moved = read_dataset(write_files(tmp_path / "1", rows, header))
        plain = dataset_of(self.campaign, tmp_path / "2")
        for data in (plain, moved):
            assert np.linalg.norm(data.conditions.point - data.points, axis=1).max() < 10.0

    def test_no_validation_reading_moves_a_point(self, tmp_path: Path) -> None:
        rows = [dict(row) for row in self.campaign.rows]
        header = {**self.campaign.header, "world": "free"}
        plain = read_dataset(write_files(tmp_path / "1", rows, header))
        for number, row in enumerate(rows):
            if row["set"] == "validation":
                row |= {"x_mm": 1e6 + 10.0 * number, "y_mm": -1e6, "z_mm": 3e5}
        wild = read_dataset(write_files(tmp_path / "2", rows, header))
        np.testing.assert_array_equal(wild.conditions.point, plain.conditions.point)

    def test_a_stated_stand_is_in_the_world_too(self, tmp_path: Path) -> None:
        rows = [dict(row) for row in self.campaign.rows]
        pose = np.eye(4)
        pose[:3, 3] = [5000.0, -2000.0, 900.0]
        move_rows(rows, pose)
        data = read_dataset(write_files(tmp_path, rows, {**self.campaign.header, "world": "free"}))
        conditions = data.conditions
        name = conditions.target_names[0]
        rows_of = conditions.target == 0
        stated = conditions_at(base_model_of(data), conditions.joints[rows_of], StatedConditions(), name)
        np.testing.assert_allclose(stated.point, conditions.point[rows_of], atol=1e-6)
        for got, expected in (
            (stated.moment, conditions.moment), (stated.overturning, conditions.overturning),
            (stated.unit_load, conditions.unit_load), (stated.torque, conditions.torque),
        ):  # fmt: skip
            np.testing.assert_allclose(got, expected[rows_of], atol=1e-6)
