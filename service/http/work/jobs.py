"""Jobs, one at a time, in a worker process.

They are identifications, diagnoses, alignments, regressions, validations, selections, searches of placements,
watches and sweeps.

    RECORD/identifications/ID/, diagnoses/, alignments/, regressions/, validations/, selections/, placements/,
    watch-plans/, watches/, upkeeps/, sweeps/: job.json, then result.json + report.html (a picture of an alignment, of
    placements and of sweeps, poses of a selection, the updated model of a watch) or problem.json

The folder is the state. A job without an outcome that is not being worked on was cut off.
"""

from __future__ import annotations

import queue
import shutil
import threading
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from acquisition import State
from calib.text import replace_file
from service import job
from service.files import as_json
from service.http.wire import problems
from service.http.wire.bodies import ProblemKept, ResponseBody, StoredJob
from service.http.wire.paths import path_of
from service.http.wire.problems import Problem, not_found
from service.http.work.deletions import DeletionLog, hash_of, take_away
from service.http.work.stored_documents import read_kept, readable
from service.http.work.workers import WorkerDied, Workers
from service.ids import new_id, safe_id
from service.job_folder import (
    ARROWS,
    JOB,
    MODEL,
    PICTURE,
    PROBLEM,
    PROGRESS,
    REPORT,
    RESULT,
    STEP,
)
from service.json_values import utc_text
from service.refusals import REFUSALS

MOST_WAITING = 50
_FOLDERS = {
    "identification": "identifications",
    "diagnosis": "diagnoses",
    "alignment": "alignments",
    "regression": "regressions",
    "validation": "validations",
    "selection": "selections",
    "placement": "placements",
    "watch_plan": "watch-plans",
    "watch": "watches",
    "upkeep": "upkeeps",
    "sweeps": "sweeps",
}
_WITH_RESULTS = (*_FOLDERS.values(), "loops")


class Jobs:
    """The jobs of one record directory. Thread-safe."""

    def __init__(self, record: Path, done: Callable[[], None] = lambda: None) -> None:
        """Start the queue; `done` is called when a job has ended."""
        self._record, self._done = record, done
        self._queue: queue.SimpleQueue[Path | None] = queue.SimpleQueue()
        self._changed = threading.Condition()
        self._waiting: set[Path] = set()
        self._current: Path | None = None
        self._worker = Workers(1, waiting=0)
        for folder in _FOLDERS.values():
            (record / folder).mkdir(parents=True, exist_ok=True)
        self._thread = threading.Thread(target=self._work, name="jobs")
        self._thread.start()

    def add(
        self, kind: str, asked: Mapping[str, Any], files: Mapping[str, bytes] | None = None
    ) -> dict[str, Any]:
        """Put a job in the queue; its document.

        Parameters
        ----------
        asked :
            What `service.job` is told, `dataset_id` among it if the job is one of a data set.
        files :
            Content by name of files for the folder of the job.

        Raises
        ------
        Problem
            503: too many jobs wait.
        """
        own = new_id()
        folder = self._record / _FOLDERS[kind] / own
        order = {"id": own, "kind": kind, "created_utc": utc_text(time.time()), "dataset_id": "", **asked}
        with self._changed:
            if len(self._waiting) >= MOST_WAITING:
                raise Problem(503, "Too many jobs are waiting.", "Ask again when some are done.")
            self._waiting.add(folder)
        try:
            folder.mkdir()
            for file, content in (files or {}).items():
                (folder / file).write_bytes(content)
            replace_file(folder / JOB, as_json(order))
        except BaseException:
            shutil.rmtree(folder, ignore_errors=True)
            with self._changed:
                self._waiting.discard(folder)
            raise
        self._queue.put(folder)
        return self.document(kind, own)

    def ids(self, kind: str) -> list[str]:
        """Return the ids of the jobs of a kind, newest first."""
        folder = self._record / _FOLDERS[kind]
        return sorted(
            (p.name for p in folder.iterdir() if safe_id(p.name) and (p / JOB).is_file()), reverse=True
        )

    def document(self, kind: str, name: str) -> dict[str, Any]:
        """Return the state of a job.

        Raises
        ------
        Problem
            404: there is no such job or file.
        """
        folder = self._record / _FOLDERS[kind] / name
        if not safe_id(name) or not (folder / JOB).is_file():
            raise not_found(kind, name)
        order = read_kept(folder / JOB, StoredJob)
        with self._changed:
            waiting, current = folder in self._waiting, folder == self._current
        result = problem = None
        if waiting:
            state, version = State.READY, 1
        elif current:
            state, version = State.RUNNING, 2
        elif (folder / RESULT).is_file():
            state, version = State.SUCCEEDED, 3
            result = read_kept(folder / RESULT, ResponseBody)
        else:
            state, version = State.FAILED, 3
            problem = self._problem(folder)
        shown: dict[str, Any] = {key: order[key] for key in ("id", "kind", "dataset_id", "created_utc")}
        if (folder / PROGRESS).is_file():
            shown["progress"] = read_kept(folder / PROGRESS, ResponseBody)
        if "baseline" in order:
            shown["baseline"] = {key: order["baseline"][key] for key in ("id", "sha256")}
        if result is not None and kind == "alignment":
            shown["dataset_id"] = result["dataset_id"]
        return shown | {
            "state": state.value,
            "state_code": state.code,
            "version": version,
            "step": self._step(folder) if current else "",
            "result": result,
            "problem": problem,
            "report": path_of("reports", name)
            if (folder / REPORT).is_file() and result is not None
            else None,
        }

    def kind_of(self, name: str) -> str | None:
        """Return the kind of the job with this id; None if there is none."""
        known = (kind for kind, folder in _FOLDERS.items() if (self._record / folder / name / JOB).is_file())
        return next(known, None) if safe_id(name) else None

    def _step(self, folder: Path) -> str:
        """Return the step of the running job; empty before it has reported one."""
        with suppress(Problem):
            return str(read_kept(folder / STEP, ResponseBody).get("step", ""))
        return ""

    def _problem(self, folder: Path) -> dict[str, Any]:
        if (folder / PROBLEM).is_file():
            problem = read_kept(folder / PROBLEM, ProblemKept)
            return problems.document(422, problem.pop("text"), problem.pop("do"), **problem)
        return problems.document(500, "The work was cut off before its end.", "Ask for it again.")

    def of_dataset(self, dataset_id: str) -> dict[str, str]:
        """Return the kinds of the jobs on a data set by their ids, newest first.

        Those with damaged files are left out.
        """
        found = {}
        for kind, collection in _FOLDERS.items():
            folder = self._record / collection
            for order in readable(
                self.ids(kind), lambda name, folder=folder: read_kept(folder / name / JOB, StoredJob)
            ):
                if order["dataset_id"] == dataset_id:
                    found[order["id"]] = kind
        return dict(sorted(found.items(), reverse=True))

    def wait(self, kind: str, name: str, after: int, seconds: float) -> int:
        """Return the version, waiting up to `seconds` for one beyond `after`."""
        with self._changed:
            self._changed.wait_for(lambda: self.document(kind, name)["version"] > after, seconds)
        return self.document(kind, name)["version"]

    def counts(self) -> dict[str, int]:
        """Return the numbers of jobs that wait, and that are worked on."""
        with self._changed:
            return {"waiting": len(self._waiting), "working": int(self._current is not None)}

    def refuse_working_on(self, own: str) -> None:
        """Raise Problem 409 while a job waits for, or works on, the data set or the result with this id.

        A job names all that it reads in its file: its data set, another one, and the models that it judges or compares.
        """
        with self._changed:
            busy = [*self._waiting, *([] if self._current is None else [self._current])]
        for folder in busy:
            file = folder / JOB  # not there yet: what a job reads that comes at this moment is not known
            if not file.is_file() or own in file.read_text("utf-8"):
                raise Problem(409, f"Job {folder.name} works on it.", "Wait until it is done.", code=8130)

    def delete(self, name: str, trail: DeletionLog, by: str, reason: str) -> dict[str, Any]:
        """Delete a job and return the line of the trail.

        Raises
        ------
        Problem
            404, or 409 while it waits or works.
        StorageError
            The trail cannot be written, or the files cannot be deleted.
        """
        places = {kind: self._record / each / name / JOB for kind, each in _FOLDERS.items() if safe_id(name)}
        found = [kind for kind, file in places.items() if file.is_file()]
        if not found:
            raise not_found("result", name)
        folder = self._record / _FOLDERS[found[0]] / name
        with self._changed:
            if folder in self._waiting or folder == self._current:
                raise Problem(409, "The job waits or works.", "Wait until it is done.", code=8130)
        self.refuse_working_on(name)
        with self._changed:
            line = trail.note(found[0], {"id": name}, by, reason, sha256=hash_of(folder / RESULT))
            take_away(folder)
        return line

    def report(self, name: str) -> str:
        """Return the HTML of a job's report.

        Raises
        ------
        Problem
            404: there is no such job or file.
        """
        return self._file(name, REPORT, "report")

    def picture(self, name: str) -> str:
        """Return the SVG of an alignment, a search of placements or sweeps.

        Raises
        ------
        Problem
            404: there is no such job or file.
        """
        return self._file(name, PICTURE, "picture")

    def arrows(self, name: str) -> dict[str, Any]:
        """Return the errors of the readings in space.

        Raises
        ------
        Problem
            404: there is no such job or file.
        """
        return read_kept(self._path(name, ARROWS, "picture of errors"), ResponseBody)

    def model(self, name: str) -> dict[str, Any]:
        """Return the model that a job or a loop has found.

        Raises
        ------
        Problem
            404: there is no such job or file.
        """
        return read_kept(self.model_file(name), ResponseBody)

    def model_file(self, name: str) -> Path:
        """Return the path of the model that a job has found.

        Raises
        ------
        Problem
            404: there is no such job or file.
        """
        return self._path(name, MODEL, "model")

    def certified(self, name: str) -> Path:
        """Return the folder of an identification or a diagnosis that has a result.

        Raises
        ------
        Problem
            404: there is no such job or file.
        """
        folder = self._path(name, REPORT, "result").parent
        if folder.parent.name not in ("identifications", "diagnoses"):
            raise Problem(
                404, f"There is no certificate of {name!r}.", "Name an identification or a diagnosis."
            )
        return folder

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
            with suppress(Problem, WorkerDied, *REFUSALS):  # the job has no outcome then
                self._worker.call(job.do, folder)
            with self._changed:
                self._current = None
                self._changed.notify_all()
            self._done()

    def end(self) -> None:
        """End the current work and begin none; it can be requested again."""
        self._worker.close()

    def close(self) -> None:
        """Close the queue, once all work is ended."""
        self.end()
        self._queue.put(None)
        self._thread.join()
