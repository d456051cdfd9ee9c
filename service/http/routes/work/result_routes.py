"""The results of jobs: their models, reports, pictures, certificates and errors in space."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, Query
from fastapi.responses import HTMLResponse, JSONResponse, Response

from service.http.routes.json_route import JsonRoute
from service.http.state import Here
from service.http.wire.bodies import JobsShown, ModelShown, ResultShown
from service.http.wire.headers import DatasetId, JobId
from service.http.wire.tags import Tag
from service.http.work.certifying import certificate_of
from service.http.work.paging import LINKED, Paged
from service.results.cell.arrows import ArrowsShown

router = APIRouter(route_class=JsonRoute)
# A report is complete in itself; whatever its data say, a browser runs and loads nothing for it.
REPORT_HEADERS = {
    "Content-Security-Policy": "default-src 'none'; style-src 'unsafe-inline'; img-src data:; sandbox",
    "X-Content-Type-Options": "nosniff",
}


@router.get(
    "/datasets/{dataset_id}/jobs",
    operation_id="listDatasetJobs",
    responses=LINKED,
    tags=[Tag.DATA],
    response_model=JobsShown,
)
async def list_dataset_jobs(here: Here, dataset_id: DatasetId, page: Paged) -> Response:
    """The jobs of a data set: its identifications, diagnoses and regressions, newest first."""

    def found() -> dict[str, str]:
        here.datasets.get(dataset_id)
        return here.jobs.of_dataset(dataset_id)

    kinds = await here.listing(f"kinds of {dataset_id}", found)
    return await here.listed("jobs", page, lambda: kinds, lambda name: here.jobs.document(kinds[name], name))


@router.get("/models/{job_id}", operation_id="getModel", tags=[Tag.DIAGNOSE], response_model=ModelShown)
def get_model(here: Here, job_id: JobId) -> JSONResponse:
    """The model that an identification or a diagnosis has found (`truepose-model/1`)."""
    return JSONResponse(here.jobs.model(job_id))


@router.get("/results/{result_id}", operation_id="getResult", tags=[Tag.DIAGNOSE], response_model=ResultShown)
def get_result(here: Here, result_id: JobId) -> dict[str, Any]:
    """Return a job of any kind, a closed loop or a verification; `kind` names which."""
    return here.result(result_id)


@router.get(
    "/results/{job_id}/arrows", operation_id="getArrows", tags=[Tag.DIAGNOSE], response_model=ArrowsShown
)
def get_arrows(here: Here, job_id: JobId) -> dict[str, Any]:
    """The errors of an identification or a diagnosis in space, before and after: at most 500 readings, held out."""
    return here.jobs.arrows(job_id)


@router.get(
    "/reports/{job_id}", operation_id="getReport", tags=[Tag.DIAGNOSE, Tag.CORE], response_class=HTMLResponse
)
def get_report(here: Here, job_id: JobId) -> HTMLResponse:
    """The report of an identification, a diagnosis or a validation: one HTML page that loads nothing."""
    return HTMLResponse(here.jobs.report(job_id), headers=REPORT_HEADERS)


def _about(description: str, example: str) -> Any:
    return Query(max_length=200, description=description, examples=[example])


@router.get(
    "/results/{job_id}/certificate.xml",
    operation_id="getCertificate",
    tags=[Tag.CORRECT],
    response_class=Response,
)
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
