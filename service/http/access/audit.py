"""Audits: files of the record such as `lease.jsonl`.

`lease.jsonl` lists who was given the motion lease and why it was taken over. An audit has one JSON object per
line, synced before the noted event takes effect. Lines are only ever added. The events of a run are in its own
record.
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
        """Add a line with the time and an event.

        Raises
        ------
        StorageError
            It cannot be written.
        """
        self.add({"utc": utc_text(time.time()), "what": what, **more})

    def add(self, values: Mapping[str, str | float]) -> None:
        """Add a line of these values, synced to the disk.

        Raises
        ------
        StorageError
            It cannot be written.
        """
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
