"""Sequential selection: gains against their definition, and misses and limits against their distributions."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from calib.fit import identify
from calib.selection import DECIDING, LEVEL, Design, bound, least_bound, misses
from tests.benchmarks.adaptive import Arm


def a_design(seed: int, candidates: int = 12, rows: int = 6, parameters: int = 5) -> Design:
    rng = np.random.default_rng(seed)
    root, zone = rng.normal(size=(2, parameters, parameters))
    return Design(
        rng.normal(size=(candidates, rows, parameters)), zone @ zone.T, root @ root.T + np.eye(parameters)
    )


@given(st.integers(0, 10_000), st.integers(0, 11))
def test_a_gain_is_the_fall_of_the_variance(seed: int, pose: int) -> None:
    design = a_design(seed)
    later = design.with_pose(pose)
    information = np.linalg.inv(design.covariance) + design.rows[pose].T @ design.rows[pose]
    assert later.covariance == pytest.approx(np.linalg.inv(information), abs=1e-8)
    assert design.gains[pose] == pytest.approx(design.variance - later.variance, rel=1e-6)


@given(st.integers(0, 10_000))
def test_the_first_of_the_best_gains_most_and_none_is_taken_twice(seed: int) -> None:
    design = a_design(seed)
    chosen, later = design.best(11, taken=[3])
    assert sorted([3, *chosen]) == list(range(12))
    others = np.delete(design.gains, 3)
    assert design.gains[chosen[0]] == others.max()
    assert later.variance < design.variance


def test_the_limit_holds_as_often_as_it_says() -> None:
    """For misses that follow their distribution, the expected error is the true one times their scale."""
    rng = np.random.default_rng(1)
    numbers = np.full(15, 9)
    true = 1.7  # times what is expected
    square = true**2 * rng.chisquare(9, size=(4000, 15))
    limits = np.array([bound(0.05, each, numbers)[1] for each in square])
    assert np.mean(limits >= true * 0.05) == pytest.approx(0.95, abs=0.012)
    middle = np.median([bound(0.05, each, numbers)[0] for each in square])
    assert middle == pytest.approx(true * 0.05, rel=0.01)


@pytest.mark.parametrize(("level", "least", "most"), [(LEVEL, 0.15, 0.3), (DECIDING, 0.03, 0.075)])
def test_repeated_looks_deceive_seldom_at_the_level_that_decides(
    level: float, least: float, most: float
) -> None:
    """The share of campaigns in which one of 16 looks, after five visits each, has a limit below the true error."""
    square = np.random.default_rng(2).chisquare(9, size=(500, 80))
    numbers = np.full(80, 9)
    true = 1.2
    deceived = [
        any(bound(1.0, true**2 * each[:k], numbers[:k], level)[1] < true for k in range(5, 81, 5))
        for each in square
    ]
    assert least < np.mean(deceived) < most


def test_misses_below_the_expected_promise_no_less_than_is_expected() -> None:
    numbers = np.full(15, 9)
    assert bound(0.05, np.full(15, 0.1), numbers) == (0.05, 0.05)
    assert least_bound(0.05, 135) == pytest.approx(0.05 * np.sqrt(135 / stats.chi2.ppf(0.05, 135)))
    assert bound(0.05, 9.0 * np.ones(15), numbers)[1] == pytest.approx(least_bound(0.05, 135))


def test_misses_of_a_true_model_follow_chi_square_whatever_a_visit_holds() -> None:
    """Held-out visits of two and three readings: their misses, each on its own numbers, scatter as they should."""
    probabilities: list[float] = []
    for seed in range(1, 7):
        arm = Arm("abb-irb120", seed)
        rows = arm.readings(arm.pool.candidates[:50])
        for row in rows[90:]:
            row["set"] = "validation"
        del rows[91::6]  # one reading of every second visit that is held out
        dataset = arm.dataset(rows)
        found = misses(identify(dataset), dataset, dataset.validation_rows)
        assert len(set(found.reading)) == 20
        assert sorted(set(found.numbers.tolist())) == [6, 9]
        probabilities += stats.chi2.sf(found.square, found.numbers).tolist()
    assert stats.kstest(probabilities, "uniform").pvalue > 0.01
