"""The world frame for nests that are inconsistent, have moved, or vary by noise alone."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from acquisition.cell.world_frame import WorldFrame
from acquisition.errors import NestsDisagree
from drivers.interfaces import Answer
from tests.acquisition.fakes import (
    SeatingOperator,
)
from tests.acquisition.stage import CONNECT, NESTS, Stage


def test_wrong_nest_is_asked_about_and_measured_again(stage: Stage) -> None:
    stage.bench.shift_mm = {"N2": 3.0}

    class Tidy(SeatingOperator):
        def ask(self, prompt: Any) -> Answer:
            self.bench.shift_mm = {}
            return super().ask(prompt)

    stage.operator = Tidy(stage.bench)
    assert stage.execute().state.value == "succeeded"
    assert "N1 and N2 are 603.00 mm apart" in stage.operator.asked[0]
    assert stage.bench.log[4:10] == NESTS * 2


@pytest.mark.parametrize(
    ("u_mm", "said"), [({"world__u_mm": 0.02}, True), ({"world__u_mm": 0.3}, False), ({}, False)]
)
def test_a_nest_beyond_its_stated_uncertainty_is_named(
    tmp_path: Path, u_mm: dict[str, float], said: bool
) -> None:
    stage = Stage(tmp_path, cell=u_mm)
    stage.bench.shift_mm = {"N2": 0.4}
    with closing(stage.run):
        assert stage.execute().state.value == "succeeded"
        doubts = [event.data for event in stage.run.events() if event.kind == "nest_doubted"]
    assert bool(doubts) == said
    if said:
        assert [each["nest"] for each in doubts] == ["N2"]
        assert "Nest N2 lies 0.4" in doubts[0]["text"]
        assert "from where the cell file puts it to 0.02 mm" in doubts[0]["text"]


def test_wrong_nest_and_nobody_there(stage: Stage) -> None:
    stage.bench.shift_mm = {"N2": 3.0}
    stage.operator.answers = [Answer.ABORT]
    assert stage.execute().state.value == "stopped"
    assert "move" not in stage.bench.log
    assert NestsDisagree.exit_code == 1


def paused_and_pushed(stage: Stage, by_mm: list[float]) -> WorldFrame:
    """Pause and resume a run, move the tracker meanwhile, and return the world frame of before."""
    stage.bench.faults[10] = stage.run.pause
    stage.execute()
    before = stage.run._store.world
    assert before is not None
    stage.run.resume()
    stage.bench.tracker.origin[:] += by_mm
    return before


def test_a_tracker_that_was_moved_between_is_found(stage: Stage) -> None:
    before = paused_and_pushed(stage, [40.0, -30.0, 5.0])
    assert stage.execute().state.value == "succeeded"
    after = stage.run._store.world
    assert after is not None
    assert after.origin - before.origin == pytest.approx([40.0, -30.0, 5.0], abs=1e-6)
    assert "instrument_moved" in [event.kind for event in stage.run.events()]


def test_nests_that_are_to_be_measured_again_make_no_frame(stage: Stage) -> None:
    stage.execute()
    store = stage.run._store
    assert sorted(store.nests_mm()) == ["N1", "N2", "N3"]
    store.measure_nests_again("somebody leaned on the table")
    assert store.nests_mm() == {}


def test_nests_within_the_noise_leave_the_world_as_it_is(stage: Stage) -> None:
    before = paused_and_pushed(stage, [0.02, -0.02, 0.01])
    outcome = stage.execute()
    after = stage.run._store.world
    assert (outcome.state.value, outcome.reason) == ("succeeded", "")
    assert after is not None
    assert after.as_json() == before.as_json()


def test_a_small_real_move_is_not_swallowed(stage: Stage) -> None:
    """The move of 0.15 mm is five times the noise of a nest, and below the old limit of 0.2 mm."""
    paused_and_pushed(stage, [0.15, 0.0, 0.0])
    outcome = stage.execute()
    assert outcome.reason == "The instrument was moved: its readings come from 2 stations."
    (moved,) = [event for event in stage.run.events() if event.kind == "instrument_moved"]
    assert moved.data["nests_off_mm"] == pytest.approx(0.15, abs=1e-6)


def test_nests_are_all_seen_from_one_station(stage: Stage) -> None:
    """The run is paused after the first nest, and the tracker is pushed.

    The push is too small to show in the distances between nests.
    """
    stage.bench.faults[5] = stage.run.pause
    assert stage.execute().state.value == "paused"
    stage.bench.tracker.origin[:] += [0.6, 0.6, 0.0]
    stage.run.resume()
    assert stage.execute().state.value == "succeeded"
    assert stage.bench.log[5:12] == [*CONNECT, *NESTS]
    world = stage.run._store.world
    assert world is not None
    assert world.origin == pytest.approx(stage.bench.tracker.origin, abs=1e-9)
