"""Simulated versions of Python's modules of time, threads, sockets, names and databases.

They are given to our own packages only, by `install`, whenever one of them imports such a module. The packages
call the standard library's own interface, so that nothing in them knows of the simulation.
"""

from __future__ import annotations

import builtins
import concurrent.futures._base
import importlib.util
import os
import queue
import random
import secrets
import select
import socket
import sqlite3
import sys
import threading
import time
import uuid
from collections import deque
from collections.abc import Callable, Mapping
from types import ModuleType
from typing import Any

import filelock
import filelock._api

from tests.simulation.scheduler import Process, Scheduler, Task

PACKAGES = ("drivers", "acquisition", "calib", "fleet", "service", "mocks", "truepose")
_real_import = builtins.__import__


class Surroundings:
    """Scheduler, network and disk of the current simulation, on which the replaced modules act."""

    scheduler: Scheduler
    network: Any
    disk: Any


WORLD = Surroundings()


def _now() -> Scheduler:
    return WORLD.scheduler


def _me() -> Task:
    task = WORLD.scheduler.current
    assert task is not None
    return task


# -- threading -------------------------------------------------------------------------------------------------


class Lock:
    """A lock; waiting tasks are woken in the order in which the seed lets them run."""

    def __init__(self) -> None:
        self._holder: Task | None = None
        self._waiting: deque[Task] = deque()

    def acquire(self, blocking: bool = True, timeout: float = -1) -> bool:
        _now().pause()
        end = None if timeout < 0 else _now().now + timeout
        while self._holder is not None:
            if not blocking:
                return False
            left = None if end is None else end - _now().now
            if left is not None and left <= 0:
                return False
            self._waiting.append(_me())
            _now().park(left)
            if self._holder is not None and _me() in self._waiting:
                self._waiting.remove(_me())
        self._holder = _me()
        return True

    def release(self) -> None:
        if self._holder is None:
            raise RuntimeError("release unlocked lock")
        self._holder = None
        while self._waiting:
            _now().wake(self._waiting.popleft())
        _now().pause()

    def locked(self) -> bool:
        return self._holder is not None

    def __enter__(self) -> bool:
        return self.acquire()

    def __exit__(self, *_: object) -> None:
        self.release()


class RLock(Lock):
    """A lock that its holder may take again."""

    def __init__(self) -> None:
        super().__init__()
        self._count = 0

    def acquire(self, blocking: bool = True, timeout: float = -1) -> bool:
        if self._holder is not _me() and not super().acquire(blocking, timeout):
            return False
        self._count += 1
        return True

    def release(self) -> None:
        if self._holder is not _me():
            raise RuntimeError("cannot release un-acquired lock")
        self._count -= 1
        if not self._count:
            super().release()

    def _release_all(self) -> int:
        count, self._count = self._count, 0
        super().release()
        return count

    def _take_again(self, count: int) -> None:
        Lock.acquire(self)
        self._count = count


class Condition:
    """A condition variable on such a lock."""

    def __init__(self, lock: Lock | None = None) -> None:
        self._lock = RLock() if lock is None else lock
        self._waiting: deque[Task] = deque()
        self.acquire, self.release = self._lock.acquire, self._lock.release

    def __enter__(self) -> bool:
        return self._lock.acquire()

    def __exit__(self, *_: object) -> None:
        self._lock.release()

    def wait(self, timeout: float | None = None) -> bool:
        if self._lock._holder is not _me():
            raise RuntimeError("cannot wait on un-acquired lock")
        me = _me()
        self._waiting.append(me)
        count = self._lock._release_all() if isinstance(self._lock, RLock) else self._lock.release() or 0
        # A switch within the release may have let the notifier run already.
        woken = me not in self._waiting or _now().park(timeout)
        if me in self._waiting:
            self._waiting.remove(me)
        if isinstance(self._lock, RLock):
            self._lock._take_again(count)
        else:
            self._lock.acquire()
        return woken

    def wait_for(self, predicate: Callable[[], Any], timeout: float | None = None) -> Any:
        end = None if timeout is None else _now().now + timeout
        result = predicate()
        while not result:
            left = None if end is None else end - _now().now
            if left is not None and left <= 0:
                break
            self.wait(left)
            result = predicate()
        return result

    def notify(self, n: int = 1) -> None:
        if self._lock._holder is not _me():
            raise RuntimeError("cannot notify on un-acquired lock")
        for _ in range(min(n, len(self._waiting))):
            _now().wake(self._waiting.popleft())

    def notify_all(self) -> None:
        self.notify(len(self._waiting))


class SimulatedEvent:
    """A flag for which tasks wait."""

    def __init__(self) -> None:
        self._flag = False
        self._waiting: list[Task] = []

    def is_set(self) -> bool:
        _now().pause()
        return self._flag

    def set(self) -> None:
        self._flag = True
        waiting, self._waiting = self._waiting, []
        for task in waiting:
            _now().wake(task)
        _now().pause()

    def clear(self) -> None:
        self._flag = False

    def wait(self, timeout: float | None = None) -> bool:
        _now().pause()
        end = None if timeout is None else _now().now + timeout
        while not self._flag:
            left = None if end is None else end - _now().now
            if left is not None and left <= 0:
                break
            self._waiting.append(_me())
            _now().park(left)
            if _me() in self._waiting:
                self._waiting.remove(_me())
        return self._flag


class Semaphore:
    """A counter for which tasks wait."""

    def __init__(self, value: int = 1) -> None:
        self._value, self._changed = value, Condition(Lock())

    def acquire(self, blocking: bool = True, timeout: float | None = None) -> bool:
        with self._changed:
            if not self._changed.wait_for(lambda: self._value > 0, timeout if blocking else 0.0):
                return False
            self._value -= 1
            return True

    def release(self, n: int = 1) -> None:
        with self._changed:
            self._value += n
            self._changed.notify(n)

    __enter__ = acquire

    def __exit__(self, *_: object) -> None:
        self.release()


class Thread:
    """A thread, which is a task of the scheduler."""

    _count = 0

    def __init__(
        self,
        group: None = None,
        target: Callable[..., Any] | None = None,
        name: str | None = None,
        args: Any = (),
        kwargs: Mapping[str, Any] | None = None,
        *,
        daemon: bool | None = None,
    ) -> None:
        Thread._count += 1
        self.name, self.daemon = name or f"Thread-{Thread._count}", bool(daemon)
        self._target, self._args, self._kwargs = target, args, dict(kwargs or {})
        self.task: Task | None = None
        self._ended = SimulatedEvent()

    @property
    def ident(self) -> int | None:
        return None if self.task is None else self.task.number

    def run(self) -> None:
        if self._target is not None:
            self._target(*self._args, **self._kwargs)

    def start(self) -> None:
        def whole() -> None:
            try:
                self.run()
            except Exception as error:  # noqa: BLE001 - reported as threads report it
                WORLD.network.thread_died(self.name, error)
            finally:
                self._ended.set()

        self.task = _now().spawn(self.name, whole)
        self.task.local[0] = {"thread": self}
        _now().pause()

    def join(self, timeout: float | None = None) -> None:
        self._ended.wait(timeout)

    def is_alive(self) -> bool:
        return self.task is not None and not self._ended._flag


class Timer(Thread):
    """A thread that begins after a time, unless it is cancelled."""

    def __init__(
        self, interval: float, function: Callable[..., Any], args: Any = (), kwargs: Any = None
    ) -> None:
        super().__init__()
        self._interval, self._call, self.finished = interval, (function, args, kwargs or {}), SimulatedEvent()

    def cancel(self) -> None:
        self.finished.set()

    def run(self) -> None:
        function, args, kwargs = self._call
        if not self.finished.wait(self._interval):
            function(*args, **kwargs)
        self.finished.set()


class Local:
    """Attributes of which every task has its own."""

    def __getattribute__(self, name: str) -> Any:
        if name.startswith("__"):
            return object.__getattribute__(self, name)
        try:
            return _me().local[id(self)][name]
        except KeyError:
            raise AttributeError(name) from None

    def __setattr__(self, name: str, value: Any) -> None:
        _me().local.setdefault(id(self), {})[name] = value


def _current_thread() -> Thread:
    own = _me().local.setdefault(0, {})
    if "thread" not in own:  # the first task of a process
        own["thread"] = thread = Thread(name=_me().name)
        thread.task = _me()
    return own["thread"]


# -- the rest --------------------------------------------------------------------------------------------------


class ThreadPoolExecutor:
    """Threads that take calls in turn."""

    def __init__(self, max_workers: int | None = None, thread_name_prefix: str = "pool") -> None:
        self._most, self._name = max_workers or 4, thread_name_prefix
        self._calls: deque[Any] = deque()
        self._changed, self._threads, self._idle, self._over = Condition(), [], 0, False

    def submit(self, function: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Any:
        future = FUTURES.Future()
        with self._changed:
            if self._over:
                raise RuntimeError("cannot schedule new futures after shutdown")
            self._calls.append((future, function, args, kwargs))
            if self._idle < len(self._calls) and len(self._threads) < self._most:
                thread = Thread(target=self._work, name=f"{self._name}_{len(self._threads)}")
                self._threads.append(thread)
                thread.start()
            self._changed.notify()
        return future

    def _work(self) -> None:
        while True:
            with self._changed:
                self._idle += 1
                self._changed.wait_for(lambda: self._calls or self._over)
                self._idle -= 1
                if not self._calls:
                    return
                future, function, args, kwargs = self._calls.popleft()
            if future.set_running_or_notify_cancel():
                try:
                    future.set_result(function(*args, **kwargs))
                except BaseException as error:  # noqa: BLE001 - it belongs to whoever asks for the result
                    future.set_exception(error)

    def map(self, function: Callable[..., Any], *of: Any) -> Any:
        return iter(
            [future.result() for future in [self.submit(function, *each) for each in zip(*of, strict=False)]]
        )

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        with self._changed:
            self._over = True
            while cancel_futures and self._calls:
                self._calls.popleft()[0].cancel()
            self._changed.notify_all()
        for thread in self._threads if wait else ():
            thread.join()

    def __enter__(self) -> ThreadPoolExecutor:
        return self

    def __exit__(self, *_: object) -> None:
        self.shutdown()


def _bytes(n: int) -> bytes:
    return _now().random.randbytes(n)


class SimulatedConnection(sqlite3.Connection):
    """A database connection on the simulated disk, which may be full.

    Other tasks run between its orders.
    """

    held: tuple[Process, int] | None = None

    def execute(self, sql: str, *args: Any) -> sqlite3.Cursor:
        _now().pause()
        WORLD.disk.before(sql)
        return super().execute(sql, *args)

    def close(self) -> None:
        if self.held is not None:
            self.held[0].release(self.held[1])
        super().close()


def _connect(*args: Any, **kwargs: Any) -> sqlite3.Connection:
    connection: SimulatedConnection = sqlite3.connect(*args, factory=SimulatedConnection, **kwargs)
    process = _me().process
    connection.held = process, process.hold(lambda: sqlite3.Connection.close(connection))
    return connection


class FileLock(filelock.FileLock):  # type: ignore[misc]
    """A file lock, which ends with its process."""

    def _acquire(self) -> None:
        super()._acquire()
        if (fd := self._context.lock_file_fd) is not None:
            process = _me().process
            self._held = process, process.hold(lambda: os.close(fd))

    def _release(self) -> None:
        process, number = self._held
        process.release(number)
        super()._release()


def _like(real: ModuleType, **own: Any) -> ModuleType:
    """Return a module with the names of a real one, of which some are replaced."""
    module = ModuleType(real.__name__)
    module.__dict__.update({name: value for name, value in vars(real).items() if name != "__name__"} | own)
    return module


def _copy(real: ModuleType, shims: Mapping[str, ModuleType]) -> ModuleType:
    """Return a copy of a standard module, run from its source upon the replaced modules."""
    assert real.__file__ is not None
    spec = importlib.util.spec_from_file_location(f"simulated.{real.__name__}", real.__file__)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    module.__dict__["__builtins__"] = vars(builtins) | {"__import__": _importing(shims, always=True)}
    spec.loader.exec_module(module)
    return module


def _importing(shims: Mapping[str, ModuleType], *, always: bool = False) -> Callable[..., Any]:
    def imported(
        name: str, globals: Any = None, locals: Any = None, fromlist: Any = (), level: int = 0
    ) -> Any:
        if not level and (shim := shims.get(name)) is not None:
            asks = (globals or {}).get("__name__", "")
            if always or asks.partition(".")[0] in PACKAGES:
                return shim
        return _real_import(name, globals, locals, fromlist, level)

    return imported


THREADING = _like(
    threading,
    Lock=Lock,
    RLock=RLock,
    Condition=Condition,
    Event=SimulatedEvent,
    Semaphore=Semaphore,
    BoundedSemaphore=Semaphore,
    Thread=Thread,
    Timer=Timer,
    local=Local,
    current_thread=_current_thread,
    main_thread=lambda: None,
    get_ident=lambda: _me().number,
    get_native_id=lambda: _me().number,
)
TIME = _like(
    time,
    time=lambda: _now().time(),
    monotonic=lambda: _now().monotonic(),
    perf_counter=lambda: _now().monotonic(),
    sleep=lambda seconds: _now().sleep(seconds),
)
FUTURES = _copy(concurrent.futures._base, {"threading": THREADING, "time": TIME})
POOLS = _like(
    concurrent.futures,
    ThreadPoolExecutor=ThreadPoolExecutor,
    Future=FUTURES.Future,
    wait=FUTURES.wait,
    as_completed=FUTURES.as_completed,
    TimeoutError=TimeoutError,
    CancelledError=FUTURES.CancelledError,
)
QUEUE = _copy(queue, {"threading": THREADING, "time": TIME})
QUEUE.SimpleQueue = QUEUE._PySimpleQueue  # type: ignore[attr-defined]  # that of C would block the thread
SECRETS = _like(
    secrets,
    token_hex=lambda n=32: _bytes(n).hex(),
    token_bytes=lambda n=32: _bytes(n),
    token_urlsafe=lambda n=32: _bytes(n).hex(),
    randbelow=lambda n: _now().random.randrange(n),
)
UUID = _like(uuid, uuid4=lambda: uuid.UUID(bytes=_bytes(16), version=4))
RANDOM = _like(
    random, random=lambda: _now().random.random(), uniform=lambda a, b: _now().random.uniform(a, b)
)
SQLITE = _like(sqlite3, connect=_connect)
SOCKET = _like(
    socket,
    create_connection=lambda address, timeout=None, **_: WORLD.network.connect(address, timeout),
    socket=lambda *args: WORLD.network.socket(*args),
    getaddrinfo=lambda host, port, **_: [(socket.AF_INET, socket.SOCK_STREAM, 6, "", ("127.0.0.1", port))],
)
SELECT = _like(select, select=lambda r, w, x, seconds=None: WORLD.network.select(r, w, seconds))

SHIMS: dict[str, ModuleType] = {
    "threading": THREADING,
    "time": TIME,
    "concurrent.futures": POOLS,
    "queue": QUEUE,
    "secrets": SECRETS,
    "uuid": UUID,
    "random": RANDOM,
    "sqlite3": SQLITE,
    "socket": SOCKET,
    "select": SELECT,
}


def install() -> None:
    """Replace the modules for our packages, none of which may have been imported yet.

    Raises
    ------
    RuntimeError
        One of the packages was imported before.
    """
    if early := [name for name in sys.modules if name.partition(".")[0] in PACKAGES]:
        raise RuntimeError(f"{early[0]} was imported before the simulation was installed")
    builtins.__import__ = _importing(SHIMS)
    filelock.FileLock = FileLock  # type: ignore[misc, assignment]
    filelock._api.time = TIME  # type: ignore[assignment]
