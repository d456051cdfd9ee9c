"""Test the compensation of arms with other than six degrees of freedom.

These would catch: a target refused because the arm cannot tilt, a position that is sacrificed for an orientation,
and a residual error that is not reported or reported too small. They would also catch a track that moves, an elbow
that wanders, and limits that are no longer kept. The landing is computed by another chain.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from calib import Robot, StatedConditions, correct, load_robot
from calib.arm.freedoms import Freedoms
from calib.arm.kinematics import joint_scale, nominal_jacobian
from calib.array import Array
from calib.compensate import Status, nominal_of
from calib.data import DEFAULT_GROUPS
from calib.model import ModelStructure, base_model
from calib.units import to_internal
from tests.calib.chain import chain
from tests.calib.level import built, random_postures

TOOL = (30.0, -20.0, 100.0)
SIZES = {"alpha": 0.04, "beta": 0.03, "theta": 0.1, "a": 0.25, "d": 0.25}


def errant(robot: Robot, seed: int) -> tuple[ModelStructure, Array, dict[str, float]]:
    """Draw a robot with usual errors of geometry and base; also return them as slot changes."""
    rng = np.random.default_rng(seed)
    effects = base_model.build(DEFAULT_GROUPS, robot, ("main",), ({"T1": False},))
    model = ModelStructure(robot, effects, {"main": {"T1": TOOL}})
    estimate, slots = np.zeros(len(model.parameters)), dict[str, float]()
    for i, parameter in enumerate(model.parameters):
        name = parameter.name
        kind = "base" if name.startswith("base.") else name.rstrip("0123456789")
        size = {"mm": 0.3, "deg": 0.02}[parameter.unit] if kind == "base" else SIZES.get(kind, 0.0)
        estimate[i] = to_internal(size * rng.choice((-1.0, 1.0)) * rng.uniform(0.6, 1.4), parameter.unit)
        if size:
            slots[name] = estimate[i]
    return model, estimate, slots


def landing(robot: Robot, joints: Array, slots: dict[str, float]) -> Array:
    """Compute the landing poses of the tool point by the slow second chain, (n, 4, 4)."""
    return np.array([chain(robot, q, slots, target=TOOL).real for q in joints])


def wide(robot: Robot) -> Array:
    """Limits with room for a correction, but for joints that are held."""
    limits = np.column_stack([robot.lower, robot.upper])
    room = np.where(limits[:, 1] - limits[:, 0] > 1e-3, 0.1 * joint_scale(robot), 0.0)
    return limits + room[:, None] * [-1.0, 1.0]


ARMS = ("scara", "palletizer", "seven", "track", "gantry")


@pytest.mark.parametrize("name", ARMS)
def test_the_tool_lands_and_what_is_left_is_said(name: str, tmp_path: Path) -> None:
    robot, coupling = built(name, tmp_path)
    model, estimate, slots = errant(robot, 1)
    targets = random_postures(robot, coupling, 100, 1)
    done = correct(
        model, estimate, targets, StatedConditions(), target="T1", limits=wide(robot), coupling=coupling
    )
    good = done.good
    assert np.mean(good) > 0.9
    wanted = landing(robot, targets[good], {})
    before = np.linalg.norm((landing(robot, targets[good], slots) - wanted)[:, :3, 3], axis=1)
    assert np.mean(before) > 0.3
    reached = landing(robot, done.joints[good], slots)
    assert np.max(np.linalg.norm((reached - wanted)[:, :3, 3], axis=1)) < 2e-6
    turn = reached[:, :3, :3] @ wanted[:, :3, :3].transpose(0, 2, 1)
    askew = np.linalg.norm(turn - np.eye(3), axis=(1, 2)) / np.sqrt(2.0)
    np.testing.assert_allclose(done.left.askew[good], askew, rtol=1e-4, atol=2e-9)
    if name in ("seven", "track"):
        assert np.max(askew) < 1e-8
        assert not any(done.notes)
        return
    word = "turn" if name == "gantry" else "tilt"
    for note, size in zip(np.array(done.notes)[good], askew, strict=True):
        assert note == f"left: {np.degrees(size):.3f} deg of {word} that this arm cannot turn"
    if word == "tilt":  # its turn about the vertical is corrected
        assert np.max(np.abs(turn[:, 1, 0] - turn[:, 0, 1])) < 1e-8
        assert np.min(askew) > 1e-5


def test_a_wrist_that_is_held_by_rods_is_not_asked_to_move(tmp_path: Path) -> None:
    robot, coupling = built("palletizer", tmp_path)
    model, estimate, _ = errant(robot, 2)
    targets = random_postures(robot, coupling, 30, 2)
    done = correct(model, estimate, targets, StatedConditions(), limits=wide(robot), coupling=coupling)
    wrist = robot.controller_angles(done.joints[done.good], coupling)[:, 3]
    assert np.max(np.abs(wrist)) < 1e-12


def test_a_track_stays_and_of_seven_axes_the_nearest_posture_is_taken(tmp_path: Path) -> None:
    for name in ("track", "seven"):
        robot, coupling = built(name, tmp_path)
        model, estimate, _ = errant(robot, 3)
        targets = random_postures(robot, coupling, 50, 3)
        done = correct(model, estimate, targets, StatedConditions(), limits=wide(robot))
        moved = (done.joints - targets)[done.good]
        if name == "track":
            assert np.max(np.abs(moved[:, 0])) < 1e-11  # mm
            continue
        jacobian = nominal_jacobian(robot, targets[done.good], np.zeros(3))[1]
        free = np.linalg.svd(jacobian)[2][:, 6]
        # What moves the elbow alone is of second order in the correction.
        alone = np.abs(np.sum(moved * free, axis=1))
        assert np.max(alone) < 0.02 * np.max(np.linalg.norm(moved, axis=1))


def test_a_positioner_weighs_shift_and_turn(tmp_path: Path) -> None:
    robot, coupling = built("positioner", tmp_path)
    model, estimate, slots = errant(robot, 4)
    targets = random_postures(robot, coupling, 40, 4)
    done = correct(model, estimate, targets, StatedConditions(), target="T1", limits=wide(robot))
    assert done.good.all()
    wanted = landing(robot, targets, {})

    def cost(joints: Array) -> Array:
        """Shift and turn together, a turn at 300 mm."""
        off = landing(robot, joints, slots)
        turn = off[:, :3, :3] @ wanted[:, :3, :3].transpose(0, 2, 1)
        skew = 0.5 * (turn - turn.transpose(0, 2, 1))
        vector = np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], axis=1)
        return np.sum((off - wanted)[:, :3, 3] ** 2, axis=1) + np.sum((300.0 * vector) ** 2, axis=1)

    least = cost(done.joints)
    for k in range(2):
        for aside in (-1e-4, 1e-4):
            assert np.all(cost(done.joints + aside * np.eye(2)[k]) > least)
    assert all("that this arm cannot move and" in note for note in done.notes)


@pytest.mark.parametrize(
    ("name", "count", "places", "turns", "driven"),
    [
        ("scara", 4, True, 1, 4),
        ("palletizer", 4, True, 1, 4),
        ("seven", 6, True, 3, 7),
        ("track", 6, True, 3, 6),
        ("gantry", 3, True, 0, 3),
        ("positioner", 2, False, 2, 2),
    ],
)
def test_freedoms(name: str, count: int, places: bool, turns: int, driven: int, tmp_path: Path) -> None:
    robot, coupling = built(name, tmp_path)
    found = Freedoms.of(robot, wide(robot), coupling, np.zeros(3))
    assert (found.count, found.places, found.turns) == (count, places, turns)
    assert found.columns.shape == (robot.joints, driven)


def test_a_joint_whose_limits_hold_it_is_left_out() -> None:
    robot = load_robot("abb-irb120")
    limits = np.column_stack([robot.lower, robot.upper])
    limits[5] = 0.3, 0.3
    found = Freedoms.of(robot, limits, "none", np.zeros(3))
    assert (found.count, found.places) == (5, True)


def test_limits_and_singular_postures_are_refused_as_before(tmp_path: Path) -> None:
    robot, _ = built("scara", tmp_path)
    model, estimate, _ = errant(robot, 5)
    targets = random_postures(robot, "none", 4, 5)
    targets[0, 1] = 0.0  # stretched
    targets[1, 2] = robot.upper[2] + 1.0
    targets[2, 0] = np.nan
    done = correct(model, estimate, targets, StatedConditions())
    assert done.status[:3] == (Status.SINGULAR, Status.BEYOND_LIMITS, Status.OUT_OF_REACH)
    assert np.all(np.isnan(done.joints[:3]))
    assert done.notes[:3] == ("", "", "")


def test_the_inverse_direction_is_the_inverse(tmp_path: Path) -> None:
    """There and back, the tool point returns to its place, within the freedoms of the arm."""
    robot, coupling = built("scara", tmp_path)
    model, estimate, _ = errant(robot, 6)
    driven = random_postures(robot, coupling, 50, 6)
    shown = nominal_of(model, estimate, driven, StatedConditions(), target="T1", limits=wide(robot))
    good = shown.good
    assert np.mean(good) > 0.9
    back = correct(model, estimate, shown.joints[good], StatedConditions(), target="T1", limits=wide(robot))
    np.testing.assert_allclose(
        (back.joints / joint_scale(robot))[back.good],
        (driven[good] / joint_scale(robot))[back.good],
        atol=1e-6,
    )


def test_rows_do_not_influence_each_other(tmp_path: Path) -> None:
    robot, coupling = built("palletizer", tmp_path)
    model, estimate, _ = errant(robot, 7)
    targets = random_postures(robot, coupling, 10, 7)
    together = correct(model, estimate, targets, StatedConditions(), coupling=coupling, limits=wide(robot))
    for i in range(10):
        alone = correct(
            model, estimate, targets[i : i + 1], StatedConditions(), coupling=coupling, limits=wide(robot)
        )
        np.testing.assert_allclose(alone.joints[0], together.joints[i], rtol=0.0, atol=1e-11)
        assert alone.notes[0] == together.notes[i]
