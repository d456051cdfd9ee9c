"""Execution of a closed loop or of a proof: its state, and the orders that it obeys.

It obeys orders between and within its runs. It lives in one thread, which has the robot until it ends
(`RunManager.lend`). While the loop computes, its robot is at rest, and nothing else may move it. Long
computations run in a separate worker process, which ends with the loop.

While it is paused it keeps its knowledge and its clock, and continues at the same point. If the service ends, or the
disk is full, it rests without its thread: another execution then uses what is measured and computes the rest again.

This module also has the status of a closed loop, as in `loop.json` and the interface.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from acquisition import (
    Campaign,
    Cell,
    Devices,
    Event,
    ExecutionOutcome,
    LeaseDeadline,
    Run,
    ScaledClock,
    State,
    checked_plan,
)
from acquisition.campaign import Visit
from acquisition.errors import StorageError
from acquisition.loop import Equipment, LoopEnded, Say, diagnosed
from acquisition.record import DeviceAcceptance
from acquisition.run import ON_REQUEST, STOPPED
from calib.diagnose import DiagnosisFit
from calib.text import replace_file
from drivers.errors import AcquisitionError
from service.files import as_json
from service.http.runs.run_manager import BEGIN_S, SERVICE_ENDS, RunManager
from service.http.wire import problems
from service.http.wire.problems import Problem
from service.http.work.workers import Workers
from service.refusals import REFUSALS, of_disk

ABOUT = "loop.json"
Play = Callable[[Equipment, Say], str | None]
FAULT = "A fault of this program has ended it; its runs are kept."


class LoopWork:
    """Execution of one closed loop. Thread-safe, except `__call__`.

    `play` drives, keeps the results and returns the id of the data set, if there is one. `accepted` is as in `resume`.
    With `over` it has ended; if it is paused then, it can only be continued by another execution.
    """

    def __init__(
        self,
        folder: Path,
        status: LoopStatus,
        book: RunManager,
        cell: Cell,
        devices: Devices,
        lease: LeaseDeadline,
        play: Play,
        accepted: DeviceAcceptance | None = None,
    ) -> None:
        self._folder, self._book, self._lease, self._play = folder, book, lease, play
        self._rests = 0
        self._worker = Workers(1, waiting=0)
        self._changed = threading.Condition()  # never held while a run is asked or ordered anything
        self._status = status
        self._run: Run | None = None
        self._finished: Run | None = None  # while the loop rested in it
        self._pausing = ""  # why
        self._ending = ""
        self._accepted = accepted  # by the client that resumed it last
        self.over = False
        self._simulated = status.simulated
        self._equipment = Equipment(
            cell,
            devices,
            ScaledClock(cell.time_scale if self._simulated else 1.0),
            self._simulated,
            listen=self._listen,
            lease=lambda: self._lease,
            create=self._create,
            place=lambda record: book.record_of(self._name_of(record)),
            rests=lambda: self._rests,
            resumed=self._resumed,
            compute=self._compute,
            diagnose=self._diagnose,
            begin=book.compute,
            confirm=self._confirmed if status.outlook is not None else lambda motion: True,
        )
        self._update()

    # -- in the thread of the loop ------------------------------------------------------------------------

    def __call__(self) -> None:
        """Run the whole loop; its status records the outcome."""
        state, reason, dataset_id = State.FAILED, FAULT, None
        problem: dict[str, Any] | None = None
        try:
            dataset_id = self._play(self._equipment, self._say)
            state, reason = State.SUCCEEDED, ""
        except LoopEnded as ended:
            state, reason = ended.outcome.state, str(ended)
        except (*REFUSALS, OSError) as error:
            refusal = of_disk(error) if isinstance(error, OSError) else error
            state = State.PAUSED if isinstance(refusal, StorageError) else State.FAILED
            problem = problems.of_error(refusal)
            reason = problem["detail"]
        except Problem as refusal:
            problem = problems.document(refusal.status_code, refusal.detail, refusal.do, refusal.code)
            reason = refusal.detail
        finally:
            self._worker.close()
            self.over = True
            if self._ending == STOPPED and state in (
                State.FAILED,
                State.PAUSED,
            ):  # stopped before it had begun to move
                state, reason, problem = State.STOPPED, STOPPED, None
            problem = problem or self._status.problem  # for which it rested
            self._update(run_id=None, state=state, reason=reason, problem=problem, dataset_id=dataset_id)

    def _say(self, step: str) -> None:
        self._checkpoint()
        self._update(step=step, steps=(*self._status.steps, step))

    def _compute(self, function: Callable[..., Any], *args: Any) -> Any:
        """Compute a function in the worker process and return its value.

        Raises
        ------
        LoopEnded
            The loop ends meanwhile.
        """
        self._checkpoint()
        try:
            return self._worker.call(function, *args)
        except Problem:
            self._checkpoint()
            raise

    def _diagnose(self, data: Path, say: Say) -> DiagnosisFit:
        say("diagnosis: which effects explain the readings")
        return self._compute(diagnosed, data)

    def _checkpoint(self) -> None:
        """Wait while the loop is paused, at a point where nothing moves.

        Raises
        ------
        LoopEnded
            The loop must end.
        """
        if self._pausing and not self._ending:
            self._rest(self._pausing)
        if self._ending:
            raise LoopEnded(
                ExecutionOutcome(State.STOPPED if self._ending == STOPPED else State.PAUSED, self._ending)
            )

    def _rest(
        self,
        reason: str,
        error: AcquisitionError | None = None,
        over: Callable[[], bool] = lambda: False,
    ) -> str | None:
        """Wait for an order to continue; return who gave it, or None if the loop must end.

        `error` is the reason for the rest; `over` returns whether there is no more reason.
        """
        problem = None if error is None else problems.of_error(error)
        with self._changed:
            self._pausing = self._pausing or reason
            self._update(state=State.PAUSED, reason=reason, problem=problem)
            self._rests += 1
            self._changed.wait_for(lambda: self._ending or not self._pausing or over())
            if self._ending:
                return None
            self._update(state=State.RUNNING, reason="", problem=None)
            return self._lease.owner

    def _confirmed(self, motion: str) -> bool:
        """Rest until a person lets the robot move.

        Raises
        ------
        LoopEnded
            The loop ends meanwhile.
        """
        self._rest(f"Next the robot {motion}. Resume to let it move.")
        self._checkpoint()  # an order that came meanwhile
        return True

    def _resumed(self, run: Run, outcome: ExecutionOutcome) -> bool:
        self._book.not_begun()
        by = self._rest(outcome.reason, outcome.error, lambda: self._finished is run)
        if by is not None and self._finished is not run:
            run.resume(by=by, accepted=self._accepted)
        return by is not None and not self._ending  # a stop that came before that was of a run at rest

    @contextmanager
    def _create(self, record: Path, cell: Cell, campaign: Campaign, simulated: bool) -> Iterator[Run]:
        name = self._name_of(record)
        title = f"{self._status.name}, {record.name.replace('_', ' ')}"

        def plan() -> list[Visit]:
            return self._compute(checked_plan, cell, campaign)

        self._checkpoint()
        with self._book.run_of_loop(name, title, cell, campaign, plan) as run:
            self._run = run
            self._update(run_id=name, runs=tuple(dict.fromkeys((*self._status.runs, name))))
            try:
                state = State(run.status().state)
                if state in (State.PAUSED, State.STOPPED) or (
                    state is State.READY and self._accepted is not None
                ):
                    run.resume(by=self._lease.owner, accepted=self._accepted)
                self._checkpoint()  # an order that came meanwhile has seen no run, or has been followed by that
                yield run
                if state is not State.SUCCEEDED and State(run.status().state) is State.SUCCEEDED:
                    self._accepted = None  # later runs expect the device of this one
            finally:
                self._run = None
                self._update(run_id=None)

    def _name_of(self, record: Path) -> str:
        return f"{self._status.id}-{record.name.replace('_', '-')}"

    def _listen(self, run: Run) -> Callable[[Event], None]:
        def hear(_: Event) -> None:
            self._book.begun()
            with self._changed:
                self._status = replace(self._status, version=self._status.version + 1)
                self._changed.notify_all()

        return hear

    def _update(self, **changes: Any) -> None:
        with self._changed:
            self._status = replace(self._status, version=self._status.version + 1, **changes)
            with suppress(
                OSError
            ):  # a full disk: another start of the service finds the loop cut off earlier
                replace_file(self._folder / ABOUT, as_json(self._status.as_dict()))
            self._changed.notify_all()

    # -- from any thread ----------------------------------------------------------------------------------

    @property
    def document(self) -> dict[str, Any]:
        with self._changed:
            return self._status.as_dict()

    def wait(self, after: int, seconds: float) -> int:
        """Return the version, waiting up to `seconds` for one beyond `after`."""
        with self._changed:
            self._changed.wait_for(lambda: self._status.version > after, seconds)
            return self._status.version

    def pause(self, by: str, reason: str = ON_REQUEST) -> None:
        """Pause after the current reading, or after the current step if nothing moves."""
        with self._changed:
            self._pausing = self._pausing or reason
            resting = self._status.state is State.PAUSED
        if not resting:
            self._book.pause_all(by, reason)

    def resume(self, lease: LeaseDeadline, accepted: DeviceAcceptance | None = None) -> None:
        """Continue by leave of the lease holder; return when the loop continues.

        `accepted` is another robot or instrument than that of the loop's first campaign.

        Raises
        ------
        Problem
            409: the loop is not paused.
        """
        with self._changed:
            if self._status.state is not State.PAUSED:
                raise Problem(
                    409,
                    f"It is {self._status.state.value}; only a paused one can be resumed.",
                    "Look at its state; begin a new one where it has ended.",
                    code=3104,
                )
            self._go_on(lease, accepted)

    def finish(self, run_id: str, lease: LeaseDeadline, by: str, reason: str) -> None:
        """Finish the run in hand by leave of the lease holder; the loop goes on with its diagnosis.

        Raises
        ------
        NotResumed
            The run has ended, or has no reading that could be fitted.
        """
        with self._changed:
            run, current = self._run, self._status.run_id == run_id
            rests = self._status.state is State.PAUSED
        if run is None or not current or not rests:
            self._book.finish(run_id, by, reason)
            return
        run.finish(by, reason)
        with self._changed:
            self._finished = run
            self._go_on(lease)

    def _go_on(self, lease: LeaseDeadline, accepted: DeviceAcceptance | None = None) -> None:
        self._lease, self._accepted, self._pausing = lease, accepted, ""
        self._changed.notify_all()
        self._changed.wait_for(self._goes_on, BEGIN_S)

    def _goes_on(self) -> bool:
        """Return whether an order to continue has been obeyed, or another order has followed it."""
        return self._status.state is not State.PAUSED or bool(self._pausing or self._ending)

    def stop(self, by: str) -> list[AcquisitionError]:
        """Halt the robot now and end the loop. Returns what could not be stopped."""
        self._ending = STOPPED
        run = self._run
        unheard = [] if run is None else run.stop(by=by)
        self._end(STOPPED)
        return unheard

    def close(self) -> None:
        """End the loop because the service ends; the run manager pauses the current run."""
        self._end(SERVICE_ENDS)

    def _end(self, why: str) -> None:
        with self._changed:
            self._ending = self._ending or why
            self._changed.notify_all()
        self._worker.close()


@dataclass(frozen=True)
class LoopStatus:
    """Snapshot of a loop.

    A change makes another one, with the next `version`. `steps` are its steps, the last one in progress. `runs` are
    its runs; `run_id` is the current one. `problem` is the reason why it failed or rests. `outlook` is that of
    `Expected`.
    """

    id: str
    name: str
    created_utc: str
    simulated: bool
    state: State
    dry_run: bool = False
    version: int = 1
    reason: str = ""
    step: str = ""
    steps: tuple[str, ...] = ()
    run_id: str | None = None
    runs: tuple[str, ...] = ()
    dataset_id: str | None = None
    problem: dict[str, Any] | None = None
    outlook: dict[str, Any] | None = None

    def as_dict(self) -> dict[str, Any]:
        """Return the status as plain values, for JSON."""
        shown = asdict(self) | {"steps": list(self.steps), "runs": list(self.runs)}
        return shown | {"state": self.state.value, "state_code": self.state.code}
