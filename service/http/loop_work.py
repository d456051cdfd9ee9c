"""A closed loop that goes on: what it has come to, and the orders that it obeys between and within its runs.

It lives in one thread, which has the robot until it ends (`Book.lend`). Fits are made in that thread, other than
those of a job: while the loop computes its robot stands, and nothing else may move it.

While it is paused it keeps what it knows and its clock, and goes on where it was. It does not outlive the service:
the runs do, the loop is begun anew.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from acquisition import Campaign, Cell, Devices, Event, Lease, Outcome, Run, ScaledClock, State
from acquisition.control import ON_REQUEST
from acquisition.individuals import Acceptance
from acquisition.loop import Equipment, LoopEnded, LoopResult, close_loop
from calib.errors import DataError
from calib.files import replace_file
from drivers.errors import AcquisitionError
from service.files import as_json
from service.http import problems
from service.http.book import SERVICE_ENDS, Book
from service.http.problems import Problem

ABOUT = "loop.json"
FAULT = "A fault of this program has ended the loop; its runs are kept."
STOPPED = "Stopped on request."


class LoopWork:
    """Thread-safe, but for `__call__`. `done`: what to do with the result; its members are added to the document."""

    def __init__(
        self,
        folder: Path,
        document: Mapping[str, Any],
        book: Book,
        cell: Cell,
        devices: Devices,
        lease: Lease,
        done: Callable[[LoopResult], Mapping[str, Any]],
    ) -> None:
        self._folder, self._book, self._lease, self._done = folder, book, lease, done
        self._changed = threading.Condition()  # never held while a run is asked or told anything
        self._document = dict(document)
        self._run: Run | None = None
        self._pausing = ""  # why
        self._ending = ""
        self._accepted: Acceptance | None = None  # by whoever resumed it last
        self._simulated = bool(document["simulated"])
        self._equipment = Equipment(
            cell,
            devices,
            ScaledClock(cell.time_scale if self._simulated else 1.0),
            self._simulated,
            listen=self._listen,
            lease=lambda: self._lease,
            create=self._create,
            resumed=self._resumed,
        )
        self._tell()

    # -- in the thread of the loop ------------------------------------------------------------------------

    def __call__(self, campaign: Campaign, poses: int) -> None:
        """Run the whole loop; its end stands in the document."""
        end: dict[str, Any] = {"state": State.FAILED, "reason": FAULT}
        try:
            result = close_loop(self._equipment, campaign, self._folder, poses=poses, say=self._say)
            end = {"state": State.SUCCEEDED, "reason": "", **self._done(result)}
        except LoopEnded as ended:
            stopped = ended.outcome.state is State.STOPPED
            end |= {"state": State.STOPPED if stopped else State.FAILED, "reason": str(ended)}
        except (AcquisitionError, DataError) as error:
            told = problems.of_error(error)
            end |= {"reason": told["detail"], "problem": told}
        finally:
            if (
                self._ending == STOPPED and end["state"] is State.FAILED
            ):  # stopped before it had begun to move
                end = {"state": State.STOPPED, "reason": STOPPED}
            self._tell(run_id=None, **end)

    def _say(self, step: str) -> None:
        self._checkpoint()
        self._tell(step=step, steps=[*self._document["steps"], step])

    def _checkpoint(self) -> None:
        """Where nothing moves: wait while paused. Raises LoopEnded when the loop is to end."""
        if self._pausing and not self._ending:
            self._rest(self._pausing)
        if self._ending:
            raise LoopEnded(Outcome(State.STOPPED if self._ending == STOPPED else State.PAUSED, self._ending))

    def _rest(self, reason: str) -> str | None:
        """Wait for somebody to say go on: who it was; None when the loop is to end."""
        with self._changed:
            self._pausing = self._pausing or reason
            self._tell(state=State.PAUSED, reason=reason)
            self._changed.wait_for(lambda: self._ending or not self._pausing)
            if self._ending:
                return None
            self._tell(state=State.RUNNING, reason="")
            return self._lease.owner

    def _resumed(self, run: Run, outcome: Outcome) -> bool:
        self._book.not_begun()
        by = self._rest(outcome.reason)
        if by is not None:
            run.resume(by=by, accepted=self._accepted)
        return by is not None

    @contextmanager
    def _create(self, record: Path, cell: Cell, campaign: Campaign, simulated: bool) -> Iterator[Run]:
        self._checkpoint()
        name = f"{self._document['id']}-{record.name.replace('_', '-')}"
        title = f"{self._document['name']}, {record.name.replace('_', ' ')}"
        with self._book.run_of_loop(name, title, cell, campaign) as run:
            self._run = run
            self._tell(run_id=name, runs=[*self._document["runs"], name])
            try:
                self._checkpoint()  # an order that came meanwhile has seen no run
                yield run
            finally:
                self._run = None
                self._tell(run_id=None)

    def _listen(self, run: Run) -> Callable[[Event], None]:
        def hear(_: Event) -> None:
            self._book.begun()
            with self._changed:
                self._document["version"] += 1
                self._changed.notify_all()

        return hear

    def _tell(self, **changes: Any) -> None:
        with self._changed:
            state = changes.get("state")
            if state is not None:
                changes |= {"state": state.value, "state_code": state.code}
            self._document |= {**changes, "version": self._document["version"] + 1}
            replace_file(self._folder / ABOUT, as_json(self._document))
            self._changed.notify_all()

    # -- from any thread ----------------------------------------------------------------------------------

    @property
    def document(self) -> dict[str, Any]:
        with self._changed:
            return dict(self._document)

    def wait(self, after: int, seconds: float) -> int:
        """The version, waiting up to so many seconds for one beyond `after`."""
        with self._changed:
            self._changed.wait_for(lambda: self._document["version"] > after, seconds)
            return self._document["version"]

    def pause(self, by: str, reason: str = ON_REQUEST) -> None:
        """Rest after the reading in hand, or after the step in hand where nothing moves."""
        with self._changed:
            self._pausing = self._pausing or reason
            resting = self._document["state"] == State.PAUSED.value
        if not resting:
            self._book.pause_all(by, reason)

    def resume(self, lease: Lease, accepted: Acceptance | None = None) -> None:
        """Go on, by leave of whoever has the lease. Raises Problem 409 where the loop is not paused.

        accepted: another robot or instrument than that of the loop's first campaign.
        """
        with self._changed:
            if self._document["state"] != State.PAUSED.value:
                raise Problem(
                    409,
                    f"The loop is {self._document['state']}; only a paused one can be resumed.",
                    "Look at its state; begin a new loop where it has ended.",
                    code=3104,
                )
            self._lease, self._accepted, self._pausing = lease, accepted, ""
            self._changed.notify_all()

    def stop(self, by: str) -> list[AcquisitionError]:
        """Halt the robot now and end the loop. Returns what could not be stopped."""
        self._ending = STOPPED
        run = self._run
        told = [] if run is None else run.stop(by=by)
        self._end(STOPPED)
        return told

    def close(self) -> None:
        """The service ends, and the loop with it; the run in hand is paused by the book."""
        self._end(SERVICE_ENDS)

    def _end(self, why: str) -> None:
        with self._changed:
            self._ending = self._ending or why
            self._changed.notify_all()
