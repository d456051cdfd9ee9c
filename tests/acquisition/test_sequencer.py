"""The sequencer's reactions to every class of error and to people, and its order of work."""

from __future__ import annotations

import io
import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from acquisition.errors import NotResumed, StorageError
from drivers.errors import (
    BeamBroken,
    Busy,
    EmergencyStop,
    LinkLost,
    LinkTimeout,
    NoOperator,
    WrongMode,
)
from drivers.interfaces import Answer, JointReading
from drivers.operator import TerminalOperator
from tests.acquisition.fakes import (
    FakeArm,
    FakeMeter,
    devices_of,
)
from tests.acquisition.stage import ALL, Stage, fill_disk


def test_the_order_of_a_campaign(stage: Stage) -> None:
    events: list[str] = []
    outcome = stage.execute(lambda event: events.append(event.kind))
    assert (outcome.state.value, outcome.exit_code) == ("succeeded", 0)
    assert stage.bench.log == ALL
    status = stage.run.status()
    assert (status.state_code, status.done, status.total, status.skipped) == (5, 5, 5, 0)
    assert status.last_reading is not None
    assert status.last_reading["target"] == "T3"
    assert events[-1] == "state"
    assert events.count("reading") == 8
    lengths = set()
    for shot in stage.bench.shots.values():
        if shot.target.startswith("T"):
            away = [abs(a - b) for a, b in zip(shot.joints_deg, shot.came_from_deg, strict=True)]
            assert away == pytest.approx([away[0]] * 6, abs=1e-6)
            lengths.add(round(away[0], 4))
    assert all(5.0 <= length <= 15.0 for length in lengths)
    assert len(lengths) > 1
    with pytest.raises(NotResumed):
        stage.execute()
    with pytest.raises(NotResumed, match="finished; nothing to resume") as caught:
        stage.run.resume()
    assert "Look at the cell" not in caught.value.what_to_do


def test_the_record_knows_of_a_move_before_the_robot_makes_it(
    stage: Stage, monkeypatch: pytest.MonkeyPatch
) -> None:
    """After a crash the record must say that the robot may be anywhere."""
    move = FakeArm.move_to
    known: list[tuple[str, str]] = []

    def seen(arm: FakeArm, joints_deg: Sequence[float]) -> JointReading:
        known.append(stage.attempts()[-1][:2])
        return move(arm, joints_deg)

    monkeypatch.setattr(FakeArm, "move_to", seen)
    assert stage.execute().state.value == "succeeded"
    assert set(known) == {("arrive", "open")}


def test_a_robot_that_is_read_back_elsewhere_is_approached_anew(
    stage: Stage, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No reading is stored under angles that the robot does not read back.

    The belief of its driver does not matter.
    """
    move = FakeArm.move_to

    def elsewhere(arm: FakeArm, joints_deg: Sequence[float]) -> JointReading:
        there = move(arm, joints_deg)
        by_deg = 0.03 if arm.bench.log.count("move") == 2 else 0.0  # at the first pose, the first time
        return replace(there, joints_deg=(*there.joints_deg[:5], there.joints_deg[5] + by_deg))

    monkeypatch.setattr(FakeArm, "move_to", elsewhere)
    assert stage.execute().state.value == "succeeded"
    arrivals = [attempt for attempt in stage.attempts() if attempt[0] == "arrive"]
    first = arrivals[0][2]
    assert [(status, visit) for _, status, visit in arrivals][:2] == [("failed", first), ("good", first)]
    assert stage.bench.log.count("move") == ALL.count("move") + 2
    (failed,) = (event for event in stage.run.events() if event.kind == "attempt_failed")
    assert failed.data["error"]["code"] == 3008


@pytest.mark.parametrize("meanwhile", ["settles", "is measured"])
def test_a_robot_that_moves_by_itself_before_its_reading_is_taken(
    stage: Stage, monkeypatch: pytest.MonkeyPatch, meanwhile: str
) -> None:
    """A brake that slips or a person who jogs the arm would give a point under wrong angles."""
    device, verb = (FakeArm, "move_to") if meanwhile == "settles" else (FakeMeter, "measure")
    act = getattr(device, verb)
    begun = "move" if meanwhile == "settles" else "measure T"

    def creeps_after(who: Any, *args: Any, **kinds: Any) -> Any:
        done = act(who, *args, **kinds)
        bench = who.bench
        if sum(each.startswith(begun) for each in bench.log) == 2 and bench.log[-1].startswith(begun):
            bench.where = (bench.where[0] + 0.05, *bench.where[1:])
        return done

    monkeypatch.setattr(device, verb, creeps_after)
    assert stage.execute().state.value == "succeeded"
    (prompt,) = (event for event in stage.run.events() if event.kind == "prompt")
    assert "0.050 deg" in prompt.data["text"]
    (failed,) = (event for event in stage.run.events() if event.kind == "attempt_failed")
    assert failed.data["error"]["code"] == 3109
    assert stage.bench.log.count("move") == ALL.count("move") + 2  # approached anew
    assert sum(kind == "measure" and status == "good" for kind, status, _ in stage.attempts()) == 8


def test_settle_and_warm_up_take_campaign_time(tmp_path: Path) -> None:
    stage = Stage(tmp_path, warm_up_s=3600.0)
    stage.execute()
    assert 3600.0 + 3 * 4.0 < stage.clock.now() < 3600.0 + 3 * 4.0 + 10.0
    first = next(e for e in stage.run.events() if e.kind == "arrived")
    assert first.t_s is not None
    assert first.t_s > 3600.0
    stage.run.close()


def test_a_cell_resumed_the_next_morning_warms_up_again(tmp_path: Path) -> None:
    stage = Stage(tmp_path, warm_up_s=3600.0)
    stage.bench.faults[10] = stage.run.pause
    assert stage.execute().state.value == "paused"
    stage.clock.calendar += 16 * 3600.0
    begin = stage.clock.now()
    stage.run.resume()
    assert stage.execute().state.value == "succeeded"
    assert stage.clock.now() - begin > 3600.0
    first, again = (e for e in stage.run.events() if e.kind == "warm_up")
    assert first.t_s is not None
    assert again.t_s is not None
    assert again.data["until_t_s"] == pytest.approx(again.t_s + 3600.0, abs=1.0)
    shots = [e.t_s for e in stage.run.events(after=again.id) if e.kind == "reading"]
    assert min(t for t in shots if t is not None) > again.t_s + 3600.0
    stage.run.close()


@pytest.mark.parametrize("call", range(1, len(ALL) + 1))
def test_a_lost_link_is_taken_up_again_anywhere(tmp_path: Path, call: int) -> None:
    stage = Stage(tmp_path)
    stage.fail(call, LinkTimeout("late"))
    assert stage.execute().state.value == "succeeded"
    lost = stage.bench.log[call - 1]
    after = stage.bench.log[call:]
    assert after[0].startswith("connect")
    if lost in ("move", "measure T1", "measure T2", "measure T3"):
        device = "meter" if lost.startswith("measure") else "arm"
        assert after[:4] == [f"connect {device}", f"arm {device}", "move", "move"]
    assert stage.run.status().done == 5
    stage.run.close()


def test_a_dead_link_pauses_with_its_exit_code(stage: Stage) -> None:
    for call in range(9, 50):
        stage.fail(call, LinkLost("gone"))
    outcome = stage.execute()
    assert (outcome.state.value, outcome.exit_code) == ("paused", 4)
    assert isinstance(outcome.error, LinkLost)
    assert stage.run.status().reason.startswith("gone")


def test_a_robot_that_cannot_be_stopped_is_not_rearmed_after_a_lost_move(stage: Stage) -> None:
    stage.can_stop = False
    stage.fail(9, LinkLost("gone in mid-move"))
    assert stage.execute().state.value == "paused"
    assert stage.bench.log[9:] == []


def test_unmeasurable_is_retried_then_put_off_then_skipped(stage: Stage) -> None:
    stage.bench.hidden = {"T1"}
    assert stage.execute().state.value == "succeeded"
    measured = [name for name in stage.bench.log if name.startswith("measure T")]
    assert measured[:3] == ["measure T1", "measure T1", "measure T2"]
    assert measured[-4:] == ["measure T1"] * 4  # the two put off, tried again at the end
    assert stage.bench.log.count("move") == 2 * (2 * 3 + 1 + 2 * 2)  # every retry is an approach
    status = stage.run.status()
    assert (status.done, status.skipped) == (5, 2)
    assert status.reason == "2 readings were skipped."


def test_unmeasurable_once_costs_nothing(stage: Stage) -> None:
    stage.fail(10, BeamBroken("a person walked by"))
    assert stage.execute().state.value == "succeeded"
    assert stage.run.status().skipped == 0
    assert ("measure", "failed", 3) in stage.attempts()


def test_nothing_measurable_is_a_failure(stage: Stage) -> None:
    stage.bench.hidden = {"T1", "T2", "T3"}
    outcome = stage.execute()
    assert (outcome.state.value, outcome.exit_code) == ("failed", 1)


def test_an_arm_that_is_seen_nowhere_is_not_driven_on(stage: Stage) -> None:
    """A wrong robot file or a missing coupling makes every clearance check wrong."""
    stage.bench.hidden = {"T1", "T2", "T3"}
    stage.operator = TerminalOperator(io.StringIO())  # nobody is there
    outcome = stage.execute()
    assert outcome.state.value == "paused"
    tries = [name for name in stage.bench.log if name.startswith("measure T")]
    assert len(tries) == 3 * 2  # three readings, each tried twice
    prompt = [event for event in stage.run.events() if event.kind == "prompt"][-1]
    assert "none of the first 3 readings" in prompt.data["text"]
    assert "joint_coupling" in prompt.data["text"]


def test_a_person_may_say_that_it_is_the_line_of_sight(stage: Stage) -> None:
    stage.bench.hidden = {"T1", "T2"}
    assert stage.execute().state.value == "succeeded"
    assert ["none of the first" in text for text in stage.operator.asked] == [
        True
    ]  # once, and not of the readings since
    assert stage.run.status().skipped == 4


def test_refused_asks_and_goes_on_when_confirmed(stage: Stage) -> None:
    stage.fail(8, WrongMode("key switch in manual"))
    states: list[str] = []
    outcome = stage.execute(lambda e: states.append(e.data["state"]) if e.kind == "state" else None)
    assert outcome.state.value == "succeeded"
    assert "key switch in manual" in stage.operator.asked[0]
    assert states == ["running", "waiting_for_operator", "running", "succeeded"]
    assert stage.bench.log[8:11] == ["arm arm", "move", "move"]


def test_refused_skip_and_abort(stage: Stage) -> None:
    stage.operator.answers = [Answer.SKIP, Answer.ABORT]
    stage.fail(8, WrongMode("first"))
    stage.fail(13, Busy("second"))
    outcome = stage.execute()
    assert (outcome.state.value, outcome.exit_code) == ("stopped", 130)
    assert stage.run.status().skipped == 1


def test_refused_again_and_again_pauses(stage: Stage) -> None:
    for call in range(8, 40):
        stage.fail(call, WrongMode("stays in manual"))
    outcome = stage.execute()
    assert (outcome.state.value, outcome.exit_code) == ("paused", 4)
    assert len(stage.operator.asked) == 2


def test_no_operator_pauses(stage: Stage) -> None:
    with open(os.devnull, encoding="utf-8") as nobody:
        stage.operator = TerminalOperator(reader=nobody)
        stage.fail(8, WrongMode("manual"))
        outcome = stage.execute()
    assert isinstance(outcome.error, NoOperator)
    assert (outcome.state.value, outcome.exit_code) == ("paused", 4)
    assert stage.run.status().prompt is None


def test_safety_stop_ends_at_once_and_resumes_only_when_asked(stage: Stage) -> None:
    stage.fail(8, EmergencyStop("pressed"))
    outcome = stage.execute()
    assert (outcome.state.value, outcome.exit_code) == ("paused", 5)
    assert stage.bench.log[8:] == []
    with pytest.raises(NotResumed):
        stage.execute()
    assert stage.bench.log[8:] == []
    stage.run.resume(by="anna")
    assert stage.execute().state.value == "succeeded"
    assert stage.run.status().done == 5


def test_storage_error_pauses_and_nothing_is_lost(stage: Stage) -> None:
    database = stage.run._store.database
    acknowledged: list[int] = []

    stage.bench.faults[11] = lambda: fill_disk(stage.run._store)
    outcome = stage.execute(lambda e: acknowledged.append(e.data["attempt"]) if e.kind == "reading" else None)
    assert outcome.state.value == "paused"
    assert isinstance(outcome.error, StorageError)
    assert stage.run.status().state == "paused"
    assert "Make room" in stage.run.status().reason
    database.script("PRAGMA max_page_count = 1000000")
    stage.run.resume()
    outcome = stage.execute(lambda e: acknowledged.append(e.data["attempt"]) if e.kind == "reading" else None)
    assert outcome.state.value == "succeeded"
    rows = database.query("SELECT id FROM attempt WHERE kind = 'measure' AND status = 'good' ORDER BY id")
    assert [row[0] for row in rows] == acknowledged


def test_a_fault_of_the_program_leaves_the_run_paused_and_the_robot_disarmed(stage: Stage) -> None:
    def bug() -> None:
        raise ZeroDivisionError

    stage.bench.faults[9] = bug
    devices = devices_of(stage.bench, stage.operator)
    with pytest.raises(ZeroDivisionError):
        stage.run.execute(devices, stage.clock)
    assert stage.run.status().state == "paused"
    assert isinstance(devices.robot, FakeArm)
    assert not devices.robot.armed


def test_two_executions_at_once_are_refused(stage: Stage) -> None:
    refused: list[bool] = []

    def second() -> None:
        with pytest.raises(NotResumed):
            stage.execute()
        refused.append(True)

    stage.bench.faults[9] = second
    assert stage.execute().state.value == "succeeded"
    assert refused == [True]


def test_a_prompt_voids_the_approach(stage: Stage) -> None:
    """The second target of a visit is refused, and a person at the robot has corrected it."""
    stage.fail(11, WrongMode("not ready"))
    assert stage.execute().state.value == "succeeded"
    assert stage.bench.log[10:15] == ["measure T2", "arm meter", "move", "move", "measure T2"]


def test_where_the_robot_stands_is_read_back_before_it_moves(stage: Stage) -> None:
    stage.bench.where = (1.0, 2.0, 3.0, 4.0, 5.0, 6.0)
    stage.fail(9, LinkLost("gone"))
    stage.execute()
    met = [
        e.data["read_deg"] for e in stage.run.events() if e.kind == "connected" and e.data["role"] == "robot"
    ]
    assert met[0] == [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]
    assert len(met) == 2  # and again after the link was lost
