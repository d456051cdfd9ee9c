"""Structure that no effect explains, drawn where it lives: over a joint's angle or time, in the workspace, by target.

What is left of every reading is a vector; its three parts in the world are drawn over the angle or the time, with the
weighted means of bins, or as arrows at their place, means of the readings near it. Pure noise scatters evenly about
zero and its arrows point anywhere.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from calib.dataset import Dataset
from calib.kinematics import Array
from calib.units import DEG
from service.report import drawing
from service.report.residuals import Sample, binned
from service.report.scatter import MOST_DOTS, thinned

_AXES = "xyz"
_BINS = 24
_CELLS = 9  # of the longer side of the workspace
_FEWEST = 3  # readings a cell


def picture_of(where: str, number: int, dataset: Dataset, sample: Sample) -> str | None:
    """The picture of one place as SVG; None where no points were measured, or the place is not one we can draw."""
    left = sample.left(dataset)
    pointed = np.isfinite(left[:, 0])
    if not pointed.any():
        return None
    name, left, held = f"left{number}", left[pointed], sample.held[pointed]
    if where.endswith(" angle"):
        joint = int(where.split()[1])
        angle = sample.angle(joint)[pointed] / DEG
        return _over(angle, f"θ{joint}, deg", left, held, name, where)
    if where.startswith(("torque about joint ", "last move of joint ")):
        joint = int(where.split()[-1]) - 1
        if where.startswith("torque"):
            return _over(
                sample.column("torque")[pointed, joint] / 1000.0, "torque, N.m", left, held, name, where
            )
        moved = (sample.column("joints") - sample.column("previous"))[pointed, joint] / DEG
        return _over(moved, "last move, deg", left, held, name, where)
    if where == "time":
        time = sample.column("time")[pointed] / 3600.0
        return _over(time, "time, h", left, held, name, where)
    if where == "tool target":
        targets = sample.column("target")[pointed].astype(int)
        return _by_target(targets, sample.parts[0].conditions.target_names, left, name)
    if where == "region of the workspace":
        points = dataset.points[np.concatenate([part.rows for part in sample.parts])][pointed]
        return _in_space(points, left, name)
    return None


def _over(x: Array, label: str, left: Array, held: NDArray[np.bool_], name: str, where: str) -> str:
    drawn, places = drawing.figure(10.2, 2.5, 1, 3)
    limits = _limits(left)
    for k, axes in enumerate(places):
        shown = thinned(np.arange(len(x)), MOST_DOTS)
        for validation in (False, True):
            dots = shown[held[shown] == validation]
            axes.plot(
                x[dots],
                left[dots, k],
                linestyle="none",
                marker="o",
                markersize=2.6 if validation else 2.0,
                markeredgewidth=0.0,
                color=drawing.DOT,
                alpha=0.75 if validation else 0.38,
            )
        edges = np.linspace(x.min(), x.max() + 1e-9, int(np.clip(len(x) / 12, 4, _BINS)) + 1)
        spread = np.full(len(x), float(np.std(left[:, k])))
        centre, mean, u = binned(x, left[:, k], spread, edges)
        _means(axes, centre, mean, u)
        axes.set_ylim(*limits)
        axes.set_xlabel(label)
        axes.set_ylabel(f"left in {_AXES[k]}, mm")
    return drawing.as_svg(
        drawn, name, f"What is left over {where}, its three parts in the world, one dot a reading"
    )


def _means(axes: Axes, x: Array, mean: Array, u: Array) -> None:
    axes.axhline(0.0, color=drawing.QUIET, linewidth=0.7, zorder=1)
    axes.errorbar(
        x,
        mean,
        yerr=u,
        fmt="o-",
        markersize=3.0,
        linewidth=1.0,
        color=drawing.FITTED,
        markerfacecolor="white",
        markeredgewidth=1.0,
        elinewidth=1.0,
        zorder=5,
    )


def _limits(left: Array) -> tuple[float, float]:
    low, high = np.quantile(left, (0.004, 0.996))
    room = 0.08 * float(high - low) or 1.0
    return float(low) - room, float(high) + room


def _by_target(targets: NDArray[np.int64], names: Sequence[str], left: Array, name: str) -> str:
    drawn, places = drawing.figure(10.2, 2.5, 1, 3)
    used = np.unique(targets)
    count = np.array([np.sum(targets == t) for t in used])
    for k, axes in enumerate(places):
        mean = np.array([left[targets == t, k].mean() for t in used])
        spread = np.array([left[targets == t, k].std() for t in used])
        _means(axes, np.arange(len(used), dtype=float), mean, 2.0 * spread / np.sqrt(count))
        axes.set_xticks(range(len(used)), [str(names[t]) for t in used])
        axes.margins(x=0.2)
        axes.set_ylabel(f"mean left in {_AXES[k]}, mm")
    return drawing.as_svg(
        drawn, name, "Mean of what is left for every tool target, with expanded uncertainty"
    )


def _in_space(points: Array, left: Array, name: str) -> str:
    """Means of the residual vectors near a place, from above and from the side."""
    drawn, places = drawing.figure(10.2, 4.0, 1, 2)
    side = float(np.max(np.ptp(points, axis=0))) / _CELLS or 1.0
    views = [(places[0], 0, 1, "from above"), (places[1], 0, 2, "from the side")]
    arrows = [_cells(points[:, [a, b]], left[:, [a, b]], side) for _, a, b, _ in views]
    longest = max((float(np.max(np.linalg.norm(v, axis=1), initial=0.0)) for _, v in arrows), default=0.0)
    scale = 0.9 * side / longest if longest > 0.0 else 1.0
    for (axes, a, b, title), (at, vectors) in zip(views, arrows, strict=True):
        shown = thinned(np.arange(len(points)), MOST_DOTS)
        axes.plot(
            points[shown, a],
            points[shown, b],
            linestyle="none",
            marker="o",
            markersize=1.6,
            markeredgewidth=0.0,
            color=drawing.DOT,
            alpha=0.3,
        )
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
    """Centres (c, 2) and mean vectors (c, 2) of the square cells that hold enough readings."""
    place = np.floor((points - points.min(axis=0)) / side).astype(int)
    _, cell = np.unique(place, axis=0, return_inverse=True)
    count = np.bincount(cell)
    enough = count >= _FEWEST
    at, vector = (
        np.column_stack([np.bincount(cell, column)[enough] / count[enough] for column in values.T])
        for values in (points, left)
    )
    return at, vector
