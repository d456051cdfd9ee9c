"""Audits, files of the record: who was given the motion lease and why it was taken over (`lease.jsonl`), for instance.

One JSON object a line, each synced before what it notes takes effect; lines are only ever added. What a run does is in
its own events.
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Mapping
from pathlib import Path

from acquisition.errors import StorageError
from service.json_values import utc_text

FILE = "lease.jsonl"
MODE = 0o600


class Audit:
    """The file of one record directory. Who writes keeps the order: one line at a time."""

    def __init__(self, folder: Path, file: str = FILE) -> None:
        self._path = folder / file

    def note(self, what: str, **more: str | float) -> None:
        """Add a line. Raises StorageError where it cannot be written."""
        self.add({"utc": utc_text(time.time()), "what": what, **more})

    def add(self, values: Mapping[str, str | float]) -> None:
        """Add a line of these values. Raises StorageError where it cannot be written."""
        line = json.dumps(dict(values)).encode() + b"\n"
        try:
            with open(self._path, "ab", opener=_open) as file:
                file.write(line)
                file.flush()
                os.fsync(file.fileno())
        except OSError as error:
            raise StorageError(f"{self._path}: cannot be written ({error.strerror})") from error


def _open(name: str, flags: int) -> int:
    return os.open(name, flags, MODE)
