"""Ways between poses.

They never go through the table. Between poses that the program draws, a way is always found; otherwise, a person
is asked.
"""

from __future__ import annotations

from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from acquisition.campaign.plan import check_plan, make_plan
from acquisition.cell.transit import Transit, clear_moves, home_of, may_visit
from acquisition.cell.workspace import is_allowed, lowest_of
from acquisition.errors import NoClearWay, UnsafePlan
from acquisition.record.store import Event
from drivers.errors import ConfigError
from drivers.interfaces import Answer, Prompt
from tests.acquisition.fakes import SeatingOperator, a_campaign, a_cell
from tests.acquisition.stage import Stage

CELL = a_cell()
LEFT, RIGHT = (-70.0, 20.0, 0.0, 0.0, 30.0, 0.0), (70.0, 20.0, 0.0, 0.0, 30.0, 0.0)  # to either side


def dipping() -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Two stands of the cell whose straight way is not clear, found at random."""
    rng = np.random.default_rng(5)
    low, high = np.array(CELL.robot.limits_deg).T
    postures = np.round(rng.uniform(low + 6.0, high, (3000, 6)), 1)
    postures = postures[may_visit(CELL, postures, postures - 5.0)]
    bad = np.flatnonzero(~clear_moves(CELL, postures[:-1], postures[1:] - 5.0))
    assert (
        0.02 < len(bad) / len(postures) < 0.3
    )  # that is how often a campaign without ways would hit the table
    one, other = postures[bad[0]], postures[bad[0] + 1]
    return tuple(one.tolist()), tuple(other.tolist())


def buried() -> tuple[float, ...]:
    """A posture in the table out of which no straight move rises."""
    low, high = np.array(CELL.robot.limits_deg).T
    postures = np.random.default_rng(1).uniform(low, high, (400, 6))
    postures = postures[lowest_of(CELL, postures) < -50.0]
    first = make_plan(CELL, a_campaign())[3].approach_deg
    for goal in (first, home_of(CELL)):
        postures = postures[~clear_moves(CELL, postures, np.broadcast_to(np.array(goal), postures.shape))]
    return tuple(postures[0].tolist())


def lowest(start: tuple[float, ...], goal: tuple[float, ...]) -> float:
    """Return the lowest point of arm and tool, sampled finely along the straight way, mm."""
    share = np.linspace(0.0, 1.0, 2000)[:, None]
    path = np.array(start) + share * (np.array(goal) - np.array(start))
    return float(lowest_of(CELL, path).min())


def test_a_way_through_the_table_goes_over_home() -> None:
    start, goal = dipping()
    goal = tuple(q - 5.0 for q in goal)
    assert lowest(start, goal) < CELL.robot.table_z_mm
    path = Transit(CELL).path(start, goal)
    assert path == [home_of(CELL), goal]
    for one, other in zip([start, *path], path, strict=False):
        assert lowest(one, other) >= CELL.robot.table_z_mm


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=10, deadline=None)
def test_from_every_drawn_stand_to_every_other(seed: int) -> None:
    campaign = a_campaign(seed=seed, block=[{"count": 6}, {"count": 4, "set": "validation"}])
    visits = [visit for visit in make_plan(CELL, campaign) if visit.kind == "pose"]
    check_plan(CELL, visits)
    transit = Transit(CELL)
    for one in visits:
        for other in visits[::3]:  # also in an order that nobody planned
            at = one.joints_deg
            for joints_deg in transit.path(at, other.approach_deg):
                assert lowest(at, joints_deg) >= CELL.robot.table_z_mm
                at = joints_deg


def test_home_is_high_and_the_cells_own_where_it_has_one() -> None:
    home = home_of(CELL)
    assert home is not None
    assert lowest_of(CELL, np.array([home]))[0] > 400.0
    assert home_of(a_cell(robot__home_deg=[0, 0, 0, 0, 30, 0])) == (0, 0, 0, 0, 30, 0)
    for home_deg, words in (([0, 0, 0], "has 3 joints"), ([0, 0, 0, 0, 0, 200], "joint 6 at 200 is outside")):
        with pytest.raises(ConfigError, match=words):
            a_cell(robot__home_deg=home_deg)


def test_a_parked_robot_may_rise_but_not_sink() -> None:
    low, high = np.array(CELL.robot.limits_deg).T
    postures = np.random.default_rng(1).uniform(low, high, (4000, 6))
    height = lowest_of(CELL, postures)
    parked = postures[(height < 10.0) & (height > -60.0)]
    home = np.broadcast_to(np.array(home_of(CELL)), parked.shape)
    good = clear_moves(CELL, parked, home)
    assert 0.1 < good.mean() < 1.0  # some must sink first, or sideways: these need a person
    for one, may in zip(parked[:60], good[:60], strict=True):
        share = np.linspace(0.0, 1.0, 500)[:, None]
        path = lowest_of(CELL, one + share * (home[0] - one))
        dips = path.min() < path[0] - 3.0
        assert not (may and dips)


def test_a_tool_does_not_leave_the_table_through_its_lowest_point() -> None:
    """The tool is 5 mm too low, 20 deg before it points straight down.

    It may move up, but not through the lowest point.
    """
    only = {"T1": [0.0, 0.0, 125.0]}
    start = np.array([[0.0, 0.0, 0.0, 0.0, 70.0, 0.0]])
    low = float(lowest_of(a_cell(tool__targets=only), start)[0])
    cell = a_cell(tool__targets=only, robot__table_z_mm=low + 5.0)
    for turned, clear in ((10.0, True), (119.0, False)):
        goal = np.array([[0.0, 0.0, 0.0, 0.0, turned, 0.0]])
        assert not is_allowed(cell, start)[0]
        assert cell.clearance.clear_at(goal)[0]
        assert clear_moves(cell, start, goal)[0] == clear


def test_a_box_in_the_way_is_gone_round() -> None:
    cell = a_cell(robot__keep_out=[[[350.0, -30.0, 0.0], [900.0, 30.0, 600.0]]])
    assert is_allowed(cell, np.array([LEFT, RIGHT])).all()
    assert Transit(CELL).path(LEFT, RIGHT) == [RIGHT]
    assert Transit(cell).path(LEFT, RIGHT) == [home_of(cell), RIGHT]


def test_nowhere_to_go_is_said_before_anything_moves() -> None:
    wall = [[150.0, -30.0, 0.0], [900.0, 30.0, 1200.0]]
    behind = a_cell(robot__keep_out=[wall], robot__home_deg=[-90, 0, 0, 0, 0, 0])
    poses = [list(LEFT), list(RIGHT)]
    assert is_allowed(behind, np.array(poses)).all()
    visits = make_plan(behind, a_campaign(block=[{"select": "list", "joints_deg": poses}]))
    with pytest.raises(UnsafePlan, match=r"between pose 1 of block 1 .* and pose 2 of block 1") as caught:
        check_plan(behind, visits)
    for word in (
        "the tool at T3 comes 25 mm into keep-out box 1 at 50\xa0% of the move",
        "straight",
        "from home on",
    ):
        assert word in caught.value.message
    with pytest.raises(NoClearWay, match=r"no way from .* is clear: straight, the tool at T3 comes"):
        Transit(behind).path(poses[0], poses[1])


def test_the_last_move_to_a_pose_is_straight_and_has_to_be_clear() -> None:
    cell = a_cell(robot__keep_out=[[[350.0, -30.0, 0.0], [900.0, 30.0, 600.0]]])
    visits = make_plan(cell, a_campaign(block=[{"select": "list", "joints_deg": [list(RIGHT)]}]))
    check_plan(cell, visits)
    far = [replace(visit, approach_deg=LEFT) if visit.kind == "pose" else visit for visit in visits]
    with pytest.raises(
        UnsafePlan, match=r"the last move to pose 1 of block 1 .* into keep-out box 1 at 50\xa0% of the move"
    ):
        check_plan(cell, far)


def test_the_sequencer_goes_the_way_and_tells(tmp_path: Path) -> None:
    start, goal = dipping()
    block = [{"select": "list", "joints_deg": [list(start), list(goal)], "targets": ["T1"]}]
    stage = Stage(tmp_path, block=block, approach={"offset_deg": -5.0, "sides": "one"})
    events: list[Event] = []
    with closing(stage.run):
        assert stage.execute(events.append).state.value == "succeeded"
    detours = [event.data for event in events if event.kind == "detour"]
    assert [tuple(detour["over_deg"]) for detour in detours] == [home_of(CELL)]
    assert stage.bench.log.count("move") == 2 * 2 + len(detours)
    for shot in stage.bench.shots.values():
        if shot.target == "T1":
            np.testing.assert_allclose(shot.came_from_deg, np.array(shot.joints_deg) - 5.0)


def test_a_robot_with_no_way_out_is_jogged_by_a_person(tmp_path: Path) -> None:
    stage = Stage(tmp_path)

    class Jogging(SeatingOperator):
        def ask(self, prompt: Prompt) -> Answer:
            stage.bench.where = (0.0,) * 6
            return super().ask(prompt)

    stage.bench.where = buried()
    stage.operator = Jogging(stage.bench)
    with closing(stage.run):
        assert stage.execute().state.value == "succeeded"
    assert "no way from" in stage.operator.asked[0]
    assert "Jog the robot" in stage.operator.asked[0]


def test_ends_count() -> None:
    """A way that ends in the table is refused, even if the rest is clear."""
    low = np.array([[0.0, 110.0, 0.0, 0.0, 0.0, 0.0]])
    assert not clear_moves(CELL, np.zeros((1, 6)), low)[0]
    assert clear_moves(CELL, np.zeros((0, 6)), np.zeros((0, 6))).shape == (0,)


def test_out_of_a_box_there_is_no_way() -> None:
    """A tool in a box may touch it already, and only a person knows the way out."""
    cell = a_cell(robot__keep_out=[[[-600.0, -900.0, 300.0], [900.0, -200.0, 900.0]]])
    inside = (-50.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    assert not is_allowed(cell, np.array([inside]))[0]
    with pytest.raises(NoClearWay):
        Transit(cell).path(inside, RIGHT)


def test_a_robot_far_below_does_not_sweep() -> None:
    deep = np.array([[0.0, 110.0, 0.0, 0.0, 0.0, 0.0]])
    assert lowest_of(CELL, deep)[0] < -200.0
    for turned in (60.0, -60.0):
        assert not clear_moves(CELL, deep, np.array([[turned, 0.0, 0.0, 0.0, 0.0, 0.0]]))[0]


def test_the_way_begins_where_the_robot_stands_now(tmp_path: Path) -> None:
    """Jogged during the warm-up, after it was met: a new look decides."""
    stage = Stage(tmp_path, warm_up_s=600.0)
    buried_at = buried()

    def jog(event: Event) -> None:
        if event.kind == "warm_up":
            stage.bench.where = buried_at

    with closing(stage.run):
        outcome = stage.execute(jog)
    assert any("no way from" in text for text in stage.operator.asked)
    assert outcome.state.value == "paused"  # confirmed again and again, and it stands there still
    assert "move" not in stage.bench.log
