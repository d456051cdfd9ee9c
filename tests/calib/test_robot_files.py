"""Test robot files.

These would catch: a built-in file that does not load or differs from the published numbers, and a custom file that
is accepted although it lacks or garbles something. They would also catch a refusal without file, key and remedy,
and a joint matrix that is applied the wrong way round.
"""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest

from calib.arm.kinematics import BasePoses, Chain, forward, nominal_values, propagate
from calib.arm.robot import BUILT_IN, built_in_robots, load_robot
from calib.errors import DataError
from mocks.world import ROBOTS, robot_named

GOOD = (BUILT_IN / "abb-irb120.toml").read_text(encoding="utf-8")


@pytest.mark.parametrize("name", sorted(ROBOTS))
def test_the_robots_of_the_simulator_are_built_in(name: str) -> None:
    """The simulator holds its own copy of every number: a wrong digit on either side shows."""
    ours, theirs = load_robot(name), robot_named(name)
    assert ours.name == name
    assert ours.convention == theirs.convention
    for k, link in enumerate(theirs.links):
        assert math.degrees(ours.alpha[k]) == pytest.approx(link.alpha_deg, abs=1e-12)
        assert math.degrees(ours.theta[k]) == pytest.approx(link.theta_deg, abs=1e-12)
        assert (ours.a[k], ours.d[k]) == (link.a_mm, link.d_mm)
        assert ours.lower[k] < ours.upper[k]
    assert [(x.link, x.mass_kg, x.cog_mm) for x in ours.loads] == [
        (x.link, x.mass_kg, x.cog_mm) for x in theirs.loads
    ]
    assert len(ours.source) > 20
    assert ours.base == ("thesis" if ours.convention == "mdh" else "plain")
    assert ours.parallel_axes == ((3,) if ours.convention == "mdh" else (2, 3))


WITH_BODY = [name for name in built_in_robots() if load_robot(name).capsules]


def test_the_robots_of_the_simulator_have_bodies() -> None:
    assert set(ROBOTS) <= set(WITH_BODY)


@pytest.mark.parametrize("name", WITH_BODY)
def test_a_body_reaches_from_foot_to_flange(name: str) -> None:
    robot = load_robot(name)
    assert robot.body == robot.capsules
    assert robot.capsules[0].name == "foot"
    assert {1, 2, 3} <= {capsule.link for capsule in robot.capsules}
    assert all(20.0 < capsule.radius_mm < 150.0 for capsule in robot.capsules)


@pytest.mark.parametrize("name", WITH_BODY)
def test_a_file_without_capsules_gives_a_thick_arm_from_joint_to_joint(name: str, tmp_path: Path) -> None:
    text = (BUILT_IN / f"{name}.toml").read_text(encoding="utf-8")
    (tmp_path / "mine.toml").write_text(text[: text.index("[[capsule]]")], encoding="utf-8")
    robot, own = load_robot("mine.toml", tmp_path), load_robot(name)
    assert robot.capsules == ()
    assert {capsule.radius_mm for capsule in robot.body} == {robot.body[0].radius_mm}
    assert robot.body[0].radius_mm >= 0.75 * max(capsule.radius_mm for capsule in own.capsules)
    joints = np.random.default_rng(0).uniform(-2.0, 2.0, (3, robot.joints))
    frames = propagate(Chain.of(robot), nominal_values(robot, joints), BasePoses()).link_frames
    previous = [np.array(frame[3]) for frame in frames]
    for capsule in robot.body:
        x, y, z, origin = frames[capsule.link - 1]
        end = origin + sum(c * axis for c, axis in zip(capsule.to_mm, (x, y, z), strict=True))
        other = capsule.link - 2 if robot.convention == "dh" else capsule.link
        if 0 <= other < robot.joints:
            np.testing.assert_allclose(end - previous[other], 0.0, atol=1e-9)


def test_joint_matrix_of_the_fanuc() -> None:
    robot = load_robot("fanuc-lrmate200ic")
    assert "fanuc-j23" in robot.joint_matrices
    controller = np.radians([[10.0, 20.0, 30.0, 40.0, 50.0, 60.0]])
    raised = np.radians([[10.0, 55.0, 30.0, 40.0, 50.0, 60.0]])
    # The controller counts joint 3 from the horizontal: joint 2 alone carries the forearm without turning it.
    both = forward(robot, robot.model_angles(np.vstack([controller, raised]), "fanuc-j23"))
    np.testing.assert_allclose(both[0, :3, :3], both[1, :3, :3], atol=1e-12)
    assert np.linalg.norm(both[0, :3, 3] - both[1, :3, 3]) > 100.0
    plain = forward(robot, np.vstack([controller, raised]))
    assert np.abs(plain[0, :3, :3] - plain[1, :3, :3]).max() > 0.1
    np.testing.assert_array_equal(robot.model_angles(controller, "none"), controller)


def test_a_file_of_ones_own_beside_the_header(tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text(GOOD.replace("302.0", "303.5"), encoding="utf-8")
    assert load_robot("mine.toml", tmp_path).d[3] == 303.5


REFUSED = {
    "format": (GOOD.replace("truepose-robot/1", "robot/9"), "format"),
    "no format": (GOOD.replace("format =", "fromat ="), "format"),
    "not toml": (GOOD + "\n[[link", "TOML"),
    "not utf-8": ("", "UTF-16"),
    "convention": (GOOD.replace('"mdh"', '"craig"'), "convention"),
    "no convention": (GOOD.replace("convention =", "converntion ="), "convention"),
    "missing key": (GOOD.replace("theta_deg = 180.0\n", ""), "theta_deg"),
    "missing name": (GOOD.replace('name = "abb-irb120"\n', ""), "name"),
    "missing source": (re.sub(r"source = .*\n", "", GOOD), "source"),
    "no links": (re.sub(r"\[\[link\]\]\n(\w+ = .*\n)+", "", GOOD), "link"),
    "limits": (GOOD.replace("min_deg = -165.0", "min_deg = 165.0"), "min_deg"),
    "load on link 9": (GOOD.replace("link = 6\nmass", "link = 9\nmass"), "load"),
    "load without mass": (GOOD.replace("mass_kg = 2.7\n", ""), "mass_kg"),
    "weightless load": (GOOD.replace("mass_kg = 2.7", "mass_kg = 0.0"), "load"),
    "flat load": (GOOD.replace("[50.0, 25.0, 100.0]", "[50.0, 25.0]"), "load"),
    "text for a number": (GOOD.replace("a_mm = 270.0", 'a_mm = "long"'), "long"),
    "a flag for a number": (GOOD.replace("a_mm = 270.0", "a_mm = true"), "link[3].a_mm"),
    "nan": (GOOD.replace("a_mm = 270.0", "a_mm = nan"), "link"),
    "infinite": (GOOD.replace("d_mm = 302.0", "d_mm = inf"), "link"),
    "text for a load": (GOOD.replace("mass_kg = 2.7", 'mass_kg = "2.7 kg"'), "mass_kg"),
    "unknown base": (GOOD.replace('"thesis"', '"theses"'), "base"),
    "parallel axes": (GOOD.replace("parallel_axes = [3]", "parallel_axes = [13]"), "parallel_axes"),
    "capsule of no link": (GOOD.replace("link = 4\nfrom", "link = 9\nfrom"), "'forearm' names link 9"),
    "capsule without radius": (GOOD.replace("radius_mm = 65.0\n", ""), "radius_mm is missing"),
    "capsule of a radius of nought": (GOOD.replace("radius_mm = 65.0", "radius_mm = 0.0"), "'forearm'"),
    "capsule as thick as a house": (GOOD.replace("radius_mm = 65.0", "radius_mm = 65000.0"), "'forearm'"),
    "capsule with text": (GOOD.replace("radius_mm = 65.0", 'radius_mm = "65"'), "'forearm'"),
    "capsule with nan": (GOOD.replace("[0.0, 0.0, -240.0]", "[0.0, 0.0, nan]"), "from_mm"),
    "capsule without a place": (GOOD.replace("[0.0, 0.0, -240.0]", "[0.0, -240.0]"), "no point"),
    "capsule with a mistyped key": (GOOD.replace("radius_mm = 65.0", "radius_m = 65.0"), "radius_m"),
    "capsules as a table": (
        GOOD[: GOOD.index("\n[[capsule]]")] + '\n[capsule]\nname = "arm"\n',
        "[[capsule]]",
    ),
    "links as a table": (re.sub(r"\[\[link\]\]\n(\w+ = .*\n)+", "", GOOD) + "\n[link]\na = 1\n", "link"),
}


@pytest.mark.parametrize("case", sorted(REFUSED))
def test_a_broken_robot_file_is_refused(case: str, tmp_path: Path) -> None:
    text, word = REFUSED[case]
    assert text != GOOD
    path = tmp_path / "broken.toml"
    path.write_bytes(b"\xff\xfe" if case == "not utf-8" else text.encode())
    with pytest.raises(DataError) as caught:
        load_robot("broken.toml", tmp_path)
    assert str(path) in str(caught.value)
    assert word in str(caught.value)
    assert len(caught.value.do) > 5


@pytest.mark.parametrize("name", ["abb-irb121", "missing.toml", "", "../abb-irb120", "."])
def test_an_unknown_robot_is_refused_and_where_the_known_are_listed_is_said(
    name: str, tmp_path: Path
) -> None:
    with pytest.raises(DataError, match=r"truepose robot list") as caught:
        load_robot(name, tmp_path)
    assert caught.value.key == "robot"
