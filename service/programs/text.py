"""Program files as text that goes back to the very bytes it came from, and edits that touch nothing else.

Controllers write UTF-8, Latin-1 or anything else: bytes that are not UTF-8 travel as surrogates, and line ends,
tabs and a byte order mark stay as they are.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from calib.errors import DataError
from calib.files import replace_file


@dataclass(frozen=True)
class Edit:
    """Replace text[start:end] by `text`."""

    start: int
    end: int
    text: str


def read_text(path: Path) -> str:
    """A program as text. Raises DataError when there is no such file or it holds binary data."""
    try:
        data = path.read_bytes()
    except (FileNotFoundError, IsADirectoryError) as error:
        raise DataError("there is no such file.", do="Check the name.", file=path) from error
    if b"\0" in data:
        raise DataError("is not a text file.", do="Save the program as text (ASCII).", file=path)
    return data.decode("utf-8", errors="surrogateescape")


def write_text(path: Path, text: str) -> None:
    """Write a program whole or not at all, byte for byte where nothing was edited."""
    replace_file(path, text.encode("utf-8", errors="surrogateescape"))


def edited(text: str, edits: Iterable[Edit]) -> str:
    """The text with all edits made. Raises ValueError when two of them overlap."""
    out, at = [], 0
    for edit in sorted(edits, key=lambda e: e.start):
        if edit.start < at:
            raise ValueError("two edits of a program overlap")
        out += [text[at : edit.start], edit.text]
        at = edit.end
    return "".join([*out, text[at:]])


def line_of(text: str, at: int) -> int:
    """Line number, from 1, of a position in the text."""
    return text.count("\n", 0, at) + 1


def decimal(value: float, places: int) -> str:
    """A number with so many places, without zeros at its end, never in exponents and never '-0'."""
    short = f"{value:.{places}f}".rstrip("0").rstrip(".")
    return "0" if short in ("-0", "") else short
