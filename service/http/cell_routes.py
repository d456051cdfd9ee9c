"""Health, the cell, and its motion lease."""

from __future__ import annotations

from importlib.metadata import version
from typing import Any

from fastapi import APIRouter, Response

from service.http.bodies import CellShown, Health, LeaseShown, TakeLease
from service.http.headers import LeaseId
from service.http.lease import Held
from service.http.state import Here
from service.plain import utc_text

router = APIRouter(tags=["cell"])


@router.get("/health", operation_id="getHealth", response_model=Health)
def get_health(here: Here) -> dict[str, Any]:
    """The service answers. Needs no token."""
    simulated = here.settings.simulated is not None
    return {"status": "ok", "version": version("truepose"), "simulated": simulated}


@router.get("/cell", operation_id="getCell", response_model=CellShown)
def get_cell(here: Here) -> dict[str, Any]:
    """The cell, who may move its robot, and which run does."""
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
        "loop_id": here.book.lent_to,
        "lease": None if held is None else _shown(held, ""),
    }


@router.post("/cell/lease", operation_id="takeLease", response_model=LeaseShown)
def take_lease(here: Here, body: TakeLease, lease_id: LeaseId = "") -> dict[str, Any]:
    """Take the motion lease, or keep it: repeat this before it expires, or the robot rests and its run is paused."""
    held = here.lease.take(body.holder, body.seconds, lease_id)
    return _shown(held, held.id)


@router.delete("/cell/lease", operation_id="giveLeaseBack", status_code=204)
def give_lease_back(here: Here, lease_id: LeaseId = "") -> Response:
    """Give the lease back; a run pauses after the reading in hand, a loop also between two runs."""
    holder = here.lease.give_back(lease_id)
    if holder is not None:
        whole = here.book if here.book.lent_to is None else here.loops
        whole.pause_all(holder, f"{holder} gave the motion lease back.")
    return Response(status_code=204)


def _shown(held: Held, lease_id: str) -> dict[str, Any]:
    return {
        "holder": held.holder,
        "expires_utc": utc_text(held.expires_utc),
        "seconds": held.beats.seconds,
        "lease_id": lease_id,
    }
