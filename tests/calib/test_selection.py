"""Test exchange, bound and indices on plain matrices.

They are compared with brute force, recomputation and known optima.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from calib.array import Array
from calib.errors import DataError
from calib.selection import observability, select
from calib.selection.exchange import (
    Indices,
    SelectionState,
    exchange,
    greedy,
    log_det,
    optimum,
    without_least,
)
from calib.selection.pose_rows import PoseRows

SEEDS = st.integers(0, 10_000)


def random_rows(seed: int, poses: int, k: int, m: int) -> Array:
    return np.random.default_rng(seed).normal(size=(poses, k, m))


def true_log_det(rows: Array, selection: Indices) -> float:
    x = rows[selection].reshape(-1, rows.shape[2])
    return float(np.linalg.slogdet(x.T @ x)[1])


@pytest.mark.parametrize("seed", range(8))
def test_tiny_problems_are_solved_to_the_optimum(seed: int) -> None:
    k = 1 + seed % 3
    rows = random_rows(seed, 11, k, 3)
    best = max(true_log_det(rows, np.array(each)) for each in combinations(range(11), 4))
    assert true_log_det(rows, select(rows, 4)) == pytest.approx(best, abs=1e-9)


@settings(max_examples=30, deadline=None)
@given(seed=SEEDS, k=st.integers(1, 4))
def test_exchange_never_lowers_the_determinant_and_ends_where_no_swap_helps(seed: int, k: int) -> None:
    rows = random_rows(seed, 30, k, 5)
    blocks = PoseRows.of(rows)
    start = np.sort(np.random.default_rng(seed).choice(30, 8, replace=False))
    end = exchange(blocks, start)
    assert len(set(end.tolist())) == 8
    assert log_det(blocks, end) >= log_det(blocks, start)
    reached = true_log_det(rows, end)
    for place in range(8):
        for j in np.setdiff1d(np.arange(30), end):
            swapped = end.copy()
            swapped[place] = j
            assert true_log_det(rows, swapped) <= reached + 1e-8


@settings(max_examples=30, deadline=None)
@given(seed=SEEDS, k=st.integers(1, 4))
def test_updates_equal_recomputation(seed: int, k: int) -> None:
    rows = random_rows(seed, 20, k, 4)
    blocks = PoseRows.of(rows)
    selection = np.arange(8)
    state = SelectionState.of(blocks, blocks.information(selection)).changed(3, -1.0).changed(15, +1.0)
    moved = np.array([0, 1, 2, 4, 5, 6, 7, 15])
    anew = SelectionState.of(blocks, blocks.information(moved))
    assert state.inverse == pytest.approx(anew.inverse, rel=1e-7, abs=1e-9)
    assert state.b == pytest.approx(anew.b, rel=1e-7, abs=1e-9)
    gains = [true_log_det(rows, np.append(moved, j)) - true_log_det(rows, moved) for j in range(20)]
    assert state.gains() == pytest.approx(gains, abs=1e-7)


def test_prepared_blocks_keep_every_determinant() -> None:
    rows = random_rows(3, 40, 3, 4) * np.array([1e-4, 1.0, 30.0, 1e5])
    blocks = PoseRows.of(rows)
    for seed in range(5):
        selection = np.random.default_rng(seed).choice(40, 7, replace=False)
        assert log_det(blocks, selection) + blocks.log_scale == pytest.approx(true_log_det(rows, selection))


def test_rows_that_say_nothing_new_are_left_out() -> None:
    """Nine rows of three points on a rigid body hold six independent ones."""
    rng = np.random.default_rng(1)
    mixing = rng.normal(size=(9, 6))
    blocks = PoseRows.of(mixing @ rng.normal(size=(50, 6, 12)))
    assert blocks.width == 6


def test_without_least_leaves_out_what_costs_least() -> None:
    rows = random_rows(5, 12, 2, 4)
    blocks = PoseRows.of(rows)
    all_but = [np.delete(np.arange(12), i) for i in range(12)]
    best = max(all_but, key=lambda each: true_log_det(rows, each))
    assert without_least(blocks, np.arange(12), 11).tolist() == best.tolist()
    gone = int(np.setdiff1d(np.arange(12), best)[0])
    assert gone in without_least(blocks, np.arange(12), 5, fixed=[gone])


def test_fixed_poses_stay() -> None:
    blocks = PoseRows.of(random_rows(2, 60, 2, 5))
    worst = np.argsort(optimum(blocks).sensitivity)[:3]
    start = greedy(blocks, [int(i) for i in worst], 9)
    assert set(worst) <= set(exchange(blocks, start, fixed=worst))
    assert log_det(blocks, exchange(blocks, start)) > log_det(blocks, exchange(blocks, start, fixed=worst))


def test_same_seed_same_selection() -> None:
    rows = random_rows(7, 200, 3, 12)
    assert select(rows, 15, seed=4).tolist() == select(rows, 15, seed=4).tolist()
    assert select(rows, 15).tolist() == sorted(set(select(rows, 15).tolist()))


def test_units_of_the_parameters_do_not_matter() -> None:
    rows = random_rows(11, 150, 3, 8)
    units = 10.0 ** np.random.default_rng(1).uniform(-5.0, 5.0, 8)
    assert select(rows, 14).tolist() == select(rows * units, 14).tolist()
    several = [np.sort(np.random.default_rng(s).choice(150, 14, replace=False)) for s in range(10)]

    def ranked(scaled: Array) -> list[int]:
        o1 = [observability(scaled[each].reshape(-1, 8), 14).o1 for each in several]
        return np.argsort(o1).tolist()

    assert ranked(rows) == ranked(rows * units)


def test_bound_of_quadratic_regression_is_the_textbook_one() -> None:
    """The bound of quadratic regression puts a third of the weight at -1, 0 and 1.

    The functions are 1, x, x^2 on [-1, 1], and det is 4/27 (Fedorov 1972).
    """
    x = np.linspace(-1.0, 1.0, 201)
    blocks = PoseRows.of(np.stack([np.ones_like(x), x, x**2], axis=1)[:, None, :])
    best = optimum(blocks, 1e-4)
    above = best.log_det + blocks.log_scale - np.log(4.0 / 27.0)
    assert -1e-12 < above <= 3.0 * np.log1p(best.gap)
    assert best.gap < 1e-4
    near = [best.weights[part].sum() for part in (slice(0, 5), slice(96, 105), slice(196, 201))]
    assert near == pytest.approx([1.0 / 3.0] * 3, abs=1e-3)


@settings(max_examples=20, deadline=None)
@given(seed=SEEDS, tolerance=st.sampled_from([1e-4, 0.5]))
def test_no_selection_exceeds_the_bound_however_early_it_stops(seed: int, tolerance: float) -> None:
    rows = random_rows(seed, 80, 2, 6)
    blocks = PoseRows.of(rows)
    best = optimum(blocks, tolerance)
    assert best.weights.sum() == pytest.approx(1.0)
    for count in (4, 10, 40):
        chosen = exchange(blocks, greedy(blocks, [], count))
        assert best.efficiency(log_det(blocks, chosen), count) <= 1.0
    assert best.efficiency(best.log_det + 6 * np.log(10), 10) == pytest.approx(1.0)


def test_indices_follow_their_formulas() -> None:
    turned = np.linalg.qr(random_rows(1, 1, 6, 3)[0])[0]
    o = observability(turned @ np.diag([8.0, 4.0, 2.0]), 4)
    assert (o.o1, o.o2, o.o3) == pytest.approx((2.0, 0.25, 2.0))
    assert (o.o4, o.o5) == pytest.approx((0.5, 1.0 / (1 / 8 + 1 / 4 + 1 / 2)))
    nothing = observability(np.ones((6, 2)), 2)
    assert (nothing.o1, nothing.o5) == (0.0, 0.0)


@pytest.mark.parametrize(
    ("change", "count", "words"),
    [
        (lambda rows: rows, 21, "21 poses are requested from 20 candidates"),
        (lambda rows: rows, 2, "2 poses have 4 rows for 5 parameters"),
        (lambda rows: rows * np.array([1, 1, 0, 1, 1]), 6, "4 of 5 parameters"),
        (lambda rows: np.where(rows > 2.5, np.nan, rows), 6, "not finite"),
        (lambda rows: rows[:2], 2, "determine 0 of 5 parameters"),
        (lambda rows: rows[0], 2, "shape"),
        (lambda rows: rows[:0], 2, "shape"),
    ],
)
def test_bad_input_is_refused(change: object, count: int, words: str) -> None:
    rows = random_rows(0, 20, 2, 5)
    rows[3, 0, 0] = 3.0
    with pytest.raises(DataError, match=words):
        select(change(rows), count)  # type: ignore[operator]
    with pytest.raises(DataError, match="1 rows for 5"):
        observability(np.ones((1, 5)), 1)
