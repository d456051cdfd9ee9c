"""The trail of deletions, `RECORD/deleted.jsonl`, and the events of deleted runs.

The trail has one line for each deletion. The line is durable before anything is deleted; lines are only ever
added. The events of runs are in `RECORD/deleted/`.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

from acquisition import export_events
from acquisition.errors import StorageError
from acquisition.record import sha256_of
from service.http.access.audit import Audit
from service.http.wire.problems import Problem
from service.json_values import utc_text

FILE, FOLDER = "deleted.jsonl", "deleted"
_COMING = ".deleted-"  # ids do not begin with a dot: no list shows files that are being deleted


class DeletionLog:
    """The trail of one record directory."""

    def __init__(self, record: Path) -> None:
        self._record = record
        self._audit = Audit(record, FILE)
        (record / FOLDER).mkdir(exist_ok=True)

    def note(self, kind: str, document: dict[str, Any], by: str, reason: str, **more: str) -> dict[str, Any]:
        """Write that a document is being deleted, and return the line.

        Raises
        ------
        StorageError
            The line cannot be written.
        """
        line = {
            "utc": utc_text(time.time()),
            "kind": kind,
            "id": str(document["id"]),
            "name": str(document.get("name", "")),
            "by": by,
            "reason": reason,
            "created_utc": str(document.get("created_utc", "")),
            "sha256": str(document.get("sha256", "")),
        } | more
        self._audit.add(line)
        return line

    def note_run(
        self, document: dict[str, Any], folder: Path, by: str, reason: str, *, events: bool
    ) -> dict[str, Any]:
        """Write that the run in a folder is being deleted; its events stay, if it has any.

        Returns the line.

        Raises
        ------
        StorageError, RecordError
            The line or the events cannot be written.
        """
        kept = f"{FOLDER}/{folder.name}.events.jsonl"
        if events:
            export_events(folder, self._record / kept)
        more = {"kept": kept} if events else {}
        return self.note("run", document, by, reason, sha256=sha256_of(folder), **more)

    def lines(self) -> dict[str, dict[str, Any]]:
        """Return every line by its number in the file, oldest first.

        A line that the end of the program cut off is missing.
        """
        file = self._record / FILE
        lines = file.read_text("utf-8").splitlines() if file.is_file() else []
        found = {}
        for number, line in enumerate(lines):
            with suppress(json.JSONDecodeError):
                found[f"{number:09}"] = json.loads(line)
        return found


def take_away(place: Path) -> None:
    """Delete a folder or a file, out of sight at once.

    Raises
    ------
    StorageError
        It cannot be deleted.
    Problem
        409: it is in use.
    """
    aside = place.with_name(_COMING + place.name)
    try:
        os.replace(place, aside)
    except PermissionError as error:
        raise Problem(
            409, f"{place.name} is in use.", "Close what reads its files, and delete it then."
        ) from error
    except OSError as error:
        raise StorageError(f"{place.name}: cannot be deleted ({error.strerror})") from error
    if aside.is_dir():
        shutil.rmtree(aside, ignore_errors=True)
    else:
        aside.unlink(missing_ok=True)


def hash_of(file: Path) -> str:
    """Return the SHA-256 of a file in hexadecimal; empty if it cannot be read.

    For a record, use `sha256_of`.
    """
    try:
        with file.open("rb") as content:
            return hashlib.file_digest(content, "sha256").hexdigest()
    except OSError:
        return ""
