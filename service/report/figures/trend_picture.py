"""Picture of a trend: values with U, centre of the control chart, limits of every value."""

from __future__ import annotations

import io

import matplotlib
import numpy as np
from matplotlib.dates import AutoDateLocator, ConciseDateFormatter, date2num
from matplotlib.figure import Figure

from calib.units import percent
from service.report.figures import drawing
from service.results.history import Trend

ENDINGS = (".svg", ".png")
_DPI = 150


def trend_picture(trend: Trend) -> Figure:
    """Draw values over time; a value that the chart takes for a signal has another colour."""
    drawn, (axes,) = drawing.figure(7.5, 3.6)
    times = np.array(date2num([point.measured_at for point in trend.points]))
    values = np.array([point.value for point in trend.points])
    axes.errorbar(
        times,
        values,
        yerr=[point.u or 0.0 for point in trend.points],
        fmt="o",
        markersize=4.0,
        linewidth=1.0,
        color=drawing.AFTER,
        label="value and U (k = 2)",
    )
    chart = trend.chart
    if chart is not None:
        axes.axhline(chart.centre, color=drawing.QUIET, linewidth=0.8, label="centre of the first values")
        for side, name in ((0, f"limits, {percent(chart.rate)} signals by chance"), (1, None)):
            axes.step(
                times, chart.limits[:, side], where="mid", color=drawing.BEFORE, linewidth=1.0, label=name
            )
        axes.plot(times[chart.reference :], chart.mean[chart.reference :], color=drawing.NOMINAL, linewidth=1.0,
                  label="weighted mean")  # fmt: skip
        out = sorted({signal.index for signal in chart.signals})
        axes.plot(times[out], values[out], "o", color=drawing.FITTED, markersize=6.0,
                  label="signal" if out else None)  # fmt: skip
    locator = AutoDateLocator()
    axes.xaxis.set_major_locator(locator)
    axes.xaxis.set_major_formatter(ConciseDateFormatter(locator))
    axes.set_ylabel(f"{trend.parameter}, {trend.unit}" if trend.unit else trend.parameter)
    axes.set_title(f"Robot {trend.robot.serial} ({trend.robot.model})", loc="left", fontsize=9.5)
    drawing.legend(drawn, axes, 3)
    return drawn


def picture_bytes(trend: Trend, ending: str) -> bytes:
    """Return the picture as a file of SVG or PNG."""
    file = io.BytesIO()
    with matplotlib.rc_context({"svg.fonttype": "none", "svg.hashsalt": trend.parameter, "font.size": 9.0}):
        metadata = {"Date": None} if ending == ".svg" else None
        trend_picture(trend).savefig(file, format=ending[1:], dpi=_DPI, metadata=metadata)
    return file.getvalue()
