"""History of the robots of a service: its store, and the journal of added results.

    RECORD/history.sqlite3       the store, if no other was named; history-simulated.sqlite3 with simulators
    RECORD/history-kept.jsonl    a line for every result that was read

The store is asked in separate processes, so that a database that does not answer delays no client that plans or
stops.
"""

from __future__ import annotations

import hashlib
import json
import threading
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, TypeVar, TypeVarTuple

from calib.errors import DataError
from calib.text import parse_json
from service import history_calls
from service.http.wire.problems import Problem
from service.http.work.workers import WorkerDied, Workers
from service.refusals import REFUSALS

PROCESSES, CALLS = 2, 10
JOURNAL = "history-kept.jsonl"
SETTLED_S = 30.0  # after an end: what comes next, an identification say, is not held up
AGAIN_S = 60.0  # until a store that was away is tried again
MOST_REFUSED = 50
_KINDS = {
    "diagnoses": "diagnosis",
    "loops": "loop",
    "watches": "watch",
    "upkeeps": "upkeep",
    "runs": "run",
}
_T = TypeVar("_T")
_Ts = TypeVarTuple("_Ts")


class RobotHistory:
    """The history of one service. Thread-safe.

    Nothing is opened before a question or a result.

    Parameters
    ----------
    store : str, optional
        Address of the store; None for a file of the record.
    name : str
        Name of the cell.
    permitted_mm : float, optional
        Position error, RMS, from which dates are calculated; None if it was not stated.
    """

    def __init__(
        self, record: Path, store: str | None, name: str, *, simulated: bool, permitted_mm: float | None
    ) -> None:
        own = record.absolute() / f"history{'-simulated' if simulated else ''}.sqlite3"
        self.address = store or f"sqlite:///{own}"
        self.name, self.simulated, self.permitted_mm = name, simulated, permitted_mm
        self._record = record
        self._workers = Workers(PROCESSES, waiting=CALLS)
        self._changed, self._bringing = threading.Condition(), threading.Lock()
        self._mark = _mark(self.address)
        self._done = _journal(record / JOURNAL, self._mark)
        self._wanted = any(next((record / folder).glob("*/"), None) for folder in _KINDS)
        self._closed, self._trouble = False, ""
        self._thread = threading.Thread(target=self._keep, name="history")
        self._thread.start()

    def ask(self, function: Callable[[str, *_Ts], _T], *args: *_Ts) -> _T:
        """Call a function of `service.history_calls` on the store.

        Raises
        ------
        Problem
            503: the store does not answer in time.
        DataError
            The question cannot be answered.
        """
        return self._workers.call(function, self.address, *args)

    def look(self) -> None:
        """Note that a result has ended; it enters the store in a while, or at the next question."""
        with self._changed:
            self._wanted = True
            self._changed.notify_all()

    def bring(self) -> None:
        """Add all results that have ended to the store.

        If the store does not answer, `refused` has the reason.
        """
        with self._bringing:
            with self._changed:
                if not self._wanted:
                    return
                self._wanted, done = False, frozenset(self._done)
            trouble = ""
            try:
                self._note(self.ask(history_calls.keep, self._record, self.name, done, self.simulated))
            except (*REFUSALS, OSError, WorkerDied) as error:
                trouble = str(error)
            except Problem as problem:
                trouble = problem.detail
            with self._changed:
                self._trouble, self._wanted = trouble, self._wanted or bool(trouble)

    def here(self) -> dict[str, dict[str, str]]:
        """Map documents of the store to the results of this service (kind and id)."""
        found: dict[str, dict[str, str]] = {}
        with self._changed:
            lines = list(self._done.items())
        for path, line in lines:
            folder, own, _ = path.split("/", 2)
            for document in line["documents"]:
                found.setdefault(document, {"kind": _KINDS[folder], "id": own})
        return found

    def refused(self) -> list[dict[str, str]]:
        """Return the results that were not kept, with reasons, newest first; at most 50."""
        with self._changed:
            lines = [(path, line) for path, line in self._done.items() if line["state"] == "refused"]
            away = [{"path": "", "because": self._trouble}] if self._trouble else []
        return away + [
            {"path": path, "because": line["because"]} for path, line in lines[::-1][:MOST_REFUSED]
        ]

    def close(self) -> None:
        """End every question and the thread that keeps."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()
        self._workers.close()
        self._thread.join()

    def _keep(self) -> None:
        """Bring results into the store, a while after their end and while the store is away."""
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._wanted or self._closed)
                if self._changed.wait_for(lambda: self._closed, AGAIN_S if self._trouble else SETTLED_S):
                    return
            self.bring()

    def _note(self, kept: Sequence[dict[str, Any]]) -> None:
        lines = {each["path"]: {"store": self._mark, **each} for each in kept}
        if not lines:
            return
        with (self._record / JOURNAL).open("a", encoding="utf-8") as journal:
            journal.writelines(json.dumps(line) + "\n" for line in lines.values())
        with self._changed:
            self._done.update(lines)


def _mark(address: str) -> str:
    """Return the mark of a store in the journal, because its address may hold a password."""
    return hashlib.sha256(address.encode()).hexdigest()[:16]


def _journal(path: Path, store: str) -> dict[str, dict[str, Any]]:
    """Read the journal's lines about a store, by path.

    The file of a line that was cut off is added again.
    """
    found: dict[str, dict[str, Any]] = {}
    if not path.is_file():
        return found
    for text in path.read_bytes().splitlines():
        with suppress(DataError):
            match parse_json(text, path):
                case {"store": str(of), "path": str(name), "state": str(), "documents": list()} as line:
                    if of == store:
                        found[name] = line
    return found
