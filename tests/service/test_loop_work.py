"""Orders to a closed loop between its runs, when no run is there to hear them; and its end."""

from __future__ import annotations

import errno
import json
import os
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import pytest

from acquisition import Campaign, Cell, Devices, ExecutionOutcome, LeaseDeadline, Run, State
from acquisition.errors import StorageError
from acquisition.loop import Equipment, LoopEnded, Say
from acquisition.loop.loop import measure
from acquisition.record import DeviceAcceptance
from drivers import ConfigError
from drivers.errors import AcquisitionError
from service.http.runs import loop_work
from service.http.runs.loop_work import ABOUT, LoopStatus, LoopWork
from service.http.runs.loops import ASKED, CUT_OFF, RESTS, LoopStore, WorkStore
from service.http.runs.run_manager import SERVICE_ENDS, RunManager
from service.http.runs.verifications import VerificationStore
from service.http.wire.problems import Problem
from service.http.work import workers
from service.http.work.datasets import DatasetStore
from service.http.work.stored_documents import readable
from service.http.work.workers import Workers
from tests.acquisition.fakes import Bench, a_campaign, a_cell, devices_of
from tests.drivers.waiting import PATIENCE_S, until
from tests.service.lease_clock import LeaseClock

BEGUN = LoopStatus("the-loop", "night", "2026-11-22T10:00:00.000Z", True, State.RUNNING)
QUICK: dict[str, Any] = {"settle_s": 0.0}


@dataclass
class Stage:
    """A loop of which the test is the author: `play` is what `close_loop` would do."""

    folder: Path
    bench: Bench = field(default_factory=lambda: Bench(a_cell()))

    def __post_init__(self) -> None:
        self.workers = Workers(1, waiting=0)
        self.book = RunManager(
            self.folder / "runs", lambda cell: devices_of(self.bench), self.workers, simulated=True
        )
        (self.folder / "loop").mkdir()

    def play(self, scene: Callable[[Equipment, Campaign, Path, Say], None]) -> LoopWork:
        def played(equipment: Equipment, say: Say) -> str:
            scene(equipment, a_campaign(**QUICK), self.folder / "loop", say)
            return "the-data"

        lease = LeaseDeadline("anna", 30.0, LeaseClock())
        cell, devices = self.bench.cell, devices_of(self.bench)
        return LoopWork(self.folder / "loop", BEGUN, self.book, cell, devices, lease, played)

    def begin(self, scene: Callable[[Equipment, Campaign, Path, Say], None]) -> LoopWork:
        work = self.play(scene)
        self.book.lend("the-loop", work)
        return work


@pytest.fixture
def stage(tmp_path: Path) -> Iterator[Stage]:
    stage = Stage(tmp_path)
    with closing(stage.workers), closing(stage.book):
        yield stage


def test_a_service_that_ends_while_a_person_is_asked_is_the_reason(
    stage: Stage, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(globals(), "BEGUN", replace(BEGUN, outlook={"poses": 15}))
    driven: list[str] = []

    def scene(equipment: Equipment, campaign: Campaign, folder: Path, say: Say) -> None:
        if not equipment.confirm("drives new poses"):
            raise LoopEnded(ExecutionOutcome(State.PAUSED, "Nobody wanted it."))
        driven.append("new poses")

    work = stage.begin(scene)
    until(lambda: work.document["state"] == "paused")
    work.close()
    until(lambda: work.over)
    assert (work.document["state"], work.document["reason"]) == ("paused", SERVICE_ENDS)
    assert not driven


def test_a_pause_between_two_runs_rests_before_the_next_moves(stage: Stage) -> None:
    computing, computed = threading.Event(), threading.Event()

    def scene(equipment: Equipment, campaign: Campaign, folder: Path, say: Say) -> None:
        say("computing")
        computing.set()
        computed.wait(PATIENCE_S)
        measure(equipment, campaign, folder / "campaign_2")

    work = stage.begin(scene)
    computing.wait(PATIENCE_S)
    work.pause("anna", "anna gave the motion lease back.")
    assert work.document["state"] == "running"  # until the step has ended
    computed.set()
    until(lambda: work.document["state"] == "paused")
    assert work.document["reason"] == "anna gave the motion lease back."
    assert stage.bench.calls == 0
    work.pause("anna")  # already
    work.resume(LeaseDeadline("bert", 30.0, LeaseClock()))
    assert work.document["state"] != "paused"  # nobody takes the old pause for the next one
    until(lambda: work.document["state"] == "succeeded")
    assert work.document["runs"] == ["the-loop-campaign-2"]
    shown = stage.book.document("the-loop-campaign-2")
    assert (shown["state"], shown["name"]) == ("succeeded", "night, campaign 2")
    with pytest.raises(Problem, match="only a paused one"):
        work.resume(LeaseDeadline("bert", 30.0, LeaseClock()))


@pytest.mark.parametrize("paused", [False, True])
def test_a_stop_between_two_runs_ends_it_without_another_move(stage: Stage, paused: bool) -> None:
    computing, computed = threading.Event(), threading.Event()

    def scene(equipment: Equipment, campaign: Campaign, folder: Path, say: Say) -> None:
        computing.set()
        computed.wait(PATIENCE_S)
        measure(equipment, campaign, folder / "campaign2")

    work = stage.begin(scene)
    computing.wait(PATIENCE_S)
    if paused:
        work.pause("anna")
        computed.set()
        until(lambda: work.document["state"] == "paused")
    assert work.stop("anybody") == []
    computed.set()
    until(lambda: stage.book.lent_to is None)
    assert (work.document["state"], work.document["reason"]) == ("stopped", "Stopped on request.")
    assert stage.bench.calls == 0


@pytest.mark.parametrize("how", ["stop", "end of the service"])
def test_what_is_computed_ends_with_the_loop(stage: Stage, how: str) -> None:
    """A fit of ten minutes; it is under way in another process when the order comes."""
    processes: list[int] = []

    def scene(equipment: Equipment, campaign: Campaign, folder: Path, say: Say) -> None:
        processes.append(equipment.compute(os.getpid))
        equipment.compute(time.sleep, 10.0 * PATIENCE_S)

    work = stage.begin(scene)
    until(lambda: processes and work._worker._busy)
    assert processes != [os.getpid()]
    work.stop("anybody") if how == "stop" else work.close()
    until(lambda: stage.book.lent_to is None)
    ended = ("stopped", "Stopped on request.") if how == "stop" else ("paused", "The service was ended.")
    assert (work.document["state"], work.document["reason"]) == ended
    with pytest.raises(ProcessLookupError):
        os.kill(processes[0], 0)


def test_what_takes_too_long_stands_in_the_document(stage: Stage, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(workers, "MOST_S", 0.2)

    def scene(equipment: Equipment, campaign: Campaign, folder: Path, say: Say) -> None:
        equipment.compute(time.sleep, PATIENCE_S)

    work = stage.play(scene)
    work()
    assert (work.document["state"], work.document["problem"]["status"]) == ("failed", 503)


def test_a_paused_run_of_a_loop_goes_on_where_it_was(stage: Stage) -> None:
    def scene(equipment: Equipment, campaign: Campaign, folder: Path, say: Say) -> None:
        measure(equipment, campaign, folder / "campaign1")

    stage.bench.faults[10] = lambda: stage.book.pause_all("anna", "Lunch.")
    work = stage.begin(scene)
    until(lambda: work.document["state"] == "paused")
    assert work.document["reason"] == "Lunch."
    assert stage.book.document("the-loop-campaign1")["done"] == 1
    with pytest.raises(Problem, match="loop the-loop"):
        stage.book.refuse_busy()
    work.resume(LeaseDeadline("bert", 30.0, LeaseClock()))
    until(lambda: work.document["state"] == "succeeded")
    shown = stage.book.document("the-loop-campaign1")
    assert shown["done"] == shown["total"]
    assert len(stage.bench.shots) == shown["total"] + 2 * 3  # nests twice, no reading twice


@pytest.mark.parametrize("rests", [False, True])
def test_a_run_of_a_loop_that_is_finished_leads_on(stage: Stage, rests: bool) -> None:
    next_steps: list[str] = []

    def scene(equipment: Equipment, campaign: Campaign, folder: Path, say: Say) -> None:
        measure(equipment, campaign, folder / "campaign1")
        next_steps.append("diagnosis")

    def finish() -> None:
        work.finish("the-loop-campaign1", LeaseDeadline("bert", 30.0, LeaseClock()), "bert", "it is enough")

    # while the second target is measured: one reading is enough to end with
    stage.bench.faults[11] = (lambda: stage.book.pause_all("anna", "Lunch.")) if rests else finish
    work = stage.begin(scene)
    if rests:
        until(lambda: work.document["state"] == "paused")
        finish()
        assert work.document["state"] != "paused"
    until(lambda: work.document["state"] == "succeeded")
    assert next_steps == ["diagnosis"]
    assert stage.bench.calls == 11  # nothing was measured, or moved, after it
    shown = stage.book.document("the-loop-campaign1")
    assert (shown["state"], shown["done"], shown["finished_early"]["by"]) == ("succeeded", 2, "bert")


def test_a_stop_that_meets_an_order_to_resume_wins(stage: Stage, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two clients: one resumes while the other stops, just before the run is allowed to move again."""

    def scene(equipment: Equipment, campaign: Campaign, folder: Path, say: Say) -> None:
        measure(equipment, campaign, folder / "campaign1")

    resume, calls = Run.resume, list[int]()

    def met(run: Run, *args: Any, **more: Any) -> None:
        assert work.stop("bert") == []
        calls.append(stage.bench.calls)
        resume(run, *args, **more)

    stage.bench.faults[10] = lambda: stage.book.pause_all("anna", "Lunch.")
    work = stage.begin(scene)
    until(lambda: work.document["state"] == "paused")
    monkeypatch.setattr(Run, "resume", met)
    work.resume(LeaseDeadline("anna", 30.0, LeaseClock()))
    until(lambda: stage.book.lent_to is None)
    assert (work.document["state"], work.document["reason"]) == ("stopped", "Stopped on request.")
    assert calls == [stage.bench.calls]


def test_what_is_refused_and_what_breaks_stands_in_the_document(stage: Stage) -> None:
    def refuse(equipment: Equipment, campaign: Campaign, folder: Path, say: Say) -> None:
        raise ConfigError("no")

    def break_down(equipment: Equipment, campaign: Campaign, folder: Path, say: Say) -> None:
        raise ZeroDivisionError

    work = stage.play(refuse)
    work()
    assert (work.document["state"], work.document["problem"]["status"]) == ("failed", 422)
    work = stage.play(break_down)
    with pytest.raises(ZeroDivisionError):
        work()
    assert (work.document["state"], work.document["run_id"]) == ("failed", None)
    assert "fault of this program" in work.document["reason"]


def test_the_end_of_the_service_ends_it(stage: Stage) -> None:
    def scene(equipment: Equipment, campaign: Campaign, folder: Path, say: Say) -> None:
        measure(equipment, campaign, folder / "campaign1")

    def end() -> None:
        work.close()
        stage.book.pause_all("service ends", "The service was ended.")

    stage.bench.faults[10] = end
    work = stage.begin(scene)
    until(lambda: stage.book.lent_to is None)
    assert (work.document["state"], work.document["reason"]) == ("paused", "The service was ended.")
    assert stage.book.document("the-loop-campaign1")["state"] == "paused"


def test_a_loop_for_which_the_disk_has_no_room_rests(stage: Stage, monkeypatch: pytest.MonkeyPatch) -> None:
    full = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    def scene(equipment: Equipment, campaign: Campaign, folder: Path, say: Say) -> None:
        measure(equipment, campaign, folder / "campaign1")
        raise full

    def refuse(*_: Any) -> None:
        raise full

    stage.bench.faults[10] = lambda: monkeypatch.setattr(loop_work, "replace_file", refuse)
    work = stage.begin(scene)
    until(lambda: stage.book.lent_to is None)
    assert (work.document["state"], work.document["problem"]["code"]) == ("paused", StorageError.code)
    shown = stage.book.document("the-loop-campaign1")
    assert (shown["state"], shown["done"]) == ("succeeded", shown["total"])


def opened(
    stage: Stage,
    tmp_path: Path,
    asked: dict[str, Any] | None = None,
    kind: str = "loop",
    opening: Callable[[], None] = lambda: None,
    **files: str,
) -> WorkStore:
    """The loops, or verifications, of a service that starts with these files, by name."""
    for name, text in files.items():
        folder = tmp_path / "loops" / name.replace("_", "-")
        folder.mkdir(parents=True)
        (folder / ABOUT).write_text(text, "utf-8")
        if asked is not None:
            (folder / ASKED).write_text(json.dumps(asked), "utf-8")

    def open_devices(_: Cell) -> Devices:
        opening()
        return devices_of(stage.bench)

    at, workers = tmp_path / "loops", Workers(1, waiting=0)
    if kind == "verification":
        return VerificationStore(at, stage.book, open_devices, workers, simulated=True)
    return LoopStore(
        at, stage.book, DatasetStore(tmp_path / "datasets"), open_devices, workers, simulated=True
    )


def asked_of(stage: Stage, kind: str, cell: str = "") -> dict[str, Any]:
    asked = {"cell": cell or stage.bench.cell.source, "poses": 1}
    if kind == "verification":
        return asked | {"model_id": "", "seed": 1}
    return asked | {"campaign": a_campaign(**QUICK).source}


def test_a_loop_whose_file_is_damaged_is_named_and_the_others_are_listed(
    stage: Stage, tmp_path: Path
) -> None:
    odd = json.dumps(BEGUN.as_dict() | {"state": "asleep"})
    loops = opened(stage, tmp_path, cut='{"a":', odd=odd, the_loop=json.dumps(BEGUN.as_dict()))
    assert [loop["id"] for loop in readable(loops.ids(), loops.document)] == ["the-loop"]
    for name, words in (("cut", "not valid JSON"), ("odd", "state: ")):
        with pytest.raises(Problem, match=f"loops/{name}/{ABOUT} .* damaged .*{words}"):
            loops.document(name)


def test_a_loop_that_was_cut_off_has_failed(stage: Stage, tmp_path: Path) -> None:
    loops = opened(stage, tmp_path, the_loop=json.dumps(BEGUN.as_dict() | {"run_id": "the-loop-campaign1"}))
    shown = loops.document("the-loop")
    assert (shown["state"], shown["reason"], shown["run"]) == ("failed", CUT_OFF, None)
    with pytest.raises(Problem, match="has ended"):
        loops.stop("the-loop", "anna")
    with pytest.raises(Problem, match="no loop"):
        loops.document("another")


@pytest.mark.parametrize("kind", ["loop", "verification"])
def test_a_loop_that_was_cut_off_rests_and_can_be_stopped(stage: Stage, tmp_path: Path, kind: str) -> None:
    begun = json.dumps(BEGUN.as_dict() | {"run_id": "the-loop-campaign1"})
    loops = opened(stage, tmp_path, asked_of(stage, kind), kind, the_loop=begun)
    shown = loops.document("the-loop")
    assert (shown["state"], shown["reason"], shown["run"]) == ("paused", RESTS, None)
    loops.pause("the-loop", "anna")
    assert loops.stop("the-loop", "anna") == []
    assert loops.document("the-loop")["state"] == "stopped"
    with pytest.raises(Problem, match="has ended"):
        loops.resume("the-loop", stage.bench.cell, LeaseDeadline("anna", 30.0, LeaseClock()), None)
    assert stage.bench.calls == 0


@pytest.mark.parametrize("kind", ["loop", "verification"])
@pytest.mark.parametrize(
    ("cell", "simulated", "runs", "words"),
    [
        ("another", True, (), "another cell file"),
        ("", False, (), "measured on real devices"),
        ("", True, ("the-loop-campaign1",), "was deleted"),
    ],
)
def test_a_loop_that_cannot_go_on_says_why(
    stage: Stage, tmp_path: Path, kind: str, cell: str, simulated: bool, runs: tuple[str, ...], words: str
) -> None:
    begun = replace(BEGUN, simulated=simulated, runs=runs)
    loops = opened(stage, tmp_path, asked_of(stage, kind, cell), kind, the_loop=json.dumps(begun.as_dict()))
    with pytest.raises(Problem, match=words):
        loops.resume("the-loop", stage.bench.cell, LeaseDeadline("anna", 30.0, LeaseClock()), None)
    assert loops.document("the-loop")["state"] == "paused"
    assert stage.book.lent_to is None


@pytest.mark.parametrize("kind", ["loop", "verification"])
def test_of_two_clients_that_resume_a_loop_one_does(
    stage: Stage, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str
) -> None:
    loops = opened(stage, tmp_path, asked_of(stage, kind), kind, the_loop=json.dumps(BEGUN.as_dict()))
    both, played, refused = threading.Barrier(2), list[str](), list[Problem]()

    def play(*_: Any) -> None:
        played.append("once")
        until(lambda: refused)
        raise LoopEnded(ExecutionOutcome(State.STOPPED, "Enough."))

    def resume(who: str) -> None:
        both.wait(PATIENCE_S)
        try:
            loops.resume("the-loop", stage.bench.cell, LeaseDeadline(who, 30.0, LeaseClock()), None)
        except Problem as problem:
            refused.append(problem)

    monkeypatch.setattr(type(loops), "_play", lambda *_: play)
    clients = [threading.Thread(target=resume, args=(who,)) for who in ("anna", "bert")]
    for each in clients:
        each.start()
    for each in clients:
        each.join()
    until(lambda: stage.book.lent_to is None)
    assert (len(played), [each.status_code for each in refused]) == (1, [409])
    assert loops.document("the-loop")["reason"] == "Enough."


@pytest.mark.parametrize("kind", ["loop", "verification"])
def test_a_stop_that_meets_the_continuation_of_a_loop_wins(stage: Stage, tmp_path: Path, kind: str) -> None:
    """It comes when the devices are opened, just before the robot is lent."""
    begun = json.dumps(BEGUN.as_dict())
    loops = opened(
        stage,
        tmp_path,
        asked_of(stage, kind),
        kind,
        lambda: stops.append(loops.stop("the-loop", "bert")),
        the_loop=begun,
    )
    stops: list[list[AcquisitionError]] = []
    with pytest.raises(Problem, match=f"The {kind} has ended"):
        loops.resume("the-loop", stage.bench.cell, LeaseDeadline("anna", 30.0, LeaseClock()), None)
    assert (stops, stage.book.lent_to, stage.bench.calls) == ([[]], None, 0)
    assert loops.document("the-loop")["state"] == "stopped"


@pytest.mark.parametrize(("kind", "run"), [("loop", "campaign2"), ("verification", "campaign1")])
def test_a_run_that_verifies_is_not_finished_early(
    stage: Stage, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str, run: str
) -> None:
    loops = opened(stage, tmp_path, asked_of(stage, kind), kind, the_loop=json.dumps(BEGUN.as_dict()))
    refused = threading.Event()
    monkeypatch.setattr(type(loops), "_play", lambda *_: lambda *_: refused.wait(PATIENCE_S) and None)
    lease = LeaseDeadline("anna", 30.0, LeaseClock())
    loops.resume("the-loop", stage.bench.cell, lease, None)
    with pytest.raises(Problem, match="verifies the correction") as problem:
        loops.finish(f"the-loop-{run}", lease, "anna", "it is enough")
    assert problem.value.status_code == 409
    assert f"or stop the {kind}" in problem.value.do
    refused.set()
    until(lambda: stage.book.lent_to is None)


def test_a_device_that_was_accepted_counts_until_a_run_has_ended_with_it(
    stage: Stage, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The run that rested is abandoned, because its targets have become old."""
    other = DeviceAcceptance("SN-2", "the tracker was exchanged", "anna")
    resumed: list[tuple[str, DeviceAcceptance | None]] = []

    def scene(equipment: Equipment, campaign: Campaign, folder: Path, say: Say) -> None:
        with equipment.create(folder / "campaign2", equipment.cell, campaign, True) as run:
            assert equipment.resumed(run, ExecutionOutcome(State.PAUSED, "Another instrument."))
            run.stop(by="the loop")
        for name in ("campaign3", "campaign4"):
            measure(equipment, campaign, folder / name)

    def resume(
        run: Run, by: str = "", key: str | None = None, accepted: DeviceAcceptance | None = None
    ) -> None:
        resumed.append((run.folder.name, accepted))

    monkeypatch.setattr(Run, "resume", resume)
    work = stage.begin(scene)
    until(lambda: work.document["state"] == "paused")
    work.resume(LeaseDeadline("anna", 30.0, LeaseClock()), other)
    until(lambda: stage.book.lent_to is None)
    assert work.document["state"] == "succeeded", work.document
    assert resumed == [("the-loop-campaign2", other), ("the-loop-campaign3", other)]
