"""Corrected programs, and models in other formats: `truepose compensate` and `export`."""

from __future__ import annotations

from pathlib import Path as FilePath
from typing import Annotated, Any

from fastapi import APIRouter, File, Form, Path, Query, UploadFile

from calib.compensate import Bounds
from service.http.routes.json_route import JsonRoute
from service.http.routes.work.target_routes import refuse
from service.http.state import Here
from service.http.wire.bodies import CorrectedProgram, ExportChoices, ExportKind, ModelExport
from service.http.wire.headers import JobId
from service.http.wire.tags import Tag
from service.http.work.worker_calls import corrected_program, exported, exports_listed

router = APIRouter(route_class=JsonRoute, tags=[Tag.CORRECT])
_CONDITIONS = (
    "For which conditions it shall hold, KEY=VALUE,...: side, approach (deg), temperature (degC), time (s), mass (kg), "
    "cog (mm), series."
)
_BOUNDS = Bounds()
_NAMED_ONLY = "Leave out the carried terms of the model: correct named causes only."
_FRAME = "{} that is not in the program, [NAME=]x,y,z,w,p,r, mm and deg."
Conditions = Annotated[str, Form(max_length=1000, description=_CONDITIONS, examples=["side=below"])]
ExportConditions = Annotated[str, Query(max_length=1000, description=_CONDITIONS, examples=["side=below"])]
LargestDeg = Annotated[
    float,
    Query(
        gt=0.0, le=90.0, description="A model that turns the flange by more is refused, deg.", examples=[2.0]
    ),
]
LargestMm = Annotated[
    float,
    Query(
        gt=0.0,
        le=1000.0,
        description="A model that shifts the flange by more is refused, mm.",
        examples=[15.0],
    ),
]


@router.post("/models/{job_id}/programs", operation_id="correctProgram", response_model=CorrectedProgram)
def correct_program(
    here: Here,
    job_id: JobId,
    program: Annotated[
        UploadFile,
        File(
            description="RAPID .mod, Fanuc .ls, URScript .script, KUKA .src or .dat, Yaskawa .jbi, VAL3 .dtx or "
            "targets .csv; the ending of its name tells the format."
        ),
    ],
    conditions: Conditions = "",
    tool: Annotated[
        list[str], Form(max_length=100, description=_FRAME.format("Tools"), examples=[["0,0,100,0,0,0"]])
    ] = [],  # noqa: B006 (FastAPI copies it)
    frame: Annotated[
        list[str],
        Form(
            max_length=100,
            description=_FRAME.format("Work objects or user frames"),
            examples=[["W=0,0,0,0,0,0"]],
        ),
    ] = [],  # noqa: B006
    pulses: Annotated[
        str,
        Form(
            max_length=1000,
            description="Yaskawa: pulses per degree of every axis, with its sign, P1,P2,...",
            examples=["1432.3,1432.3,1324.5,927.1,1046.0,593.1"],
        ),
    ] = "",
    external_apart: Annotated[
        bool, Form(description="External axes carry neither robot nor work: they are kept.", examples=[False])
    ] = False,
    inverse: Annotated[
        bool, Form(description="From actual to nominal: taught on the real robot.", examples=[False])
    ] = False,
    keep_refused: Annotated[
        bool, Form(description="Answer though some targets stay as they were.", examples=[False])
    ] = False,
    named_only: Annotated[bool, Form(description=_NAMED_ONLY, examples=[False])] = False,
    most_uncertainty_mm: Annotated[
        float,
        Form(
            ge=0.0,
            le=1e4,
            allow_inf_nan=False,
            description="Refuse targets that the model knows less well than this (95 %), mm. With 0, none.",
            examples=[0.2],
        ),
    ] = 0.0,
    largest_deg: LargestDeg = _BOUNDS.turn_deg,
    largest_mm: LargestMm = _BOUNDS.shift_mm,
) -> dict[str, Any]:
    """Correct the targets of a robot program.

    The real robot then lands where the program says; all other text stays. 422 if a target cannot be corrected,
    unless `keep_refused` is true: then it stays as it was.
    """
    order = {
        "conditions": conditions,
        "tool": tool,
        "frame": frame,
        "pulses": pulses,
        "external_apart": external_apart,
        "inverse": inverse,
        "most_uncertainty_mm": most_uncertainty_mm,
        "named_only": named_only,
        "largest_deg": largest_deg,
        "largest_mm": largest_mm,
    }
    name = FilePath((program.filename or "").replace("\\", "/")).name or "program"
    content = program.file.read()
    document, refused = here.file_readers.call(
        corrected_program, here.jobs.model_file(job_id), job_id, name, content, order
    )
    refuse(refused, unless=keep_refused)
    return document


@router.get("/models/{job_id}/exports", operation_id="listExports", response_model=ExportChoices)
def list_exports(
    here: Here,
    job_id: JobId,
    conditions: ExportConditions = "",
    named_only: Annotated[bool, Query(description=_NAMED_ONLY, examples=[False])] = False,
    largest_deg: LargestDeg = _BOUNDS.turn_deg,
    largest_mm: LargestMm = _BOUNDS.shift_mm,
) -> dict[str, Any]:
    """Return what every format of an export carries, what it leaves out, and the error it leaves.

    `left_mm` of a format is the `predicted_rms_mm` of its file.
    """
    order = {
        "conditions": conditions,
        "named_only": named_only,
        "largest_deg": largest_deg,
        "largest_mm": largest_mm,
        "verified_rms_mm": here.verifications.verified_rms_mm(job_id),
    }
    return here.workers.call(exports_listed, here.jobs.model_file(job_id), job_id, order)


@router.get("/models/{job_id}/exports/{kind}", operation_id="exportModel", response_model=ModelExport)
def export_model(
    here: Here,
    job_id: JobId,
    kind: Annotated[ExportKind, Path(description="Format of the exported model.", examples=["urdf"])],
    conditions: ExportConditions = "",
    robot_hash: Annotated[
        str,
        Query(
            max_length=200, description="ur-yaml: the robot's own calibration hash.", examples=["calib_123"]
        ),
    ] = "",
    named_only: Annotated[bool, Query(description=_NAMED_ONLY, examples=[False])] = False,
    largest_deg: LargestDeg = _BOUNDS.turn_deg,
    largest_mm: LargestMm = _BOUNDS.shift_mm,
) -> dict[str, Any]:
    """Return the model in another program's format.

    `text` is the file; the rest states the parts that this format leaves out.
    """
    order = {
        "conditions": conditions,
        "robot_hash": robot_hash,
        "named_only": named_only,
        "largest_deg": largest_deg,
        "largest_mm": largest_mm,
        "verified_rms_mm": here.verifications.verified_rms_mm(job_id),
    }
    return here.workers.call(exported, here.jobs.model_file(job_id), job_id, kind, order)
