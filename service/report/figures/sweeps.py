"""Picture of single joints: tangential error over the angle, up and down, per sweep."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from service.report.figures import drawing
from service.results.models.swept import SweepResponse


def sweeps_picture(sweeps: Sequence[SweepResponse]) -> str:
    """Draw the picture as SVG text."""
    rows = (len(sweeps) + 1) // 2
    drawn, panels = drawing.figure(9.0, 0.5 + 2.3 * rows, rows, min(len(sweeps), 2))
    for axes, sweep in zip(panels, sweeps, strict=False):
        angle, error, up = map(np.asarray, (sweep.angle_deg, sweep.tangential_deg, sweep.upwards))
        for rows_of, colour, label in (
            (up, drawing.AFTER, "on the way up"),
            (~up, drawing.FITTED, "on the way down"),
        ):
            order = np.flatnonzero(rows_of)[np.argsort(angle[rows_of], kind="stable")]
            axes.plot(
                angle[order],
                error[order],
                marker="o",
                markersize=2.4,
                linewidth=0.8,
                color=colour,
                label=label,
            )
        axes.set_title(
            f"joint {sweep.joint}, {sweep.target}, radius {sweep.radius_mm:.0f} mm",
            fontsize=9.0,
            loc="left",
            color=drawing.INK,
        )
        axes.set_xlabel("commanded angle, deg")
        axes.set_ylabel("tangential error, deg")
    for axes in panels[len(sweeps) :]:
        axes.set_axis_off()
    drawing.legend(drawn, panels[0], 2)
    return drawing.as_svg(drawn, "sweeps", "Tangential error of every joint over its angle, up and down")
