"""The service in the simulation: the real application, called as a web server calls it."""

from __future__ import annotations

import asyncio
import json
import sqlite3
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import anyio
import anyio.to_thread

import service.ids
from acquisition import Cell
from service.http.access.roles import ServiceSettings, Tokens
from service.http.app import create_app
from service.http.work import workers
from tests.simulation import modules
from tests.simulation.scheduler import Process, Scheduler
from tests.simulation.wires import Policy

asyncio.set_event_loop_policy(Policy(lambda: modules.WORLD.network))


PREFIX = "/api/v1"
TOKENS = Tokens("only-for-the-tests-of-simulation", "only-looks-at-the-tests-of-simulation")
ANSWERED_S = 120.0  # longest time for an answer; a request may wait for a device, whose deadlines are below


class Notes(Protocol):
    """Part of a history that notes each event that must never happen."""

    scheduler: Scheduler

    def find(self, text: str) -> None: ...


# -- what the application takes from the system -----------------------------------------------------------------


async def _in_thread(
    function: Callable[..., Any], *args: Any, abandon_on_cancel: bool = False, limiter: Any = None, **_: Any
) -> Any:
    """Call a function in a task, as `anyio.to_thread.run_sync` does in a thread."""
    loop = asyncio.get_running_loop()
    limiter = limiter or anyio.to_thread.current_default_thread_limiter()
    future = loop.create_future()

    def finish(result: Any, error: BaseException | None) -> None:
        if not future.done():
            future.set_exception(error) if error is not None else future.set_result(result)

    def work() -> None:
        result, failed = None, None
        try:
            result = function(*args)
        except BaseException as error:  # noqa: BLE001 - it belongs to the caller
            failed = error
        if not loop.is_closed():
            loop.call_soon_threadsafe(finish, result, failed)

    async with limiter:
        modules.WORLD.scheduler.spawn("handler", work)
        if abandon_on_cancel:
            return await future
        with anyio.CancelScope(shield=True):
            return await future


anyio.to_thread.run_sync = _in_thread


class Worker:
    """A worker process, whose computations take a time that the seed draws."""

    def __init__(self) -> None:
        self.alive, self._killed = True, None

    def do(self, function: Callable[..., Any], args: tuple[Any, ...], _: float) -> Any:
        scheduler = modules.WORLD.scheduler
        scheduler.sleep(scheduler.random.uniform(0.01, 2.0))
        if self._killed is not None:
            raise self._killed
        return function(*args)

    def kill(self, why: Any) -> None:
        self._killed, self.alive = why, False

    def end(self) -> None:
        self.alive = False


workers._Worker = Worker  # type: ignore[misc, assignment]


class _Datetime(service.ids.datetime):
    @classmethod
    def now(cls, tz: Any = None) -> Any:
        return cls.fromtimestamp(modules.WORLD.scheduler.time(), tz)


service.ids.datetime = _Datetime  # type: ignore[misc]


class SimulatedDisk:
    """The disk, which may be full or slow."""

    full = False
    slow_s = 0.0  # longest time of an order

    def before(self, sql: str) -> None:
        if self.full and sql.startswith(("COMMIT", "BEGIN")):
            raise sqlite3.OperationalError("database or disk is full")
        scheduler = modules.WORLD.scheduler
        if self.slow_s and scheduler.current is not None and sql.startswith(("COMMIT", "BEGIN")):
            scheduler.sleep(scheduler.random.uniform(0.0, self.slow_s))


# -- a service and its clients ----------------------------------------------------------------------------------


@dataclass
class HttpAnswer:
    """Answer of the service. `status` 0: none came."""

    status: int = 0
    body: Any = None


_APPS: dict[
    Path, tuple[Any, ServiceSettings]
] = {}  # describing 90 operations takes longer than a whole history


def _application(record: Path, cell: Cell) -> Any:
    if record not in _APPS:
        settings = ServiceSettings(record=record, tokens=TOKENS, cell=cell)
        _APPS[record] = create_app(settings), settings
    app, settings = _APPS[record]
    object.__setattr__(settings, "cell", cell)
    app.middleware_stack = None  # its locks belong to the loop of an earlier process
    return app


class Program:
    """A service process that can be ended or killed, and started again on the same record."""

    def __init__(self, notes: Notes, name: str, record: Path, cell: Cell) -> None:
        self._notes, self.name, self.record, self._cell = notes, name, record, cell
        self.process = Process(name)
        self.process.alive = False
        self.ending = False
        self._app: Any = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._over: asyncio.Event | None = None

    @property
    def alive(self) -> bool:
        return self.process.alive

    @property
    def service(self) -> Any:
        return self._app.state.service

    def start(self) -> None:
        """Start it, and wait until it answers."""
        process = self.process = Process(self.name)
        self.ending = False
        ready = modules.SimulatedEvent()
        app = self._app = _application(self.record, self._cell)

        async def main() -> None:
            async with app.router.lifespan_context(app):
                self._loop, self._over = asyncio.get_running_loop(), asyncio.Event()
                ready.set()
                await self._over.wait()

        def work() -> None:
            try:
                asyncio.run(main())
            except Exception as error:  # noqa: BLE001 - the service does not start, which is a finding
                self._notes.find(f"{self.name} ended: {type(error).__name__}: {error}")
            finally:
                self._join(process)
                process.alive = False
                ready.set()

        self._notes.scheduler.spawn(self.name, work, process)
        while not ready.wait(1.0) and process.alive:
            pass

    def _join(self, process: Process) -> None:
        """Wait for the threads of a process that ends, as the interpreter does."""
        scheduler = self._notes.scheduler
        end = scheduler.now + ANSWERED_S
        while others := [each for each in scheduler.tasks.values() if each.process is process][1:]:
            if scheduler.now > end:
                self._notes.find(f"threads are left: {', '.join(each.name for each in others)}")
                return
            scheduler.sleep(0.5)

    def end(self) -> None:
        """End it as SIGTERM does, and wait for its end."""
        process, over = self.process, self._over
        if not process.alive or self.ending or over is None:
            return
        assert self._loop is not None
        self.ending = True
        self._loop.call_soon_threadsafe(over.set)
        while process.alive:
            self._notes.scheduler.sleep(0.1)

    def kill(self) -> None:
        """End the process as `kill -9` does."""
        self._notes.scheduler.kill(self.process)

    def ask(self, method: str, path: str, body: Any = None, **headers: str) -> HttpAnswer:
        """Send a request and wait for the answer; none comes if the service dies."""
        scheduler, process, loop = self._notes.scheduler, self.process, self._loop
        if not process.alive or self.ending or loop is None:
            return HttpAnswer()
        path, _, query = path.partition("?")
        content = b"" if body is None else json.dumps(body).encode()
        sent = {
            "host": "127.0.0.1",
            "authorization": f"Bearer {TOKENS.operator}",
            "content-type": "application/json",
            "content-length": str(len(content)),
        } | {name.replace("_", "-").lower(): value for name, value in headers.items() if value}
        scope = {
            "type": "http",
            "asgi": {"version": "3.0"},
            "http_version": "1.1",
            "method": method,
            "scheme": "http",
            "path": PREFIX + path,
            "raw_path": (PREFIX + path).encode(),
            "query_string": query.encode(),
            "root_path": "",
            "headers": [(name.encode(), value.encode()) for name, value in sent.items()],
            "client": ("127.0.0.1", 5),
            "server": ("127.0.0.1", 80),
            "state": {},
        }
        done, answer, parts, given = modules.SimulatedEvent(), HttpAnswer(), list[bytes](), list[bool]()

        async def receive() -> Any:
            if given:
                await asyncio.Event().wait()
            given.append(True)
            return {"type": "http.request", "body": content, "more_body": False}

        async def send(message: Any) -> None:
            if message["type"] == "http.response.start":
                answer.status = message["status"]
            else:
                parts.append(message.get("body", b""))

        async def call() -> None:
            try:
                await self._app(scope, receive, send)
            except Exception as error:  # noqa: BLE001 - the service has failed, which is a finding
                self._notes.find(f"{method} {path}: {type(error).__name__}: {error}")
            finally:
                done.set()

        tasks: list[Any] = []  # asyncio itself holds no reference
        with suppress(RuntimeError):  # the loop has ended meanwhile
            loop.call_soon_threadsafe(lambda: tasks.append(loop.create_task(call())))
        end = scheduler.now + ANSWERED_S
        while not done.wait(0.5):
            if not process.alive:
                return HttpAnswer()
            if scheduler.now > end and not self.ending:
                self._notes.find(f"{method} {path} was not answered within {ANSWERED_S:g} s")
                return HttpAnswer()
        if answer.status:
            answer.body = json.loads(b"".join(parts) or b"null")
        if answer.status == 500:
            self._notes.find(f"{method} {path}: {answer.body}")
        return answer
