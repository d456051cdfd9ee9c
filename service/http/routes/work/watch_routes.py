"""Watches: check poses planned, readings judged by a baseline, thermal parameters kept up, as `truepose watch` does it.

Nothing here moves the robot: the plan has a campaign, which runs as every campaign does, with lease and gates.
"""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, Query
from fastapi.responses import JSONResponse

from service import history_calls
from service.http.routes.json_route import JsonRoute
from service.http.routes.work.job_routes import shown
from service.http.state import Here, Service
from service.http.wire.bodies.jobs import (
    UpkeepShown,
    UpkeepsShown,
    WatchesShown,
    WatchPlanShown,
    WatchPlansShown,
    WatchShown,
)
from service.http.wire.bodies.watches import (
    BaselineReference,
    ReadingsReference,
    UpkeepAsked,
    WatchPlanAsked,
    WatchRequestBody,
)
from service.http.wire.headers import After, IdempotencyKey, JobId, Wait
from service.http.wire.paths import path_of
from service.http.wire.problems import not_found
from service.http.work.idempotency import begun
from service.kept_dataset import CSV

router = APIRouter(route_class=JsonRoute, tags=["watches"])
PLANS, WATCHES, UPKEEPS = path_of("watch-plans"), path_of("watches"), path_of("upkeeps")
Limit = Annotated[int, Query(ge=1, le=500, description="Number of them, newest first.", examples=[50])]


def _baseline(here: Service, body: BaselineReference) -> tuple[str, bytes]:
    """The id and the document of the model that is judged by. Raises Problem 404, DataError."""
    if body.model_id:
        return body.model_id, here.jobs.model_file(body.model_id).read_bytes()
    content = here.history.ask(history_calls.content, body.model_document)
    if content is None:
        raise not_found("document", body.model_document)
    return body.model_document, content


def _readings(here: Service, body: ReadingsReference) -> dict[str, Any]:
    """The data set to judge; that of a run is made of its readings up to now. Raises Problem 404, RecordError."""
    if body.dataset_id:
        return here.datasets.get(body.dataset_id)
    here.book.get(body.run_id)  # a dry run has none
    return here.workers.call(here.datasets.export, [here.book.path(body.run_id)], "", None)


def _judge(here: Service, kind: str, body: ReadingsReference, more: dict[str, Any]) -> dict[str, Any]:
    baseline = _baseline(here, body)
    dataset = _readings(here, body)
    order = {
        "rate": body.false_alarms,
        "missing_allowed": body.allow_missing,
        "running_s": body.running_s if body.running_s >= 0.0 else None,
        **more,
    }
    data = str(here.datasets.path(dataset["id"]) / CSV)
    return here.jobs.watch(kind, *baseline, dataset["id"], {"data": data, "order": order})


@router.post("/watch-plans", operation_id="createWatchPlan", status_code=202, response_model=WatchPlanShown)
def create_watch_plan(here: Here, body: WatchPlanAsked, idempotency_key: IdempotencyKey = "") -> JSONResponse:
    """Choose check poses in the cell of this service, and say what they will show; nothing moves.

    `result.campaign` visits them: POST it to /runs, then judge the run with POST /watches. Balls that a person touches
    are planned with 'truepose watch plan --touch'.
    """

    def work() -> JSONResponse:
        order = {
            "poses": body.poses,
            "candidates": body.candidates,
            "targets": body.targets,
            "offset_deg": body.offset_deg,
            "both": not body.one_side,
            "rate": body.false_alarms,
            "seed": body.seed,
            "rounds": body.visits,
            "repeats": body.readings,
            "frame_known": not body.new_frame,
        }
        asked = {"cell": here.cell.source, "order": order}
        return begun(PLANS, here.jobs.watch("watch_plan", *_baseline(here, body), "", asked))

    return here.keys.once(idempotency_key, (PLANS, body), work)


@router.get("/watch-plans", operation_id="listWatchPlans", response_model=WatchPlansShown)
def list_watch_plans(here: Here, limit: Limit = 50) -> JSONResponse:
    """The newest plans of watches; `baseline.sha256` is the hash of their model in the history."""
    return JSONResponse({"watch_plans": here.jobs.watches("watch_plan", limit)})


@router.get("/watch-plans/{job_id}", operation_id="getWatchPlan", response_model=WatchPlanShown)
async def get_watch_plan(here: Here, job_id: JobId, wait: Wait = 0, after: After = 0) -> JSONResponse:
    """A plan of a watch; with `wait`, as soon as its version is beyond `after`."""
    return await shown(here, "watch_plan", job_id, wait, after)


@router.post("/watches", operation_id="createWatch", status_code=202, response_model=WatchShown)
def create_watch(here: Here, body: WatchRequestBody, idempotency_key: IdempotencyKey = "") -> JSONResponse:
    """Judge readings of check poses by the model of the calibration: is this still the robot that was calibrated?

    Where a cause is known, GET /models/ID with the id of this job is the updated model; targets are corrected with it
    as with any. The verdict enters the history.
    """

    def work() -> JSONResponse:
        more = {"average": body.average, "frame_known": not body.new_frame}
        return begun(WATCHES, _judge(here, "watch", body, more))

    return here.keys.once(idempotency_key, (WATCHES, body), work)


@router.get("/watches", operation_id="listWatches", response_model=WatchesShown)
def list_watches(here: Here, limit: Limit = 50) -> JSONResponse:
    """The newest watches that were judged here."""
    return JSONResponse({"watches": here.jobs.watches("watch", limit)})


@router.get("/watches/{job_id}", operation_id="getWatch", response_model=WatchShown)
async def get_watch(here: Here, job_id: JobId, wait: Wait = 0, after: After = 0) -> JSONResponse:
    """A watch; with `wait`, as soon as its version is beyond `after`."""
    return await shown(here, "watch", job_id, wait, after)


@router.post("/upkeeps", operation_id="createUpkeep", status_code=202, response_model=UpkeepShown)
def create_upkeep(here: Here, body: UpkeepAsked, idempotency_key: IdempotencyKey = "") -> JSONResponse:
    """Update how warm the arm is by a few readings, between watches; where anything else has changed, nothing is."""

    def work() -> JSONResponse:
        return begun(UPKEEPS, _judge(here, "upkeep", body, {}))

    return here.keys.once(idempotency_key, (UPKEEPS, body), work)


@router.get("/upkeeps", operation_id="listUpkeeps", response_model=UpkeepsShown)
def list_upkeeps(here: Here, limit: Limit = 50) -> JSONResponse:
    """The newest upkeeps that were made here."""
    return JSONResponse({"upkeeps": here.jobs.watches("upkeep", limit)})


@router.get("/upkeeps/{job_id}", operation_id="getUpkeep", response_model=UpkeepShown)
async def get_upkeep(here: Here, job_id: JobId, wait: Wait = 0, after: After = 0) -> JSONResponse:
    """An upkeep; with `wait`, as soon as its version is beyond `after`."""
    return await shown(here, "upkeep", job_id, wait, after)
