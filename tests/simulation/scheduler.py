"""Scheduler of a simulation: tasks on one thread, whose turns and whose time a seed decides.

A task is a greenlet. It runs until it waits, or until a switch that the seed draws. Switches are possible where real
threads can be interleaved: at a lock, an event, a socket or a transaction. Time passes only when every task waits; then
it steps to the next instant for which one waits. Every run of a seed is therefore the same.
"""

from __future__ import annotations

import asyncio
import heapq
import itertools
import sys
from collections.abc import Callable
from random import Random
from typing import Any

from greenlet import greenlet

TICK_S = 1e-6  # by which a look at the clock advances it, so that no task polls for ever in one instant


class Stuck(RuntimeError):
    """Every task waits, and none for an instant: a deadlock."""


class Overrun(RuntimeError):
    """More turns than any history needs: tasks keep each other going for ever."""


class Process:
    """A program in the simulation: its tasks, and the resources that a kill would free."""

    def __init__(self, name: str) -> None:
        self.name, self.alive = name, True
        self.closers: dict[int, Callable[[], object]] = {}  # of open sockets, databases and locks
        self._numbers = itertools.count(1)

    def hold(self, close: Callable[[], object]) -> int:
        """Register what a kill closes; the number is for `release`."""
        number = next(self._numbers)
        self.closers[number] = close
        return number

    def release(self, number: int) -> None:
        self.closers.pop(number, None)


class Task:
    """A thread of the simulation."""

    def __init__(
        self, number: int, name: str, process: Process, work: Callable[[], object], hub: greenlet
    ) -> None:
        self.number, self.name, self.process = number, name, process
        self.greenlet = greenlet(work, hub)
        self.done = self.parked = self.woken = False
        self.waits = 0  # number of the current wait, so that a timer of an earlier one wakes nobody
        self.local: dict[int, dict[str, Any]] = {}  # attributes of `threading.local` objects


class Scheduler:
    """The tasks and the time of one simulation.

    Parameters
    ----------
    seed
        Draws every choice.
    switches
        Probability of a switch to another task at a point where threads can be interleaved.
    """

    def __init__(self, seed: int, switches: float = 0.1) -> None:
        self.random = Random(seed)
        self._turns = Random(f"turns {seed}")
        self.switches = switches
        self.now, self.utc_offset = 0.0, 1.8e9
        self.log: list[str] = []
        self.switched = 0
        self.most_turns = 3_000_000
        self._hub = greenlet.getcurrent()
        self._ready: list[Task] = []
        self._timers: list[tuple[float, int, Callable[[], object]]] = []
        self._numbers = itertools.count(1)
        self.tasks: dict[int, Task] = {}
        self.harness = Process("harness")
        self.current: Task | None = None
        self._raised: BaseException | None = None

    # -- tasks ---------------------------------------------------------------------------------------------

    def note(self, text: str) -> None:
        """Write a line into the log of events."""
        name = self.current.name if self.current else "-"
        self.log.append(f"{self.now:12.6f} {name}: {text}")

    def spawn(self, name: str, work: Callable[[], object], process: Process | None = None) -> Task:
        """Create a task, which is ready to run; by default of the process of the current one."""
        if process is None:
            process = self.current.process if self.current else self.harness
        number = next(self._numbers)

        def whole() -> None:
            try:
                work()
            except BaseException as error:  # noqa: BLE001 - a failure of the harness ends the simulation
                self._raised = self._raised or error
            finally:
                task.done = True
                self.tasks.pop(number, None)

        task = Task(number, name, process, whole, self._hub)
        self.tasks[number] = task
        self._ready.append(task)
        return task

    def run(self, work: Callable[[], object]) -> None:
        """Run until `work`, in the first task, has ended.

        Raises
        ------
        Stuck
            All tasks wait for each other.
        Overrun
            It took too many turns.
        """
        first = self.spawn("main", work, self.harness)
        while not first.done:
            if self._raised is not None:
                break
            if self._ready:
                self._turn(self._pick())
            elif self._timers:
                at, _, wake = heapq.heappop(self._timers)
                self.now = max(self.now, at)
                wake()
            else:
                waiting = ", ".join(f"{each.process.name}/{each.name}" for each in self.tasks.values())
                raise Stuck(f"nothing can go on at {self.now:.3f} s: {waiting}")
        if self._raised is not None:
            raise self._raised

    def _pick(self) -> Task:
        at = 0 if len(self._ready) == 1 else self._turns.randrange(len(self._ready))
        ready = self._ready
        ready[at], ready[-1] = ready[-1], ready[at]
        return ready.pop()

    def _turn(self, task: Task) -> None:
        if task.done or not task.process.alive:
            return
        self.switched += 1
        if self.switched > self.most_turns:
            raise Overrun(f"more than {self.most_turns} turns, {self.now:.3f} s")
        self.current = task
        task.greenlet.switch()
        self.current = None

    def _leave(self) -> None:
        """Give the turn back to the hub; the running loop and hooks return with the task."""
        task = self.current
        assert task is not None, "only a task can wait"
        loop = asyncio._get_running_loop()
        if loop is None:
            self._hub.switch()
            return
        hooks = sys.get_asyncgen_hooks()
        asyncio._set_running_loop(None)
        self._hub.switch()
        asyncio._set_running_loop(loop)
        sys.set_asyncgen_hooks(*hooks)

    # -- waiting -------------------------------------------------------------------------------------------

    def at(self, when: float, wake: Callable[[], object]) -> None:
        """Call `wake` in the hub when the time has come; it must not wait."""
        heapq.heappush(self._timers, (when, next(self._numbers), wake))

    def park(self, seconds: float | None = None) -> bool:
        """Let the current task wait until `wake` or a timeout; return whether it was woken."""
        task = self.current
        assert task is not None, "only a task can wait"
        task.waits += 1
        task.parked, task.woken = True, False
        if seconds is not None:
            wait = task.waits

            def late() -> None:
                if task.parked and task.waits == wait:
                    task.parked = False
                    self._ready.append(task)

            self.at(self.now + max(seconds, 0.0), late)
        self._leave()
        return task.woken

    def wake(self, task: Task) -> None:
        """Let a task that waits run again."""
        if task.parked:
            task.parked, task.woken = False, True
            self._ready.append(task)

    def pause(self) -> None:
        """Let others run now, if the seed says so."""
        if self.current is not None and self._ready and self._turns.random() < self.switches:
            self._ready.append(self.current)
            self._leave()

    def sleep(self, seconds: float) -> None:
        """Let the current task wait for a time."""
        self.park(max(seconds, 0.0))

    def monotonic(self) -> float:
        """Return the time, s."""
        self.now += TICK_S
        return self.now

    def time(self) -> float:
        """Return the calendar time, s since 1970."""
        return self.monotonic() + self.utc_offset

    # -- processes -----------------------------------------------------------------------------------------

    def kill(self, process: Process) -> None:
        """End a process as `kill -9` does: none of its tasks runs again, not even to clean up."""
        process.alive = False
        for number, task in list(self.tasks.items()):
            if task.process is process:
                del self.tasks[number]
                GRAVEYARD.append(task)
        for close in list(process.closers.values()):
            close()
        process.closers.clear()


GRAVEYARD: list[object] = []
"""Tasks that were killed. If Python collected them, it would run their `finally` blocks."""
