"""Test the fit against closed forms, on readings that are plain numbers.

These would catch: a prior that pulls the wrong way or with the wrong weight, a step judged by half of the cost, a
fit that reports convergence too soon or too late, standard errors of another noise.
"""

from __future__ import annotations

import numpy as np
import pytest

from calib.data.spans import Span
from calib.fit.least_squares import (
    MAX_ITERATIONS,
    DroppedParameter,
    FitTermination,
    _back,
    _cost,
    _normal_factor,
    jacobian,
    orthonormal,
    solve,
    triangular_factor,
    usual_sizes,
)
from tests.calib.toy import linear, parameter, toy, toy_model

RNG = np.random.default_rng(5)
MATRIX = RNG.normal(size=(3 * 8, 4))
READ = 5.0 * RNG.normal(size=(3, 8))
START = np.array([1.5, -2.0, 0.7, -1.0])
# b is a ball, 100 mm from another: their distance is measured, and is 103 +- 2 mm
BALLS = {"anchors": {"a": (0.0, 0.0, 0.0), "b": (100.0, 0.0, 0.0)}}
APART = (Span("d1", "a", "b", "", 103.0, 2.0),)


def four(**of):
    """Free, of a usual size, known by measurement, and the place of a ball."""
    sizes = [parameter("free"), parameter("usual", 0.5), parameter("known", 0.25, measured=True)]
    return toy_model([*sizes, parameter("b.x")], **BALLS, **of)


@pytest.mark.parametrize("scale", [0.001, 0.4, 1.0, 3.0])
@pytest.mark.parametrize("weighted", [False, True])
def test_estimate_covariance_and_cost_are_those_of_the_normal_equations(scale: float, weighted: bool) -> None:
    """Estimate, covariance and cost are those of the normal equations.

    A prior scale weakens with the noise down to 1 %; a measurement and a distance never count less than declared.
    """
    start = linear(four(spans=APART), MATRIX, READ, START)
    weights = np.linspace(0.2, 3.0, 8) if weighted else None
    every = np.ones(24) if weights is None else np.tile(weights, 3)
    prior = np.array([0.0, max(scale, 0.01) / 0.5, max(scale, 1.0) / 0.25, 0.0])
    worth = max(scale, 1.0)
    tied = np.array([0.0, 0.0, 0.0, worth / 2.0])
    normal = MATRIX.T @ (every[:, None] * MATRIX) + np.diag(prior**2) + np.outer(tied, tied)
    right = MATRIX.T @ (every * READ.ravel()) + tied * worth * 3.0 / 2.0

    found = solve(start, np.ones(4, dtype=bool), weights=weights, scale=scale)

    assert (found.ending, found.iterations) == (FitTermination.CONVERGED, 2)
    np.testing.assert_allclose(found.estimate, np.linalg.solve(normal, right), rtol=1e-10)
    covariance = np.linalg.inv(normal)
    np.testing.assert_allclose(found.covariance, covariance, rtol=1e-9)
    np.testing.assert_allclose(found.prior, prior)
    np.testing.assert_allclose(found.tied, tied[None])
    by_readings = np.trace(covariance @ MATRIX.T @ (every[:, None] * MATRIX))
    assert found.given == pytest.approx(4.0 - by_readings)
    root = None if weights is None else np.sqrt(weights)
    left = READ.ravel() - MATRIX @ START
    cost = every @ left**2 + np.sum((prior * 0.7 * START) ** 2) + (worth * (3.0 - START[3]) / 2.0) ** 2
    assert _cost(start, root, prior, 0.3 * START, worth) == pytest.approx(cost, rel=1e-12)


def test_the_noise_is_as_declared_where_nothing_is_said() -> None:
    start = linear(four(spans=APART), MATRIX, READ)
    said, unsaid = solve(start, np.ones(4, dtype=bool), scale=1.0), solve(start, np.ones(4, dtype=bool))
    np.testing.assert_array_equal(said.estimate, unsaid.estimate)


def test_parameters_that_are_held_stay_where_they_are() -> None:
    active = np.array([True, False, True, False])
    found = solve(linear(four(), MATRIX, READ, START), active)
    np.testing.assert_array_equal(found.estimate[~active], START[~active])
    own, left = MATRIX[:, active], READ.ravel() - MATRIX[:, ~active] @ START[~active]
    normal = own.T @ own + np.diag([0.0, 16.0])
    np.testing.assert_allclose(found.estimate[active], np.linalg.solve(normal, own.T @ left), rtol=1e-10)
    assert not found.covariance[~active].any()
    assert not found.covariance[:, ~active].any()
    np.testing.assert_array_equal(found.prior, [0.0, 0.0, 4.0, 0.0])


def test_standardised_residuals_reading_by_reading() -> None:
    read = 0.3 * READ
    found = solve(linear(four(), MATRIX, read), np.ones(4, dtype=bool))
    left = read.ravel() - MATRIX @ found.estimate
    lengths = []
    for reading in range(8):
        rows = [reading, 8 + reading, 16 + reading]
        spread = np.eye(3) - MATRIX[rows] @ found.covariance @ MATRIX[rows].T
        lengths.append(np.sqrt(left[rows] @ np.linalg.solve(spread, left[rows])))
    assert min(lengths) < 1.0 < max(lengths)
    np.testing.assert_allclose(found.standardised(), lengths, rtol=1e-9)


def one(read: float, claimed: float, start: float, *, beside: float = 0.0):
    """Build a reading of x itself, whose claimed derivative may be wrong.

    `beside` is a second reading that nothing explains.
    """
    model = toy_model([parameter("x")])
    return toy(
        model,
        np.array([[read, beside]]),
        lambda at: np.array([at[0], 0.0]),
        lambda _at: np.array([[claimed], [0.0]]),
        np.array([start]),
    )


ACTIVE = np.ones(1, dtype=bool)


@pytest.mark.parametrize(
    ("away", "scale", "steps"),
    [
        (0.019, 1.0, 1),
        (0.021, 1.0, 2),
        (0.5, 1.0, 2),
        (0.019, 0.5, 1),
        (0.03, 0.5, 2),
        (0.07, 4.0, 1),
        (0.09, 4.0, 2),
    ],
)
def test_converged_is_a_step_of_two_percent_of_the_standard_error(
    away: float, scale: float, steps: int
) -> None:
    """The fit converges at a step of 2 % of the standard error, for noise as declared or more."""
    found = solve(one(0.0, 1.0, away), ACTIVE, scale=scale)
    assert (found.ending, found.iterations) == (FitTermination.CONVERGED, steps)


def test_a_fit_takes_no_more_steps_than_it_may() -> None:
    """Every step goes a tenth of the way."""
    start = one(0.0, 10.0, 1e6)
    found = solve(start, ACTIVE)
    assert (found.ending, found.iterations) == (FitTermination.ROUNDS, MAX_ITERATIONS)
    assert MAX_ITERATIONS == 50
    assert found.estimate[0] == pytest.approx(1e6 * 0.9**50)
    assert solve(start, ACTIVE, max_iterations=1).estimate[0] == pytest.approx(9e5)


def test_a_step_that_makes_it_worse_is_damped() -> None:
    """A step that increases the error is damped.

    Gauss-Newton on arctan from 2 overshoots to -3.5, where the error is larger; half of the step reduces it.
    """
    start = toy(
        toy_model([parameter("x")]),
        np.array([[0.0, 10.0]]),
        lambda at: np.array([np.arctan(at[0]), 0.0]),
        lambda at: np.array([[1.0 / (1.0 + at[0] ** 2)], [0.0]]),
        np.array([2.0]),
    )
    once = solve(start, ACTIVE, max_iterations=1)
    assert once.estimate[0] == pytest.approx(2.0 - 2.5 * np.arctan(2.0))
    found = solve(start, ACTIVE)
    assert found.ending is FitTermination.CONVERGED
    assert abs(found.estimate[0]) < 1e-3


def test_a_prior_alone_can_make_a_step_worth_while() -> None:
    """The prior alone can justify a step.

    The start fits the readings; the step towards the prior raises their share of the cost.
    """
    model = toy_model([parameter("x", 0.5)])
    found = solve(linear(model, np.ones((1, 1)), np.array([[8.0]]), np.array([8.0])), ACTIVE)
    assert found.ending is FitTermination.CONVERGED
    assert found.estimate[0] == pytest.approx(8.0 / 5.0)


def test_a_step_is_damped_to_a_ten_thousandth_and_no_more() -> None:
    found = solve(one(0.0, 2.0**-11.3, 1.0), ACTIVE, max_iterations=1)
    assert found.estimate[0] == pytest.approx(1.0 - 2.0**11.3 / 10_001)
    stuck = solve(one(0.0, 2.0**-14.3, 1.0), ACTIVE)
    assert (stuck.ending, stuck.estimate[0]) == (FitTermination.NO_DESCENT, 1.0)


def test_a_cost_that_is_the_same_is_no_reason_to_damp() -> None:
    assert solve(one(0.0, 0.5, 3.0), ACTIVE, max_iterations=1).estimate[0] == -3.0


def test_a_step_too_small_to_be_judged_is_taken() -> None:
    """A step too small to be judged is taken, even if it raises the cost.

    The derivative has the wrong sign. The step is small compared with the standard error, or with the rounding of
    the cost.
    """
    small = solve(one(0.0, -1.0, 0.015), ACTIVE)
    assert (small.ending, small.estimate[0]) == (FitTermination.CONVERGED, pytest.approx(0.03))
    drowned = solve(one(0.0, -1.0, 80.0, beside=1e8), ACTIVE, max_iterations=1)
    assert drowned.estimate[0] == pytest.approx(160.0)
    judged = solve(one(0.0, -1.0, 120.0, beside=1e8), ACTIVE, max_iterations=1)
    assert judged.estimate[0] == pytest.approx(120.0 * (1.0 + 1.0 / 11.0))


def test_sizes_of_what_is_dropped_add_to_those_that_stand_in() -> None:
    of = [
        parameter("a", 3.0),
        parameter("b", 2.0),
        parameter("known", 1.0, measured=True),
        parameter("c", 0.5),
    ]
    model = toy_model([*of, parameter("gone", 2.0), parameter("free")])
    gone = DroppedParameter("gone", ("a",), (("a", 2.0), ("known", 5.0), ("c", 1.0)))
    free = DroppedParameter("free", ("b",), (("b", 0.0),))
    np.testing.assert_allclose(
        usual_sizes(model, [gone, free]), [5.0, 2.0, 1.0, np.sqrt(0.25 + 4.0), 2.0, np.inf]
    )
    np.testing.assert_array_equal(model.prior_std, [3.0, 2.0, 1.0, 0.5, 2.0, np.inf])


def test_factors() -> None:
    tall, wide = RNG.normal(size=(7, 3)), RNG.normal(size=(2, 5))
    for matrix in (tall, wide):
        r = triangular_factor(matrix)
        assert r.shape == (min(matrix.shape), matrix.shape[1])
        np.testing.assert_allclose(r.T @ r, matrix.T @ matrix, atol=1e-12)
        assert not np.tril(r, -1).any()
    dependent = np.column_stack([tall, tall[:, 0]])
    for matrix in (tall, dependent):
        q, r = orthonormal(matrix)
        np.testing.assert_allclose(q @ r, matrix, atol=1e-7)
    np.testing.assert_allclose(orthonormal(tall)[0].T @ orthonormal(tall)[0], np.eye(3), atol=1e-12)


def test_a_gram_matrix_that_rounding_made_indefinite_is_made_again() -> None:
    tied, prior, size = RNG.normal(size=(2, 3)), np.array([0.0, 2.0, 3.0]), np.array([2.0, 5.0, 0.3])
    columns = RNG.normal(size=(6, 3))
    wanted = (columns.T @ columns + tied.T @ tied + np.diag(prior**2)) / (size[:, None] * size)
    for gram in (-np.eye(3), wanted):
        r = _normal_factor(gram, columns, tied, prior, size)
        np.testing.assert_allclose(r.T @ r, wanted, rtol=1e-10)


def test_triangles_are_solved_both_ways_or_refused() -> None:
    r, right = np.triu(RNG.normal(size=(4, 4))) + 3.0 * np.eye(4), RNG.normal(size=4)
    np.testing.assert_allclose(r @ _back(r, right), right)
    np.testing.assert_allclose(r.T @ _back(r, right, 1), right)
    r[2, 2] = 0.0
    with pytest.raises(np.linalg.LinAlgError, match="singular"):
        _back(r, right)


def test_derivatives_are_whitened_by_visit_where_readings_share_a_noise() -> None:
    start = linear(four(), MATRIX, READ)
    seen = []

    def by_visit(of):  # (m, k, n): turned about, so that an axis that is mistaken shows
        seen.append(of.shape)
        return 2.0 * of

    vars(start.observed).update(shared=object(), whiten=np.zeros((3, 3, 8)), by_visit=by_visit)
    np.testing.assert_array_equal(jacobian(start.design, start.observed, start.frames), 2.0 * MATRIX)
    assert seen == [(4, 3, 8)]
