"""The reader of all JSON from files and requests: bounded, finite numbers, every key once."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from calib.errors import DataError
from calib.text.plain_values import refuse_unusual, too_deep
from calib.text.text_file import decoded, read_text

MOST_BYTES = 64 * 1024 * 1024
_DIGITS = 20  # of an integer of 64 bits, with its sign


def read_json(path: Path) -> Any:
    """Read the value in a JSON file.

    Raises
    ------
    DataError
        The file cannot be read; the error names file, and line or key.
    """
    return parse_json(read_text(path, MOST_BYTES), path)


def parse_json(text: str | bytes, file: Path | str) -> Any:
    """Parse JSON text.

    Raises
    ------
    DataError
        The text is not JSON, a key is given twice, or a value is unusual.
    """

    def once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        table = dict(pairs)
        if len(table) < len(pairs):
            seen: set[str] = set()
            twice = next(key for key, _ in pairs if key in seen or seen.add(key))
            raise DataError("is given twice.", do="Give it once.", file=file, key=twice)
        return table

    def integer(digits: str) -> int:
        if len(digits) > _DIGITS:
            raise DataError(
                f"holds an integer of {len(digits)} digits.", do="Give a number of 64 bits.", file=file
            )
        return int(digits)

    if isinstance(text, bytes):
        text = decoded(text, file)
    try:
        value = json.loads(text, object_pairs_hook=once, parse_int=integer)
    except json.JSONDecodeError as error:
        raise DataError(
            f"is not valid JSON ({error.msg}, column {error.colno}).",
            do="Correct that place."
            if error.pos
            else "Name a file of JSON, e.g. a model that diagnose wrote.",
            file=file,
            line=error.lineno,
        ) from error
    except RecursionError as error:
        raise too_deep(file) from error
    refuse_unusual(value, file)
    return value
