"""Benchmark of the distance error over all pairs of 9,905 points: time and peak memory.

The time is compared with scipy's pdist. The plain way makes two vectors of 49,049,560 distances (785 MB) and takes
their difference; ours computes mean, standard deviation, RMS, 95 % and maximum on the way. The ratio to one pdist
call, which computes no difference at all, is printed as well. Elapsed time counts, since ours runs on all
processors; on a machine that is busy with other work it means little.
"""

from __future__ import annotations

import time
import tracemalloc
from collections.abc import Callable

import numpy as np
from scipy.spatial.distance import pdist

from calib.validation.pairs import pair_errors
from tests.benchmarks.clock import line, seconds

POINTS = 9905
WANTED = 1.0
MOST_MB = 200.0
_TRIES = 7


def _elapsed(call: Callable[[], object]) -> float:
    return seconds(call, _TRIES, time.perf_counter)


def run() -> bool:
    """Print ratio and memory, after making sure that both ways find the same."""
    rng = np.random.default_rng(1)
    predicted = rng.uniform(-500.0, 500.0, (POINTS, 3))
    measured = predicted + rng.normal(0.0, 0.1, predicted.shape)
    errors = np.abs(pdist(measured) - pdist(predicted))
    summary = pair_errors(measured, predicted)
    if (
        summary is None
        or abs(summary.mean - errors.mean()) > 1e-10
        or abs(summary.max - errors.max()) > 1e-10
    ):
        print("the two ways differ: nothing to compare")
        return False
    del errors
    ours = _elapsed(lambda: pair_errors(measured, predicted))
    one = _elapsed(lambda: pdist(predicted))
    two = _elapsed(lambda: np.abs(pdist(measured) - pdist(predicted)))
    ratio = ours / two
    name = f"{summary.n:,} pairs: {1000 * ours:.0f} ms, by pdist {1000 * two:.0f} ms"
    line(name, f"{ratio:.2f} x", f"<= {WANTED:.0f}", ratio <= WANTED)
    print(f"  against a single pdist call without any difference ({1000 * one:.0f} ms): {ours / one:.2f} x")
    tracemalloc.start()
    pair_errors(measured, predicted)
    peak = tracemalloc.get_traced_memory()[1] / 1e6
    tracemalloc.stop()
    line("  peak memory", f"{peak:.0f} MB", f"<= {MOST_MB:.0f}", peak <= MOST_MB)
    return ratio <= WANTED and peak <= MOST_MB
