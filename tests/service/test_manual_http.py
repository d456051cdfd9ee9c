"""Readings of a pendant and an instrument that a person types on the page.

They are checked, kept, and stored once for one key.
"""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any, cast

import httpx2

from acquisition import Cell, Devices, open_devices
from service.http.access.roles import ServiceSettings, Tokens
from service.http.app import create_app
from service.http.wire.paths import PREFIX
from service.simulated_cell import SimulatedDevices
from tests.acquisition.fakes import CAMPAIGN, a_cell
from tests.drivers.waiting import PATIENCE_S

TOKENS = Tokens("only-for-the-tests-of-truepose", "only-looks-at-the-tests-of-truepose")
BY_HAND = {
    "robot__driver": "manual",
    "robot__url": None,
    "instrument": {"driver": "manual", "station_mm": [2400.0, -900.0, 350.0]},
}
NESTS = {"N1": "0 0 0", "N2": "600 0 0", "N3": "0 600 0"}


class ByHand:
    """The devices of a cell in which a person does everything."""

    def open(self, cell: Cell) -> Devices:
        return open_devices(cell)


async def asked(client: httpx2.AsyncClient, run: str, before: str = "") -> dict[str, Any]:
    """The prompt after the one with this id."""
    async with asyncio.timeout(PATIENCE_S):
        while not (prompt := (await client.get(run)).json()["prompt"]) or prompt["id"] == before:
            await asyncio.sleep(0.01)
    return prompt


def test_numbers_are_typed_beside_the_answer(tmp_path: Path) -> None:
    async def play() -> None:
        cell = a_cell(**BY_HAND)
        settings = ServiceSettings(tmp_path, TOKENS, cell=cell, simulated=cast(SimulatedDevices, ByHand()))
        app = create_app(settings)
        async with app.router.lifespan_context(app):
            base, headers = f"http://127.0.0.1{PREFIX}", {"Authorization": f"Bearer {TOKENS.operator}"}
            transport = httpx2.ASGITransport(app)
            async with httpx2.AsyncClient(transport=transport, base_url=base, headers=headers) as client:
                await scene(client)

    async def scene(client: httpx2.AsyncClient) -> None:
        lease = await client.post("/cell/lease", json={"holder": "anna", "seconds": 300.0})
        client.headers["Lease-Id"] = lease.json()["lease_id"]
        made = await client.post("/runs", json={"campaign": CAMPAIGN, "dry_run": False})
        assert made.status_code == 202, made.text
        run = f"/runs/{made.json()['id']}"

        async def answer(prompt: dict[str, Any], verb: str = "confirm", **body: Any) -> httpx2.Response:
            key = {"Idempotency-Key": prompt["id"] + verb}
            path = f"{run}/prompts/{prompt['id']}/{verb}"
            return await client.post(path, json=body, headers=key)

        where = await asked(client, run)
        assert where["entry"]["names"] == [f"J{k}" for k in range(1, 7)]
        assert where["picture"] == "pendant"
        assert "Stop does not reach it" in where["text"]
        refused = await client.post(f"{run}/prompts/{where['id']}/confirm")
        assert refused.status_code == 409
        assert "type them" in refused.json()["operator_text"]
        wrong = await client.post(f"{run}/prompts/{where['id']}/confirm", json={"joints": "0"})
        assert wrong.status_code == 422
        assert (await answer(where, typed="0 0 0 0")).status_code == 200
        again = await asked(client, run, where["id"])
        assert again["picture"] == "pendant/again/count"
        assert again["text"].startswith("4 numbers were typed, 6 are needed")
        first = await answer(again, typed="0 0 0 0 30 0")
        second = await answer(again, typed="0 0 0 0 30 0")  # the same key: the same answer
        assert (first.status_code, second.status_code) == (200, 200)
        assert first.text == second.text
        prompt = again
        for name, place in NESTS.items():
            prompt = await asked(client, run, prompt["id"])
            assert prompt["picture"] == f"read/{name}"
            assert (await answer(prompt, typed=place.replace("6", "-6"))).status_code == 200
        drive = await asked(client, run, prompt["id"])
        assert drive["picture"] == "drive"
        assert len(drive["entry"]["shown"]) == 6
        ended = (await answer(drive, "abort")).json()
        assert ended["id"] == made.json()["id"]
        async with asyncio.timeout(PATIENCE_S):
            while (state := (await client.get(run)).json()["state"]) not in ("stopped", "failed"):
                await asyncio.sleep(0.01)
        assert state == "stopped"

    asyncio.run(play())
