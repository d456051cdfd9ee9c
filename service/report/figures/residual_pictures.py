"""Pictures of residuals over a quantity, by group or as arrows, and of left-out readings."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from calib.array import Array
from service.report.figures import drawing
from service.report.figures.quantities import Quantity
from service.report.figures.residuals import binned
from service.report.figures.scatter import MOST_DOTS, thinned

_AXES = "xyz"
_BINS = 24
_CELLS = 9  # of the longer side of the workspace
_FEWEST = 3  # readings per cell
_GROUPS = (drawing.FITTED, drawing.AFTER, drawing.BEFORE, drawing.NOMINAL)


def over(quantity: Quantity, left: Array, held: NDArray[np.bool_], name: str, where: str) -> str:
    """Draw the three components of the residuals (n, 3), mm, over a quantity.

    If the quantity has three components, each residual component is drawn over its own one.
    """
    drawn, places = drawing.figure(10.2, 2.5, 1, 3)
    limits = _limits(left)
    own = quantity.values.shape[1] == 3
    groups = [np.ones(len(left), dtype=bool)]
    if quantity.group is not None:
        groups = [quantity.group == g for g in range(len(quantity.group_names))]
    for k, axes in enumerate(places):
        x = quantity.values[:, k if own else 0]
        _dots(axes, x, left[:, k], held)
        edges = np.linspace(x.min(), x.max() + 1e-9, int(np.clip(len(x) / 12, 4, _BINS)) + 1)
        for g, mine in enumerate(groups):
            spread = (
                np.full(int(mine.sum()), max(float(np.std(left[mine, k])), 1e-9))
                if mine.any()
                else np.ones(0)
            )
            centre, mean, u = binned(x[mine], left[mine, k], spread, edges)
            named = quantity.group_names[g] if quantity.group_names else None
            _means(axes, centre, mean, u, _GROUPS[g % len(_GROUPS)], named)
        axes.set_ylim(*limits)
        axes.set_xlabel(quantity.labels[k if own else 0])
        axes.set_ylabel(f"left along the tool's {_AXES[k]}, mm" if own else f"left in {_AXES[k]}, mm")
    if quantity.group_names:
        drawing.legend(drawn, places[0], len(quantity.group_names))
    axes_of = "along the axes of the tool" if own else "in the world"
    return drawing.as_svg(
        drawn, name, f"What is left over {where}, its three parts {axes_of}, one dot a reading"
    )


def by_group(group: NDArray[np.int64], names: Sequence[str], left: Array, name: str, of_what: str) -> str:
    """Mean residual (n, 3), mm, of every group, with its expanded uncertainty."""
    drawn, places = drawing.figure(10.2, 2.5, 1, 3)
    used, count = np.unique(group, return_counts=True)
    for k, axes in enumerate(places):
        mean = np.array([left[group == g, k].mean() for g in used])
        spread = np.array([left[group == g, k].std() for g in used])
        line = "none" if len(used) > len(_GROUPS) else "-"
        _means(axes, np.arange(len(used), dtype=float), mean, 2.0 * spread / np.sqrt(count), line=line)
        axes.set_xticks(range(len(used)), [str(names[g]) for g in used])
        axes.margins(x=0.2 if len(used) < 8 else 0.02)
        axes.set_ylabel(f"mean left in {_AXES[k]}, mm")
    return drawing.as_svg(drawn, name, f"Mean of what is left for {of_what}, with expanded uncertainty")


def left_out(quantity: Quantity, error: Array, out: NDArray[np.bool_], name: str, where: str) -> str:
    """Draw the readings that were left out among the others.

    `out` (n,) marks them. They are drawn by their error (n,), mm, over one quantity, or in the plane of two.
    """
    drawn, (axes,) = drawing.figure(5.0, 2.9)
    x = quantity.values[:, 0]
    y = error if quantity.values.shape[1] == 1 else quantity.values[:, 1]
    rest = thinned(np.flatnonzero(~out), MOST_DOTS)
    drawing.dots(axes, x[rest], y[rest], size=2.2, alpha=0.5, label="in the fit")
    axes.plot(
        x[out], y[out], linestyle="none", marker="x", markersize=5.0, color=drawing.FITTED, label="left out"
    )
    axes.set_xlabel(quantity.labels[0])
    axes.set_ylabel("error, mm" if quantity.values.shape[1] == 1 else quantity.labels[1])
    drawing.legend(drawn, axes, 2)
    return drawing.as_svg(drawn, name, f"The readings that were left out among the others, over {where}")


def _dots(axes: Axes, x: Array, y: Array, held: NDArray[np.bool_]) -> None:
    """Draw one dot per reading; darker ones took no part in the fit."""
    shown = thinned(np.arange(len(x)), MOST_DOTS)
    for validation in (False, True):
        dots = shown[held[shown] == validation]
        drawing.dots(
            axes, x[dots], y[dots], size=2.6 if validation else 2.0, alpha=0.75 if validation else 0.38
        )


def _means(
    axes: Axes,
    x: Array,
    mean: Array,
    u: Array,
    colour: str = drawing.FITTED,
    label: str | None = None,
    line: str = "-",
) -> None:
    axes.axhline(0.0, color=drawing.QUIET, linewidth=0.7, zorder=1)
    axes.errorbar(
        x,
        mean,
        yerr=u,
        fmt="o",
        linestyle=line,
        markersize=3.0,
        linewidth=1.0,
        color=colour,
        label=label,
        markerfacecolor="white",
        markeredgewidth=1.0,
        elinewidth=1.0,
        zorder=5,
    )


def _limits(left: Array) -> tuple[float, float]:
    low, high = np.quantile(left, (0.004, 0.996))
    room = 0.08 * float(high - low) or 1.0
    return float(low) - room, float(high) + room


def in_space(points: Array, left: Array, name: str) -> str:
    """Draw means of the residual vectors near a place, from above and from the side."""
    drawn, places = drawing.figure(10.2, 4.0, 1, 2)
    side = float(np.max(np.ptp(points, axis=0))) / _CELLS or 1.0
    views = [(places[0], 0, 1, "from above"), (places[1], 0, 2, "from the side")]
    arrows = [_cells(points[:, [a, b]], left[:, [a, b]], side) for _, a, b, _ in views]
    longest = max((float(np.max(np.linalg.norm(v, axis=1), initial=0.0)) for _, v in arrows), default=0.0)
    scale = 0.9 * side / longest if longest > 0.0 else 1.0
    for (axes, a, b, title), (at, vectors) in zip(views, arrows, strict=True):
        shown = thinned(np.arange(len(points)), MOST_DOTS)
        drawing.dots(axes, points[shown, a], points[shown, b], size=1.6, alpha=0.3)
        axes.quiver(
            *at.T,
            *(scale * vectors).T,
            angles="xy",
            scale_units="xy",
            scale=1.0,
            color=drawing.FITTED,
            width=0.004,
            zorder=4,
        )
        axes.set_aspect("equal", adjustable="datalim")
        axes.set_title(f"{title}; longest arrow {longest:.3f} mm", fontsize=9.0, loc="left")
        axes.set_xlabel(f"{_AXES[a]}, mm")
        axes.set_ylabel(f"{_AXES[b]}, mm")
    return drawing.as_svg(
        drawn, name, "What is left as arrows in the workspace, from above and from the side"
    )


def _cells(points: Array, left: Array, side: float) -> tuple[Array, Array]:
    """Return centres and mean vectors, (c, 2) each, of square cells with enough readings."""
    place = np.floor((points - points.min(axis=0)) / side).astype(int)
    _, cell = np.unique(place, axis=0, return_inverse=True)
    count = np.bincount(cell)
    enough = count >= _FEWEST
    at, vector = (
        np.column_stack([np.bincount(cell, column)[enough] / count[enough] for column in values.T])
        for values in (points, left)
    )
    return at, vector
