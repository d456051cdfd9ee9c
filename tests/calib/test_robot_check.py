"""Test the check of a robot file against a few readings.

These would catch: a usual mistake named wrong or not at all, a proposed line that does not mend the file, and a
good file that is accused. The benchmark `robot_check` counts over ten arms.
"""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib.arm.robot import BUILT_IN, load_robot
from calib.errors import DataError
from calib.robot_file import RobotFileVerdict, described, held_against, read_handful
from calib.robot_file.misread import line_of
from calib.units import DEG
from tests.benchmarks.robot_check import TARGETS, arms, mistakes, named, readings_of

ARMS = arms()
CASES = {
    f"{arm}, {kind}, {words}": (file, counted, which, points, words)
    for arm in ("ur5", "SCARA")
    for joints, which, measured in [readings_of(replace(ARMS[arm], name="own"), 1)]
    for kind, file, counted, points, words in mistakes(replace(ARMS[arm], name="own"), joints, measured)
    if arm == "SCARA" or not kind.startswith("zero") or "joint 4" in words
}


@pytest.mark.parametrize("case", CASES)
def test_a_usual_mistake_is_named(case: str) -> None:
    file, joints, which, points, words = CASES[case]
    assert any(re.search(words, what) for what in named(file, joints, which, points))


@pytest.mark.parametrize("arm", ["six on a track", "seven axes"])
def test_a_good_file_is_not_accused(arm: str) -> None:
    robot = replace(ARMS[arm], name="own")
    assert named(robot, *readings_of(robot, 2)) == ()


GOOD = (BUILT_IN / "ur10.toml").read_text("utf-8").replace('name = "ur10"', 'name = "own"')


def readings(folder: Path, header: str = "", counted: np.ndarray | None = None) -> Path:
    """Write 20 readings of a real UR10 to a file.

    The joints of the file are `counted` (6, 6) times those of the arm.
    """
    joints, which, points = readings_of(load_robot("ur10"), 3)
    shown = np.degrees(joints @ (np.eye(6) if counted is None else counted).T)
    names = [f"j{k}_deg" for k in range(1, 7)] + ["tool_target", "x_mm", "y_mm", "z_mm"]
    rows = [
        [*(f"{x:.5f}" for x in q), f"T{t}", *(f"{x:.4f}" for x in p)]
        for q, t, p in zip(shown, which, points, strict=True)
    ]
    path = folder / "few.csv"
    path.write_text("\n".join(",".join(row) for row in [names, *rows]) + "\n", "utf-8")
    if header:
        path.with_suffix(".toml").write_text(header, "utf-8")
    return path


HEADER = "[tool_targets]\n" + "\n".join(f"T{i} = {t.tolist()}" for i, t in enumerate(TARGETS))


def verdict_of(folder: Path, text: str, data: Path, coupling: str | None = None) -> RobotFileVerdict:
    (folder / "own.toml").write_text(text, "utf-8")
    handful = read_handful(load_robot("own.toml", folder), data, coupling)
    return held_against(folder / "own.toml", text, handful)


@pytest.mark.parametrize("header", ["", HEADER])
@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('convention = "dh"', 'convention = "mdh"'),
        ("a_mm = -612.0", "a_mm = 612.0"),
        ("theta_deg = 0.0\nd_mm = 163.941", "theta_deg = 90.0\nd_mm = 163.941"),
        ("theta_deg = 0.0\nd_mm = 163.941", "theta_deg = -180.0\nd_mm = 163.941"),
    ],
)
def test_the_line_that_is_told_mends_the_file(old: str, new: str, header: str, tmp_path: Path) -> None:
    text = re.sub(r"parallel_axes.*", "", GOOD)
    assert old in text
    data = readings(tmp_path, header)
    assert verdict_of(tmp_path, text, data).explained
    bad = text.replace(old, new, 1)
    found = verdict_of(tmp_path, bad, data)
    told = re.match(r"own\.toml, line (\d+): (\w+ = \S+)", found.mistakes[0].lines[0])
    assert told is not None, found
    lines = bad.splitlines()
    assert lines[int(told[1]) - 1].split()[0] == told[2].split()[0]
    lines[int(told[1]) - 1] = told[2]
    assert verdict_of(tmp_path, "\n".join(lines), data).explained


@pytest.mark.parametrize("several", [False, True])
def test_the_joint_matrix_that_is_told_mends_the_counting(several: bool, tmp_path: Path) -> None:
    """The reported joint matrix corrects the counting of a Fanuc.

    Joint 3 counts with joint 2; in the second case, joints 3 to 6 also count in the other direction.
    """
    model = np.diag([1.0, 1.0, -1.0, -1.0, -1.0, -1.0]) if several else np.eye(6)
    model[2, 1] = -1.0
    data = readings(tmp_path, HEADER, np.linalg.inv(model))
    found = verdict_of(tmp_path, GOOD, data)
    assert "coupled" in found.mistakes[0].what
    block = "\n".join(line.strip() for line in found.mistakes[0].lines if line.startswith("    "))
    mended = GOOD.replace("[[link]]", f"{block}\n\n[[link]]", 1)
    assert verdict_of(tmp_path, mended, data, "counted").explained
    np.testing.assert_allclose(load_robot("own.toml", tmp_path).joint_matrices["counted"].matrix, model)


def test_what_nothing_explains_is_not_called_by_a_name(tmp_path: Path) -> None:
    data = readings(tmp_path, HEADER)
    lines = data.read_text("utf-8").splitlines()
    points = sorted(line.rsplit(",", 3)[1:] for line in lines[1:])
    mixed = [",".join([line.rsplit(",", 3)[0], *p]) for line, p in zip(lines[1:], points, strict=True)]
    data.write_text("\n".join([lines[0], *mixed]) + "\n", "utf-8")
    found = verdict_of(tmp_path, GOOD, data)
    assert (found.mistakes, found.explained) == ((), False)


def test_too_few_readings_and_missing_columns_are_refused(tmp_path: Path) -> None:
    data = readings(tmp_path)
    text = data.read_text("utf-8")
    data.write_text("\n".join(text.splitlines()[:7]), "utf-8")
    with pytest.raises(DataError, match="has 6 readings of one series"):
        verdict_of(tmp_path, GOOD, data)
    data.write_text(text.replace("j3_deg", "A3"), "utf-8")
    with pytest.raises(DataError, match="column 'j3_deg' is missing"):
        verdict_of(tmp_path, GOOD, data)


def test_lines_are_found_in_the_right_table() -> None:
    at = line_of(GOOD, "a_mm", 3)
    assert at is not None
    assert GOOD.splitlines()[at - 1] == "a_mm = -572.3"
    assert line_of(GOOD, "a_mm", 7) is None
    assert line_of(GOOD, "mass_kg", 2) is None


def test_figures_of_an_arm_are_those_of_its_data_sheet() -> None:
    """The described dimensions of an IRB 120 are those of its data sheet.

    The flange is at [374, 0, 630] with all joints at zero. The axes of its wrist meet; the reach is 580 mm to the
    wrist.
    """
    robot = load_robot("abb-irb120")
    found = described(robot, np.radians([0.0, 0.0, 0.0, 0.0, 30.0, 0.0]))
    np.testing.assert_allclose(found.postures["all zero"][1][:3, 3], [374.0, 0.0, 630.0], atol=1e-9)
    assert set(found.postures) == {"all zero", "middle of the ranges", "home"}
    assert found.wrist == "spherical: axes 4, 5, 6 meet in [302, 0, 630] mm at all zero"
    assert found.inverse == "in closed form, spherical wrist"
    assert 580.0 < found.reach_mm < 580.0 + 72.0
    assert found.remarks == ()


def test_what_is_odd_is_said() -> None:
    robot = load_robot("abb-irb120")
    nearly = described(replace(robot, a=(*robot.a[:4], 0.4, 0.0)))
    assert any("Axes 4 and 5 nearly meet, at 0.4 mm" in remark for remark in nearly.remarks)
    assert nearly.wrist.startswith("not spherical")
    metres = described(replace(robot, a=tuple(x / 1e3 for x in robot.a), d=tuple(x / 1e3 for x in robot.d)))
    assert any("in metres?" in remark for remark in metres.remarks)
    radians = described(replace(robot, alpha=tuple(x * DEG for x in robot.alpha), theta=(0.0,) * 6))
    assert any("in radians?" in remark for remark in radians.remarks)
    off = described(replace(robot, lower=(robot.lower[0], 0.2, *robot.lower[2:])))
    assert any("All zero lies outside the limits of j2" in remark for remark in off.remarks)
    untwisted = described(replace(robot, parallel_axes=()))
    assert any("Axes 2 and 3 are parallel" in remark for remark in untwisted.remarks)
