"""Log for programs: one JSON object per line.

Each object has the members `utc`, `level`, `from` and `message`, and the additional members of the record.
"""

from __future__ import annotations

import json
import logging
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from calib.errors import DataError
from service.files import STANDARD_OUTPUT
from service.json_values import finite, utc_text

_LONGEST = 65536  # bytes of a line that are checked
NAMES = ("service", "acquisition", "drivers", "uvicorn.error")


class JsonLines(logging.Formatter):
    """Formatter that writes a record as one JSON line; `extra={"told": {...}}` adds members."""

    def format(self, record: logging.LogRecord) -> str:
        """Return the line, without its line end."""
        line = {
            "utc": utc_text(record.created),
            "level": record.levelname.lower(),
            "from": record.name,
            "message": record.getMessage(),
            **getattr(record, "told", {}),
        }
        if record.exc_info:
            line["traceback"] = self.formatException(record.exc_info)
        return json.dumps(finite(line))


def _may_grow(file: Path) -> bool:
    """Return whether a log may be appended to a file.

    That is so if the file is a log of this program, is empty, does not exist, or is not an ordinary file.
    """
    try:
        with file.open("rb") as stream:
            first = stream.readline(_LONGEST) if file.is_file() else b""
    except OSError:  # reported when the log is opened
        return True
    return not first or first.startswith(b'{"utc": ')


@contextmanager
def json_log(file: str | None) -> Iterator[None]:
    """Append a log to a file during the block; no log if `file` is None.

    With `-` the log is written to standard error.

    Raises
    ------
    DataError
        The file cannot be written, or is not a log of this program.
    """
    if file is None:
        yield
        return
    if file != STANDARD_OUTPUT and not _may_grow(Path(file)):
        raise DataError(
            f"{file} is not a log of this program.",
            do="Name another file; a log is appended to the content of its file.",
            key="--log",
        )
    try:
        handler = (
            logging.StreamHandler(sys.stderr)
            if file == STANDARD_OUTPUT
            else logging.FileHandler(file, "a", "utf-8")
        )
    except OSError as error:
        raise DataError(
            f"cannot be written ({error.strerror}).", do="Name another file.", key="--log"
        ) from error
    handler.setFormatter(JsonLines())
    loggers = [logging.getLogger(name) for name in NAMES]
    before = [each.level for each in loggers]
    for each in loggers:
        each.addHandler(handler)
        each.setLevel(logging.INFO)
    try:
        yield
    finally:
        for each, level in zip(loggers, before, strict=True):
            each.removeHandler(handler)
            each.setLevel(level)
        handler.close()
