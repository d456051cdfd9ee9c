"""Worker processes for long computations, which must not delay the stop of a robot.

Planning, dry runs, checks of uploads, exports, corrections and fits are pure computations of seconds to
minutes. In threads of this process they would share one interpreter lock with the orders to the robot.
"""

from __future__ import annotations

import os
import pickle
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, TypeVar, TypeVarTuple

from service.child import python
from service.http.wire.problems import Problem

MOST_S = 900.0  # of one call
_T = TypeVar("_T")
_Ts = TypeVarTuple("_Ts")


class WorkerDied(RuntimeError):
    """A worker ended during a call, by a fault of this program or by a person."""


class Workers:
    """A pool of at most `most` processes, started on demand and kept. Thread-safe.

    At most `waiting` calls may wait for a free process; more are refused. A call may take at most `most_s`.
    """

    def __init__(self, most: int, *, waiting: int, most_s: float = MOST_S) -> None:
        self._most, self._most_waiting, self._most_s = most, waiting, most_s
        self._changed = threading.Condition()
        self._idle: list[_Worker] = []
        self._busy: set[_Worker] = set()
        self._waiting = 0
        self._closed = False

    def call(self, function: Callable[[*_Ts], _T], *args: *_Ts) -> _T:
        """Call a function of a module in a worker and return its result. Blocks.

        Raises
        ------
        DataError, AcquisitionError
            The function raised it.
        Problem
            503: too many calls wait, the time is over or the service ends.
        WorkerDied
            The worker ended during the call.
        """
        with self._hired() as worker:
            return worker.do(function, args, self._most_s)

    @contextmanager
    def _hired(self) -> Iterator[_Worker]:
        worker = self._hire()
        try:
            yield worker
        finally:
            with self._changed:
                self._busy.discard(worker)
                if worker.alive and not self._closed:
                    self._idle.append(worker)
                else:
                    worker.end()
                self._changed.notify_all()

    def _hire(self) -> _Worker:
        with self._changed:
            if len(self._busy) >= self._most and self._waiting >= self._most_waiting:
                raise Problem(
                    503,
                    "Too much is being computed already; this was not begun.",
                    "Ask again in a while.",
                    code=8120,
                    headers={"Retry-After": "5"},
                )
            self._waiting += 1
            try:
                self._changed.wait_for(lambda: self._closed or len(self._busy) < self._most)
            finally:
                self._waiting -= 1
            if self._closed:
                raise ending()
            worker = self._idle.pop() if self._idle else _Worker()
            self._busy.add(worker)
            return worker

    def close(self) -> None:
        """End every worker now; calls under way are refused."""
        with self._changed:
            self._closed = True
            for worker in self._busy:
                worker.kill(ending())  # closed by the thread that uses it
            for worker in self._idle:
                worker.end()
            self._idle.clear()
            self._changed.notify_all()


class _Worker:
    """One process and the conversation with it."""

    def __init__(self) -> None:
        # One thread of the linear algebra library: see service.cli.
        threads = {name: os.environ.get(name, "1") for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS")}
        self._process = subprocess.Popen(
            python("service.worker"),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env=os.environ | threads,
            process_group=0,  # Ctrl-C at the terminal is for the service; a separate session would have its own share
        )
        self._killed: Problem | None = None  # why

    @property
    def alive(self) -> bool:
        return self._process.poll() is None

    def do(self, function: Callable[..., _T], args: tuple[Any, ...], most_s: float) -> _T:
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        late = Problem(503, f"This took longer than {most_s:g} s.", "Ask for less at once.", code=8121)
        began_s, end, done = self._computed_s(), time.monotonic() + MOST_S, threading.Event()

        def watch() -> None:
            """Limit the call by the processor time of the process.

            On a busy computer, the call is not to blame for waiting its turn.
            """
            left = most_s
            while left > 0.0 and (until_end_s := end - time.monotonic()) > 0.0:
                if done.wait(max(min(left, until_end_s), 0.1)):
                    return
                computed = self._computed_s()
                left = 0.0 if computed is None or began_s is None else most_s - (computed - began_s)
            self.kill(late)

        threading.Thread(target=watch, daemon=True).start()
        try:
            self._process.stdin.write(pickle.dumps((function, args)))
            self._process.stdin.flush()
            result, refusal = pickle.load(self._process.stdout)
        except (EOFError, pickle.UnpicklingError, OSError) as error:  # it ended, perhaps in mid-answer
            self._process.kill()
            self._process.wait()
            raise self._killed or WorkerDied("a worker process ended in mid-call") from error
        finally:
            done.set()
        if refusal is not None:
            raise refusal
        return result

    def _computed_s(self) -> float | None:
        """Return the processor time of the process so far, s; None if the system does not report it."""
        try:
            fields = Path(f"/proc/{self._process.pid}/stat").read_text("utf-8").rpartition(")")[2].split()
            return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
        except (OSError, ValueError, IndexError, AttributeError):
            return None

    def kill(self, why: Problem) -> None:
        """End the process, from any thread; a call under way is refused with `why`."""
        self._killed = why
        self._process.kill()

    def end(self) -> None:
        self._process.kill()
        self._process.wait()
        for stream in (self._process.stdin, self._process.stdout):
            assert stream is not None
            with suppress(OSError):  # what it did not receive any more
                stream.close()


def ending() -> Problem:
    """Return the problem of requests that arrive while the service ends."""
    return Problem(503, "The service is being ended.", "Ask again when it runs again.", code=8122)
