"""Trust in a model: predicted uncertainty over the workspace, and the basis of the fit."""

from __future__ import annotations

from typing import Any

import numpy as np
from markupsafe import Markup
from matplotlib import colormaps
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm

from calib.data import Dataset
from calib.fit import IdentificationFit, UncertaintyMap, uncertainty_map
from service.report.figures import drawing
from service.results.models.parameters import high_leverage, strong_correlations
from service.wording import millimetres

_LISTED = 6
_CELLS = 28
_COLOURS = colormaps["viridis_r"].resampled(16)  # steps can be read off; a smooth scale becomes a bitmap


def trust_of(dataset: Dataset, found: IdentificationFit) -> dict[str, Any]:
    """Build the section of a report on the trust in a model.

    It has a figure, the radius that contains 95 %, correlations, leverage and condition number.
    """
    of_map = uncertainty_map(found)
    return {
        "figure": Markup(_figure(of_map)),
        "rows": [
            (name, *(millimetres(float(x)) for x in (np.median(u), np.quantile(u, 0.95), u.max())))
            for name, u in (
                ("within the measured joint ranges", of_map.radius_95[of_map.measured]),
                ("outside them, within the joint limits", of_map.radius_95[~of_map.measured]),
            )
            if len(u)
        ],
        "condition": f"{found.condition_number:.0f}",
        "chi_square": f"{found.reduced_chi_square:.3f}",
        "correlations": [
            f"{a} with {b} ({r:+.3f})".replace("-", "−") for a, b, r in strong_correlations(found)[:_LISTED]
        ],
        "more_correlations": max(0, len(strong_correlations(found)) - _LISTED),
        "leverage": [
            f"{dataset.reading_id[row]} ({share:.2f})" for row, share in high_leverage(found)[:_LISTED]
        ],
        "mean_leverage": f"{found.leverage.mean():.2f}",
        "config": found.config_sha256[:12],
    }


def _figure(of_map: UncertaintyMap) -> str:
    """Draw the largest radius that contains 95 % by distance and height.

    One panel is within the measured ranges, the other within the limits.
    """
    drawn, panels = drawing.figure(7.6, 3.0, 1, 2, bars=True)
    radius = np.linspace(0.0, float(of_map.radius.max()), _CELLS + 1)
    height = np.linspace(float(of_map.height.min()), float(of_map.height.max()), _CELLS + 1)
    scale = LogNorm(float(of_map.radius_95.min()), float(of_map.radius_95.max()))
    for axes, (title, rows) in zip(
        panels,
        (
            ("Within the measured joint ranges", of_map.measured),
            ("Within the robot's joint limits", np.ones(len(of_map.radius_95), dtype=bool)),
        ),
        strict=True,
    ):
        worst = np.full((_CELLS, _CELLS), np.nan)
        i = np.clip(np.digitize(of_map.radius[rows], radius) - 1, 0, _CELLS - 1)
        j = np.clip(np.digitize(of_map.height[rows], height) - 1, 0, _CELLS - 1)
        np.fmax.at(worst, (j, i), of_map.radius_95[rows])
        axes.pcolormesh(radius, height, worst, norm=scale, cmap=_COLOURS)
        axes.set_title(title, fontsize=9.5, loc="left")
        axes.set_xlabel("distance of the flange from axis 1, mm")
        axes.set_ylabel("height, mm")
    bar = drawing.colour_bar(
        drawn, ScalarMappable(scale, _COLOURS), panels[-1], "largest radius that contains 95 %, mm"
    )
    bar.ax.tick_params(which="both", labelsize=8.5)
    drawing.plain(bar.ax.yaxis)
    return drawing.as_svg(
        drawn,
        "trust",
        "Map of the radius that contains 95 % of predicted positions over distance from axis 1 and height",
    )
