"""Tables with one coordinate a line, as reports of inspection programs have them: joined to one point a line. So are
matrices of four lines, the last of which is 0 0 0 1.

    Name   Control   Nom       Meas        Dev                 Name  Nom X  Meas X  Dev X  Nom Y ..
    P1     X         100.000   100.0213    0.021       ->      P1    100.0  100.02  0.021  ..
           Y         200.000   199.9871   -0.013

A point begins at its X; its name may be given on that line only. What is neither X, Y nor Z (a distance, a
diameter) is left.
"""

from __future__ import annotations

from dataclasses import replace

from calib.errors import DataError
from calib.foreign.files.layout import Layout
from calib.foreign.files.number import Notation, is_number, notation_of
from calib.foreign.files.sheet import Row

_OTHERS = {"d", "dist", "distance", "3d", "diameter", "dxyz", "dl", "dn", "t", "abstand"}


def joined(layout: Layout) -> Layout:
    """The layout with one point a line; itself where it has no column of axes. Raises DataError for points with
    gaps."""
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
        Row(
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
    """The layout with one matrix a line, where four lines of four numbers are one each; else None."""
    rows = layout.rows
    if layout.header_line is not None or len(layout.names) != 4 or len(rows) % 4 or not rows:
        return None
    notation = notation_of(layout.cells.values()) or Notation()
    last = [tuple(map(notation.number, row.cells)) for row in rows[3::4]]
    if any(cells != (0.0, 0.0, 0.0, 1.0) for cells in last):
        return None
    joined_rows = tuple(
        Row(rows[i].line, tuple(cell for row in rows[i : i + 4] for cell in row.cells))
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
