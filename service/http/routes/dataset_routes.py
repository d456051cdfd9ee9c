"""Data sets: uploaded, listed, given back."""

from __future__ import annotations

import hashlib
from typing import Annotated, Any

from fastapi import APIRouter, File, Form, UploadFile
from fastapi.responses import FileResponse, JSONResponse, Response

from service.http.routes.json_route import JsonRoute
from service.http.state import Here
from service.http.wire.bodies import (
    DatasetList,
    DatasetMapped,
    DatasetShown,
    MapProposalShown,
)
from service.http.wire.headers import DatasetId, IdempotencyKey
from service.http.wire.paths import path_of
from service.http.wire.tags import Tag
from service.http.work.idempotency import reply
from service.http.work.paging import LINKED, Paged
from service.http.work.proposals import proposed
from service.kept_dataset import CSV, TOML

router = APIRouter(route_class=JsonRoute, tags=[Tag.DATA])
DATASETS = path_of("datasets")
ForeignFiles = Annotated[
    list[UploadFile],
    File(
        description="The file of another program (text or .xlsx), or one with joints and one with points.",
        min_length=1,
        max_length=2,
        examples=[["joints.txt", "points.csv"]],
    ),
]


@router.post(
    "/datasets", operation_id="uploadDataset", tags=[Tag.CORE], status_code=201, response_model=DatasetShown
)
def upload_dataset(
    here: Here,
    csv: Annotated[UploadFile, File(description="DATA.csv: the readings.")],
    toml: Annotated[UploadFile, File(description="DATA.toml: their header.")],
    name: Annotated[str, Form(max_length=200, description="A name for people.", examples=["night 1"])] = "",
    idempotency_key: IdempotencyKey = "",
) -> JSONResponse:
    """Upload a data set: both files, refused with line or key where they cannot be used."""
    table, header = csv.file.read(), toml.file.read()

    def work() -> JSONResponse:
        dataset = here.file_readers.call(here.datasets.upload, table, header, name)
        return reply(201, dataset, location=f"{DATASETS}/{dataset['id']}")

    # The files count, not the body: its boundaries differ every time it is sent.
    hashes = [hashlib.sha256(part).hexdigest() for part in (table, header)]
    return here.keys.once(idempotency_key, (DATASETS, name, *hashes), work)


@router.post(
    "/datasets/mapped", operation_id="uploadMappedDataset", status_code=201, response_model=DatasetMapped
)
def upload_mapped(
    here: Here,
    files: ForeignFiles,
    map_file: Annotated[
        UploadFile,
        File(
            alias="map",
            description="MAP.toml: what its columns are, as `truepose convert --propose` writes it.",
        ),
    ],
    name: Annotated[str, Form(max_length=200, description="A name for people.", examples=["night 1"])] = "",
    idempotency_key: IdempotencyKey = "",
) -> JSONResponse:
    """Upload files of another program with their map.

    They become a data set, or are refused as `truepose convert` refuses them.
    """
    given = [(each.filename or "", each.file.read()) for each in files]
    text = map_file.file.read()

    def work() -> JSONResponse:
        dataset = here.file_readers.call(here.datasets.upload_mapped, given, text, name)
        return reply(201, dataset, location=f"{DATASETS}/{dataset['id']}")

    hashes = [hashlib.sha256(part).hexdigest() for part in (*(content for _, content in given), text)]
    return here.keys.once(idempotency_key, (DATASETS, "mapped", name, *hashes), work)


@router.post("/proposals", operation_id="proposeMap", response_model=MapProposalShown)
def propose_map(
    here: Here,
    files: ForeignFiles,
    robot: Annotated[
        str,
        Form(
            max_length=200,
            description="The built-in robot that was measured, empty if it is not known yet.",
            examples=["ur5"],
        ),
    ] = "",
    answer: Annotated[
        list[str],
        Form(
            max_length=200,
            description="Answers KEY=CHOICE, as --answer of the command; column.NAME=CHOICE states a meaning.",
            examples=[["unit.points=mm", "column.Remark=leave"]],
        ),
    ] = [],  # noqa: B006 (FastAPI copies it)
) -> Response:
    """Propose a map for files of another program, and ask what they do not show.

    Nothing is kept. Send the files again with answers until `complete` is true, then with `map_text` to
    /datasets/mapped.
    """
    content = here.file_readers.call(
        proposed, [(each.filename or "", each.file.read()) for each in files], robot, answer
    )
    return Response(content, media_type=JSONResponse.media_type)


@router.get("/datasets", operation_id="listDatasets", responses=LINKED, response_model=DatasetList)
async def list_datasets(here: Here, page: Paged) -> Response:
    """List every data set, newest first."""
    return await here.listed("datasets", page, here.datasets.ids, here.datasets.get)


@router.get("/datasets/{dataset_id}", operation_id="getDataset", response_model=DatasetShown)
def get_dataset(here: Here, dataset_id: DatasetId) -> dict[str, Any]:
    """Return the content of a data set. Its files are below it."""
    return here.datasets.get(dataset_id)


@router.get("/datasets/{dataset_id}/data.csv", operation_id="downloadDatasetCsv", response_class=FileResponse)
def download_csv(here: Here, dataset_id: DatasetId) -> FileResponse:
    """Return the readings."""
    return FileResponse(here.datasets.path(dataset_id) / CSV, media_type="text/csv; charset=utf-8")


@router.get(
    "/datasets/{dataset_id}/data.toml", operation_id="downloadDatasetToml", response_class=FileResponse
)
def download_toml(here: Here, dataset_id: DatasetId) -> FileResponse:
    """Return the header of the readings."""
    return FileResponse(here.datasets.path(dataset_id) / TOML, media_type="application/toml")
