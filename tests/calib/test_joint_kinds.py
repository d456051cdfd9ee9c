"""Test sliding joints together with turning joints.

These would catch: a slide that turns, mm taken for degrees, an external axis that shifts the numbers of the arm's
joints, and a key of another format that is ignored. They would also catch parallel axes that count from another end
in the other convention, and a DH number freed that no reading can show.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from calib.arm.kinematics import BasePoses, Chain, forward, nominal_values, propagate, statics
from calib.arm.robot import built_in_robots, load_robot
from calib.array import Array
from calib.errors import DataError
from calib.units import DEG
from tests.calib.chain import chain
from tests.calib.machines import GANTRY, MACHINES, SCARA, SCARA_DH, TRACK, machine
from tests.calib.test_statics import GRAVITY, slope

STEP = 1e-30


def joints_of(robot_lower: tuple[float, ...], robot_upper: tuple[float, ...], n: int) -> Array:
    return np.random.default_rng(5).uniform(robot_lower, robot_upper, (n, len(robot_lower)))


@pytest.mark.parametrize("name", MACHINES)
def test_the_chain_and_its_velocities_are_those_of_matrices(name: str, tmp_path: Path) -> None:
    robot = machine(name, tmp_path)
    joints = joints_of(robot.lower, robot.upper, 4)
    frames = propagate(Chain.of(robot), nominal_values(robot, joints), BasePoses())
    slots = list(Chain.of(robot).slots)
    velocities, turnings = frames.velocities(slots), frames.turnings(slots)
    poses = forward(robot, joints)
    for i, q in enumerate(joints):
        np.testing.assert_allclose(poses[i], chain(robot, q, {}).real, atol=1e-9)
        for s, slot in enumerate(slots):
            rate = chain(robot, q, {slot: 1j * STEP}).imag / STEP
            np.testing.assert_allclose(velocities[s, :, i], rate[:3, 3], atol=1e-7)
            spin = rate[:3, :3] @ poses[i, :3, :3].T
            np.testing.assert_allclose(turnings[s, :, i], [spin[2, 1], spin[0, 2], spin[1, 0]], atol=1e-9)
        for k, slot in enumerate(robot.joint_slots):  # what a joint does is what its slot does
            moved = q.astype(complex)
            moved[k] += 1j * STEP
            rate = chain(robot, moved, {}).imag / STEP
            np.testing.assert_allclose(velocities[slots.index(slot), :, i], rate[:3, 3], atol=1e-7)


@pytest.mark.parametrize("name", MACHINES)
def test_forces_and_moments_are_slopes_of_the_potential_energy(name: str, tmp_path: Path) -> None:
    robot = machine(name, tmp_path)
    joints = joints_of(robot.lower, robot.upper, 3)
    got = statics(robot, joints, gravity=GRAVITY)
    size = max(np.abs(got.moment).max(), 1.0)
    for i, q in enumerate(joints):
        for k, slot in enumerate(robot.joint_slots):
            expected = [slope(robot, q, s) for s in (f"bearing{k + 1}.rx", f"bearing{k + 1}.ry", slot)]
            np.testing.assert_allclose(got.moment[i, k], expected, rtol=0.0, atol=1e-10 * size)


def test_columns_and_units_follow_the_kind(tmp_path: Path) -> None:
    track, scara = machine("track", tmp_path), machine("scara", tmp_path)
    assert track.joint_columns == ("e1_mm", *(f"j{k}_deg" for k in range(1, 7)))
    assert scara.joint_columns == ("j1_deg", "j2_deg", "j3_mm", "j4_deg")
    assert machine("positioner", tmp_path).joint_columns == ("e1_deg", "e2_deg")
    assert scara.kinds == ("turns", "turns", "slides", "turns")
    np.testing.assert_array_equal(scara.joint_units, [DEG, DEG, 1.0, DEG])
    assert (scara.lower[2], scara.upper[2]) == (-200.0, 0.0)
    for name in built_in_robots():
        robot = load_robot(name)
        assert len(robot.joint_columns) == len(robot.joint_units) == robot.joints
        for k, (kind, column) in enumerate(zip(robot.kinds, robot.joint_columns, strict=True), start=1):
            assert column == f"j{k}_{'mm' if kind == 'slides' else 'deg'}"


def test_a_joint_matrix_couples_mm_and_degrees_as_the_file_says(tmp_path: Path) -> None:
    """A ball screw spline: a turn of joint 4 lifts the quill by its lead of 20 mm."""
    text = SCARA + (
        "[joint_matrices.spline]\n"
        "matrix = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0.055555555555555552], [0, 0, 0, 1]]\n"
        "offset_deg = [10, 0, 0, 0]\noffset_mm = [0, 0, -5, 0]\n"
    )
    (tmp_path / "spline.toml").write_text(text, encoding="utf-8")
    robot = load_robot("spline.toml", tmp_path)
    read = np.array([[10.0, 20.0, -30.0, 360.0]])
    model = robot.model_angles(read * robot.joint_units, "spline")
    np.testing.assert_allclose(model / robot.joint_units, [[20.0, 20.0, -15.0, 360.0]], atol=1e-9)
    back = robot.controller_angles(model, "spline") / robot.joint_units
    np.testing.assert_allclose(back, read, atol=1e-9)


REFUSED = {
    "prismatic": (SCARA.replace('joint = "slides"', 'kind = "prismatic"'), "link[3].min_mm", "joint"),
    "kind": (
        SCARA.replace("min_deg = -350.0", 'kind = "revolute"\nmin_deg = -350.0'),
        "link[4].kind",
        "'joint'",
    ),
    "no such kind": (SCARA.replace('"slides"', '"prismatic"'), "link[3].joint", '"slides"'),
    "degrees of a slide": (SCARA.replace("min_mm", "min_deg"), "link[3].min_deg", "min_mm"),
    "mm of a turn": (SCARA.replace("min_deg = -350.0", "min_mm = -350.0"), "link[4].min_mm", "min_deg"),
    "mistyped": (SCARA.replace("alpha_deg", "alfa_deg", 1), "link[1].alfa_deg", "'alpha_deg'"),
    "mistyped above": (SCARA.replace("parallel_axes", "paralel_axes"), "paralel_axes", "'parallel_axes'"),
    "a matrix's key": (SCARA + "[joint_matrices.a]\nmatrx = []\n", "joint_matrices.a.matrx", "'matrix'"),
    "limits swapped": (SCARA.replace("min_mm = -200.0", "min_mm = 200.0"), None, "limits"),
    "an axis of the arm's": (TRACK.replace('"e1"', '"j3"'), "link[1].axis", "e1"),
    "an axis twice": (MACHINES["positioner"].replace('"e2"', '"e1"'), "link[2].axis", "once"),
    "thesis on a track": (GANTRY.replace("parallel_axes", 'base = "thesis"\nparallel_axes'), "base", "plain"),
    "offset of the wrong unit": (
        SCARA
        + "[joint_matrices.a]\nmatrix = [[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]\noffset_deg = [0, 0, 5, 0]\n",
        "joint_matrices.a.offset_deg",
        "offset_mm",
    ),
    "parallel to nothing": (
        SCARA.replace("parallel_axes = [2,", "parallel_axes = [1,"),
        "parallel_axes",
        "2 to 4",
    ),
    "axes that cross": (
        TRACK.replace("parallel_axes = [4]", "parallel_axes = [3]"),
        "parallel_axes",
        "second",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_a_robot_file_cannot_mean_is_refused_by_key(case: str, tmp_path: Path) -> None:
    text, key, remedy = REFUSED[case]
    (tmp_path / "mine.toml").write_text(text, encoding="utf-8")
    with pytest.raises(DataError) as caught:
        load_robot("mine.toml", tmp_path)
    assert caught.value.key == key
    assert remedy in caught.value.do


def test_parallel_axes_count_alike_in_both_conventions(tmp_path: Path) -> None:
    """The same twist of the same axis moves the same target in both conventions."""
    modified, standard = machine("scara", tmp_path), machine("scara-dh", tmp_path)
    joints = joints_of(modified.lower, modified.upper, 5)
    assert (modified.parallel_axes, standard.parallel_axes) == ((2, 3, 4), (1, 2, 3))
    np.testing.assert_allclose(forward(modified, joints), forward(standard, joints), atol=1e-9)
    for one, other in zip(modified.parallel_axes, standard.parallel_axes, strict=True):
        values = []
        for robot, link in ((modified, one), (standard, other)):
            frames = propagate(
                Chain.of(robot), {**nominal_values(robot, joints), f"beta{link}": 0.01}, BasePoses()
            )
            values.append(frames.axis[f"theta{one}"])
        np.testing.assert_allclose(values[0], values[1], atol=1e-12)
    assert SCARA_DH != SCARA
    for name in ("ur5", "ur10"):
        assert load_robot(name).parallel_axes == (2, 3)


@pytest.mark.parametrize(
    ("name", "left_out"),
    [
        ("track", set()),
        ("scara", {"a3", "d2"}),
        ("scara-dh", {"a2", "d2"}),
        ("gantry", {"a2", "a3"}),
        ("seven", set()),
    ],
)
def test_numbers_that_shift_a_slide_across_are_not_freed(
    name: str, left_out: set[str], tmp_path: Path
) -> None:
    """The remaining parameters absorb the numbers that are left out, for any true machine."""
    robot = machine(name, tmp_path)
    rng = np.random.default_rng(1)
    joints = rng.uniform(robot.lower, robot.upper, (200, robot.joints))
    values = nominal_values(robot, joints)
    everything = [f"{kind}{k}" for k in range(2, robot.joints + 1) for kind in ("alpha", "a", "theta", "d")]
    everything += ["alpha1", "a1"] if robot.convention == "dh" else []
    for slot in everything:  # no machine is as it was drawn: nothing meets at a right angle any more
        values[slot] = values[slot] + rng.normal(0.0, 0.05)
    free = [f"{kind}{k}" for kind, k in robot.geometric_links]
    assert set(everything) - set(free) == left_out
    outside = [f"{of}.{axis}" for of in ("base", "tool") for axis in ("x", "y", "z", "rx", "ry", "rz")]
    frames = propagate(Chain.of(robot), {**values, "tool.x": 30.0, "tool.z": 50.0}, BasePoses())

    def rank(slots: list[str]) -> int:
        columns = np.concatenate([frames.velocities(slots), 300.0 * frames.turnings(slots)], axis=1)
        matrix = columns.reshape(len(slots), -1).T
        return int(np.linalg.matrix_rank(matrix / np.linalg.norm(matrix, axis=0), tol=1e-9))

    assert rank([*free, *outside]) == rank([*everything, *outside])
    turns, slides = robot.kinds.count("turns"), robot.kinds.count("slides")
    assert rank([*free, *outside]) == 4 * turns + 2 * slides + 6  # Schröer 1993: all that any numbers can say
