"""Searches of placements of a ballbar's base balls in the cell of this service, as `truepose plan-ballbar` does it."""

from __future__ import annotations

from fastapi import APIRouter
from fastapi.responses import JSONResponse, Response

from service.http.routes.json_route import JsonRoute
from service.http.routes.work.job_routes import REPORT_HEADERS, shown
from service.http.state import Here
from service.http.wire.bodies import PlacementsAsked, PlacementsShown
from service.http.wire.headers import After, IdempotencyKey, JobId, Wait
from service.http.wire.paths import path_of
from service.http.work.idempotency import begun
from service.results.cell.placements import PlacementRequest, wanted_of

router = APIRouter(route_class=JsonRoute, tags=["placements"])
PLACEMENTS = path_of("placements")


@router.post("/placements", operation_id="createPlacements", status_code=202, response_model=PlacementsShown)
def create_placements(
    here: Here, body: PlacementsAsked, idempotency_key: IdempotencyKey = ""
) -> JSONResponse:
    """Search where the base balls should be, so that the arm reaches most stances; nothing moves."""
    order = PlacementRequest.of(body.model_dump())
    wanted_of(order)
    cell = here.cell

    def work() -> JSONResponse:
        return begun(PLACEMENTS, here.jobs.place(cell, order))

    return here.keys.once(idempotency_key, (PLACEMENTS, body), work)


@router.get("/placements/{job_id}", operation_id="getPlacements", response_model=PlacementsShown)
async def get_placements(here: Here, job_id: JobId, wait: Wait = 0, after: After = 0) -> JSONResponse:
    """A search; with `wait`, as soon as its version is beyond `after`. Its result is that of `plan-ballbar --json`."""
    return await shown(here, "placement", job_id, wait, after)


@router.get("/placements/{job_id}/picture.svg", operation_id="getPlacementsPicture", response_class=Response)
def get_picture(here: Here, job_id: JobId) -> Response:
    """The placements that were found, from above and from the side."""
    return Response(here.jobs.picture(job_id), media_type="image/svg+xml", headers=REPORT_HEADERS)
