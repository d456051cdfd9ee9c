"""Test the warmth of the arm between watches: thermal updates, and their refusals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib import CalibratedModel, DataError, Dataset, identify
from calib.effects.instrument import drift_translation
from calib.effects.thermal import arm_growth, warm_up
from calib.model import BoundModel, Effect, ModelStructure, effect
from calib.model.regressors import Constant
from calib.saved import as_saved
from calib.units import DEG
from calib.watch import (
    PlannedVisits,
    WhitenedReadings,
    cause_to_update,
    judge,
    keep_up,
    later,
    planned,
    warms_up,
)
from tests.benchmarks.coverage import RANGE, ROBOT, Kind, header_of, simulate

POINTS = Kind("points", 120)
AFTER_S, CONSTANT_S = 3000.0, 1500.0


@pytest.fixture(scope="module")
def cold() -> CalibratedModel:
    """A model without thermal effects."""
    return replace(as_saved(identify(simulate(POINTS, 5).data)), noise_scale=1.0)


@pytest.fixture(scope="module")
def warming(cold: CalibratedModel) -> CalibratedModel:
    """The model with a warm-up of 200 ppm, known to 10."""
    m = len(cold.estimate)
    covariance = np.zeros((m + 1, m + 1))
    covariance[:m, :m], covariance[m, m] = cold.covariance, (10e-6) ** 2
    model = cold.model.append(warm_up(ROBOT, CONSTANT_S))
    return replace(cold, model=model, estimate=np.append(cold.estimate, 200e-6), covariance=covariance)


def measured(
    saved: CalibratedModel,
    change: Effect,
    values: list[float],
    seed: int = 1,
    count: int = 6,
    noise: float = 1.0,
) -> Dataset:
    """Simulate a few poses of two targets from the model with a change, after some time.

    `noise` is a multiple of the declared noise.
    """
    rng = np.random.default_rng(seed)
    joints = rng.uniform(RANGE[:, 0], RANGE[:, 1], (count, ROBOT.joints))
    visits = PlannedVisits.of_points(joints, np.ones_like(joints), np.full(count, 5.0 * DEG), ("T2", "T3"))
    would = later(planned(saved, header_of(POINTS), visits), AFTER_S)
    model = ModelStructure(
        ROBOT,
        (*saved.model.effects, change),
        saved.model.targets,
        saved.model.placements,
        saved.model.station,
    )
    points = BoundModel(model, would.conditions).predict(np.append(saved.estimate, values))
    return replace(
        would, points=points + noise * header_of(POINTS).noise.sigma_mm * rng.normal(size=points.shape)
    )


def test_the_warmth_of_the_day_is_found_with_its_u(warming: CalibratedModel) -> None:
    """Grown by 300 ppm beyond the model, after two time constants, of which 0.865 is there."""
    data = measured(warming, arm_growth(ROBOT), [300e-6])
    found = keep_up(warming, data)
    assert found.model is not None
    (change,) = found.change
    share = 1.0 - np.exp(-np.mean(data.conditions.time) / CONSTANT_S)
    u = 2.0 * float(np.sqrt(found.covariance[0, 0]))
    assert change == pytest.approx(300e-6 / share, abs=1.5 * u)
    assert u < 200e-6
    assert found.model.estimate[-1] == pytest.approx(200e-6 + change)
    np.testing.assert_array_equal(found.model.estimate[:-1], warming.estimate[:-1])  # nothing else
    assert np.linalg.eigvalsh(found.model.covariance).min() > -1e-15
    # the updated model is as sure of the growth as the readings, not as sure as it was on another day
    assert np.sqrt(found.model.covariance[-1, -1]) == pytest.approx(u / 2.0, rel=0.1)
    again = keep_up(found.model, measured(warming, arm_growth(ROBOT), [300e-6], seed=2))
    assert again.rest.kind == "unchanged"


def test_what_is_not_warmth_is_refused_and_nothing_is_written(warming: CalibratedModel) -> None:
    struck = measured(warming, _tool_by(), [1.0])
    found = keep_up(warming, struck)
    assert found.model is None
    assert "tool_shift" in [cause.label for cause, _ in found.rest.causes]


def test_a_model_without_a_thermal_effect_says_which_would_be_needed(cold: CalibratedModel) -> None:
    with pytest.raises(DataError, match="warm_up"):
        keep_up(cold, measured(cold, arm_growth(ROBOT), [800e-6], count=10))
    with pytest.raises(DataError, match="nor do these readings"):
        keep_up(cold, measured(cold, arm_growth(ROBOT), [0.0]))
    assert not warms_up(cold.model)


def test_a_warm_arm_and_a_drift_are_causes_that_pass(cold: CalibratedModel) -> None:
    """A warm arm or a drift is named as such and updates nothing.

    The robot is warm and the baseline cold. The instrument drifts since the watch began, not since the robot was
    cold.
    """
    for change, values, label in (
        (arm_growth(ROBOT), [600e-6], "arm_growth"),
        (drift_translation(AFTER_S), [3.0 / 3600.0, -3.0 / 3600.0, 3.0 / 3600.0], "drift_translation"),
    ):
        moved = measured(cold, change, values, count=14, noise=0.0)
        verdict = judge(WhitenedReadings.of(cold, moved))
        assert label in [cause.label for cause, _ in verdict.causes]
        assert verdict.kind in ("changed", "ambiguous")
        assert "{" not in verdict.in_words + verdict.advice
        with pytest.raises(DataError, match=r"is temporary|different errors"):
            cause_to_update(verdict)


def _tool_by() -> Effect:
    return effect("struck", "frames and tool", "mounting", "", {"x": ("mm", None, [("tool.x", Constant())])})
