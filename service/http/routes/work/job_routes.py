"""Identifications, diagnoses and their reports."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, Query
from fastapi.responses import HTMLResponse, JSONResponse, Response

from service.files import as_json
from service.http.routes.json_route import JsonRoute
from service.http.state import Here, Service
from service.http.wire.bodies import (
    DiagnosisShown,
    IdentificationShown,
    JobsShown,
    ModelShown,
    ToDiagnose,
    ToFit,
    ToIdentify,
)
from service.http.wire.headers import After, DatasetId, IdempotencyKey, JobId, Wait
from service.http.wire.paths import path_of
from service.http.wire.plan_bodies import ArrowsShown, ResultShown
from service.http.wire.problems import not_found
from service.http.work.certifying import certificate_of
from service.http.work.idempotency import begun
from service.kept_dataset import CSV

router = APIRouter(route_class=JsonRoute, tags=["results"])
# A report is complete in itself; whatever its data say, a browser runs and loads nothing for it.
REPORT_HEADERS = {
    "Content-Security-Policy": "default-src 'none'; style-src 'unsafe-inline'; img-src data:; sandbox",
    "X-Content-Type-Options": "nosniff",
}


def _add(
    here: Service, kind: str, collection: str, body: ToFit, key: str, carry_to: str = ""
) -> JSONResponse:
    def work() -> JSONResponse:
        dataset, options = here.datasets.get(body.dataset_id), body.options
        if carry_to:
            here.datasets.get(carry_to)  # refused where there is none
            options |= {"carry_to": str(here.datasets.path(carry_to) / CSV)}
        path = here.datasets.path(body.dataset_id) / CSV
        prior = as_json(body.prior).encode() if body.prior else None
        job = here.jobs.add(kind, dataset, path, here.settings.cell, body.limits, prior=prior, **options)
        return begun(path_of(collection), job)

    return here.keys.once(key, (collection, body), work)


async def shown(here: Service, kind: str, name: str, wait: int, after: int) -> JSONResponse:
    """The document of a job; with `wait`, s, as soon as its version is beyond `after`.

    As it was kept: a result of an older version is given back whatever this one would say of it.
    """

    def read() -> dict[str, Any]:
        return here.jobs.document(kind, name)

    what = f"{kind} {name}"
    document = await here.reading(what, read)
    if wait and document["version"] <= after and document["state"] not in ("succeeded", "failed"):
        await here.changed(what, lambda seconds: here.jobs.wait(kind, name, after, seconds), after, wait)
        document = await here.reading(what, read)
    return JSONResponse(document)


@router.post(
    "/identifications",
    operation_id="createIdentification",
    status_code=202,
    response_model=IdentificationShown,
)
def create_identification(here: Here, body: ToIdentify, idempotency_key: IdempotencyKey = "") -> JSONResponse:
    """Identify the robot of a data set, and hold the error on readings held out to limits where there are some."""
    return _add(here, "identification", "identifications", body, idempotency_key)


@router.get("/identifications/{job_id}", operation_id="getIdentification", response_model=IdentificationShown)
async def get_identification(here: Here, job_id: JobId, wait: Wait = 0, after: After = 0) -> JSONResponse:
    """An identification; with `wait`, as soon as its version is beyond `after`."""
    return await shown(here, "identification", job_id, wait, after)


@router.post("/diagnoses", operation_id="createDiagnosis", status_code=202, response_model=DiagnosisShown)
def create_diagnosis(here: Here, body: ToDiagnose, idempotency_key: IdempotencyKey = "") -> JSONResponse:
    """Identify the robot of a data set and find what its model lacks.

    The error on readings held out is held to limits where there are some: `result.acceptance`.
    Where something is ambiguous, `result.follow_up` holds a campaign that decides it, within the cell of this
    service: POST it to /runs.
    """
    return _add(here, "diagnosis", "diagnoses", body, idempotency_key, body.carry_to)


@router.get("/diagnoses/{job_id}", operation_id="getDiagnosis", response_model=DiagnosisShown)
async def get_diagnosis(here: Here, job_id: JobId, wait: Wait = 0, after: After = 0) -> JSONResponse:
    """A diagnosis; with `wait`, as soon as its version is beyond `after`."""
    return await shown(here, "diagnosis", job_id, wait, after)


@router.get("/datasets/{dataset_id}/jobs", operation_id="listDatasetJobs", response_model=JobsShown)
def list_dataset_jobs(here: Here, dataset_id: DatasetId) -> JSONResponse:
    """The jobs of a data set: its identifications, diagnoses and regressions, newest first."""
    here.datasets.get(dataset_id)
    return JSONResponse({"jobs": here.jobs.of_dataset(dataset_id)})


@router.get("/models/{job_id}", operation_id="getModel", response_model=ModelShown)
def get_model(here: Here, job_id: JobId) -> JSONResponse:
    """The model that an identification or a diagnosis has found (`truepose-model/1`)."""
    return JSONResponse(here.jobs.model(job_id))


@router.get("/results/{result_id}", operation_id="getResult", response_model=ResultShown)
def get_result(here: Here, result_id: JobId) -> dict[str, Any]:
    """A job of any kind, or a closed loop, for whoever has its id alone; `kind` says which of them it is."""
    kind = here.jobs.kind_of(result_id)
    if kind is not None:
        return here.jobs.document(kind, result_id)
    if result_id not in here.loops.ids():
        raise not_found("result", result_id)
    return here.loops.document(result_id) | {"kind": "loop"}


@router.get("/results/{job_id}/arrows", operation_id="getArrows", response_model=ArrowsShown)
def get_arrows(here: Here, job_id: JobId) -> dict[str, Any]:
    """The errors of an identification or a diagnosis in space, before and after: at most 500 readings, held out."""
    return here.jobs.arrows(job_id)


@router.get("/reports/{job_id}", operation_id="getReport", response_class=HTMLResponse)
def get_report(here: Here, job_id: JobId) -> HTMLResponse:
    """The report of an identification, a diagnosis or a validation: one HTML page that loads nothing."""
    return HTMLResponse(here.jobs.report(job_id), headers=REPORT_HEADERS)


def _about(description: str, example: str) -> Any:
    return Query(max_length=200, description=description, examples=[example])


@router.get("/results/{job_id}/certificate.xml", operation_id="getCertificate", response_class=Response)
def get_certificate(
    here: Here,
    job_id: JobId,
    laboratory: Annotated[str, _about("Who calibrates; left out: not stated.", "Cell 7, ACME")] = "",
    city: Annotated[str, _about("Where that is.", "Ulm")] = "",
    country: Annotated[str, _about("Its country, two letters (ISO 3166-1).", "DE")] = "",
    customer: Annotated[str, _about("For whom.", "ACME")] = "",
    responsible: Annotated[str, _about("The person who is responsible.", "Anna Ruf")] = "",
) -> Response:
    """A digital calibration certificate of an identification or a diagnosis: XML after the schema of the PTB (3.3.0).

    422 where the data set does not say when it was measured. Its number is that of the report.
    """
    told = {
        "laboratory": laboratory,
        "city": city,
        "country": country,
        "customer": customer,
        "responsible": responsible,
    }
    about = {name: text for name, text in told.items() if text}
    text = here.workers.call(certificate_of, here.jobs.certified(job_id), about)
    return Response(text, media_type="application/xml", headers={"X-Content-Type-Options": "nosniff"})
