"""Gates during a campaign.

The arm warms up, the nests are checked, the instrument is set up again, the arm settles.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from acquisition import Devices, Event, ExecutionOutcome, Run, export
from acquisition.campaign.blocks.block import Settle
from acquisition.campaign.campaign import campaign_of_record
from acquisition.record.readings import ReferenceDrift, drift_of
from acquisition.run.rig.rig import TRIES, until_still
from calib import read_dataset
from drivers import Answer, ConfigError, JointReading, NoisyMeasurement, NoOperator, PointReading, Prompt
from tests.acquisition.fakes import (
    Bench,
    FakeArm,
    FakeMeter,
    JumpingClock,
    SeatingOperator,
    a_campaign,
    a_cell,
)

WARM_UP = {"below_mm": 0.02, "over": 3, "every_s": 300.0, "at_most_s": 7200.0}
CREEP_MM, CREEP_S = 0.2, 900.0


class CreepingMeter(FakeMeter):
    """Sees the tool creep along x as the arm warms up."""

    def __init__(self, bench: Bench, clock: JumpingClock) -> None:
        super().__init__(bench)
        self.clock = clock
        self.creep_mm = CREEP_MM

    def measure(
        self, target: str, *, samples: int = 100, near_mm: Sequence[float] | None = None
    ) -> PointReading:
        reading = super().measure(target, samples=samples, near_mm=near_mm)
        if target in self.bench.cell.nests:
            return reading
        x, y, z = reading.xyz_mm
        return replace(reading, xyz_mm=(x + self.creep_mm * math.exp(-self.clock.now() / CREEP_S), y, z))


class Stage:
    """A run on fakes that creep."""

    def __init__(self, folder: Path, *answers: Answer, driver: str = "faro", **campaign: Any) -> None:
        self.folder = folder
        cell = a_cell(robot__table_z_mm=-2000.0, instrument__driver=driver)  # no table, no detours
        self.bench = Bench(cell)
        self.clock = JumpingClock()
        self.arm = FakeArm(self.bench)
        self.meter = CreepingMeter(self.bench, self.clock)
        self.operator = SeatingOperator(self.bench, answers)
        campaign = {"block": [{"count": 6, "targets": ["T1"]}]} | campaign
        self.run = Run.create(folder / "r", self.bench.cell, a_campaign(**campaign), simulated=True)

    def execute(self, on_event: Callable[[Event], None] | None = None) -> ExecutionOutcome:
        return self.run.execute(Devices(self.arm, self.meter, self.operator), self.clock, on_event)

    def events(self, kind: str) -> list[Event]:
        return [event for event in self.run.events() if event.kind == kind]


@pytest.fixture
def make(tmp_path: Path) -> Iterator[Callable[..., Stage]]:
    made: list[Stage] = []

    def one(*answers: Answer, **campaign: Any) -> Stage:
        made.append(Stage(tmp_path, *answers, **campaign))
        return made[-1]

    yield one
    for stage in made:
        with closing(stage.run):
            pass


# -- warm-up ----------------------------------------------------------------------------------------------


def test_the_reference_pose_is_measured_until_it_stands(make: Callable[..., Stage]) -> None:
    stage = make(warm_up=WARM_UP)
    assert stage.execute().state.value == "succeeded"
    readings = [e for e in stage.events("reading") if e.data["set"] == "reference"]
    at = [e.t_s or 0.0 for e in readings]
    # 300 s take the creep to 1/1.4: it stands when 0.2 exp(-t/900) (1 - exp(-600/900)) has come below 0.02.
    last = at[-1] - 600.0
    assert CREEP_MM * math.exp(-last / CREEP_S) * (1.0 - math.exp(-600.0 / CREEP_S)) <= 0.02
    before = last - 300.0
    assert CREEP_MM * math.exp(-before / CREEP_S) * (1.0 - math.exp(-600.0 / CREEP_S)) > 0.02
    for earlier, later in itertools.pairwise(at):
        assert later - earlier == pytest.approx(300.0, abs=10.0)
    others = [e.t_s or 0.0 for e in stage.events("reading") if e.data["set"] == "calibration"]
    assert min(others) > at[-1]
    (warm,) = stage.events("warm")
    assert warm.data["readings"] == len(readings)
    assert warm.data["spread_mm"] <= 0.02
    assert stage.bench.log.count("move") == 2 * (len(readings) + 6)  # every one over its approach point
    assert stage.run.status().total == 7
    dataset = read_dataset(export(stage.folder / "r", stage.folder / "data.csv"))
    assert (dataset.sets[dataset.usable] == "reference").sum() == 1
    assert stage.operator.asked == []


def test_an_arm_that_never_stands_is_for_a_person_to_judge(make: Callable[..., Stage]) -> None:
    gate = WARM_UP | {"below_mm": 1e-3, "at_most_s": 1500.0}
    stage = make(warm_up=gate)
    assert stage.execute().state.value == "succeeded"
    (asked,) = stage.operator.asked
    assert "the reference pose still moves by 0.0" in asked
    assert "0.001 mm are allowed" in asked


def test_abort_at_the_gate_stops(make: Callable[..., Stage]) -> None:
    stage = make(Answer.ABORT, warm_up=WARM_UP | {"below_mm": 1e-3, "at_most_s": 600.0})
    assert stage.execute().state.value == "stopped"
    assert {e.data["set"] for e in stage.events("reading") if e.data["set"] != "nest"} == {"reference"}


def test_a_resumed_campaign_asks_its_arm_again(make: Callable[..., Stage]) -> None:
    stage = make(warm_up=WARM_UP)
    counts = itertools.count()

    def pause(event: Event) -> None:
        if event.kind == "reading" and event.data["set"] == "calibration" and next(counts) == 2:
            stage.run.pause()

    assert stage.execute(pause).state.value == "paused"
    resumed = stage.run.status().version
    stage.run.resume()
    assert stage.execute().state.value == "succeeded"
    again = [e.data["set"] for e in stage.run.events(after=resumed) if e.kind == "reading"]
    assert again == ["nest"] * 3 + ["reference"] * 3 + ["calibration"] * 3
    assert len(stage.events("warm")) == 2


def test_a_reference_pose_that_cannot_be_measured_does_not_hold_up_the_rest(
    make: Callable[..., Stage],
) -> None:
    stage = make(warm_up=WARM_UP, block=[{"count": 2, "targets": ["T2"]}])
    stage.bench.hidden = {"T1"}
    assert stage.execute().state.value == "succeeded"
    assert [e.data["spread_mm"] for e in stage.events("warm")] == [None]
    assert stage.run.status().skipped == 1


# -- nests ------------------------------------------------------------------------------------------------


def test_nests_are_checked_after_so_many_readings(make: Callable[..., Stage]) -> None:
    stage = make(nest_check={"every": 4, "limit_mm": 0.05}, block=[{"count": 6, "targets": ["T1", "T2"]}])
    assert stage.execute().state.value == "succeeded"
    nests = ["measure N1", "measure N2", "measure N3"]
    visit = ["move", "move", "measure T1", "measure T2"]
    assert stage.bench.log[4:] == [*nests, *visit * 2] * 3 + nests
    assert [e.data["off_mm"] for e in stage.events("nests_checked")] == [0.0, 0.0, 0.0]
    assert stage.operator.asked == []


def test_a_check_in_mid_visit_waits_for_its_end(make: Callable[..., Stage]) -> None:
    stage = make(nest_check={"every": 1, "limit_mm": 0.05}, block=[{"count": 2, "targets": ["T1", "T2"]}])
    assert stage.execute().state.value == "succeeded"
    assert stage.bench.log.count("move") == 4
    assert len(stage.events("nests_checked")) == 2


@pytest.mark.parametrize("answer", [Answer.CONFIRM, Answer.REDO])
@pytest.mark.parametrize("driver", ["faro", "emscon"])
def test_an_instrument_that_moved_unseen_is_known_at_the_end(
    make: Callable[..., Stage], answer: Answer, driver: str
) -> None:
    """Catches a tracker that locked on again 0.8 mm off after the last check of nests."""
    aims = 3 * (driver == "emscon")  # a person, once
    stage = make(*[Answer.CONFIRM] * aims, answer, driver=driver, nest_check={"every": 100, "limit_mm": 0.05})

    def push(event: Event) -> None:
        if event.kind == "reading" and event.data["set"] == "calibration":
            stage.bench.shift_mm = dict.fromkeys(stage.bench.cell.nests, 0.3)

    assert stage.execute(push).state.value == "succeeded"
    assert len(stage.operator.asked) == aims + 1
    assert "is 0.300 mm from where the world frame has it" in stage.operator.asked[-1]
    again = [e.data["poses"] for e in stage.events("measure_again") if len(e.data["poses"]) == 6]
    assert len(again) == (answer is Answer.REDO)
    assert stage.bench.log.count("measure T1") == 6 * (1 + len(again))


@pytest.mark.parametrize("retaken", [0, 1])
def test_moved_nests_are_asked_about_again_where_the_question_was_cut_off(
    make: Callable[..., Stage], monkeypatch: pytest.MonkeyPatch, retaken: int
) -> None:
    """Catches readings of a moved instrument, kept because no operator was there."""
    stage = make(Answer.REDO, nest_check={"every": 100, "limit_mm": 0.05})
    answers = stage.operator.ask

    def push(event: Event) -> None:
        if event.kind == "reading" and event.data["set"] == "calibration":
            stage.bench.shift_mm = dict.fromkeys(stage.bench.cell.nests, 0.3)

    def nobody(prompt: Prompt) -> Answer:
        raise NoOperator("gone home")

    monkeypatch.setattr(stage.operator, "ask", nobody)
    assert stage.execute(push).state.value == "paused"
    since = stage.events("nests_checked")[-1].data["since"]
    assert len(since) == 6
    stage.run._store.measure_again(since[:retaken], "retaken in the pause")
    monkeypatch.setattr(stage.operator, "ask", answers)
    stage.run.resume()
    assert stage.execute().state.value == "succeeded"
    assert since[retaken:] in [e.data["poses"] for e in stage.events("measure_again")]
    assert len(stage.events("nests_judged")) == 1


def test_a_nest_beyond_the_limit_is_for_a_person_to_judge(make: Callable[..., Stage]) -> None:
    stage = make(nest_check={"every": 3, "limit_mm": 0.05})

    def push(event: Event) -> None:
        if event.kind == "reading" and event.data["set"] == "calibration":
            stage.bench.shift_mm["N2"] = 0.3

    assert stage.execute(push).state.value == "succeeded"
    (asked,) = stage.operator.asked
    assert "Nest N2 is 0.300 mm from where the world frame has it, the limit is 0.05 mm" in asked
    assert len(stage.events("instrument_moved")) == 1
    # People were at the cell: the reading after the question has an approach of its own.
    assert stage.bench.log.count("move") == 2 * 6


def test_slow_creep_of_a_nest_adds_up(make: Callable[..., Stage]) -> None:
    """Each step is within the noise, so that the frame stays; the limit counts from the frame."""
    stage = make(nest_check={"every": 1, "limit_mm": 0.025}, block=[{"count": 4, "targets": ["T1"]}])

    def push(event: Event) -> None:
        if event.kind == "reading" and event.data["set"] == "calibration":
            stage.bench.shift_mm["N2"] = stage.bench.shift_mm.get("N2", 0.0) + 0.01

    assert stage.execute(push).state.value == "succeeded"
    assert [e.data["off_mm"] for e in stage.events("nests_checked")] == pytest.approx(
        [0.01, 0.02, 0.03, 0.04]
    )
    assert len(stage.operator.asked) == 2
    assert stage.events("instrument_moved") == []


def test_a_new_station_is_set_up_before_its_block(make: Callable[..., Stage]) -> None:
    blocks = [{"count": 2, "targets": ["T1"]}, {"count": 2, "targets": ["T1"], "new_station": True}]
    stage = make(block=blocks, order="shuffled")
    assert stage.execute().state.value == "succeeded"
    (asked,) = stage.operator.asked
    assert asked.startswith("Set up the instrument at its next station")
    nests, visit = ["measure N1", "measure N2", "measure N3"], ["move", "move", "measure T1"]
    assert stage.bench.log[4:] == [*nests, *visit * 2, *nests, *visit * 2]


def test_a_campaign_resumed_at_its_second_station_stays_there(make: Callable[..., Stage]) -> None:
    blocks = [{"count": 1, "targets": ["T1"]}, {"count": 3, "targets": ["T1"], "new_station": True}]
    stage = make(block=blocks)
    seen = itertools.count(1)

    def pause(event: Event) -> None:
        if event.kind == "reading" and event.data["set"] == "calibration" and next(seen) == 2:
            stage.run.pause()

    assert stage.execute(pause).state.value == "paused"
    stage.run.resume()
    assert stage.execute().state.value == "succeeded"
    assert len(stage.operator.asked) == 1


# -- drift ------------------------------------------------------------------------------------------------


def test_drift_is_that_of_the_reference_pose(make: Callable[..., Stage]) -> None:
    stage = make(reference_every=2)
    shown: list[ReferenceDrift | None] = []

    def watch(event: Event) -> None:
        if event.kind == "reading" and event.data["set"] == "reference":
            shown.append(drift_of(stage.run._store))

    assert stage.execute(watch).state.value == "succeeded"
    at = [e.t_s or 0.0 for e in stage.events("reading") if e.data["set"] == "reference"]
    assert shown[0] is None
    for drift, now, count in zip(shown[1:], at[1:], itertools.count(2), strict=False):
        assert drift is not None
        wanted = CREEP_MM * (math.exp(-at[0] / CREEP_S) - math.exp(-now / CREEP_S))
        assert drift.readings == count
        assert drift.off_mm == pytest.approx(wanted, abs=2e-6)
        assert drift.most_mm == drift.off_mm
    last = shown[-1]
    assert last is not None
    assert stage.run.status().drift == last.as_dict()


# -- settling ---------------------------------------------------------------------------------------------


@given(st.lists(st.floats(-0.1, 0.1), min_size=1, max_size=TRIES - 1), st.floats(1e-5, 1e-2))
def test_still_is_two_equal_read_backs(swing: list[float], resolution: float) -> None:
    replies = [JointReading((q, 1.0), resolution) for q in [*swing, 0.5, 0.5]]
    asked: list[JointReading] = []
    waited: list[float] = []

    def position() -> JointReading:
        asked.append(replies[len(asked)])
        return asked[-1]

    found = until_still(position, waited.append)
    assert found is asked[-1]
    assert abs(asked[-1].joints_deg[0] - asked[-2].joints_deg[0]) <= resolution
    for one, other in itertools.pairwise(asked[:-1]):
        assert abs(one.joints_deg[0] - other.joints_deg[0]) > resolution
    assert len(waited) == len(asked) - 1


def test_an_arm_that_never_rests_is_told() -> None:
    swing = itertools.cycle([0.0, 0.1])
    with pytest.raises(NoisyMeasurement, match=r"still moves by 0\.1000 deg"):
        until_still(lambda: JointReading((next(swing),), 1e-3), lambda _: None)


class SwingingArm(FakeArm):
    """Tells the end of a move while it still swings."""

    left = 3  # it stands still before its first move

    def move_to(self, joints_deg: Sequence[float]) -> JointReading:
        reached = super().move_to(joints_deg)
        self.left = 0
        return reached

    def position(self) -> JointReading:
        reading = super().position()
        self.left += 1
        off = 0.01 * max(0, 3 - self.left)
        return replace(reading, joints_deg=tuple(q + off for q in reading.joints_deg))


def test_a_block_may_ask_for_the_check(make: Callable[..., Stage]) -> None:
    stage = make(block=[{"count": 1, "targets": ["T1"], "settle_s": 1.5, "settle_check": True}])
    stage.arm = SwingingArm(stage.bench)
    assert stage.execute().state.value == "succeeded"
    assert stage.arm.left == 5  # and once more after the reading
    began, ended = (stage.events(kind)[-1].t_s or 0.0 for kind in ("world_frame", "arrived"))
    # Half a second to see that it stands before its first way, the pause, and three looks until it stands again.
    assert ended - began == pytest.approx(0.5 + 1.5 + 3 * 0.5, abs=0.1)


# -- files ------------------------------------------------------------------------------------------------


def test_settling_of_blocks() -> None:
    campaign = a_campaign(
        settle_s=3.0,
        settle_check=True,
        block=[
            {"count": 1},
            {"count": 1, "settle_s": 1.0, "settle_check": False},
            {"kind": "sphere", "centre_deg": [0.0] * 6},
        ],
    )
    wanted = [Settle(3.0, True), Settle(1.0, False), Settle(2.0, True), Settle(3.0, True)]
    assert [campaign.settle_of(number) for number in (0, 1, 2, -1)] == wanted
    assert campaign_of_record(campaign.source, "record") == campaign


@pytest.mark.parametrize(
    ("change", "key"),
    [
        ({"warm_up": {}}, "warm_up.below_mm"),
        ({"warm_up": {"below_mm": 0.0}}, "warm_up.below_mm"),
        ({"warm_up": {"below_mm": 0.1, "over": 1}}, "warm_up.over"),
        ({"warm_up": {"below_mm": 0.1, "every": 1}}, "warm_up.every"),
        ({"warm_up": 3600}, "warm_up"),
        ({"nest_check": {"every": 10}}, "nest_check.limit_mm"),
        ({"nest_check": {"every": 0, "limit_mm": 0.1}}, "nest_check.every"),
        ({"nest_check": {"every": 1, "limit_mm": 0.1, "n": 1}}, "nest_check.n"),
        ({"settle_check": 1}, "settle_check"),
    ],
)
def test_gates_refused_by_key(change: dict[str, Any], key: str) -> None:
    with pytest.raises(ConfigError) as caught:
        a_campaign(**change)
    assert f"key '{key}'" in str(caught.value), caught.value
