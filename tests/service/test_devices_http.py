"""What the service says of its devices, without asking one.

These would catch: a state that nobody has observed, a device that is asked or connected for an answer, a loss that is
not shown, or not in the events, trouble that is forgotten when the run lets go, and an examination that is not noted.
"""

from __future__ import annotations

import asyncio
import json
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import httpx2
import pytest

from acquisition import Cell, Devices
from acquisition.examination import CheckResult, Examination
from acquisition.run import DeviceCondition
from acquisition.run.rig.device_state import DeviceStates, KnownDevice
from drivers.errors import BeamBroken, EmergencyStop, LinkLost, NoisyMeasurement
from service.http.access.roles import ServiceSettings, Tokens
from service.http.app import create_app
from service.http.routes.work import examination_routes
from service.http.wire.paths import PREFIX
from service.http.work.workers import Workers
from service.simulated_cell import SimulatedDevices
from tests.acquisition.fakes import CAMPAIGN, Bench, SeatingOperator, a_cell, devices_of
from tests.drivers.waiting import PATIENCE_S

TOKENS = Tokens("only-for-the-tests-of-truepose", "only-looks-at-the-tests-of-truepose")


@dataclass
class Asked:
    """A service on fakes in this loop."""

    bench: Bench
    client: httpx2.AsyncClient

    async def devices(self) -> dict[str, dict[str, Any]]:
        answer = await self.client.get("/cell/devices")
        assert answer.status_code == 200, answer.text
        return {each["role"]: each for each in answer.json()["devices"]}

    async def run(self, *states: str) -> dict[str, Any]:
        """Begin a run and wait until it is in one of these states."""
        lease = await self.client.post("/cell/lease", json={"holder": "anna", "seconds": 300.0})
        self.client.headers["Lease-Id"] = lease.json()["lease_id"]
        began = await self.client.post(
            "/runs", json={"campaign": CAMPAIGN | {"settle_s": 0.0}, "dry_run": False}
        )
        assert began.status_code == 202, began.text
        return await self.until(began.json()["id"], *states)

    async def until(self, run: str, *states: str) -> dict[str, Any]:
        async with asyncio.timeout(PATIENCE_S):
            while (document := (await self.client.get(f"/runs/{run}")).json())["state"] not in states:
                await asyncio.sleep(0.01)
        return document

    async def events(self, run: str, kind: str) -> list[dict[str, Any]]:
        """The data of the events of a kind up to now."""
        answer = await self.client.get(f"/runs/{run}/events.jsonl")
        found = [json.loads(line) for line in answer.text.splitlines()]
        return [event["data"] for event in found if event["kind"] == kind]


def play(
    folder: Path, monkeypatch: pytest.MonkeyPatch, scene: Callable[[Asked], Awaitable[None]], **cell: Any
) -> None:
    bench = Bench(a_cell(**cell))

    class Fakes:
        def open(self, cell: Cell) -> Devices:
            return devices_of(bench, SeatingOperator(bench))

    async def whole() -> None:
        settings = ServiceSettings(folder, TOKENS, cell=bench.cell, simulated=cast(SimulatedDevices, Fakes()))
        app = create_app(settings)
        async with app.router.lifespan_context(app):
            headers = {"Authorization": f"Bearer {TOKENS.operator}"}
            base = f"http://127.0.0.1{PREFIX}"
            async with httpx2.AsyncClient(
                transport=httpx2.ASGITransport(app), base_url=base, headers=headers
            ) as client:
                await scene(Asked(bench, client))

    monkeypatch.setattr(Workers, "call", lambda self, function, *args: function(*args))
    asyncio.run(whole())


def test_before_anything_has_asked_nothing_is_invented(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def scene(asked: Asked) -> None:
        found = await asked.devices()
        assert list(found) == ["robot", "instrument"]
        assert {each["state"] for each in found.values()} == {"unknown"}
        assert all("asked" in each["says"] for each in found.values())
        assert all(each["since_utc"] is each["heard_utc"] is None for each in found.values())
        assert asked.bench.calls == 0
        assert found["robot"]["driver"] == asked.bench.cell.robot.driver

    play(tmp_path, monkeypatch, scene)


def test_while_it_runs_what_they_do_is_shown_and_asking_asks_no_device(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def scene(asked: Asked) -> None:
        loop, seen = asyncio.get_running_loop(), dict[str, dict[str, dict[str, Any]]]()

        def look(name: str) -> Callable[[], None]:
            def within() -> None:
                before = asked.bench.calls
                found = asyncio.run_coroutine_threadsafe(asked.devices(), loop).result(PATIENCE_S)
                assert asked.bench.calls == before  # no device was asked, also within a move
                seen[name] = found

            return within

        asked.bench.faults |= {1: look("connecting"), 8: look("moving"), 10: look("measuring")}
        ended = await asked.run("succeeded")
        assert seen["connecting"]["robot"]["state"] == "connecting"
        assert seen["connecting"]["instrument"]["state"] == "unknown"
        assert (seen["moving"]["robot"]["state"], seen["moving"]["instrument"]["state"]) == (
            "moving",
            "ready",
        )
        assert (seen["measuring"]["robot"]["state"], seen["measuring"]["instrument"]["state"]) == (
            "ready",
            "measuring",
        )
        assert "T1" in seen["measuring"]["instrument"]["says"]
        after = await asked.devices()
        assert {each["state"] for each in after.values()} == {"not_connected"}
        assert after["robot"]["since_utc"] >= seen["measuring"]["robot"]["since_utc"]
        assert await asked.events(ended["id"], "device_state") == []  # no event for what is as it should be

    play(tmp_path, monkeypatch, scene)


@pytest.mark.parametrize(
    ("call", "error", "role", "state"),
    [
        (10, LinkLost("the wire is cut"), "instrument", "silent"),
        (8, LinkLost("the wire is cut"), "robot", "silent"),
        (10, BeamBroken("broken"), "instrument", "beam_lost"),
    ],
)
def test_trouble_that_passes_is_shown_while_it_lasts_and_in_the_events(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, call: int, error: Exception, role: str, state: str
) -> None:
    async def scene(asked: Asked) -> None:
        loop, seen = asyncio.get_running_loop(), list[dict[str, Any]]()

        def fail() -> None:
            raise error

        def look() -> None:
            seen.append(asyncio.run_coroutine_threadsafe(asked.devices(), loop).result(PATIENCE_S)[role])

        asked.bench.faults |= {call: fail, call + 1: look}
        ended = await asked.run("succeeded")
        told = await asked.events(ended["id"], "device_state")
        trouble, well = told
        assert (trouble["role"], trouble["state"]) == (role, state)
        assert well["state"] in ("ready", "moving", "measuring")
        assert seen[0]["state"] == state
        assert (await asked.devices())[role]["state"] == "not_connected"

    play(tmp_path, monkeypatch, scene)


def test_trouble_that_ends_a_run_stays_known_until_an_examination(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def scene(asked: Asked) -> None:
        def pressed() -> None:
            raise EmergencyStop("the emergency stop is pressed")

        asked.bench.faults[8] = pressed
        ended = await asked.run("paused")
        robot = (await asked.devices())["robot"]
        assert (robot["state"], robot["code"]) == ("in_error", 4001)
        assert "pressed" in robot["says"]
        assert robot["since_utc"] is not None
        assert [each["state"] for each in await asked.events(ended["id"], "device_state")] == ["in_error"]
        found.append(CheckResult("robot", "lease", "fault", "another campaign uses it", code=5003))
        assert (await asked.client.post("/cell/examination")).status_code == 200
        assert (await asked.devices())["robot"] == robot  # it was not asked
        found[:] = [CheckResult("robot", "link", "ok", "it answers")]
        found.append(
            CheckResult("instrument", "link", "fault", "it does not answer", "Look at the cable.", 1001)
        )
        assert (await asked.client.post("/cell/examination")).status_code == 200
        examined = await asked.devices()
        assert (examined["robot"]["state"], examined["instrument"]["state"]) == ("not_connected", "silent")
        assert examined["robot"]["since_utc"] > robot["since_utc"]
        assert "Look at the cable." in examined["instrument"]["says"]

    def examined(cell: Cell, devices: Devices, **_: object) -> Examination:
        return Examination(cell.name, True, 0.1, list(found))

    found: list[CheckResult] = []
    monkeypatch.setattr(examination_routes, "examine", examined)
    play(tmp_path, monkeypatch, scene)


def test_the_time_is_that_of_the_last_change() -> None:
    now, told = [100.0], list[KnownDevice]()
    states = DeviceStates(lambda: now[0], told.append)
    states.note("robot", DeviceCondition.CONNECTING, "a")
    assert states.known["robot"].heard_utc is None
    for at, what in ((101.0, "b"), (102.0, "b")):
        now[0] = at
        states.note("robot", DeviceCondition.READY, what)
    assert (states.known["robot"].since_utc, states.known["robot"].heard_utc) == (101.0, 102.0)
    now[0] = 103.0
    states.heard("robot")
    assert (states.known["robot"].since_utc, states.known["robot"].heard_utc) == (101.0, 103.0)
    now[0] = 104.0
    states.failed("robot", LinkLost("gone"), stopped=False)
    now[0] = 105.0
    states.note("robot", DeviceCondition.CONNECTING, "a")
    now[0] = 106.0
    states.failed("robot", LinkLost("gone"), stopped=False)
    lost = states.known["robot"]  # also while it is connected again, and not heard meanwhile
    assert (lost.condition, lost.since_utc, lost.heard_utc) == (DeviceCondition.SILENT, 104.0, 103.0)
    assert [each.condition for each in told] == [DeviceCondition.SILENT]  # once, however often it is tried
    states.released()
    assert states.known["robot"].condition is DeviceCondition.SILENT
    states.note("robot", DeviceCondition.READY, "b")
    states.failed("robot", NoisyMeasurement("swings"), stopped=False)
    assert states.known["robot"].condition is DeviceCondition.READY
    assert [each.condition for each in told] == [DeviceCondition.SILENT, DeviceCondition.READY]
    states.released()
    assert states.known["robot"].condition is DeviceCondition.NOT_CONNECTED
