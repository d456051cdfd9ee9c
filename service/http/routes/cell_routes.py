"""Health, the cell, and its motion lease."""

from __future__ import annotations

from importlib.metadata import version
from typing import Any

from fastapi import APIRouter, Request, Response

from service.http.access.motion_lease import HeldLease
from service.http.routes.json_route import JsonRoute
from service.http.routes.pages.page import page_hash
from service.http.state import Here
from service.http.wire.bodies import (
    CellShown,
    ConnectionList,
    DeviceList,
    Health,
    LeaseRequest,
    LeaseShown,
    LeaseTakeoverRequest,
)
from service.http.wire.headers import LeaseId
from service.http.wire.tags import Tag
from service.json_values import utc_text

router = APIRouter(route_class=JsonRoute, tags=[Tag.CELL])


@router.get("/health", operation_id="getHealth", response_model=Health)
async def get_health(here: Here) -> dict[str, Any]:
    """Confirm that the service answers. Needs no token."""
    simulated = here.settings.simulated is not None
    return {"status": "ok", "version": version("truepose"), "page": page_hash(), "simulated": simulated}


@router.get("/cell", operation_id="getCell", response_model=CellShown)
async def get_cell(here: Here, request: Request) -> dict[str, Any]:
    """Return the cell.

    Also returned are who may move its robot, which run does, and the role of the token that asks.
    """
    cell, held = here.cell, here.lease.current
    return {
        "name": cell.name,
        "robot": cell.robot.model.name,
        "robot_driver": cell.robot.driver,
        "instrument": cell.instrument.name,
        "instrument_driver": cell.instrument.driver,
        "targets": list(cell.tool.targets),
        "nests": list(cell.nests),
        "simulated": here.settings.simulated is not None,
        "run_id": here.book.busy_with,
        "loop_id": here.book.lent_to if here.book.lent_for == "loop" else None,
        "verification_id": here.book.lent_to if here.book.lent_for == "verification" else None,
        "last_run_id": here.book.last,
        "role": request.state.role.value,
        "lease": None if held is None else _shown(held),
    }


@router.get("/cell/devices", operation_id="listDevices", response_model=DeviceList)
async def list_devices(here: Here) -> dict[str, Any]:
    """Return what is known of robot and instrument: what they do, or what is wrong, and since when.

    It is what runs and examinations have met. No device is asked for this answer, and none is connected, moved or
    set. Trouble that begins or ends in a run is also its event `device_state`.
    """
    cell = here.cell
    names = {
        "robot": (cell.robot.model.name, cell.robot.driver),
        "instrument": (cell.instrument.name, cell.instrument.driver),
    }
    return {
        "devices": [
            {
                "role": each.role,
                "name": names[each.role][0],
                "driver": names[each.role][1],
                "state": each.condition,
                "says": each.says,
                "since_utc": each.since_utc and utc_text(each.since_utc),
                "heard_utc": each.heard_utc and utc_text(each.heard_utc),
                "code": each.code,
            }
            for each in here.book.devices()
        ]
    }


@router.get("/cell/connections", operation_id="listConnections", response_model=ConnectionList)
async def list_connections(here: Here) -> dict[str, Any]:
    """List the connections to MQTT and OPC UA that the service was started with, and how they are."""
    return {"connections": [each.log.document() for each in here.settings.publishers]}


@router.post("/cell/lease", operation_id="takeLease", tags=[Tag.CORE], response_model=LeaseShown)
async def take_lease(here: Here, body: LeaseRequest, lease_id: LeaseId = "") -> dict[str, Any]:
    """Take the motion lease, or keep it.

    Repeat this before it expires; otherwise the robot rests and its run is paused. Without `Lease-Id` it is taken
    if no client holds it, and the answer has its secret, `lease_id`. The secret is never given again, also not for
    an `Idempotency-Key`. With `Lease-Id` it is prolonged; 409 if it has ended.
    """
    if lease_id:
        return _shown(here.lease.renew(body.holder, body.seconds, lease_id))
    held = await here.urgent(lambda: here.lease.grant(body.holder, body.seconds))
    return _shown(held, lease_id=held.secret)


@router.post("/cell/lease/takeover", operation_id="takeLeaseOver", response_model=LeaseShown)
async def take_lease_over(here: Here, body: LeaseTakeoverRequest) -> dict[str, Any]:
    """Take the motion lease from its holder; a moving run pauses after the current reading.

    Holder, reason and time are kept in `lease.jsonl` of the record, and in the events of the run.
    """

    def work() -> dict[str, Any]:
        held, before = here.lease.take_over(body.holder, body.seconds, body.reason)
        if before:
            why = f"{body.holder} has taken the motion lease over from {before}: {body.reason}"
            here.rest(body.holder, why)
        return _shown(held, lease_id=held.secret, taken_from=before)

    return await here.urgent(work)


@router.delete("/cell/lease", operation_id="giveLeaseBack", tags=[Tag.CORE], status_code=204)
async def give_lease_back(here: Here, lease_id: LeaseId = "") -> Response:
    """Give the lease back.

    A run pauses after the current reading, a loop also between two runs. Needs `Lease-Id`.
    """

    def work() -> None:
        holder = here.lease.give_back(lease_id)
        if holder is not None:
            here.rest(holder, f"{holder} gave the motion lease back.")

    await here.urgent(work)
    return Response(status_code=204)


def _shown(held: HeldLease, *, lease_id: str = "", taken_from: str = "") -> dict[str, Any]:
    return {
        "holder": held.holder,
        "expires_utc": utc_text(held.expires_utc),
        "seconds": held.beats.seconds,
        "lease_id": lease_id,
        "taken_from": taken_from,
    }
