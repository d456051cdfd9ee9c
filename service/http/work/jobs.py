"""Identifications, diagnoses, alignments, regressions, searches of placements: one at a time, in a worker process.

    RECORD/identifications/ID/, diagnoses/, alignments/, regressions/, placements/: job.json, then result.json and
    report.html (picture.svg of an alignment and of placements) or problem.json

The folder is the state: a job without an outcome that nobody works on was cut off.
"""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any

from acquisition import Cell, State
from calib.text import replace_file
from service import job
from service.files import as_json
from service.http.wire import problems
from service.http.wire.bodies import Answered, JobKept, ProblemKept
from service.http.wire.paths import path_of
from service.http.wire.problems import Problem, not_found
from service.http.work.kept import read_kept, readable
from service.http.work.workers import WorkerDied, Workers
from service.job import JOB, MODEL, PICTURE, PROBLEM, PROGRESS, REPORT, RESULT, ROBOT, TRACKER
from service.names import new_id, safe_id
from service.plain import utc_text
from service.results import placements
from service.results.alignment import Order

MOST_WAITING = 50
_FOLDERS = {
    "identification": "identifications",
    "diagnosis": "diagnoses",
    "alignment": "alignments",
    "regression": "regressions",
    "placement": "placements",
}
_WITH_RESULTS = (*_FOLDERS.values(), "loops")


class Jobs:
    """The jobs of one record directory. Thread-safe."""

    def __init__(self, record: Path) -> None:
        self._record = record
        self._queue: queue.SimpleQueue[Path | None] = queue.SimpleQueue()
        self._changed = threading.Condition()
        self._waiting: set[Path] = set()
        self._current: Path | None = None
        self._worker = Workers(1, waiting=0)
        for folder in _FOLDERS.values():
            (record / folder).mkdir(parents=True, exist_ok=True)
        self._thread = threading.Thread(target=self._work, name="jobs")
        self._thread.start()

    def add(self, kind: str, dataset: dict[str, Any], data: Path, cell: Cell | None = None) -> dict[str, Any]:
        """Put a job in the queue; its document. Raises Problem 503 when too many wait.

        cell: what a diagnosis that is ambiguous proposes to measure next is kept within it.
        """
        asked = {"data": str(data), "cell": None if cell is None else cell.source}
        return self._add(kind, {"dataset_id": dataset["id"], **asked}, {})

    def regress(self, dataset: dict[str, Any], data: Path, order: dict[str, Any]) -> dict[str, Any]:
        """Put a regression in the queue, as `add`. order: the options of `regress_command`."""
        asked = {"dataset_id": dataset["id"], "data": str(data), "order": order}
        return self._add("regression", asked, {})

    def place(self, cell: Cell, order: placements.Order) -> dict[str, Any]:
        """Put a search of placements of the base balls in the queue, as `add`."""
        return self._add("placement", {"dataset_id": "", "cell": cell.source, "order": asdict(order)}, {})

    def align(self, robot: bytes, tracker: bytes, order: Order, name: str) -> dict[str, Any]:
        """Put the alignment of two streams in the queue, as `add`. name: that of the data set it will make."""
        asked = {"dataset_id": "", "name": name, "order": asdict(order)}
        return self._add("alignment", asked, {ROBOT: robot, TRACKER: tracker})

    def _add(self, kind: str, asked: dict[str, Any], files: Mapping[str, bytes]) -> dict[str, Any]:
        own = new_id()
        folder = self._record / _FOLDERS[kind] / own
        order = {"id": own, "kind": kind, "created_utc": utc_text(time.time()), **asked}
        with self._changed:
            if len(self._waiting) >= MOST_WAITING:
                raise Problem(503, "Too many jobs are waiting.", "Ask again when some are done.")
            self._waiting.add(folder)
        folder.mkdir()
        for file, content in files.items():
            (folder / file).write_bytes(content)
        replace_file(folder / JOB, as_json(order))
        self._queue.put(folder)
        return self.document(kind, own)

    def document(self, kind: str, name: str) -> dict[str, Any]:
        """The state of a job. Raises Problem 404."""
        folder = self._record / _FOLDERS[kind] / name
        if not safe_id(name) or not (folder / JOB).is_file():
            raise not_found(kind, name)
        order = read_kept(folder / JOB, JobKept)
        with self._changed:
            waiting, current = folder in self._waiting, folder == self._current
        result = problem = None
        if waiting:
            state, version = State.READY, 1
        elif current:
            state, version = State.RUNNING, 2
        elif (folder / RESULT).is_file():
            state, version = State.SUCCEEDED, 3
            result = read_kept(folder / RESULT, Answered)
        else:
            state, version = State.FAILED, 3
            problem = self._problem(folder)
        shown: dict[str, Any] = {key: order[key] for key in ("id", "kind", "dataset_id", "created_utc")}
        if (folder / PROGRESS).is_file():
            shown["progress"] = read_kept(folder / PROGRESS, Answered)
        if result is not None and kind == "alignment":
            shown["dataset_id"] = result["dataset_id"]
        return shown | {
            "state": state.value,
            "state_code": state.code,
            "version": version,
            "result": result,
            "problem": problem,
            "report": path_of("reports", name)
            if (folder / REPORT).is_file() and result is not None
            else None,
        }

    def _problem(self, folder: Path) -> dict[str, Any]:
        if (folder / PROBLEM).is_file():
            problem = read_kept(folder / PROBLEM, ProblemKept)
            return problems.document(422, problem.pop("text"), problem.pop("do"), **problem)
        return problems.document(500, "The work was cut off before its end.", "Ask for it again.")

    def of_dataset(self, dataset_id: str) -> list[dict[str, Any]]:
        """The jobs that were asked to work on a data set, newest first, without those whose files are damaged."""
        found = []
        for kind, collection in _FOLDERS.items():
            folder = self._record / collection
            names = [p.name for p in folder.iterdir() if safe_id(p.name) and (p / JOB).is_file()]
            orders = readable(names, lambda name, folder=folder: read_kept(folder / name / JOB, JobKept))
            own = [order["id"] for order in orders if order["dataset_id"] == dataset_id]
            found += readable(own, lambda name, kind=kind: self.document(kind, name))
        return sorted(found, key=lambda job: job["id"], reverse=True)

    def wait(self, kind: str, name: str, after: int, seconds: float) -> int:
        """The version, waiting up to so many seconds for one beyond `after`."""
        with self._changed:
            self._changed.wait_for(lambda: self.document(kind, name)["version"] > after, seconds)
        return self.document(kind, name)["version"]

    def report(self, name: str) -> str:
        """The HTML of a job's report. Raises Problem 404."""
        return self._file(name, REPORT, "report")

    def picture(self, name: str) -> str:
        """The SVG of an alignment or a search of placements. Raises Problem 404."""
        return self._file(name, PICTURE, "picture")

    def model(self, name: str) -> dict[str, Any]:
        """The model that a job or a loop has found. Raises Problem 404."""
        return read_kept(self.model_file(name), Answered)

    def model_file(self, name: str) -> Path:
        """The path of the model that a job found. Raises Problem 404."""
        return self._path(name, MODEL, "model")

    def _file(self, name: str, file_name: str, what: str) -> str:
        return self._path(name, file_name, what).read_text(encoding="utf-8")

    def _path(self, name: str, file_name: str, what: str) -> Path:
        for folder in _WITH_RESULTS:
            done = self._record / folder / name
            # The result is written last: with it everything is there.
            if safe_id(name) and (done / RESULT).is_file() and (done / file_name).is_file():
                return done / file_name
        raise Problem(404, f"There is no {what} {name!r} (yet).", "Wait until its job has succeeded.")

    def _work(self) -> None:
        while (folder := self._queue.get()) is not None:
            with self._changed:
                self._waiting.discard(folder)
                self._current = folder
                self._changed.notify_all()
            with suppress(Problem, WorkerDied):  # the job has no outcome then
                self._worker.call(job.do, folder)
            with self._changed:
                self._current = None
                self._changed.notify_all()

    def end(self) -> None:
        """End the work in hand and begin none; it can be asked for again."""
        self._worker.close()

    def close(self) -> None:
        """Close the queue, once all work is ended."""
        self.end()
        self._queue.put(None)
        self._thread.join()
