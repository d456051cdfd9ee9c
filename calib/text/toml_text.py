"""The reader of all TOML from files and requests: bounded, finite numbers, a few levels."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any

from calib.errors import DataError
from calib.text.plain_values import LONGEST_TEXT, refuse_unusual, too_deep
from calib.text.text_file import read_text

MOST_BYTES = 8 * 1024 * 1024
"""A campaign of 5,000 listed poses has half a megabyte."""
_PARTS = 40
# Python's reader takes time and memory with the square of the parts of a key: a.a.a.a...
_LONG_KEY = re.compile(
    rf"(?<![\w-])(?:(?:[\w-]++|\"[^\"\n]*+\"|'[^'\n]*+')[ \t]*+\.[ \t]*+){{{_PARTS}}}", re.ASCII
)


def read_toml(path: Path) -> tuple[str, dict[str, Any]]:
    """Text and table of a TOML file. Raises DataError naming file, and line or key."""
    text = read_text(path, MOST_BYTES)
    return text, parse_toml(text, path)


def parse_toml(text: str, file: Path | str) -> dict[str, Any]:
    """The table of TOML text. Raises DataError for what is not TOML, or holds unusual values."""
    if len(text) > MOST_BYTES:
        raise DataError(f"is larger than {MOST_BYTES // 2**20} MB.", do="Check the file.", file=file)
    if found := _LONG_KEY.search(text):
        line = text.count("\n", 0, found.start()) + 1
        raise DataError(
            f"a key has more than {_PARTS} parts.", do="Correct that place.", file=file, line=line
        )
    try:
        table = tomllib.loads(text)
    except RecursionError as error:
        raise too_deep(file) from error
    except tomllib.TOMLDecodeError as error:
        raise DataError(f"is not valid TOML ({error}).", do="Correct that place.", file=file) from error
    except ValueError as error:
        raise DataError(
            "holds an integer of thousands of digits.", do="Give a number of 64 bits.", file=file
        ) from error
    refuse_unusual(table, file, longest=LONGEST_TEXT)
    return table
