"""Regressions: MLS-SVR beside the models of a data set, in sample and by waypoint, as `truepose regress` does it."""

from __future__ import annotations

from fastapi import APIRouter
from fastapi.responses import JSONResponse

from service.http.routes.json_route import JsonRoute
from service.http.routes.work.job_routes import shown
from service.http.state import Here
from service.http.wire.bodies import RegressionAsked, RegressionShown
from service.http.wire.headers import After, IdempotencyKey, JobId, Wait
from service.http.wire.paths import path_of
from service.http.work.datasets import CSV
from service.http.work.idempotency import begun

router = APIRouter(route_class=JsonRoute, tags=["regressions"])
REGRESSIONS = path_of("regressions")


@router.post("/regressions", operation_id="createRegression", status_code=202, response_model=RegressionShown)
def create_regression(
    here: Here, body: RegressionAsked, idempotency_key: IdempotencyKey = ""
) -> JSONResponse:
    """Compare MLS-SVR with identification on a data set.

    The model that it is based on is saved with the regression, where that gains; its targets are at /models.
    """

    def work() -> JSONResponse:
        dataset = here.datasets.get(body.dataset_id)
        order = {
            "on": body.on,
            "kernel": body.kernel,
            "features": body.features,
            "level": body.level,
            "both": body.compare,
            "diagnosed": body.diagnose,
        }
        return begun(
            REGRESSIONS, here.jobs.regress(dataset, here.datasets.path(body.dataset_id) / CSV, order)
        )

    return here.keys.once(idempotency_key, (REGRESSIONS, body), work)


@router.get("/regressions/{job_id}", operation_id="getRegression", response_model=RegressionShown)
async def get_regression(here: Here, job_id: JobId, wait: Wait = 0, after: After = 0) -> JSONResponse:
    """A regression; with `wait`, as soon as its version is beyond `after`. Its result is that of `regress --json`."""
    return await shown(here, "regression", job_id, wait, after)
