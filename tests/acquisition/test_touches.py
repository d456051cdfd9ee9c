"""Cups of the base taught by the robot.

These would catch: an arm that is armed while a person jogs it, a touch of another cup or by another ball that is
accepted, and one that the sides of the triangle contradict. They would also catch poses that stay planned for wrong
places of the cups, and a data set with other places of the cups than the poses.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from acquisition import Devices, export
from acquisition.campaign import make_plan
from acquisition.cell import targets_at
from acquisition.record.readings import readings_of, touches_of
from acquisition.record.touches import Taught
from calib import DataError, read_dataset
from calib.units import DEG
from drivers import Answer, ConfigError
from tests.acquisition.bars import OFF_DEG, Bar, made
from tests.acquisition.fakes import HEXAPOD, Bench, FakeArm, FakeBar, JumpingClock, a_campaign, a_cell
from tests.acquisition.test_ballbar_geometry import BALLBAR, SIDES

TOUCHED = {"kind": "ballbar_geometry", "touch_with": "T1"}
CUPS = ("B1", "B2", "B3")


class FakeHands:
    """Operator who brings a ball of the real arm into a cup.

    `mistakes` gives, by cup, the touch of the first time as (ball, cup, mm off).
    """

    def __init__(self, bench: Bench, arm: FakeArm, mistakes: dict[str, tuple[str, str, float]]) -> None:
        self.bench, self.arm, self.mistakes = bench, arm, dict(mistakes)
        self.touched: list[str] = []

    def touch(self, target: str, base_target: str, near_deg: Sequence[float]) -> None:
        assert not self.arm.armed, "a person is at an armed robot"
        ball, cup, off_mm = self.mistakes.pop(base_target, (target, base_target, 0.0))
        bench, names = self.bench, list(self.bench.cell.tool.targets)
        place = np.add(bench.cell.nests[cup], (bench.shift_mm.get(cup, 0.0) + off_mm, 0.0, 0.0))

        def left(q: Any) -> Any:
            return place - targets_at(bench.cell, (q + np.array(bench.off_deg))[None])[0, names.index(ball)]

        joints = np.array(near_deg)  # of an ABB: model and controller count alike
        for _ in range(30):
            slope = np.array([left(joints) - left(joints + d) for d in 0.01 * np.eye(6)]).T / 0.01
            joints = joints + np.linalg.pinv(slope) @ left(joints)
        assert np.linalg.norm(left(joints)) < 1e-6
        bench.where = tuple(float(q) for q in joints)
        bench.log.append(f"touch {base_target}")
        self.touched.append(base_target)

    def jog(self, joints_deg: Sequence[float]) -> None:
        assert not self.arm.armed, "a person is at an armed robot"
        self.bench.where = tuple(joints_deg)
        self.bench.log.append("jog")


class Touching(Bar):
    """A ballbar campaign that begins with touches."""

    def __init__(self, folder: Path, *answers: Answer, **options: Any) -> None:
        self.mistakes: dict[str, tuple[str, str, float]] = options.pop("mistakes", {})
        everything: dict[str, Any] = {"cell": BALLBAR, "block": [TOUCHED, *HEXAPOD]} | options
        super().__init__(folder, *answers, **everything)
        self.hands: FakeHands | None = None

    def execute(self) -> str:
        arm = FakeArm(self.bench)
        self.hands = FakeHands(self.bench, arm, self.mistakes)
        devices = Devices(arm, FakeBar(self.bench), self.operator, self.hands)
        return self.run.execute(devices, JumpingClock(), self.events.append).state.value


@pytest.fixture
def bars(tmp_path: Path) -> Iterator[Any]:
    with made(Touching, tmp_path) as make:
        yield make


def told_again(bar: Touching, words: str) -> list[str]:
    return [text for text in bar.operator.asked if words in text]


def test_cups_are_touched_between_the_two_triangles_by_an_arm_that_is_not_armed(bars: Any) -> None:
    bar: Touching = bars()
    assert bar.execute() == "succeeded"
    log = [call for call in bar.bench.log if call.split()[0] in ("touch", "jog", "move", "build", "measure")]
    assert log[:13] == [
        *("build 150", *(f"measure {other} {one}" for one, other in SIDES[:3])),
        *("touch B1", "touch B2", "touch B3", "jog"),
        *("build 300", *(f"measure {other} {one}" for one, other in SIDES[3:]), "move"),
    ]
    (prompt,) = told_again(bar, "until T1 sits in B2")
    assert "The robot is not armed" in prompt
    assert told_again(bar, "Jog T1 out of B3")


def test_poses_and_data_set_have_the_cups_where_the_robot_believes_them(bars: Any, tmp_path: Path) -> None:
    bar: Touching = bars(off_deg=OFF_DEG)
    bar.bench.shift_mm |= dict.fromkeys(CUPS, 2.0)
    assert bar.execute() == "succeeded"
    cell, (taught,) = bar.bench.cell, bar.events_of("taught")
    touches = {row.base_target: row.reached for row in touches_of(bar.run._store)}
    for cup, reached in touches.items():
        believed = targets_at(cell, np.array([reached]))[0, 0]
        np.testing.assert_allclose(taught["touched_mm"][cup], believed, atol=1e-4)
        assert np.linalg.norm(np.subtract(taught["nests_mm"][cup], believed)) < 1.0  # the triangle's shape
    places = {name: np.array(place) for name, place in taught["nests_mm"].items()}
    for pair, side in taught["sides_mm"].items():
        one, other = pair.split()
        assert np.linalg.norm(places[one] - places[other]) == pytest.approx(side, abs=2e-4)
    planned = [p for p in bar.run._store.plan() if p.visit.joints_deg and "corrected" not in p.visit.name]
    for each in planned:
        ball = targets_at(cell, np.array([each.visit.joints_deg]))[
            0, list(cell.tool.targets).index(each.target)
        ]
        assert np.linalg.norm(ball - places[each.base_target or ""]) == pytest.approx(300.0, abs=0.01)
    dataset = read_dataset(export(bar.folder, tmp_path / "out.csv"))
    assert {n: list(p) for n, p in dataset.header.base_targets.items()} == {
        n: list(p) for n, p in taught["nests_mm"].items()
    }
    assert dict(dataset.header.base_targets_u_mm) == dict.fromkeys(CUPS, 1.0)
    assert not set(CUPS) & set(dataset.header.u_mm_assumed)
    assert len(dataset.spans) == 6  # a touch is no distance that the bar has measured


def test_more_legs_are_within_the_stroke_than_by_the_cell_file(bars: Any) -> None:
    blocks = [{"kind": "hexapod", "set": "calibration", "count": 10, "stages": 1}]
    missed = []
    for first in ([{"kind": "ballbar_geometry"}], [TOUCHED]):
        bar: Touching = bars(off_deg=OFF_DEG, block=[*first, *blocks])
        bar.bench.shift_mm |= dict.fromkeys(CUPS, 2.0)
        bar.execute()
        missed.append(bar.run.status().skipped)
    assert missed[1] < missed[0] / 3


def test_a_placed_pose_keeps_its_place_its_legs_and_its_branch(bars: Any) -> None:
    bar: Touching = bars(block=[TOUCHED, *HEXAPOD, {"kind": "ballbar_geometry"}])
    bar.bench.shift_mm |= dict.fromkeys(CUPS, 3.0)
    before = {v.number: v for v in make_plan(bar.bench.cell, bar.run.campaign) if v.joints_deg}
    assert bar.execute() == "succeeded"
    after = {p.visit.number: p.visit for p in bar.run._store.plan() if p.visit.joints_deg}
    assert after.keys() == before.keys()
    for number, visit in after.items():
        assert visit.readings == before[number].readings
        apart = np.abs(np.subtract(visit.joints_deg, before[number].joints_deg))
        assert 1e-3 < apart.max() < 5.0
    assert bar.bench.log[-1] == "measure B3 B2"  # the last block still comes last


def test_another_cup_and_another_ball_are_named_and_done_again(bars: Any) -> None:
    bar: Touching = bars(
        mistakes={"B1": ("T1", "B2", 0.0), "B2": ("T2", "B2", 0.0), "B3": ("T1", "B3", 60.0)},
        block=[TOUCHED, HEXAPOD[0] | {"count": 1}],
    )
    assert bar.execute() == "succeeded"
    said = told_again(bar, "are expected")
    for text, named in zip(
        said,
        (
            "T1 is 300.0 mm from B1, and at most 25 mm are expected; it is T1 in B2",
            "from B2, and at most 25 mm are expected; it is T2 in B2",
            "T1 is 60.0 mm from B3, and at most 25 mm are expected",
        ),
        strict=True,
    ):
        assert named in text
    assert bar.hands is not None
    assert bar.hands.touched == ["B1", "B1", "B2", "B2", "B3", "B3"]
    assert bar.run.status().skipped == 0
    assert bar.events_of("taught")[0]["off_mm"] < 0.01


def test_a_cup_touched_beside_its_seat_is_accused_by_the_sides_and_touched_again(bars: Any) -> None:
    bar: Touching = bars(mistakes={"B1": ("T1", "B1", 9.0)})
    assert bar.execute() == "succeeded"
    (said,) = told_again(bar, "by the touches and")
    assert ": B1 was not touched where it is, or has moved since" in said
    assert bar.hands is not None
    assert bar.hands.touched == ["B1", "B2", "B3", "B1"]
    assert bar.events_of("taught")[0]["off_mm"] < 0.01
    assert bar.run.status().skipped == 0


def test_sides_that_make_no_triangle_are_refused_and_a_shape_that_fits_is_not() -> None:
    touched = {"B1": (0.0, 0.0, 0.0), "B2": (300.0, 0.0, 0.0), "B3": (150.0, 259.8, 0.0)}
    sides = {("B1", "B2"): 300.2, ("B1", "B3"): 299.9, ("B2", "B3"): 300.1}
    good = Taught(touched, sides, (), {})
    assert good.accused == ()
    frame = good.frame
    assert frame is not None
    np.testing.assert_allclose(frame.to_world(good.nests_mm["B2"]), [300.2, 0.0, 0.0], atol=2e-4)
    np.testing.assert_allclose(frame.to_world(good.nests_mm["B1"]), 0.0, atol=2e-4)
    assert abs(frame.to_world(good.nests_mm["B3"])[2]) < 2e-4
    impossible = Taught(touched, sides | {("B2", "B3"): 601.0}, (), {})
    with pytest.raises(DataError, match="make no triangle"):
        _ = impossible.nests_mm


def test_an_impossible_triangle_pauses_where_nobody_measures_it_again(bars: Any, monkeypatch: Any) -> None:
    bar: Touching = bars()
    real = FakeBar.measure

    def measure(self: FakeBar, target: str, *, base_target: str, samples: int = 100) -> Any:
        reading = real(self, target, base_target=base_target, samples=samples)
        wrong = {target, base_target} == {"B2", "B3"}
        return type(reading)(*_values(reading, 601.0 if wrong else reading.length_mm))

    monkeypatch.setattr(FakeBar, "measure", measure)
    assert bar.execute() == "paused"
    said = told_again(bar, "the base triangle is impossible")
    assert len(said) == 2  # it was measured again, and still was
    assert "move" not in bar.bench.log


def _values(reading: Any, length_mm: float) -> list[Any]:
    names = list(type(reading).__dataclass_fields__)
    return [length_mm if name == "length_mm" else getattr(reading, name) for name in names]


def test_resuming_asks_for_no_touch_again_and_keeps_the_poses(bars: Any) -> None:
    bar: Touching = bars()
    bar.crash_at(22)  # in the middle of the legs
    assert re.match("measure B. T", bar.bench.log[-1])
    (taught,) = bar.events_of("taught")
    bar.run.resume()
    assert bar.execute() == "succeeded"
    assert bar.hands is not None
    assert bar.hands.touched == []
    assert len(bar.events_of("taught")) == 1
    assert taught["poses"] == 2
    assert len([row for row in readings_of(bar.run._store) if row.counts]) == 12


def test_a_skipped_touch_leaves_the_cups_where_the_cell_file_has_them(bars: Any) -> None:
    bar: Touching = bars(*[Answer.CONFIRM] * 4, Answer.SKIP)
    assert bar.execute() == "succeeded"
    assert bar.events_of("taught") == []
    assert bar.run.status().skipped == 1


def test_a_touch_needs_a_ball_of_the_tool_and_the_first_three_cups() -> None:
    cell = a_cell(**BALLBAR)
    for wrong, match in (
        ({"touch_with": "T9"}, "touch_with = 'T9' is none of T1, T2, T3"),
        ({"touch_with": "T1", "base": ["B1", "B2"]}, "needs the first three of B1, B2, B3"),
    ):
        with pytest.raises(ConfigError, match=match):
            make_plan(cell, a_campaign(block=[{"kind": "ballbar_geometry"} | wrong]))


def test_the_simulated_arm_is_jogged_into_the_cup() -> None:
    from mocks.cell import Cell
    from mocks.cell_file import CellFile
    from mocks.shared.at_rest import state_at_rest

    nests = {"B1": (350.0, 173.2, 60.0), "B2": (200.0, -86.6, 60.0), "B3": (500.0, -86.6, 60.0)}
    targets = {"T1": (0.0, 86.6, 100.0), "T2": (-75.0, -43.3, 100.0)}
    cell = Cell(
        CellFile(
            robot="fanuc-lrmate200ic", nests=nests, targets=targets, robot_driver="fanuc", effects=("none",)
        )
    )
    cell._touch({"target": "T1", "base": "B1", "near_deg": [32, 49, -74, 0, -16, -62]})
    there = cell.world.true_point(state_at_rest(cell.world, cell.arm, cell.clock), "T1")
    assert np.linalg.norm(np.subtract(there, nests["B1"])) < 0.05
    cell.qc20w.device.balls["B1"] = np.array([5000.0, 0.0, 0.0])
    with pytest.raises(ValueError, match="does not bring T1"):
        cell._touch({"target": "T1", "base": "B1", "near_deg": [0.1 / DEG] * 6})
