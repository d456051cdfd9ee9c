"""Clearance of straight moves in joint space, compared with very fine sampling.

The distances of the sampling are written independently. These would catch: a thin post between two looks, an arm
without thickness, and a bound of the bend that is too small. They would also catch a distance to a box that forgets its
edges and corners, a mounting that hides a real obstacle, and moves that pass at a margin and are refused.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from acquisition.cell.arm import CellArm
from acquisition.cell.cell import Cell, cell_from
from acquisition.cell.clearance import NEAREST_MM
from acquisition.cell.obstacles import Box, FloorObstacle, Post, between_lines
from calib.arm import load_robot
from calib.array import Array
from drivers.errors import ConfigError
from mocks.world.kinematics import frames, nominal_geometry
from mocks.world.robots import robot_named
from mocks.world.transforms import place
from tests.acquisition.arm_reference import far_from_box, far_from_line, looked_at
from tests.acquisition.fakes import CELL, changed
from tests.calib.machines import SCARA_DH, TRACK

POST = {"name": "post", "low_mm": [380, 80, 20], "high_mm": [480, 180, 600]}
ROD = {"name": "rod", "from_mm": [415, 115, 20], "to_mm": [415, 115, 600], "radius_mm": 15}
SLANTED = {"name": "strut", "from_mm": [300, -400, 20], "to_mm": [500, -100, 700], "radius_mm": 60}


def cell_with(*fixtures: dict[str, Any], **values: Any) -> Cell:
    return cell_from({**changed(CELL, **values), "fixture": list(fixtures)}, "cell.toml")


def clear_postures(cell: Cell, count: int, seed: int = 0) -> Array:
    low, high = np.array(cell.robot.limits_deg).T
    postures = np.random.default_rng(seed).uniform(low, high, (12 * count, len(low)))
    return postures[cell.clearance.clear_at(postures)][:count]


@pytest.mark.parametrize(
    ("fixture", "model"),
    [(POST, "abb-irb120"), (ROD, "abb-irb120"), (SLANTED, "fanuc-lrmate200ic"), (ROD, "ur5")],
)
def test_no_move_that_touches_is_clear_and_none_that_passes_is_refused(
    fixture: dict[str, Any], model: str
) -> None:
    """Thirty moves between clear postures are sampled at 800 instants each."""
    limits = {} if model == "abb-irb120" else {"robot__limits_deg": None}
    cell = cell_with(fixture, robot__model=model, **limits)
    postures = clear_postures(cell, 60)
    starts, goals = postures[0::2], postures[1::2]
    goals = starts + (goals - starts) * np.minimum(
        1.0, 180.0 / np.abs(goals - starts).max(axis=1, keepdims=True)
    )
    found = cell.clearance.contacts(starts, goals)
    for start, goal, contact in zip(starts, goals, found, strict=True):
        nearest, moved = looked_at(cell, start, goal, 800)
        if contact is None:
            assert nearest >= 0.0
        else:
            assert nearest < NEAREST_MM + moved
            assert 0.0 <= contact.share <= 1.0
    assert 3 < sum(contact is not None for contact in found) < 27  # both kinds are tried


def test_a_post_of_100_mm_is_grazed_by_no_move_that_passes_for_clear() -> None:
    """One of 120 moves grazed it when the arm was a line, sampled every few degrees."""
    cell = cell_with(POST)
    postures = clear_postures(cell, 240, seed=1)
    clear = cell.clearance.clear_between(postures[0::2], postures[1::2])
    assert 20 < clear.sum() < 100
    for start, goal in zip(postures[0::2][clear], postures[1::2][clear], strict=True):
        assert looked_at(cell, start, goal, 300)[0] >= 0.0


def test_a_rod_of_30_mm_does_not_slip_between_two_looks() -> None:
    """A horizontal bar is in the way of the wrist as joint 1 turns past.

    In 50 moves, the rod is always struck in the middle.
    """
    tip = cell_with().clearance.arm.lines(np.zeros((1, 6)))[0, 4, 0]  # of the wrist, straight ahead
    rod = {
        "name": "rod",
        "from_mm": [*tip[:2], tip[2] - 60.0],
        "to_mm": [*tip[:2], tip[2] + 60.0],
        "radius_mm": 15,
    }
    cell = cell_with(rod)
    rng = np.random.default_rng(2)
    turned = np.zeros((50, 6))
    turned[:, 0] = rng.uniform(20.0, 80.0, 50)
    found = cell.clearance.contacts(-turned * rng.uniform(0.3, 1.0, (50, 1)), turned)
    assert all(contact is not None and contact.obstacle == "rod" for contact in found)


@pytest.mark.parametrize(("depth_mm", "touches"), [(2.0, True), (-NEAREST_MM - 0.2, False)])
def test_the_bow_of_a_path_is_within_its_bound_and_the_bound_is_close(depth_mm: float, touches: bool) -> None:
    """The stretched arm turns about joint 1 past a flat wall that its circle just enters.

    It enters at three tenths of the move. At the ends of both halves of the move, the arm is 15 mm and more from the
    wall. With half of the bound, or none, the chord between them would prove the first half clear.
    """
    only = {"tool__targets": {"T1": [0.0, 0.0, 125.0]}, "robot__table_z_mm": -900.0}
    arm = cell_with(**only).clearance.arm
    start, goal = np.array([[-18.0, 90.0, -99.0, 0.0, 0.0, 0.0], [42.0, 90.0, -99.0, 0.0, 0.0, 0.0]])
    line = arm.lines(start[None])[0]
    radius = float(np.max(np.hypot(line[..., 0], line[..., 1]).max(axis=1) + arm.radii))
    x = radius - depth_mm
    wall = {"name": "wall", "low_mm": [x, -900, -900], "high_mm": [x + 50, 900, 900]}
    (contact,) = cell_with(wall, **only).clearance.contacts(start[None], goal[None])
    assert (contact is not None) == touches
    if contact is not None:
        assert (contact.part, contact.obstacle) == ("the tool at T1", "wall")
        assert contact.share == pytest.approx(0.3, abs=0.05)


@pytest.mark.parametrize("model", ["abb-irb120", "fanuc-lrmate200ic", "ur5", "ur10"])
def test_the_capsules_are_where_the_simulators_links_are(model: str) -> None:
    """The frames of the links, multiplied out a second time by the simulator."""
    cell = cell_with(robot__model=model, robot__limits_deg=None)
    robot = robot_named(model)
    for joints in np.random.default_rng(4).uniform(-120.0, 120.0, (5, 6)):
        chain = frames(
            robot.convention, nominal_geometry(robot), cell.robot.model_angles(joints[None])[0].tolist()
        )
        lines = cell.clearance.arm.lines(joints[None])[0]
        for capsule, line in zip(cell.clearance.arm.capsules, lines, strict=True):
            for end, seen in zip((capsule.from_mm, capsule.to_mm), line, strict=True):
                assert seen == pytest.approx(place(chain[capsule.link], end), abs=1e-9)


def test_bends_are_bounds() -> None:
    """Second differences along random moves stay within the bound.

    If one joint turns alone, the bound is nearly reached.
    """
    share = np.linspace(0.0, 1.0, 201)[:, None]
    for model in ("abb-irb120", "fanuc-lrmate200ic", "ur5", "ur10"):
        arm = cell_with(robot__model=model, robot__limits_deg=None).clearance.arm
        rng = np.random.default_rng(3)
        closest = np.zeros(6)
        for i in range(60):
            start, turn = rng.uniform(-90.0, 90.0, (2, 6))
            if i >= 30:
                turn *= np.arange(6) == i % 6
            lines = arm.lines(start + share * turn)
            seen = np.linalg.norm(np.diff(lines, n=2, axis=0), axis=3).max(axis=(0, 2)) / share[1, 0] ** 2
            bound = arm.bends(start[None], (start + turn)[None])[0]
            assert np.all(seen <= bound * (1.0 + 1e-3) + 1e-3)
            if i >= 30:
                closest[i % 6] = max(closest[i % 6], float(np.max(seen / np.maximum(bound, 1e-9))))
        assert closest[0] > 0.5  # half the bound would not hold


@pytest.mark.parametrize("machine", [TRACK, SCARA_DH], ids=["track", "scara"])
def test_bends_are_bounds_where_joints_slide(machine: str, tmp_path: Path) -> None:
    path = tmp_path / "own.toml"
    path.write_text(machine, encoding="utf-8")
    robot = load_robot(str(path))
    arm = CellArm.of(robot, "none", {"T1": (30.0, 40.0, 120.0)}, 25.0)
    slides = np.array([kind == "slides" for kind in robot.kinds])
    share, rng = np.linspace(0.0, 1.0, 201)[:, None], np.random.default_rng(3)
    low, high = np.array([robot.lower, robot.upper]) / robot.joint_units
    nearest = 0.0
    for i in range(40):
        start, goal = rng.uniform(low, high, (2, robot.joints))
        if i % 2:  # a slide and one joint before or behind it
            goal = np.where(slides | (np.arange(robot.joints) == i % robot.joints), goal, start)
        lines = arm.lines(start + share * (goal - start))
        seen = np.linalg.norm(np.diff(lines, n=2, axis=0), axis=3).max(axis=(0, 2)) / share[1, 0] ** 2
        bound = arm.bends(start[None], goal[None])[0]
        assert np.all(seen <= bound * (1.0 + 1e-3) + 1e-3)
        nearest = max(nearest, float(np.max(seen / np.maximum(bound, 1e-9))))
    assert nearest > 0.5


coordinate = st.floats(-300.0, 300.0).map(lambda x: round(x, 3))
point = st.tuples(coordinate, coordinate, coordinate)


@given(st.lists(st.tuples(point, point), min_size=1, max_size=6))
@settings(max_examples=60, deadline=None)
def test_lines_to_a_box(ends: list[tuple[tuple[float, ...], tuple[float, ...]]]) -> None:
    """The result equals a search along the line.

    Lines through the box, points, and lines along an axis are included.
    """
    low, high = (-50.0, -80.0, -10.0), (60.0, 20.0, 90.0)
    lines = np.array([*ends, *[(a, a) for a, _ in ends], *[(a, (a[0], a[1], b[2])) for a, b in ends]])
    box = Box(name="box", low_mm=low, high_mm=high)
    towards = box.towards(lines)
    for line, vector in zip(lines, towards, strict=True):
        assert math.dist(vector, (0, 0, 0)) == pytest.approx(far_from_box(line, low, high), abs=1e-4)
    # What has come apart is separated by the plane across.
    apart = np.linalg.norm(towards, axis=1)
    across = towards[apart > 1e-6] / apart[apart > 1e-6, None]
    height = np.einsum("pkj,pj->pk", lines[apart > 1e-6], across).min(axis=1)
    assert np.all(height >= box.reach(across) + apart[apart > 1e-6] - 1e-6)


def test_a_line_past_a_corner_and_past_an_edge() -> None:
    box = Box(name="box", low_mm=(0.0, 0.0, 0.0), high_mm=(10.0, 10.0, 10.0))
    corner = [[13.0, 14.0, 10.0], [13.0, 14.0, 10.0]]
    past = [[20.0, 10.0, 5.0], [10.0, 20.0, 5.0]]  # its ends are 10 mm away, its middle 7.07 from the edge
    assert np.linalg.norm(box.towards(np.array([corner, past])), axis=1) == pytest.approx([5.0, 50.0**0.5])


@given(st.tuples(point, point, point, point))
@settings(max_examples=60, deadline=None)
def test_lines_to_lines(ends: tuple[tuple[float, ...], ...]) -> None:
    a, b, c, d = (np.array(end) for end in ends)
    for line, other in (([a, b], [c, d]), ([a, b], [c, c]), ([a, b], [c, c + (b - a)]), ([a, a], [c, c])):
        apart = between_lines(np.array([line]), np.array([other]))[0]
        assert math.dist(apart, (0, 0, 0)) == pytest.approx(far_from_line(line, other), abs=2e-3)


def test_a_post_has_a_radius_and_round_ends() -> None:
    post = Post(name="post", from_mm=(0.0, 0.0, 0.0), to_mm=(0.0, 0.0, 100.0), radius_mm=20.0)
    lines = np.array([[[50.0, -9.0, 50.0], [50.0, 9.0, 50.0]], [[0.0, 0.0, 130.0], [5.0, 0.0, 200.0]]])
    assert np.linalg.norm(post.towards(lines), axis=1) == pytest.approx([30.0, 10.0])
    assert post.reach(np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])) == pytest.approx([120.0, 20.0])
    assert FloorObstacle(20.0).reach(np.array([[0.0, 0.0, 1.0]])) == pytest.approx([20.0])


def test_the_arm_has_its_thickness() -> None:
    """A box 10 mm below the forearm's skin is not touched, and a box 10 mm within is.

    No centre line is near the box.
    """
    arm = cell_with().clearance.arm
    i = [capsule.name for capsule in arm.capsules].index("forearm")
    line, radius = arm.lines(np.zeros((1, 6)))[0, i], arm.radii[i]
    top = float(line[:, 2].min() - radius)
    x = float(line[:, 0].mean())
    for gap, touches in ((10.0, False), (-10.0, True)):
        box = {"name": "box", "low_mm": [x - 5, -5, top - 60 - gap], "high_mm": [x + 5, 5, top - gap]}
        (contact,) = cell_with(box).clearance.at(np.zeros((1, 6)))
        assert (contact is not None) == touches
        if contact is not None:
            assert (contact.part, contact.obstacle) == ("forearm", "box")
            assert contact.depth_mm == pytest.approx(10.0, abs=0.5)
            assert "forearm comes 10 mm into box" in str(contact)


def test_the_tool_has_the_radius_of_the_cell_file() -> None:
    posture = np.array([[0.0, 60.0, 20.0, 0.0, 10.0, 0.0]])
    lines = cell_with().clearance.arm.lines(posture)[0]
    lowest = float(lines[-3:, :, 2].min())
    for radius, z, clear in (
        (20.0, lowest - 22.0, True),
        (20.0, lowest - 18.0, False),
        (30.0, lowest - 22.0, False),
    ):
        cell = cell_with(robot__table_z_mm=z, tool__radius_mm=radius)
        assert cell.clearance.clear_at(posture)[0] == clear


def test_the_foot_may_touch_what_it_stands_on_and_nothing_else_may() -> None:
    pedestal = {"name": "pedestal", "low_mm": [-150, -150, -500], "high_mm": [150, 150, 60]}
    wall = {"name": "wall", "low_mm": [-400, -400, 0], "high_mm": [-300, 400, 900]}
    room = cell_with(pedestal, wall).clearance
    names = [capsule.name for capsule in room.arm.capsules]
    assert [o.name for o in room.obstacles[1:]] == ["pedestal", "wall", "the robot's own foot"]
    for name, *pairs in zip(names, *room.pairs.T, strict=True):
        foot, upper = name == "foot", name in ("foot", "upper arm")
        assert pairs == [not foot, not foot, True, not upper]


def test_a_ceiling_over_everything_is_no_mounting() -> None:
    """It is not taken for the foot, so the links from the elbow on make it refuse every posture."""
    cell = cell_with(robot__table_z_mm=5000.0)
    assert not cell.clearance.clear_at(np.zeros((1, 6)))[0]


def test_the_tool_does_not_hit_the_robots_own_foot() -> None:
    folded = np.array([[0.0, 100.0, 70.0, 0.0, 60.0, 0.0]])
    (contact,) = cell_with(robot__table_z_mm=-900.0).clearance.at(folded)
    assert contact is not None
    assert contact.obstacle == "the robot's own foot"


REFUSED = [
    ({"low_mm": [0, 0, 0], "high_mm": [1, 1, 1]}, "name"),
    ({"name": "a", "low_mm": [0, 0, 0], "high_mm": [1, 1, 0]}, "high_mm"),
    ({"name": "a", "low_mm": [0, 0, 0]}, "high_mm"),
    ({"name": "a", "from_mm": [0, 0, 0], "to_mm": [1, 1, 0]}, "radius_mm"),
    ({"name": "a", "from_mm": [0, 0, 0], "to_mm": [1, 1, 0], "radius_mm": 0}, "radius_mm"),
    ({"name": "a", "from_mm": [0, 0, 0], "to_mm": [1, 1, 0], "radius_mm": 5, "low_mm": [0, 0, 0]}, "from_mm"),
    ({"name": "a", "from_mm": [0, 0], "to_mm": [1, 1, 0], "radius_mm": 5}, "from_mm"),
    ({**POST, "height_mm": 4}, "height_mm"),
]


@pytest.mark.parametrize(("fixture", "key"), REFUSED)
def test_a_fixture_that_makes_no_sense_is_refused(fixture: dict[str, Any], key: str) -> None:
    with pytest.raises(ConfigError, match=rf"fixture\[\d\]\.{key}"):
        cell_with(fixture)


def test_a_name_of_two_fixtures_is_refused() -> None:
    with pytest.raises(ConfigError, match="'post' twice"):
        cell_with(POST, POST)
