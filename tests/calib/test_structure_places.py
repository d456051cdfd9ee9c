"""Test structure that no driver of the arm shows.

These would catch: an error of each pose reported as noise, targets of one visit counted as independent, and noise
that continues from one reading to the next. They would also catch a law that hides in the left-out readings, and an
effect claimed although left-out blocks lose by it.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy import stats

from calib.array import Array
from calib.diagnose import diagnosis
from calib.diagnose.diagnosis import Blocks
from calib.diagnose.structure import ACTS_ON, EACH_POSE, draws, each_pose, left_over, p_lack_of_fit, together
from calib.fit.identify import identify
from calib.scan.scores import Space
from mocks.campaign import DEFAULT_FIT, Campaign
from mocks.world import Session, World, scaled, stream
from mocks.world.dataset import header_of, row_of
from tests.benchmarks.diagnosis_complete import campaign as complete_campaign
from tests.benchmarks.diagnosis_foreign import campaign as foreign_campaign
from tests.benchmarks.diagnosis_sets import load, visits
from tests.benchmarks.foreign_laws import LAWS


def a_space(n: int, each: int, at_once: int, seed: int = 2, *, declared: bool = True) -> Space:
    """Fit the base model to repeated visits.

    Each pose has `each` visits with `at_once` targets. The repeatability of the robot is stated if `declared`.
    """
    world = World("abb-irb120", seed, session=Session(n + 30))
    sets, readings = visits(world, n, 0, each, at_once, "varied", stream(seed, 1))
    rows = [row_of(world, i, s, reading) for i, (s, reading) in enumerate(zip(sets, readings, strict=True))]
    header = header_of(world, 1.0, list(DEFAULT_FIT))
    if not declared:
        del header["noise"]["repeatability_deg"]
    return Space.of(identify(load(Campaign(rows, header, {}, world, readings))))


def with_residual(space: Space, errors: Array) -> Space:
    """Return the space as if the readings had the whitened errors (k, n)."""
    basis = space.basis_of_readings
    left = errors.ravel() - basis @ (basis.T @ errors.ravel())
    return replace(space, residual=left.reshape(errors.shape))


@pytest.fixture(scope="module")
def visited() -> Space:
    return a_space(200, 5, 1)


@pytest.fixture(scope="module")
def single() -> Space:
    return a_space(200, 1, 1)


@pytest.fixture(scope="module")
def at_once() -> Space:
    return a_space(150, 2, 3, declared=False)


def test_an_error_of_each_pose_is_a_place_of_its_own(visited: Space) -> None:
    rng = np.random.default_rng(1)
    k, n = visited.residual.shape
    pose = visited.fitted.readings.conditions.pose
    own = 1.5 * rng.normal(size=(k, pose.max() + 1))[:, pose] + rng.normal(size=(k, n))
    (found,) = each_pose(with_residual(visited, own))
    assert found.where == EACH_POSE
    assert found.p_value < 1e-12
    assert found.explained_variance == pytest.approx(0.6, abs=0.15)
    for _ in range(20):
        assert each_pose(with_residual(visited, 3.0 * rng.normal(size=(k, n)))) == [], "noise of any size"


def test_draws_share_between_poses_what_noise_does(visited: Space) -> None:
    """Draws lose as much between poses as the data does.

    With forty poses, the fit hides a third of the error of each pose, in the data and in its draws. When this
    loss was removed on one side only, the data had more between poses than any draw, and complete sets had structure.
    """
    rng = np.random.default_rng(6)
    k, n = visited.residual.shape
    pose = visited.fitted.readings.conditions.pose
    own = np.bincount(pose)
    ratios = []
    for _ in range(20):
        drawn = draws(with_residual(visited, rng.normal(size=(k, n))), clipped=True).reshape(k, n, -1)
        means = np.stack([drawn[:, pose == p].sum(axis=1) for p in range(len(own))], axis=1)
        between = np.sum(means**2 / own[:, None], axis=(0, 1)) / np.sum(drawn**2, axis=(0, 1))
        ratios.append(between[0] / np.mean(between[1:]))
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.06)


def test_targets_of_one_visit_are_not_independent(at_once: Space) -> None:
    """An undeclared error that the three targets of a visit share is no lack of fit.

    It is no error of the pose either.
    """
    conditions = at_once.fitted.readings.conditions
    visit = np.unique(conditions.visit, return_inverse=True)[1]
    assert np.bincount(visit).tolist() == [3] * 50
    assert len(np.unique(conditions.pose)) == 25
    rng = np.random.default_rng(3)
    drawn = [with_residual(at_once, rng.normal(size=(3, 50))[:, visit]) for _ in range(60)]
    assert not any(each_pose(left) for left in drawn)
    # as much as independent readings leave once in 10,000 sets is nothing rare where three readings are one try
    square = stats.chi2.isf(1e-4, at_once.freedom)
    larger = drawn[0].residual * np.sqrt(square / np.sum(drawn[0].residual ** 2))
    assert 0.005 < p_lack_of_fit(replace(at_once, residual=larger)) < 0.1


def test_noise_that_a_reading_has_from_the_one_before_is_structure_in_time(visited: Space) -> None:
    rng = np.random.default_rng(5)
    k, n = visited.residual.shape
    errors = rng.normal(size=(k, n))
    order = np.argsort(visited.fitted.readings.conditions.order)
    for before, after in pairwise(order):
        errors[:, after] = 0.8 * errors[:, before] + 0.6 * errors[:, after]
    found = left_over(with_residual(visited, errors))
    assert [s.where for s in found][:1] == ["time, from one reading to the next"]


def test_readings_left_out_that_lie_together_are_structure(single: Space) -> None:
    conditions = single.fitted.readings.conditions
    pose = conditions.pose
    moment = np.bincount(pose, conditions.overturning[:, 0]) / np.bincount(pose)
    heaviest = np.isin(pose, np.argsort(-moment)[:10])
    found = together(single, heaviest)
    assert found
    assert {s.acts_on for s in found} == {ACTS_ON}
    rng = np.random.default_rng(8)
    anywhere = [np.isin(pose, rng.permutation(pose.max() + 1)[:10]) for _ in range(30)]
    assert sum(bool(together(single, out)) for out in anywhere) <= 1
    assert together(single, np.zeros(len(pose), dtype=bool)) == []


def test_a_law_that_hides_in_the_readings_left_out_is_not_complete() -> None:
    """A floor that yields under the largest moments only is not reported as complete.

    28 of 1,000 readings are left out, and all others fit.
    """
    result = diagnosis.diagnose(load(foreign_campaign("weak_floor", 400, 120_000)))
    assert len(result.final.faulty_rows) >= 4
    assert result.p_lack_of_fit > 1e-3
    assert result.verdict == "unexplained"
    assert any(s.acts_on == ACTS_ON for s in result.structure)


def test_blocks_that_are_dealt_part_no_pose(visited: Space, single: Space) -> None:
    blocks = Blocks.random_blocks(visited)
    pose = visited.fitted.readings.conditions.pose
    assert all(len(set(blocks.of_reading[pose == p].tolist())) == 1 for p in range(pose.max() + 1))
    assert np.bincount(blocks.of_reading).min() >= 15
    in_time = Blocks.random_blocks(single).of_reading[np.argsort(single.fitted.readings.conditions.order)]
    assert len(set(in_time[-12:].tolist())) >= 2, "no block has all of the end"


def test_an_effect_that_left_out_blocks_lose_by_is_not_claimed(monkeypatch: pytest.MonkeyPatch) -> None:
    campaign = foreign_campaign("gap_by_load", 150, 120_000)
    campaign.world.effects = [
        scaled(campaign.world, campaign.world.draw_effect("backlash:j4"), campaign.readings, 3.0)
    ]
    rows = [
        row_of(campaign.world, i, "calibration", reading) for i, reading in enumerate(campaign.readings[:150])
    ]
    data = load(replace(campaign, rows=rows))
    assert [f.effect.label for f in diagnosis.diagnose(data).effects] == ["backlash:j4"]
    monkeypatch.setattr(
        diagnosis, "carried_gains", lambda space, effects, blocks: -np.ones((len(effects), blocks.count))
    )
    assert diagnosis.diagnose(data).effects == ()


@pytest.mark.parametrize("seed", [130_000, 130_005])
def test_six_poses_visited_five_times_fit(seed: int) -> None:
    """Six poses visited five times fit to the noise.

    They have fewer numbers than the model has parameters. Dropped parameters once stayed at nominal, ten times off.
    """
    data = load(complete_campaign("5 visits a pose", 30, seed))
    found = identify(data)
    assert found.converged
    assert 0.8 < found.noise_scale < 1.2
    assert found.degrees_of_freedom == pytest.approx(90 - 18, abs=2)


def test_twenty_laws_are_foreign() -> None:
    """Each law moves its stated part, and none is in the simulator's catalogue."""
    assert len(LAWS) == 20
    world = World("abb-irb120", 5, session=Session(40))
    _, readings = visits(world, 24, 6, 2, 1, "varied", stream(5, 1))
    for make, places in LAWS.values():
        law = make(world, np.random.default_rng(3))
        assert places
        assert list(scaled(world, law, readings, 3.0).amplitudes) == ["a"]
