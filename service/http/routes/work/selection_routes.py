"""Selections: calibration poses chosen by observability in the cell of this service, as `truepose select` does it."""

from __future__ import annotations

from fastapi import APIRouter
from fastapi.responses import JSONResponse

from service.files import as_json
from service.http.routes.json_route import JsonRoute
from service.http.routes.work.job_routes import shown
from service.http.state import Here
from service.http.wire.bodies import SelectionAsked, SelectionShown
from service.http.wire.headers import After, IdempotencyKey, JobId, Wait
from service.http.wire.paths import path_of
from service.http.work.idempotency import begun

router = APIRouter(route_class=JsonRoute, tags=["selections"])
SELECTIONS = path_of("selections")


@router.post("/selections", operation_id="createSelection", status_code=202, response_model=SelectionShown)
def create_selection(here: Here, body: SelectionAsked, idempotency_key: IdempotencyKey = "") -> JSONResponse:
    """Choose calibration poses; nothing moves. `result.poses_deg` goes into a block with `select = "list"`."""

    def work() -> JSONResponse:
        order = {
            "count": body.count,
            "candidates": body.candidates,
            "groups": body.groups,
            "targets": body.targets or None,
            "offset_deg": body.offset_deg,
            "share": body.share,
            "wanted_u": body.wanted_u_mm or None,
            "seed": body.seed,
        }
        prior = as_json(body.prior).encode() if body.prior else None
        return begun(SELECTIONS, here.jobs.select(here.cell, order, prior))

    return here.keys.once(idempotency_key, (SELECTIONS, body), work)


@router.get("/selections/{job_id}", operation_id="getSelection", response_model=SelectionShown)
async def get_selection(here: Here, job_id: JobId, wait: Wait = 0, after: After = 0) -> JSONResponse:
    """A selection; with `wait`, as soon as its version is beyond `after`."""
    return await shown(here, "selection", job_id, wait, after)
