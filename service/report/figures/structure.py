"""Pictures of structure that no effect explains.

Structure is drawn where it lives: over an angle, two or three of them, a load, a direction or time. Other pictures
are by the side of the tool that is down or seen, in the workspace, by target or by pose.

The residual of every reading is a vector. Its three components in the world are drawn over their driver, with
the weighted means of bins, or as arrows at their place, means of the readings near it. Pure noise scatters
evenly about zero, and its arrows point in random directions. If the readings that the fit left out lie
together, they are drawn among the others.

Maps of the residuals show means in squares of two quantities, with one map for every third of a third quantity.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from calib.array import Array
from calib.data import Dataset
from calib.diagnose import ACTS_ON, EACH_POSE, SEEN, TOGETHER, ResidualStructure, sight_at_tool
from calib.fit import all_readings
from calib.model import BoundModel
from service.report.figures import drawing
from service.report.figures import residual_pictures as pictures
from service.report.figures.quantities import Quantity, quantity_of
from service.report.figures.residuals import MDEG, PlotSample

_MOST_POSES = 40
_IN_CELL, _MOST_CELLS = 5, 4  # readings in a cell of three angles; cells along each
_AXES = "xyz"
_SQUARES = 12  # of either of two quantities
_IN_SQUARE = 4  # readings, if there are few
_THIRDS = "lowest", "middle", "highest"


def picture_of(left: ResidualStructure, number: int, dataset: Dataset, sample: PlotSample) -> str | None:
    """Draw the picture of one place as SVG.

    It is None if no points were measured, or if the name of the place is unknown.
    """
    name = f"left{number}"
    if left.acts_on == ACTS_ON:
        return _of_left_out(left.where, name, dataset, sample)
    rest = sample.left(dataset)
    pointed = np.isfinite(rest[:, 0])
    if not pointed.any():
        return None
    if left.where == "tool target":
        targets = sample.column("target").astype(np.int64)
        names = sample.parts[0].conditions.target_names
        return pictures.by_group(targets[pointed], names, rest[pointed], name, "every tool target")
    if left.where == EACH_POSE:
        return _by_pose(sample, rest, pointed, name)
    if left.where == "region of the workspace":
        points = dataset.points[np.concatenate([part.rows for part in sample.parts])]
        return pictures.in_space(points[pointed], rest[pointed], name)
    parts = [_quantity(left.where, design, dataset, sample) for design in sample.designs]
    known = [part for part in parts if part is not None]
    if len(known) < len(parts):
        return None
    quantity = _joined(known)
    if "side of the tool" in left.where:
        rest = _in_tool(sample, rest)
    quantity = _taken(quantity, pointed)
    if left.where == TOGETHER:
        return _over_three(left, quantity, rest, pointed, sample, name)
    if quantity.values.shape[1] == 2:
        return over_two(quantity, rest[pointed], name, left.where)
    return pictures.over(quantity, rest[pointed], sample.held[pointed], name, left.where)


def _over_three(
    left: ResidualStructure,
    angles: Quantity,
    rest: Array,
    pointed: NDArray[np.bool_],
    sample: PlotSample,
    name: str,
) -> str | None:
    """Draw maps over the three angles that explain most of the residuals.

    The maps show the components of the residuals, or the error of the joint on which the structure acts.
    """
    values, weight, labels = rest[pointed], np.ones(int(pointed.sum())), tuple(f"{k}, mm" for k in "xyz")
    conditions = sample.parts[0].conditions
    axes = [axis.removeprefix("j") for axis in conditions.axis_names]
    which = left.acts_on.removeprefix("joint ")
    if which in axes and conditions.unit_names[axes.index(which)] == "deg":
        seen = sample.of_joint(axes.index(which) + 1, ())
        values, weight = seen.y[pointed, None] / MDEG, 1.0 / seen.sd[pointed] ** 2
        labels = (f"joint {which}, mdeg",)
    three = most_telling(angles.values, values, weight)
    if three is None:
        return None
    return over_three(_columns(angles, three), values, weight, labels, name, left.where)


def _columns(quantity: Quantity, which: list[int]) -> Quantity:
    return Quantity(quantity.values[:, which], tuple(quantity.labels[k] for k in which))


def most_telling(angles: Array, values: Array, weight: Array) -> list[int] | None:
    """Find the three angles whose cells explain most.

    Of angles (n, q), it takes the three over whose cells the means of values (n, p) explain most, corrected for
    their number. The angle that explains least by itself is last. The result is None if fewer than three vary.
    """
    n, q = angles.shape
    cells = int(np.clip((n / _IN_CELL) ** (1.0 / 3.0), 2, _MOST_CELLS))
    place = np.stack([_ranked(angle, cells) for angle in angles.T], axis=1)

    def told(of: tuple[int, ...]) -> float:
        _, cell = np.unique(place[:, of], axis=0, return_inverse=True)
        cell = cell.reshape(-1)
        total = np.bincount(cell, weight)
        sums = np.array([np.bincount(cell, weight * column) for column in values.T])
        gain = float(np.sum(sums**2 / total))
        most = float(np.sum(weight[:, None] * values**2))
        return 1.0 - (1.0 - gain / most) * n / max(n - len(total), 1)

    if q < 3:
        return None
    best = max(combinations(range(q), 3), key=told)
    return sorted(best, key=lambda k: -told((k,)))


def _ranked(angle: Array, cells: int) -> NDArray[np.int64]:
    """Return the cell (n,) of each angle, for `cells` cells with equally many readings."""
    return np.argsort(np.argsort(angle, kind="stable"), kind="stable") * cells // len(angle)


def _joined(parts: list[Quantity]) -> Quantity:
    group = None
    if parts[0].group is not None:
        group = np.concatenate([part.group for part in parts if part.group is not None])
    return Quantity(np.concatenate([p.values for p in parts]), parts[0].labels, group, parts[0].group_names)


def _taken(quantity: Quantity, rows: NDArray[np.bool_]) -> Quantity:
    group = None if quantity.group is None else quantity.group[rows]
    return Quantity(quantity.values[rows], quantity.labels, group, quantity.group_names)


def _quantity(where: str, design: BoundModel, dataset: Dataset, sample: PlotSample) -> Quantity | None:
    """Return the quantity over which structure is drawn.

    The side from which the tool is seen depends on the fitted base.
    """
    conditions = design.conditions
    if SEEN not in where:
        return quantity_of(where, conditions, dataset.header)
    seen = sight_at_tool(design.frames(sample.fitted.estimate, ()), sample.fitted.model.station)
    labels = tuple(f"line of sight along the tool's {axis}" for axis in "xyz")
    if not where.startswith("tool target"):
        return Quantity(seen, labels)
    return Quantity(seen, labels, conditions.target, conditions.target_names)


def _in_tool(sample: PlotSample, rest: Array) -> Array:
    """Return the residuals (n, 3) along the axes of the tool."""
    turns = [design.frames(sample.fitted.estimate, ()).rotation for design in sample.designs]
    return np.einsum("nji,nj->ni", np.concatenate(turns), rest)


def _by_pose(sample: PlotSample, rest: Array, pointed: NDArray[np.bool_], name: str) -> str | None:
    """Draw the poses with the largest own errors, of those revisited in the calibration."""
    pose = sample.parts[0].conditions.pose
    count = len(pose)
    rest, pose = rest[:count][pointed[:count]], pose[pointed[:count]]
    if not len(pose):
        return None
    visits = np.bincount(pose)
    means = np.array([np.bincount(pose, column) for column in rest.T]) / np.maximum(visits, 1)
    size = np.where(visits > 1, np.linalg.norm(means, axis=0), -1.0)
    largest = np.argsort(-size)[: min(_MOST_POSES, int(np.sum(visits > 1)))]
    if not len(largest):
        return None
    rank = np.full(len(visits), -1)
    rank[largest] = np.arange(len(largest))
    shown = rank[pose] >= 0
    labels = [str(k + 1) if (k + 1) % 5 == 0 or k == 0 else "" for k in range(len(largest))]
    return pictures.by_group(
        rank[pose][shown], labels, rest[shown], name, "every pose that was visited again, the largest first"
    )


def _of_left_out(where: str, name: str, dataset: Dataset, sample: PlotSample) -> str | None:
    """Draw the distance of every calibration reading from the model.

    The readings that were left out are among the others.
    """
    readings, out = all_readings(dataset, sample.fitted)
    design = BoundModel(sample.fitted.model, readings.conditions)
    predicted = design.predict(sample.fitted.estimate)
    error = np.linalg.norm(dataset.points[readings.rows] - predicted, axis=1)
    seen = np.isfinite(error)
    quantity = _quantity(where, design, dataset, sample)
    if quantity is None or not out[seen].any():
        return None
    quantity = _taken(quantity, seen)
    if where == TOGETHER:
        lies: Array = out[seen, None].astype(np.float64) - float(np.mean(out[seen]))
        three = most_telling(quantity.values, lies, np.ones(len(lies)))
        if three is None:
            return None
        quantity = _columns(quantity, three[:2])
    return pictures.left_out(quantity, error[seen], out[seen], name, where)


def over_two(quantity: Quantity, left: Array, name: str, where: str) -> str:
    """Draw means of the residual components (n, 3), mm, in squares of two quantities."""
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
    """Draw weighted means of values (n, p) in squares of the first two of three quantities.

    There is a row of maps for each of the p values, with their names in `labels`. There is a column for each third
    of the readings by the last quantity.
    """
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
    """Return weighted means (squares, squares) of the values; NaN in squares without readings."""
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
