"""Layout of a sheet: the lines of names, units and readings, and the lines to leave out.

A table is a sequence of rows with numbers in the same columns, below a row of words. Lines above it are
a preamble. A row of units may follow the names, and names may take two lines (a group over x, y, z). A
row of means or a remark below is left out and reported. Two tables on one sheet are never joined.

Reports of inspection programs have tables with one coordinate per line. These are joined to one point
per line. So are matrices of four lines, the last of which is 0 0 0 1.

    Name   Control   Nom       Meas        Dev                 Name  Nom X  Meas X  Dev X  Nom Y ..
    P1     X         100.000   100.0213    0.021       ->      P1    100.0  100.02  0.021  ..
           Y         200.000   199.9871   -0.013

A point begins at its X; its name may be given on that line only. Lines for other quantities than X, Y
and Z (a distance, a diameter) are left out.

**Units** are found in headers as words: `[mm]`, `(deg)`, `in °`, `Grad`, `_rad`.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

from calib.errors import DataError
from calib.foreign.files.number import NOT_MEASURED, Notation, is_number, notation_of, seconds_of
from calib.foreign.files.sheet import FEWEST_NUMBERS, Sheet, SheetRow, wide_blanks

_SUMMARY = re.compile(
    r"(mean|average|avg|median|min|max|minimum|maximum|std|stdev|rms|range|sum|total|mittel|mittelwert|durchschnitt"
    r"|standardabweichung|stabw|spannweite|summe|streuung)\W*",
    re.IGNORECASE,
)

_PREAMBLE_UNIT = re.compile(
    r"\b(?:units?|einheit(?:en)?)\b[^\w°]*+(?:(?:length|angle|länge|winkel)[^\w°]*+)?([\w°µμ]+)",
    re.IGNORECASE,
)

_LOST = frozenset(NOT_MEASURED) - {"x"}  # which names a column

_SHOWN = 10  # tables

_FEW = 2  # rows above the names that look like readings and are none

_OTHERS = {"d", "dist", "distance", "3d", "diameter", "dxyz", "dl", "dn", "t", "abstand"}

_WORDS = {
    "mm": ("mm", "millimeter", "millimeters", "millimetre", "millimetres"),
    "m": ("m", "meter", "meters", "metre", "metres"),
    "um": ("um", "µm", "μm", "micron", "microns", "micrometer", "mikrometer"),
    "cm": ("cm", "centimeter", "zentimeter"),
    "in": ("in", "inch", "inches", "zoll", '"'),
    "deg": ("deg", "degs", "degree", "degrees", "°", "grad", "º"),
    "rad": ("rad", "radian", "radians", "bogenmaß", "bogenmass"),
    "mrad": ("mrad",),
    "gon": ("gon",),
    "s": ("s", "sec", "secs", "second", "seconds", "sekunde", "sekunden"),
    "ms": ("ms", "msec", "millisecond", "milliseconds"),
    "us": ("us", "µs", "μs"),
    "min": ("min", "minutes"),
    "c": ("c", "°c", "degc", "celsius"),
    "?": ("ft", "feet", "km", "µrad", "arcsec", "inc", "incs", "counts", "%", "k", "°f"),
}

_UNIT = {word: unit for unit, words in _WORDS.items() for word in words}

_NO_UNIT = ("", "-", "--", "1", "text", "[-]", "(-)", "string", "n/a")

LONGEST = 200

"""Characters of a name that is looked at: what is longer names nothing."""

_BRACKETS = re.compile(r"[\[({<]\s*([^\])}>]{1,15}?)\s*[\])}>]")

_BEHIND = re.compile(r"(?:\s+in\s+|[_/,\s]\s*)([A-Za-zµμ°º\"]{1,12})$")


@dataclass(frozen=True)
class Layout:
    """A table of a sheet.

    Attributes
    ----------
    names : tuple of str
        Names of the columns, each once (`X`, `X#2`).
    units : tuple of str
        From the row of units, '' without one.
    rows : tuple of SheetRow
        Rows of readings.
    said : tuple of str
        Remarks on how the other rows were read.
    above : tuple of str
        Text of the preamble.
    """

    sheet: Sheet
    names: tuple[str, ...]
    units: tuple[str, ...]
    rows: tuple[SheetRow, ...]
    header_line: int | None
    said: tuple[str, ...]
    above: tuple[str, ...]

    @cached_property
    def cells(self) -> dict[str, tuple[str, ...]]:
        """Name -> its cells, row by row; '' beyond the end of a short row."""
        return {
            name: tuple(row.cells[k] if k < len(row.cells) else "" for row in self.rows)
            for k, name in enumerate(self.names)
        }

    @cached_property
    def lines(self) -> tuple[int, ...]:
        """The line of every row."""
        return tuple(row.line for row in self.rows)

    def spoilt(self, row: int, name: str) -> str:
        """Return the reason why a cell holds no value, or ''."""
        return self.sheet.spoilt.get((self.lines[row], self.names.index(name)), "")

    @cached_property
    def stated_unit(self) -> tuple[str, int] | None:
        """The unit of lengths that the preamble states, and the number of its line among `above`."""
        for i, text in enumerate(self.above):
            if (match := _PREAMBLE_UNIT.search(text)) and unit_of(match[1]):
                return unit_of(match[1]), i
        return None


@dataclass(frozen=True)
class TwoTables(Exception):
    """A sheet has several tables; `lines` are the first and last line of each."""

    lines: tuple[tuple[int, int], ...]


def layout_of(sheet: Sheet, lines: tuple[int, int] | None = None) -> Layout | None:
    """Find the only table of a sheet, or of its lines `lines`; None if there is none.

    Raises
    ------
    TwoTables
        There are several tables.
    """
    rows = [row for row in sheet.rows if lines is None or lines[0] <= row.line <= lines[1]]
    blocks = _blocks(rows)
    if not blocks:
        return None
    if len(blocks) > 1:
        blocks = _joined(rows, blocks)
    if len(blocks) > 1:
        raise TwoTables(tuple((rows[_top(rows, b)].line, rows[b[-1]].line) for b in blocks))
    of = blocks[0]
    width = Counter(len(rows[i].cells) for i in of).most_common(1)[0][0]
    names, units, top, said = _header(sheet, rows, of[0], width)
    readings, left = [], []
    inside = set(of)
    for i in range(of[0], len(rows)):
        row = rows[i]
        if i in inside and not any(_SUMMARY.fullmatch(cell) for cell in row.cells[:3]):
            readings.append(row)
        elif top is None or row.cells != rows[top].cells:
            left.append(row)
    said += [f"line {row.line} is left aside: '{' '.join(filter(None, row.cells))[:50]}'" for row in left[:5]]
    if len(left) > 5:
        said.append(f"{len(left) - 5} more lines between or below the readings are left aside")
    longest = max(len(row.cells) for row in readings)
    if longest > len(names):
        names += [f"column {k + 1}" for k in range(len(names), longest)]
        units += [""] * (longest - len(units))
    first = of[0] if top is None else top
    above = tuple(" ".join(filter(None, row.cells)) for row in rows[:first])
    line = None if top is None else rows[top].line
    return Layout(sheet, _each_once(names), tuple(units), tuple(readings), line, tuple(said), above)


def _value(cell: str) -> bool:
    return is_number(cell) or seconds_of(cell) is not None


def _blocks(rows: Sequence[SheetRow]) -> list[list[int]]:
    """Find runs of rows with values in the most common columns, separated by rows of words."""
    where = [
        frozenset() if row.comment else frozenset(k for k, cell in enumerate(row.cells) if _value(cell))
        for row in rows
    ]
    common = [each for each in where if len(each) >= FEWEST_NUMBERS]
    if not common:
        return []
    usual = Counter(common).most_common(1)[0][0]
    blocks: list[list[int]] = [[]]
    for i, row in enumerate(rows):
        # another table may have its numbers elsewhere
        if len(where[i]) >= FEWEST_NUMBERS and (
            len(where[i] & usual) * 2 >= len(usual) or len(where[i]) * 2 >= len(usual)
        ):
            blocks[-1].append(i)
        elif _words(row) >= max(2, len(usual) // 2) and not where[i] and blocks[-1]:
            blocks.append([])
    return [block for block in blocks if block]


def _words(row: SheetRow) -> int:
    """Different words of a row that may name columns."""
    return len({cell for cell in row.cells if not _value(cell) and cell.lower() not in _LOST})


def _joined(rows: Sequence[SheetRow], blocks: list[list[int]]) -> list[list[int]]:
    """Join blocks of rows that belong to one table.

    Two blocks are joined if the names are repeated between them (a page break). A few rows above the
    first names are left out.
    """
    if len(blocks[0]) <= _FEW < len(blocks[1]) and _top(rows, blocks[0]) == blocks[0][0]:
        blocks = blocks[1:]
    out = [blocks[0]]
    for before, block in pairwise(blocks):
        same = rows[_top(rows, block)].cells == rows[_top(rows, before)].cells
        lost = all(row.cells[:1] and _words(row) < len(row.cells) for row in rows[before[-1] + 1 : block[0]])
        if same or (lost and _top(rows, block) == block[0]):
            out[-1] = out[-1] + block
        else:
            out.append(block)
    return out


def _top(rows: Sequence[SheetRow], block: list[int]) -> int:
    """Find the row that names the columns of a block; its first reading if none does."""
    for i in range(block[0] - 1, max(block[0] - 4, -1), -1):
        if unit_row(rows[i].cells):
            continue
        return i if _words(rows[i]) >= 2 and not any(map(_value, rows[i].cells)) else block[0]
    return block[0]


def _header(
    sheet: Sheet, rows: Sequence[SheetRow], first: int, width: int
) -> tuple[list[str], list[str], int | None, list[str]]:
    """Find names, units, the index of the row of names (None without) and remarks."""
    top = _top(rows, [first])
    units = [""] * width
    said: list[str] = []
    for row in rows[top + 1 : first]:
        if unit_row(row.cells):
            units = [unit_of(cell) for cell in row.cells] + [""] * (width - len(row.cells))
            said.append(f"line {row.line} holds units")
    if top == first:
        return (
            [f"column {k + 1}" for k in range(width)],
            units,
            None,
            ["no line names the columns: they are numbered"],
        )
    names = list(rows[top].cells)
    if len(names) != width and sheet.separator == "blanks":
        wide = wide_blanks(sheet.path, rows[top].line)
        names = wide if len(wide) == width else names
        if len(names) != width:
            said = [
                f"line {rows[top].line} has {len(names)} words over {width} columns: columns are numbered"
            ]
            return [f"column {k + 1}" for k in range(width)], units, None, said
    if (
        sheet.separator == "comma"
        and len(names) < width
        and not any("." in cell for cell in rows[first].cells)
    ):
        raise DataError(
            f"has {len(names)} names over {width} columns: commas stand between the cells and in the numbers.",
            do="Export it with semicolons or tabs between the cells, or with decimal points.",
            file=sheet.shown,
            line=rows[first].line,
        )
    names += [""] * (width - len(names))
    names = [name or f"column {k + 1}" for k, name in enumerate(names)]
    if top and not any(map(_value, rows[top - 1].cells)):
        over = _groups(sheet, rows[top - 1], len(names))
        if over and (len(set(names)) < len(names) or _merged(sheet, rows[top - 1])):
            said.append(f"names of lines {rows[top - 1].line} and {rows[top].line} are joined")
            whole = _merged(
                sheet, rows[top - 1]
            )  # else how far a group reaches is told by names that come again
            names = [
                f"{group} {name}" if group and (whole or names.count(name) > 1) else name
                for group, name in zip(over, names, strict=True)
            ]
    said.insert(0, f"line {rows[top].line} names the columns")
    return names, units, top, said


def _merged(sheet: Sheet, row: SheetRow) -> bool:
    return any(line == row.line for line, _ in sheet.groups)


def _groups(sheet: Sheet, row: SheetRow, width: int) -> list[str]:
    """Find the group over each column; return [] if the row is none of groups."""
    filled = [k for k, cell in enumerate(row.cells[:width]) if cell]
    if not filled or row.comment or len(row.cells) > width or (len(filled) == 1 and not _merged(sheet, row)):
        return []
    if _merged(sheet, row):
        return [
            sheet.groups.get((row.line, k), row.cells[k] if k < len(row.cells) else "") for k in range(width)
        ]
    out, group = [], ""
    for k in range(width):
        group = (row.cells[k] if k < len(row.cells) else "") or group
        out.append(group)
    return out


def _each_once(names: Sequence[str]) -> tuple[str, ...]:
    count: Counter[str] = Counter()
    out = []
    for name in names:
        count[name] += 1
        out.append(name if count[name] == 1 else f"{name}#{count[name]}")
    return tuple(out)


def layouts_of(sheets: Sequence[Sheet], lines: tuple[int, int] | None = None) -> list[Layout]:
    """Find the table of every sheet that has one.

    Raises
    ------
    DataError
        No sheet has a table, or one has several.
    """
    out = []
    for sheet in sheets:
        try:
            found = layout_of(sheet, lines)
        except TwoTables as two:
            shown = ", ".join(f"{first} to {last}" for first, last in two.lines[:_SHOWN])
            shown += ", ..." if len(two.lines) > _SHOWN else ""
            raise DataError(
                f"holds {len(two.lines)} tables, in lines {shown}.",
                do=f"Choose: lines = [{two.lines[0][0]}, {two.lines[0][1]}] in the map, or --lines "
                f"{two.lines[0][0]} {two.lines[0][1]}.",
                file=sheet.shown,
            ) from two
        out += [found] if found is not None and found.rows else []
    if not out:
        raise DataError(
            f"holds no table: no rows with {FEWEST_NUMBERS} numbers or more.",
            do="Give one row per reading, with columns separated by tabs, semicolons, commas or blanks.",
            file=sheets[0].path,
        )
    return out


def joined(layout: Layout) -> Layout:
    """Join a layout to one point per line; return it unchanged if it has no column of axes.

    Raises
    ------
    DataError
        A point lacks a coordinate, or its coordinates are not in order.
    """
    if (whole := _matrices(layout)) is not None:
        return whole
    axis = next((name for name in layout.names if _axes(layout.cells[name])), None)
    if axis is None:
        return layout
    values = [name for name in layout.names if name != axis and any(map(is_number, layout.cells[name]))]
    texts = [name for name in layout.names if name not in (axis, *values)]
    points: list[list[int]] = []
    for i, cell in enumerate(layout.cells[axis]):
        if cell.lower() == "x":
            points.append([i])
        elif cell.lower() in ("y", "z"):
            if (
                not points
                or len(points[-1]) != "xyz".index(cell.lower())
                or _renamed(layout, texts, points[-1][0], i)
            ):
                raise DataError(
                    f"has {cell} where another coordinate is due: every point needs X, Y and Z, one below the other.",
                    do="Export x, y and z of a point on one line.",
                    file=layout.sheet.shown,
                    line=layout.lines[i],
                )
            points[-1].append(i)
    short = next((point for point in points if len(point) < 3), None)
    if short is not None:
        raise DataError(
            "has a point without Z.",
            do="Export x, y and z of every point.",
            file=layout.sheet.shown,
            line=layout.lines[short[0]],
        )
    names = (*texts, *(f"{name} {letter}" for letter in "XYZ" for name in values))
    rows = tuple(
        SheetRow(
            layout.lines[of[0]],
            (
                *(layout.cells[name][of[0]] for name in texts),
                *(layout.cells[name][i] for i in of for name in values),
            ),
        )
        for of in points
    )
    said = f"one coordinate a line (column '{axis}'): joined to {len(points)} points"
    units = tuple("" for _ in texts) + tuple(
        dict(zip(layout.names, layout.units, strict=False)).get(n, "") for _ in "XYZ" for n in values
    )
    return replace(layout, names=names, units=units, rows=rows, said=(*layout.said, said))


def _matrices(layout: Layout) -> Layout | None:
    """Join a layout to one matrix per line, or return None if its lines are not matrices.

    Every four lines of four numbers must be a matrix whose last line is 0 0 0 1.
    """
    rows = layout.rows
    if layout.header_line is not None or len(layout.names) != 4 or len(rows) % 4 or not rows:
        return None
    notation = notation_of(layout.cells.values()) or Notation()
    last = [tuple(map(notation.number, row.cells)) for row in rows[3::4]]
    if any(cells != (0.0, 0.0, 0.0, 1.0) for cells in last):
        return None
    joined_rows = tuple(
        SheetRow(rows[i].line, tuple(cell for row in rows[i : i + 4] for cell in row.cells))
        for i in range(0, len(rows), 4)
    )
    names = tuple(f"T{row}{column}" for row in range(1, 5) for column in range(1, 5))
    said = f"four lines of four numbers are a matrix: joined to {len(joined_rows)} poses"
    return replace(layout, names=names, units=("",) * 16, rows=joined_rows, said=(*layout.said, said))


def _axes(cells: tuple[str, ...]) -> bool:
    found = {cell.lower() for cell in cells}
    return set("xyz") <= found and found <= set("xyz") | _OTHERS


def _renamed(layout: Layout, texts: list[str], first: int, row: int) -> bool:
    return bool(texts) and layout.cells[texts[0]][row] not in ("", layout.cells[texts[0]][first])


def unit_of(text: str) -> str:
    """Return the unit of a word, for example mm for `[mm]`.

    The result is `?` for a unit that is not supported, and '' for other words.
    """
    bare = text.strip().strip("[](){}<>").strip().lower()
    return _UNIT.get(bare, "")


def split(name: str) -> tuple[str, str]:
    """Split the name of a column from its unit: `X Pos. [mm]` -> `X Pos.`, mm."""
    if len(name) > LONGEST:
        return name, ""
    for match in _BRACKETS.finditer(name):
        if unit := unit_of(match[1]):
            return (name[: match.start()] + " " + name[match.end() :]).strip(), unit
    if (match := _BEHIND.search(name)) and (unit := _UNIT.get(match[1].lower(), "")) and match.start() > 0:
        single = len(match[1]) == 1 and match[1].isalpha()
        # a letter alone is a unit behind `_` or `/`, else a name: `Euler C`, `t_s`
        behind = name[match.start()] in "_/" and (unit != "c" or name.lower().startswith("t"))
        if not single or behind:
            return name[: match.start()].strip(), unit
    return name, ""


def unit_row(cells: Sequence[str]) -> bool:
    """Test whether a row holds only units."""
    found = [cell for cell in cells if cell.strip().lower() not in _NO_UNIT]
    return len(found) >= 2 and all(unit_of(cell) for cell in found)
