"""History of robots, as in `truepose history`: a list, one robot, trends, documents."""

from __future__ import annotations

import hashlib
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Depends, File, Form, Path, Query, UploadFile
from fastapi.responses import JSONResponse, Response

from service import history_calls
from service.http.routes.json_route import JsonRoute
from service.http.state import Here
from service.http.wire.headers import IdempotencyKey
from service.http.wire.paths import path_of
from service.http.wire.problems import Problem, not_found
from service.http.wire.tags import Tag
from service.http.work.idempotency import reply
from service.http.work.paging import LINKED, Paged
from service.ids import plain_name
from service.results.robot_answers import AddResponse, RobotResponse, Robots, Trends

router = APIRouter(route_class=JsonRoute, tags=[Tag.ROBOTS])
DOCUMENTS = path_of("documents")
LARGEST = 16 * 1024 * 1024  # of a document that is sent; a model has 30 kB to a few MB

RobotName = Annotated[
    str,
    Path(
        max_length=200,
        description="The id of a robot, as the list has it; or its serial number, if only one type has it.",
        examples=["3f9a1c07b2e48d15"],
    ),
]
Permitted = Annotated[
    float,
    Query(
        ge=0.0,
        le=1000.0,
        allow_inf_nan=False,
        description="Permitted RMS position error, mm, on which the dates depend. 0: the value of the service.",
        examples=[0.2],
    ),
]
Way = Annotated[
    Literal["staircase", "drift"],
    Query(
        description="Method of ILAC-G24: staircase (longer after good checks), or drift (before the error exceeds the "
        "permitted one).",
        examples=["staircase"],
    ),
]


def _days(words: str, example: float) -> Any:
    return Query(
        ge=1.0, le=36_500.0, allow_inf_nan=False, description=f"{words}, days (no unit).", examples=[example]
    )


First = Annotated[float, _days("Interval before anything is known", 180.0)]
Shortest = Annotated[float, _days("Shortest interval", 7.0)]
Longest = Annotated[float, _days("Longest interval", 1825.0)]


async def _due(
    here: Here,
    permitted_mm: Permitted = 0.0,
    method: Way = "staircase",
    first_days: First = 180.0,
    shortest_days: Shortest = 7.0,
    longest_days: Longest = 1825.0,
) -> dict[str, Any]:
    """Return the settings for dates of checks, as the query has them."""
    return {
        "permitted_mm": permitted_mm or here.history.permitted_mm,
        "method": method,
        "first_days": first_days,
        "shortest_days": shortest_days,
        "longest_days": longest_days,
    }


Due = Annotated[dict[str, Any], Depends(_due)]


@router.get("/robots", operation_id="listRobots", responses=LINKED, response_model=Robots)
def list_robots(
    here: Here,
    due: Due,
    page: Paged,
) -> JSONResponse:
    """List the robots of the history, at most 1,000.

    Each has its state, last verdict and cause, errors, and the date of its next check. Everything that this service
    has measured and found up to now is in it, or in `not_kept` with the reason. With `limit` or `cursor` they are in
    the order of their ids, and `left_out` counts those behind the page.
    """
    here.history.bring()
    found = here.history.ask(history_calls.robots, due, page.after, page.limit)
    more = {"permitted_mm": due["permitted_mm"], "not_kept": here.history.refused()}
    last = found["robots"][-1]["id"] if found["left_out"] else ""
    return JSONResponse(found | more, headers=page.headers(last))


@router.get("/robots/{robot_id}", operation_id="getRobot", response_model=RobotResponse)
def get_robot(
    here: Here,
    robot_id: RobotName,
    due: Due,
    limit: Annotated[
        int, Query(ge=1, le=2000, description="Number of documents, newest first.", examples=[200])
    ] = 200,
) -> JSONResponse:
    """Return one robot: its entry of the list, and its documents with their contents."""
    here.history.bring()
    found = here.history.ask(history_calls.robot, robot_id, due, limit)
    if found is None:
        raise not_found("robot", robot_id)
    own = here.history.here()
    for line in found["history"]:
        line["here"] = own.get(line["document"])
    return JSONResponse(found | {"permitted_mm": due["permitted_mm"]})


@router.get("/robots/{robot_id}/trends", operation_id="getTrends", response_model=Trends)
def get_trends(
    here: Here,
    robot_id: RobotName,
    parameter: Annotated[
        str,
        Query(
            max_length=200,
            description="Its name, as the model has it, or error_rms for the position error. Left out: all.",
            examples=["error_rms"],
        ),
    ] = "",
    limit: Annotated[
        int,
        Query(ge=1, le=2000, description="Number of values of each parameter, the newest.", examples=[200]),
    ] = 200,
) -> JSONResponse:
    """Return the changes of a robot's parameters.

    They are values with U (k = 2), control limits, and the values outside these limits.
    """
    found = here.history.ask(history_calls.trends, robot_id, parameter or None, limit)
    if found is None:
        raise not_found("robot", robot_id)
    return JSONResponse(found)


@router.get("/documents/{document}", operation_id="getDocument", response_class=Response)
def get_document(
    here: Here,
    document: Annotated[
        str,
        Path(
            pattern="^[0-9a-f]{64}$",
            description="SHA-256 of the document.",
            examples=["a93c6fe109b1ae117f0e7f2bb0621db385ac9f84da4fc45fa30a1e73de499bda"],
        ),
    ],
) -> Response:
    """Return a document of the history as it was sent: JSON."""
    found = here.history.ask(history_calls.content, document)
    if found is None:
        raise not_found("document", document)
    return Response(found, media_type="application/json", headers={"X-Content-Type-Options": "nosniff"})


@router.post("/documents", operation_id="addDocument", status_code=201, response_model=AddResponse)
def add_document(
    here: Here,
    file: Annotated[
        UploadFile,
        File(
            description="A model, watch verdict, diagnosis or thermal update as JSON, or the readings of a data set."
        ),
    ],
    toml: Annotated[
        UploadFile | None,
        File(description="The header of the data set, where `file` is its readings.", examples=["DATA.toml"]),
    ] = None,
    serial: Annotated[
        str,
        Form(
            max_length=200,
            description="Serial number, where the document names none.",
            examples=["120-500321"],
        ),
    ] = "",
    idempotency_key: IdempotencyKey = "",
) -> JSONResponse:
    """Keep a document from elsewhere, as `truepose history add` does; the same content once.

    `state` is conflict if the history has another content for the same thing: both are kept, `contradicts` names it.
    """
    name, content = plain_name(file.filename or "document"), file.file.read(LARGEST + 1)
    header = None if toml is None else toml.file.read(LARGEST + 1)

    def work() -> JSONResponse:
        if len(content) + len(header or b"") > LARGEST:
            raise Problem(
                413, "The document is larger than 16 MB.", "Send the document alone, not its readings."
            )
        history = here.history
        whose = (history.name, serial.strip(), history.simulated)
        made = history.ask(history_calls.put, name, content, header, *whose)
        return reply(201, made, location=f"{DOCUMENTS}/{made['added'][0]['document']}")

    hashes = [hashlib.sha256(part).hexdigest() for part in (content, header or b"")]
    return here.keys.once(idempotency_key, (DOCUMENTS, serial, *hashes), work)
