"""Maps of the residuals: means in squares of two quantities, one map for every third of a third quantity."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from calib.array import Array
from service.report.figures import drawing
from service.report.figures.quantities import Quantity

_AXES = "xyz"
_SQUARES = 12  # of either of two quantities
_IN_SQUARE = 4  # readings, where there are few
_THIRDS = "lowest", "middle", "highest"


def over_two(quantity: Quantity, left: Array, name: str, where: str) -> str:
    """Means of the three components of the residuals (n, 3), mm, in squares of two quantities."""
    drawn, places = drawing.figure(10.2, 2.9, 1, 3, bars=True)
    x, y = quantity.values.T
    edges = _edges(x, _SQUARES), _edges(y, _SQUARES)
    means = [_means(x, y, part, np.ones(len(part)), edges) for part in left.T]
    largest = _largest(means)
    for k, axes in enumerate(places):
        _draw(axes, edges, means[k], largest, quantity.labels)
        axes.set_title(f"left in {_AXES[k]}, mm", fontsize=9.0, loc="left")
    drawing.colour_bar(drawn, places[0].collections[0], places[-1], "mean, mm")
    return drawing.as_svg(
        drawn, name, f"Means of what is left over {where}, its three parts in the world, in squares of both"
    )


def over_three(
    quantity: Quantity, values: Array, weight: Array, labels: Sequence[str], name: str, where: str
) -> str:
    """Weighted means of values (n, p), `labels` their names, in squares of the first two of three quantities: a row of
    maps for each of the p, a column for each third of the readings by the last quantity."""
    x, y, z = quantity.values.T
    count = int(np.clip(np.sqrt(len(z) / 3.0 / _IN_SQUARE), 4, _SQUARES))
    edges, thirds = (_edges(x, count), _edges(y, count)), np.quantile(z, (0.0, 1.0 / 3.0, 2.0 / 3.0, 1.0))
    third = np.clip(np.searchsorted(thirds, z, side="right") - 1, 0, 2)
    drawn, places = drawing.figure(10.2, 0.5 + 2.5 * len(labels), len(labels), 3, bars=True)
    for row, (label, value) in enumerate(zip(labels, values.T, strict=True)):
        mine = [third == k for k in range(3)]
        means = [_means(x[of], y[of], value[of], weight[of], edges) for of in mine]
        largest, along = _largest(means), places[3 * row : 3 * row + 3]
        for k, axes in enumerate(along):
            _draw(axes, edges, means[k], largest, quantity.labels)
            what = quantity.labels[2].partition(",")[0]
            title = f"{_THIRDS[k]} third of {what}: {thirds[k]:.0f} to {thirds[k + 1]:.0f}"
            axes.set_title(title, fontsize=9.0, loc="left")
        drawing.colour_bar(drawn, along[0].collections[0], along[-1], f"mean left in {label}")
    return drawing.as_svg(
        drawn, name, f"Means of what is left over {where}: maps of two angles, by thirds of a third angle"
    )


def _edges(values: Array, count: int) -> Array:
    return np.linspace(values.min(), values.max() + 1e-9, count + 1)


def _means(x: Array, y: Array, value: Array, weight: Array, edges: tuple[Array, Array]) -> Array:
    """(squares, squares) weighted means of the values in every square; NaN where it has no reading."""
    worth, total = (np.histogram2d(x, y, edges, weights=of)[0] for of in (weight, weight * value))
    return np.where(worth > 0.0, total / np.where(worth > 0.0, worth, 1.0), np.nan)


def _largest(means: Sequence[Array]) -> float:
    return float(np.nanmax(np.abs(means))) or 1.0


def _draw(
    axes: Axes, edges: tuple[Array, Array], means: Array, largest: float, labels: Sequence[str]
) -> None:
    axes.pcolormesh(*edges, means.T, cmap="PuOr", vmin=-largest, vmax=largest, rasterized=True)
    axes.set_xlabel(labels[0])
    axes.set_ylabel(labels[1])
    axes.grid(visible=False)
