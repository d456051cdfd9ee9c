"""Workbooks (.xlsx): values of cells as Excel last saved them, and merged cells.

They are read with openpyxl. A merged cell over several rows is the value of each; over several columns,
it is a group of names. A formula counts by its saved value. One that was never computed, and an error
such as #DIV/0!, is no value, with the reason. Dates stay dates, even if a spreadsheet has made one of a
number.
"""

from __future__ import annotations

import datetime
import io
import warnings
from pathlib import Path
from typing import Any

from calib.errors import DataError
from calib.foreign.files.packed import MOST_CELLS, UNREADABLE, refuse_bomb
from calib.foreign.files.sheet import Sheet, SheetRow
from calib.text.columns import MOST_COLUMNS
from calib.text.text_file import read_bytes

_MOST_BYTES = 64 * 1024 * 1024
_MOST_ROWS = 300_000
_LONGEST = 32_767  # characters of a cell, as Excel has it
_ERRORS = (KeyError, IndexError, ValueError, TypeError, AttributeError, ArithmeticError, SyntaxError)


def workbook_sheets(path: Path) -> list[Sheet]:
    """Read every visible sheet that holds anything.

    Raises
    ------
    DataError
        The file is no workbook, is too large, or holds no filled sheet.
    """
    data = _bytes(path)
    with warnings.catch_warnings():
        warnings.simplefilter(
            "ignore"
        )  # of parts of a workbook that hold no cells: styles, filters, printers
        values, formulas = _load(path, data, values=True), _load(path, data, values=False)
    out = []
    for sheet in values.worksheets:
        if sheet.sheet_state == "visible":
            found = _sheet(path, sheet, formulas[sheet.title])
            if found.rows:
                out.append(found)
    if not out:
        raise DataError("holds no filled sheet.", do="Check the file.", file=path)
    return out


def _load(path: Path, data: bytes, *, values: bool) -> Any:
    import openpyxl  # of no use to whoever has no workbook, and slow to import
    from openpyxl.utils import exceptions

    odd = (
        exceptions.CellCoordinatesException,
        exceptions.SheetTitleException,
        exceptions.NamedRangeException,
    )
    odd += (exceptions.IllegalCharacterError, exceptions.InvalidFileException)
    try:
        return openpyxl.load_workbook(io.BytesIO(data), data_only=values)
    except (*_ERRORS, *UNREADABLE, *odd) as error:
        raise DataError(
            f"cannot be read as a workbook ({type(error).__name__}).",
            do="Open it in Excel or LibreOffice and save it as .xlsx, or export the sheet as CSV.",
            file=path,
        ) from error


def _bytes(path: Path) -> bytes:
    """Read the file.

    Raises
    ------
    DataError
        The file cannot become a workbook within bounds.
    """
    if path.suffix.lower() == ".xls":
        raise DataError("is a workbook of before 2007.", do="Save it as .xlsx.", file=path)
    data = read_bytes(path, _MOST_BYTES)
    refuse_bomb(data, path)
    return data


def _sheet(path: Path, values: Any, formulas: Any) -> Sheet:
    size = values.max_row, values.max_column
    if size[0] > _MOST_ROWS or size[1] > MOST_COLUMNS or size[0] * size[1] > MOST_CELLS:
        raise DataError(
            f"sheet '{values.title}' has {size[0]} rows and {size[1]} columns.",
            do="Delete what lies outside the table (also emptied rows), or export it as CSV.",
            file=path,
        )
    grid = [[_text(cell) for cell in row] for row in values.iter_rows(values_only=True)]
    long = next((i for i, row in enumerate(grid, 1) if any(len(cell) > _LONGEST for cell in row)), None)
    if long is not None:
        raise DataError(
            f"a cell of sheet '{values.title}' has more than {_LONGEST} characters.",
            do="Shorten it, or export the table as CSV.",
            file=path,
            line=long,
        )
    spoilt: dict[tuple[int, int], str] = {}
    computed = dates = 0
    for cells, row in zip(formulas.iter_rows(), grid, strict=True):
        for cell in cells:
            where = (cell.row, cell.column - 1)
            if cell.data_type == "f":
                computed += 1
                if not row[cell.column - 1]:
                    spoilt[where] = "holds a formula whose value was never computed"
            if cell.data_type == "d":
                dates += 1
                spoilt.setdefault(where, "is a date to the spreadsheet, not a number")
            if row[cell.column - 1].startswith("#") and row[cell.column - 1].endswith(("!", "?", "A")):
                spoilt[where] = f"holds the error {row[cell.column - 1]}"
    groups, filled = _merged(values, grid)
    said = []
    if computed:
        said.append(f"{computed} cells are formulas: the values that were saved with them count")
    if filled:
        said.append(f"{filled} cells merged over several rows: each row has the value")
    rows = tuple(SheetRow(i, tuple(row)) for i, row in enumerate(grid, start=1) if any(row))
    return Sheet(path, values.title, rows, "", tuple(said), groups, spoilt)


def _merged(sheet: Any, grid: list[list[str]]) -> tuple[dict[tuple[int, int], str], int]:
    """Find groups of names in merged cells, and fill cells that are merged downwards.

    Groups are by line and column of the rests of cells merged in one row. Also returns the number of
    cells filled.
    """
    groups: dict[tuple[int, int], str] = {}
    filled = 0
    for area in sheet.merged_cells.ranges:
        value = grid[area.min_row - 1][area.min_col - 1]
        if area.min_row == area.max_row:
            groups.update({(area.min_row, k): value for k in range(area.min_col - 1, area.max_col)})
        elif area.min_col == area.max_col:
            for row in grid[area.min_row : area.max_row]:
                row[area.min_col - 1] = value
                filled += 1
    return groups, filled


def _text(value: Any) -> str:
    if value is None:
        return ""
    if isinstance(value, bool):
        return str(int(value))
    if isinstance(value, float):
        return repr(int(value)) if value.is_integer() and abs(value) < 1e15 else repr(value)
    if isinstance(value, datetime.datetime | datetime.date | datetime.time):
        return value.isoformat(" ") if isinstance(value, datetime.datetime) else value.isoformat()
    return str(value).strip()
