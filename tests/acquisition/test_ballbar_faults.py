"""Faults of a ballbar during a reading.

These would catch: a reading lost with the radio, or taken twice, an empty battery that ends the campaign, and an arm
that leaves its pose for either with the bar on.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from acquisition.campaign import make_plan
from acquisition.record.readings import readings_of
from drivers import Answer, LinkLost, NotReady
from tests.acquisition.bars import Bar


@pytest.fixture
def bar(tmp_path: Path) -> Iterator[Bar]:
    made = Bar(tmp_path / "record")
    yield made
    made.run.close()


def legs_of(bar: Bar) -> list[tuple[str, str | None]]:
    return [(row.target, row.base_target) for row in readings_of(bar.run._store) if row.counts]


def planned(bar: Bar) -> list[tuple[str, str | None]]:
    return [leg for visit in make_plan(bar.bench.cell, bar.run.campaign) for leg in visit.readings]


def test_a_radio_lost_in_a_reading_costs_none(bar: Bar) -> None:
    def lose() -> None:
        raise LinkLost("no radio link to the bar", device="instrument", raw=b"601")

    bar.bench.faults[9] = lose
    assert bar.execute() == "succeeded"  # the fake robot asserts that no bar hangs on it when it moves
    assert bar.events_of("reconnect")[0]["error"]["message"] == "no radio link to the bar"
    assert sorted(legs_of(bar)) == sorted(planned(bar))
    assert bar.run.status().skipped == 0
    failed = bar.events_of("attempt_failed")
    assert [each["error"]["code"] for each in failed] == [LinkLost.code]


def test_an_empty_battery_is_said_and_the_reading_taken_after_it_was_changed(bar: Bar) -> None:
    def empty() -> None:
        raise NotReady("battery low", device="instrument", raw=b"502")

    bar.bench.faults[9] = empty
    assert bar.execute() == "succeeded"
    (said,) = [text for text in bar.operator.asked if "battery low" in text]
    assert said
    assert sorted(legs_of(bar)) == sorted(planned(bar))
    assert bar.run.status().skipped == 0


def test_a_battery_that_nobody_changes_leaves_one_reading_out_and_no_more(tmp_path: Path) -> None:
    def empty() -> None:
        raise NotReady("battery low", device="instrument", raw=b"502")

    bar = Bar(tmp_path / "record")
    bar.bench.faults[9] = empty
    ask = bar.operator.ask
    bar.operator.ask = lambda prompt: (  # type: ignore[method-assign]
        Answer.SKIP if "battery low" in prompt.text else ask(prompt)
    )
    assert bar.execute() == "succeeded"
    assert bar.run.status().skipped == 1
    assert len(legs_of(bar)) == len(planned(bar)) - 1
    bar.run.close()
