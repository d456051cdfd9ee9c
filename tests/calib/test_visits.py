"""Test readings of one visit, which share the rest position of the robot.

These would catch: legs of one pose weighed as if the arm had arrived separately for each, a covariance that differs
from the dense one, uncertainties that are too small, and a single reading treated otherwise than before. They would
also catch a wrong reading that drags the others of its visit along, and visits that are no visits.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from calib import Dataset, IdentificationFit, identify, load_robot, read_dataset
from calib.array import Array
from calib.data import Conditions
from calib.data.read import visits_of, with_visits
from calib.diagnose.structure import along, directions, drivers
from calib.effects import Survey, offers
from calib.effects.geometry import change_points
from calib.fit import readings_of
from calib.fit.identify import fit
from calib.fit.least_squares import jacobian
from calib.fit.readings import linearised
from calib.model import BoundModel
from calib.model.observations import Observations, VisitCovariance
from calib.scan import Candidate, Harmonics, Space, Steps
from tests.benchmarks.diagnosis_complete import campaign as complete_campaign
from tests.benchmarks.nests import LEG_SIGMA_MM, example, header_of, legs_of, truth_of
from tests.calib.campaigns import conditions_of, simulate, write_files

CELL, VISITS = example()
TRUTH = truth_of(CELL, 3)
LEGS = legs_of(TRUTH, CELL, VISITS)
U_MM = {"base_targets_u_mm": 0.3, "tool_targets_u_mm": 0.05}


def read(folder: Path, rows: list[dict[str, Any]]) -> Dataset:
    return read_dataset(write_files(folder, rows, header_of(CELL, CELL.nests, CELL.tool.targets, **U_MM)))


@pytest.fixture(scope="module")
def legs(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    return read(tmp_path_factory.mktemp("legs"), LEGS)


@pytest.fixture(scope="module")
def fitted(legs: Dataset) -> IdentificationFit:
    return identify(legs)


def lengths_of(design: BoundModel, estimate: Array) -> Array:
    """Compute distances from tool balls to base balls, (n,), mm."""
    frames = design.frames(estimate, ())
    return np.linalg.norm(frames.p - frames.anchor, axis=0)


def differences(along: Any, size: float, at: Array) -> Array:
    """Differentiate along(x) (n,) for x (m,) by central differences of a step; return (n, m)."""
    steps = size * np.eye(len(at))
    return np.column_stack([(along(at + step) - along(at - step)) / (2.0 * size) for step in steps])


def by_joint(found: IdentificationFit, conditions: Conditions) -> Array:
    """Differentiate the lengths of the nominal robot by the joint angles at rest, (n, N)."""
    nominal = np.zeros(len(found.estimate))

    def turned(by: Array) -> Array:
        return lengths_of(
            BoundModel(found.model, replace(conditions, joints=conditions.joints + by)), nominal
        )

    return differences(turned, 1e-6, np.zeros(conditions.joints.shape[1]))


def test_the_fit_is_that_of_the_dense_covariance(legs: Dataset, fitted: IdentificationFit) -> None:
    """The fit equals generalised least squares with C = S S' s^2 + sigma^2 I.

    Its blocks are the readings of one pose.
    """
    conditions, noise = fitted.readings.conditions, legs.header.noise
    place = np.round(conditions.joints / 1e-9).astype(np.int64)
    same = np.all(place[:, None] == place[None], axis=2)
    scatter = noise.repeatability * by_joint(fitted, conditions)
    covariance = scatter @ scatter.T * same + LEG_SIGMA_MM**2 * np.eye(len(place))
    weight = np.linalg.inv(covariance)
    active = fitted.standard_errors > 0.0
    design = BoundModel(fitted.model, conditions)
    jacobian = differences(partial(lengths_of, design), 1e-7, fitted.estimate)[:, active]
    left = legs.lengths[fitted.readings.rows] - lengths_of(design, fitted.estimate)
    prior = fitted.prior[active] ** 2
    information = jacobian.T @ weight @ jacobian + np.diag(prior)
    step = np.linalg.solve(information, jacobian.T @ weight @ left - prior * fitted.estimate[active])
    expected = np.linalg.inv(information) * max(fitted.noise_scale, 1.0) ** 2
    errors = np.sqrt(np.diag(expected))
    assert np.abs(step / errors).max() < 0.05, "it is the minimum"
    got = fitted.covariance[np.ix_(active, active)]
    np.testing.assert_allclose(got / np.outer(errors, errors), expected / np.outer(errors, errors), atol=2e-3)
    assert np.sum(fitted.residual**2) == pytest.approx(left @ weight @ left, rel=1e-3)


def drawn(n: int, k: int, visit: NDArray[np.int64], seed: int) -> VisitCovariance:
    rng = np.random.default_rng(seed)
    return VisitCovariance(visit, rng.normal(size=(6, k, n)) * rng.choice((0.3, 3.0, 300.0), n))


@pytest.mark.parametrize("k", [1, 3, 7])
def test_rows_of_a_visit_have_variance_one(k: int) -> None:
    """Whitened visits agree with dense matrices.

    The visits have one to nine readings, not in order, and some share nothing.
    """
    rng = np.random.default_rng(k)
    n = 40
    visit = rng.permutation(np.repeat(np.arange(9), [1, 1, 2, 3, 4, 5, 6, 9, 9]))
    shared = drawn(n, k, visit, k)
    shared.scatter[:, :, visit == 3] = 0.0
    rows = shared.scatter.reshape(6, -1)
    same = np.tile(visit, k)
    covariance = rows.T @ rows * (same[:, None] == same) + np.eye(k * n)
    w = shared.whitened(np.eye(k * n).reshape(-1, k, n)).reshape(k * n, -1)
    np.testing.assert_allclose(w @ covariance @ w.T, np.eye(k * n), atol=1e-7)
    np.testing.assert_allclose(w, w.T, atol=1e-12, err_msg="each row is changed least")
    alone = shared.alone
    for i in (0, 7, 39):
        own = covariance.reshape(k, n, k, n)[:, i, :, i]
        np.testing.assert_allclose(alone[:, :, i] @ own @ alone[:, :, i].T, np.eye(k), atol=1e-7)
    some = np.flatnonzero(rng.random(n) < 0.6)
    few = (
        shared.take(some).whitened(np.eye(k * len(some)).reshape(-1, k, len(some))).reshape(k * len(some), -1)
    )
    of_some = np.arange(k * n).reshape(k, n)[:, some].ravel()
    left = covariance[np.ix_(of_some, of_some)]
    np.testing.assert_allclose(few @ left @ few.T, np.eye(len(left)), atol=1e-7)


def test_a_reading_by_itself_is_whitened_as_ever(tmp_path: Path) -> None:
    """One reading per visit has one triangle over both noises and shares nothing.

    The noises are those of the instrument and of the arm.
    """
    _, data = simulate(tmp_path, "abb-irb120", 3, 60, 10)
    assert len(np.unique(data.conditions.visit)) == len(data)
    found = identify(data)
    assert found.readings.observed.shared is None
    assert found.readings.observed.alone is found.readings.observed
    conditions, noise = found.readings.conditions, data.header.noise
    robot = found.model.robot
    frames = BoundModel(found.model, conditions).frames(np.zeros(len(found.estimate)), robot.joint_slots)
    points = data.points[found.readings.rows]
    covariance = noise.of_points(points, np.full(points.shape, np.nan))
    covariance += noise.of_joints(frames.velocities(robot.joint_slots), robot.kinds)
    w = found.readings.observed.whiten.transpose(2, 0, 1)
    np.testing.assert_allclose(
        w @ covariance @ w.transpose(0, 2, 1), np.tile(np.eye(3), (len(w), 1, 1)), atol=1e-6
    )


def normalised_errors(data: Dataset, found: IdentificationFit, count: int) -> Array:
    """Return errors of held-out lengths over their stated uncertainty, (count, v).

    In each of `count` campaigns, arm, arrivals and readings are drawn as declared.
    """
    model, rng = found.model, np.random.default_rng(5)
    conditions = found.readings.conditions
    here, fresh = BoundModel(model, conditions), BoundModel(model, data.conditions.take(data.validation_rows))
    readings = readings_of(data, data.fit_rows, model, found.estimate)
    count_fresh = len(fresh.conditions)
    nothing, one = np.zeros(count_fresh), np.ones((1, 1, count_fresh))
    plain = Observations(None, None, nothing, one, np.ones(count_fresh, dtype=np.int64))
    usual = np.where(np.isfinite(model.prior_std), model.prior_std, 0.0)
    arrives = by_joint(found, conditions)
    _, stop = np.unique(np.round(conditions.joints / 1e-9).astype(np.int64), axis=0, return_inverse=True)
    out = []
    for _ in range(count):
        truth = usual * rng.normal(size=len(usual))
        at_rest = data.header.noise.repeatability * rng.normal(size=(stop.max() + 1, 6))
        lengths = lengths_of(here, truth) + np.sum(arrives * at_rest[stop.ravel()], axis=1)
        lengths += LEG_SIGMA_MM * rng.normal(size=len(lengths))
        measured = replace(readings, observed=replace(readings.observed, lengths=lengths))
        again = fit(data, model, measured, truth)
        error = lengths_of(fresh, again.estimate) - lengths_of(fresh, truth)
        slope = jacobian(fresh, plain, fresh.frames(again.estimate, fresh.slots))
        as_declared = again.covariance / max(again.noise_scale, 1.0) ** 2
        variance = np.einsum("im,mn,in->i", slope, as_declared, slope)
        out.append(error / np.sqrt(variance))
    return np.array(out)


def test_uncertainties_are_those_that_the_errors_have(legs: Dataset, fitted: IdentificationFit) -> None:
    """Normalised errors of visits have mean square 1; legs taken as independent have more.

    Over 300 campaigns the mean square is 1.00 with a standard error of 0.03, and 1.52 for independent legs.
    """
    honest = np.mean(normalised_errors(legs, fitted, 60) ** 2)
    assert honest == pytest.approx(1.0, abs=0.15)
    apart = replace(legs, conditions=replace(legs.conditions, visit=np.arange(len(legs))))
    alone = np.mean(normalised_errors(apart, fitted, 60) ** 2)
    assert alone > 1.3, "legs taken for independent promise what they do not know"


def test_a_fit_by_parts_has_every_visit_in_one(
    legs: Dataset, fitted: IdentificationFit, monkeypatch: Any
) -> None:
    """A large fit is worked out some readings at a time: the sums are those of the whole."""
    monkeypatch.setattr(
        "calib.fit.readings._AT_ONCE", 45
    )  # seven parts of 41 readings, were it not for the visits
    parts = list(linearised(fitted.model, fitted.readings, fitted.estimate))
    assert len(parts) > 3
    assert sorted(np.concatenate([part for part, _, _ in parts]).tolist()) == list(
        range(len(fitted.readings.rows))
    )
    square = sum(float(np.sum(residual**2)) for _, residual, _ in parts)
    assert square == pytest.approx(float(np.sum(fitted.residual**2)), rel=1e-9)


def test_one_wrong_leg_is_left_out_alone(tmp_path: Path) -> None:
    """A single wrong leg is left out, although its error affects its whole visit.

    An error of a millimetre shows in all legs of its visit once they are whitened together.
    """
    rows = [dict(row) for row in LEGS]
    wrong = next(i for i, row in enumerate(rows) if row["set"] == "calibration" and i > 40)
    rows[wrong]["length_mm"] += 1.0
    found = identify(read(tmp_path, rows))
    assert found.faulty_rows == (str(rows[wrong]["reading_id"]),)
    assert 0.8 < found.noise_scale < 1.2


def stops(**given: Any) -> Conditions:
    """Build readings of one robot in the given order.

    `pose` holds the pose numbers; other arguments replace the conditions that differ between readings.
    """
    pose = np.array(given.pop("pose"))
    robot = load_robot("abb-irb120")
    n = len(pose)
    joints = 0.1 * pose[:, None] * np.ones(robot.joints)
    usual: dict[str, Any] = {
        "previous": joints - 0.05,
        "side": np.ones((n, robot.joints)),
        **{name: np.zeros(n, dtype=np.int64) for name in ("series", "target", "anchor")},
    }
    return replace(conditions_of(robot, joints), **(usual | given))


def numbers(conditions: Conditions) -> list[int]:
    """The visits, numbered in the order in which they begin."""
    visit = visits_of(conditions).tolist()
    return [list(dict.fromkeys(visit)).index(each) for each in visit]


def test_a_visit_is_one_stop_of_the_robot() -> None:
    legs_of_two = stops(pose=[0, 0, 0, 1, 1, 1, 0, 0, 0], target=np.tile([0, 1, 2], 3))
    assert numbers(legs_of_two) == [0, 0, 0, 1, 1, 1, 2, 2, 2], "a pose that is visited again"
    again = stops(pose=[0] * 6, target=np.tile([0, 1, 2], 2))
    assert numbers(again) == [0, 0, 0, 1, 1, 1], "a target that is read after the same approach again"
    joints = again.joints
    still = replace(again, previous=np.vstack([joints[:1] - 0.3, joints[1:]]))
    assert numbers(still) == [0] * 6, "read again, and the robot had not moved"
    sides = replace(still, side=np.repeat([[1.0], [-1.0]], 3, axis=0) * np.ones((6, 6)))
    assert numbers(sides) == [0, 0, 0, 1, 1, 1], "a sweep that turns round"
    elsewhere = replace(again, target=np.arange(6), previous=joints - 0.05 * np.arange(6)[:, None])
    assert numbers(elsewhere) == list(range(6)), "arrived at from elsewhere"
    assert numbers(replace(again, series=np.array([0, 0, 0, 1, 1, 1]))) == [0, 0, 0, 1, 1, 1]
    back = stops(pose=[0, 0, 1, 1, 0, 0], target=np.tile([0, 1], 3))
    shuffled = np.array([4, 0, 2, 5, 1, 3])
    assert visits_of(back.take(shuffled)).tolist() == visits_of(back)[shuffled].tolist(), "in order of time"


def test_standstills_of_a_path_are_visits_although_joints_jitter() -> None:
    jitter = 1e-6 * np.random.default_rng(1).normal(size=(6, 6))
    path = stops(pose=[0, 0, 0, 1, 1, 1], waypoint=np.repeat([4, 5], 3))
    joints = path.joints + jitter
    before = np.vstack([joints[:1], joints[:-1]])
    moved = np.sign(joints - before)
    assert numbers(
        replace(path, joints=joints, previous=before, side=np.where(moved == 0.0, 1.0, moved))
    ) == [0, 0, 0, 1, 1, 1]


def test_visits_as_recorded() -> None:
    again = stops(pose=[0] * 6, target=np.tile([0, 1, 2], 2))
    named = np.array(["a", "a", "a", "a", "a", "b"])
    assert with_visits(again, named).visit.tolist() == [0, 0, 0, 0, 0, 1]
    partly = with_visits(again, np.array(["", "", "", "a", "a", ""])).visit
    assert partly[0] == partly[1] == partly[2] != partly[3] == partly[4] != partly[5]
    assert with_visits(again, np.full(6, "")).visit.tolist() == visits_of(again).tolist()
    elsewhere = with_visits(stops(pose=[0, 0, 1, 1, 0]), np.full(5, "1")).visit
    assert elsewhere.tolist() == [0, 0, 1, 1, 2], "a visit has one pose, and two records may count alike"


def test_held_out_readings_part_visits_and_nothing_else(tmp_path: Path) -> None:
    """A validation pose separates two visits of one pose; its measured values change nothing."""
    rows = [dict(row) for row in LEGS]
    first = identify(read(tmp_path / "a", rows))
    for row in rows:
        if row["set"] == "validation":
            row["length_mm"] += 0.05 * float(row["reading_id"])
    second = identify(read(tmp_path / "b", rows))
    assert np.array_equal(first.estimate, second.estimate)
    assert np.array_equal(first.covariance, second.covariance)
    assert np.array_equal(first.residual, second.residual)


def test_steps_are_looked_for_where_visits_begin(legs: Dataset, fitted: IdentificationFit) -> None:
    ranks = change_points(Survey.of(fitted, legs))
    conditions = fitted.readings.conditions
    row = np.searchsorted(conditions.order, ranks)
    assert len(ranks) > 30
    assert np.all(conditions.visit[row] != conditions.visit[row - 1])


@pytest.fixture(scope="module")
def targets(tmp_path_factory: pytest.TempPathFactory) -> Space:
    """Three targets a visit, and a repeatability five times the noise of the tracker."""
    campaign = complete_campaign("5 visits, 3 targets, 5 x the noise", 90, 1)
    data = read_dataset(write_files(tmp_path_factory.mktemp("targets"), campaign.rows, campaign.header))
    return Space.of(identify(data))


def test_candidates_are_whitened_as_the_model_is(targets: Space) -> None:
    """Candidate columns are whitened like those of the model.

    Columns of the model's effects, whose drives differ within a visit, equal those of the fit. For every offer, the
    scan of a place gives the same as its columns.
    """
    model = targets.fitted.model
    assert targets.fitted.readings.observed.shared is not None
    for effect in model.effects:
        np.testing.assert_allclose(
            targets.effect_columns(effect), targets.columns[:, model.positions(effect)], rtol=1e-9, atol=1e-9
        )
    vectors = np.random.default_rng(2).normal(size=(targets.size, 2))
    families = offers(Survey(model.robot, targets.fitted.readings.conditions))
    assert {type(family) for family in families} >= {Candidate, Harmonics, Steps}
    for family in families:
        scores = family.scores(targets)
        place = len(scores.raw) // 3
        columns = targets.effect_columns(scores.effect(place))
        shared, gram = scores.shared(targets, vectors)[place], scores.gram(targets)[place]
        size = np.linalg.norm(columns, axis=0)
        np.testing.assert_allclose(shared, columns.T @ vectors, atol=1e-4 * size.max(), err_msg=family.label)
        np.testing.assert_allclose(
            gram, columns.T @ columns, atol=1e-4 * size.max() ** 2, err_msg=family.label
        )


def test_structure_within_a_visit_is_looked_for_as_it_is_whitened(targets: Space) -> None:
    """Correlations of drivers and directions with the residual use its whitening.

    This includes targets that differ within a visit.
    """
    rows = np.random.default_rng(3).normal(size=(targets.size, 2))
    pulled, driven = targets.pulled(rows), drivers(targets)
    assert "tool target" in driven
    for direction, axes in directions(targets).items():
        for functions in driven.values():
            f = functions[:, 0]
            columns = targets.fitted.readings.observed.by_visit(axes[0] * f).ravel()
            size = float(np.linalg.norm(columns))
            np.testing.assert_allclose(
                f @ along(axes[0], pulled), columns @ rows, atol=1e-8 * size, err_msg=direction
            )
