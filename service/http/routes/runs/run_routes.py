"""Runs: made, looked at, paused, resumed, stopped."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from fastapi import APIRouter
from fastapi.responses import JSONResponse, PlainTextResponse, Response

from acquisition import LeaseDeadline, export_events
from acquisition.record import DeviceAcceptance
from service.http.routes.json_route import JsonRoute
from service.http.runs.dry_runs import planned
from service.http.state import Here, Service
from service.http.wire.bodies import (
    DatasetShown,
    ExportBody,
    NewRun,
    Resume,
    ResumeBody,
    RunResponse,
    Runs,
    WhyBody,
)
from service.http.wire.headers import After, IdempotencyKey, LeaseId, RunId, Wait
from service.http.wire.paths import path_of
from service.http.wire.tags import Tag
from service.http.work.idempotency import reply
from service.http.work.paging import LINKED, Paged

router = APIRouter(route_class=JsonRoute, tags=[Tag.MEASURE])
RUNS = path_of("runs")
LINES = "application/x-ndjson"


def accepted(here: Service, run_id: str, *, at_once: bool = False, **more: Any) -> JSONResponse:
    """Return 202 with the run as it is now, and the place of its state."""
    document = here.book.document(run_id, at_once=at_once) | more
    return reply(202, document, location=f"{RUNS}/{run_id}", retry_after=1)


@router.post("/runs", operation_id="createRun", tags=[Tag.CORE], status_code=202, response_model=RunResponse)
def create_run(
    here: Here, body: NewRun, idempotency_key: IdempotencyKey = "", lease_id: LeaseId = ""
) -> JSONResponse:
    """Check a campaign (`dry_run`, the default), or measure it.

    Measuring moves the robot and needs `Lease-Id`.
    """

    def work() -> JSONResponse:
        cell = here.cell
        table = here.shelf.get(body.campaign_id)["campaign"] if body.campaign_id else body.campaign
        models = here.models_of(table)
        if body.dry_run:
            return accepted(here, here.book.check(cell, table, body.name, models))
        here.lease.needed(lease_id)
        here.book.need_robot()
        plan = here.workers.call(planned, cell, table, models)

        def begin(
            lease: LeaseDeadline,
        ) -> str:  # requested again: planning may take longer than the lease was held
            return here.book.start(cell, plan, body.name, lease)

        return accepted(here, here.let_move(lease_id, begin))

    return here.keys.once(idempotency_key, (RUNS, body), work)


@router.get("/runs", operation_id="listRuns", responses=LINKED, tags=[Tag.CORE], response_model=Runs)
async def list_runs(here: Here, page: Paged) -> Response:
    """List every run, newest first."""
    return await here.listed("runs", page, here.book.ids, here.book.document)


@router.get("/runs/{run_id}", operation_id="getRun", tags=[Tag.CORE], response_model=RunResponse)
async def get_run(here: Here, run_id: RunId, wait: Wait = 0, after: After = 0) -> Response:
    """Return a run.

    With `wait`, the answer comes as soon as its version is beyond `after` or nothing can happen to it any more.
    """
    glance = await here.glances(run_id)
    if wait and glance.version <= after and not glance.still:
        run = await here.waiting(lambda: here.book.get(run_id))
        await here.changed(f"run {run_id}", lambda seconds: run.wait(after, seconds), after, wait)
        glance = await here.glances.anew(run_id)
    return Response(glance.body, media_type=JSONResponse.media_type)


@router.post("/runs/{run_id}/pause", operation_id="pauseRun", status_code=202, response_model=RunResponse)
async def pause_run(here: Here, run_id: RunId) -> JSONResponse:
    """End a run after the current reading; it can be resumed."""

    def work() -> JSONResponse:
        here.book.pause(run_id, by=who(here))
        return accepted(here, run_id)

    return await here.order(run_id, work)


@router.post("/runs/{run_id}/finish", operation_id="finishRun", status_code=202, response_model=RunResponse)
async def finish_run(
    here: Here, run_id: RunId, body: WhyBody, idempotency_key: IdempotencyKey = "", lease_id: LeaseId = ""
) -> JSONResponse:
    """End a run early, as succeeded, with the readings that it has.

    The current reading is completed, then the robot rests; a run that rests or waits for an answer ends at once.
    `finished_early` says who ended it and when, and with how many readings. It cannot be resumed. 409 where no pose
    is measured yet, or where the run has ended otherwise. It needs no lease, unless a loop has the robot: that goes
    on with the diagnosis, and may move then.
    """

    def work() -> JSONResponse:
        by = who(here, lease_id)
        store = next(
            (each for each in (here.loops, here.verifications) if run_id in each.runs_in_hand()), None
        )
        if store is not None:
            here.let_move(lease_id, lambda lease: store.finish(run_id, lease, by, body.reason))
        else:
            here.book.finish(run_id, by, body.reason)
        return accepted(here, run_id)

    asked = (f"{RUNS}/{run_id}/finish", body)
    return await here.order(run_id, lambda: here.keys.once(idempotency_key, asked, work))


@router.post("/runs/{run_id}/resume", operation_id="resumeRun", status_code=202, response_model=RunResponse)
def resume_run(
    here: Here, run_id: RunId, body: ResumeBody, idempotency_key: IdempotencyKey = "", lease_id: LeaseId = ""
) -> JSONResponse:
    """Go on; the robot moves, so this needs `Lease-Id`.

    With another robot or instrument than the record's only by its serial number, and for a reason.
    """

    def work() -> JSONResponse:
        here.book.path(run_id)
        here.let_move(
            lease_id,
            lambda lease: here.book.resume(run_id, here.cell, lease, acceptance(body, lease.owner)),
        )
        return accepted(here, run_id)

    asked = (f"{RUNS}/{run_id}/resume", body)
    return here.keys.once(idempotency_key, asked, work)


@router.post(
    "/runs/{run_id}/restation", operation_id="restationRun", status_code=202, response_model=RunResponse
)
def restation_run(
    here: Here, run_id: RunId, body: WhyBody, idempotency_key: IdempotencyKey = "", lease_id: LeaseId = ""
) -> JSONResponse:
    """State that the instrument is moved.

    The nests are measured again before the next pose, or on resuming. A run that continues first asks to set the
    instrument up; its earlier readings keep their world frame. Pause, or order this before the instrument is
    touched.
    """

    def work() -> JSONResponse:
        here.book.get(run_id).restation(by=who(here, lease_id), reason=body.reason)
        return accepted(here, run_id)

    return here.keys.once(idempotency_key, (f"{RUNS}/{run_id}/restation", body), work)


@router.post(
    "/runs/{run_id}/stop",
    operation_id="stopRun",
    tags=[Tag.CORE],
    status_code=202,
    response_model=RunResponse,
)
async def stop_run(here: Here, run_id: RunId) -> JSONResponse:
    """Halt the robot now and end the run. Needs no lease.

    `problems` lists the devices that could not be stopped. The answer comes when the robot has the order, which may
    be a moment before the run has ended.
    """

    def work() -> JSONResponse:
        problems = [problem.as_dict() for problem in here.book.stop(run_id, by=who(here))]
        return accepted(here, run_id, at_once=True, problems=problems)

    return await here.order(run_id, work, stops=True)


@router.post(
    "/runs/{run_id}/dataset",
    operation_id="exportRun",
    tags=[Tag.CORE],
    status_code=201,
    response_model=DatasetShown,
)
def export_run(
    here: Here, run_id: RunId, body: ExportBody, idempotency_key: IdempotencyKey = ""
) -> JSONResponse:
    """Export the readings up to now as a data set.

    `with` adds runs measured later in the same cell, such as a follow-up.
    """

    def work() -> JSONResponse:
        runs = [run_id, *body.later]
        for each in runs:
            here.book.get(each)  # a dry run has none
        records = [here.book.path(each) for each in runs]
        accepting = acceptance(body, who(here))
        dataset = here.workers.call(here.datasets.export, records, body.name, accepting)
        return reply(201, dataset, location=path_of("datasets", dataset["id"]))

    asked = (f"{RUNS}/{run_id}/dataset", body)
    return here.keys.once(idempotency_key, asked, work)


@router.get(
    "/runs/{run_id}/events.jsonl",
    operation_id="downloadEvents",
    response_class=PlainTextResponse,
    responses={200: {"content": {LINES: {"schema": {"type": "string"}}}}},
)
def download_events(here: Here, run_id: RunId) -> PlainTextResponse:
    """Return the events up to now, oldest first, one JSON object per line."""
    here.book.get(run_id)
    with TemporaryDirectory() as folder:
        file = Path(folder) / "events.jsonl"
        here.workers.call(export_events, here.book.path(run_id), file)
        return PlainTextResponse(file.read_text(encoding="utf-8"), media_type=LINES)


def acceptance(body: Resume, by: str) -> DeviceAcceptance | None:
    """Return the other device that a request accepts; None if it accepts none."""
    return DeviceAcceptance(body.accept_other, body.reason, by) if body.accept_other.strip() else None


def who(here: Service, lease_id: str = "") -> str:
    """Return the name under which an order is recorded.

    It is the holder of the lease if the secret of the lease came too.
    """
    held = here.lease.current
    if held is None:
        return "http"
    return held.holder if held.proved_by(lease_id) else f"http ({held.holder} holds the lease)"
