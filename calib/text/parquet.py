"""Data sets as Parquet, the cells of the CSV typed by column, by pyarrow (extra `parquet`).

Columns with a unit at the end of their name, sides, quaternions and waypoints are numbers if every filled cell is one:
doubles, or integers of 64 bits. All others are text, so that an identifier `007` stays one. An empty cell is null.
Numbers are read as the shortest text of the same double, so nothing is lost on the way there or back.
"""

from __future__ import annotations

import io
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from calib.errors import DataError
from calib.text.text_file import MOST_BYTES, read_bytes

if TYPE_CHECKING:
    import pyarrow
    from pyarrow import parquet

PARQUET = ".parquet"
DATA_SETS = (".csv", PARQUET)
"""Endings of the file with the readings of a data set."""

_MOST_CELLS = 50_000_000
_AT_ONCE = 1000  # rows
_OF_NUMBERS = re.compile(r".+_(deg|mm|mrad|s|c)|rot_[wxyz]|approach.+|waypoint")
_WHOLE = re.compile(r"-?(0|[1-9]\d{0,17})")
_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?")


def parquet_of(columns: Mapping[str, Sequence[str]]) -> bytes:
    """Return columns of cells, as a CSV has them, as a Parquet file."""
    import pyarrow
    from pyarrow import parquet

    out = io.BytesIO()
    parquet.write_table(pyarrow.table({name: _typed(name, cells) for name, cells in columns.items()}), out)
    return out.getvalue()


def _typed(name: str, cells: Sequence[str]) -> pyarrow.Array:
    import pyarrow

    filled = [cell.strip() for cell in cells]
    if _OF_NUMBERS.fullmatch(name):
        if all(_WHOLE.fullmatch(cell) for cell in filled if cell):
            return pyarrow.array([int(cell) if cell else None for cell in filled], pyarrow.int64())
        if all(_NUMBER.fullmatch(cell) for cell in filled if cell):
            return pyarrow.array([float(cell) if cell else None for cell in filled], pyarrow.float64())
    return pyarrow.array([cell or None for cell in cells], pyarrow.string())


def parquet_cells(path: Path) -> tuple[list[str], list[tuple[str, ...]], bytes]:
    """Read a Parquet file: the names of its columns, the cells of its rows, and its content.

    Raises
    ------
    DataError
        The file is no Parquet, is too large, or a column has neither numbers nor text; the error names the column.
    """
    import pyarrow
    from pyarrow import parquet

    content = read_bytes(path)
    try:
        file = parquet.ParquetFile(io.BytesIO(content))
        about = file.metadata
        if about.num_rows * about.num_columns > _MOST_CELLS:
            raise DataError(
                f"has {about.num_rows} rows and {about.num_columns} columns.", do="Split it.", file=path
            )
        names = file.schema_arrow.names
        if other := [field for field in file.schema_arrow if not _is_plain(field.type)]:
            raise DataError(
                f"column '{other[0].name}' holds {other[0].type}, neither numbers nor text.",
                do="Leave it out, or store plain numbers in the unit of its name.",
                file=path,
            )
        table = pyarrow.Table.from_batches(_bounded(file, path), file.schema_arrow)
        columns = [_cells(column) for column in table.columns]
    except (pyarrow.ArrowException, OSError) as error:
        raise DataError(
            f"cannot be read as Parquet ({type(error).__name__}).",
            do="Write it again, or give the CSV.",
            file=path,
        ) from error
    return names, list(zip(*columns, strict=True)), content


def _bounded(file: parquet.ParquetFile, path: Path) -> Iterator[pyarrow.RecordBatch]:
    """Yield a few rows at a time: a small file can hold one long text in a million rows."""
    left = MOST_BYTES
    for batch in file.iter_batches(_AT_ONCE):
        left -= batch.nbytes
        if left < 0:
            raise DataError(
                f"holds more than {MOST_BYTES / 1024 / 1024:g} MB.",
                do="Split it, or leave out text.",
                file=path,
            )
        yield batch


def _is_plain(kind: pyarrow.DataType) -> bool:
    from pyarrow import types

    if types.is_dictionary(kind):
        return _is_plain(kind.value_type)
    plain = (types.is_integer, types.is_floating, types.is_string, types.is_large_string, types.is_null)
    return any(test(kind) for test in plain)


def _cells(column: pyarrow.ChunkedArray) -> list[str]:
    """Return the cells of a column as text; null and NaN, as pandas writes it, are empty."""
    import pyarrow
    from pyarrow import types

    if types.is_dictionary(column.type):
        column = column.cast(column.type.value_type)
    if types.is_string(column.type) or types.is_large_string(column.type):
        return [cell or "" for cell in column.to_pylist()]
    if types.is_floating(column.type):
        column = column.cast(pyarrow.float64())
    return ["" if cell is None or cell != cell else repr(cell) for cell in column.to_pylist()]
