"""Correction for other arms, for controllers with other conventions, and in the inverse direction.

The tests catch a limit judged in the wrong angles, a target out of reach that is driven, and an inverse direction that
is not the inverse.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib import StatedConditions, correct, forward, load_robot
from calib.compensate import Status, model_sides, nominal_of
from tests.calib.errant import ROBOT, STATED, WIDE, landing, only_geometry, random_targets, real_robot


@pytest.mark.parametrize("name", ["abb-irb120", "fanuc-lrmate200ic", "ur5", "ur10"])
def test_98_percent_within_a_nanometre_after_four_iterations_and_all_in_the_end(name: str) -> None:
    robot = load_robot(name)
    model, estimate = only_geometry(robot, 3)
    joints = np.random.default_rng(2).uniform(-2.0, 2.0, (1000, 6))
    limits = np.tile([-10.0, 10.0], (6, 1))
    done = correct(model, estimate, joints, StatedConditions(), limits=limits)
    assert np.mean(done.good) > 0.85
    assert np.max(done.landed[done.good]) <= 1e-6
    after_four = correct(
        model, estimate, joints[done.good], StatedConditions(), limits=limits, most_iterations=4
    )
    assert np.mean(after_four.landed <= 1e-6) >= 0.98


def test_out_of_reach_is_refused_and_leaves_the_others_alone() -> None:
    model, estimate = real_robot(3)
    joints = random_targets(10, 3)
    far = joints.copy()
    far[4] = np.nan
    one = correct(model, estimate, joints, STATED)
    other = correct(model, estimate, far, STATED)
    assert other.status[4] is Status.OUT_OF_REACH
    assert "does not reach" in other.reasons[4]
    rest = np.arange(10) != 4
    np.testing.assert_array_equal(other.joints[rest], one.joints[rest])


def test_limits_are_judged_as_the_controller_counts() -> None:
    """LR Mate: J3 counts from the horizontal; model theta_3 = -(J2 + J3)."""
    robot = load_robot("fanuc-lrmate200ic")
    model, estimate = only_geometry(robot, 1)
    counted = np.radians([[10.0, 100.0, 60.0, 20.0, -50.0, 30.0]])
    joints = robot.model_angles(counted, "fanuc-j23")
    assert joints[0, 2] < robot.lower[2]  # taken for model angles it would be beyond
    refused = correct(model, estimate, joints, StatedConditions())
    assert refused.status == (Status.BEYOND_LIMITS,)
    done = correct(model, estimate, joints, StatedConditions(), coupling="fanuc-j23")
    assert done.good.all()
    np.testing.assert_allclose(robot.controller_angles(done.joints, "fanuc-j23"), counted, atol=0.01)


def test_sides_of_a_coupled_joint() -> None:
    robot = load_robot("fanuc-lrmate200ic")
    assert list(model_sides(robot, np.ones(6), "fanuc-j23")) == [1, 1, -1, -1, -1, -1]
    assert list(model_sides(robot, -np.ones(6), "none")) == [-1] * 6
    with pytest.raises(ValueError, match="joint 3"):
        model_sides(robot, np.array([1.0, 1.0, -1.0, 1.0, 1.0, 1.0]), "fanuc-j23")


def test_the_inverse_direction_is_the_inverse() -> None:
    model, estimate = real_robot(4)
    driven = random_targets(200, 4)
    shown = nominal_of(model, estimate, driven, STATED, limits=WIDE)
    assert np.mean(shown.good) > 0.85
    stands = landing(model, estimate, driven[shown.good])
    np.testing.assert_allclose(forward(ROBOT, shown.joints[shown.good]), stands, atol=1e-8)
    back = correct(model, estimate, shown.joints[shown.good], STATED, limits=WIDE)
    np.testing.assert_allclose(back.joints[back.good], driven[shown.good][back.good], atol=1e-6)
    assert np.mean(back.good) > 0.95


def test_the_inverse_direction_refuses_too() -> None:
    model, estimate = real_robot(5)
    joints = random_targets(3, 5)
    joints[0, 4] = 0.0
    joints[1, 0] = ROBOT.upper[0] + 0.1
    joints[2] = np.nan
    done = nominal_of(model, estimate, joints, STATED)
    assert done.status == (Status.SINGULAR, Status.BEYOND_LIMITS, Status.OUT_OF_REACH)
    assert np.all(np.isnan(done.joints))


def test_a_robot_without_closed_form_is_corrected() -> None:
    model, estimate = real_robot(0)
    odd = replace(model, robot=replace(ROBOT, alpha=(*ROBOT.alpha[:2], 0.01, *ROBOT.alpha[3:])))
    assert correct(odd, estimate, random_targets(2, 0), STATED, limits=WIDE).good.any()
