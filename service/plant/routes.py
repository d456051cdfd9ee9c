"""The routes of a fleet's server.

The answers of a fleet's server, as OpenAPI describes them. Times are RFC 3339, UTC.
"""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Sequence
from datetime import datetime, timedelta
from importlib.metadata import version
from typing import Annotated

import anyio.to_thread
from fastapi import APIRouter, Depends, Query, Request
from fastapi import Path as InPath
from pydantic import BaseModel, ConfigDict, Field
from starlette.requests import ClientDisconnect
from starlette.responses import JSONResponse, Response

from fleet.store import AddResult, Document, DocumentSummary, FleetStore, Kind, RobotKey, RobotSummary
from service.http.access.gate import bearer
from service.http.wire.problems import Problem
from service.plant.own_tokens import Senders


class Acknowledgement(BaseModel):
    """The acknowledgement of a document: it survives a power cut of the server."""

    hash: str = Field(description="SHA-256 of the content that was kept.")
    state: str = Field(description="new, or known where the server had it.")


class DocumentShown(BaseModel):
    """A document of a list."""

    hash: str = Field(description="SHA-256 of the content.")
    kind: str = Field(description="model, watch, campaign, dataset, diagnosis or thermal.")
    serial: str = Field(description="Serial number of the robot.")
    model: str = Field(description="Type of the robot.")
    cell: str = Field(description="The cell that sent it.")
    identity: str = Field(description="Identity of the thing that it describes.")
    measured_at: datetime
    added_at: datetime
    program: str = Field(description="Version that wrote it; empty if it is not stated.")
    size: int = Field(description="Bytes.")
    conflict: bool = Field(description="Whether another content was sent for the same identity.")

    @classmethod
    def of(cls, entry: DocumentSummary) -> DocumentShown:
        """Return the document of an entry."""
        return cls(
            hash=entry.hash,
            kind=entry.kind,
            serial=entry.robot.serial,
            model=entry.robot.model,
            cell=entry.cell,
            identity=entry.identity,
            measured_at=entry.measured_at,
            added_at=entry.added_at,
            program=entry.program,
            size=entry.size,
            conflict=entry.conflict,
        )


class DocumentsShown(BaseModel):
    """Documents, newest first."""

    documents: Sequence[DocumentShown]


class FleetRobotResponse(BaseModel):
    """A robot that documents were sent of."""

    serial: str
    model: str
    cells: Sequence[str]
    documents: dict[str, int] = Field(description="How many of each kind.")
    last: datetime = Field(description="When the last was measured.")

    @classmethod
    def of(cls, known: RobotSummary) -> FleetRobotResponse:
        """Return the document of a robot."""
        return cls(
            serial=known.robot.serial,
            model=known.robot.model,
            cells=known.cells,
            documents={str(kind): count for kind, count in known.documents.items()},
            last=known.last,
        )


class RobotsShown(BaseModel):
    """All robots."""

    robots: Sequence[FleetRobotResponse]


class PointShown(BaseModel):
    """One value of a parameter."""

    model_config = ConfigDict(from_attributes=True)

    measured_at: datetime
    parameter: str
    value: float
    u: float | None = Field(description="Expanded uncertainty, k = 2; null where the model states none.")
    unit: str
    hash: str = Field(description="The document that has it; of a re-diagnosis the data set.")
    program: str = Field(description="Version that says it.")
    rediagnosed: bool = Field(description="Whether a re-diagnosis says it, in place of the cell's own model.")


class FleetTrendResponse(BaseModel):
    """The values of parameters over time, by name and time."""

    serial: str
    model: str
    points: Sequence[PointShown]


class HealthShown(BaseModel):
    """Health of the server."""

    status: str
    version: str


router = APIRouter()
UPLOADS = 16  # in hand; each may be a body in memory
SHARE = 2  # of these for one sender: a cell sends one after another, and may begin again before the last has ended here
PIECE_S = 60.0  # a client that sends nothing for so long has gone
UPLOAD_S = 600.0  # for a whole document: 32 MB at half a megabit a second
AHEAD = timedelta(days=1)  # by which a cell's clock may go before the server's
BUSY_S = 2
MOST = 10_000  # documents of one list
_CONFLICT = 8610
_DAMAGED = 8611
_OTHER_ROBOT = 8612


async def _store(request: Request) -> FleetStore:
    return request.app.state.store


Here = Annotated[FleetStore, Depends(_store)]

Hash = Annotated[
    str, InPath(pattern="^[0-9a-f]{64}$", description="SHA-256 of the content, 64 hexadecimal digits.")
]


@router.get("/health", response_model=HealthShown)
async def health() -> HealthShown:
    """Confirm that the server answers; says nothing of its store."""
    return HealthShown(status="ok", version=version("truepose"))


@router.put("/documents/{hash}", response_model=Acknowledgement, status_code=201)
async def put_document(
    request: Request,
    store: Here,
    hash: Hash,
    kind: Annotated[Kind, Query(description="Kind of document.")],
    serial: Annotated[str, Query(description="Serial number of the robot.")],
    model: Annotated[str, Query(description="Type of the robot.")],
    cell: Annotated[
        str,
        Query(
            description="The cell that made it. A token of one cell overrides it by the name of that cell."
        ),
    ],
    identity: Annotated[str, Query(description="Identity of the thing that it describes.")],
    measured_at: Annotated[
        datetime, Query(description="When its first reading was taken, with a time zone.")
    ],
) -> Response:
    """Keep a document; the body is its content. Sent again, it is kept once.

    409 if the store has another content for the same identity. Both are then kept, and every upload of either is
    answered so, because an answer may be lost.
    """
    senders: Senders = request.app.state.senders
    own = senders.own(bearer(request.headers.get("authorization", "")))
    robot = RobotKey(serial, model)
    if own is not None:
        cell = own.name
        if own.robots and robot not in own.robots:
            raise Problem(
                403,
                f"The token of '{cell}' does not name the robot {model}:{serial}.",
                "Let it name that robot (truepose fleet token allow). Then send again (truepose fleet outbox retry).",
                code=_OTHER_ROBOT,
            )
    _refuse_ahead(measured_at, request.app.state.now())
    # A client with the shared token may give any name; its address then distinguishes it too.
    sender = cell if own else f"{cell} at {request.client.host if request.client else ''}"
    uploads: Counter[str] = request.app.state.uploads
    if uploads.total() >= UPLOADS or uploads[sender] >= SHARE:
        raise Problem(
            503,
            "Too many documents are being sent.",
            "Nothing: it is sent again by itself.",
            headers={"Retry-After": str(BUSY_S)},
        )
    uploads[sender] += 1
    try:
        content = await _whole(request)
        if content is None:
            return Response(status_code=400)  # no client hears it
        document = Document(kind, robot, cell, identity, measured_at, content)
        added = await anyio.to_thread.run_sync(_added, store, document, hash)
    finally:
        uploads[sender] -= 1
        if not uploads[sender]:
            del uploads[sender]  # names would pile up
    if added.other_hashes:
        raise Problem(
            409,
            f"Another content was sent for '{identity}': {', '.join(added.other_hashes)}, and this one is {hash}.",
            "Both are kept. Find out which is right: the record of the cell is the truth.",
            code=_CONFLICT,
            hash=hash,
            other_hashes=list(added.other_hashes),
            kept=True,
        )
    shown = Acknowledgement(hash=added.hash, state=added.state)
    return JSONResponse(shown.model_dump(), 201 if added.state == "new" else 200)


@router.get("/documents", response_model=DocumentsShown)
def list_documents(
    store: Here,
    serial: Annotated[str, Query(description="Of this robot; with `model`.")] = "",
    model: Annotated[str, Query(description="Type of the robot.")] = "",
    kind: Annotated[Kind | None, Query(description="Of this kind.")] = None,
    since: Annotated[datetime | None, Query(description="Measured then or later, with a time zone.")] = None,
    limit: Annotated[
        int, Query(ge=1, le=MOST, description="Largest number of documents; the newest are listed.")
    ] = 1000,
) -> DocumentsShown:
    """List the newest documents, newest first."""
    if since is not None and since.tzinfo is None:
        raise Problem(422, "since: has no time zone.", "Give a time such as 2026-03-02T09:15:00Z.")
    robot = _robot(store, serial, model) if serial else None
    found = store.documents(robot, kind, since, limit)
    return DocumentsShown(documents=[DocumentShown.of(entry) for entry in found])


@router.get("/documents/{hash}", response_class=Response)
def get_document(store: Here, hash: Hash) -> Response:
    """Return the content of a document, byte for byte."""
    if not store.known([hash]):
        raise Problem(404, f"There is no document {hash}.", "List the documents to see which there are.")
    return Response(
        store.content(hash),
        media_type="application/octet-stream",
        headers={"X-Content-Type-Options": "nosniff"},
    )


@router.get("/robots", response_model=RobotsShown)
def list_robots(store: Here) -> RobotsShown:
    """List all robots of which documents were sent."""
    return RobotsShown(robots=[FleetRobotResponse.of(known) for known in store.robots()])


@router.get("/robots/{serial:path}/trend", response_model=FleetTrendResponse)
def get_trend(
    store: Here,
    serial: str,
    model: Annotated[str, Query(description="Type, where two robots have one serial number.")] = "",
    parameter: Annotated[
        str | None, Query(description="This one (left out: all).", examples=["theta2"])
    ] = None,
) -> FleetTrendResponse:
    """Return the values of a robot's parameters over time, with U."""
    robot = _robot(store, serial, model)
    points = [PointShown.model_validate(point) for point in store.trend(robot, parameter)]
    return FleetTrendResponse(serial=robot.serial, model=robot.model, points=points)


def _added(store: FleetStore, document: Document, hash: str) -> AddResult:
    """Keep a document.

    Raises
    ------
    Problem
        400: its content does not have the stated hash.
    """
    if document.hash != hash:
        raise Problem(
            400,
            f"The content that arrived has the hash {document.hash}, not {hash}.",
            "Send it again; nothing was kept.",
            code=_DAMAGED,
        )
    return store.add(document)


def _refuse_ahead(measured_at: datetime, now: datetime) -> None:
    """Refuse a time in the future, because such a document would be a robot's newest until then.

    A document may be of any age: outboxes wait for weeks, and old measurements are sent once.

    Raises
    ------
    Problem
        422: the time is in the future.
    """
    if measured_at.tzinfo is not None and measured_at - now > AHEAD:
        raise Problem(
            422,
            f"measured_at: {measured_at:%Y-%m-%d %H:%M} is in the future (the server has {now:%Y-%m-%d %H:%M} UTC).",
            "Set the clock that is wrong, the cell's or the server's. Then send again (truepose fleet outbox retry).",
        )


def _robot(store: FleetStore, serial: str, model: str) -> RobotKey:
    """Return the robot of a serial number.

    Raises
    ------
    Problem
        404, or 422 if several robots have the serial number.
    """
    found = [each for each in store.named() if each.serial == serial and model in ("", each.model)]
    if not found:
        raise Problem(404, f"There is no robot {serial!r}.", "List the robots to see which there are.")
    if len(found) > 1:
        types = ", ".join(each.model for each in found)
        raise Problem(422, f"Several robots have the serial number {serial!r}: {types}.", "Give `model` too.")
    return found[0]


async def _whole(request: Request) -> bytes | None:
    """Read the body; None if the client has left. The gate counts the bytes.

    Raises
    ------
    Problem
        408: the client falls silent or takes too long.
    """
    parts: list[bytes] = []
    pieces = aiter(request.stream())
    try:
        async with asyncio.timeout(UPLOAD_S):
            while True:
                async with asyncio.timeout(PIECE_S):
                    part = await anext(pieces, None)
                if part is None:
                    return b"".join(parts)
                parts.append(part)
    except ClientDisconnect:
        return None
    except TimeoutError as error:
        raise Problem(408, "The document did not come to its end.", "Send it again.") from error
