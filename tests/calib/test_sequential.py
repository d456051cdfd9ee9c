"""Sequential selection: gains against their definition, and misses and limits against their distributions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from acquisition.campaign.blocks.adaptive import seen_by, unmeasured, visits_of
from calib.array import Array
from calib.data import Noise
from calib.fit import identify
from calib.model import BoundModel, ModelStructure, StatedConditions, base_model, conditions_of
from calib.model.observations import Observations
from calib.selection import DECIDING, LEVEL, Design, bound, least_bound, misses, model_limit, zone_of
from tests.benchmarks.adaptive import Arm
from tests.benchmarks.adaptive_ballbar import BallbarArm


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


@pytest.mark.parametrize("level", [LEVEL, DECIDING])
def test_the_limit_of_a_model_holds_for_models_that_scatter_as_their_covariance_says(level: float) -> None:
    design, rng = a_design(3), np.random.default_rng(2)
    errors = rng.multivariate_normal(np.zeros(5), design.covariance, size=20_000)
    square = np.einsum("ni,ij,nj->n", errors, design.spread, errors)
    assert np.mean(square) == pytest.approx(design.variance, rel=0.03)
    limit = model_limit(design.spread, design.covariance, level)
    assert np.mean(square <= limit) == pytest.approx(level, abs=0.3 * (1.0 - level))


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
        rows = arm.readings(range(50))
        for row in rows[90:]:
            row["set"] = "validation"
        del rows[91::6]  # one reading of every second visit that is held out
        dataset = arm.dataset(rows)
        found = misses(identify(dataset), dataset, dataset.validation_rows)
        assert len(set(found.reading)) == 20
        assert sorted(set(found.numbers.tolist())) == [6, 9]
        probabilities += stats.chi2.sf(found.square, found.numbers).tolist()
    assert stats.kstest(probabilities, "uniform").pvalue > 0.01


def test_the_error_of_positions_found_by_lengths_does_not_count_where_the_cups_stand() -> None:
    """Cups that are known to 5 mm, with base and cups turned and shifted together: nothing in the zone is wrong."""
    robot = Arm("abb-irb120", 1).cell.robot.model
    cups = {"B1": (486.6, 50.0, -100.0), "B2": (313.4, 150.0, -100.0), "B3": (400.0, -100.0, -100.0)}
    tool = {"T1": (0.0, 86.6, 100.0), "T2": (-75.0, -43.3, 100.0)}
    effects = base_model.build(
        ["base", "geometry"], robot, ["main"], [dict.fromkeys(tool, False)], dict.fromkeys(cups, 5.0)
    )
    model = ModelStructure(robot, effects, {"main": tool}, anchors=cups)
    rng = np.random.default_rng(1)
    joints = rng.uniform(-0.5, 0.5, (20, 6))
    asked = conditions_of(model, joints, joints - 0.1, StatedConditions(), ["T1", "T2"] * 10)
    zone = zone_of(model, np.zeros(len(model.parameters)), asked, Noise("isotropic"))
    together = np.zeros(len(model.parameters))
    together[model.of_base] = [0.3, -0.2, 0.5, 1e-4, -2e-4, 3e-4]
    alone = together.copy()
    bound_model = BoundModel(model, asked)
    points = bound_model.predict(0.0 * together)
    shift, turn = _motion(points, bound_model.predict(1e-3 * together) - points)
    for name, place in cups.items():
        together[[model.index[f"{name}.{axis}"] for axis in "xyz"]] = 1e3 * (shift + np.cross(turn, place))
    assert together @ zone.spread @ together == pytest.approx(0.0, abs=1e-6)
    assert alone @ zone.spread @ alone > 0.1


def _motion(points: Array, moved: Array) -> tuple[Array, Array]:
    """Return the small shift and turn that move points (n, 3) so."""
    sides = [np.cross(axis, points).ravel() for axis in np.eye(3)]
    shifts = [np.tile(axis, len(points)) for axis in np.eye(3)]
    found = np.asarray(np.linalg.lstsq(np.column_stack([*shifts, *sides]), moved.ravel())[0], np.float64)
    return found[:3], found[3:]


def test_legs_of_one_visit_share_where_the_arm_came_to_rest() -> None:
    """Their whitened rows hold as much information as their covariance says."""
    arm = BallbarArm(1)
    model, noise = unmeasured(arm.site)
    few = replace(arm.pool, candidates=arm.pool.candidates[:3], legs=arm.pool.legs[:3])
    estimate, stated = np.zeros(len(model.parameters)), StatedConditions(loads=arm.cell.loads)
    rows, _ = seen_by(arm.site, few, model, estimate, stated, noise)
    legs = visits_of(arm.site, few.candidates, model, stated, few.legs)
    design, robot = BoundModel(model, legs), model.robot
    frames = design.frames(estimate, (*design.slots, *robot.joint_slots))
    nothing, one = np.zeros(len(legs)), np.ones((1, 1, len(legs)))
    plain = Observations(None, None, nothing, one, np.ones(len(legs), dtype=np.int64))
    columns = design.columns(plain.columns(frames, design.slots)).reshape(3, 6, -1)
    by_joint = plain.columns(frames, robot.joint_slots)[:, 0].T.reshape(3, 6, -1) * noise.repeatability
    covariance = by_joint @ by_joint.transpose(0, 2, 1) + noise.length_mm**2 * np.eye(6)
    wanted = columns.transpose(0, 2, 1) @ np.linalg.solve(covariance, columns)
    np.testing.assert_allclose(
        rows.transpose(0, 2, 1) @ rows, wanted, rtol=1e-6, atol=1e-6 * np.abs(wanted).max()
    )
