"""Orders and answers of people during a campaign.

Pause, stop, redo, skip, and prompts from anywhere.
"""

from __future__ import annotations

import threading
from pathlib import Path

import pytest

from acquisition import Event
from acquisition.errors import NotResumed
from acquisition.record import FILE
from acquisition.run.orders.control import Control, Pausing, Stopping
from drivers import AcquisitionError, Answer, RemoteOperator, UnknownPrompt
from tests.acquisition.fakes import FakeArm, JumpingClock, devices_of
from tests.acquisition.stage import ALL, CONNECT, NESTS, Stage
from tests.drivers.waiting import PATIENCE_S, in_thread, until


def test_pause_ends_after_the_reading_in_hand(stage: Stage) -> None:
    stage.bench.faults[10] = stage.run.pause
    outcome = stage.execute()
    assert (outcome.state.value, outcome.exit_code) == ("paused", 130)
    assert stage.bench.log == ALL[:10]
    assert stage.run.status().done == 1
    stage.run.resume()
    assert stage.execute().state.value == "succeeded"
    resumed = [*CONNECT, *NESTS, "move", "move", "measure T2"]
    assert stage.bench.log[10:20] == resumed  # nests looked at again, the approach made anew


def test_stop_halts_the_robot_and_ends(stage: Stage) -> None:
    devices = devices_of(stage.bench, stage.operator)
    assert isinstance(devices.robot, FakeArm)
    problems: list[AcquisitionError] = []
    stage.bench.faults[9] = lambda: problems.extend(stage.run.stop(by="anna"))
    outcome = stage.run.execute(devices, stage.clock)
    assert (outcome.state.value, outcome.exit_code) == ("stopped", 130)
    assert devices.robot.stops == 1
    assert stage.bench.log == ALL[:9]
    assert problems == []
    assert stage.attempts()[-1][1] == "failed"
    stage.run.resume()
    assert stage.execute().state.value == "succeeded"


def test_stop_before_it_runs(stage: Stage) -> None:
    stage.run.stop()
    assert stage.run.status().state == "stopped"
    with pytest.raises(NotResumed):
        stage.execute()
    stage.run.stop()
    assert stage.bench.log == []


def test_idempotent_commands(stage: Stage) -> None:
    stage.run.stop(key="once")
    stage.run.resume(key="twice")
    stage.run.resume(key="twice")
    verbs = [event.data["verb"] for event in stage.run.events() if event.kind == "command"]
    assert verbs == ["stop", "resume"]


def test_one_smr_is_asked_for_and_moved(tmp_path: Path) -> None:
    stage = Stage(tmp_path, cell={"instrument__one_smr": True})
    assert stage.execute().state.value == "succeeded"
    seats = [text.split()[4] for text in stage.operator.asked]
    assert seats == ["N1", "N2", "N3", "T1", "T2", "T3"]
    assert all(shot.seated == shot.target for shot in stage.bench.shots.values())
    stage.run.close()


def test_prompt_is_answered_from_another_thread_whoever_shows_it(tmp_path: Path) -> None:
    for i, operator in enumerate((None, RemoteOperator())):
        stage = Stage(tmp_path / str(i), cell={"instrument__one_smr": True})
        stage.operator = operator
        done = in_thread(stage.execute)
        for _ in range(6):
            until(lambda stage=stage: stage.run.status().prompt is not None)
            status = stage.run.status()
            assert status.prompt is not None
            assert (status.state, status.state_code) == ("waiting_for_operator", 3)
            with pytest.raises(UnknownPrompt):
                stage.run.answer("nonesuch", Answer.CONFIRM)
            if "redo" not in status.prompt["expects"]:
                with pytest.raises(UnknownPrompt):
                    stage.run.answer(status.prompt["id"], Answer.REDO)
            stage.run.answer(status.prompt["id"], Answer.CONFIRM, by="anna")
            identity = status.prompt["id"]
            until(
                lambda stage=stage, identity=identity: (stage.run.status().prompt or {}).get("id") != identity
            )
        assert done.result(PATIENCE_S).state.value == "succeeded"
        stage.run.close()


@pytest.mark.parametrize(("order", "state"), [("pause", "paused"), ("stop", "stopped")])
def test_orders_end_a_prompt(tmp_path: Path, order: str, state: str) -> None:
    stage = Stage(tmp_path, cell={"instrument__one_smr": True})
    stage.operator = RemoteOperator()
    done = in_thread(stage.execute)
    until(lambda: stage.run.status().prompt is not None)
    getattr(stage.run, order)()
    assert done.result(PATIENCE_S).state.value == state
    until(lambda: stage.operator.pending is None)
    assert stage.run.status().prompt is None
    assert stage.bench.shots == {}
    stage.run.close()


def test_pause_from_an_event(stage: Stage) -> None:
    caller: list[int] = []

    def on_event(event: Event) -> None:
        caller.append(threading.get_ident())
        if event.kind == "reading":
            stage.run.pause()

    assert stage.execute(on_event).state.value == "paused"
    assert set(caller) == {threading.get_ident()}
    assert stage.bench.log == ALL[:5]
    assert (stage.folder / FILE).exists()


def test_redo_measures_the_last_reading_again_after_a_new_approach(tmp_path: Path) -> None:
    stage = Stage(tmp_path, cell={"instrument__one_smr": True})
    stage.operator.answers = [Answer.CONFIRM] * 4 + [Answer.REDO]
    assert stage.execute().state.value == "succeeded"
    # T1 twice, then "Seat T2" is answered by redo: T1 is seated anew, and measured before T2 is asked for.
    seats = [text.split()[4] for text in stage.operator.asked]
    assert seats == ["N1", "N2", "N3", "T1", "T2", "T1", "T2", "T3"]
    once = ["move", "move", "measure T1"]
    assert stage.bench.log[7:16] == once * 3
    status = stage.run.status()
    assert (status.done, status.total, status.skipped) == (5, 5, 0)
    (again,) = [event for event in stage.run.events() if event.kind == "measure_again"]
    readings = [event.data["pose"] for event in stage.run.events() if event.kind == "reading"]
    assert set(again.data["poses"] + again.data["replaced_by"]) <= set(readings)
    assert len(readings) == len(set(readings)) == 3 + 5 + 1
    stage.run.close()


def test_redo_is_offered_once_there_is_something_to_redo(tmp_path: Path) -> None:
    stage = Stage(tmp_path, cell={"instrument__one_smr": True})
    assert stage.execute().state.value == "succeeded"
    offered = ["redo" in event.data["expects"] for event in stage.run.events() if event.kind == "prompt"]
    assert offered == [False, False, False, False, True, True]
    stage.run.close()


def test_skip_with_a_reason(tmp_path: Path) -> None:
    stage = Stage(tmp_path, cell={"instrument__one_smr": True})
    stage.operator = None
    done = in_thread(stage.execute)
    answered = ""
    while not done.done():
        prompt = stage.run.status().prompt
        if prompt is None or prompt["id"] == answered:
            threading.Event().wait(0.005)
            continue
        answered = prompt["id"]
        third = "T3" in prompt["text"]
        stage.run.answer(answered, Answer.SKIP if third else Answer.CONFIRM, by="anna", reason="worn nest")
    assert done.result().state.value == "succeeded"
    skipped = [event.data["reason"] for event in stage.run.events() if event.kind == "skipped"]
    assert skipped == ["worn nest"]
    answers = [event.data for event in stage.run.events() if event.kind == "answer"]
    assert (answers[-1]["by"], answers[-1]["answer"], answers[-1]["reason"]) == ("anna", "skip", "worn nest")
    stage.run.close()


@pytest.mark.parametrize(("order", "raised"), [("stop", Stopping), ("rest", Pausing)])
def test_an_order_ends_the_settling_it_comes_in(order: str, raised: type[Exception]) -> None:
    """The clock reports whether its wait was interrupted.

    No stop may wait until the robot has settled.
    """
    woken: list[bool] = []

    class During(JumpingClock):
        def wait(self, seconds: float, wake: threading.Event) -> bool:
            control.stop() if order == "stop" else control.rest("Nobody is there.")
            woken.append(wake.is_set())
            return wake.is_set()

    control = Control(During())
    with pytest.raises(raised):
        control.settle(600.0)
    assert woken == [True]


def test_a_pause_waits_for_the_settling_and_its_reading() -> None:
    clock = JumpingClock()
    control = Control(clock)
    control.pause()
    control.settle(600.0)
    assert clock.now() > 600.0
    with pytest.raises(Pausing):
        control.wait(600.0)
