"""Regression panel: its table, and a picture of errors in sample and on held-out waypoints."""

from __future__ import annotations

from typing import Any

import numpy as np
from markupsafe import Markup
from matplotlib.ticker import LogLocator, NullLocator
from numpy.typing import NDArray

from calib.array import Array
from calib.comparison import RegressionComparison
from service.printed.regression_tables import COLUMNS, rows
from service.report.figures import drawing
from service.results.models.regressed import RegressionResult

_WIDE = 1000.0  # ratio of the ends of an axis, from which on 2 and 5 between the powers of ten run into each other


def section_of(comparison: RegressionComparison, result: RegressionResult) -> dict[str, Any]:
    """The panel as the template shows it: rows of (name, kind, figures), the picture, and the result."""
    return {
        "columns": COLUMNS,
        "rows": rows(result),
        "picture": Markup(picture(comparison)),
        "result": result,
    }


def foremost(findings: list[str], asked: str) -> list[str]:
    """Return the findings for the head of the report.

    They are the first one, and those on the requested predictor.
    """
    return list(dict.fromkeys([findings[0], *(each for each in findings if each.startswith(f"{asked}:"))]))


def picture(comparison: RegressionComparison) -> str:
    """Draw the errors of every predictor, in sample and left out, with the median.

    Each waypoint is a dot.
    """
    drawn, (axes,) = drawing.figure(7.2, 0.6 + 0.55 * len(comparison.scored))
    kinds = (("in sample", drawing.BEFORE, -0.16), ("on waypoints left out", drawing.AFTER, 0.16))
    for place, scored in enumerate(comparison.scored):
        for (label, colour, beside), errors in zip(
            kinds, (scored.in_sample, scored.by_waypoint), strict=True
        ):
            size = 1e3 * _by_waypoint(errors, comparison.waypoint)
            height = np.full(len(size), place + beside)
            axes.plot(size, height, ".", color=colour, markersize=4, label="" if place else label)
            axes.plot(
                np.median(size), place + beside, "|", color=drawing.INK, markersize=11, markeredgewidth=1.6
            )
    axes.set_yticks(range(len(comparison.scored)), [s.predictor.name for s in comparison.scored])
    axes.invert_yaxis()
    drawing.plain_ratio_axis(axes)
    low, high = axes.get_xlim()
    axes.xaxis.set_major_locator(LogLocator(subs=(1.0,) if high > _WIDE * low else (1.0, 2.0, 5.0)))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.grid(axis="y", visible=False)
    axes.set_xlabel("RMS distance at a waypoint, um")
    drawing.legend(drawn, axes, 2)
    return drawing.as_svg(drawn, "regression", "Errors of every predictor, by waypoint")


def _by_waypoint(errors: Array, waypoint: NDArray[np.int64]) -> Array:
    """Return the RMS distance (w,) at every waypoint, from errors (n, 3)."""
    _, number = np.unique(waypoint, return_inverse=True)
    squares = np.bincount(number, weights=(errors**2).sum(axis=1)) / np.bincount(number)
    return np.maximum(np.sqrt(squares), 1e-9)
