"""Draws panels: dots, weighted means with k = 2 bars, and the fitted law."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from service.report.figures import drawing
from service.report.figures.panels import PlotPanel
from service.report.figures.residuals import binned

MOST_DOTS = 500  # a panel: enough to see the cloud, few enough for a file that opens at once
_LEGEND_COLUMN = 1.6  # inches
_SIDE_ROOM = 0.02  # of the width: dots at the edge are seen whole
_UNSEEN_MDEG, _UNSEEN_UM = 500.0, 5000.0  # standard error of one reading
_SIDE_COLOURS = {0.0: drawing.DOT, 1.0: "#2563a8", -1.0: "#8a5a00"}
_SIDE_NAMES = {1.0: "arrived from below", -1.0: "from above"}


def effect_figure(panel: PlotPanel, name: str, width: float = 5.0, height: float = 2.9) -> str:
    """Draw one effect, large, as SVG; width and height are in inches."""
    drawn, (axes,) = drawing.figure(width, height)
    _draw(axes, panel, large=True)
    axes.set_xlabel(panel.x_label)
    axes.set_ylabel(panel.y_label)
    drawing.legend(drawn, axes, int(width / _LEGEND_COLUMN))
    return drawing.as_svg(drawn, name, panel.described)


def joints_figure(panels: Sequence[PlotPanel]) -> str:
    """Draw small panels, one per joint, as SVG."""
    columns = 3
    rows = -(-len(panels) // columns)
    drawn, places = drawing.figure(8.6, 2.1 * rows, rows, columns)
    for axes, panel in zip(places, panels, strict=False):
        _draw(axes, panel, large=False)
        if float(np.median(panel.sd)) > (_UNSEEN_MDEG if panel.y_label.endswith("mdeg") else _UNSEEN_UM):
            axes.text(
                0.5,
                0.84,
                "these readings hardly see this joint",
                transform=axes.transAxes,
                ha="center",
                fontsize=8.0,
            )
        axes.set_title(panel.title, fontsize=8.0, loc="left", color=drawing.INK)
        axes.set_xlabel(panel.x_label)
    for i, (axes, panel) in enumerate(zip(places, panels, strict=False)):
        if i % columns == 0 or panel.y_label != panels[i - 1].y_label:
            axes.set_ylabel(panel.y_label)
    for axes in places[len(panels) :]:
        axes.set_visible(False)
    return drawing.as_svg(
        drawn, "joints", "Residual over joint angle. " + ". ".join(p.described for p in panels)
    )


def _draw(axes: Axes, panel: PlotPanel, *, large: bool) -> None:
    clear = panel.clear
    fast = panel.fast
    sides = (0.0,) if panel.side is None else (1.0, -1.0)
    for s in sides:
        mine = clear if panel.side is None else clear & (panel.side == s)
        colour = _SIDE_COLOURS[s]
        shown = thinned(np.flatnonzero(mine), MOST_DOTS // len(sides))
        for held in (False, True):
            dots = shown[panel.held[shown] == held]
            drawing.dots(
                axes,
                panel.x[dots],
                panel.y[dots],
                size=2.6 if held else 2.0,
                alpha=0.75 if held else 0.38,
                colour=colour,
            )
        if not fast:
            _means(axes, panel, mine, s, large=large)
    for x, y, s in panel.lines:
        axes.plot(
            x,
            y,
            color=drawing.FITTED if s == 0.0 else _SIDE_COLOURS[s],
            linewidth=0.5 if fast else 1.6 if large else 1.2,
            label="fitted law" if s == 0.0 else _SIDE_NAMES[s],
            zorder=1.5 if fast else 4.0,
        )
    if panel.band is not None:
        x, lowest, highest = panel.band
        axes.fill_between(
            x, lowest, highest, color=drawing.FITTED, alpha=0.25, linewidth=0.0, label="k = 2", zorder=3.0
        )
    axes.set_ylim(*_heights(panel))
    low, high = float(np.min(panel.lines[0][0])), float(np.max(panel.lines[0][0]))
    low, high = min(low, float(np.min(panel.x))), max(high, float(np.max(panel.x)))
    if low < high:
        room = _SIDE_ROOM * (high - low)
        axes.set_xlim(low - room, high + room)
    axes.axhline(0.0, color=drawing.QUIET, linewidth=0.7, zorder=1)


def _means(axes: Axes, panel: PlotPanel, mine: np.ndarray, side: float, *, large: bool) -> None:
    count = int(np.clip(mine.sum() / 10, 6, 30 if large else 20))
    if mine.sum() < 12:
        return
    edges = np.linspace(float(panel.x[mine].min()), float(panel.x[mine].max()) + 1e-9, count + 1)
    x, y, spread = binned(panel.x[mine], panel.y[mine], panel.sd[mine], edges)
    colour = drawing.INK if side == 0.0 else _SIDE_COLOURS[side]
    axes.errorbar(
        x,
        y,
        yerr=spread,
        fmt="o",
        markersize=3.4 if large else 2.6,
        color=colour,
        markerfacecolor="white",
        markeredgewidth=1.0,
        elinewidth=1.0,
        zorder=5,
        label="mean of a bin, k = 2" if side >= 0.0 else "_",
    )


def _heights(panel: PlotPanel) -> tuple[float, float]:
    """Return limits that hold zero, the law and all but the wildest dots."""
    law = np.concatenate([y for _, y, _ in panel.lines])
    low, high = np.quantile(panel.y[panel.clear], (0.008, 0.992)) if panel.clear.any() else (0.0, 0.0)
    low, high = min(float(low), float(np.nanmin(law)), 0.0), max(float(high), float(np.nanmax(law)), 0.0)
    room = 0.08 * (high - low) or 1.0
    return low - room, high + room


def thinned(rows: np.ndarray, most: int) -> np.ndarray:
    """Thin rows to at most `most` by a fixed draw."""
    if len(rows) <= most:
        return rows
    return np.sort(np.random.default_rng(0).choice(rows, most, replace=False))
