"""Pictures of the judged errors: arrows in the workspace, over time, and by target.

Arrows are measured less predicted points in the world, many times their size. Each model has its own
enlargement. Otherwise the residuals after a calibration would be dots compared with those before it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from calib.array import Array
from calib.data import Dataset
from calib.fit import statistics_of
from calib.model import BoundModel, ModelStructure
from calib.validation import targets_in_base
from service.report.figures import drawing
from service.report.figures.errors import ErrorSample
from service.report.figures.scatter import thinned
from service.report.figures.space_picture import ErrorsInSpace
from service.wording import millimetres

Models = Mapping[str, tuple[ModelStructure, Array, str]]
_ARROWS = 150
_DOTS = 800
_STRETCHES = 40  # of the readings in order of time, for the line
_PAUSE = 0.2  # of the whole time: two evenings in one data set
_LONGEST = 0.16  # of the workspace, which the longest arrow but the wildest takes
_TARGETS = 24  # rows of the table
_FLAT_MM, _SPANNED = 1.0, 2  # points on a line do not show how the base stands


@dataclass(frozen=True)
class Vectors:
    """Errors (n, 3), mm, world frame, of one model."""

    name: str
    errors: Array
    colour: str


def section_of(dataset: Dataset, models: Models, measured: Sequence[ErrorSample]) -> dict[str, Any]:
    """Build pictures and table for models with colours and errors on the validation readings.

    It is empty without validation readings.
    """
    if not measured:
        return {}
    rows, found = np.flatnonzero(dataset.validation_rows), errors_in(dataset, models)
    return {
        "arrows": None if found is None else Markup(arrows(dataset.points[found[0]], found[1])),
        "over_time": Markup(over_time(dataset, rows, measured)),
        "by_clock": _known_time(dataset, rows),
        "models": [each.name for each in measured],
        "targets": _by_target(dataset, rows, measured),
    }


def _known_time(dataset: Dataset, rows: NDArray[np.int64]) -> bool:
    return bool(
        np.isfinite(dataset.conditions.time[rows]).all() and np.ptp(dataset.conditions.time[rows]) > 0.0
    )


def errors_in(dataset: Dataset, models: Models) -> tuple[NDArray[np.bool_], list[Vectors]] | None:
    """Return a mask (n,) of held-out points, and there the errors of the first model and of the last.

    It is None without held-out points.
    """
    taken = np.zeros(len(dataset), dtype=bool)
    taken[thinned(np.flatnonzero(dataset.validation_rows & dataset.pointed), _ARROWS)] = True
    if not taken.any():
        return None
    conditions, points = dataset.conditions.take(taken), dataset.points[taken]
    ends = [list(models.items())[k] for k in (0, -1)]
    return taken, [
        Vectors(name, points - BoundModel(model, conditions).predict(estimate), colour)
        for name, (model, estimate, colour) in ends
    ]


def in_space(dataset: Dataset, models: Models) -> ErrorsInSpace | None:
    """Return the same errors in the frame of the robot's base; None where they do not show how it stands."""
    found = errors_in(dataset, models)
    if found is None:
        return None
    taken, (before, after) = found
    model, estimate, _ = list(models.values())[-1]
    conditions, at = dataset.conditions.take(taken), targets_in_base(dataset, model, estimate)[taken]
    seen = dataset.points[taken] - after.errors
    turned = [np.zeros_like(at), np.zeros_like(at)]
    for series in np.unique(conditions.series):
        mine = conditions.series == series
        away = [places[mine] - places[mine].mean(axis=0) for places in (at, seen)]
        if np.linalg.matrix_rank(away[0], tol=_FLAT_MM) < _SPANNED:
            return None
        base = Rotation.align_vectors(*away)[0]
        for out, each in zip(turned, (before, after), strict=True):
            out[mine] = base.apply(each.errors[mine])
    return ErrorsInSpace(model.robot, conditions.joints, at, *turned)


def arrows(points: Array, models: Sequence[Vectors]) -> str:
    """Draw errors of models at points (n, 3), mm, as SVG.

    They are drawn from above and from the side, one row per model.
    """
    drawn, places = drawing.figure(8.2, 2.55 * len(models), len(models), 2)
    size = float(np.max(np.ptp(points, axis=0))) or 1.0
    told = []
    for number, each in enumerate(models):
        length = np.linalg.norm(each.errors, axis=1)
        usual = float(np.quantile(length, 0.95)) or 1.0
        times = enlargement(_LONGEST * size / usual)
        for axes, a, b, seen in (
            (places[2 * number], 0, 1, "from above"),
            (places[2 * number + 1], 0, 2, "from the side"),
        ):
            _arrows(axes, points[:, [a, b]], times * each.errors[:, [a, b]], each.colour)
            axes.set_title(f"{each.name}, {seen}, {times:g} times", fontsize=9.0, loc="left")
            axes.set_xlabel(f"{'xyz'[a]}, mm")
            axes.set_ylabel(f"{'xyz'[b]}, mm")
        told.append(f"{each.name} up to {millimetres(float(length.max()))} mm")
    return drawing.as_svg(
        drawn, "arrows", f"Errors as arrows in the workspace, from above and from the side: {'; '.join(told)}"
    )


def enlargement(wanted: float) -> float:
    """Return the largest of 1, 2, 5, 10, 20, 50 and so on up to `wanted`; at least 1."""
    power = 10.0 ** np.floor(np.log10(max(wanted, 1.0)))
    return float(power * max(step for step in (1.0, 2.0, 5.0) if step * power <= max(wanted, 1.0)))


def _arrows(axes: Axes, at: Array, vectors: Array, colour: str) -> None:
    drawing.dots(axes, at[:, 0], at[:, 1], size=1.4, alpha=0.6)
    axes.quiver(
        *at.T,
        *vectors.T,
        angles="xy",
        scale_units="xy",
        scale=1.0,
        color=colour,
        width=0.003,
        headwidth=2.6,
        headlength=3.0,
        headaxislength=2.8,
        zorder=4,
    )
    ends = np.vstack([at, at + vectors])
    axes.update_datalim(ends)
    axes.autoscale_view()
    axes.set_aspect("equal", adjustable="datalim")


def over_time(dataset: Dataset, rows: NDArray[np.int64], measured: Sequence[ErrorSample]) -> str:
    """Draw errors (n,) of every model on the rows (n,) over time in hours, as SVG.

    If no time is known, they are in order. The line is the median of a stretch, and ends where measuring paused.
    """
    clock = _known_time(dataset, rows)
    x = dataset.conditions.time[rows] / 3600.0 if clock else dataset.conditions.order[rows] + 1.0
    drawn, (axes,) = drawing.figure(8.2, 2.4)
    shown = thinned(np.arange(len(rows)), _DOTS)
    pieces = stretches(x)
    for each in measured:
        drawing.dots(axes, x[shown], each.distances[shown], size=2.4, alpha=0.5, colour=each.colour)
        for piece in pieces:
            axes.plot(
                [np.median(x[part]) for part in piece],
                [np.median(each.distances[part]) for part in piece],
                color=each.colour,
                linewidth=1.5,
                label=each.name if piece is pieces[0] else None,
            )
    axes.set_yscale("log")
    drawing.plain(axes.yaxis)
    axes.set_xlabel("time, h" if clock else "reading, in order of time")
    axes.set_ylabel("error, mm")
    drawing.legend(drawn, axes, len(measured))
    return drawing.as_svg(drawn, "over-time", "Error of every model on held-out readings over time")


def stretches(x: Array) -> list[list[NDArray[np.int64]]]:
    """Split the rows of times x (n,) into stretches.

    Rows are in different stretches if nothing was measured for a fifth of the whole time between them.
    """
    order = np.argsort(x, kind="stable")
    sessions = np.split(order, np.flatnonzero(np.diff(x[order]) > _PAUSE * np.ptp(x)) + 1)
    share = [_STRETCHES * len(each) // len(x) for each in sessions]
    return [
        np.array_split(rows, max(1, min(most, len(rows) // 5)))
        for rows, most in zip(sessions, share, strict=True)
    ]


def _by_target(
    dataset: Dataset, rows: NDArray[np.int64], measured: Sequence[ErrorSample]
) -> list[tuple[str, int, list[tuple[str, str]]]]:
    """Return (target, n, (RMS, max) of every model, mm) for every target.

    If there are several series, targets are listed for each.
    """
    conditions = dataset.conditions
    several = len(conditions.series_names) > 1
    table = []
    for s, series in enumerate(conditions.series_names):
        for t, target in enumerate(conditions.target_names):
            mine = (conditions.series[rows] == s) & (conditions.target[rows] == t)
            if not mine.any():
                continue
            figures = [statistics_of(each.distances[mine]) for each in measured]
            shown = [(millimetres(e.rms), millimetres(e.max)) for e in figures if e is not None]
            table.append((f"{series}: {target}" if several else target, int(mine.sum()), shown))
    return table[:_TARGETS]
