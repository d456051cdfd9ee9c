"""A ballbar campaign.

Operator and robot take turns, the zero is kept, and positions out of stroke come again.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from acquisition import Event, Run, export
from acquisition.campaign import make_plan
from acquisition.campaign.plan import check_plan
from acquisition.cell import targets_at
from acquisition.errors import NotResumed, RecordError
from acquisition.record import export_together
from acquisition.record.store import PlannedReading
from acquisition.run.prompts.manual_steps import ManualSteps
from calib import identify, read_dataset
from calib.validation.ballbar import repeats_of_lengths
from drivers import Answer, ConfigError, LinkLost, NotReady, OutOfRange
from tests.acquisition.bars import OFF_DEG, TWO_STAGES, Bar, made
from tests.acquisition.fakes import (
    BALLBAR,
    HEXAPOD,
    JumpingClock,
    SeatingOperator,
    a_campaign,
    a_cell,
    devices_of,
)


@pytest.fixture
def bars(tmp_path: Path) -> Iterator[Any]:
    with made(Bar, tmp_path) as make:
        yield make


def test_every_pose_of_the_plan_has_six_legs_as_long_as_the_bar() -> None:
    cell = a_cell(**BALLBAR)
    visits = make_plan(cell, a_campaign(block=[{"kind": "hexapod", "configurations": "all"}]))
    check_plan(cell, visits)
    names = list(cell.tool.targets)
    assert len({visit.joints_deg for visit in visits}) == len(visits) > 40
    for visit in visits:
        assert len(set(visit.readings)) == 6
        points = targets_at(cell, np.array([visit.joints_deg]))[0]
        legs = [points[names.index(t)] - np.array(cell.nests[b]) for t, b in visit.readings if b]
        np.testing.assert_allclose(
            np.linalg.norm(legs, axis=1), 300.0, atol=0.003
        )  # joints have four decimals


def test_hands_and_robot_take_turns(bars: Any) -> None:
    bar = bars()
    assert bar.execute() == "succeeded"
    moves = ["move", "move"]
    first, second = make_plan(bar.bench.cell, a_campaign(block=HEXAPOD))
    assert bar.bench.log[4:] == [
        *moves,
        *(f"measure {base} {target}" for target, base in first.readings),
        *moves,
        *(f"measure {base} {target}" for target, base in second.readings),
    ]
    assert bar.operator.asked[0].startswith(
        "Take the ballbar off, step back and press confirm: the robot moves to"
    )
    assert [text.split(" and press")[0] for text in bar.operator.asked[1:7]] == [
        f"Attach the ballbar between {base} and {target}" for target, base in first.readings
    ]
    assert bar.operator.asked[7].startswith("Take the ballbar off")
    reading = bar.events_of("reading")[0]
    assert (reading["target"], reading["base_target"]) == first.readings[0]
    assert reading["length_mm"] == pytest.approx(300.0, abs=0.003)


@pytest.mark.parametrize("between", ["taken off", "a pause"])
def test_a_leg_is_attached_anew_after_it_was_taken_off_or_somebody_was_at_it(between: str) -> None:
    cell, asked = a_cell(**BALLBAR), list[str]()

    def ask(text: str, picture: object) -> Answer:
        asked.append(text.partition(" ")[0])
        return Answer.CONFIRM

    hands = ManualSteps(cell, ask, lambda planned: False)
    visit = make_plan(cell, a_campaign(block=HEXAPOD))[0]
    target, base = visit.readings[0]
    leg = PlannedReading(1, visit, target, "planned", base)
    for _ in range(2):
        assert hands.span(leg) is Answer.CONFIRM
    assert asked == ["Attach"], "what hangs there is not asked for again"
    if between == "taken off":
        hands.free(leg)
    else:
        hands.doubt()
    hands.span(leg)
    assert asked[-1] == "Attach"
    assert asked.count("Attach") == 2


def test_a_reading_that_is_skipped_leaves_the_robot_where_it_is(bars: Any) -> None:
    bar = bars(Answer.CONFIRM, Answer.SKIP)  # off, and then the first leg
    assert bar.execute() == "succeeded"
    assert bar.bench.log.count("move") == 4
    assert bar.run.status().skipped == 1


def test_a_skipped_pose_is_not_driven(bars: Any) -> None:
    bar = bars(Answer.SKIP)
    assert bar.execute() == "succeeded"
    assert bar.run.status().skipped == 1


def test_a_redo_goes_back_with_the_bar_off(bars: Any) -> None:
    bar = bars(*[Answer.CONFIRM] * 2, Answer.REDO)  # off, leg 1, and when leg 2 is asked for
    assert bar.execute() == "succeeded"
    assert bar.bench.log.count("move") == 6
    assert len(bar.events_of("measure_again")) == 1
    assert bar.run.status().done == 12


def test_after_a_crash_the_bar_is_taken_off_first(bars: Any) -> None:
    bar = bars()
    bar.crash_at(9)  # while the third leg is measured
    assert (bar.run.status().state, bar.run.status().done) == ("paused", 2)
    assert bar.bench.spanned is not None  # it hangs there still
    bar.run.resume()
    bar.operator.asked.clear()
    assert bar.execute() == "succeeded"
    assert bar.operator.asked[0].startswith("Take the ballbar off")


def test_a_lost_robot_is_approached_again_without_the_bar(bars: Any) -> None:
    bar = bars()

    def lose() -> None:
        raise LinkLost("gone", device="meter")

    bar.bench.faults[8] = lose
    assert bar.execute() == "succeeded"  # the fake robot asserts that no bar hangs on it


@pytest.mark.parametrize("every", [1, 6, 7, 100])
def test_the_zero_is_read_between_poses(bars: Any, every: int) -> None:
    bar = bars(zero_every=every)
    assert bar.execute() == "succeeded"
    expected = 2 if every <= 6 else 1
    assert bar.bench.zeroed == expected
    assert bar.events_of("zeroed") == [{"zero_mm": 0.001, "bar_mm": 300.0}] * expected
    first = bar.bench.log.index("zero")
    assert first < bar.bench.log.index("move")


def test_a_zero_that_is_skipped_is_not_read(bars: Any) -> None:
    bar = bars(Answer.SKIP, zero_every=100)
    assert bar.execute() == "succeeded"
    assert bar.bench.zeroed == 0


def test_a_bar_that_is_not_in_its_calibrator_is_asked_for_again(bars: Any) -> None:
    bar = bars(zero_every=100)

    def outside() -> None:
        raise OutOfRange("the bar is not in its calibrator", device="meter")

    bar.bench.faults[5] = outside
    assert bar.execute() == "succeeded"
    assert bar.bench.zeroed == 1
    assert "not in its calibrator" in bar.operator.asked[1]


def test_a_wrong_extension_bar_is_told_to_the_operator(bars: Any) -> None:
    bar = bars()

    def wrong() -> None:
        raise NotReady("the bar is calibrated to 98.2 mm, the cell needs 300 mm", device="meter")

    bar.bench.faults[4] = wrong  # when the bar is armed
    assert bar.execute() == "succeeded"
    assert "98.2 mm, the cell needs 300 mm" in bar.operator.asked[0]


def test_what_is_out_of_stroke_comes_again_at_corrected_joints(bars: Any) -> None:
    bar = bars(off_deg=OFF_DEG, block=[TWO_STAGES])
    assert bar.execute() == "succeeded"
    (stage,) = bar.events_of("second_stage")
    put_off = bar.events_of("deferred")
    assert 20 < len(put_off) < 0.5 * bar.run.status().total
    assert stage["refused"] == 0
    assert bar.run.status().skipped == 0  # all of them could be had then
    again = sum(len(each["poses"]) for each in bar.events_of("replanned"))
    assert again == len(put_off)
    # Each is tried once per stage: a bar that shows its stop shows it again.
    assert len(bar.events_of("attempt_failed")) == len(put_off)
    dataset = read_dataset(export(bar.folder, bar.folder / "out.csv"))
    assert dataset.usable.sum() == bar.run.status().total
    assert dataset.header.not_taken == 0
    assert dataset.header.instrument == "qc20w"
    found = identify(dataset)
    assert np.all(np.abs(dataset.lengths - 300.0) < 1.0)
    value = dict(zip(found.model.index, found.estimate, strict=True))
    for joint in (2, 4, 5):  # the thetas that neither base nor tool can take
        assert np.degrees(value[f"theta{joint}"]) == pytest.approx(OFF_DEG[joint - 1], abs=0.02)


def test_one_stage_leaves_the_others_out(bars: Any) -> None:
    bar = bars(off_deg=OFF_DEG, block=[{"kind": "hexapod", "stages": 1, "count": 8}])
    assert bar.execute() == "succeeded"
    assert bar.events_of("second_stage") == []
    assert bar.run.status().skipped > 0


def test_too_few_readings_for_a_second_stage_are_told(
    bars: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "none"))  # a stage is planned without a file
    bar = bars(off_deg=OFF_DEG, block=[{"kind": "hexapod", "count": 3}])
    assert bar.execute() == "succeeded"
    (refused,) = bar.events_of("second_stage_refused")
    assert refused["readings"] == bar.run.status().skipped
    assert "readings" in refused["reason"]
    assert refused["reason"].startswith(str(bar.folder / "data.csv"))


def test_a_second_stage_survives_the_end_of_the_program(bars: Any) -> None:
    bar = bars(off_deg=OFF_DEG, block=[TWO_STAGES])

    def crash(event: Event) -> None:
        bar.events.append(event)
        if event.kind == "second_stage":
            bar.run.pause()

    assert bar.run.execute(devices_of(bar.bench, bar.operator), JumpingClock(), crash).state.value == "paused"
    bar.run.close()
    bar.run = Run.open(bar.folder)
    bar.run.resume()
    assert bar.execute() == "succeeded"
    assert len(bar.events_of("second_stage")) == 1
    assert bar.run.status().skipped == 0


def test_a_record_without_a_distance_is_no_data_set(bars: Any, tmp_path: Path) -> None:
    with pytest.raises(RecordError, match="no reading of a pose"):
        export(bars().folder, tmp_path / "out.csv")


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        (
            {"block": [{"count": 3}]},
            "block 1: kind = 'poses' does not go with the qc20w",
        ),
        ({"reference_every": 5}, "need an instrument that measures points"),
        ({"block": [{"kind": "hexapod", "base": ["B1", "B2", "B9"]}]}, "not B1, B2, B9"),
        ({"block": [{"kind": "hexapod", "targets": ["T1", "T2"]}]}, "B3 and T1, T2"),
    ],
)
def test_what_a_ballbar_cannot_do(changes: dict[str, Any], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        make_plan(a_cell(**BALLBAR), a_campaign(**({"block": HEXAPOD} | changes)))


def test_balls_that_the_arm_does_not_reach() -> None:
    far = BALLBAR | {
        "world__nests": {"B1": [1486.6, 50, -100], "B2": [1313.4, 150, -100], "B3": [1400, -100, -100]}
    }
    with pytest.raises(ConfigError, match="reaches no stance of the legs between B1, B2, B3 and T1, T2, T3"):
        make_plan(a_cell(**far), a_campaign(block=HEXAPOD))


def test_a_ballbar_needs_its_length() -> None:
    with pytest.raises(ConfigError, match=r"instrument\.nominal_mm': is missing"):
        a_cell(**(BALLBAR | {"instrument": {"driver": "qc20w", "url": "tcp://127.0.0.1:5703"}}))
    with pytest.raises(ConfigError, match="zero_every needs a ballbar"):
        make_plan(a_cell(), a_campaign(zero_every=10))


def test_a_sphere_about_a_ball_on_the_base(tmp_path: Path) -> None:
    """The taught centre has the target in the ball; every point is a distance to it."""
    cell = a_cell(**BALLBAR)
    pose = make_plan(cell, a_campaign(block=HEXAPOD))[0]
    block = {
        "kind": "sphere",
        "centre_deg": list(pose.joints_deg),
        "targets": ["T1"],
        "base": "B1",
        "count": 5,
    }
    visits = make_plan(cell, a_campaign(block=[block | {"above_deg": 20.0}]))
    assert [visit.readings for visit in visits] == [[("T1", "B1")]] * 5
    for wrong, words in (
        ({"radius_mm": 250.0}, "the ballbar is 300 mm long"),
        ({"base": "B7"}, "'B7' is none of B1"),
    ):
        with pytest.raises(ConfigError, match=words):
            make_plan(cell, a_campaign(block=[block | wrong]))
    with closing(Run.create(tmp_path, cell, a_campaign(block=[block]), simulated=True)) as run:
        assert run.status().total == 5


def test_nothing_within_the_stroke_is_an_end_and_not_a_dead_end(bars: Any) -> None:
    bar = bars(off_deg=(3.0, 3.0, 3.0, 0.0, 0.0, 0.0))
    assert bar.execute() == "failed"
    assert bar.run.status().reason == "Not one pose could be measured."
    (refused,) = bar.events_of("second_stage_refused")
    assert "holds no reading" in refused["reason"]


def test_a_robot_that_was_pushed_while_the_bar_was_put_on_approaches_anew(bars: Any) -> None:
    bar = bars()

    class Pushing(SeatingOperator):
        def ask(self, prompt: Any) -> Answer:
            answer = super().ask(prompt)
            if len(self.asked) == 3:  # off, the first leg, and now the second
                self.bench.where = tuple(q + 0.05 for q in self.bench.where)
            return answer

    bar.operator = Pushing(bar.bench)
    assert bar.execute() == "succeeded"
    (prompt,) = [text for text in bar.operator.asked if "was turned by 0.050 deg" in text]
    assert "approaches the pose again" in prompt
    assert bar.run.status().done == 12
    rows = bar.run._store.database.query(
        "SELECT count(*) FROM attempt WHERE kind = 'arrive' AND status = 'good'"
    )
    assert rows[0][0] == 3


def test_two_records_make_one_data_set(bars: Any, tmp_path: Path) -> None:
    first, second = bars(), bars(seed=9)
    for bar in (first, second):
        assert bar.execute() == "succeeded"
        bar.run.close()
    dataset = read_dataset(export_together([first.folder, second.folder], tmp_path / "both.csv"))
    assert len(dataset) == 24
    assert dataset.spanned.all()
    assert len(set(dataset.reading_id)) == 24
    for bar in (first, second):
        bar.run = Run.open(bar.folder)


def test_balls_that_have_no_above() -> None:
    wall = {"B1": [486.6, 50, -100], "B2": [313.4, 50, -100], "B3": [400, 50, 100]}
    flat = {"T1": [0, 86.6, 0], "T2": [-75, -43.3, 0], "T3": [75, -43.3, 0]}
    for changes, words in (
        ({"world__nests": wall}, "vertical plane"),
        ({"tool__targets": flat}, "with the flange"),
    ):
        with pytest.raises(ConfigError, match=words):
            make_plan(a_cell(**(BALLBAR | changes)), a_campaign(block=HEXAPOD))


def test_a_ballbar_has_no_station(bars: Any) -> None:
    with pytest.raises(NotResumed, match="has no station"):
        bars().run.restation(by="anna")
    with pytest.raises(ConfigError, match="new_station need"):
        make_plan(a_cell(**BALLBAR), a_campaign(block=[*HEXAPOD, HEXAPOD[0] | {"new_station": True}]))


def test_distances_are_repeated(bars: Any) -> None:
    """Nubiola 3.5: two poses in turn, three visits each, one leg."""
    legs = [visit.readings[:1] for visit in make_plan(a_cell(**BALLBAR), a_campaign(block=HEXAPOD))]
    poses = [list(visit.joints_deg) for visit in make_plan(a_cell(**BALLBAR), a_campaign(block=HEXAPOD))]
    block = {"kind": "repeat", "select": "list", "joints_deg": poses, "visits": 3}
    bar = bars(block=[block | {"legs": [[list(leg) for leg in row] for row in legs]}])
    assert bar.execute() == "succeeded"
    dataset = read_dataset(export(bar.folder, bar.folder / "out.csv"))
    assert list(dataset.sets) == ["repeat"] * 6
    assert len(np.unique(dataset.conditions.pose)) == 2
    repeats = repeats_of_lengths(dataset)
    assert repeats is not None
    assert (repeats.poses, repeats.readings) == (2, 6)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"legs": [[["T1", "B1"]]]}, r"block\[0\]\.legs"),
        ({"select": "random", "count": 1, "legs": [[["T1", "B1"]]]}, r"block\[0\]\.legs"),
        ({"legs": [[["T1", "B9"]], [["T1", "B1"]]]}, "no leg from 'T1' to 'B9'"),
        ({}, "kind = 'repeat' does not go with the qc20w"),
    ],
)
def test_distances_that_cannot_be_repeated(changes: dict[str, Any], words: str) -> None:
    pose = [0.0, 20.0, 0.0, 0.0, 60.0, 0.0]
    block = {"kind": "repeat", "select": "list", "joints_deg": [pose, pose]} | changes
    with pytest.raises(ConfigError, match=words):
        make_plan(a_cell(**BALLBAR), a_campaign(block=[block]))
