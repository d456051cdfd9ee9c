"""Test that files with another meaning are refused by name, and that odd files are read."""

from __future__ import annotations

import copy
import csv
import re
import shutil
import tomllib
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from calib import DataError, forward, identify, load_robot, read_dataset
from calib.arm import BasePoses, Chain, inverse_kinematics, nominal_values, propagate
from calib.arm.start import base_and_tool
from calib.units import DEG
from tests.benchmarks.coverage import BASE_TARGETS, RANGE
from tests.benchmarks.misread import files_of, mistakes, odd_sets, refusal
from tests.benchmarks.real_data import SHARED
from tests.calib.campaigns import Row, write_files
from tests.calib.cells import NOISE, POSE, Cell

GOOD = {robot: files_of(robot, 1) for robot in ("abb-irb120", "ur10")}
MISTAKES = {
    f"{robot}, {what}": (robot, do, words, own)
    for robot, good in GOOD.items()
    for what, do, words, own in mistakes(good[2])
    if own or robot == "abb-irb120"
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_is_named_with_what_mends_it(mistake: str, tmp_path: Path) -> None:
    robot, do, words, own = MISTAKES[mistake]
    files = copy.deepcopy(GOOD[robot])
    do(files)
    text = refusal(tmp_path, files, own=own)
    assert re.search(words, text), text
    assert "np." not in text


@pytest.mark.parametrize("own", [False, True])
def test_good_files_are_read(own: bool, tmp_path: Path) -> None:
    for files in GOOD.values():
        assert refusal(tmp_path, files, own=own) == ""


def test_another_robot_of_the_library_is_named(tmp_path: Path) -> None:
    rows, header, table = GOOD["abb-irb120"]
    text = refusal(tmp_path, (rows, header | {"robot": "ur5"}, table), own=False)
    assert 'Set robot = "abb-irb120".' in text


def files_of_arm(name: str, coupling: str) -> tuple[list[Row], dict[str, Any]]:
    """Simulate 20 poses of an arm in the box, as its controller counts.

    Its table has errors of 0.5 mm and 0.05 deg.
    """
    robot, rng = load_robot(name), np.random.default_rng(5)
    joints = rng.uniform(robot.lower, robot.upper, (20, robot.joints))
    values = nominal_values(robot, robot.model_angles(joints, coupling))
    for k in range(1, robot.joints + 1):
        for kind, size in (("alpha", 0.05 * DEG), ("theta", 0.05 * DEG), ("a", 0.5), ("d", 0.5)):
            values[f"{kind}{k}"] = values[f"{kind}{k}"] + size * rng.normal()
    frames = propagate(Chain.of(robot), values, BasePoses())
    points = (frames.p + 60.0 * frames.x - 20.0 * frames.y + 90.0 * frames.z).T @ POSE[:3, :3].T + POSE[:3, 3]
    columns = (*robot.joint_columns, "x_mm", "y_mm", "z_mm")
    rows = np.hstack([joints / robot.joint_units, points])
    header = {"format": "truepose-dataset/1", "robot": name, "world": "free", "joint_coupling": coupling}
    header |= {"tool_targets": {"T1": [60.0, -20.0, 90.0]}, "beyond_limits": True}
    header |= {"noise": {"kind": "isotropic", "sigma_mm": 0.02}}
    return [dict(zip(columns, map(float, row), strict=True)) | {"set": "calibration"} for row in rows], header


ALIKE = [
    ("ur5", "none", "ur5e", "none"),
    ("ur10e", "none", "ur10", "none"),
    ("kuka-kr6-r900", "kuka", "abb-irb1200-5-0.9", "none"),
    ("fanuc-m20ia", "fanuc-j23", "fanuc-m10ia", "fanuc-j23"),
    ("abb-irb1200-5-0.9", "none", "kuka-kr6-r900", "kuka"),
]


@pytest.mark.parametrize(("name", "coupling", "wrong", "wrong_coupling"), ALIKE)
def test_arms_that_are_nearly_alike_are_told_apart(
    name: str, coupling: str, wrong: str, wrong_coupling: str, tmp_path: Path
) -> None:
    rows, header = files_of_arm(name, coupling)
    read_dataset(write_files(tmp_path, rows, header))
    with pytest.raises(DataError) as caught:
        read_dataset(write_files(tmp_path, rows, header | {"robot": wrong, "joint_coupling": wrong_coupling}))
    counted = "" if coupling == wrong_coupling else f' and joint_coupling = "{coupling}"'
    assert f'Set robot = "{name}"{counted}.' in str(caught.value)


def test_no_other_arm_is_suspected_of_what_the_right_one_misses_by(tmp_path: Path) -> None:
    """No other arm is suspected because it fits better in a narrow sweep.

    In a sweep of joint 4, the IRB 120 misses by 0.9 mm; a KR 10 that is placed at its best fit misses by 0.1 mm.
    """
    what, cell, header = next(islice(odd_sets(327), 326, None))
    assert what == "sweep of joint 4 alone"
    cell.dataset(tmp_path, **header)


def test_a_robot_that_nothing_brings_near_its_readings_is_refused(tmp_path: Path) -> None:
    """Points sorted apart from their joints are refused: no change or parameter explains them."""
    rows, header, table = copy.deepcopy(GOOD["abb-irb120"])
    points = sorted((row["x_mm"], row["y_mm"], row["z_mm"]) for row in rows)
    for row, (x, y, z) in zip(rows, points, strict=True):
        row |= {"x_mm": x, "y_mm": y, "z_mm": z}
    assert refusal(tmp_path, (rows, header, table), own=False) == ""
    with pytest.raises(DataError, match="does not fit these readings: with its parameters fitted it still"):
        identify(read_dataset(tmp_path / "data.csv"))


def test_a_robot_whose_lengths_would_be_others_is_refused(tmp_path: Path) -> None:
    """An arm with an upper arm 80 mm longer than in the file is refused.

    A fit could turn any arm into any other.
    """
    cell = Cell(1)
    cell.add["a3"] += 80.0
    cell.measure("p", 60, noise=NOISE, validation=0)
    with pytest.raises(DataError, match=r"would have a3 = 3\d\d mm instead of 270"):
        identify(cell.dataset(tmp_path))


def test_a_robot_far_from_its_zeros_is_placed_where_nothing_else_is_freed(tmp_path: Path) -> None:
    """The error of a robot far from its zeros is reported if its zeros are not freed.

    With its zeros freed, the same readings are explained.
    """
    rows, header, _ = copy.deepcopy(GOOD["abb-irb120"])
    for row in rows:
        row["j2_deg"] += 10.0
        row["j3_deg"] -= 10.0
    data = read_dataset(write_files(tmp_path, rows, header | {"beyond_limits": True}))
    placed, fitted = identify(data, groups=("base",)), identify(data)
    assert placed.noise_scale > 100.0 * fitted.noise_scale


def test_a_joint_far_beyond_its_limit_is_refused_unless_the_header_allows_it(tmp_path: Path) -> None:
    rows, header, table = copy.deepcopy(GOOD["abb-irb120"])
    rows[6]["j4_deg"] = 300.0
    text = refusal(tmp_path, (rows, header, table), own=False)
    assert re.search(r"line 8: column 'j4_deg' is 300, and joint 4 .* from -160 to 160 deg", text), text
    assert refusal(tmp_path, (rows, header | {"beyond_limits": True}, table), own=False) == ""
    rows[6]["status"] = "rejected:typing error"
    assert refusal(tmp_path, (rows, header, table), own=False) == ""


def test_odd_sets_are_read(tmp_path: Path) -> None:
    for _, cell, header in islice(odd_sets(20), 20):
        cell.dataset(tmp_path, **header)


def test_a_joint_of_the_wrong_sign_shows_in_distances(tmp_path: Path) -> None:
    cell = Cell(place=POSE)
    cell.measure("l", 60 * len(BASE_TARGETS), noise=NOISE)
    for row in cell.rows:
        row["j3_deg"] = -row["j3_deg"]
    with pytest.raises(DataError, match="sign of the column j3_deg"):
        cell.dataset(tmp_path)


def test_base_and_unknown_tool_end_where_least_squares_does() -> None:
    """Base and unknown tool agree with least squares for a long tool and a narrow range.

    Alternating alignment and averaging converge slowly there.
    """
    rng = np.random.default_rng(5)
    robot, tool = load_robot("abb-irb120"), np.array([40.0, -30.0, 600.0])
    middle = RANGE.mean(axis=1)
    flange = forward(robot, middle + 0.15 * (rng.uniform(RANGE[:, 0], RANGE[:, 1], (60, 6)) - middle))
    there = flange[:, :3, 3] + flange[:, :3, :3] @ tool
    measured = there @ POSE[:3, :3].T + POSE[:3, 3] + rng.normal(0.0, 0.3, (60, 3))

    def left(x: np.ndarray) -> np.ndarray:
        arm = flange[:, :3, 3] + flange[:, :3, :3] @ x[6:]
        return (measured - arm @ Rotation.from_rotvec(x[:3]).as_matrix().T - x[3:6]).ravel()

    true = np.r_[Rotation.from_matrix(POSE[:3, :3]).as_rotvec(), POSE[:3, 3], tool]
    best = least_squares(left, true, loss="linear", x_scale=np.r_[np.ones(3), np.full(6, 100.0)])
    pose, found = base_and_tool(flange, np.zeros((1, 3)), np.zeros(60, np.int64), measured, tool_unknown=True)
    ours = left(np.r_[Rotation.from_matrix(pose[:3, :3]).as_rotvec(), pose[:3, 3], found[0]])
    assert np.sqrt(np.mean(ours**2)) < 1.02 * np.sqrt(np.mean(best.fun**2))


UNKNOWN_TOOL = {"model": {"fit": ["base", "geometry", "tool"]}}


@pytest.mark.parametrize("exchanged", [(1, 3), (4, 6)])
def test_joints_that_are_not_neighbours_are_found_exchanged_beside_an_unknown_tool(
    exchanged: tuple[int, int], tmp_path: Path
) -> None:
    rows, header = files_of_arm("abb-irb120", "none")
    one, other = (f"j{k}_deg" for k in exchanged)
    wrong = [row | {one: row[other], other: row[one]} for row in rows]
    text = refusal(tmp_path, (wrong, header | UNKNOWN_TOOL, {}), own=False)
    assert f"Swap the columns {one} and {other}." in text


def test_rows_that_slipped_show_though_the_robot_stays_long_at_every_pose(tmp_path: Path) -> None:
    rows, header = files_of_arm("abb-irb120", "none")
    stays = [dict(row) for row in rows for _ in range(12)]
    points = [[row[axis] for axis in ("x_mm", "y_mm", "z_mm")] for row in stays]
    for i, row in enumerate(stays):
        row |= dict(zip(("x_mm", "y_mm", "z_mm"), points[i - 1], strict=True))
    assert "1 row too late" in refusal(tmp_path, (stays, header | UNKNOWN_TOOL, {}), own=False)


def test_rows_that_slipped_by_less_than_the_nominal_robot_misses_are_named(tmp_path: Path) -> None:
    """Rows that slipped along a path with steps of some millimetres are named.

    Only the arm as built is nearer than the next row.
    """
    header, steps = files_of_arm("ur10", "none")[1], 400
    robot, rng = load_robot("ur10"), np.random.default_rng(2)
    phase = np.linspace(0.0, 3.0, steps)[:, None] * np.array([1.0, 0.9, 1.1, 1.3, 1.2, 1.4])
    joints = 1.2 * np.sin(phase + np.arange(6)) + 0.003 * rng.normal(size=(steps, 6))
    values = nominal_values(robot, joints)
    for k in range(1, 7):
        for kind, size in (("alpha", 0.1 * DEG), ("theta", 0.1 * DEG), ("a", 1.0), ("d", 1.0)):
            values[f"{kind}{k}"] = values[f"{kind}{k}"] + size * rng.normal()
    frames = propagate(Chain.of(robot), values, BasePoses())
    points = (frames.p + 60.0 * frames.x + 90.0 * frames.z).T
    points += 0.02 * rng.normal(size=points.shape)

    def written(late: int) -> list[Row]:
        table = np.hstack([joints[late:] / robot.joint_units, points[: steps - late]])
        columns = (*robot.joint_columns, "x_mm", "y_mm", "z_mm")
        return [dict(zip(columns, map(float, row), strict=True)) | {"set": "calibration"} for row in table]

    assert refusal(tmp_path, (written(0), header | UNKNOWN_TOOL, {}), own=False) == ""
    assert "1 row too late" in refusal(tmp_path, (written(1), header | UNKNOWN_TOOL, {}), own=False)


def test_a_mistake_is_named_where_the_tool_turns_in_a_few_points(tmp_path: Path) -> None:
    """A mistake is named for a ball in sockets 30 mm apart.

    The nominal arm misses a twentieth of the span of readings and flange.
    """
    robot, rng = load_robot("abb-irb120"), np.random.default_rng(8)
    tool, home = np.array([0.0, 0.0, 60.0]), np.radians([10.0, 20.0, -10.0, 30.0, 60.0, 0.0])
    at = forward(robot, home[None])[0]
    sockets = (at[:3, :3] @ tool + at[:3, 3]) + rng.uniform(-15.0, 15.0, (4, 3))
    joints, points = [], []
    while len(joints) < 40:
        turn = at[:3, :3] @ Rotation.from_rotvec(rng.uniform(-0.6, 0.6, 3)).as_matrix()
        flange = np.eye(4)
        socket = sockets[len(joints) % 4]
        flange[:3, :3], flange[:3, 3] = turn, socket - turn @ tool
        reached = inverse_kinematics(robot, flange[None], seed=home[None])
        near = reached.joints[0][np.all(np.isfinite(reached.joints[0]), axis=1)]
        if len(near):
            joints.append(near[np.argmin(np.abs(near - home).max(axis=1))])
            points.append(socket + rng.normal(0.0, 1.0, 3))
    table = np.hstack([np.degrees(joints), points])
    columns = (*robot.joint_columns, "x_mm", "y_mm", "z_mm")
    good = [dict(zip(columns, map(float, row), strict=True)) | {"set": "calibration"} for row in table]
    header = files_of_arm("abb-irb120", "none")[1] | {"tool_targets": {"T1": tool.tolist()}} | UNKNOWN_TOOL
    wrong = [row | {"j4_deg": -float(row["j4_deg"])} for row in good]
    assert refusal(tmp_path, (good, header, {}), own=False) == ""
    assert "joint 4 turns in the other direction" in refusal(tmp_path, (wrong, header, {}), own=False)


MEASURED = {"ball in sockets": Path("mukca/k14"), "repeated stays": Path("fanuc_r2000_leica/fanuc_r2000")}


@pytest.mark.parametrize("kind", MEASURED)
@pytest.mark.parametrize(
    "mistake", ["Swap the columns j4_deg and j6_deg", "Change the sign of the column j4_deg"]
)
def test_mistakes_beside_readings_of_real_arms_are_named(kind: str, mistake: str, tmp_path: Path) -> None:
    source = SHARED / "data" / MEASURED[kind]
    if not source.with_suffix(".csv").exists():
        pytest.skip("the measured data are not here")
    for file in source.parent.glob("*.toml"):
        shutil.copy(file, tmp_path)
    with source.with_suffix(".csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    for row in rows:
        if "Swap" in mistake:
            row["j4_deg"], row["j6_deg"] = row["j6_deg"], row["j4_deg"]
        else:
            row["j4_deg"] = repr(-float(row["j4_deg"]))
    header = tomllib.loads(source.with_suffix(".toml").read_text("utf-8"))
    assert mistake in refusal(tmp_path, (rows, header, {}), own=False)
