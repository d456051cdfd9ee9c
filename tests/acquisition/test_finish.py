"""A run that a person ends early has succeeded with the readings that it has.

These would catch: a reading in hand that is lost, a motion after the order, an order that a kill undoes, a second order
that is refused or counted again, an end without anything to fit, and an error or a stop that an order hides.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import pytest

from acquisition import Run, export, read_status
from acquisition.errors import NotResumed, StorageError
from drivers import Answer
from drivers.errors import EmergencyStop, LinkLost
from tests.acquisition.fakes import Crash
from tests.acquisition.stage import ALL, Stage
from tests.drivers.waiting import in_thread, until


def finish(stage: Stage, by: str = "anna", reason: str = "") -> None:
    stage.run.finish(by, reason)


def kinds(run: Run, kind: str) -> list[dict[str, object]]:
    return [dict(event.data) for event in run.events() if event.kind == kind]


def test_a_running_campaign_ends_after_the_reading_in_hand(stage: Stage) -> None:
    stage.bench.faults[11] = lambda: finish(
        stage, reason="it is enough"
    )  # while T2 of the first pose is measured
    outcome = stage.execute()
    assert (outcome.state.value, outcome.exit_code, outcome.error) == ("succeeded", 0, None)
    assert stage.bench.log == ALL[:11]  # the reading is taken, and nothing moves any more
    status = stage.run.status()
    assert (status.state, status.done, status.total) == ("succeeded", 2, 5)
    assert status.finished_early is not None
    (ordered,) = [event for event in stage.run.events() if event.kind == "finish"]
    assert status.finished_early == {
        "by": "anna",
        "reason": "it is enough",
        "utc": ordered.utc,
        "measured": 2,
        "total": 5,
    }
    assert outcome.reason == status.reason == "Finished early by anna: 2 of 5 readings were measured."
    with pytest.raises(NotResumed):
        stage.run.resume()
    with pytest.raises(NotResumed):
        stage.execute()
    rows = export(stage.folder, stage.folder / "data.csv").read_text("utf-8").splitlines()
    assert len(rows) == 1 + 2


@pytest.mark.parametrize("rest", ["pause", "stop"])
def test_a_run_at_rest_ends_at_once(stage: Stage, rest: str) -> None:
    stage.bench.faults[11] = getattr(stage.run, rest)
    stage.execute()
    calls = list(stage.bench.log)
    finish(stage)
    assert stage.run.status().state == "succeeded"
    assert stage.bench.log == calls  # no device was asked
    assert read_status(stage.folder).finished_early is not None


def test_in_a_prompt_it_ends_without_the_answer(tmp_path: Path) -> None:
    stage = Stage(tmp_path, cell={"instrument__one_smr": True})
    stage.operator = None
    done = in_thread(stage.execute)
    for _ in range(4):  # three nests, and the first target, which is in two poses
        until(lambda: stage.run.status().prompt is not None)
        prompt = stage.run.status().prompt
        assert prompt is not None
        stage.run.answer(prompt["id"], Answer.CONFIRM)
        until(lambda prompt=prompt: (stage.run.status().prompt or {}).get("id") != prompt["id"])
    until(lambda: stage.run.status().prompt is not None)
    finish(stage)
    done.result()
    status = stage.run.status()
    assert (status.state, status.prompt, status.done) == ("succeeded", None, 2)
    stage.run.close()


def test_it_is_noted_once_however_often_it_is_ordered(stage: Stage) -> None:
    def thrice() -> None:
        stage.run.finish("anna", key="k")
        stage.run.finish("anna", key="k")
        stage.run.finish("ben")

    stage.bench.faults[11] = thrice
    assert stage.execute().state.value == "succeeded"
    stage.run.finish("cora")
    assert [event["by"] for event in kinds(stage.run, "finish")] == ["anna"]
    assert len(kinds(stage.run, "finished_early")) == 1


@pytest.mark.parametrize("state", ["ready", "no reading", "succeeded"])
def test_it_is_refused_where_nothing_can_be_fitted_or_the_run_has_ended(stage: Stage, state: str) -> None:
    if state == "no reading":  # the nests are no readings to fit
        stage.bench.faults[7] = stage.run.pause
        stage.execute()
    elif state == "succeeded":
        stage.execute()
    version = stage.run.status().version
    with pytest.raises(
        NotResumed, match="nothing is left to finish" if state == "succeeded" else "nothing to fit"
    ):
        finish(stage)
    assert stage.run.status().version == version  # nothing was noted
    if state != "succeeded":
        if state == "no reading":
            stage.run.resume()
        assert stage.execute().state.value == "succeeded"
        assert stage.run.status().finished_early is None


def test_the_reference_pose_alone_is_nothing_to_fit(tmp_path: Path) -> None:
    stage = Stage(tmp_path, reference_every=2)
    first = next(each.visit for each in stage.run._store.plan() if each.visit.counted)
    assert first.set == "reference"
    stage.bench.faults[9 + len(first.targets)] = stage.run.pause  # at its last target
    stage.execute()
    assert stage.run.status().done == len(first.targets)
    with pytest.raises(NotResumed, match="nothing to fit"):
        finish(stage)
    stage.run.close()


def killed(stage: Stage, at: int, before: Callable[[], None]) -> None:
    """End the program in a device call, after `before`."""

    def crash() -> None:
        before()
        stage.run._store.close()
        raise Crash

    stage.bench.faults[at] = crash
    with suppress(Crash, sqlite3.Error, StorageError):  # what its end would have written is lost
        stage.execute()


def test_a_kill_between_order_and_end_does_not_undo_it(stage: Stage) -> None:
    killed(stage, 11, lambda: finish(stage, reason="late"))
    seen = read_status(stage.folder)  # before anybody opens it
    assert (seen.state, seen.reason) == (
        "succeeded",
        "Finished early by anna: 1 of 5 readings were measured.",
    )
    with Run.open(stage.folder) as again:
        status = again.status()
        assert (status.state, status.reason, status.finished_early) == (
            "succeeded",
            seen.reason,
            seen.finished_early,
        )
        with pytest.raises(NotResumed):
            again.resume()
        assert len(kinds(again, "finished_early")) == 1
    with Run.open(stage.folder) as again:
        assert len(kinds(again, "finished_early")) == 1


def test_a_kill_after_a_pause_leaves_it_paused(stage: Stage) -> None:
    killed(stage, 11, lambda: None)
    with Run.open(stage.folder) as again:
        assert again.status().state == "paused"


def test_a_stop_that_follows_wins(stage: Stage) -> None:
    def both() -> None:
        finish(stage)
        stage.run.stop("ben")

    stage.bench.faults[11] = both
    assert stage.execute().state.value == "stopped"
    assert stage.run.status().finished_early is None
    stage.run.resume()
    assert stage.execute().state.value == "succeeded"  # the order ended with that execution
    assert stage.run.status().finished_early is None


def test_an_error_that_follows_is_shown(stage: Stage) -> None:
    def pressed() -> None:
        finish(stage)
        raise EmergencyStop("pressed")

    stage.bench.faults[11] = pressed
    outcome = stage.execute()
    assert outcome.state.value == "paused"
    assert isinstance(outcome.error, EmergencyStop)
    finish(stage)  # who has seen that may
    assert stage.run.status().state == "succeeded"


def test_a_link_that_breaks_in_the_reading_in_hand_does_not_prolong_it(stage: Stage) -> None:
    def lost() -> None:
        finish(stage)
        raise LinkLost("lost")

    stage.bench.faults[11] = lost
    assert stage.execute().state.value == "succeeded"
    assert stage.run.status().done == 1
