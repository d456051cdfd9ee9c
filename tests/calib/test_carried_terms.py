"""Test that carried terms contain exactly what left-out readings confirm.

Each has its place and moment.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from calib.data import Dataset
from calib.diagnose import DiagnosisFit, diagnose
from calib.diagnose.dictionary import Dictionary, OfClock, bound
from calib.diagnose.pursuit import Groups, Pursuit, Screening, shrunk
from calib.model import BoundModel
from calib.model.carried_regressors import Held, HeldPair, OfTime
from calib.model.effect import Effect, EffectTerm, Parameter
from calib.model.regressors import Constant, Regressor, from_json, to_json
from tests.calib.campaigns import simulate

RNG = np.random.default_rng(5)
OUT = 0.25  # share of a range by which conditions are moved beyond it


@pytest.fixture(scope="module")
def clean(tmp_path_factory: pytest.TempPathFactory) -> tuple[Dataset, DiagnosisFit]:
    folder = tmp_path_factory.mktemp("carried")
    _, data = simulate(folder, "abb-irb120", 11, 240, 80, [], approach="varied")
    return data, diagnose(data)


def bent(clean: tuple[Dataset, DiagnosisFit], slot: str, regressor: Regressor, size: float) -> Dataset:
    """The data set of a robot one of whose slots follows a condition as well."""
    data, found = clean
    law = Effect(
        "law",
        "structure",
        "robot",
        "A law.",
        (Parameter("law.size", "mm"),),
        (EffectTerm("law.size", slot, 1.0, regressor),),
    )
    base = found.base
    bare, whole = (
        BoundModel(model, data.conditions).predict(estimate)
        for model, estimate in (
            (base.model, base.estimate),
            (base.model.append(law), np.append(base.estimate, size)),
        )
    )
    return replace(data, points=data.points + whole - bare)


def test_a_complete_model_carries_nothing(clean: tuple[Dataset, DiagnosisFit]) -> None:
    _, found = clean
    assert (found.verdict, found.carried, found.withdrawn) == ("complete", (), ())
    assert found.shares.named + found.shares.carried == 0.0
    assert found.shares.noise == pytest.approx(1.0)
    assert found.error_named == found.error_after


def test_a_length_that_jumps_is_placed_and_dated(clean: tuple[Dataset, DiagnosisFit]) -> None:
    """No effect of the library moves a length of one link between two readings."""
    data, plain = clean
    times = data.conditions.time
    moment = float(np.sort(times)[150])
    step = OfTime((moment, moment + 1e-3), (0.0, 1.0))
    found = diagnose(bent(clean, "a2", step, 0.25))
    assert found.verdict == "unexplained"
    first = found.carried[0]
    assert (first.slot, first.place, first.condition) == ("a2", "the length a2", "time")
    assert first.between is not None
    before, after = (list(data.reading_id).index(name) for name in first.between)
    assert times[before] <= moment <= times[after]
    assert 0.1 < first.effect.amplitude(first.values, first.covariance)[0] < 0.4  # other terms share in it
    assert found.error_before is not None
    assert found.error_after is not None
    assert plain.error_after is not None
    assert found.error_after.rms < 1.15 * plain.error_after.rms < 0.7 * found.error_before.rms
    assert found.shares.carried > 0.5
    assert found.agrees
    assert (found.structure[0].where, found.structure[0].acts_on) == ("time", "the length a2")


def test_an_error_of_one_joint_that_follows_another_is_carried_and_usable(
    clean: tuple[Dataset, DiagnosisFit],
) -> None:
    data, plain = clean
    law = Held("angle", 3, "sine", 2.0, 0.0, -np.pi, np.pi)
    found = diagnose(bent(clean, "theta5", law, 1.5e-3))
    places = [(term.place, term.condition) for term in found.carried]
    assert places[0] == ("joint 5", "joint 3 angle")
    assert found.carried[0].effect.is_usable
    assert found.error_after is not None
    assert plain.error_after is not None
    assert found.error_after.rms < 1.15 * plain.error_after.rms
    assert len(data) == len(found.dataset)


def test_without_times_only_an_order_is_claimed(clean: tuple[Dataset, DiagnosisFit]) -> None:
    moment = float(np.sort(clean[0].conditions.time)[150])
    data = bent(clean, "a2", OfTime((moment, moment + 1e-3), (0.0, 1.0)), 0.25)
    untimed = replace(data.conditions, time=np.full(len(data), np.nan))
    found = diagnose(replace(data, conditions=untimed))
    assert (found.carried[0].place, found.carried[0].condition) == ("the length a2", "order of the rows")
    assert "time" not in [place.where for place in found.structure]
    assert found.next_measurements


def test_rows_that_come_back_are_no_longer_left_out(clean: tuple[Dataset, DiagnosisFit]) -> None:
    """Rows explained by a law within a few degrees of a joint are no longer left out.

    The law is so large that its readings were rejected as gross errors.
    """
    data = bent(clean, "theta3", Held("angle", 3, "window", 1.0 / 0.3, 0.2, -np.pi, np.pi), 4e-3)
    found = diagnose(data)
    assert found.back
    assert not set(found.back) & set(found.final.faulty_rows)
    assert set(found.back) <= {data.reading_id[row] for row in found.final.readings.rows}
    assert found.carried[0].condition == "joint 3 angle"


def test_held_out_readings_choose_no_term(clean: tuple[Dataset, DiagnosisFit]) -> None:
    data = bent(clean, "theta5", Held("angle", 3, "sine", 2.0, 0.0, -np.pi, np.pi), 1.5e-3)
    points = data.points.copy()
    points[data.validation_rows] += RNG.normal(0.0, 50.0, (int(data.validation_rows.sum()), 3))
    one, other = diagnose(data), diagnose(replace(data, points=points))
    assert [term.effect for term in one.carried] == [term.effect for term in other.carried]
    np.testing.assert_array_equal(one.final.estimate, other.final.estimate)


@pytest.mark.parametrize(
    "regressor",
    [
        Held("angle", 2, "cosine", 3.0, 0.0, -1.0, 0.5),
        Held("angle", 2, "window", 4.0, 0.1, -1.0, 0.5),
        Held("torque", 2, "cubic", 1e-5, 0.0, -4e4, 9e4),
        Held("move", 1, "sign", 20.0, 0.0, -0.2, 0.2),
        Held("air", 0, "linear", 1.0, 21.0, 20.0, 22.0),
        HeldPair(1, 3, "sine", 1.0, -2.0, -1.0, 1.0, -0.5, 0.5),
        OfTime((0.0, 100.0, 200.0), (0.0, 1.0, 0.5)),
        OfTime((0.0, 100.0), (0.0, 1.0), "order"),
    ],
)
def test_beyond_its_range_a_regressor_keeps_its_value(
    clean: tuple[Dataset, DiagnosisFit], regressor: Held | HeldPair | OfTime
) -> None:
    assert from_json(to_json(regressor)) == regressor
    conditions = clean[0].conditions
    far = replace(
        conditions,
        joints=conditions.joints + 50.0,
        torque=conditions.torque + 1e9,
        time=conditions.time + 1e9,
        order=conditions.order + 1e9,
        temperature=conditions.temperature + 1e3,
    )
    values = np.asarray(regressor.evaluate(far))
    assert np.ptp(values) == pytest.approx(0.0, abs=1e-12)
    out, here = ([*regressor.beyond(c).values()] for c in (far, conditions))
    assert np.all(np.max(out, axis=0) > OUT)
    within = np.max(here, axis=0) == 0.0
    farther = np.asarray(regressor.evaluate(conditions))
    assert np.all(np.abs(farther) <= max(1.0, float(np.max(np.abs(farther[within]), initial=0.0)) + 1e-9))


def test_a_function_of_time_is_linear_between_the_readings_that_know_it() -> None:
    step = OfClock(lambda u: np.asarray(u > 10.0, dtype=np.float64))
    regressor = bound(step, np.array([0.0, 5.0, 9.0, 13.0, 20.0]), "time")
    assert isinstance(regressor, OfTime)
    values = np.interp([5.0, 9.0, 11.0, 13.0, 40.0], regressor.times, regressor.values)
    np.testing.assert_allclose(values, [0.0, 0.0, 0.5, 1.0, 1.0])


def matrices(rows: int, widths: Sequence[int], count: int) -> tuple[np.ndarray, np.ndarray]:
    columns = RNG.normal(size=(rows, count + sum(widths)))
    return columns, columns @ np.r_[np.ones(count), np.zeros(sum(widths))] + 0.1 * RNG.normal(size=rows)


def test_the_unit_of_a_term_decides_nothing() -> None:
    """The unit of a term does not affect its choice.

    The cube of a torque has squares beyond single precision, so its name was lost when columns were not scaled.
    """
    rows, of_model = 200, np.linalg.qr(RNG.normal(size=(200, 3)))[0]
    columns = RNG.normal(size=(5, rows)).astype(np.float32)
    data = columns[3] + 0.3 * columns[1] + 0.1 * RNG.normal(size=rows)
    left = data - of_model @ (of_model.T @ data)
    found = []
    for size in (1.0, 1e21):
        groups = Groups(np.ones(5, dtype=np.int64), np.zeros(5), np.ones(5, dtype=bool), 0)
        scaled: Any = (columns * np.array([1.0, 1.0, 1.0, size, 1.0])[:, None]).astype(np.float32)
        state = Screening(scaled, of_model, left.copy(), groups, rows)
        state.round()
        found.append((state.chosen, state.rss))
    assert found[0][0][0] == 3
    assert found[1][0] == found[0][0]
    assert found[1][1] == pytest.approx(found[0][1], rel=1e-4)


def test_a_pursuit_leaves_what_least_squares_leaves() -> None:
    """A pursuit leaves the residual of least squares with the model and after every term.

    This includes the rows that take no part.
    """
    widths = np.array([1, 2, 1, 3, 2])
    columns, data = matrices(80, widths.tolist(), 3)
    other, other_data = matrices(20, widths.tolist(), 3)
    data = data + 2.0 * columns[:, 4] + 0.5 * columns[:, 9]
    groups = Groups(widths, np.zeros(5), np.zeros(5, dtype=bool), 3)
    pursuit = Pursuit(
        columns.T @ columns, columns.T @ data, float(data @ data), 80, groups, (other, other_data)
    )
    for _ in range(4):
        at = pursuit.columns(len(pursuit.chosen))
        found, *_ = np.linalg.lstsq(columns[:, at], data, rcond=None)
        assert pursuit.rss == pytest.approx(float(np.sum((data - columns[:, at] @ found) ** 2)))
        np.testing.assert_allclose(pursuit.missed, other_data - other[:, at] @ found, atol=1e-8)
        assert pursuit.free == 80 - len(at)
        assert pursuit.step()
    assert pursuit.chosen[0] == 1, "the term of two columns that holds the largest law enters first"


def test_evidence_shrinks_a_term_that_is_none_and_keeps_one_that_is() -> None:
    columns, data = matrices(200, [1, 1], 2)
    data = data + 3.0 * columns[:, 2]
    value, covariance, noise, precision = shrunk(
        columns.T @ columns, columns.T @ data, float(data @ data), 200, 2, [1, 1]
    )
    assert value[2] == pytest.approx(3.0, abs=0.05)
    assert abs(value[3]) < 0.01
    assert precision[3] > 100.0 * precision[2]
    assert np.sqrt(noise) == pytest.approx(0.1, rel=0.2)
    assert covariance[2, 2] == pytest.approx(noise / (columns[:, 2] @ columns[:, 2]), rel=0.2)


def test_what_rows_lack_is_not_offered(clean: tuple[Dataset, DiagnosisFit]) -> None:
    data, found = clean
    whole = Dictionary.of(found.base.model, found.base.readings, data.conditions)
    assert whole.clock == "time"
    kinds = {entry.kind for entry in whole.entries}
    assert {"time", "air", "late air", "joint", "gear", "pair", "window", "torque", "side", "move"} <= kinds
    time, air = data.conditions.time.copy(), data.conditions.temperature.copy()
    time[3], air[5] = np.nan, np.nan
    poor = Dictionary.of(
        found.base.model, found.base.readings, replace(data.conditions, time=time, temperature=air)
    )
    assert poor.clock == "order"
    assert not {"air", "late air"} & {entry.kind for entry in poor.entries}
    assert Constant() not in {f for entry in whole.entries for f in entry.functions}
