"""Test poses solved from six legs, as a data set of points.

These would catch: legs in another order, the wrong assembly mode, a frame that differs from that of the stated
cups, and sides of a triangle that are stated although they were measured. They would also catch an uncertainty that
is not that of the legs, and a leg under another label that passes for a pose.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from acquisition.cell.reach import configurations
from calib import DataError, forward, identify, read_dataset
from calib.arm.start import align
from calib.convert import IMPORTERS
from calib.convert.hexapod_legs import solved_poses
from mocks.world import ArmState
from tests.calib.campaigns import write_files
from tests.calib.test_spans import _CELL, _VISITS, BALLS, LEGS, SIDES, TRUTH, dataset, header_of, span

SPANS = [span(*side) for side in SIDES]


def true_points(names: list[tuple[int, str]]) -> np.ndarray:
    """Compute the true positions of tool balls, (n, 3), by number of the visit and name."""
    out = []
    for number, ball in names:
        visit = _VISITS[::3][number]
        angles, before = np.degrees(_CELL.robot.model_angles([visit.joints_deg, visit.approach_deg]))
        rest = angles + np.degrees(TRUTH.world.arrival_error(number))
        state = ArmState(tuple(rest), tuple(before), visit.sides, 20.0 * number, reading=number)
        out.append(TRUTH.world.true_point(state, ball))
    return np.array(out)


def test_solved_poses_are_where_the_balls_really_were(tmp_path: Path) -> None:
    solved = solved_poses(dataset(tmp_path, SPANS))
    assert len(solved.visits) == len(_VISITS[::3])
    number = {visit.joints_deg: k for k, visit in enumerate(_VISITS[::3])}
    names = [
        (number[tuple(LEGS[visit.rows[0]][f"j{k}_deg"] for k in range(1, 7))], ball)
        for visit in solved.visits
        for ball in visit.tool
    ]
    truth, found = true_points(names), solved.points.reshape(-1, 3)
    # the frame is that of the stated cups: rigidly beside the true one by what the cups are off
    turn, shift = align(truth, found, np.ones(len(truth)))
    left = np.abs(found - truth @ turn.T - shift)
    assert left.max() < 6.0 * solved.u_mm.max()
    assert left.max() < 0.02
    assert 0.0005 < np.median(solved.u_mm) < 0.004
    cups = np.array([np.subtract(_CELL.nests[name], BALLS[name]) for name in _CELL.nests])
    assert np.linalg.norm((found - truth).mean(axis=0) - cups.mean(axis=0)) < 0.3


def test_sides_that_were_not_measured_are_the_stated_ones(tmp_path: Path) -> None:
    with_sides, without = (
        solved_poses(dataset(tmp_path / name, spans)) for name, spans in (("a", SPANS), ("b", []))
    )
    assert np.abs(with_sides.points - without.points).max() > 0.05
    assert without.u_mm.min() > 5.0 * with_sides.u_mm.max()


def test_the_data_set_of_points_is_identified(tmp_path: Path) -> None:
    legs = dataset(tmp_path, SPANS)
    IMPORTERS["hexapod-legs"](legs.path).write(tmp_path / "points.csv")
    points = read_dataset(tmp_path / "points.csv")
    assert len(points) == 3 * len(_VISITS[::3])
    assert set(points.sets) == {"calibration", "validation"}
    one, two = (found.estimate[found.model.index["theta3"]] for found in (identify(legs), identify(points)))
    assert one == pytest.approx(two, abs=2e-4)


def test_a_leg_under_another_label_is_no_pose(tmp_path: Path) -> None:
    first = [dict(row) for row in LEGS[:6]]
    first[0]["length_mm"] += 160.0  # as long as to another ball
    legs = [*first, *LEGS[6:]]
    solved = solved_poses(dataset(tmp_path, SPANS, legs))
    assert (solved.far_mm > 30.0).sum() == 1
    IMPORTERS["hexapod-legs"](tmp_path / "data.csv").write(tmp_path / "points.csv")
    points = read_dataset(tmp_path / "points.csv")
    assert int(points.usable.sum()) == 3 * (len(solved.visits) - 1)
    rejected = points.status[~points.usable]
    assert len(rejected) == 3
    assert all("mm from where the robot is" in why for why in rejected)


def test_five_legs_are_no_standing(tmp_path: Path) -> None:
    legs = [row for k, row in enumerate(LEGS) if k % 6]
    with pytest.raises(DataError, match="no visit of the robot in which all six legs"):
        solved_poses(dataset(tmp_path, SPANS, legs))


def test_legs_of_two_visits_of_a_pose_are_two_poses(tmp_path: Path) -> None:
    """Legs of two visits make two poses, since the arm comes to rest elsewhere.

    Legs of one arrival mixed with those of another make a pose that never was.
    """
    again = [row | {"visit": "1", "reading_id": f"{row['reading_id']}-again"} for row in LEGS[:6]]
    again = [row | {"length_mm": float(row["length_mm"]) + 0.02} for row in again]
    once = [row | {"visit": f"{k // 6 + 2}"} for k, row in enumerate(LEGS)]
    solved, plain = (
        solved_poses(dataset(tmp_path / name, SPANS, legs))
        for name, legs in (("twice", [*once, *again]), ("once", once))
    )
    assert len(solved.visits) == len(plain.visits) + 1
    ends = [sorted(visit.rows)[0] for visit in solved.visits]
    first, second = solved.points[ends.index(0)], solved.points[ends.index(len(LEGS))]
    np.testing.assert_allclose(first, plain.points[[min(v.rows) for v in plain.visits].index(0)])
    assert np.abs(second - first).max() > 0.01
    # a visit that lacks a leg is no pose of its own: its other legs do not take the place of the first visit's
    mixed = solved_poses(dataset(tmp_path / "mixed", SPANS, [*once, *again[1:]]))
    np.testing.assert_allclose(mixed.points, plain.points)


def test_a_leg_taken_again_later_completes_its_pose(tmp_path: Path) -> None:
    visits = [row | {"visit": f"{k // 6 + 2}"} for k, row in enumerate(LEGS)]
    late = visits[3] | {"visit": "late"}
    solved = solved_poses(dataset(tmp_path, SPANS, [*visits[:3], *visits[4:], late]))
    assert len(solved.visits) == len(LEGS) // 6


def test_legs_taken_in_two_visits_are_solved_where_the_pose_is_whole_in_another_set(tmp_path: Path) -> None:
    """A pose visited once to fit and once to judge, with one leg repeated later, is kept twice."""
    fitted = [row | {"visit": "once", "set": "calibration"} for row in LEGS[:6]]
    held = [
        row | {"visit": "held", "set": "validation", "reading_id": f"{row['reading_id']}-held"}
        for row in LEGS[:6]
    ]
    held[3]["visit"] = "late"
    legs = [*fitted, *held, *LEGS[6:]]
    data = dataset(tmp_path, SPANS, legs)
    solved = solved_poses(data)
    assert len(solved.visits) == len(LEGS) // 6 + 1
    assert {str(data.sets[visit.rows[0]]) for visit in solved.visits if min(visit.rows) < 12} == {
        "calibration",
        "validation",
    }


def test_a_cup_without_a_position(tmp_path: Path) -> None:
    header = header_of(_CELL, {k: v for k, v in _CELL.nests.items() if k != "B3"}, _CELL.tool.targets)
    header["base_targets"]["B3"] = "free"
    with pytest.raises(DataError, match="has no position of B3"):
        solved_poses(read_dataset(write_files(tmp_path, LEGS, header)))


def test_joints_of_another_branch_are_no_pose(tmp_path: Path) -> None:
    """Joints typed in with the wrist flipped are no pose.

    A flip that omits one joint is no pose; a whole flip is no reading.
    """
    typed = np.array([[LEGS[0][f"j{k}_deg"] for k in range(1, 7)]])
    flange = forward(_CELL.robot.model, _CELL.robot.model_angles(typed))
    found = configurations(_CELL, flange)[0]
    others = found[np.isfinite(found).all(axis=1) & (np.abs(found - typed).max(axis=1) > 1.0)]
    assert len(others)
    half = typed[0] * [1, 1, 1, 1, -1, 1]
    for name, joints in (("half", half), ("whole", others[0])):
        new = {f"j{k}_deg": float(q) for k, q in enumerate(joints, start=1)}
        legs = dataset(tmp_path / name, SPANS, [*(row | new for row in LEGS[:6]), *LEGS[6:]])
        ids = [legs.reading_id[i] for i in np.flatnonzero(legs.spanned)[:6]]
        if name == "half":
            solved = solved_poses(legs)
            assert (solved.far_mm > 30.0).sum() == 1
        rejected = set(identify(legs).faulty_rows)
        assert rejected
        assert rejected <= set(ids)
