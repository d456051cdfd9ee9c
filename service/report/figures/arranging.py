"""Where the axes of a figure stand: reckoned once from the words beside them.

matplotlib's constrained layout makes and measures every tick twice over, a quarter of the time that a report takes, and
measures them in a font that the page does not use. Here lines are counted, and letters of the widest numbers.
"""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure

from calib.array import Array

_POINTS = 72.0  # an inch
_EM = 9.0 / _POINTS  # inches; of every text but small titles
_DIGIT = 0.63 * _EM  # the width of one
_WIDTHS = {".": 0.5, ",": 0.5, " ": 0.5, "−": 1.35}  # of a digit
_LINE = 1.25 * _EM
_TICK = 7.5 / _POINTS  # a tick and what keeps its number off
_PAD = 4.5 / _POINTS  # between a label and the numbers, and at the edge
_OVERHANG = 0.12  # inches; half of a number at the end of an abscissa

_Sides = tuple[float, float, float, float]  # inches to the left, right, top and bottom of an axes


def arrange(drawn: Figure) -> None:
    """Place the axes of a figure that were made as one grid, and leave room for the legend above them."""
    placed = [(axes, spec) for axes in drawn.axes if (spec := axes.get_subplotspec()) is not None]
    grid = placed[0][1].get_gridspec()
    room = np.zeros((grid.nrows, grid.ncols, 4))
    for axes, spec in placed:
        room[spec.rowspan.start, spec.colspan.start] = _around(axes)
    left, right, above, below = (room[:, :, side] for side in range(4))
    above[0] += _legend_height(drawn)
    width, height = drawn.get_size_inches()
    x, wide = _along(left.max(axis=0), right.max(axis=0), np.asarray(grid.get_width_ratios(), float), width)
    y, high = _along(above.max(axis=1), below.max(axis=1), np.ones(grid.nrows), height)
    for axes, spec in placed:
        i, j = spec.rowspan.start, spec.colspan.start
        share = wide[j] / width, high[i] / height
        axes.set_position((x[j] / width, 1.0 - y[i] / height - share[1], *share))


def _along(before: Array, behind: Array, shares: Array, whole: float) -> tuple[Array, Array]:
    """Begin and length (n,) of axes in a row with room before and behind each; shares below 1 are inches, of bars."""
    bars = np.where(shares < 1.0, shares, 0.0)
    free = whole - before.sum() - behind.sum() - bars.sum()
    length = np.where(shares < 1.0, shares, free / np.sum(shares >= 1.0))
    return np.cumsum(before + behind + length) - behind - length, length


def _around(axes: Axes) -> _Sides:
    if not axes.get_visible() or not axes.axison:
        return 0.0, 0.0, 0.0, 0.0
    beside = _TICK + _widest(axes.yaxis) + _PAD + (_LINE if axes.get_ylabel() else 0.0)
    bars = axes.yaxis.get_ticks_position() == "right"
    titles = max(_lines(axes.get_title(loc=side)) for side in ("left", "center", "right"))
    above = _PAD + (titles * _LINE + _PAD if titles else 0.0)
    below = 0.0 if bars else _TICK + _LINE + _PAD + _LINE * _lines(axes.get_xlabel())
    return (_PAD, beside, above, below) if bars else (beside, _OVERHANG, above, below)


def _lines(text: str) -> int:
    return text.count("\n") + 1 if text else 0


def _widest(axis: Axis) -> float:
    """Inches that the widest of the numbers in view takes."""
    low, high = sorted(axis.get_view_interval())
    words: list[str] = []
    for ticks, formatter in (
        (axis.get_majorticklocs(), axis.get_major_formatter()),
        (axis.get_minorticklocs(), axis.get_minor_formatter()),
    ):
        seen = [tick for tick in ticks if low <= tick <= high]
        words += formatter.format_ticks(seen)
    return max((sum(_DIGIT * _WIDTHS.get(letter, 1.0) for letter in word) for word in words), default=0.0)


def _legend_height(drawn: Figure) -> float:
    """Inches of the legend of a figure: the columns hold its texts in order, the first ones the more."""
    if not drawn.legends:
        return 0.0
    (legend,) = drawn.legends
    lines = [_lines(text.get_text()) for text in legend.get_texts()]
    columns = np.array_split(lines, legend._ncols)  # pyright: ignore[reportAttributeAccessIssue]
    return float(max(column.sum() for column in columns)) * _LINE + _PAD
