"""Picture of two aligned streams.

It shows the speeds by each stream's own clock and by the common clock, and the error along and across the path
by speed.
"""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from calib.motion import split
from service.report.figures import drawing
from service.report.figures.scatter import thinned
from service.results.files.alignment import StreamAlignment

_SHOWN_S = 60.0
_LEAD_S = 5.0
_MOVES = 0.2  # of the highest speed: there the stretch that is shown begins
_MOST_DOTS = 1500

Array = NDArray[np.float64]


def motion_picture(result: StreamAlignment) -> str:
    """Draw the picture as SVG text."""
    drawn, (before, after, *errors) = drawing.figure(9.0, 10.5, 4, 1)
    found = result.aligned
    time = result.tracked.time
    step = np.diff(time)
    near = step < 1.5 * result.tracked.period
    middle = (0.5 * (time[1:] + time[:-1]))[near]
    speed = np.linalg.norm(np.diff(result.tracked.points, axis=0)[near], axis=1) / step[near]
    begin = float(found.time[int(np.argmax(found.speed > _MOVES * found.speed.max()))]) - _LEAD_S
    for axes, at, title in (
        (before, middle, "Speeds, each by its own clock from its first sample"),
        (after, found.clocks.robot_time(middle), "Speeds on one clock"),
    ):
        _speeds(axes, found.time, found.speed, begin, drawing.AFTER, "robot, from its joints")
        _speeds(axes, at, speed, begin, drawing.FITTED, "tracker")
        axes.set_title(title, fontsize=9.0, loc="left", color=drawing.INK)
        axes.set_xlabel("time, s")
        axes.set_ylabel("speed, mm/s")
        axes.set_xlim(begin, begin + _SHOWN_S)
    _errors(result, *errors)
    before.legend(frameon=False, fontsize=8.5, loc="best")
    return drawing.as_svg(drawn, "motion", _described(result))


def _speeds(axes: Axes, time: Array, speed: Array, begin: float, colour: str, label: str) -> None:
    inside = (time >= begin - 1.0) & (time <= begin + _SHOWN_S + 1.0)
    axes.plot(time[inside], speed[inside], color=colour, linewidth=1.0, label=label)


def _errors(result: StreamAlignment, along: Axes, across: Axes) -> None:
    """Draw the errors of the moving samples by speed.

    They are those of the nominal arm, and the residuals of its static part.
    """
    found = result.aligned
    moving = np.flatnonzero((found.weight > 0.0) & (found.speed >= result.order.slower_than))
    shown = moving[thinned(np.arange(len(moving)), _MOST_DOTS)]
    speed = found.speed[shown]
    for errors, colour, label in (
        (found.nominal, drawing.NOMINAL, "nominal arm in its best place"),
        (found.moving, drawing.AFTER, "what its static part leaves"),
    ):
        for axes, values in zip(
            (along, across), split(errors[shown], found.velocity[shown] / speed[:, None]), strict=True
        ):
            axes.plot(
                speed,
                values,
                linestyle="none",
                marker="o",
                markersize=2.2,
                markeredgewidth=0.0,
                color=colour,
                label=label,
            )
    for axes, title in (
        (along, "Error along the path by speed; below zero the points come late"),
        (across, "Error across the path by speed"),
    ):
        axes.set_title(title, fontsize=9.0, loc="left", color=drawing.INK)
        axes.set_xlabel("speed, mm/s")
        axes.set_ylabel("error, mm")
    across.set_ylim(bottom=0.0)
    across.legend(frameon=False, fontsize=8.5, loc="upper right")


def _described(result: StreamAlignment) -> str:
    miss = [
        float(np.sqrt(np.mean(np.sum(e[result.aligned.weight > 0.0] ** 2, axis=1))))
        for e in (result.aligned.nominal, result.aligned.moving)
    ]
    return (
        f"Speeds of robot and tracker before and after the alignment of their clocks, {result.offset:.5f} s "
        f"apart; errors of the moving robot along and across its path by speed, RMS {miss[0]:.3f} mm nominal, of which "
        f"its static part leaves {miss[1]:.3f} mm."
    )
