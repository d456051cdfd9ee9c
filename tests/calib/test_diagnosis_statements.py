"""Test the statements of a diagnosis about its findings.

These would catch: a moment of change that is dated inside held-out rows, an amplitude that is more certain than its
time constant allows, and advice that varies another quantity than the one concerned. They would also catch noise
declared too large without a remark, and warnings of numpy for residuals that are mostly zero.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from calib import DataError, Dataset, identify, read_dataset
from calib.array import Array
from calib.data import plausible
from calib.data.hypotheses import Explanation
from calib.diagnose import DiagnosedEffect, diagnose, next_measurements
from calib.diagnose.follow_up import remarks_of
from calib.diagnose.found import visible, with_shapes
from calib.diagnose.select import EffectEvidence, refit
from calib.diagnose.structure import ACTS_ON, EACH_POSE, drivers, left_over, log_p_of
from calib.effects import Survey, offers
from calib.effects.elasticity import joint_compliance
from calib.effects.thermal import TIME_CONSTANT, warm_up
from calib.effects.transmission import periodic
from calib.model import Effect
from calib.scan import Scores, Space
from calib.units import to_internal
from mocks.campaign import make_campaign
from tests.calib.campaigns import exact, simulate, write_files

EVIDENCE = EffectEvidence({"x": 1.0}, {}, 10.0, 1e-9, 0.5)


def found_of(effect: Effect, values: list[float], std: list[float]) -> DiagnosedEffect:
    """A finding with these values and standard errors in the units of its parameters."""
    units = [p.unit for p in effect.parameters]
    value = np.array([to_internal(v, u) for v, u in zip(values, units, strict=True)])
    spread = np.array([to_internal(s, u) for s, u in zip(std, units, strict=True)])
    return DiagnosedEffect(effect, EVIDENCE, value, np.diag(spread**2), None)


def test_a_finding_knows_whether_it_is_confirmed_usual_and_possible() -> None:
    soft = joint_compliance(3)
    assert found_of(soft, [2.0], [0.9]).confirmed
    assert not found_of(soft, [2.0], [1.1]).confirmed
    assert found_of(soft, [2.0], [0.1]).beyond_usual
    assert not found_of(soft, [0.5], [0.1]).beyond_usual
    assert found_of(soft, [-0.5], [0.1]).impossible
    assert not found_of(soft, [0.5], [0.1]).impossible
    wave = found_of(periodic(2, 3.0), [0.06, 0.08], [0.01, 0.01])
    assert wave.usual == pytest.approx(np.hypot(0.1, 0.1))
    assert not wave.beyond_usual


def held_out(data: Dataset, first: int, last: int) -> Dataset:
    """The data set with the readings of ranks first to last in the validation set."""
    order = data.conditions.order
    return replace(
        data,
        sets=np.where((order >= first) & (order <= last), "validation", data.sets).astype(data.sets.dtype),
    )


@pytest.mark.parametrize("before", [2, 9, 15])
def test_the_moment_of_a_step_lies_between_two_readings_of_the_fit(before: int, tmp_path: Path) -> None:
    campaign, data = simulate(tmp_path, seed=16, n=200, n_validation=0, effects=["base_shift"], size=6.0)
    truth = int(campaign.truth["effects"][0]["parameters"]["at_reading"]["value"])
    rank = {name: int(at) for name, at in zip(data.reading_id, data.conditions.order, strict=True)}
    step = rank[str(truth)]
    data = held_out(data, step - before, step + 17 - before)
    (found,) = (f for f in diagnose(data).effects if f.effect.label == "base_shift")
    assert found.between is not None
    low, high = (rank[name] for name in found.between)
    assert low < step <= high
    assert low == step - before - 1
    assert high <= step + 17 - before + 3


def shaped(data: Dataset, effect: Effect) -> tuple[DiagnosedEffect, DiagnosedEffect]:
    """Return a finding of an effect without and with the uncertainty of its shape.

    The effect is in the model.
    """
    base = identify(data)
    fitted = refit(data, base, (effect,))
    at = fitted.model.positions(effect)
    plain = DiagnosedEffect(effect, EVIDENCE, fitted.estimate[at], fitted.covariance[np.ix_(at, at)], None)
    (wide,) = with_shapes(data, fitted, [plain])
    return plain, wide


def test_the_uncertainty_of_a_time_constant_widens_the_amplitude(tmp_path: Path) -> None:
    deviates: list[tuple[float, float, float]] = []
    for seed in (16, 17, 18, 19):
        campaign, data = simulate(tmp_path, seed=seed, n=200, n_validation=0, effects=["warm_up"])
        hidden = {k: v["value"] for k, v in campaign.truth["effects"][0]["parameters"].items()}
        result = diagnose(data)
        (effect,) = (f.effect for f in result.effects if f.effect.label == "warm_up")
        plain, wide = shaped(data, effect)
        (value, narrow, _), (_, std, _) = plain.amplitude, wide.amplitude
        constant = wide.shape_std[TIME_CONSTANT]
        deviates.append(
            (
                (value - 1e6 * hidden["alpha"]) / std,
                (effect.shape[TIME_CONSTANT] - hidden["T_c"]) / constant,
                std / narrow,
            )
        )
    of_value, of_constant, wider = np.array(deviates).T
    assert np.all(wider > 1.0)
    assert np.max(wider) > 1.1
    assert np.max(np.abs(of_value)) < 3.0
    assert np.max(np.abs(of_constant)) < 3.0


def test_the_derivative_is_that_of_the_fit(tmp_path: Path) -> None:
    """Another constant moves the fitted amplitude by as much as the covariance is widened."""
    campaign = make_campaign(seed=16, n=200, n_validation=0, effects=["warm_up"])
    truth = float(campaign.truth["effects"][0]["parameters"]["T_c"]["value"])
    data = read_dataset(write_files(tmp_path, *exact(campaign)))
    robot, step = data.header.robot, 5.0
    plain, wide = shaped(data, warm_up(robot, truth))
    more, _ = shaped(data, warm_up(robot, truth + step))
    less, _ = shaped(data, warm_up(robot, truth - step))
    slope = (more.values[0] - less.values[0]) / (2.0 * step)
    added = np.sqrt(wide.covariance[0, 0] - plain.covariance[0, 0])
    assert added == pytest.approx(abs(slope) * wide.shape_std[TIME_CONSTANT], rel=0.05)


def test_whole_orders_are_exact_and_others_uncertain(tmp_path: Path) -> None:
    _, data = simulate(tmp_path, seed=16, n=200, n_validation=0, effects=["periodic:j1:n4.5"])
    _, broken = shaped(data, periodic(1, 4.5))
    assert 0.001 < broken.shape_std["order"] < 0.1
    _, whole = shaped(data, periodic(1, 4.0))
    assert whole.shape_std == {}


@pytest.fixture(scope="module")
def space(tmp_path_factory: pytest.TempPathFactory) -> Space:
    folder = tmp_path_factory.mktemp("statements")
    _, data = simulate(folder, seed=1, n=120, n_validation=0, effects=[], approach="varied")
    return Space.of(identify(data))


def test_every_place_has_advice_that_names_its_joints(space: Space) -> None:
    for where in (*drivers(space), EACH_POSE):
        (advice, *_) = next_measurements([(where, "the tool point")])
        if "torque" in where or "moment" in where:
            assert "payload" in advice
            continue
        for joint in (word for word in where.split() if word.isdigit()):
            assert f"joint {joint}" in advice, where


@pytest.mark.parametrize(
    ("where", "acts_on", "word"),
    [
        ("joint 3 angle", "joint 3", "joint 3 alone"),
        ("time", "the offset d5", "first ten poses"),
        ("torque about joint 2", "joint 2", "payload"),
        ("overturning moment", "the tilt of the base", "payload"),
        ("last move of joint 4", "joint 4", "lengths"),
        ("temperature", "the lengths of the arm", "temperature"),
        ("time", ACTS_ON, "left out"),
        ("something new", "the tool point", "first ten poses"),
    ],
)
def test_advice_varies_the_quantity_concerned(where: str, acts_on: str, word: str) -> None:
    assert word in " ".join(next_measurements([(where, acts_on)]))


def test_advice_is_short_and_never_repeats_itself() -> None:
    places = [(f"joint {j} and joint {k} angles", f"joint {k}") for j in range(1, 6) for k in range(j + 1, 7)]
    told = next_measurements([*places, *places])
    assert 0 < len(told) == len(set(told)) <= 5
    assert next_measurements([])


@pytest.mark.parametrize(("factor", "remarked"), [(1.0, False), (2.0, True)])
def test_noise_declared_too_large_is_remarked(factor: float, remarked: bool, tmp_path: Path) -> None:
    _, data = simulate(
        tmp_path,
        seed=3,
        n=120,
        n_validation=0,
        effects=[],
        noise_declared_factor=factor,
        repeatability_deg=0.0,
    )
    assert any("too large" in each for each in remarks_of(data, identify(data))) == remarked


@pytest.mark.parametrize(("times", "means"), [(1.0, "as declared"), (3.0, "more than"), (0.3, "less than")])
def test_repeats_within_a_visit_show_the_noise_of_the_instrument(
    times: float, means: str, tmp_path: Path
) -> None:
    _, data = simulate(tmp_path, seed=3, n=60, n_validation=0, effects=[])
    fitted = identify(data)
    assert not any("repeated readings" in each for each in remarks_of(data, fitted))
    rng = np.random.default_rng(5)
    covariance = data.header.noise.of_points(data.points, data.u_point)
    noise = np.einsum("nab,nb->na", np.linalg.cholesky(covariance), rng.normal(size=data.points.shape))
    twice = fitted.readings.taken(np.repeat(np.arange(len(fitted.readings.rows)), 2))
    rows = np.r_[np.arange(len(data)), np.arange(len(data))].reshape(2, -1).T.ravel()
    again = np.arange(2 * len(data)) % 2 == 1
    points = data.points[rows] + times * np.sqrt(2.0) * noise[rows] * again[:, None]
    doubled = replace(
        data,
        points=points,
        reading_id=tuple(f"{data.reading_id[r]}-{k}" for k, r in enumerate(rows)),
        **{name: getattr(data, name)[rows] for name in ("sets", "status", "orientation", "lengths")},
        **{name: getattr(data, name)[rows] for name in ("u_point", "u_rotation", "u_length")},
        conditions=data.conditions.take(rows),
    )
    told = remarks_of(doubled, replace(fitted, readings=replace(twice, rows=np.arange(len(rows)))))
    (remark,) = (each for each in told if "repeated readings" in each)
    assert means in remark
    assert remark.startswith("60 repeated")


def with_residual(space: Space, errors: Array) -> Space:
    return replace(
        space, residual=errors, held=np.concatenate([errors.ravel(), np.zeros(len(space.held) - space.size)])
    )


def test_residuals_that_are_mostly_zero_are_no_structure_and_no_warning(space: Space) -> None:
    errors = np.zeros(space.residual.shape)
    errors[:, :3] = 5.0
    assert left_over(with_residual(space, errors)) == []


def test_a_place_that_one_draw_carries_alone_is_no_warning() -> None:
    values = np.zeros((2, 60))
    values[0, 7] = 1.0
    values[1] = np.random.default_rng(1).chisquare(2.0, 60)
    assert np.all(np.isfinite(log_p_of(values)))


def test_no_smallest_size_is_absurd(space: Space) -> None:
    families = offers(Survey(space.fitted.model.robot, space.fitted.readings.conditions))
    scores = Scores(families, space)
    sizes = {v.label: v.size for v in visible(scores)}
    assert any(size is not None for size in sizes.values())
    # readings that see a millionth of what these do would need sizes that no robot has
    scores.a = [1e-12 * a for a in scores.a]
    assert all(v.size is None for v in visible(scores) if v.label.startswith(("backlash:", "periodic:")))


def test_no_rival_repeats_what_was_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    _, data = simulate(tmp_path, seed=3, n=60, n_validation=0, effects=[])
    cause: Any = SimpleNamespace(what="The sign of joint 1 is wrong", do="Turn it.", file="header", key="x")
    other: Any = SimpleNamespace(what="Joint 1 counts backwards", do="Turn it.", file="header", key="x")
    why = Explanation(cause, (cause, other), (other,), 5.0, 0.1)
    monkeypatch.setattr(plausible, "explained", lambda *_, **__: why)
    with pytest.raises(DataError) as caught:
        plausible.refuse_implausible(data)
    assert caught.value.do.count("As likely") == 1
    assert "As likely: Joint 1 counts backwards." in caught.value.do
