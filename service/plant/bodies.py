"""The answers of a fleet's server, as OpenAPI describes them. Times are RFC 3339, UTC."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime

from pydantic import BaseModel, ConfigDict, Field

from fleet.store import Entry, Known


class AddedShown(BaseModel):
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
    identity: str = Field(description="Which thing it is a statement of.")
    measured_at: datetime
    added_at: datetime
    program: str = Field(description="Version that wrote it; empty where it does not say.")
    size: int = Field(description="Bytes.")
    conflict: bool = Field(description="Whether another content was sent for the same identity.")

    @classmethod
    def of(cls, entry: Entry) -> DocumentShown:
        """The document of an entry."""
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


class RobotShown(BaseModel):
    """A robot that documents were sent of."""

    serial: str
    model: str
    cells: Sequence[str]
    documents: dict[str, int] = Field(description="How many of each kind.")
    last: datetime = Field(description="When the last was measured.")

    @classmethod
    def of(cls, known: Known) -> RobotShown:
        """The document of a robot."""
        return cls(
            serial=known.robot.serial,
            model=known.robot.model,
            cells=known.cells,
            documents={str(kind): count for kind, count in known.documents.items()},
            last=known.last,
        )


class RobotsShown(BaseModel):
    """All robots."""

    robots: Sequence[RobotShown]


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


class TrendShown(BaseModel):
    """The values of parameters over time, by name and time."""

    serial: str
    model: str
    points: Sequence[PointShown]


class HealthShown(BaseModel):
    """The server is there."""

    status: str
    version: str
