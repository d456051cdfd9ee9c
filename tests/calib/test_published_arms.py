"""Test the built-in arms.

These would catch: a wrong digit in a DH table, an axis that turns against the controller's count, a zero, a
coupling, or a wrong direction of the flange. They would also catch a mass in the wrong frame, an arm that cannot be
inverted, and an arm without a published description.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from calib.arm.inverse_kinematics import BRANCHES, inverse_kinematics
from calib.arm.kinematics import BasePoses, Chain, forward, nominal_values, propagate
from calib.arm.robot import Robot, built_in_robots, load_robot
from calib.array import Array
from calib.validation.judge import branches
from tests.calib.published_arms import PUBLISHED

OF_THESES = {"abb-irb120", "ur10", "ur5"}  # published as DH tables, and tested against vectors of theirs
ARMS = sorted(PUBLISHED)


def controller_joints(robot: Robot, n: int, seed: int) -> Array:
    return np.random.default_rng(seed).uniform(robot.lower, robot.upper, (n, robot.joints))


def test_every_built_in_arm_has_its_published_description() -> None:
    assert set(built_in_robots()) == set(PUBLISHED) | OF_THESES
    page = (Path(__file__).parents[2] / "docs" / "robots.md").read_text(encoding="utf-8")
    assert re.findall(r"^\| `([^`]+)` \|", page, re.MULTILINE) == built_in_robots()


@pytest.mark.parametrize("name", ARMS)
def test_the_table_stands_where_the_published_chain_stands(name: str) -> None:
    robot, published = load_robot(name), PUBLISHED[name]
    assert robot.name == name
    assert (published.coupling == "none") == (not robot.joint_matrices)
    joints = controller_joints(robot, 20, 1)
    poses = forward(robot, robot.model_angles(joints, published.coupling))
    wanted = np.array([published.frames(q)[-1] for q in joints])
    np.testing.assert_allclose(poses[:, :3, 3], wanted[:, :3, 3], rtol=0.0, atol=1e-6)
    np.testing.assert_allclose(poses[:, :3, :3], wanted[:, :3, :3], rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("name", [name for name in ARMS if PUBLISHED[name].masses])
def test_masses_ride_where_the_published_masses_ride(name: str) -> None:
    robot, published = load_robot(name), PUBLISHED[name]
    joints = controller_joints(robot, 3, 2)
    frames = propagate(Chain.of(robot), nominal_values(robot, joints), BasePoses()).link_frames
    assert [(load.link, load.mass_kg) for load in robot.loads] == [
        (k, mass) for k, (mass, _) in enumerate(published.masses, start=1)
    ]
    for i, q in enumerate(joints):
        of_links = published.frames(q)
        for load, (_, centre) in zip(robot.loads, published.masses, strict=True):
            x, y, z, p = (np.broadcast_to(v, (3, len(joints)))[:, i] for v in frames[load.link - 1])
            place = p + x * load.cog_mm[0] + y * load.cog_mm[1] + z * load.cog_mm[2]
            wanted = of_links[load.link - 1] @ [*centre, 1.0]
            np.testing.assert_allclose(place, wanted[:3], rtol=0.0, atol=1e-3)


POSTURES = {
    "arm up, forearm level": ("kuka-kr6-r900", (0, -90, 90, 0, 0, 0), (525, 0, 890), (1, 0, 0)),
    "A1 to the right of one who looks along x": ("kuka-kr10-r1100", (90, -90, 90, 0, 0, 0), (0, -620, 995), (0, -1, 0)),
    "the tool downwards": ("kuka-iiwa7-r800", (0, 30, 0, -60, 0, 90, 0), (600, 0, 560.410162), (0, 0, -1)),
    "a pose of the maker's manual": ("doosan-m1013", (0, 0, 90, 0, 90, 0), (559, 34.5, 651.5), (0, 0, -1)),
    "a pose that programs start from": ("mecademic-meca500", (0, 0, 0, 0, 0, 0), (190, 0, 308), (1, 0, 0)),
    "straight up": ("staubli-tx2-90", (0, 0, 0, 0, 0, 0), (50, 50, 1428), (0, 0, 1)),
    "level": ("staubli-tx2-90", (0, 90, 0, 0, 0, 0), (1000, 50, 478), (1, 0, 0)),
    "zero of a UR: the arm level to the back": ("ur5e", (0, 0, 0, 0, 0, 0), (-817.2, -232.9, 62.8), (0, -1, 0)),
    "the rod keeps the forearm level": ("abb-irb2400-12-1.55", (0, 90, 0, 0, 0, 0), (1645, 0, 750), (1, 0, 0)),
    "joint 3 from the level": ("fanuc-r2000ic-165f", (0, 45, 0, 0, 0, 0), (2567.13979, 0, 1655.13979), (1, 0, 0)),
    "the quill half down": ("yaskawa-sg650", (90, -90, -105, 0), (300, 350, 35), (0, 0, 1)),
    "B downwards": ("yaskawa-gp7", (0, 0, 0, 0, -90, 0), (480, 0, 735), (0, 0, -1)),
}  # fmt: skip


@pytest.mark.parametrize("what", POSTURES)
def test_a_posture_stands_where_the_lengths_of_the_maker_put_it(what: str) -> None:
    name, joints, place, outwards = POSTURES[what]
    robot = load_robot(name)
    counted = np.array([joints]) * robot.joint_units
    pose = forward(robot, robot.model_angles(counted, PUBLISHED[name].coupling))[0]
    np.testing.assert_allclose(pose[:3, 3], place, rtol=0.0, atol=1e-4)
    np.testing.assert_allclose(pose[:3, 2], outwards, rtol=0.0, atol=1e-9)


# mm, from the makers' data sheets: how far the wrist centre, or the flange, gets from axis 1; ABB rounds to 0.05 m
REACHES = {
    "abb-irb1200-5-0.9": ("wrist", 901.0, 1.0),
    "abb-irb1200-7-0.7": ("wrist", 703.0, 1.0),
    "abb-irb1600-10-1.45": ("wrist", 1450.0, 1.0),
    "abb-irb4600-40-2.55": ("wrist", 2550.0, 5.0),
    "abb-irb4600-60-2.05": ("wrist", 2050.0, 5.0),
    "doosan-m1013": ("flange", 1300.0, 1.0),
    "fanuc-lrmate200ic": ("wrist", 704.0, 1.0),
    "fanuc-m10ia": ("wrist", 1420.0, 1.0),
    "fanuc-m20ia": ("wrist", 1811.0, 1.0),
    "fanuc-r2000ic-165f": ("wrist", 2655.0, 1.0),  # less than the sum of its links: axis 2 ends at 76 deg
    "kuka-kr10-r1100": ("wrist", 1101.0, 1.0),
    "kuka-kr6-r900": ("wrist", 901.0, 1.0),
    "mecademic-meca500": ("flange", 330.0, 1.0),
    "staubli-tx2-60": ("flange", 670.0, 1.0),
    "yaskawa-gp7": ("wrist", 927.0, 1.0),
}


@pytest.mark.parametrize("name", REACHES)
def test_the_arm_reaches_as_far_as_its_data_sheet_says(name: str) -> None:
    """The farthest posture in the plane of the arm agrees with the data sheet.

    A grid of postures is drawn closer and closer about the best.
    """
    what, figure, within = REACHES[name]
    robot, lower, upper = load_robot(name), np.array(load_robot(name).lower), np.array(load_robot(name).upper)
    moved = (1, 2) if what == "wrist" else (1, 2, 4)
    behind = abs(robot.d[-1]) if what == "wrist" else 0.0
    centre, span = (lower + upper) / 2.0, (upper - lower) / 2.0
    farthest = 0.0
    for _ in range(14):
        steps = [np.linspace(-1.0, 1.0, 9)] * len(moved)
        grid = np.stack([g.ravel() for g in np.meshgrid(*steps)], axis=1)
        joints = np.zeros((len(grid), robot.joints))
        for column, k in enumerate(moved):
            joints[:, k] = np.clip(centre[k] + span[k] * grid[:, column], lower[k], upper[k])
        pose = forward(robot, robot.model_angles(joints, PUBLISHED[name].coupling))
        point = pose[:, :3, 3] - behind * pose[:, :3, 2]
        away = np.hypot(point[:, 0], point[:, 1])
        best = int(np.argmax(away))
        farthest, centre, span = max(farthest, float(away[best])), joints[best], 0.5 * span
    assert farthest == pytest.approx(figure, abs=within)


@pytest.mark.parametrize("name", [name for name in ARMS if load_robot(name).joints == 6])
def test_the_arm_is_inverted_in_closed_form(name: str) -> None:
    robot = load_robot(name)
    joints = robot.model_angles(controller_joints(robot, 50, 3), PUBLISHED[name].coupling)
    poses = forward(robot, joints)
    found = inverse_kinematics(robot, poses)
    own = found.joints[np.arange(len(joints)), [BRANCHES.index(b) for b in branches(robot, joints) or ()]]
    assert np.abs((own - joints + np.pi) % (2.0 * np.pi) - np.pi).max() < 1e-7
    again = forward(robot, found.joints[found.valid])
    np.testing.assert_allclose(again, poses[np.nonzero(found.valid)[0]], rtol=0.0, atol=1e-9)
