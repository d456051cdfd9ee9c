"""Axes that are placed by counting letters: every word within the figure, and none on another axes.

These would catch a number that is cut at the edge, a label that stands on its neighbour, and a legend on a plot.
"""

from __future__ import annotations

from itertools import combinations

import matplotlib
import pytest
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure

from service.report.figures import drawing
from service.report.figures.arranging import arrange

_ROOM = 2.0  # points that an estimate may be short by: the font of the page is narrower than matplotlib's


def named(axes: Axes, highest: float) -> None:
    axes.plot([0.0, 12000.0], [-highest, highest], label="one\ntwo\nthree")
    axes.plot([0.0, 12000.0], [0.0, 0.0], label="another")
    axes.set_title("first line\nsecond line", fontsize=9.0, loc="left")
    axes.set_xlabel("reading, in order of time")
    axes.set_ylabel("error, mm")


def apart(drawn: Figure) -> None:
    arrange(drawn)
    whole = drawn.bbox
    room = _ROOM * drawn.dpi / 72.0
    with matplotlib.rc_context({"font.size": 9.0}):  # of the ticks, which are made when they are measured
        boxes = [box for axes in drawn.axes if (box := axes.get_tightbbox()) is not None]
    boxes += [legend.get_window_extent() for legend in drawn.legends]
    for box in boxes:
        assert box.x0 > whole.x0 - room
        assert box.x1 < whole.x1 + room
        assert box.y0 > whole.y0 - room
        assert box.y1 < whole.y1 + room
    for one, other in combinations(boxes, 2):
        wide = min(one.x1, other.x1) - max(one.x0, other.x0)
        high = min(one.y1, other.y1) - max(one.y0, other.y0)
        assert min(wide, high) < room


@pytest.mark.parametrize("highest", [0.001, 0.5, 150000.0])
@pytest.mark.parametrize("grid", [(1, 1), (2, 2)])
def test_no_word_is_cut_or_covered(grid: tuple[int, int], highest: float) -> None:
    drawn, places = drawing.figure(9.0, 3.0 * grid[0], *grid)
    for axes in places:
        named(axes, highest)
    drawing.legend(drawn, places[0], 2)
    apart(drawn)


def test_a_colour_bar_has_room() -> None:
    drawn, (places,), (bar,) = drawing.figure_with_bars(9.0, 3.0, 1, 2)
    for axes in places:
        named(axes, 0.5)
    drawn.colorbar(ScalarMappable(), cax=bar, label="mean, mm")
    apart(drawn)
    assert bar.get_position().width * 9.0 < 0.2
