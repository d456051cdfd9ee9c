"""The plan of a run, the benefit of each pose, and poses to measure again or leave out."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated

from fastapi import APIRouter, Depends, Path, Query
from fastapi.responses import JSONResponse

from calib.errors import DataError
from service.http.routes.json_route import JsonRoute
from service.http.routes.runs.run_routes import RUNS, accepted, who
from service.http.runs.dry_runs import plan_in
from service.http.state import Here
from service.http.wire.bodies import RunResponse, WhyBody
from service.http.wire.headers import IdempotencyKey, LeaseId, RunId
from service.http.wire.problems import not_found
from service.http.wire.tags import Tag
from service.results.cell.plan import PlanShown
from service.results.cell.price import PriceShown, price_of
from service.results.cell.scene import SceneShown, scene_of

router = APIRouter(route_class=JsonRoute)
Number = Annotated[
    int, Path(ge=0, le=2**31, description="Number of the visit in the plan, from 0 on.", examples=[17])
]
Joints = Annotated[
    str,
    Query(
        max_length=400,
        description="Joint angles of the robot, deg, with commas (none: at home).",
        examples=["0,20,-30,0,45,0"],
    ),
]


@router.get("/cell/scene", operation_id="getScene", tags=[Tag.PREPARE])
def get_scene(here: Here, joints_deg: Joints = "") -> SceneShown:
    """The cell as a picture needs it: arm and tool as capsules, boxes and posts, nests and targets, mm, world frame."""
    try:
        posture = [float(part) for part in joints_deg.split(",")] if joints_deg.strip() else []
    except ValueError as error:
        raise DataError("are not numbers.", do="Give angles in deg with commas.", key="joints_deg") from error
    return here.workers.call(scene_of, here.cell, posture)


@router.get("/runs/{run_id}/plan", operation_id="getPlan", tags=[Tag.CHECK])
def get_plan(here: Here, run_id: RunId) -> PlanShown:
    """Every visit of a run, or of a dry run: where its targets should be, what became of them, how long it takes."""
    return here.workers.call(plan_in, here.book.path(run_id))


@router.get("/runs/{run_id}/visits/{number}/price", operation_id="getPrice", tags=[Tag.MEASURE])
def get_price(here: Here, run_id: RunId, number: Number) -> PriceShown:
    """The price of a pose: the predicted U of positions as planned and without it, mm, and the seconds it takes."""
    here.book.get(run_id)  # a dry run measures nothing
    price = here.workers.call(price_of, here.book.path(run_id), number)
    if price is None:
        raise not_found("visit", str(number))
    return price


def _order(
    here: Here,
    run_id: RunId,
    number: Number,
    body: WhyBody,
    idempotency_key: IdempotencyKey = "",
    lease_id: LeaseId = "",
) -> Callable[[str], JSONResponse]:
    """Return the function that orders a verb for a visit, in the name of the client."""

    def give(verb: str) -> JSONResponse:
        by = who(here, lease_id)

        def work() -> JSONResponse:
            visits = here.book.get(run_id).visits
            order = visits.again if verb == "retake" else visits.leave_out
            if not order(number, by, body.reason):
                raise not_found("visit that this could be done with", str(number))
            return accepted(here, run_id)

        if verb == "retake":
            here.lease.needed(lease_id)
        return here.keys.once(idempotency_key, (f"{RUNS}/{run_id}/visits/{number}/{verb}", body.reason), work)

    return give


Order = Annotated[Callable[[str], JSONResponse], Depends(_order)]
VISIT = "/runs/{run_id}/visits/{number}"


@router.post(
    f"{VISIT}/retake",
    operation_id="retakeVisit",
    tags=[Tag.MEASURE],
    status_code=202,
    response_model=RunResponse,
)
def retake_visit(order: Order) -> JSONResponse:
    """Measure a pose again: its readings are kept, out of use. The robot goes back there, so this needs `Lease-Id`."""
    return order("retake")


@router.post(
    f"{VISIT}/skip", operation_id="skipVisit", tags=[Tag.MEASURE], status_code=202, response_model=RunResponse
)
def skip_visit(order: Order) -> JSONResponse:
    """Leave out the readings of a pose that are not measured yet. `retake` requests them again."""
    return order("skip")
