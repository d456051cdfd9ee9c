"""Closed loops: made, looked at, paused, resumed, stopped."""

from __future__ import annotations

from typing import Any

from fastapi import APIRouter
from fastapi.responses import JSONResponse, Response

from acquisition import LeaseDeadline
from service.http.routes.json_route import JsonRoute
from service.http.routes.runs.run_routes import acceptance, who
from service.http.runs.dry_runs import Expected, calibration_of, planned
from service.http.runs.loops import ENDED
from service.http.state import Here, Service
from service.http.wire.bodies import LoopList, LoopShown, NewLoop, ResumeBody
from service.http.wire.headers import After, IdempotencyKey, LeaseId, LoopId, Wait
from service.http.wire.paths import path_of
from service.http.wire.tags import Tag
from service.http.work.idempotency import reply
from service.http.work.paging import LINKED, Paged

router = APIRouter(route_class=JsonRoute, tags=[Tag.MEASURE])
LOOPS = path_of("loops")


def _accepted(here: Service, loop_id: str, **more: Any) -> JSONResponse:
    document = here.loops.document(loop_id) | more
    return reply(202, document, location=f"{LOOPS}/{loop_id}", retry_after=1)


@router.post("/loops", operation_id="createLoop", tags=[Tag.CORE], status_code=202, response_model=LoopShown)
def create_loop(
    here: Here, body: NewLoop, idempotency_key: IdempotencyKey = "", lease_id: LeaseId = ""
) -> JSONResponse:
    """Check a loop (`dry_run`, the default), or go through it.

    Going through it moves the robot and needs `Lease-Id`. A campaign is measured and diagnosed; with `accuracy_mm`,
    its poses are chosen while they are measured, and `outlook` says what is expected. If something is ambiguous,
    poses that decide it are measured too. Then corrected targets of new poses are driven and measured; with
    `accuracy_mm`, only once the paused loop is resumed. Its campaigns are runs, in `runs`.
    """

    def work() -> JSONResponse:
        cell = here.cell
        table = here.shelf.get(body.campaign_id)["campaign"] if body.campaign_id else body.campaign
        outlook = Expected()
        if body.accuracy_mm:
            asked = {
                "accuracy_mm": body.accuracy_mm,
                "minutes": body.minutes or None,
                "zone": body.zone or None,
                "zone_joints_deg": body.zone_joints_deg or None,
                "poses": body.poses,
            }
            table, outlook = here.workers.call(calibration_of, cell, asked)
        if body.dry_run:
            return _accepted(here, here.loops.check(cell, table, body.name, outlook))
        here.lease.needed(lease_id)
        here.book.need_robot()
        campaign, _ = here.workers.call(planned, cell, table)

        def begin(lease: LeaseDeadline) -> str:
            return here.loops.start(cell, campaign, body.name, body.poses, lease, outlook)

        return _accepted(here, here.let_move(lease_id, begin))

    return here.keys.once(idempotency_key, (LOOPS, body), work)


@router.get("/loops", operation_id="listLoops", responses=LINKED, response_model=LoopList)
async def list_loops(here: Here, page: Paged) -> Response:
    """List every loop, newest first."""
    return await here.listed("loops", page, here.loops.ids, here.loops.document)


@router.get("/loops/{loop_id}", operation_id="getLoop", tags=[Tag.CORE], response_model=LoopShown)
async def get_loop(here: Here, loop_id: LoopId, wait: Wait = 0, after: After = 0) -> dict[str, Any]:
    """Return a loop.

    With `wait`, the answer comes as soon as its version is beyond `after` or nothing can happen to it any more.
    """

    def read() -> dict[str, Any]:
        return here.loops.document(loop_id)

    document = await here.reading(f"loop {loop_id}", read)
    if wait and document["version"] <= after and document["state"] not in {state.value for state in ENDED}:
        await here.changed(
            f"loop {loop_id}", lambda seconds: here.loops.wait(loop_id, after, seconds), after, wait
        )
        document = await here.reading(f"loop {loop_id}", read)
    return document


@router.post("/loops/{loop_id}/pause", operation_id="pauseLoop", status_code=202, response_model=LoopShown)
async def pause_loop(here: Here, loop_id: LoopId) -> JSONResponse:
    """Pause a loop after the current reading, or between two campaigns after the current step."""

    def work() -> JSONResponse:
        here.loops.pause(loop_id, by=who(here))
        return _accepted(here, loop_id)

    return await here.order(loop_id, work)


@router.post("/loops/{loop_id}/resume", operation_id="resumeLoop", status_code=202, response_model=LoopShown)
def resume_loop(
    here: Here,
    loop_id: LoopId,
    body: ResumeBody,
    idempotency_key: IdempotencyKey = "",
    lease_id: LeaseId = "",
) -> JSONResponse:
    """Go on where it was; the robot moves, so this needs `Lease-Id`. A run of a loop is resumed with its loop.

    With another robot or instrument than before only by its serial number, and for a reason.
    """

    def work() -> JSONResponse:
        here.loops.document(loop_id)
        here.let_move(
            lease_id,
            lambda lease: here.loops.resume(loop_id, here.cell, lease, acceptance(body, lease.owner)),
        )
        return _accepted(here, loop_id)

    asked = (f"{LOOPS}/{loop_id}/resume", body)
    return here.keys.once(idempotency_key, asked, work)


@router.post("/loops/{loop_id}/stop", operation_id="stopLoop", status_code=202, response_model=LoopShown)
async def stop_loop(here: Here, loop_id: LoopId) -> JSONResponse:
    """Halt the robot now and end the loop. Needs no lease.

    `problems` lists the devices that could not be stopped. The answer comes when the robot has the order, which may
    be a moment before the loop has ended.
    """

    def work() -> JSONResponse:
        problems = here.loops.stop(loop_id, by=who(here))
        return _accepted(here, loop_id, problems=[problem.as_dict() for problem in problems])

    return await here.order(loop_id, work, stops=True)
