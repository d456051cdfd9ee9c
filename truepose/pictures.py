"""Pictures of residuals by matplotlib."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING

from matplotlib.figure import Figure

if TYPE_CHECKING:
    import pandas

_BINS = 30


class NotebookFigure(Figure):
    """A figure that a notebook shows by itself, with or without a chosen backend of matplotlib."""

    def _repr_png_(self) -> bytes:
        drawn = io.BytesIO()
        self.savefig(drawn, format="png", dpi=80)
        return drawn.getvalue()


def residuals(found: pandas.DataFrame) -> Figure:
    """Draw the errors of `Model.residuals`, one dot per reading, and their histogram by set."""
    drawn = NotebookFigure(figsize=(9.0, 3.2), layout="constrained")
    by_reading, histogram = drawn.subplots(1, 2, width_ratios=(2, 1))
    place = {name: number for number, name in enumerate(found.index)}
    for name, part in found.groupby("set"):
        by_reading.plot([place[each] for each in part.index], part["error_mm"], ".", label=str(name))
        histogram.hist(part["error_mm"], bins=_BINS, histtype="step", label=str(name))
    by_reading.set(xlabel="reading", ylabel="error, mm", ylim=(0.0, None))
    histogram.set(xlabel="error, mm", ylabel="readings")
    by_reading.legend(title="set")
    return drawn


def before_and_after(before: pandas.DataFrame, after: pandas.DataFrame) -> Figure:
    """Draw the errors of two models on the same readings, one dot each, the later in front."""
    drawn = NotebookFigure(figsize=(9.0, 3.2), layout="constrained")
    axes = drawn.subplots()
    for found, label in ((before, "base model"), (after, "with effects")):
        axes.plot(range(len(found)), found["error_mm"], ".", label=label)
    axes.set(xlabel="reading", ylabel="error, mm", ylim=(0.0, None))
    axes.legend()
    return drawn
