"""Test all pairs: equal to a plain loop for any tile, and independent of rigid motions.

They are accurate for points that nearly coincide.
"""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.distance import pdist
from scipy.spatial.transform import Rotation

from calib.array import Array
from calib.validation.pairs import RESOLUTION, pair_errors
from calib.validation.summary import Summary, summarise

SEEDS = st.integers(0, 2**32 - 1)


def points_of(seed: int, n: int, error: float = 0.3) -> tuple[Array, Array]:
    """Predicted points in a cube of a metre far from the origin, and measured ones."""
    rng = np.random.default_rng(seed)
    predicted = rng.uniform(-500.0, 500.0, (n, 3)) + np.array([3000.0, -2000.0, 500.0])
    return predicted + rng.normal(0.0, error, (n, 3)), predicted


def naive(measured: Array, predicted: Array) -> Array:
    """Every pair by itself, in extended precision."""
    m, p = measured.astype(np.longdouble), predicted.astype(np.longdouble)
    i, j = np.triu_indices(len(m), 1)
    lengths = (np.sqrt(np.sum((x[i] - x[j]) ** 2, axis=1)) for x in (m, p))
    return np.abs(next(lengths) - next(lengths)).astype(np.float64)


def found(measured: Array, predicted: Array, tile: int = 192) -> Summary:
    summary = pair_errors(measured, predicted, tile=tile)
    assert summary is not None
    return summary


def same(summary: Summary, errors: Array) -> None:
    assert summary.n == len(errors)
    assert summary.mean == pytest.approx(errors.mean(), rel=1e-9, abs=1e-10)
    assert summary.rms == pytest.approx(np.sqrt(np.mean(errors**2)), rel=1e-9, abs=1e-10)
    assert summary.max == pytest.approx(errors.max(), abs=2e-10)
    if len(errors) > 1:
        assert summary.std == pytest.approx(errors.std(ddof=1), rel=1e-6, abs=1e-9)
    exact = float(np.quantile(errors, 0.95, method="inverted_cdf"))
    assert summary.p95 == pytest.approx(exact, rel=2.0 * RESOLUTION, abs=3e-9)


@given(SEEDS, st.integers(2, 70), st.integers(1, 80))
@settings(deadline=None, max_examples=60)
def test_any_tile_gives_what_every_pair_by_itself_gives(seed: int, n: int, tile: int) -> None:
    measured, predicted = points_of(seed, n)
    same(found(measured, predicted, tile), naive(measured, predicted))


@given(SEEDS)
@settings(deadline=None, max_examples=20)
def test_repeated_poses_are_as_accurate_as_distant_ones(seed: int) -> None:
    rng = np.random.default_rng(seed)
    measured, predicted = points_of(seed, 20)
    which = rng.integers(0, 20, 60)
    predicted = predicted[which]
    measured = predicted + 10.0 ** rng.uniform(-7.0, 0.0, (60, 1)) * rng.normal(0.0, 1.0, (60, 3))
    close = np.linalg.norm(predicted[:, None] - predicted[None], axis=2) == 0.0
    assert close.sum() > 60
    same(found(measured, predicted), naive(measured, predicted))


@given(SEEDS, st.floats(-np.pi, np.pi))
@settings(deadline=None, max_examples=30)
def test_distances_know_nothing_of_frames(seed: int, angle: float) -> None:
    measured, predicted = points_of(seed, 40)
    turn = Rotation.from_rotvec(angle * np.array([0.6, 0.0, 0.8])).as_matrix()
    moved = measured @ turn.T + np.array([120.0, -80.0, 30.0])
    there, here = found(moved, predicted), found(measured, predicted)
    for name in ("mean", "std", "rms", "max"):
        assert getattr(there, name) == pytest.approx(getattr(here, name), abs=1e-9)
    assert there.p95 == pytest.approx(here.p95, rel=4.0 * RESOLUTION)


def test_thousands_of_points_against_scipy_in_bounded_memory() -> None:
    measured, predicted = points_of(3, 3000)
    errors = np.abs(pdist(measured) - pdist(predicted))
    tracemalloc.start()
    summary = found(measured, predicted)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    same(summary, errors)
    assert peak < errors.nbytes / 2


@pytest.mark.parametrize("size", [0.0, 1e-4, 1.0, 1e4])
def test_a_bracket_that_misses_is_set_anew(size: float) -> None:
    """A bracket is set again if the sample sees another distribution.

    One point in twelve is off, in step with the sample's stride.
    """
    predicted = points_of(5, 2400)[1]
    measured = predicted.copy()
    measured[1::12] += size * np.random.default_rng(1).normal(0.0, 1.0, (200, 3))
    same(found(measured, predicted), np.abs(pdist(measured) - pdist(predicted)))


def test_one_pair_and_none() -> None:
    measured = np.array([[0.0, 0.0, 0.0], [3.0, 4.0, 0.0]])
    one = found(measured, 2.0 * measured)
    assert (one.n, one.mean, one.max) == (1, 5.0, 5.0)
    assert one.p95 == pytest.approx(5.0)
    assert np.isnan(one.std)
    assert pair_errors(measured[:1], measured[:1]) is None


@given(SEEDS, st.integers(1, 200))
@settings(deadline=None, max_examples=30)
def test_summary_against_numpy(seed: int, n: int) -> None:
    errors = np.random.default_rng(seed).gamma(2.0, 0.1, n)
    summary = summarise(errors)
    assert summary is not None
    assert summary.n == n
    assert summary.mean == pytest.approx(np.mean(errors))
    assert summary.rms == pytest.approx(np.sqrt(np.mean(np.square(errors))))
    assert summary.p95 == pytest.approx(np.percentile(errors, 95))
    assert summary.max == errors.max()
    if n > 1:
        assert summary.std == pytest.approx(np.sqrt(np.sum((errors - errors.mean()) ** 2) / (n - 1)))
        assert summary.mean_3std == pytest.approx(summary.mean + 3.0 * summary.std)
    else:
        assert np.isnan(summary.std)


def test_nothing_to_summarise() -> None:
    assert summarise(np.array([])) is None
