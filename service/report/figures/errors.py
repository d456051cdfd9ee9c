"""Position error on held-out readings: histogram on common bins, and cumulative curve."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib.array import Array
from calib.fit import statistics_of
from service.report.figures import drawing
from service.wording import millimetres

_FEWEST_BINS, _MOST_BINS = 12, 50
_WIDE = 6.0  # ratio of the medians above which only a logarithmic axis shows both


@dataclass(frozen=True)
class ErrorSample:
    """Distances (n,), mm, of one model on the held-out readings."""

    name: str
    distances: Array
    colour: str


def common_bins(sets: Sequence[ErrorSample]) -> tuple[Array, bool]:
    """Return edges of bins that hold every set, mm, and whether they are spaced by ratio."""
    together = np.concatenate([s.distances for s in sets])
    count = int(np.clip(np.sqrt(2.0 * len(sets[0].distances)) * 1.5, _FEWEST_BINS, _MOST_BINS))
    medians = [max(float(np.median(s.distances)), 1e-9) for s in sets]
    if max(medians) / min(medians) > _WIDE:
        low = max(float(together.min()), float(together.max()) * 1e-4, 1e-9)
        return np.geomspace(low, max(float(together.max()), low * 1.01), count + 1), True
    return np.linspace(0.0, max(float(together.max()), 1e-9), count + 1), False


def histogram(sets: Sequence[ErrorSample]) -> str:
    """Draw the histogram of all sets on the same bins, as SVG."""
    edges, ratio = common_bins(sets)
    drawn, (axes,) = drawing.figure(4.3, 2.9)
    for i, s in enumerate(sets):
        e = statistics_of(s.distances)
        assert e is not None
        label = (
            f"{s.name}\nmean {millimetres(e.mean)}\n95 % {millimetres(e.p95)}\nmax {millimetres(e.max)} mm"
        )
        counts, _ = np.histogram(np.clip(s.distances, edges[0], edges[-1]), edges)
        axes.stairs(
            counts, edges, fill=True, color=s.colour, alpha=0.3 + 0.3 * i / max(len(sets) - 1, 1), label=label
        )
        axes.stairs(counts, edges, color=s.colour, linewidth=1.2)
        axes.axvline(e.mean, color=s.colour, linewidth=1.2, linestyle=(0, (4, 2)))
    if ratio:
        drawing.plain_ratio_axis(axes)
    else:
        axes.set_xlim(0.0, None)
    axes.yaxis.set_major_locator(drawing.whole_numbers())
    axes.grid(axis="x", visible=False)
    axes.set_xlabel("error, mm")
    axes.set_ylabel(f"readings of {len(sets[0].distances)}")
    axes.margins(y=0.04)
    drawing.legend(drawn, axes, len(sets))
    names = " and ".join(s.name for s in sets)
    return drawing.as_svg(drawn, "histogram", f"Histogram of the position error, same bins: {names}")


def cumulative(sets: Sequence[ErrorSample]) -> str:
    """Draw the share of the readings below an error, as SVG."""
    drawn, (axes,) = drawing.figure(4.3, 2.9)
    _, ratio = common_bins(sets)
    for s in sets:
        x = np.sort(s.distances)
        share = np.arange(1, len(x) + 1) / len(x) * 100.0
        if len(x) > 400:
            keep = np.unique(np.linspace(0, len(x) - 1, 400).astype(int))
            x, share = x[keep], share[keep]
        axes.step(x, share, where="post", color=s.colour, linewidth=1.8, label=s.name)
    axes.axhline(95.0, color=drawing.QUIET, linewidth=0.8, linestyle=(0, (2, 2)))
    axes.annotate("95 %", (0.01, 95.0), xycoords=("axes fraction", "data"), ha="left", va="top", fontsize=8.5)
    if ratio:
        drawing.plain_ratio_axis(axes)
    else:
        axes.set_xlim(0.0, None)
    axes.set_ylim(0.0, 101.0)
    axes.set_xlabel("error, mm")
    axes.set_ylabel("share of the readings, %")
    drawing.legend(drawn, axes, len(sets))
    return drawing.as_svg(drawn, "cumulative", "Cumulative curve of the position error of each model")
