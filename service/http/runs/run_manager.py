"""The runs of the record directory, and the one of them that may be using the robot.

    RECORD/runs/ID/record.sqlite3    a run, by `acquisition`
    RECORD/runs/ID/dry_run.json      a campaign that was only checked

One thread at a time uses the robot: that of a run, or that of a closed loop with its runs one after another.
Nothing is executed when the book is opened: runs that were going on when the program ended come back paused.

Computations from the records of runs are made in a worker process as soon as one is free. The runs go on meanwhile.
"""

from __future__ import annotations

import shutil
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

from acquisition import (
    Campaign,
    Cell,
    Devices,
    Event,
    LeaseDeadline,
    Run,
    RunStatus,
    State,
    read_status,
)
from acquisition.campaign import Visit
from acquisition.errors import StorageError
from acquisition.examination import Examination
from acquisition.record import DeviceAcceptance, is_begun
from acquisition.run import NEVER_ASKED, ON_REQUEST, ROLES, DeviceCondition, KnownDevice
from drivers.errors import AcquisitionError, LinkError, LinkLost
from service.http.runs import dry_runs, errors
from service.http.runs.damage import Damaged, look_through, was_cut_off
from service.http.runs.dry_runs import DryRuns
from service.http.runs.execution import RobotThread
from service.http.runs.run_document import run_document
from service.http.wire.problems import Problem, not_found
from service.http.work.deletions import DeletionLog, take_away
from service.http.work.workers import Workers, ending
from service.ids import new_id, safe_id

# Seconds for the current reading when the service ends; after them only the current move is waited for
PAUSE_S = 2.0
REST_S = 3.0  # for that; then the robot is halted
STOP_S = 60.0  # longer than any deadline of a device
FINISH_S = 5.0
BEGIN_S = 30.0  # from an order to go on until a run does: the robot's name is looked up, its lock and the record taken
SERVICE_ENDS = "The service was ended."
MAY_MOVE = "Nothing is connected since this link was lost: press the emergency stop if the robot moves."
T = TypeVar("T")


class RunManager:
    """Manager of the runs of a record folder. Thread-safe.

    `open_devices` returns the devices of a cell, not yet connected. `workers` make the plans. There are two locks.
    `_opening` is held while a record is opened, which may wait for another program that has it. `_mutex` is held
    only for moments. A stop of the run that uses the robot takes neither.
    """

    def __init__(
        self, folder: Path, open_devices: Callable[[Cell], Devices], workers: Workers, *, simulated: bool
    ) -> None:
        self._folder, self._open_devices, self._simulated = folder, open_devices, simulated
        self._workers, self.compute = workers, RunComputations(workers)
        self._opening, self._mutex = threading.Lock(), threading.RLock()
        self._closed = False
        self._runs: dict[str, Run] = {}
        self._errors: dict[str, AcquisitionError] = {}
        self._dry_runs = DryRuns(folder)
        self._damaged = Damaged(folder)
        self._execution: RobotThread | None = None
        self._devices: dict[str, KnownDevice] = dict(
            NEVER_ASKED
        )  # of devices, from runs and examinations that ended
        self.last: str | None = None  # the run that used the robot last
        self.at_rest: Callable[[], None] = lambda: None  # called when a run or a loop has ended
        folder.mkdir(parents=True, exist_ok=True)
        for name in self.ids():
            self._recover(name)

    def _recover(self, name: str) -> None:
        folder = self._folder / name
        with self._damaged.met(name):
            if self._dry_runs.document(name) is not None:
                return
            if was_cut_off(folder):  # no client was told of it
                shutil.rmtree(folder)
                return
            look_through(folder)
            self.last = self.last or name  # the newest comes first
            if State(self._look(name).state).active:
                self._runs[name] = Run.open(folder)

    def _look(self, name: str) -> RunStatus:
        return read_status(self._folder / name)

    def ids(self) -> list[str]:
        """Return the ids of all runs, newest first.

        Runs in memory are listed even if their folder is gone.
        """
        try:
            found = {p.name for p in self._folder.iterdir() if safe_id(p.name)}
        except FileNotFoundError:
            found = set()
        return sorted(found | set(self._runs), reverse=True)

    def document(self, name: str, *, at_once: bool = False) -> dict[str, Any]:
        """Return the contract's document of a run.

        With `at_once`, it does not wait for a run that is just beginning or ending; this is for the answer to a stop.

        Raises
        ------
        Problem
            404: there is no such run.
        """
        self._known(name)
        if (known := self._damaged.document(name)) is not None:
            return known
        if not at_once:
            self._let_begin(name)
            self._let_finish(name)
        with self._mutex:
            run, error = self._runs.get(name), self._errors.get(name)
        try:
            if run is None and (dry := self._dry_runs.document(name)) is not None:
                return dry
            status = self._look(name) if run is None else run.status()
        except StorageError as damage:  # since the service was started
            return self._damaged.set_aside(name, damage)
        return run_document(name, status, error=error)

    def _let_begin(self, name: str) -> None:
        """Wait until a run that was resumed has begun.

        Otherwise it would be shown with the reason of its former rest.
        """
        execution = self._execution
        if execution is not None and execution.run_id == name and not execution.loop_id:
            execution.begun.wait(BEGIN_S)

    def _let_finish(self, name: str) -> None:
        """Wait until a run that has just ended has freed robot and record."""
        execution = self._execution
        if execution is None or execution.run_id != name or not execution.begun.is_set():
            return
        if not execution.loop_id and not State(self._runs[name].status().state).active:
            execution.thread.join(FINISH_S)

    def changes(self, name: str) -> int | None:
        """Return `Run.changes` of the run that uses the robot, without waiting.

        It is None for any other run.
        """
        run = self._runs.get(name) if name == self.busy_with else None
        return None if run is None else run.changes

    def get(self, name: str) -> Run:
        """Return a run, opened if necessary.

        Raises
        ------
        Problem
            404, or 409 for a dry run.
        RecordInUse
            Another program has the record.
        """
        run = self._runs.get(name)
        return self._opened(name) if run is None else run

    def _opened(self, name: str) -> Run:
        self._known(name)
        if self._dry_runs.document(name) is not None:
            raise errors.dry()
        with self._opening:
            run = self._runs.get(name)
            if run is None:
                run = Run.open(self._folder / name)
                with self._mutex:
                    self._runs[name] = run
            return run

    def record_of(self, name: str) -> Path:
        """Return the folder of a record with this name, whether or not there is one."""
        return self._folder / name

    def path(self, name: str) -> Path:
        """Return the folder of a run's record.

        Raises
        ------
        Problem
            404: there is no such run.
        """
        self._known(name)
        return self.record_of(name)

    def _known(self, name: str) -> None:
        if name not in self._runs and (not safe_id(name) or not (self._folder / name).is_dir()):
            raise not_found("run", name)

    # -- making and executing ----------------------------------------------------------------------------

    def check(
        self, cell: Cell, table: Mapping[str, Any], name: str, models: Mapping[str, Path] | None = None
    ) -> str:
        """Make a dry run: everything is checked, nothing is opened; `models` as in `campaign_of`.

        Raises
        ------
        ConfigError, UnsafePlan
            The campaign cannot be used, or its plan is unsafe.
        """
        own = new_id()
        folder = self._folder / own
        with _whole(folder):
            self._workers.call(dry_runs.keep, folder, cell, table, name, self._simulated, models or {})
        return own

    def start(self, cell: Cell, plan: tuple[Campaign, list[Visit]], name: str, lease: LeaseDeadline) -> str:
        """Create a run from a plan and let the robot move.

        Raises
        ------
        Problem
            409: another run or loop uses the robot.
        """
        campaign, visits = plan
        devices = self._open_devices(cell)
        run_id = new_id()
        folder, title = self._folder / run_id, name or cell.name
        with _whole(folder):
            run = Run.create(folder, cell, campaign, simulated=self._simulated, name=title, visits=visits)
        try:
            with self._mutex:
                self.refuse_busy()
                self._runs[run_id] = run
                self._begin(run_id, run, devices, lease)
        except Problem:  # another was quicker
            run.close()
            shutil.rmtree(folder)
            raise
        return run_id

    def resume(
        self, name: str, cell: Cell, lease: LeaseDeadline, accepted: DeviceAcceptance | None = None
    ) -> None:
        """Resume a paused or stopped run.

        `accepted` is another robot or instrument than the record's.

        Raises
        ------
        Problem, NotResumed, RecordInUse
            The run cannot be resumed now.
        """
        run = self.get(name)
        if run.cell.source != cell.source:
            raise errors.other_cell()
        self.need_robot()
        devices = self._open_devices(run.cell)
        with self._mutex:
            self.refuse_busy()
            status = run.status()
            if status.simulated != self._simulated:
                raise errors.other_devices(simulated=status.simulated)
            if status.state != State.READY.value:
                run.resume(by=lease.owner, accepted=accepted)
            self._begin(name, run, devices, lease)

    def need_robot(self) -> None:
        """Refuse new work while the robot is busy.

        It first waits for a run that was stopped, or is just ending.
        """
        execution = self._execution
        if execution is not None and execution.stopped:
            execution.thread.join(FINISH_S)
        elif execution is not None:
            self._let_finish(execution.run_id)
        self.refuse_busy()

    def refuse_busy(self) -> None:
        """Refuse new work while the robot is busy or the service ends.

        Raises
        ------
        Problem
            409 with the ids of the current run and loop, or 503 if the service ends.
        """
        if self._closed:
            raise ending()
        execution = self._execution
        if execution is not None:
            raise errors.busy(execution)

    @property
    def busy_with(self) -> str | None:
        """The id of the run that uses the robot."""
        execution = self._execution
        return None if execution is None else execution.run_id or None

    @property
    def lent_to(self) -> str | None:
        """The id of the loop that uses the robot."""
        execution = self._execution
        return None if execution is None else execution.loop_id or None

    def _begin(self, name: str, run: Run, devices: Devices, lease: LeaseDeadline) -> None:
        def work() -> None:
            try:
                outcome = run.execute(devices, on_event=heard, lease=lease, begin=self.compute)
                if outcome.error is not None:
                    self._errors[name] = outcome.error
            except AcquisitionError as error:
                self._errors[name] = error
            finally:
                execution.begun.set()
                self._devices |= run.devices
                self._execution = None
                self.at_rest()

        def heard(_: Event) -> None:
            execution.begun.set()

        execution = RobotThread(threading.Thread(target=work, name=f"run {name}"), name)
        self._errors.pop(name, None)
        self._execution, self.last = execution, name
        execution.thread.start()

    # -- for a loop --------------------------------------------------------------------------------------

    @property
    def lent_for(self) -> str:
        """Whether it is a loop or a verification that uses the robot; empty if neither does."""
        execution = self._execution
        return "" if execution is None or not execution.loop_id else execution.kind

    def lend(self, loop_id: str, work: Callable[[], None], kind: str = "loop") -> None:
        """Let a loop, or a verification, use the robot until `work`, in a separate thread, ends.

        Raises
        ------
        Problem
            409: the robot is busy.
        """

        def whole() -> None:
            try:
                work()
            finally:
                self._execution = None
                self.at_rest()

        with self._mutex:
            self.refuse_busy()
            # Not waited for when the program ends: between its runs a loop computes for many seconds.
            thread = threading.Thread(target=whole, name=f"loop {loop_id}", daemon=True)
            self._execution = RobotThread(thread, "", loop_id, kind=kind)
            thread.start()

    @contextmanager
    def run_of_loop(
        self, name: str, title: str, cell: Cell, campaign: Campaign, plan: Callable[[], list[Visit]]
    ) -> Iterator[Run]:
        """Create or open a run of the loop that has the robot.

        It is listed and takes orders like any other run.
        """
        execution = self._execution
        assert execution is not None
        if is_begun(folder := self.record_of(name)):
            run = self.get(name)
        else:
            with _whole(folder):
                run = Run.create(folder, cell, campaign, simulated=self._simulated, name=title, visits=plan())
        with self._mutex:
            self._runs[name] = run  # stays open: others look at it
            execution.begun.clear()
            execution.run_id = self.last = name
        try:
            yield run
        finally:
            self._devices |= run.devices
            execution.run_id = ""

    def begun(self) -> None:
        """Note that the run of the loop executes, so that orders reach it."""
        if (execution := self._execution) is not None:
            execution.begun.set()

    def not_begun(self) -> None:
        """Note that the run of the loop rests; a pause waits until it executes again."""
        if (execution := self._execution) is not None:
            execution.begun.clear()

    @contextmanager
    def examined(self) -> Iterator[Callable[[Examination], None]]:
        """Reserve the devices within the block, in which their state is read.

        Yields a function that takes the result.

        Raises
        ------
        Problem
            409: the robot is busy.
        """
        self.need_robot()
        with self._mutex:
            self.refuse_busy()
            self._execution = RobotThread(threading.current_thread(), "", examines=True)
        before = self._devices
        self._devices = {
            role: replace(each, condition=DeviceCondition.CONNECTING, says="It is being examined.", code=None)
            for role, each in before.items()
        }
        found: list[Examination] = []
        try:
            yield found.append
        finally:
            self._devices = before | known_from(found)
            self._execution = None

    def devices(self) -> list[KnownDevice]:
        """Return what is known of robot and instrument. Nothing is asked or read for it, and nothing is waited for."""
        run = self._runs.get(self.busy_with or "")
        known = self._devices if run is None else {**self._devices, **run.devices}
        return [known[role] for role in ROLES]

    def join(self, seconds: float) -> bool:
        """Wait up to this time for the current user of the robot to end; whether the robot is free."""
        if (execution := self._execution) is not None:
            execution.thread.join(seconds)
        return self._execution is None

    # -- orders to runs ----------------------------------------------------------------------------------

    def pause(self, name: str, by: str, reason: str = ON_REQUEST) -> None:
        """Pause a run after the current reading.

        Raises
        ------
        Problem, RecordInUse, StorageError
            The run cannot be paused.
        """
        run, execution = self.get(name), self._execution
        if execution is not None and execution.run_id == name:
            execution.begun.wait(FINISH_S)  # a run that has not begun yet cannot be paused, and would go on
        run.pause(by=by, reason=reason)

    def pause_all(self, by: str, reason: str) -> None:
        """Pause the run that uses the robot after the current reading."""
        if (name := self.busy_with) is not None:
            self.pause(name, by, reason)

    def finish(self, name: str, by: str, reason: str) -> None:
        """End a run as succeeded: after the current reading, or at once where it rests.

        Raises
        ------
        Problem, NotResumed, RecordInUse, StorageError
            The run cannot be finished.
        """
        run, execution = self.get(name), self._execution
        if execution is not None and execution.run_id == name:
            execution.begun.wait(FINISH_S)  # as in `pause`
        run.finish(by, reason)
        self.at_rest()

    def stop(self, name: str, by: str) -> list[AcquisitionError]:
        """Halt the robot now and end the run; return the errors of devices that did not stop.

        Raises
        ------
        Problem, RecordInUse
            There is no such run, or another program has it.
        """
        run, execution = self.get(name), self._execution
        if execution is not None and execution.run_id == name:
            execution.stopped = not execution.loop_id
        problems = run.stop(by=by)
        lost = self._errors.get(name)
        if self._execution is None and isinstance(lost, LinkError):
            problems.append(LinkLost(lost.message, device=lost.device, what_to_do=MAY_MOVE))
        return problems

    def delete(
        self, name: str, trail: DeletionLog, by: str, reason: str, in_hand: Sequence[str]
    ) -> dict[str, Any]:
        """Delete a run with its readings and return the line of the trail; its events stay.

        `in_hand` are the runs of the loop that has the robot.

        Raises
        ------
        Problem
            404, or 409 while it runs.
        RecordInUse
            Another program has the record.
        StorageError
            The trail cannot be written, or the files cannot be deleted.
        """
        with self._mutex:
            if name in (self.busy_with, *in_hand):
                raise errors.in_use()
            document = self.document(name, at_once=True)
            told_only = document.get("damaged") or document["dry_run"]
            run = None if told_only else self.get(name)  # with it no other program has the record
            line = trail.note_run(document, self._folder / name, by, reason, events=run is not None)
            if run is not None:
                run.close()
            self._runs.pop(name, None)
            self._errors.pop(name, None)
            self.last = None if self.last == name else self.last
            for known in (self._damaged, self._dry_runs):
                known.forget(name)
            take_away(self._folder / name)
        return line

    def refuse_new(self) -> None:
        """Refuse all new work from now on: the service ends."""
        self._closed = True

    def close(self) -> None:
        """Pause what runs, let it come to rest, after a while halt the robot; give every record up."""
        self.refuse_new()
        by = "service ends"
        if (name := self.busy_with) is not None:
            self.pause(name, by, SERVICE_ENDS)
            if not self.join(PAUSE_S):
                self.get(name).pause(by, reason=SERVICE_ENDS, at_once=True)
            if not self.join(REST_S):
                self.get(name).halt()
                self.join(STOP_S)
        self.compute.close()
        with self._mutex:
            for run in self._runs.values():
                run.close()
            self._runs.clear()


@contextmanager
def _whole(folder: Path) -> Iterator[None]:
    """Remove the new folder of a run that cannot be created within the block, for example on a full disk."""
    new = not folder.exists()
    try:
        yield
    except BaseException:
        if new:
            shutil.rmtree(folder, ignore_errors=True)
        raise


def known_from(examinations: Sequence[Examination]) -> dict[str, KnownDevice]:
    """Return what examinations that have just ended say of the devices that they asked, by role."""
    known, now_utc = {}, time.time()
    for role, each in ((role, each) for each in examinations for role in ROLES):
        found = [check for check in each.findings if check.device == role]
        if any(check.check == "lease" and check.level != "ok" for check in found):
            continue  # another program uses it: it was not asked
        fault = next((check for check in found if check.level == "fault"), None)
        condition, says, heard_utc = (
            DeviceCondition.NOT_CONNECTED,
            "It was examined and is in order.",
            now_utc,
        )
        if fault is not None:
            silent = fault.code is not None and fault.code // 1000 == LinkError.code // 1000
            condition = DeviceCondition.SILENT if silent else DeviceCondition.IN_ERROR
            says, heard_utc = f"{fault.found}. {fault.do}", None if silent else now_utc
        code = None if fault is None else fault.code
        known[role] = KnownDevice(role, condition, says, now_utc, heard_utc, code)
    return known


class RunComputations:
    """Computations from the records of runs, in a worker process.

    If one is refused because too much is being computed, its run has no forecast, or computes itself.
    """

    def __init__(self, workers: Workers) -> None:
        self._workers = workers
        self._thread = ThreadPoolExecutor(1, "computations")  # it waits for the worker

    def __call__(self, function: Callable[[Path], T], record: Path, /) -> Future[T]:
        """Begin one; its future raises AcquisitionError, Problem, WorkerDied."""
        return self._thread.submit(self._workers.call, function, record)

    def close(self) -> None:
        """Begin no more runs; report to those who wait for one that it is cancelled."""
        self._thread.shutdown(wait=False, cancel_futures=True)
