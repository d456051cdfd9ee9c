"""Urgent requests on a full service: robot orders, lease, status, answers, health.

They never wait, while all other requests may. The threads are held by events, not by time. These would catch a stop
that shares the threads of ordinary requests, or of clients that wait. That holds for every part of its way: the service
object, the order itself, the refusal of a wrong one. They would also catch a burst of requests that are all served
before it.
"""

from __future__ import annotations

import asyncio
import re
import threading
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, cast

import anyio.to_thread
import httpx2
import pytest
from starlette.types import Message, Receive, Scope, Send

from acquisition import Cell, Devices, ExecutionOutcome, Run, State
from service.http.access.lanes import AT_ONCE, ORDINARY, UPLOADS, RequestLanes
from service.http.access.roles import ServiceSettings, Tokens
from service.http.app import create_app
from service.http.runs import run_manager
from service.http.state import ORDERS, Service
from service.http.wire.paths import PREFIX
from service.http.work.campaigns import CampaignStore
from service.http.work.workers import Workers
from service.simulated_cell import SimulatedDevices
from tests.acquisition.fakes import CAMPAIGN, Bench, FakeMeter, a_cell
from tests.drivers.waiting import PATIENCE_S
from tests.service.slow_arm import SlowArm

TOKENS = Tokens("only-for-the-tests-of-truepose", "only-looks-at-the-tests-of-truepose")


@dataclass
class Held:
    """A service in this loop, whose ordinary and waiting threads can all be held."""

    client: httpx2.AsyncClient
    service: Service
    arm: SlowArm
    released: threading.Event
    requests: list[asyncio.Task[httpx2.Response]] = field(default_factory=list)

    async def hold(self) -> None:
        """Ordinary requests and streams of events, more of both than there are threads."""
        ordinary = anyio.to_thread.current_default_thread_limiter()
        waiters = self.service._waiters
        for limiter, path in ((ordinary, "/campaigns/held"), (waiters, "/runs/held-{}/events")):
            more = int(limiter.total_tokens) + 5
            self.requests += [asyncio.create_task(self.client.get(path.format(i))) for i in range(more)]
        async with asyncio.timeout(PATIENCE_S):
            while ordinary.available_tokens or waiters.available_tokens:
                await asyncio.sleep(0.01)

    async def until(self, path: str, member: str, wanted: Callable[[Any], bool]) -> Any:
        """Poll a document until one of its members satisfies a condition, and return that member."""
        async with asyncio.timeout(PATIENCE_S):
            while not wanted(found := (await self.client.get(path)).json()[member]):
                await asyncio.sleep(0.01)
        return found


def in_held_service(
    folder: Path, monkeypatch: pytest.MonkeyPatch, scene: Callable[[Held], Awaitable[None]]
) -> None:
    """Play a scene on a held service.

    In its cell, the arm moves until it is stopped, and one SMR is seated by hand.
    """
    bench = Bench(a_cell(instrument__one_smr=True))
    arm, released = SlowArm(bench), threading.Event()

    class Fakes:
        def open(self, cell: Cell) -> Devices:
            return Devices(arm, FakeMeter(bench))

    def held_campaign(shelf: CampaignStore, name: str) -> dict[str, Any]:
        released.wait()
        return {}

    async def play() -> None:
        settings = ServiceSettings(folder, TOKENS, cell=bench.cell, simulated=cast(SimulatedDevices, Fakes()))
        app = create_app(settings)
        async with app.router.lifespan_context(app):
            service: Service = app.state.service
            opened = service.book.get
            monkeypatch.setattr(
                service.book, "get", lambda name: released.wait() if "held" in name else opened(name)
            )
            transport = httpx2.ASGITransport(app)
            headers = {"Authorization": f"Bearer {TOKENS.operator}"}
            base = f"http://127.0.0.1{PREFIX}"
            async with httpx2.AsyncClient(transport=transport, base_url=base, headers=headers) as client:
                held = Held(client, service, arm, released)
                try:
                    await scene(held)
                finally:
                    released.set()
                    arm.halted.set()
                    await asyncio.gather(*held.requests, return_exceptions=True)

    monkeypatch.setattr(CampaignStore, "get", held_campaign)
    monkeypatch.setattr(Workers, "call", lambda self, function, *args: function(*args))
    asyncio.run(play())


async def a_run(held: Held) -> str:
    """Begun, up to its first question."""
    lease = await held.client.post("/cell/lease", json={"holder": "anna", "seconds": 300.0})
    assert lease.status_code == 200
    held.client.headers["Lease-Id"] = lease.json()["lease_id"]
    answer = await held.client.post("/runs", json={"campaign": CAMPAIGN, "dry_run": False})
    assert answer.status_code == 202, answer.text
    run = f"/runs/{answer.json()['id']}"
    await held.until(run, "prompt", bool)
    return run


def test_what_is_urgent_is_served_while_every_other_thread_is_held(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def scene(held: Held) -> None:
        client, run = held.client, await a_run(held)
        await held.hold()
        async with asyncio.timeout(PATIENCE_S):
            assert (await client.get("/health")).status_code == 200
            assert (await client.get("/cell")).json()["run_id"] == run.rpartition("/")[2]
            renewed = await client.post("/cell/lease", json={"holder": "anna", "seconds": 60.0})
            assert renewed.json()["seconds"] == 60.0
            wrong = {"holder": "anna", "seconds": 0.0}
            assert (await client.post("/cell/lease", json=wrong)).status_code == 422
            assert (await client.post("/cell/lease", json={"holder": "bert"})).status_code == 409
            while not held.arm.moving.is_set():  # every question up to the first move
                (prompt,) = (await client.get(f"{run}/prompts")).json()["prompts"] or (None,)
                if prompt is not None:
                    key = {"Idempotency-Key": prompt["id"]}
                    path = f"{run}/prompts/{prompt['id']}/confirm"
                    answered = (await client.post(path, headers=key)).json()
                    assert (answered["prompt"] or {"id": ""})["id"] != prompt[
                        "id"
                    ]  # it is over when that comes
                    again = (await client.post(path)).json()
                    assert (again["code"], again.get("open_prompt_id")) != (3020, prompt["id"])
                await asyncio.sleep(0.01)
            assert (await client.post(f"{run}/prompts/another/confirm")).status_code == 409
            assert (await client.get(run)).json()["state"] == "running"
            for wrong in ("/runs/nothing/stop", "/loops/nothing/stop", "/runs/nothing/prompts/p/abort"):
                assert (await client.post(wrong)).status_code == 404
            stopped = await client.post(f"{run}/stop")
        assert (stopped.status_code, stopped.json()["problems"]) == (202, [])
        assert held.arm.halted.is_set()
        assert await held.until(run, "state", lambda state: state != "running") == "stopped"
        assert not any(request.done() for request in held.requests)

    in_held_service(tmp_path, monkeypatch, scene)


@pytest.mark.parametrize("where", ["before the record says stopped", "after it"])
def test_a_stop_is_answered_before_the_run_has_ended_and_the_next_one_waits_for_that(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, where: str
) -> None:
    monkeypatch.setattr(run_manager, "FINISH_S", 10.0 * PATIENCE_S)
    let_go, wanted = threading.Event(), threading.Event()
    execute, need_robot = Run.execute, run_manager.RunManager.need_robot

    def lingering(run: Run, devices: Devices, **more: Any) -> ExecutionOutcome:
        outcome = execute(run, devices, **more)
        let_go.wait()
        return outcome

    def wanting(here: run_manager.RunManager) -> None:
        wanted.set()
        need_robot(here)

    async def scene(held: Held) -> None:
        after = where == "after it"
        if after:
            monkeypatch.setattr(Run, "execute", lingering)
        else:
            monkeypatch.setattr(held.arm, "disconnect", let_go.wait)
        client, run = held.client, await a_run(held)
        name = run.rpartition("/")[2]
        try:
            for _ in range(1 + after):  # the second one finds it stopped
                async with asyncio.timeout(PATIENCE_S):
                    stopped = await client.post(f"{run}/stop")
                assert stopped.status_code == 202
                while after and held.service.book.get(name).status().state != "stopped":
                    await asyncio.sleep(0.01)
            assert held.arm.halted.is_set()
            assert held.service.book.busy_with == name
            monkeypatch.setattr(run_manager.RunManager, "need_robot", wanting)
            again = asyncio.create_task(client.post(f"{run}/resume"))
            await asyncio.to_thread(wanted.wait, PATIENCE_S)
        finally:
            let_go.set()
        assert (await again).status_code == 202, (await again).text

    in_held_service(tmp_path, monkeypatch, scene)


def test_a_stop_does_not_wait_behind_answers_that_a_disk_holds(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def scene(held: Held) -> None:
        client, run = held.client, await a_run(held)
        prompt = (await client.get(run)).json()["prompt"]["id"]
        monkeypatch.setattr(held.service.keys, "once", lambda *_: held.released.wait())
        path = f"{run}/prompts/{prompt}/confirm"
        held.requests += [asyncio.create_task(client.post(path)) for _ in range(ORDERS + 5)]
        async with asyncio.timeout(PATIENCE_S):
            while held.service._orders.available_tokens:
                await asyncio.sleep(0.01)
            assert (await client.post(f"{run}/stop")).status_code == 202

    in_held_service(tmp_path, monkeypatch, scene)


@pytest.mark.parametrize("how", ["give the lease back", "take the lease over", "pause", "abort"])
def test_other_orders_are_served_as_well(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, how: str) -> None:
    async def scene(held: Held) -> None:
        client, run = held.client, await a_run(held)
        await held.hold()
        async with asyncio.timeout(PATIENCE_S):
            if how == "pause":
                answer = await client.post(f"{run}/pause")
            elif how == "abort":
                prompt = (await client.get(run)).json()["prompt"]["id"]
                answer = await client.post(f"{run}/prompts/{prompt}/abort")
            elif how == "take the lease over":
                order = {"holder": "bert", "reason": "anna has gone home"}
                answer = await client.post("/cell/lease/takeover", json=order)
            else:
                answer = await client.delete("/cell/lease")
        assert answer.status_code < 300, answer.text
        ended = "stopped" if how == "abort" else "paused"
        # Between its question and its end the run is seen running.
        assert await held.until(run, "state", lambda state: not State(state).active) == ended

    in_held_service(tmp_path, monkeypatch, scene)


# -- the lanes --------------------------------------------------------------------------------------------------


@dataclass
class Application:
    """Notes in which order requests come through; with `until`, they stay until then."""

    came: list[str] = field(default_factory=list)
    until: asyncio.Event | None = None

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        self.came.append(scope["path"])
        if self.until is not None:
            await self.until.wait()


async def _ask(lanes: RequestLanes, method: str, path: str, kind: str = "", *, ends: bool = True) -> int:
    """The status of a refusal; 0 when it came through. `ends` False: its body never does."""
    sent: list[Message] = []

    async def receive() -> Message:
        if not ends:
            await asyncio.Event().wait()
        return {"type": "http.request", "body": b"", "more_body": False}

    async def send(message: Message) -> None:
        sent.append(message)

    headers = [(b"content-type", kind.encode())]
    await lanes({"type": "http", "method": method, "path": path, "headers": headers}, receive, send)
    return sent[0]["status"] if sent else 0


@pytest.mark.parametrize(
    "others", [("POST", "/api/v1/runs"), ("GET", "/api/v1/runs/a")], ids=["dry runs", "long polls"]
)
def test_a_stop_overtakes_what_came_before_it(others: tuple[str, str]) -> None:
    async def play() -> None:
        app = Application()
        lanes = RequestLanes(app)
        async with asyncio.TaskGroup() as group:
            for _ in range(100):
                group.create_task(_ask(lanes, *others))
            group.create_task(_ask(lanes, "POST", "/api/v1/runs/a/stop"))
        assert len(app.came) == 101
        assert app.came.index("/api/v1/runs/a/stop") < 3

    asyncio.run(play())


def test_status_does_not_queue_behind_ordinary_requests() -> None:
    async def play() -> None:
        app = Application()
        lanes = RequestLanes(app)
        async with asyncio.TaskGroup() as group:
            for _ in range(100):
                group.create_task(_ask(lanes, "POST", "/api/v1/runs"))
            group.create_task(_ask(lanes, "GET", "/api/v1/runs/a"))
        assert app.came.index("/api/v1/runs/a") < 6

    asyncio.run(play())


@pytest.mark.parametrize(
    ("kind", "most"), [("application/json", ORDINARY), ("multipart/form-data; b=c", UPLOADS)]
)
def test_more_than_can_be_in_hand_is_refused_at_once(kind: str, most: int) -> None:
    async def play() -> None:
        app = Application(until=asyncio.Event())
        assert app.until is not None
        lanes = RequestLanes(app)
        async with asyncio.TaskGroup() as group:
            for _ in range(most):
                group.create_task(_ask(lanes, "POST", "/api/v1/datasets", kind))
            while len(app.came) < most:
                await asyncio.sleep(0)
            assert await _ask(lanes, "POST", "/api/v1/datasets", kind) == 503
            app.until.set()
        assert await _ask(lanes, "POST", "/api/v1/datasets", kind) == 0

    asyncio.run(play())


def test_a_client_that_sends_slowly_holds_up_nobody() -> None:
    async def play() -> None:
        app = Application()
        lanes = RequestLanes(app)
        slow = asyncio.create_task(_ask(lanes, "POST", "/api/v1/runs", ends=False))
        async with asyncio.timeout(PATIENCE_S):
            assert await _ask(lanes, "POST", "/api/v1/campaigns") == 0
        assert app.came == ["/api/v1/campaigns"]
        slow.cancel()

    asyncio.run(play())


@contextmanager
def _described(folder: Path) -> Iterator[dict[str, Any]]:
    yield create_app(ServiceSettings(folder, TOKENS)).openapi()["paths"]


def test_every_order_to_the_robot_is_in_the_first_lane(tmp_path: Path) -> None:
    with _described(tmp_path) as paths:
        first = {path for path in paths if AT_ONCE.fullmatch(re.sub(r"{\w+}", "x", path))}
    orders = {path for path in paths if re.search(r"/(stop|pause|finish)$|/prompts/|/lease|/health", path)}
    assert first == orders
    assert len(first) > 6
