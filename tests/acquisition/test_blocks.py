"""Kinds of blocks: the rules that every plan keeps, and readers that recognise the rows."""

from __future__ import annotations

from collections import Counter
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from acquisition import Cell, Run, export
from acquisition.campaign import Visit, make_plan
from acquisition.campaign.blocks.sphere import cap
from acquisition.campaign.plan import check_plan
from acquisition.cell import targets_at
from acquisition.cell.workspace import facing
from acquisition.errors import UnsafePlan
from calib import Dataset, read_dataset
from calib.fit.circle_points import find_sweeps, starts
from calib.validation.iso9283 import pose_repeatability, repeated_poses
from drivers import ConfigError
from tests.acquisition.fakes import Bench, JumpingClock, a_campaign, a_cell, devices_of

CELL = a_cell()
ONE_SIDE = {"offset_deg": -5.0, "sides": "one"}
TAUGHT = [0.0, 40.0, 20.0, 0.0, 30.0, 0.0]
GOOD = [[10.0, 40.0, -20.0, 30.0, 20.0, 60.0], [-10.0, 50.0, -30.0, 60.0, 40.0, -60.0]]


def poses_of(visits: list[Visit]) -> list[Visit]:
    return [visit for visit in visits if visit.kind == "pose"]


def plan_of(*blocks: dict[str, Any], cell: Cell = CELL, **campaign: Any) -> list[Visit]:
    campaign = {"approach": ONE_SIDE} | campaign
    return poses_of(make_plan(cell, a_campaign(block=list(blocks), **campaign)))


def measured(folder: Path, *blocks: dict[str, Any], **campaign: Any) -> Dataset:
    """The data set of a campaign on fakes."""
    campaign = {"approach": ONE_SIDE} | campaign
    with Run.create(folder / "r", CELL, a_campaign(block=list(blocks), **campaign), simulated=True) as run:
        assert run.execute(devices_of(Bench(CELL)), JumpingClock()).state.value == "succeeded"
    return read_dataset(export(folder / "r", folder / "data.csv"))


@st.composite
def sweeps(draw: st.DrawFn) -> dict[str, Any]:
    block: dict[str, Any] = {
        "kind": "sweep",
        "joint": draw(st.integers(1, 6)),
        "step_deg": draw(st.floats(3.0, 20.0)),
        "both_ways": draw(st.booleans()),
    }
    if draw(st.booleans()):
        low, high = CELL.robot.limits_deg[block["joint"] - 1]
        begin = draw(st.floats(low + 6.0, high - 36.0))
        block["range_deg"] = [begin, draw(st.floats(begin + 25.0, high - 6.0))]
    return block


APPROACHES = st.fixed_dictionaries(
    {"offset_deg": st.sampled_from([-5.0, -2.5, 4.0]), "sides": st.sampled_from(["one", "both"])}
)
SHARED = st.fixed_dictionaries(
    {},
    optional={
        "targets": st.sampled_from([["T1"], ["T2", "T3"]]),
        "approach": APPROACHES,
        "settle_s": st.just(1.0),
    },
)
BLOCKS = st.one_of(
    st.fixed_dictionaries(
        {"count": st.integers(1, 12), "set": st.sampled_from(["calibration", "validation"])}
    ),
    sweeps(),
    st.fixed_dictionaries(
        {
            "kind": st.just("repeat"),
            "count": st.integers(1, 4),
            "visits": st.integers(2, 6),
            "order": st.sampled_from(["interleaved", "row"]),
        }
    ),
    st.fixed_dictionaries({"kind": st.just("circle_point"), "width_deg": st.floats(30.0, 45.0)}),
)
SPHERES = st.fixed_dictionaries(
    {
        "kind": st.just("sphere"),
        "centre_deg": st.just(TAUGHT),
        "radius_mm": st.floats(100.0, 300.0),
        "count": st.integers(2, 20),
        "targets": st.sampled_from([["T1"], ["T2"]]),
    }
)


@given(
    blocks=st.lists(st.builds(lambda a, b: a | b, BLOCKS, SHARED), min_size=1, max_size=3),
    sphere=st.lists(SPHERES, max_size=1),
    seed=st.integers(0, 2**31),
    reference_every=st.integers(0, 9),
    shuffled=st.booleans(),
    one_smr=st.booleans(),
)
def test_every_plan(
    blocks: list[dict[str, Any]],
    sphere: list[dict[str, Any]],
    seed: int,
    reference_every: int,
    shuffled: bool,
    one_smr: bool,
) -> None:
    cell = a_cell(instrument__one_smr=one_smr)
    campaign = a_campaign(
        block=blocks + sphere,
        seed=seed,
        reference_every=reference_every,
        order="shuffled" if shuffled else "blocks",
        approach=ONE_SIDE,
    )
    visits = make_plan(cell, campaign)
    check_plan(cell, visits)
    assert [visit.number for visit in visits] == list(range(len(visits)))
    low, high = np.array(cell.robot.limits_deg).T
    for visit in poses_of(visits):
        block = campaign.blocks[visit.block]
        pose, start = np.array(visit.joints_deg), np.array(visit.approach_deg)
        assert np.all((pose >= low) & (pose <= high) & (start >= low) & (start <= high))
        assert np.array_equal(pose, np.round(pose, 4))
        away = pose - start
        if visit.set == "reference":
            assert visit.sides == (-1 if campaign.blocks[0].approach.offset_deg > 0 else 1,) * 6
            assert np.ptp(np.abs(away)) < 1e-9
        elif block.kind != "sphere":
            length, shortest = float(np.abs(away).max()), abs(block.approach.offset_deg)
            assert away == pytest.approx(length * np.array(visit.sides), abs=1e-9)
            longest = 3.0 * shortest if block.kind == "poses" else shortest
            assert shortest - 1e-9 <= length <= longest + 1e-9
            if block.approach.sides == "one":
                usual = 1 if block.approach.offset_deg < 0 else -1
                assert sum(side != usual for side in visit.sides) <= (block.kind == "sweep")
        else:
            moved = np.abs(away) > 0.0
            assert np.array_equal(np.sign(away[moved]), np.array(visit.sides)[moved])
        assert len(visit.targets) == 1 or not one_smr
    for number, block in enumerate(campaign.blocks):
        mine = [v for v in poses_of(visits) if v.block == number and v.set != "reference"]
        targets = block.targets or tuple(cell.tool.targets)
        stands = {(v.name, v.joints_deg) for v in mine}
        assert {v.set for v in mine} == {block.set}
        assert Counter(t for v in mine for t in v.targets) == dict.fromkeys(targets, len(stands))


def test_a_seed_makes_one_plan() -> None:
    blocks = [
        {"count": 4},
        {"kind": "circle_point", "width_deg": 40.0},
        {"kind": "repeat", "count": 2, "visits": 3},
    ]
    one, same, other = (plan_of(*blocks, seed=seed, order="shuffled") for seed in (5, 5, 6))
    assert one == same != other


@pytest.mark.parametrize("one_smr", [False, True])
def test_targets_are_read_again_while_the_robot_rests(*, one_smr: bool) -> None:
    """A person moves a single SMR no more often than without repeated readings."""
    cell = a_cell(instrument__one_smr=one_smr)
    block = {"kind": "poses", "count": 2, "targets": ["T1", "T2"], "readings": 3}
    visits = [v for v in make_plan(cell, a_campaign(block=[block])) if v.kind == "pose"]
    once = ("T1",) * 3, ("T2",) * 3
    assert [v.targets for v in visits] == (
        [once[0], once[0], once[1], once[1]] if one_smr else [once[0] + once[1]] * 2
    )
    with pytest.raises(ConfigError, match="readings"):
        a_campaign(block=[block | {"readings": 0}])


@given(reference_every=st.integers(1, 10), count=st.integers(1, 20), one_smr=st.booleans())
def test_a_reference_comes_first_and_after_every_so_many_readings(
    reference_every: int, count: int, one_smr: bool
) -> None:
    cell = a_cell(instrument__one_smr=one_smr)
    visits = plan_of({"count": count}, cell=cell, reference_every=reference_every)
    since: dict[str, int] = {}
    for visit in visits:
        key = visit.targets[0] if one_smr else ""
        if visit.set == "reference":
            assert key not in since or since[key] >= reference_every
            since[key] = 0
        else:
            assert since[key] < reference_every  # KeyError: a reading before the first reference
            since[key] += len(visit.targets)
    assert set(since) == ({"T1", "T2", "T3"} if one_smr else {""})


def test_a_sweep_goes_up_and_down_over_the_same_angles(tmp_path: Path) -> None:
    sweep = {"kind": "sweep", "joint": 4, "range_deg": [-60, 60], "step_deg": 10.0, "targets": ["T2"]}
    visits = plan_of(sweep | {"at_deg": TAUGHT})
    angles = [visit.joints_deg[3] for visit in visits]
    assert angles == [*range(-60, 61, 10), *range(60, -61, -10)]
    assert [visit.sides[3] for visit in visits] == [1] * 13 + [-1] * 13
    others = np.delete([visit.joints_deg for visit in visits], 3, axis=1)
    assert np.array_equal(others, np.tile(np.delete(TAUGHT, 3), (26, 1)))
    assert {side for visit in visits for side in np.delete(visit.sides, 3)} == {1}
    dataset = measured(tmp_path, sweep)
    (found,) = find_sweeps(dataset)
    assert (found.joint, len(found.rows)) == (4, 26)
    sides = dataset.conditions.side[found.rows, 3]
    angles_read = np.degrees(dataset.conditions.joints[found.rows, 3])
    for angle in range(-60, 61, 10):
        assert sorted(sides[np.abs(angles_read - angle) < 1e-6]) == [-1.0, 1.0]


def test_a_sweep_without_a_range_uses_what_the_limits_leave() -> None:
    angles = [v.joints_deg[1] for v in plan_of({"kind": "sweep", "joint": 2, "step_deg": 10.0})]
    assert (min(angles), max(angles)) == (5.0, 105.0)
    assert len(angles) == 22


def test_circle_points_start_base_and_tool(tmp_path: Path) -> None:
    dataset = measured(tmp_path, {"kind": "circle_point"}, samples=1)
    found = {(sweep.joint, sweep.target) for sweep in find_sweeps(dataset)}
    assert found == {(joint, target) for joint in (1, 2, 5, 6) for target in range(3)}
    start = starts(dataset)[0]
    assert start.base is not None
    assert start.base == pytest.approx(np.eye(4), abs=1e-3)
    for target in (1, 2):  # T1 stands on axis 6 and draws no circle about it
        wanted = CELL.tool.targets[dataset.conditions.target_names[target]]
        assert start.targets[target] == pytest.approx(np.array(wanted), abs=1e-3)


def test_repeats_are_what_iso_9283_reads(tmp_path: Path) -> None:
    dataset = measured(tmp_path, {"kind": "repeat", "visits": 6, "targets": ["T1"]}, samples=1)
    assert set(dataset.sets) == {"repeat"}
    at = dataset.conditions
    found = repeated_poses(at.joints, at.series, at.target)
    assert [rows.tolist() for rows in found] == [[i + 5 * k for k in range(6)] for i in range(5)]
    assert all(pose_repeatability(dataset.points[rows]) < 1e-5 for rows in found)
    row = plan_of({"kind": "repeat", "visits": 3, "order": "row", "select": "list", "joints_deg": GOOD})
    assert [visit.joints_deg for visit in row] == [tuple(GOOD[0])] * 3 + [tuple(GOOD[1])] * 3
    assert len({visit.number for visit in row}) == 6  # each visit is approached anew


def test_thirty_visits_of_five_poses_unless_the_file_says() -> None:
    visits = plan_of({"kind": "repeat"})
    assert set(Counter(visit.joints_deg for visit in visits).values()) == {30}
    assert len(visits) == 150


@pytest.mark.parametrize("target", ["T1", "T2"])
def test_a_sphere_about_the_taught_centre(target: str) -> None:
    block = {"kind": "sphere", "centre_deg": TAUGHT, "targets": [target]}
    visits = plan_of(block)
    assert len(visits) == 100
    assert {visit.set for visit in visits} == {"validation"}
    which = list(CELL.tool.targets).index(target)
    centre = targets_at(CELL, np.array([TAUGHT]))[0, which]
    points = targets_at(CELL, np.array([visit.joints_deg for visit in visits]))[:, which]
    radius = np.linalg.norm(points - centre, axis=1)
    assert radius == pytest.approx(300.0, abs=2e-3)  # what four decimals of a degree leave
    assert np.all(points[:, 2] >= centre[2] - 1e-3)
    spread = np.linalg.svd((points - centre) / 300.0, compute_uv=False) / 10.0
    assert (
        spread.min() > 0.25
    )  # all directions, not a ring; an arm of its thickness reaches fewer than a line did
    for before, visit in pairwise(visits):
        assert visit.approach_deg == before.joints_deg  # no suppression of backlash
    suppressed = plan_of(block | {"approach": {"offset_deg": -3.0}})
    away = np.array([np.subtract(v.joints_deg, v.approach_deg) for v in suppressed])
    assert away == pytest.approx(3.0, abs=1e-9)


@given(count=st.integers(1, 400), above=st.floats(-80.0, 80.0))
def test_directions_fill_their_cap_evenly(count: int, above: float) -> None:
    directions = cap(count, above)
    least = np.sin(np.radians(above))
    assert np.linalg.norm(directions, axis=1) == pytest.approx(1.0)
    assert np.all(directions[:, 2] > least)
    # Archimedes: equal areas are equal heights.
    assert directions[:, 2].mean() == pytest.approx(0.5 * (1.0 + least), abs=1e-9)


def test_what_turns_shows_its_targets_all_the_way() -> None:
    cell = a_cell(tool__normals={"T1": [0, 0, 1]})
    visits = plan_of({"kind": "circle_point", "targets": ["T1"]}, cell=cell)
    assert facing(cell, np.array([visit.joints_deg for visit in visits]), ("T1",)).all()
    with pytest.raises(ConfigError, match=r"no posture was found from which joint 1 .* T1 in sight"):
        plan_of({"kind": "sweep", "joint": 1, "targets": ["T1"]}, cell=cell)
    with pytest.raises(ConfigError, match="reaches no point of the sphere"):
        plan_of({"kind": "sphere", "centre_deg": TAUGHT, "targets": ["T1"]}, cell=cell)


def test_shuffled_poses_leave_sweeps_and_repeats_whole() -> None:
    blocks = [{"count": 8}, {"kind": "sweep", "joint": 6, "step_deg": 20.0}, {"count": 8}]
    visits = plan_of(*blocks, order="shuffled")
    assert Counter(v.block for v in visits) == Counter(v.block for v in plan_of(*blocks))
    at = [i for i, visit in enumerate(visits) if visit.block == 1]
    assert at == list(range(at[0], at[0] + len(at)))
    assert [visits[i].name for i in at] == [v.name for v in plan_of(*blocks) if v.block == 1]
    mixed = [visit.block for visit in visits if visit.block != 1]
    assert mixed != sorted(mixed)


def test_nothing_is_mixed_across_a_new_station() -> None:
    blocks = [{"count": 5}, {"count": 5, "set": "validation"}, {"count": 5, "new_station": True}]
    visits = plan_of(*blocks, order="shuffled", reference_every=6)
    last_before = max(i for i, v in enumerate(visits) if v.block < 2)
    assert {v.block for v in visits[last_before + 1 :]} == {2}
    assert visits[last_before + 1].set == "reference"  # the first reading from there shows what changed


@pytest.mark.parametrize(
    ("block", "words"),
    [
        ({"kind": "sweep", "joint": 2, "range_deg": [2, 42], "at_deg": [0.0] * 6}, ["approach point", "-3"]),
        ({"kind": "sweep", "joint": 1, "range_deg": [-60, 86], "at_deg": GOOD[0], "step_deg": 73}, ["91"]),
        ({"kind": "repeat", "select": "list", "joints_deg": [[100.0, *GOOD[0][1:]]]}, ["visit 1 to pose 1"]),
        (
            {"kind": "circle_point", "at_deg": [80.0, *GOOD[0][1:]]},
            ["joint 1 at 95 deg going up of block 1", "allowed -90 to 90"],
        ),
    ],
)
def test_every_stand_is_checked_before_anything_moves(block: dict[str, Any], words: list[str]) -> None:
    visits = make_plan(CELL, a_campaign(block=[block], approach=ONE_SIDE))
    with pytest.raises(UnsafePlan) as caught:
        check_plan(CELL, visits)
    assert all(word in str(caught.value) for word in words), caught.value


def test_distances_need_a_ballbar() -> None:
    with pytest.raises(ConfigError, match="block 1: kind = 'hexapod' does not go with the faro-ion"):
        plan_of({"kind": "hexapod"})


ONE = {"count": 40, "one_target": True}
LOOKING = a_cell(tool__normals={"T1": [0.0, 0.0, 1.0], "T2": [0.0, 1.0, 0.0], "T3": [0.0, -1.0, 0.0]})


def test_one_target_that_faces_the_instrument_is_measured_in_each_pose() -> None:
    visits = plan_of(ONE, cell=LOOKING)
    assert len(visits) == 40
    joints = np.array([visit.joints_deg for visit in visits])
    seen = np.column_stack([facing(LOOKING, joints, (name,)) for name in ("T1", "T2", "T3")])
    assert not seen.all(axis=1).any()  # T2 and T3 look to opposite sides
    assert {visit.targets for visit in visits} == {("T1",), ("T2",), ("T3",)}
    for visit, row in zip(visits, seen, strict=True):
        assert row[int(visit.targets[0][1]) - 1]
    with pytest.raises(ConfigError, match="turn T1, T2, T3 to the instrument"):
        plan_of({"count": 5}, cell=LOOKING)
    with pytest.raises(ConfigError, match="observability"):
        plan_of({**ONE, "select": "observability"}, cell=LOOKING)


def test_a_target_that_faces_the_instrument_comes_before_one_without_a_normal() -> None:
    cell = a_cell(tool__normals={"T1": [0.0, 0.0, 1.0]})
    visits = plan_of(ONE | {"targets": ["T3", "T1"], "readings": 2}, cell=cell)
    joints = np.array([visit.joints_deg for visit in visits])
    seen = facing(cell, joints, ("T1",))
    assert 0 < seen.sum() < len(visits)
    assert [visit.targets for visit in visits] == [("T1",) * 2 if one else ("T3",) * 2 for one in seen]


def test_with_one_smr_a_pose_is_visited_once_for_its_target() -> None:
    visits = plan_of(ONE, cell=a_cell(instrument__one_smr=True, tool__normals=dict(LOOKING.tool.normals)))
    assert len(visits) == 40
    assert [visit.targets[0] for visit in visits] == sorted(visit.targets[0] for visit in visits)
