"""Ballbar section: sphere tests, errors of the distances, growth from the fixture."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from markupsafe import Markup

from calib.array import Array
from calib.data import Dataset
from calib.fit import length_differences
from calib.model import ModelStructure
from calib.validation import over_the_fixture, sphere_tests
from service.report.figures import drawing
from service.report.figures.scatter import thinned

Models = Mapping[str, tuple[ModelStructure, Array, str]]
_BINS = 24
_MOST_DOTS = 1200
_BIN_MM = 50.0  # in which the error is averaged along the distance
NEAR_MM = 200.0  # Nubiola, thesis, 4.4: better than 0.4 mm so near to the point above the fixture


def section_of(dataset: Dataset, models: Models) -> dict[str, Any] | None:
    """Build tables of the distances and sphere tests, and figures, for models with colours.

    Returns None without held-out distances.
    """
    rows = dataset.validation_rows & dataset.spanned
    if not rows.any():
        return None
    errors = {
        name: (length_differences(dataset, rows, model, estimate), colour)
        for name, (model, estimate, colour) in models.items()
    }
    tests = [
        (
            name,
            f"{test.target} about {test.base_target}, {test.radius_mm:.0f} mm",
            len(test.errors_mm),
            f"{test.mean_mm:+.4f}".replace("-", "−"),
            f"{test.std_mm:.4f}",
            f"{test.largest_mm:.4f}",
        )
        for name, (model, estimate, _) in models.items()
        for test in sphere_tests(dataset, rows, model, estimate)
    ]
    above = over_the_fixture(dataset)
    return {
        "models": [_row(name, found, dataset, rows, above) for name, (found, _) in errors.items()],
        "near_mm": NEAR_MM if above is not None else None,
        "spheres": tests,
        "histogram": Markup(_histogram(errors)),
        "growth": None if above is None else Markup(_growth(dataset, rows, above, errors)),
    }


def _row(
    name: str, found: Array, dataset: Dataset, rows: np.ndarray, above: Array | None
) -> tuple[str | int, ...]:
    """Return name, n, mean, std and max of the error of the distances, mm.

    For those near the fixture, n and mean are added.
    """
    off = np.abs(found)
    row = (name, len(off), *(f"{each:.4f}" for each in (off.mean(), off.std(ddof=1), off.max())))
    if above is None:
        return row
    near = off[_from(above, dataset, rows) <= NEAR_MM]
    return (*row, len(near), f"{near.mean():.4f}" if len(near) else "-")


def _from(above: Array, dataset: Dataset, rows: np.ndarray) -> Array:
    """Return the distances (n,) of the targets from the point above the fixture, mm."""
    return np.linalg.norm(dataset.conditions.point[rows] - above, axis=1)


def _histogram(errors: Mapping[str, tuple[Array, str]]) -> str:
    """Draw measured less predicted distances of every model as SVG.

    Each model has its own scale.
    """
    drawn, panels = drawing.figure(5.0, 3.1, len(errors), 1)
    for axes, (name, (found, colour)) in zip(panels, errors.items(), strict=True):
        edges = np.linspace(-1.0, 1.0, _BINS + 1) * max(float(np.abs(found).max()), 1e-9)
        counts, _ = np.histogram(found, edges)
        axes.stairs(counts, edges, fill=True, color=colour, alpha=0.6)
        axes.axvline(float(found.mean()), color=drawing.INK, linewidth=1.0, linestyle=(0, (4, 2)))
        mean, std = f"{found.mean():+.4f}".replace("-", "−"), f"{found.std():.4f}"
        axes.set_title(f"{name}: mean {mean}, standard deviation {std} mm", fontsize=8.5, loc="left")
        axes.yaxis.set_major_locator(drawing.whole_numbers())
        axes.set_ylabel("readings")
    panels[-1].set_xlabel("distance, measured less predicted, mm")
    return drawing.as_svg(
        drawn, "ballbar-histogram", "Histograms of the error of the distances of each model"
    )


def _growth(dataset: Dataset, rows: np.ndarray, above: Array, errors: Mapping[str, tuple[Array, str]]) -> str:
    """Draw the error of the distances over the distance from the point above the fixture.

    The result is SVG.
    """
    distance = _from(above, dataset, rows)
    bins = (distance // _BIN_MM).astype(int)
    drawn, (axes,) = drawing.figure(5.0, 3.1)
    for name, (found, colour) in errors.items():
        shown = thinned(np.arange(len(found)), _MOST_DOTS)
        axes.plot(
            distance[shown], np.abs(found)[shown], ".", color=colour, markersize=4.0, label=name, alpha=0.6
        )
        each = [(distance[bins == k].mean(), np.abs(found)[bins == k].mean()) for k in np.unique(bins)]
        axes.plot(*np.array(each).T, "-", color=colour, linewidth=1.4)
    axes.axvline(NEAR_MM, color=drawing.INK, linewidth=0.8, linestyle=(0, (4, 2)))
    axes.set_yscale("log")
    drawing.plain(axes.yaxis)
    axes.set_xlabel("distance of the target from the point above the fixture, mm")
    axes.set_ylabel("error of the distance, mm")
    drawing.legend(drawn, axes, min(len(errors), 3))
    return drawing.as_svg(
        drawn, "ballbar-growth", "Error of the distances over the distance from the fixture"
    )
