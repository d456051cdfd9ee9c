"""The plan and its check: what may be driven is known before anything moves."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from acquisition.campaign.plan import Visit, check_plan, make_plan
from acquisition.cell.workspace import targets_at
from acquisition.errors import UnsafePlan
from calib.arm.kinematics import forward
from drivers.errors import ConfigError
from tests.acquisition.fakes import CAMPAIGN, a_campaign, a_cell


def poses_of(visits: list[Visit]) -> list[Visit]:
    return [visit for visit in visits if visit.kind == "pose"]


def test_nests_come_first_and_the_plan_is_checked() -> None:
    cell = a_cell()
    visits = make_plan(cell, a_campaign(block=[{"count": 200}]))
    assert [visit.targets for visit in visits[:3]] == [("N1",), ("N2",), ("N3",)]
    assert len(poses_of(visits)) == 200
    check_plan(cell, visits)
    low, high = np.array(cell.robot.limits_deg).T
    for visit in poses_of(visits):
        for joints in (visit.joints_deg, visit.approach_deg):
            assert np.all((np.array(joints) >= low) & (np.array(joints) <= high))
            assert targets_at(cell, np.array([joints]))[..., 2].min() > 20.0
        away = np.array(visit.joints_deg) - np.array(visit.approach_deg)
        assert 5.0 <= abs(away[0]) <= 15.0
        assert away == pytest.approx(abs(away[0]) * np.array(visit.sides), abs=1e-9)


def lengths_of(**settings: Any) -> list[float]:
    """Return the distance of the last approach of every pose, deg."""
    visits = poses_of(make_plan(a_cell(), a_campaign(**settings)))
    return [round(abs(v.joints_deg[0] - v.approach_deg[0]), 4) for v in visits]


@pytest.mark.parametrize("select", ["random", "observability"])
def test_last_moves_to_drawn_poses_are_of_many_lengths(select: str) -> None:
    """Moves of one length make settling and lost motion the same column."""
    block = [{"count": 30, "select": select, "targets": ["T2"]}]
    lengths = lengths_of(approach={"offset_deg": -5.0}, block=block)
    assert min(lengths) >= 5.0
    assert max(lengths) <= 15.0
    assert np.std(lengths) > 1.5
    assert len(set(lengths)) > 25
    stated = lengths_of(approach={"offset_deg": 4.0, "longest_deg": 6.0}, block=block)
    assert 4.0 <= min(stated) < max(stated) <= 6.0
    assert set(lengths_of(approach={"offset_deg": -5.0, "longest_deg": 5.0}, block=block)) == {5.0}


def test_lengths_leave_poses_and_sides_as_they_are() -> None:
    """A longer approach may rule a pose out, but the drawn poses stay the same."""
    block = [{"count": 200}]
    varied, fixed = (
        {v.joints_deg: v.sides for v in poses_of(make_plan(a_cell(), a_campaign(approach=a, block=block)))}
        for a in ({"sides": "both"}, {"sides": "both", "longest_deg": 5.0})
    )
    both = varied.keys() & fixed.keys()
    assert len(both) > 150
    assert all(varied[pose] == fixed[pose] for pose in both)


def test_given_poses_and_repeated_ones_keep_the_length_they_have() -> None:
    given = {"select": "list", "joints_deg": [[0, 50, 0, 0, 40, 0], [10, 40, 10, 20, 30, 40]]}
    assert set(lengths_of(approach={"offset_deg": -5.0}, block=[given])) == {5.0}
    asked = lengths_of(approach={"offset_deg": -5.0, "longest_deg": 9.0}, block=[given])
    assert 5.0 < min(asked) < max(asked) <= 9.0
    repeat = {"kind": "repeat", "count": 2, "visits": 3, "targets": ["T2"]}
    assert set(lengths_of(approach={"offset_deg": -5.0}, block=[repeat])) == {5.0}


def test_both_sides_are_drawn_for_every_joint_and_one_side_is_from_below() -> None:
    both = np.array([v.sides for v in poses_of(make_plan(a_cell(), a_campaign(block=[{"count": 300}])))])
    assert set(np.unique(both)) == {-1, 1}
    assert np.all(np.abs(both.mean(axis=0)) < 0.35)
    joints = np.array(
        [v.joints_deg for v in poses_of(make_plan(a_cell(), a_campaign(block=[{"count": 300}])))]
    )
    assert joints.shape == (300, 6)
    one = a_campaign(approach={"offset_deg": -5.0}, block=[{"count": 5}])
    assert {s for v in poses_of(make_plan(a_cell(), one)) for s in v.sides} == {1}
    above = a_campaign(approach={"offset_deg": 5.0}, block=[{"count": 5}])
    assert {s for v in poses_of(make_plan(a_cell(), above)) for s in v.sides} == {-1}


def test_the_seed_decides() -> None:
    plans = [make_plan(a_cell(), a_campaign(seed=seed)) for seed in (1, 1, 2)]
    assert plans[0] == plans[1] != plans[2]


def test_shuffled_order_keeps_every_pose() -> None:
    blocks = [{"set": "calibration", "count": 20}, {"set": "validation", "count": 20}]
    straight = make_plan(a_cell(), a_campaign(block=blocks))
    mixed = make_plan(a_cell(), a_campaign(block=blocks, order="shuffled"))
    assert {v.joints_deg for v in straight} == {v.joints_deg for v in mixed}
    first = [v.set for v in poses_of(mixed)[:20]]
    assert {"calibration", "validation"} <= set(first)
    assert [v.number for v in mixed] == list(range(len(mixed)))


def test_reference_pose_every_so_many_readings() -> None:
    visits = poses_of(make_plan(a_cell(), a_campaign(reference_every=6, block=[{"count": 10}])))
    references = [i for i, visit in enumerate(visits) if visit.set == "reference"]
    assert references == [0, 3, 6, 9, 12, 15][: len(references)]
    assert len({visits[i].joints_deg for i in references}) == 1
    assert visits[0].targets == ("T1",)


def test_one_smr_visits_target_after_target() -> None:
    visits = poses_of(make_plan(a_cell(instrument__one_smr=True), a_campaign()))
    assert [v.targets for v in visits] == [("T1",), ("T1",), ("T2",), ("T2",), ("T3",)]


GOOD = [10.0, 40.0, -20.0, 30.0, 20.0, 60.0]


@pytest.mark.parametrize(
    ("joints", "cell", "words"),
    [
        ([95.0, *GOOD[1:]], {}, ["pose 2 of block 1", "joint 1", "95"]),
        ([10.0, 2.0, *GOOD[2:]], {}, ["approach point of pose 2 of block 1", "joint 2", "-3"]),
        ([float("inf"), *GOOD[1:]], {}, []),
        ([0.0, 100.0, -20.0, 0.0, 0.0, 0.0], {}, ["pose 2 of block 1", "table_z_mm"]),
        (GOOD, {"robot__keep_out": [[[-900, -900, 0], [900, 900, 1500]]]}, ["pose 1", "keep-out"]),
    ],
)
def test_unsafe_pose_is_named(joints: list[float], cell: dict[str, Any], words: list[str]) -> None:
    block = {"select": "list", "joints_deg": [GOOD, joints]}
    if not words:
        with pytest.raises(ConfigError):
            a_campaign(block=[block])
        return
    campaign = a_campaign(approach={"offset_deg": -5.0}, block=[block])
    the_cell = a_cell(**cell)
    visits = make_plan(the_cell, campaign)
    with pytest.raises(UnsafePlan) as caught:
        check_plan(the_cell, visits)
    assert all(word in str(caught.value) for word in words), caught.value
    assert caught.value.exit_code == 5


def test_unknown_target_and_wrong_number_of_joints() -> None:
    with pytest.raises(ConfigError, match="T9"):
        make_plan(a_cell(), a_campaign(block=[{"count": 1, "targets": ["T9"]}]))
    with pytest.raises(ConfigError, match="2 joints"):
        make_plan(a_cell(), a_campaign(block=[{"select": "list", "joints_deg": [[1, 2]]}]))


def test_a_cell_without_room_says_so() -> None:
    with pytest.raises(ConfigError, match="random poses clear"):
        make_plan(a_cell(robot__table_z_mm=5000.0), a_campaign())
    tight = [[-90, 90], [0, 110], [-80, 70], [-150, 150], [-90, 90], [-4, 4]]
    with pytest.raises(ConfigError, match="joint 6"):
        make_plan(a_cell(robot__limits_deg=tight), a_campaign())


def test_the_arm_is_looked_at_from_the_elbow_to_the_targets() -> None:
    cell = a_cell()
    joints = np.array([GOOD, [0.0] * 6])
    lines = cell.clearance.arm.lines(joints)
    flange = forward(cell.robot.model, np.radians(joints))[:, :3, 3]
    for i in range(2):
        for place in (flange[i], *targets_at(cell, joints)[i]):
            assert np.min(np.linalg.norm(lines[i].reshape(-1, 3) - place, axis=1)) < 1e-9
    assert CAMPAIGN["block"]  # the shared table was not changed by any test above
