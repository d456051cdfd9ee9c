"""The triangles of the balls measured in a campaign.

These would catch: an arm that moves for them, a bar that is not the one that fits, and a zero of another bar. They
would also catch a distance that goes to the data set as a leg, and one measured again on resuming.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest

from acquisition import Event, export
from acquisition.campaign import make_plan
from acquisition.campaign.plan import Forecast, check_plan
from acquisition.cell.cell import bar_between, bars_of
from acquisition.record.readings import readings_of
from acquisition.run import PROMPT
from acquisition.run.ballbar.distances import STAGE_1, BallbarChecks
from calib import load_model, read_dataset
from drivers import Answer, ConfigError, LengthReading, Prompt
from tests.acquisition.bars import OFF_DEG, TWO_STAGES, Bar, made
from tests.acquisition.fakes import BALLBAR as FIXTURE
from tests.acquisition.fakes import HEXAPOD, FakeBar, JumpingClock, a_campaign, a_cell, devices_of

# Base balls as far apart as the bar of 300 mm.
BALLBAR = FIXTURE | {
    "world__nests": {"B1": [573.2, 33.0, -100.0], "B2": [313.4, 183.0, -100.0], "B3": [313.4, -117.0, -100.0]}
}
GEOMETRY = {"kind": "ballbar_geometry"}
SIDES = [("T1", "T2"), ("T1", "T3"), ("T2", "T3"), ("B1", "B2"), ("B1", "B3"), ("B2", "B3")]


@pytest.fixture
def bars(tmp_path: Path) -> Iterator[Any]:
    with made(Bar, tmp_path, cell=BALLBAR) as make:
        yield make


def test_every_side_has_the_bar_that_fits() -> None:
    cell = a_cell(**BALLBAR)
    visits = make_plan(cell, a_campaign(block=[GEOMETRY, *HEXAPOD]))
    check_plan(cell, visits)
    assert [visit.readings[0] for visit in visits[:6]] == SIDES
    assert [bar.length_mm for bar in (bar_between(cell, *side) for side in SIDES) if bar] == [150.0] * 3 + [
        300.0
    ] * 3
    assert bar_between(cell, "T1", "T2").in_words() == (  # type: ignore[union-attr]
        "the ballbar of 150 mm: 100 mm and the extension bar of 50 mm"
    )
    assert {bar.length_mm for bar in bars_of(cell)} == {100, 150, 250, 300, 400, 450, 550, 600}
    assert Forecast.of(cell, a_campaign(block=[GEOMETRY, *HEXAPOD]), visits).total_s > 0.0


def test_balls_between_which_no_bar_fits_are_left_out_and_named_where_none_does() -> None:
    odd = {"T1": [0.0, 80.0, 100.0], "T2": [-60.0, -40.0, 100.0], "T3": [60.0, -40.0, 100.0]}
    cell = a_cell(**(BALLBAR | {"tool__targets": odd}))
    visits = make_plan(cell, a_campaign(block=[GEOMETRY]))
    assert [visit.readings[0] for visit in visits] == SIDES[3:]
    with pytest.raises(ConfigError, match="no bar fits between two balls of T1, T2, T3, B1"):
        make_plan(cell, a_campaign(block=[GEOMETRY | {"base": ["B1"]}]))
    with pytest.raises(ConfigError, match="block 1: base names 'B9', none of B1, B2, B3"):
        make_plan(cell, a_campaign(block=[GEOMETRY | {"base": ["B9"]}]))


def test_each_bar_is_built_once_and_zeroed_and_the_arm_stays(bars: Any) -> None:
    bar: Bar = bars(block=[GEOMETRY, *HEXAPOD])
    assert bar.execute() == "succeeded"
    log = bar.bench.log
    first_move = log.index("move")
    assert [
        call
        for call in log[:first_move]
        if "arm" not in call and call.split()[0] in ("build", "zero", "measure")
    ] == [
        "build 150",
        "zero",
        *(f"measure {other} {one}" for one, other in SIDES[:3]),
        "build 300",
        "zero",
        *(f"measure {other} {one}" for one, other in SIDES[3:]),
    ]
    assert [zero["bar_mm"] for zero in bar.events_of("zeroed")] == [150.0, 300.0]
    assert sum(text.startswith("Build the ballbar of 150 mm") for text in bar.operator.asked) == 1
    assert "it must then read 150 mm" in bar.operator.asked[1]
    status = bar.run.status()
    assert (status.done, status.total) == (18, 18)
    assert len([call for call in log if call.startswith("build")]) == 2  # the legs have the bar of the base


def test_the_data_set_has_them_as_distances_of_the_balls(bars: Any, tmp_path: Path) -> None:
    bar: Bar = bars(block=[GEOMETRY, *HEXAPOD, GEOMETRY])
    assert bar.execute() == "succeeded"
    dataset = read_dataset(export(bar.folder, tmp_path / "out.csv"))
    assert [(span.one, span.other) for span in dataset.spans] == [*SIDES, *SIDES]
    assert len(dataset) == 12
    assert {span.series for span in dataset.spans} == {"", "main"}
    assert [round(span.length_mm) for span in dataset.spans[:6]] == [150] * 3 + [300] * 3


def test_a_bar_that_nobody_builds_leaves_its_readings_out(bars: Any) -> None:
    bar: Bar = bars(*[Answer.SKIP] * 3, block=[GEOMETRY, *HEXAPOD])
    assert bar.execute() == "succeeded"
    assert [each["reason"] for each in bar.events_of("skipped")] == ["the ballbar was not built for it"] * 3
    assert "build 150" not in bar.bench.log
    assert bar.run.status().skipped == 3


def test_resuming_takes_none_of_them_again(bars: Any) -> None:
    bar: Bar = bars(block=[GEOMETRY, *HEXAPOD])
    bar.crash_at(9)  # while the third distance is measured
    assert bar.bench.log[-1] == "measure T3 T2"
    assert bar.run.status().done == 2
    bar.run.resume()
    before = len(bar.bench.log)
    assert bar.execute() == "succeeded"
    again = [call for call in bar.bench.log[before:] if call.startswith(("build", "measure"))]
    assert again[:4] == ["build 150", "measure T3 T2", "build 300", "measure B2 B1"]


def when(bar: Bar, words: str, happens: Callable[[], None], times: int = 1) -> None:
    """Let something happen when a prompt with these words is shown for the `times`-th time."""
    ask, seen = bar.operator.ask, []

    def asked(prompt: Prompt) -> Answer:
        if words in prompt.text:
            seen.append(prompt)
            if len(seen) == times:
                happens()
        return ask(prompt)

    bar.operator.ask = asked  # type: ignore[method-assign]


def test_a_cup_that_moved_between_the_two_blocks_is_named(bars: Any) -> None:
    bar: Bar = bars(block=[GEOMETRY, *HEXAPOD, GEOMETRY])
    when(bar, "Build the ballbar of 150 mm", lambda: bar.bench.shift_mm.update(B1=0.4), times=2)
    assert bar.execute() == "succeeded"
    first, second = (text for text in bar.operator.asked if "has moved" in text)
    assert re.match(r"B1 to B2 was \d+\.\d{4} mm and is \d+\.\d{4} mm now", first)
    assert "B1 or B2 has moved" in first
    assert second.startswith("B1 to B3 was ")
    assert "now: B1 has moved" in second


def test_nothing_is_said_of_cups_that_stand(bars: Any) -> None:
    bar: Bar = bars(block=[GEOMETRY, *HEXAPOD, GEOMETRY])
    assert bar.execute() == "succeeded"
    assert not any("has moved" in text for text in bar.operator.asked)


def two_stages(bars: Any, *answers: Answer) -> Bar:
    bar: Bar = bars(*answers, off_deg=OFF_DEG, block=[TWO_STAGES])
    return bar


def test_a_leg_of_stage_2_that_the_model_of_stage_1_excludes_is_named(bars: Any) -> None:
    bar = two_stages(bars)
    moved: list[str] = []

    def kick(event: Event) -> None:
        bar.events.append(event)
        if event.kind == "second_stage":
            bar.bench.shift_mm["B1"] = 0.4

    def back() -> None:
        moved.append(bar.operator.asked[-1])
        bar.bench.shift_mm.clear()

    when(bar, "by the calibration of stage 1", back)
    state = bar.run.execute(devices_of(bar.bench, bar.operator), JumpingClock(), kick).state.value
    assert state == "succeeded"
    said = next(text for text in bar.operator.asked if "by the calibration of stage 1" in text)
    assert re.match(r"B1 to T\d reads \d+\.\d{3} mm; by the calibration of stage 1 it must be", said)
    assert "whether a cup has moved" in said
    assert bar.run.status().skipped == 0  # redone, and nothing lost


def test_the_model_of_stage_1_is_kept_and_says_how_long_a_leg_must_be(bars: Any) -> None:
    bar = two_stages(bars)
    assert bar.execute() == "succeeded"
    (stage,) = bar.events_of("second_stage")
    assert stage["rms_mm"] < 0.01
    model = load_model(bar.folder / STAGE_1)
    assert model.model.robot.name == bar.bench.cell.robot.model.name
    checks = BallbarChecks(bar.run._store, bar.bench.cell)
    corrected = [each for each in bar.run._store.plan() if each.visit.name.endswith("corrected")]
    lengths = {
        (row.visit, row.target, row.base_target): row.length_mm
        for row in readings_of(bar.run._store)
        if row.counts
    }
    for planned in corrected[:20]:
        expected = checks.expected(planned)
        assert expected is not None
        assert expected[0] == pytest.approx(
            lengths[planned.visit.number, planned.target, planned.base_target], abs=0.02
        )
    assert not any("by the calibration of stage 1" in text for text in bar.operator.asked)


def test_a_low_battery_is_said_once(bars: Any) -> None:
    bar: Bar = bars(block=[GEOMETRY, *HEXAPOD])
    checks = BallbarChecks(bar.run._store, bar.bench.cell)
    reading = LengthReading("T1", "B1", 300.0, 0.0005, 0.0, 0.0, 10, 1.0, 0.0, 22.0, battery_percent=9.0)
    with bar.run._store.listening(bar.events.append):
        checks.battery(replace(reading, battery_percent=40.0))
        checks.battery(reading)
        checks.battery(reading)
    assert bar.events_of("battery_low") == [{"percent": 9.0}]


def test_a_person_moves_one_end_of_the_bar_at_a_time() -> None:
    cell = a_cell(**BALLBAR)
    for visit in make_plan(cell, a_campaign(block=[{"kind": "hexapod"}])):
        assert len(set(visit.readings)) == 6
        assert all(a[0] == b[0] or a[1] == b[1] for a, b in pairwise(visit.readings))


def test_the_bar_is_zeroed_before_every_block_of_poses(bars: Any) -> None:
    blocks = [GEOMETRY, *HEXAPOD, {"kind": "hexapod", "set": "validation", "count": 1}]
    bar: Bar = bars(block=blocks, zero_every=60)
    assert bar.execute() == "succeeded"
    log = [call for call in bar.bench.log if call == "zero" or call.startswith("measure")]
    zeros = [i for i, call in enumerate(log) if call == "zero"]
    assert zeros == [0, 4, 20]  # of either triangle, and after two poses of six legs


def test_a_prompt_shows_the_pose_and_the_balls_that_it_is_about(bars: Any) -> None:
    bar: Bar = bars(block=[GEOMETRY, *HEXAPOD])
    seen: list[tuple[str, str]] = []
    ask = bar.operator.ask

    def asked(prompt: Prompt) -> Answer:
        if prompt.picture is not None and prompt.picture.startswith("span/"):
            assert prompt.picture.split("/")[1] in prompt.text
            seen.append((prompt.text, (bar.folder / PROMPT).read_text("utf-8")))
        return ask(prompt)

    bar.operator.ask = asked  # type: ignore[method-assign]
    assert bar.execute() == "succeeded"
    legs = [(text, picture) for text, picture in seen if text.startswith("Attach the ballbar between B")]
    assert len(legs) == 15
    for text, picture in legs:
        root = ElementTree.fromstring(picture)
        title = next(root.iter("{http://www.w3.org/2000/svg}title")).text
        one, other = text.split()[4], text.split()[6]
        assert title == f"{one} to {other}"
        names = {each.text for each in root.iter("{http://www.w3.org/2000/svg}text")}
        assert {one, other} <= names
    assert len({picture for _, picture in legs}) == 15


def test_a_distance_that_is_sent_again_is_not_the_next_one(
    bars: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The last value that a bridge without its bar repeats with a new time is within the stroke."""
    measure = FakeBar.measure
    sent: list[LengthReading] = []

    def frozen_once(meter: FakeBar, target: str, **asked: Any) -> LengthReading:
        seen = measure(meter, target, **asked)
        stuck = (
            {"length_mm": sent[-1].length_mm, "deviation_mm": sent[-1].deviation_mm} if len(sent) == 3 else {}
        )
        sent.append(replace(seen, **stuck))
        return sent[-1]

    monkeypatch.setattr(FakeBar, "measure", frozen_once)
    bar = bars()
    assert bar.execute() == "succeeded"
    (error,) = [each["error"] for each in bar.events_of("attempt_failed")]
    assert "to the last digit as in the distance before" in error["message"]
    assert "bridge still receives data" in error["what_to_do"]
    assert len(sent) == 1 + 12


def test_a_bar_that_is_stuck_asks_soon_and_says_in_the_end_what_is_missing(
    bars: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    measure = FakeBar.measure

    def stuck(meter: FakeBar, target: str, **asked: Any) -> LengthReading:
        return replace(measure(meter, target, **asked), deviation_mm=0.1234)

    monkeypatch.setattr(FakeBar, "measure", stuck)
    bar = bars()
    bar.execute()
    asked = [text for text in bar.operator.asked if "to the last digit" in text]
    put_off = [at for at, event in enumerate(bar.events) if event.kind == "deferred"]
    first = next(
        at for at, event in enumerate(bar.events) if event.kind == "prompt" and event.data["text"] == asked[0]
    )
    assert sum(at < first for at in put_off) == 3
    assert bar.run.status().reason == "Most is missing: 1 of 12 readings were measured."
