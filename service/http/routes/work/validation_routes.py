"""Validations: a model judged on readings that took no part, as `truepose validate` does it."""

from __future__ import annotations

from dataclasses import asdict

from fastapi import APIRouter
from fastapi.responses import JSONResponse

from service.http.routes.json_route import JsonRoute
from service.http.routes.work.job_routes import shown
from service.http.state import Here
from service.http.wire.bodies import ValidationAsked, ValidationShown
from service.http.wire.headers import After, IdempotencyKey, JobId, Wait
from service.http.wire.paths import path_of
from service.http.wire.problems import Problem
from service.http.work.idempotency import begun
from service.kept_dataset import CSV

router = APIRouter(route_class=JsonRoute, tags=["validations"])
VALIDATIONS = path_of("validations")


@router.post("/validations", operation_id="createValidation", status_code=202, response_model=ValidationShown)
def create_validation(
    here: Here, body: ValidationAsked, idempotency_key: IdempotencyKey = ""
) -> JSONResponse:
    """Judge a saved model on a data set; without a model compare kinds of hold-out of the data set."""

    def work() -> JSONResponse:
        dataset = here.datasets.get(body.dataset_id)
        limits = body.limits
        model = here.jobs.model_file(body.model_id) if body.model_id else None
        if model is None and (limits or body.place or body.everything or body.compare_id or body.point):
            raise Problem(
                422,
                "place, everything, compare_id, point and limits go with a model.",
                "Give model_id, or leave them out.",
            )
        order = {
            "place": body.place,
            "everything": body.everything,
            "compare": {"id": body.compare_id, "file": str(here.jobs.model_file(body.compare_id))}
            if body.compare_id
            else None,
            "point": body.point or None,
            "limits": None if limits is None else asdict(limits),
        }
        return begun(
            VALIDATIONS, here.jobs.validate(dataset, here.datasets.path(body.dataset_id) / CSV, model, order)
        )

    return here.keys.once(idempotency_key, (VALIDATIONS, body), work)


@router.get("/validations/{job_id}", operation_id="getValidation", response_model=ValidationShown)
async def get_validation(here: Here, job_id: JobId, wait: Wait = 0, after: After = 0) -> JSONResponse:
    """A validation; with `wait`, as soon as its version is beyond `after`."""
    return await shown(here, "validation", job_id, wait, after)
