"""Placements of the base balls.

These would catch: balls turned the wrong way, stances of other balls than the moved ones, and cups left behind or
fixtures carried off. They would also catch a leg through the arm, and an uncertainty of lengths that are not measured.
"""

from __future__ import annotations

import json
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from acquisition.campaign.placements import BallPlacement, HexapodSurvey, best_first, grid
from acquisition.cell.cell import Cell, read_cell, with_places
from acquisition.cell.obstacles import Box, Post
from calib.arm.kinematics import forward
from calib.model import BoundModel
from calib.selection import lengths
from calib.units import DEG
from service.cli import main

EXAMPLES = Path(__file__).parents[2] / "examples"
BALLBAR = EXAMPLES / "lrmate_ballbar" / "cell.toml"
TOOL = ["T1", "T2", "T3"]
SVG = "{http://www.w3.org/2000/svg}"
MOVED = BallPlacement((-60.0, 40.0, 15.0), 25.0)


@pytest.fixture(scope="module")
def cell() -> Cell:
    return read_cell(BALLBAR)


def hexapod(cell: Cell) -> HexapodSurvey:
    return HexapodSurvey(cell, ["B1", "B2", "B3"], ["T1", "T2", "T3"])


def balls_of(cell: Cell) -> np.ndarray:
    return np.array([cell.nests[name] for name in ("B1", "B2", "B3")])


def test_the_balls_turn_about_their_middle(cell: Cell) -> None:
    before, after = balls_of(cell), balls_of(hexapod(cell).moved(MOVED))
    assert after.mean(axis=0) == pytest.approx(before.mean(axis=0) + MOVED.shift_mm, abs=1e-3)
    arms = [(balls - balls.mean(axis=0)) @ [1.0, 1.0j, 0.0] for balls in (before, after)]
    assert np.degrees(np.angle(arms[1] / arms[0])) == pytest.approx([25.0] * 3, abs=1e-3)


def test_every_configuration_holds_its_six_legs(cell: Cell) -> None:
    """Forward kinematics of the found poses gives the leg lengths to the moved balls."""
    six = hexapod(cell)
    (found,) = six.survey([MOVED])
    assert found.poses > 40
    balls = balls_of(six.moved(MOVED))
    which, branch = np.nonzero(found.there)
    joints = cell.robot.model_angles(found.joints_deg[which, branch])
    flange = forward(cell.robot.model, joints)
    tool = np.array([cell.tool.targets[name] for name in ("T1", "T2", "T3")])
    ends = (
        np.einsum("nij,nlj->nli", flange[:, :3, :3], tool[six.stances.tool[which]]) + flange[:, None, :3, 3]
    )
    length = np.linalg.norm(ends - balls[six.stances.base[which]], axis=2)
    assert np.abs(length - cell.instrument.nominal_mm).max() < 1e-3
    low, high = np.array(cell.robot.limits_deg).T
    driven = found.joints_deg[which, branch]
    assert np.all((driven >= low) & (driven <= high))


def test_a_survey_of_many_is_that_of_each(cell: Cell) -> None:
    six = hexapod(cell)
    wanted = grid([[0.0, 50.0], [0.0], [0.0]], [0.0, 40.0])
    assert len(wanted) == 4
    for one, among in zip(wanted, six.survey(wanted), strict=True):
        alone = six.survey([one])[0]
        assert np.array_equal(alone.there, among.there)
        assert sum(among.by_branch.values()) == sum(among.by_arm.values()) == among.configurations
    best = best_first(six.survey(wanted))
    assert [(r.poses, r.configurations) for r in best] == sorted(
        ((r.poses, r.configurations) for r in best), reverse=True
    )


def test_a_proof_takes_away_and_never_adds(cell: Cell) -> None:
    six = hexapod(cell)
    (found,) = six.survey([MOVED])
    proven = six.prove(found, 5.0)
    assert 0 < proven.configurations < found.configurations
    assert not (proven.there & ~found.there).any()


def test_cups_move_along_and_other_fixtures_stay(cell: Cell) -> None:
    wall = Box(name="wall", low_mm=(-900.0, -900.0, 0.0), high_mm=(-800.0, 900.0, 900.0))
    pedestal = Box(name="pedestal", low_mm=(340.0, 163.2051, 0.0), high_mm=(360.0, 183.2051, 55.0))
    with_all = with_places(cell, {}, (*cell.fixtures, wall, pedestal))
    moved = hexapod(with_all).moved(MOVED)
    assert moved.fixtures[3] == wall
    for name, post in zip(("B1", "B2", "B3"), moved.fixtures[:3], strict=True):
        assert isinstance(post, Post)
        assert post.to_mm == pytest.approx(moved.nests[name], abs=1e-3)
    box = moved.fixtures[4]
    assert isinstance(box, Box)
    assert np.mean([box.low_mm, box.high_mm], axis=0)[:2] == pytest.approx(moved.nests["B1"][:2], abs=1e-3)
    assert np.subtract(box.high_mm, box.low_mm) == pytest.approx([26.57, 26.57, 55.0], abs=0.01)


def test_no_leg_passes_through_the_arm(cell: Cell, monkeypatch: pytest.MonkeyPatch) -> None:
    """Against points along legs and limbs, and thick legs leave fewer configurations."""
    six = hexapod(cell)
    (found,) = six.survey([BallPlacement()])
    counts = []
    for radius in (0.0, 15.0, 90.0):
        monkeypatch.setattr("acquisition.campaign.placements.LEG_RADIUS_MM", radius)
        proven = six.prove(found, 5.0)
        counts.append(proven.configurations)
        which, branch = np.nonzero(proven.there)
        joints = proven.joints_deg[which, branch]
        arm = cell.clearance.arm
        near = arm.links < 5
        share = np.linspace(0.0, 1.0, 25)[:, None]
        line = arm.lines(joints)[:, near]
        limb = line[:, :, None, 0] + share * (line[:, :, None, 1] - line[:, :, None, 0])
        flange = six.stances.flange[which]
        tool = np.array([cell.tool.targets[name] for name in six.tool])[six.stances.tool[which]]
        end = np.einsum("nij,nlj->nli", flange[:, :3, :3], tool) + flange[:, None, :3, 3]
        begin = balls_of(cell)[six.stances.base[which]]
        leg = begin[:, :, None] + share * (end - begin)[:, :, None]
        for n in range(0, len(which), 40):
            apart = np.linalg.norm(limb[n][:, :, None, None] - leg[n][None, None], axis=-1).min(
                axis=(1, 2, 3)
            )
            assert np.all(apart - arm.radii[near] >= radius - 1e-6)
    assert counts[0] >= counts[1] > counts[2]


def test_the_jacobian_of_lengths_is_their_derivative(cell: Cell) -> None:
    robot, rng = cell.robot.model, np.random.default_rng(3)
    joints = rng.uniform(-60.0, 60.0, (30, 6)) * DEG
    places = rng.uniform(-60.0, 60.0, (40, 6)) * DEG
    balls = lengths.Balls(cell.tool.targets, cell.nests, {"T1": 0.05})
    names = [rng.choice(list(each), 30).tolist() for each in (cell.tool.targets, cell.nests)]
    once = lengths.Lengths(joints, *names)
    seen: list[np.ndarray] = []
    original = lengths.rows_of_lengths

    def numeric(model, estimate, conditions, noise):  # type: ignore[no-untyped-def]
        exact, design = original(model, estimate, conditions, noise), BoundModel(model, conditions)

        def length(at: np.ndarray) -> np.ndarray:
            frames = design.frames(at)
            return np.linalg.norm(frames.p - frames.anchor, axis=0)

        units = design.model.prior_std
        units = np.where(np.isfinite(units) & (units > 0.0), units, 1e-3) * 1e-4
        steps = np.diag(units)
        slopes = np.array([(length(s) - length(-s)) / (2.0 * s.max()) for s in steps]).T
        seen.append(np.abs(exact * noise.length_mm - slopes).max() / np.abs(slopes).max())
        return exact

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(lengths, "rows_of_lengths", numeric)
        u = lengths.uncertainty_of(robot, balls, once, places, noise_mm=0.01, repeatability=0.0)
    assert max(seen) < 1e-5
    assert u.shape == (40,)
    twice = lengths.Lengths(np.tile(joints, (2, 1)), 2 * names[0], 2 * names[1])
    better = lengths.uncertainty_of(robot, balls, twice, places, noise_mm=0.01, repeatability=0.0)
    assert np.all(better < u)
    worse = lengths.uncertainty_of(robot, balls, twice, places, noise_mm=0.01, repeatability=0.01 * DEG)
    assert worse.mean() > better.mean()


def test_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "p.json"
    options = ["--x", "-50", "50", "50", "--turn", "0", "120", "60", "--zone", "350", "0", "360", "200"]
    drawn = tmp_path / "p.svg"
    more = ["--show", "2", "--together", "2", "--picture", str(drawn), "--json", str(out)]
    assert main(["plan-ballbar", str(BALLBAR), *options, *more]) == 0
    document = json.loads(out.read_text("utf-8"))
    assert document["placements"] == 9
    first, second = document["best"]
    assert first["max_u_mm"] <= second["max_u_mm"]
    alone, both = document["plan"]
    assert alone["nests_mm"] == first["nests_mm"]
    assert both["max_u_mm"] < alone["max_u_mm"]
    assert both["nests_mm"] != first["nests_mm"]
    title, *panels = ElementTree.parse(drawn).getroot().iter(f"{SVG}title")
    assert title.text is not None
    assert not panels
    names = [text.text for text in ElementTree.parse(drawn).getroot().iter(f"{SVG}text")]
    assert [names.count(name) for name in ("B1", "B2", "B3")] == [4, 4, 4]  # two placements from two sides
    shown = capsys.readouterr().out
    assert f"B1 = [{first['nests_mm']['B1'][0]:g}, " in shown


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--x", "10", "-10", "5"], "'--x': is 10 -10 5. Give LOW HIGH STEP"),
        (["--turn", "0", "360", "0"], "STEP above zero"),
        (["--x", "-500", "500", "1", "--y", "-500", "500", "1"], "Ask for 20000 at most"),
        (["--base", "B1,B2"], "Name three or four of B1, B2, B3"),
        (["--together", "2"], "'--group-size': needs a zone"),
        (["--x", "0", "1", "1e-9"], "'--x': asks for more than 20000 placements"),
        (["--zone", "9000", "0", "0", "50"], "random postures brings"),
    ],
)
def test_what_is_refused(options: list[str], said: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["plan-ballbar", str(BALLBAR), *options]) in (2, 4)
    assert said in capsys.readouterr().err


def test_a_tracker_has_no_placement(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["plan-ballbar", str(EXAMPLES / "irb120_faro" / "cell.toml")]) == 2
    assert "is not a ballbar. truepose select" in capsys.readouterr().err


def test_a_fourth_cup_carries_the_tool_on_every_three_of_four(cell: Cell) -> None:
    four = with_places(cell, {"B4": (500.0, 210.0, 60.0)}, cell.fixtures)
    one, all_of_them = (
        HexapodSurvey(four, ["B1", "B2", "B3"], ["T1", "T2", "T3"]),
        HexapodSurvey(four, list(four.nests), TOOL),
    )
    assert len(all_of_them.stances.flange) > 2 * len(one.stances.flange)
    (few,), (many,) = one.survey([BallPlacement()]), all_of_them.survey([BallPlacement()])
    assert many.poses > few.poses
    balls = np.array(list(four.nests.values()))
    tool = np.array([four.tool.targets[name] for name in TOOL])
    for flange, base, ball in zip(
        all_of_them.stances.flange, all_of_them.stances.base, all_of_them.stances.tool, strict=True
    ):
        ends = tool[ball] @ flange[:3, :3].T + flange[:3, 3]
        np.testing.assert_allclose(np.linalg.norm(ends - balls[base], axis=1), 300.0, atol=1e-9)
    assert {3} < set(np.unique(all_of_them.stances.base))
    proven = all_of_them.prove(many, 5.0)
    assert few.poses < proven.poses <= many.poses
