"""Test the simulators' robots from robot files against the program's reader and chain.

These would catch: a sliding joint that is turned, a zero or a coupling lost, limits of the wrong side.
"""

from __future__ import annotations

import tomllib

import numpy as np
import pytest

from calib.arm import built_in_robots, forward, load_robot
from mocks.cell import make_world, robot_in
from mocks.cell_file import CellFile
from mocks.world import ROBOTS, World
from mocks.world.kinematics import frames, nominal_geometry
from mocks.world.robot_file import robot_of, table_of
from mocks.world.scaling import displacement, noise_rms, rehearsal, rms_per_axis, scaled
from tests.calib.machines import POSITIONER, SCARA_DH, TRACK

MADE_UP = {"track": TRACK, "positioner": POSITIONER, "scara-dh": SCARA_DH}


@pytest.mark.parametrize("name", built_in_robots())
def test_the_nominal_flange_is_where_the_program_has_it(name: str) -> None:
    ours, theirs = load_robot(name), robot_of(table_of(name))
    coupling = next(iter(ours.joint_matrices), "none")
    low, high = np.array(theirs.limits_deg).T
    counted = np.random.default_rng(1).uniform(low, high, (5, ours.joints))
    want = forward(ours, ours.model_angles(counted * ours.joint_units, coupling))
    for row, flange in zip(counted, want, strict=True):
        joints = theirs.counting.to_model(row.tolist())
        chain = frames(theirs.convention, nominal_geometry(theirs), theirs.internal(joints))
        np.testing.assert_allclose(chain[-1], flange, atol=1e-9)
        np.testing.assert_allclose(theirs.counting.counted(joints), row, atol=1e-9)


@pytest.mark.parametrize("name", sorted(ROBOTS))
def test_the_simulators_own_robots_count_as_their_files_say(name: str) -> None:
    own, of_file = ROBOTS[name], robot_of(table_of(name))
    assert own.limits_deg == of_file.limits_deg
    assert (own.twisted, own.axes or own.names) == (of_file.twisted, of_file.axes)
    joints = [10.0, 20.0, 30.0, 40.0, 50.0, 60.0]
    assert own.counting.to_model(joints) == of_file.counting.to_model(joints)


@pytest.mark.parametrize("name", sorted(MADE_UP))
def test_a_robot_file_of_ones_own_is_simulated(name: str) -> None:
    table = tomllib.loads(MADE_UP[name])
    cell = CellFile(robot="own.toml", robot_file=table, effects=("none",))
    robot = robot_in(cell)
    assert robot.names == tuple(
        ("e1", "j1", "j2", "j3", "j4", "j5", "j6") if name == "track" else robot.names
    )
    world = make_world(cell)
    assert np.all(np.isfinite(world.true_point(rehearsal(world)[0][0], "T1")))
    angle, travel = (
        world.arrival_error(1)[~np.array(robot.sliding)],
        world.arrival_error(1)[np.array(robot.sliding)],
    )
    assert np.abs(angle).max() < 1e-4  # rad
    assert not travel.size or 1e-4 < np.abs(travel).max() < 0.02  # mm


@pytest.mark.parametrize("label", ["slide_backlash:e1", "slide_scale:e1", "backlash:j1", "periodic:j6:n2"])
def test_effects_of_an_arm_on_a_track_have_their_size(label: str) -> None:
    robot = robot_of(tomllib.loads(TRACK))
    world = World(robot, seed=7)
    readings = rehearsal(world)
    found = scaled(world, world.draw_effect(label), readings, 4.0)
    assert found.label == label
    assert rms_per_axis(displacement(world, found, readings)) == pytest.approx(
        4.0 * noise_rms(world, readings), rel=1e-4
    )


@pytest.mark.parametrize(
    ("label", "words"), [("slide_scale:j1", "that joint turns"), ("backlash:j9", "'j9' is not one of")]
)
def test_labels_of_joints_that_are_not_there(label: str, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        World(robot_of(tomllib.loads(TRACK)), seed=7).draw_effect(label)


def test_another_robot_is_named_with_those_that_there_are() -> None:
    with pytest.raises(ValueError, match=r"'irb9000' is not one of .*abb-irb1200-5-0\.9"):
        robot_in(CellFile(robot="irb9000"))
