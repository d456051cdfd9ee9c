"""Program files as text with the original bytes, and edits that change nothing more.

Controllers write UTF-8, Latin-1 or other encodings. Bytes that are not UTF-8 are kept as surrogates. Line ends,
tabs and a byte order mark stay as they are.
"""

from __future__ import annotations

import re
from bisect import bisect_left
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from calib.errors import DataError
from calib.text import read_bytes, replace_file

MOST_BYTES = 32 * 1024 * 1024
LONGEST_LINE = 1_000_000
"""A module may write a whole array of targets on one line."""
_LINE_END = re.compile(r"\r\n|\r|\n")


@dataclass(frozen=True)
class Edit:
    """Replace text[start:end] by `text`."""

    start: int
    end: int
    text: str


def read_text(path: Path) -> str:
    """Read a program as text.

    Raises
    ------
    DataError
        There is no such file, it is too large, or it holds binary data.
    """
    return text_of(read_bytes(path, MOST_BYTES), path)


def text_of(data: bytes, path: Path) -> str:
    """Decode the text of a program's bytes.

    Raises
    ------
    DataError
        The bytes are binary data.
    """
    if b"\0" in data:
        raise DataError("is not a text file.", do="Save the program as text (ASCII).", file=path)
    return data.decode("utf-8", errors="surrogateescape")


def write_text(path: Path, text: str) -> None:
    """Write a program whole or not at all, byte for byte where nothing was edited."""
    replace_file(path, bytes_of(text))


def bytes_of(text: str) -> bytes:
    """Return the bytes of a program's text."""
    return text.encode("utf-8", errors="surrogateescape")


def edited(text: str, edits: Iterable[Edit]) -> str:
    """Return the text with all edits made; lines keep their numbers.

    Raises
    ------
    ValueError
        Two edits overlap.
    """
    out, at = [], 0
    for edit in sorted(edits, key=lambda e: e.start):
        if edit.start < at:
            raise ValueError("two edits of a program overlap")
        out += [text[at : edit.start], edit.text, *_LINE_END.findall(text, edit.start, edit.end)]
        at = edit.end
    return "".join([*out, text[at:]])


class Lines:
    """Line numbers of positions in a text.

    Raises
    ------
    DataError
        A line is longer than any controller writes.
    """

    def __init__(self, text: str, file: str) -> None:
        self._ends = [match.end() for match in _LINE_END.finditer(text)]
        for number, (begin, end) in enumerate(
            zip([0, *self._ends], [*self._ends, len(text)], strict=True), 1
        ):
            if end - begin > LONGEST_LINE:
                raise DataError(
                    f"has {end - begin} characters; at most {LONGEST_LINE} are taken.",
                    do="Break the line.",
                    file=file,
                    line=number,
                )

    def at(self, position: int) -> int:
        """Line number, from 1; lines end with LF, CR, or both."""
        return bisect_left(self._ends, position + 1) + 1


@dataclass(frozen=True)
class Number:
    """A number in a program, text[start:end], and its value."""

    start: int
    end: int
    value: float


def decimal(value: float, places: int) -> str:
    """Format a number with `places` decimals.

    It has no zeros at its end, no exponent, and is never '-0'.
    """
    short = f"{value:.{places}f}".rstrip("0").rstrip(".")
    return "0" if short in ("-0", "") else short
