"""Test models with carried terms in all their uses.

These would catch: a term that jumps at the border of the measured range or is used without a driver, a U that does
not grow there, and a watch that reports a term as a change.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib import CalibratedModel, DataError, Dataset, identify, load_model, save_model
from calib.compensate import Bounds, correct, refuse_unlikely
from calib.fit import IdentificationFit, radius_95
from calib.fit.identification import expanded, predict_with_covariance
from calib.model import BoundModel, conditions_at, named_only
from calib.model.carried_regressors import Held, HeldPair
from calib.prior.type_statistics import TypeMember
from calib.saved.document import FORMAT, WITH_CARRIED
from calib.units import DEG, to_internal
from calib.validation import differences
from calib.watch import WhitenedReadings, judge
from tests.calib.campaigns import simulate
from tests.calib.carrying import carried, carrying, fit_with

SIZES = {"carried:theta4:angle:1": 0.05, "carried:d5:time:2": 0.3}  # deg, mm


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    return simulate(tmp_path_factory.mktemp("data"), seed=53, n=160, n_validation=40, effects=[])[1]


@pytest.fixture(scope="module")
def moved(data: Dataset) -> tuple[Dataset, IdentificationFit]:
    return carrying(data)


@pytest.fixture(scope="module")
def saved(
    moved: tuple[Dataset, IdentificationFit], tmp_path_factory: pytest.TempPathFactory
) -> CalibratedModel:
    path = tmp_path_factory.mktemp("model") / "model.json"
    save_model(path, moved[1])
    return load_model(path)


def test_a_file_holds_carried_terms_with_covariance_and_range(
    moved: tuple[Dataset, IdentificationFit], saved: CalibratedModel
) -> None:
    dataset, fitted = moved
    for label, truth in SIZES.items():
        place = saved.model.index[f"{label}.size"]
        off = abs(saved.estimate[place] / saved.model.unit[place] - truth)
        assert off < 4.0 * np.sqrt(saved.covariance[place, place]) / saved.model.unit[place] < 0.2 * truth
    assert saved.model.effects == fitted.model.effects
    np.testing.assert_allclose(saved.covariance, fitted.covariance, rtol=1e-9)
    predicted = BoundModel(saved.model, dataset.conditions).predict(saved.estimate)
    np.testing.assert_allclose(predicted, fitted.predict(dataset.conditions), atol=1e-9)


def test_older_programs_and_fleet_servers_refuse_the_format(
    data: Dataset, moved: tuple[Dataset, IdentificationFit], tmp_path: Path
) -> None:
    """Older programs and fleet servers refuse the format of a model with carried terms.

    Both compare the format: `load_model` before this change took `truepose-model/1` alone, and so did `rows_of` of
    a fleet server, which reads no effects. A model without carried terms is still of that format.
    """
    for fitted, wanted in ((identify(data), FORMAT), (moved[1], WITH_CARRIED)):
        save_model(tmp_path / "model.json", fitted)
        assert json.loads((tmp_path / "model.json").read_text("utf-8"))["format"] == wanted
    assert FORMAT == "truepose-model/1" != WITH_CARRIED


@pytest.mark.parametrize(
    ("effect", "change"),
    [
        (0, {"quantity": "moon"}),
        (0, {"quantity": "air"}),
        (0, {"law": "square"}),
        (0, {"joint": 0}),
        (0, {"joint": 7}),
        (0, {"low": 9.0}),
        (0, {"rate": "fast"}),
        (1, {"clock": "calendar"}),
        (1, {"times": [0.0, 2.0, 1.0, 3.0]}),
        (1, {"values": [0.0, 1.0]}),
        (1, {"values": [0.0, None, 1.0, 1.0]}),
        (2, {"other": 9}),
        (2, {"other_low": 5.0}),
    ],
)
def test_damaged_regressors_are_refused(
    effect: int, change: dict[str, object], moved: tuple[Dataset, IdentificationFit], tmp_path: Path
) -> None:
    pair = carried("carried:theta2:pair:3", "deg", HeldPair(2, 3, "sine", 1.0, -1.0, -1.0, 1.0, -0.5, 0.5))
    dataset, fitted = moved
    path = tmp_path / "model.json"
    save_model(path, fit_with(dataset, fitted, fitted.model.append(pair)))
    document = json.loads(path.read_text("utf-8"))
    del document["content_sha256"]
    load_model(_written(path, document))
    own = [e for e in document["effects"] if e["group"] == "carried"][effect]
    own["terms"][0]["regressor"] |= change
    with pytest.raises(DataError, match="carried:"):
        load_model(_written(path, document))


def _written(path: Path, document: dict[str, object]) -> Path:
    path.write_text(json.dumps(document), encoding="utf-8")
    return path


def test_without_carried_terms_the_rest_is_as_a_new_fit(moved: tuple[Dataset, IdentificationFit]) -> None:
    dataset, fitted = moved
    model, estimate, covariance = named_only(fitted.model, fitted.estimate, fitted.covariance)
    fresh = fit_with(dataset, fitted, model)
    spread = np.sqrt(np.maximum(np.diag(fresh.covariance), 1e-30))
    assert model.effects == fresh.model.effects
    assert covariance.shape == (len(estimate),) * 2
    # the fit is robust and weighs rows anew, so the agreement is to a part of the standard errors
    assert np.median(np.abs(estimate - fresh.estimate) / spread) < 0.2


def test_radius_contains_95_percent() -> None:
    rng = np.random.default_rng(3)
    for variances in ((1.0, 1.0, 1.0), (0.0, 0.0, 1.0), (0.0, 0.9, 1.0), (1e-3, 0.3, 1.0), (0.3, 0.6, 1.0)):
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        covariance = 4e-4 * turn @ np.diag(variances) @ turn.T
        points = rng.normal(size=(200_000, 3)) * np.sqrt(4e-4 * np.array(variances))
        inside = np.mean(np.linalg.norm(points, axis=1) <= radius_95(covariance[None])[0])
        assert inside == pytest.approx(0.95, abs=0.003)
    assert radius_95(np.zeros((2, 3, 3))).tolist() == [0.0, 0.0]
    # k = 2 along the worst direction contains less, if the spread is a sphere
    assert expanded(np.eye(3)[None])[0] < 0.8 * radius_95(np.eye(3)[None])[0]


def test_radius_of_uneven_spreads_is_exact() -> None:
    """The chi-square distribution from which it is sought is off by up to 1 % of the radius there."""
    rng = np.random.default_rng(5)
    squares = rng.chisquare(1.0, size=(3, 2_000_000))
    for variances in ((0.0, 0.05, 1.0), (0.02, 0.2, 1.0), (0.1, 0.1, 1.0), (0.3, 1.0, 1.0)):
        drawn = np.quantile(np.array(variances) @ squares, 0.95) ** 0.5
        assert radius_95(np.diag(variances)[None])[0] == pytest.approx(drawn, rel=1.5e-3)


def test_u_grows_beyond_the_measured_range_and_not_within(saved: CalibratedModel) -> None:
    model = saved.model
    regressor = model.effects[-2].terms[0].regressor
    assert isinstance(regressor, Held)
    width = regressor.high - regressor.low
    joints = np.tile(np.radians([10.0, -20.0, 0.0, 15.0, 40.0, 5.0]), (5, 1))
    joints[:, 2] = regressor.high + width * np.array([-0.2, 0.0, 0.05, 0.25, 0.5])
    conditions = conditions_at(model, joints, replace(saved.usual, time_s=1.0, temperature_c=21.0), "")
    where = replace(conditions, target=np.ones(5, dtype=np.int64))
    np.testing.assert_allclose(model.beyond(where)["joint 3"], [0.0, 0.0, 0.05, 0.25, 0.5], atol=1e-9)
    free = replace(model, effects=tuple(e for e in model.effects if e.label != "carried:theta4:angle:1"))
    assert "joint 3" not in free.beyond(where)
    points, spread = predict_with_covariance(model, saved.estimate, saved.covariance, where)
    u = radius_95(spread)
    assert abs(u[1] / u[0] - 1.0) < 0.5
    assert u[2] < u[3]
    assert u[3] > 2.0 * u[1]
    # the term itself keeps its value
    drive = regressor.evaluate(where)
    assert np.ptp(drive[1:]) == 0.0
    assert np.all(np.isfinite(points))


def test_corrections_leave_out_what_only_the_campaign_knew(saved: CalibratedModel) -> None:
    used, part = saved.for_use()
    assert [e.label for e in part.left_out] == ["carried:d5:time:2"]
    assert part.loss is not None
    # the mean of d5 over the campaign stays: a third of the readings are before the step of 0.3 mm
    assert 0.05 < part.loss.rms < 0.3
    assert [e.label for e in used.model.effects if e.is_carried] == ["carried:theta4:angle:1"]
    named, less = saved.for_use(named_only=True)
    assert len(less.left_out) == 2
    assert not any(e.is_carried for e in named.model.effects)
    whole, _ = as_saved_without(saved).for_use()
    assert whole.notes == as_saved_without(saved).notes

    regressor = saved.model.effects[-2].terms[0].regressor
    assert isinstance(regressor, Held)
    joints = np.tile(np.radians([10.0, -20.0, 0.0, 15.0, 40.0, 5.0]), (3, 1))
    joints[:, 2] = regressor.high + np.array([-2e-3, 2e-3, 0.1])
    done = [correct(m.model, m.estimate, joints, saved.usual) for m in (used, named)]
    assert all(each.good.all() for each in done)
    assert done[0].beyond == ((), ("joint 3",), ("joint 3",))
    assert done[1].beyond == ((), (), ())
    assert "joint 3" in done[0].notes[2]
    apart = done[0].joints - done[1].joints
    assert np.abs(apart[1] - apart[0]).max() < 1e-5  # no jump at the border
    assert np.abs(done[0].joints - done[1].joints).max() > 0.01 * DEG


def as_saved_without(saved: CalibratedModel) -> CalibratedModel:
    model, estimate, covariance = named_only(saved.model, saved.estimate, saved.covariance)
    return replace(
        saved, model=model, estimate=estimate, covariance=covariance, held_std=None, left_open=None
    )


def test_the_whole_model_corrects_without_a_time(saved: CalibratedModel) -> None:
    """The whole model corrects without a time even if the terms are not removed first."""
    joints = np.radians([[10.0, -20.0, 0.0, 15.0, 40.0, 5.0]])
    assert correct(saved.model, saved.estimate, joints, saved.usual).good.all()


def test_bounds_hold_for_the_sum_of_named_and_carried(saved: CalibratedModel) -> None:
    bounds = Bounds(turn_deg=0.5, shift_mm=15.0)
    effect = carried("carried:theta4:air:9", "deg", Held("angle", 1, "linear", 0.0, -1.0, -3.0, 3.0))
    shift = carried("carried:theta4:side:8", "deg", Held("angle", 1, "cosine", 0.0, 0.0, -3.0, 3.0))
    model = saved.model.append(effect, shift)
    one = np.r_[saved.estimate, 0.0, to_internal(0.4, "deg")]
    with pytest.raises(DataError, match="carried:theta4"):
        refuse_unlikely(model, 2.0 * one, saved.usual, bounds)


def test_a_watch_after_calibration_is_quiet(
    moved: tuple[Dataset, IdentificationFit], saved: CalibratedModel
) -> None:
    """A repeated second half of the campaign, on a separate clock, shows no change."""
    dataset, _ = moved
    rows = np.flatnonzero(dataset.usable)[-40:]
    conditions = dataset.conditions
    time = conditions.time.copy()
    time[rows] -= time[rows].min()
    for clock in (time, np.full_like(time, np.nan)):
        sets = np.where(np.isin(np.arange(len(dataset)), rows), "calibration", "validation")
        later = replace(dataset, conditions=replace(conditions, time=clock), sets=sets)
        assert judge(WhitenedReadings.of(saved, later)).kind == "unchanged"
    # without the carried step the same readings are a change
    named = as_saved_without(saved)
    later = replace(later, conditions=replace(conditions, time=time))
    assert np.sum(WhitenedReadings.of(named, later).residual ** 2) > 1.5 * np.sum(
        WhitenedReadings.of(saved, later).residual ** 2
    )


def test_labels_of_carried_terms_are_compared_nowhere(saved: CalibratedModel) -> None:
    assert not [d.name for d in differences(saved, saved) if d.name.startswith("carried")]
    member = TypeMember(Path("model.json"), "", saved)
    assert not any(name.startswith("carried") for name in member.own)
