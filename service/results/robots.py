"""Robots of a store: state, last verdict, errors, next check, documents and trends.

Each function opens the store at an address and closes it again. Call it in a process that may wait for a database.

The module also adds the results of a service to its history: successful runs, diagnoses, watches and thermal updates.
The record of a campaign becomes a data set and a summary of the campaign. Only the files of the record are needed: a
file that has not been kept is found again the next time, and the store keeps equal content only once.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Literal

import acquisition
from acquisition import State, read_status
from calib.errors import DataError
from calib.text import written_by
from calib.upkeep import DriftInterval, Method, Staircase
from drivers.errors import AcquisitionError
from fleet.errors import StoreError
from fleet.outbox import CellFolder, read_data, read_result
from fleet.store import Document, FleetStore, RobotKey, RobotState, utc_now
from service import refusals
from service.files import as_json
from service.kept_dataset import CSV, TOML, refuse_paths
from service.results import history
from service.results.history import CHANGED, doubtful_date, due_now, state_of
from service.results.robot_answers import DueShown, RobotLine, text_of
from service.results.shape import document_of

Way = Literal["staircase", "drift"]
MOST = 1000
"""Robots of a list."""

ERRORS = 24
"""Values of a line's small picture."""

FORMAT = "truepose-campaign-record/1"
Outcome = Literal["new", "known", "conflict", "refused"]

_FILES = {
    "diagnoses": ("result.json", "model.json"),
    "loops": ("result.json", "model.json"),
    "watches": ("result.json", "model.json"),
    "upkeeps": ("result.json",),  # its parameters are those of its model
}

RESULT = "result.json"
_RECORD = "record.sqlite3"
Reader = Callable[[Path, CellFolder], Sequence[Document]]


@dataclass(frozen=True)
class DueDateRequest:
    """Request for the dates of the next checks, with the method that calculates them.

    Attributes
    ----------
    permitted_mm
        Largest permitted position error, RMS, mm; None if it is not set.
    first_days, shortest_days, longest_days
        First, shortest and longest interval between checks, days.
    """

    permitted_mm: float | None = None
    method: Way = "staircase"
    first_days: float = 180.0
    shortest_days: float = 7.0
    longest_days: float = 1825.0

    def way(self) -> Method | None:
        """Return the method of ILAC-G24, or None if no permitted error is set.

        Raises
        ------
        DataError
            The intervals are not valid for the method.
        """
        if self.permitted_mm is None:
            return None
        kind = Staircase if self.method == "staircase" else DriftInterval
        return kind(
            self.first_days, self.permitted_mm, shortest=self.shortest_days, longest=self.longest_days
        )


def id_of(robot: RobotKey) -> str:
    """Return the id of a robot for URLs.

    Serial numbers may hold any character, and robots of different types may have the same one.
    """
    return hashlib.sha256(f"{robot.model}\0{robot.serial}".encode()).hexdigest()[:16]


def told_robots(address: str, asked: DueDateRequest, after: str = "", most: int = 0) -> dict[str, Any]:
    """List the robots of a store as a document, the most urgent first.

    A page of the list is in the order of the ids instead, because what is urgent changes between two pages.

    Parameters
    ----------
    after : str
        Id of the last robot of the page before; empty for the first page or the whole list.
    most : int
        Number of robots of a page; 0 for all, up to `MOST`.

    Raises
    ------
    DataError
        The intervals are not valid, or the store cannot be used.
    """
    way, now = asked.way(), utc_now()
    with FleetStore.open(address) as store:
        lines = [_line(each, asked.permitted_mm, way, now) for each in store.standings()]
        place = store.place
    if after or most:
        shown = sorted((line for line in lines if line.id > after), key=lambda line: line.id)
    else:
        shown = sorted(lines, key=_urgency)
    most = most or MOST
    return {
        "store": place,
        "now": text_of(now),
        "robots": [document_of(line) for line in shown[:most]],
        "left_out": len(shown[most:]),
        "need_care": sum(line.needs_care for line in lines),
    }


def told_robot(address: str, name: str, asked: DueDateRequest, most: int) -> dict[str, Any] | None:
    """Describe one robot, by its id or serial number, with its `most` newest documents.

    The result is None if the robot is unknown.

    Raises
    ------
    DataError
        Robots of several types have this serial number.
    """
    way, now = asked.way(), utc_now()
    with FleetStore.open(address) as store:
        robot = _found(store, name)
        found = [] if robot is None else store.standings(robot)
        if robot is None or not found:
            return None
        lines = history.lines_of(store, robot)
        return {
            **document_of(_line(found[0], asked.permitted_mm, way, now)),
            "store": store.place,
            "now": text_of(now),
            "history": [document_of(line.shown) for line in lines[::-1][:most]],
            "left_out": max(len(lines) - most, 0),
        }


def told_trends(address: str, name: str, parameter: str | None, most: int) -> dict[str, Any] | None:
    """Describe the trends of one parameter, or of all, with the `most` newest values of each.

    The control chart is calculated from all values. The result is None if the robot is unknown.

    Raises
    ------
    DataError
        The robot does not have the parameter.
    """
    with FleetStore.open(address) as store:
        robot = _found(store, name)
        if robot is None:
            return None
        if parameter is None:  # a robot with data sets only has no trends, which is not an error
            found = history.trends_in(robot, store.trend(robot))
        else:
            found = history.trends_of(store, robot, parameter)
    told = [document_of(each.shown(most)) for each in found]
    about = {"id": id_of(robot), "format": history.FORMAT, "serial": robot.serial, "model": robot.model}
    return about | {"trends": told}


def content_of(address: str, hash: str) -> bytes | None:
    """Return the bytes of a document, or None if the store does not have it."""
    with FleetStore.open(address) as store:
        return store.content(hash) if store.known([hash]) else None


def put(address: str, name: str, content: bytes, header: bytes | None, cell: CellFolder) -> dict[str, Any]:
    """Keep a document that a client sends, and return the outcome.

    It is a model, a verdict, a diagnosis or a thermal update. With a `header` (TOML), it is a data set.

    Raises
    ------
    DataError
        The content is none of these, or cannot be used.
    """
    with TemporaryDirectory(prefix="truepose-history-") as folder:
        file, beside = Path(folder) / CSV, Path(folder) / TOML
        file.write_bytes(content)
        if header is not None:
            refuse_paths(header)
            beside.write_bytes(header)
        try:
            found = read_result(file, cell) if header is None else read_data(file, cell)
        except DataError as error:
            place = TOML if error.file == beside else name
            raise DataError(error.what, do=error.do, file=place, line=error.line, key=error.key) from error
    if not found:
        raise DataError(
            "is not a document that a history keeps.",
            do="Send a model, the verdict of a watch, a diagnosis or a thermal update as it was written, or a "
            "data set: its CSV as the file and its header as toml.",
            file=name,
        )
    with FleetStore.open(address) as store:
        added = store.add_all(found)
    told = history.added_document(list(zip(found, added, strict=True)))
    return told | {"robot_id": id_of(found[0].robot)}


def _found(store: FleetStore, name: str) -> RobotKey | None:
    known = store.named()
    same = [each for each in known if id_of(each) == name] or [each for each in known if each.serial == name]
    if len(same) > 1:
        raise DataError(
            f"is of {' and of '.join(each.model for each in same)}.",
            do="Ask by the id that the list of robots has.",
            file=f"serial number {name}",
        )
    return same[0] if same else None


def _line(standing: RobotState, permitted_mm: float | None, way: Method | None, now: datetime) -> RobotLine:
    """The line of a robot in a list."""
    known, errors = standing.known, history.errors_by(standing, now)
    state, due = state_of(standing), _due(standing, way, now)
    beyond = bool(errors and permitted_mm and errors[-1].value > permitted_mm)
    return RobotLine.model_validate(
        {
            "id": id_of(known.robot),
            "serial": known.robot.serial,
            "model": known.robot.model,
            "cells": known.cells,
            "documents": known.documents,
            "last_measured": known.last,
            "state": state,
            "needs_care": not known.retired and (state in CHANGED or due.overdue or beyond),
            "beyond_permitted": beyond,
            "doubtful_date": doubtful_date(known, now),
            "watched": standing.watched,
            "diagnosed": standing.diagnosed,
            "baseline": standing.baseline,
            "error_mm": errors[-1] if errors else None,
            "errors": errors[-ERRORS:],
            "due": due,
        }
    )


def _due(standing: RobotState, way: Method | None, now: datetime) -> DueShown:
    """The date of the next check, which is known for what has changed; without a date, the reason."""
    if standing.known.retired:
        due, because = None, "It is retired."
    elif way is None:
        due = due_now(standing)
        because = "No permitted error is set." if due is None else due.because
    else:
        due, because = history.next_of(standing, way, now)
    date = None if due is None else text_of(due.date)
    return DueShown(date=date, overdue=due is not None and due.date <= now, because=because)


def _urgency(line: RobotLine) -> tuple[int, float, str, str]:
    """Rank of a robot in a list.

    Robots that have changed come first, the largest error before the others; then robots whose error exceeds the
    permitted one; then overdue robots; then the others by date.
    """
    largest = -line.error_mm.rms if line.error_mm else 0.0
    if line.state in CHANGED:
        return 0, largest, "", line.serial
    if line.beyond_permitted and line.needs_care:
        return 1, largest, "", line.serial
    rank = 2 if line.due.overdue else 4 if line.state == "retired" else 3
    return rank, 0.0, line.due.date or "", line.serial


def read_record(path: Path, cell: CellFolder) -> list[Document]:
    """Create the documents of a record; none if the campaign has not succeeded.

    Raises
    ------
    DataError
        The record cannot be read or exported.
    """
    folder = path.parent
    try:
        status = read_status(folder)
        if status.state != State.SUCCEEDED.value:
            return []
        with TemporaryDirectory(prefix="truepose-fleet-") as place:
            found = read_data(acquisition.export(folder, Path(place) / "data.csv"), cell)
    except DataError as error:  # it names a temporary file, which the reader cannot see
        raise DataError(error.what, do=error.do, file=folder, key=error.key) from error
    except AcquisitionError as error:
        raise DataError(refusals.cause(error), do=refusals.remedy(error), file=folder) from error
    summary = {
        "format": FORMAT,
        "program": written_by(),
        "id": status.id,
        "name": status.name,
        "state": status.state,
        "readings": status.done,
        "skipped": status.skipped,
        "simulated": status.simulated,
        "datasets": [each.hash for each in found],
    }
    about = [
        replace(each, kind="campaign", identity=f"campaign {status.id}", content=as_json(summary).encode())
        for each in found
    ]
    return [*found, *about]


@dataclass(frozen=True)
class RecordedFile:
    """Outcome for a file of the record.

    Attributes
    ----------
    path
        Path below the record.
    documents
        Hashes of the documents.
    because
        Reason of a refusal, or the document that it contradicts; empty otherwise.
    """

    path: str
    state: Outcome
    documents: tuple[str, ...] = ()
    robot_id: str = ""
    because: str = ""


def keep_results(address: str, record: Path, cell: CellFolder, done: Collection[str]) -> list[RecordedFile]:
    """Keep the results of a record whose paths below it are not in `done`.

    Raises
    ------
    StoreError
        The store cannot be used. Results that were kept before are recognised the next time.
    """
    out: list[RecordedFile] = []
    with FleetStore.open(address) as store:
        for path, reader in _results(record):
            name = path.relative_to(record).as_posix()
            if name not in done and (kept := _keep(store, path, name, reader, cell)) is not None:
                out.append(kept)
    return out


def _results(record: Path) -> Iterator[tuple[Path, Reader]]:
    """Yield the files that may be kept, each with its reader.

    A result is written last, so the other files of its folder are complete when it exists.
    """
    for folder, names in _FILES.items():
        for place in sorted(record.glob(f"{folder}/*/")):
            if (place / RESULT).is_file():
                yield from ((place / name, read_result) for name in names if (place / name).is_file())
    for place in sorted(record.glob(f"runs/*/{_RECORD}")):
        yield place, read_record


def _keep(store: FleetStore, path: Path, name: str, reader: Reader, cell: CellFolder) -> RecordedFile | None:
    """Keep one file and return the outcome, or None if the file is not finished."""
    try:
        found = reader(path, cell)
        if not found:
            return None
        added = store.add_all(list(found))
    except StoreError:
        raise
    except (DataError, OSError) as error:
        return RecordedFile(name, "refused", because=str(error).replace(str(path), name))
    hashes, robot = tuple(each.hash for each in added), id_of(found[0].robot)
    others = [hash for each in added for hash in each.other_hashes]
    if others:
        return RecordedFile(name, "conflict", hashes, robot, f"It contradicts the document {others[-1]}.")
    state = "new" if any(each.state == "new" for each in added) else "known"
    return RecordedFile(name, state, hashes, robot)
