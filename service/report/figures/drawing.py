"""Style of figures and their inline SVG, which is small and has no clashing ids.

Screen readers can read the description of a figure.
"""

from __future__ import annotations

import html
import io
import re
from collections.abc import Iterator
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.cm import ScalarMappable
from matplotlib.colorbar import Colorbar
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.text import Text
from matplotlib.ticker import FuncFormatter, MaxNLocator

from calib.array import Array

# Colours that stay apart in grey print and for colour-blind eyes.
INK = "#1d2733"
QUIET = "#5b6876"
GRID = "#e3e7eb"
BEFORE = "#b9a06a"
AFTER = "#0f6b75"
FITTED = "#c2410c"
NOMINAL = "#9aa5b1"
DOT = "#7c93a8"

_STYLE: dict[Any, Any] = {
    "svg.fonttype": "none",  # text stays text: small files, selectable, searchable
    "font.family": "sans-serif",
    "font.size": 9.0,
    "axes.edgecolor": QUIET,
    "axes.labelcolor": INK,
    "axes.linewidth": 0.7,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": GRID,
    "grid.linewidth": 0.7,
    "xtick.color": QUIET,
    "ytick.color": QUIET,
    "text.color": INK,
    "text.parse_math": False,  # names may hold a dollar sign
}
_POINTS = 72.0  # an inch
# Inches around the axes of a figure: for numbers of six digits and a label, for half a number, for a title, for numbers
# and a label; between two columns as on the left.
_LEFT, _RIGHT, _ABOVE, _BELOW, _BETWEEN = 0.8, 0.15, 0.28, 0.5, 0.8
_BENEATH_LEGEND = 0.08
_BAR, _BAR_RIGHT = 0.14, 1.05  # width of a colour bar, without and with its numbers
_EDGE = 1e-9  # of the axes: a point upon their edge is seen
_NO_METADATA = {"Date": None, "Creator": None, "Format": None, "Type": None}
_NOISE = re.compile(
    r"<metadata>.*?</metadata>|<defs>\s*<style.*?</style>\s*</defs>"
    r'| id="(?:figure|axes|patch|line2d|text|matplotlib\.axis|xtick|ytick|legend|LineCollection|PathCollection)_\d+"',
    re.DOTALL,
)
_TEXT = re.compile(r"(>[^<>]*\w[^<>]*<)")
_LONG_NUMBER = re.compile(r"(\d+\.\d{2})\d+")
_REFERENCE = re.compile(r'(id="|url\(#|href="#)')
_DOTS = re.compile(r'<g id="dots-(\d+)"\s*/>')


def figure(
    width: float, height: float, rows: int = 1, columns: int = 1, *, bars: bool = False
) -> tuple[Figure, list[Axes]]:
    """Create an empty figure, inches, and its axes row by row.

    It does not use pyplot, so nothing is kept between reports. With `bars`, there is space for a `colour_bar` at
    the end of each row. The margins hold every number and label. A layout that is fitted to the text would take a
    fifth of the time of a report.
    """
    with matplotlib.rc_context(_STYLE):
        drawn = Figure(figsize=(width, height))
        axes = drawn.subplots(rows, columns, squeeze=False)
    right = _BAR_RIGHT if bars else _RIGHT
    wide = (width - _LEFT - right - (columns - 1) * _BETWEEN) / columns
    high = (height - _ABOVE - _BELOW - (rows - 1) * (_ABOVE + _BELOW)) / rows
    drawn.subplots_adjust(
        left=_LEFT / width,
        right=1.0 - right / width,
        bottom=_BELOW / height,
        top=1.0 - _ABOVE / height,
        wspace=_BETWEEN / wide,
        hspace=(_ABOVE + _BELOW) / high,
    )
    return drawn, [place for row in axes for place in row]


def legend(drawn: Figure, axes: Axes, columns: int) -> None:
    """Draw the legend of some axes above them, where it hides nothing."""
    with matplotlib.rc_context(_STYLE):
        made = drawn.legend(
            *axes.get_legend_handles_labels(),
            loc="upper left",
            ncols=columns,
            frameon=False,
            fontsize=8.5,
            handlelength=1.6,
            handletextpad=0.5,
            columnspacing=1.6,
            borderpad=0.2,
            borderaxespad=0.0,
        )
        taken = made.get_window_extent().height / drawn.dpi
    height = drawn.get_size_inches()[1]
    titled = any(each.get_title(loc="left") for each in drawn.axes)
    drawn.subplots_adjust(top=1.0 - (taken + (_ABOVE if titled else _BENEATH_LEGEND)) / height)


def colour_bar(drawn: Figure, of: ScalarMappable, last: Axes, label: str) -> Colorbar:
    """Draw the colour bar of a row of axes, at its end."""
    width = drawn.get_size_inches()[0]
    box = last.get_position()
    place = drawn.add_axes((box.x1 + _BAR / width, box.y0, _BAR / width, box.height))
    bar = drawn.colorbar(of, cax=place)
    bar.set_label(label, fontsize=9.0)
    return bar


class _Dots(Line2D):
    """Dots that `as_svg` draws.

    The figure keeps their place and their legend entry. A report has tens of thousands of dots, and matplotlib
    writes each with a separate style.
    """

    def __init__(self, points: Array, size: float, alpha: float, colour: str, label: str | None) -> None:
        look = {"linestyle": "none", "marker": "o", "markersize": size, "markeredgewidth": 0.0}
        super().__init__([], [], color=colour, alpha=alpha, label=label, **look)
        self.points = points
        stroke = f"stroke: {colour}; stroke-opacity: {alpha:g}; stroke-width: {size:g}; stroke-linecap: round"
        self._look = f"fill: none; {stroke}"

    def svg(self) -> str:
        """Return the points within the axes, once the figure has been laid out."""
        axes, drawn = self.axes, self.get_figure(root=True)
        assert isinstance(axes, Axes)
        assert drawn is not None
        seen = axes.transAxes.inverted().transform(axes.transData.transform(self.points))
        points = self.points[np.all((seen >= -_EDGE) & (seen <= 1.0 + _EDGE), axis=1)]
        share = drawn.transFigure.inverted().transform(axes.transData.transform(points))
        width, height = (_POINTS * length for length in drawn.get_size_inches())
        places = share * [width, -height] + [0.0, height]
        # a line as long as nothing has round ends in most viewers, not in all
        every = "".join(f'<path d="M{x:.1f} {y:.1f}h.01"/>' for x, y in places.tolist())
        return f'<g class="dots" style="{self._look}">{every}</g>'


def dots(
    axes: Axes, x: Array, y: Array, *, size: float, alpha: float, colour: str = DOT, label: str | None = None
) -> None:
    """Draw a small dot without an edge at each of x, y (n,)."""
    points = np.column_stack([x, y]).astype(float)
    axes.add_line(_Dots(points, size, alpha, colour, label))
    axes.update_datalim(points)
    axes.autoscale_view()


def whole_numbers() -> MaxNLocator:
    """Return a locator of whole numbers for an axis that counts."""
    return MaxNLocator("auto", integer=True, steps=[1, 2, 5, 10])


def plain_ratio_axis(axes: Axes) -> None:
    """Make the abscissa logarithmic, with plain numbers."""
    axes.set_xscale("log")
    plain(axes.xaxis)


def plain(axis: Axis) -> None:
    """Write plain numbers on a logarithmic axis, without powers of ten.

    Between decades, 2 and 5 are labelled on an axis of few decades, and every digit on an axis within a factor of
    four.
    """

    def between(value: float, _: object) -> str:
        low, high = axis.get_view_interval()
        shown = f"{value:g}"
        seen = high < 4.0 * low or (high < 100.0 * low and shown.strip("0.")[:1] in ("2", "5"))
        return shown if seen else ""

    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(FuncFormatter(between))


def as_svg(drawn: Figure, name: str, description: str) -> str:
    """Return the figure as an `<svg>` element.

    `name` keeps its ids apart. `description` is for screen readers.
    """
    for made_before in _texts(drawn):
        made_before.set_parse_math(False)
    clouds = [line for axes in drawn.axes for line in axes.lines if isinstance(line, _Dots)]
    for number, cloud in enumerate(clouds):
        cloud.set_gid(f"dots-{number}")
    text = io.StringIO()
    with matplotlib.rc_context({**_STYLE, "svg.hashsalt": name}):
        FigureCanvasSVG(drawn).print_svg(text, metadata=_NO_METADATA)
    svg = text.getvalue()
    svg = _NOISE.sub("", svg[svg.index("<svg") :])
    parts = _TEXT.split(svg)  # every other part is a text
    # numbers of places only: those in texts are results
    parts[::2] = [_LONG_NUMBER.sub(r"\1", part) for part in parts[::2]]
    svg = "".join(parts)
    svg = _DOTS.sub(lambda found: clouds[int(found[1])].svg(), svg)
    svg = _REFERENCE.sub(rf"\g<1>{name}-", svg)
    opening, rest = svg.split(">", 1)
    # the size comes from the page; the view box keeps the shape
    opening = re.sub(r' (?:width|height)="[^"]*"', "", opening)
    return f'{opening} role="img" aria-label="{html.escape(description, quote=True)}">{rest}'


def _texts(drawn: Figure) -> Iterator[Text]:
    """Return the texts that exist before the figure is drawn.

    Asking matplotlib for all texts would create every tick, many in vain.
    """
    for axes in drawn.axes:
        yield from (child for child in axes.get_children() if isinstance(child, Text))
        for axis in (axes.xaxis, axes.yaxis):
            yield axis.label
            yield from (tick.label1 for tick in axis.majorTicks)
    for each in drawn.legends:
        yield from each.get_texts()
