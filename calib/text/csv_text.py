"""The reader of CSV: rows with their line numbers; the lengths of lines and the number of columns are bounded."""

from __future__ import annotations

import csv
import io
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from calib.errors import DataError

LONGEST_LINE = 100_000
MOST_COLUMNS = 1_000
"""A robot of six joints with everything that can be measured has 60."""


def rows_of(text: str, file: Path | str, delimiter: str = ",") -> list[tuple[int, list[str]]]:
    """Line number, from 1, and cells of every row. Raises DataError (file, line) for what is no table."""
    reader = csv.reader(taken(io.StringIO(text, newline="\n"), file), delimiter=delimiter)
    out = []
    try:
        for row in reader:
            refuse_wide(len(row), file, reader.line_num)
            out.append((reader.line_num, row))
    except csv.Error as error:
        raise DataError(
            f"cannot be read ({error}).", do="Correct that line.", file=file, line=reader.line_num
        ) from error
    return out


def refuse_wide(columns: int, file: Path | str, line: int) -> None:
    """Raise DataError when a row has more columns than are taken."""
    if columns > MOST_COLUMNS:
        raise DataError(
            f"has {columns} columns; at most {MOST_COLUMNS} are taken.",
            do="Leave out columns that nobody reads.",
            file=file,
            line=line,
        )


def other_mark(names: Sequence[str]) -> str | None:
    """The word for what separates the cells of a header row, where it is no comma; None where it is."""
    marks = {";": "semicolons", "\t": "tabs"}
    return next((word for mark, word in marks.items() if len(names) == 1 and mark in names[0]), None)


def refuse_twice(names: Sequence[str], file: Path | str) -> None:
    """Raise DataError when a column of the header row is there twice."""
    name, count = Counter(name for name in names if name).most_common(1)[0] if any(names) else ("", 0)
    if count > 1:
        raise DataError(f"column '{name}' is there twice.", do="Keep one.", file=file, line=1)


def taken(lines: Iterable[str], file: Path | str, do: str = "Correct that line.") -> Iterator[str]:
    """The lines of a file, none longer than `LONGEST_LINE`. Raises DataError (file, line) for one that is longer."""
    for number, line in enumerate(lines, start=1):
        if len(line) > LONGEST_LINE:
            raise DataError(
                f"has {len(line)} characters; at most {LONGEST_LINE} are taken.",
                do=do,
                file=file,
                line=number,
            )
        yield line
