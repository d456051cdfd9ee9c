"""Alignments: two uploaded streams of a moving robot are synchronised into a data set."""

from __future__ import annotations

import hashlib
from dataclasses import asdict
from typing import Annotated, Any

from fastapi import APIRouter, File, Form, UploadFile
from fastapi.responses import JSONResponse

from calib.arm import built_in_robots
from calib.errors import DataError
from service.http.routes.json_route import JsonRoute
from service.http.state import Here
from service.http.wire.bodies import AlignmentShown
from service.http.wire.headers import IdempotencyKey
from service.http.wire.paths import path_of
from service.http.wire.tags import Tag
from service.http.work.idempotency import begun
from service.job_folder import ROBOT, TRACKER
from service.results.files.alignment_request import (
    FARTHEST_TOOL_MM,
    HOLDOUT,
    SEED,
    SLOW_MM_S,
    AlignmentRequest,
)

router = APIRouter(route_class=JsonRoute, tags=[Tag.DATA])
ALIGNMENTS = path_of("alignments")


def _millimetres(axis: str) -> Any:
    return Form(
        ge=-FARTHEST_TOOL_MM,
        le=FARTHEST_TOOL_MM,
        allow_inf_nan=False,
        description=f"{axis} of the target on the flange, mm.",
        examples=[100.0],
    )


def _text(description: str, example: str, longest: int = 200) -> Any:
    return Form(max_length=longest, description=description, examples=[example])


_COLUMNS = "{} of other names, NAME=COLUMN,..., as --{}-columns of the command."


@router.post("/alignments", operation_id="createAlignment", status_code=202, response_model=AlignmentShown)
def create_alignment(
    here: Here,
    robot_csv: Annotated[UploadFile, File(description="ROBOT.csv: the robot's joints by its clock")],
    tracker_csv: Annotated[UploadFile, File(description="TRACKER.csv: points by the instrument's clock")],
    robot: Annotated[str, _text("The name of a built-in robot.", "ur5")],
    tool_x_mm: Annotated[float, _millimetres("x")],
    tool_y_mm: Annotated[float, _millimetres("y")],
    tool_z_mm: Annotated[float, _millimetres("z")],
    tool_known: Annotated[
        bool,
        Form(description="Whether that place is exact. Otherwise it is fitted as well.", examples=[False]),
    ] = False,
    slower_than_mm_s: Annotated[
        float,
        Form(
            gt=0.0,
            le=1e5,
            allow_inf_nan=False,
            description="Samples slower than this are at rest, mm/s.",
            examples=[1.0],
        ),
    ] = SLOW_MM_S,
    coupling: Annotated[str, _text("How the controller counts coupled joints.", "none")] = "none",
    instrument: Annotated[str, _text("The instrument, for the data set.", "leica-at960")] = "unknown",
    sigma_mm: Annotated[
        float | None,
        Form(
            gt=0.0,
            le=1e4,
            allow_inf_nan=False,
            examples=[0.02],
            description="The instrument's uncertainty, 1 sigma of one coordinate, mm: no row has less.",
        ),
    ] = None,
    robot_columns: Annotated[
        str, _text(_COLUMNS.format("Columns of ROBOT.csv", "robot"), "t_s=time", 2000)
    ] = "",
    tracker_columns: Annotated[
        str, _text(_COLUMNS.format("Columns of TRACKER.csv", "tracker"), "t_s=time", 2000)
    ] = "",
    every_sample: Annotated[
        bool,
        Form(
            description="A row for every sample at rest, not one per stationary interval.", examples=[False]
        ),
    ] = False,
    holdout: Annotated[
        float,
        Form(
            ge=0.0, lt=1.0, allow_inf_nan=False, description="Share of rows that only judge.", examples=[0.2]
        ),
    ] = HOLDOUT,
    seed: Annotated[int, Form(ge=0, le=2**32, description="Draws them; no unit.", examples=[1])] = SEED,
    name: Annotated[str, _text("A name for the data set.", "night 1")] = "",
    idempotency_key: IdempotencyKey = "",
) -> JSONResponse:
    """Align two streams of a moving robot.

    Its stationary intervals become a data set: `dataset_id` of the job, once it has succeeded.
    """
    if robot not in built_in_robots():  # a path would be looked for among the server's files
        raise DataError(f"is '{robot}'.", do=f"Use {', '.join(built_in_robots())}.", key="robot")
    order = AlignmentRequest(
        tool=(tool_x_mm, tool_y_mm, tool_z_mm),
        robot=robot,
        tool_known=tool_known,
        slower_than=slower_than_mm_s,
        coupling=coupling,
        instrument=instrument,
        sigma_mm=sigma_mm,
        robot_columns=robot_columns or None,
        tracker_columns=tracker_columns or None,
        every_sample=every_sample,
        holdout=holdout,
        seed=seed,
    )
    streams = robot_csv.file.read(), tracker_csv.file.read()

    def work() -> JSONResponse:
        asked = {"name": name or "alignment", "order": asdict(order)}
        files: dict[str, bytes] = dict(zip((ROBOT, TRACKER), streams, strict=True))
        return begun(ALIGNMENTS, here.jobs.add("alignment", asked, files))

    # The files count, not the body: its boundaries differ every time it is sent.
    hashes = [hashlib.sha256(part).hexdigest() for part in streams]
    return here.keys.once(idempotency_key, (ALIGNMENTS, asdict(order), name, *hashes), work)
