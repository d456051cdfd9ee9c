"""Test sides of approach for coupled joints: a model joint may rest while two turn."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from calib.data.read import read_dataset
from calib.diagnose.diagnosis import diagnose
from tests.service.campaigns import Rows, edit_rows, write_data

HEADER = """
format = "truepose-dataset/1"
robot = "fanuc-lrmate200ic"
instrument = "test"
world = "nominal"
joint_coupling = "fanuc-j23"
[noise]
kind = "isotropic"
sigma_mm = 0.1
[tool_targets]
T1 = [0.0, 0.0, 100.0]
"""
# Model joint 3 is -(j2 + j3). j2, j3 and the 5 deg from which each came:
MOVES = (
    (10.0, -20.0, 5.0, 5.0),  # j3 of the model goes down
    (12.0, -26.0, 5.0, -5.0),  # stands still: came up on the way there, from 10 to 14
    (21.0, -10.0, -5.0, 5.0),  # stands still: came down on the way there
    (21.0, -10.0, 5.0, -5.0),  # has not moved at all since
    (20.3, -30.7, -5.0, -5.0),  # goes up
)


def test_a_joint_that_two_turn_has_the_side_of_its_last_move(tmp_path: Path) -> None:
    names = [f"j{k}_deg" for k in range(1, 7)] + [f"prev{k}_deg" for k in range(1, 7)]
    names += [f"approach{k}" for k in range(1, 7)]
    lines = [",".join(["reading_id", "set", "t_s", *names, "tool_target", "x_mm", "y_mm", "z_mm"])]
    for i, (j2, j3, from2, from3) in enumerate(MOVES):
        joints = [0.0, j2, j3, 30.0, 40.0, 50.0]
        before = [-5.0, j2 - from2, j3 - from3, 25.0, 35.0, 45.0]
        sides = [1, np.sign(from2), np.sign(from3), 1, 1, 1]
        row = [i, "calibration", 10.0 * i, *joints, *before, *sides, "T1", 300.0 + 10.0 * i, 0.0, 400.0]
        lines.append(",".join(str(each) for each in row))
    (tmp_path / "d.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    (tmp_path / "d.toml").write_text(HEADER, encoding="utf-8")
    conditions = read_dataset(tmp_path / "d.csv").conditions
    np.testing.assert_array_equal(conditions.side[:, 2], [-1, 1, -1, -1, 1])
    np.testing.assert_array_equal(conditions.side[:, 1], [1, 1, -1, 1, -1])
    np.testing.assert_array_equal(conditions.side[:, 3:], -np.ones((5, 3)))  # these count the other way
    turned = conditions.joints[:, 2] - conditions.previous[:, 2]
    np.testing.assert_allclose(np.degrees(turned), [-10.0, 0.0, 0.0, 0.0, 10.0], atol=1e-9)


def test_a_file_without_arrivals_says_what_stood_in(tmp_path: Path) -> None:
    """A file without arrivals states that the order of rows was used.

    Sides from that order are wrong if the robot went over other points, and backlash is not found.
    """
    told = write_data(tmp_path, n=40)
    assert read_dataset(told).arrivals_told

    def forget(rows: Rows) -> None:
        rows[:] = [{k: v for k, v in r.items() if not k.startswith(("approach", "prev"))} for r in rows]

    edit_rows(told, forget)
    data = read_dataset(told)
    assert not data.arrivals_told
    assert any("order of the rows" in note for note in diagnose(data).notes)
