"""The documents of a store: statements of a cell about one robot, byte for byte.

Each comes with the facts that it states about itself.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cached_property
from typing import Literal, get_args

from calib.errors import DataError

Kind = Literal["model", "watch", "campaign", "dataset", "diagnosis", "thermal", "retired"]
KINDS: tuple[Kind, ...] = get_args(Kind)
State = Literal["new", "known", "conflict"]
LONGEST = 200  # letters of a name
_YEARS = 1900, 9000  # beyond them a time of another zone has no UTC


@dataclass(frozen=True, order=True)
class RobotKey:
    """The key of one robot of a plant.

    It has its serial number and its type, as robot files name it ("irb120").
    """

    serial: str
    model: str

    def __post_init__(self) -> None:
        _refuse_name("serial", self.serial)
        _refuse_name("model", self.model)


@dataclass(frozen=True)
class Document:
    """One statement of a cell about a robot.

    Attributes
    ----------
    cell
        Name of the cell that made it.
    identity
        Subject of the statement (the id of its record and the kind). A second content for one identity contradicts the
        first.
    measured_at
        Time of its first reading, with a time zone.
    content
        The document itself.

    Raises
    ------
    DataError
        A value cannot be stored; the error names the key.
    """

    kind: Kind
    robot: RobotKey
    cell: str
    identity: str
    measured_at: datetime
    content: bytes

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise DataError(f"is {self.kind!r}.", do=f"Use one of {', '.join(KINDS)}.", key="kind")
        _refuse_name("cell", self.cell)
        _refuse_name("identity", self.identity)
        if self.measured_at.tzinfo is None:
            raise DataError("has no time zone.", do="Give a time in UTC.", key="measured_at")
        if not _YEARS[0] <= self.measured_at.year <= _YEARS[1]:
            raise DataError(
                f"is in the year {self.measured_at.year}.",
                do="Give the time of the first reading, by a clock that is right.",
                key="measured_at",
            )
        if not self.content:
            raise DataError("is empty.", do="Give the document.", key="content")

    @cached_property
    def hash(self) -> str:
        """SHA-256 of the content, 64 hexadecimal digits."""
        return hashlib.sha256(self.content).hexdigest()


@dataclass(frozen=True)
class AddResult:
    """The result of adding a document.

    Attributes
    ----------
    state
        "new", "known" if the store had this content, or "conflict" if it has another content for the same identity. In
        a conflict both are kept.
    other_hashes
        Hashes of the other contents, oldest first.
    """

    hash: str
    state: State
    other_hashes: tuple[str, ...] = ()


@dataclass(frozen=True)
class DocumentSummary:
    """A document in a list.

    Attributes
    ----------
    program
        Version that wrote it, "" if it does not state one.
    size
        Size in bytes.
    conflict
        Whether the store has another content for the same identity.
    """

    hash: str
    kind: Kind
    robot: RobotKey
    cell: str
    identity: str
    measured_at: datetime
    added_at: datetime
    program: str
    size: int
    conflict: bool


@dataclass(frozen=True)
class RobotSummary:
    """A robot in the store.

    Attributes
    ----------
    documents
        Number of documents of every kind.
    first, last
        Times of the first and the last measurement.
    retired
        Whether a person has reported since then that it is no longer measured.
    """

    robot: RobotKey
    cells: tuple[str, ...]
    documents: dict[Kind, int]
    first: datetime
    last: datetime
    retired: bool = False


@dataclass(frozen=True)
class TrendPoint:
    """One value of a parameter over time.

    Attributes
    ----------
    u
        Expanded uncertainty U (k = 2), None if the model states none. Value and U are in `unit`.
    hash
        Hash of the document with the value, or if `rediagnosed` that of the data set.
    program
        Program that computed the value.
    """

    measured_at: datetime
    parameter: str
    value: float
    u: float | None
    unit: str
    hash: str
    program: str
    rediagnosed: bool = False


@dataclass(frozen=True)
class NamedCause:
    """A cause or effect that a verdict names.

    Attributes
    ----------
    weight
        Its share among the causes of its class; None if the document has none.
    value, u
        Value and U (k = 2), in `unit`; None if the document has none.
    """

    label: str
    in_words: str
    weight: float | None
    value: float | None
    u: float | None
    unit: str


@dataclass(frozen=True)
class VerdictRecord:
    """The verdict of a watch or of a diagnosis on a robot."""

    robot: RobotKey
    measured_at: datetime
    kind: Kind
    hash: str
    verdict: str
    in_words: str
    advice: str
    causes: tuple[NamedCause, ...]


def utc_now() -> datetime:
    """Return the time, with its zone."""
    return datetime.now(UTC)


def _refuse_name(key: str, text: str) -> None:
    """Raise DataError for a text that is not a name: empty, too long, or with invisible letters."""
    if not text.strip() or text != text.strip():
        raise DataError("is empty, or begins or ends with a space.", do="Give a name.", key=key)
    if len(text) > LONGEST or not text.isprintable():
        raise DataError(
            f"is longer than {LONGEST} letters, or holds control characters.", do="Give a name.", key=key
        )
