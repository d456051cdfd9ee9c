"""The robots of a store as an interface shows them: state, last verdict, errors, next date, documents, trends.

Every function opens the store at an address, asks and closes it: it is called in a process that may wait for
a database.

The record of a campaign as documents of a fleet: its readings as a data set, and what was measured when by whom.

The findings of a service, brought into its history: runs that succeeded, diagnoses, watches, upkeeps.

The files of the record are the truth and nothing else is needed: what has not been kept is looked for again, and the
store keeps the same content once.
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
    "upkeeps": ("result.json",),  # whose parameters are those of its model
}

RESULT = "result.json"
_RECORD = "record.sqlite3"
Reader = Callable[[Path, CellFolder], Sequence[Document]]


@dataclass(frozen=True)
class DueDateRequest:
    """The question of dates and how they are reckoned. permitted_mm: largest position error, RMS, None where nobody has
    said; first_days, shortest_days, longest_days: intervals."""

    permitted_mm: float | None = None
    method: Way = "staircase"
    first_days: float = 180.0
    shortest_days: float = 7.0
    longest_days: float = 1825.0

    def way(self) -> Method | None:
        """The method of ILAC-G24; None where no error is permitted. Raises DataError for intervals that make none."""
        if self.permitted_mm is None:
            return None
        kind = Staircase if self.method == "staircase" else DriftInterval
        return kind(
            self.first_days, self.permitted_mm, shortest=self.shortest_days, longest=self.longest_days
        )


def id_of(robot: RobotKey) -> str:
    """The id of a robot in addresses: serial numbers may hold any letter, and types may share them."""
    return hashlib.sha256(f"{robot.model}\0{robot.serial}".encode()).hexdigest()[:16]


def told_robots(address: str, asked: DueDateRequest) -> dict[str, Any]:
    """All robots of a store, those first that are to be looked at first. Raises DataError."""
    way, now = asked.way(), utc_now()
    with FleetStore.open(address) as store:
        lines = [_line(each, asked.permitted_mm, way, now) for each in store.standings()]
        place = store.place
    lines.sort(key=_urgency)
    return {
        "store": place,
        "now": text_of(now),
        "robots": [document_of(line) for line in lines[:MOST]],
        "left_out": len(lines[MOST:]),
        "need_care": sum(line.needs_care for line in lines),
    }


def told_robot(address: str, name: str, asked: DueDateRequest, most: int) -> dict[str, Any] | None:
    """One robot with its newest documents; None where the store has none of this id or serial number.

    Raises DataError for a serial number of several types.
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
    """The trends of one parameter of a robot, or of all, with the newest values of each; None as for `told_robot`.

    The chart is that of all values. Raises DataError for a parameter that the robot has not.
    """
    with FleetStore.open(address) as store:
        robot = _found(store, name)
        if robot is None:
            return None
        if parameter is None:  # one of which nothing but data is kept has none, and that is no fault
            found = history.trends_in(robot, store.trend(robot))
        else:
            found = history.trends_of(store, robot, parameter)
    told = [document_of(each.shown(most)) for each in found]
    about = {"id": id_of(robot), "format": history.FORMAT, "serial": robot.serial, "model": robot.model}
    return about | {"trends": told}


def content_of(address: str, hash: str) -> bytes | None:
    """The bytes of a document; None for one that the store has not."""
    with FleetStore.open(address) as store:
        return store.content(hash) if store.known([hash]) else None


def put(address: str, name: str, content: bytes, header: bytes | None, cell: CellFolder) -> dict[str, Any]:
    """Keep a document that somebody sends: a model, a verdict, a diagnosis, an upkeep; with a header, a data set.
    Raises DataError."""
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
            "is no document that a history keeps.",
            do="Send a model, the verdict of a watch, a diagnosis or an upkeep, as it was written; of a data set its "
            "CSV as the file and its header as toml.",
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
    """The rank of a robot in a list: what has changed, the largest error first; then what errs beyond what is
    permitted; then what is overdue, and the others by date."""
    largest = -line.error_mm.rms if line.error_mm else 0.0
    if line.state in CHANGED:
        return 0, largest, "", line.serial
    if line.beyond_permitted and line.needs_care:
        return 1, largest, "", line.serial
    rank = 2 if line.due.overdue else 4 if line.state == "retired" else 3
    return rank, 0.0, line.due.date or "", line.serial


def read_record(path: Path, cell: CellFolder) -> list[Document]:
    """The documents of a record that is finished; none of another. Raises DataError."""
    folder = path.parent
    try:
        status = read_status(folder)
        if status.state != State.SUCCEEDED.value:
            return []
        with TemporaryDirectory(prefix="truepose-fleet-") as place:
            found = read_data(acquisition.export(folder, Path(place) / "data.csv"), cell)
    except DataError as error:  # of a file that nobody sees
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
    """The outcome for a file, by its path below the record. documents: hashes; robot_id: of the robot; because: why it
    was refused, or what it contradicts; empty otherwise."""

    path: str
    state: Outcome
    documents: tuple[str, ...] = ()
    robot_id: str = ""
    because: str = ""


def keep_results(address: str, record: Path, cell: CellFolder, done: Collection[str]) -> list[RecordedFile]:
    """Keep every result of a record that is not among `done`, paths below it. Raises StoreError: what was kept before
    is known again the next time."""
    out: list[RecordedFile] = []
    with FleetStore.open(address) as store:
        for path, reader in _results(record):
            name = path.relative_to(record).as_posix()
            if name not in done and (kept := _keep(store, path, name, reader, cell)) is not None:
                out.append(kept)
    return out


def _results(record: Path) -> Iterator[tuple[Path, Reader]]:
    """The files that may be kept, and how each is read. A result is written last: with it everything is there."""
    for folder, names in _FILES.items():
        for place in sorted(record.glob(f"{folder}/*/")):
            if (place / RESULT).is_file():
                yield from ((place / name, read_result) for name in names if (place / name).is_file())
    for place in sorted(record.glob(f"runs/*/{_RECORD}")):
        yield place, read_record


def _keep(store: FleetStore, path: Path, name: str, reader: Reader, cell: CellFolder) -> RecordedFile | None:
    """The outcome for one file; None for what is not finished."""
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
