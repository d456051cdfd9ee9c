"""Test the regression MLS-SVR.

These would catch: a solution that is not Xu's, or only at a small gamma, and a choice that uses the data by which
it is judged. They would also catch a regression that is used where it has no data, and one that changes when it is
saved.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib.arm.robot import load_robot
from calib.array import Array
from calib.comparison import comparison as compare_module
from calib.comparison.comparison import (
    NOMINAL,
    ComparisonRequest,
    RegressionComparison,
    compare,
    freeing,
    mae,
    waypoints_of,
)
from calib.compensate import Status, correct
from calib.data.dataset import Dataset
from calib.data.read import read_dataset
from calib.errors import DataError
from calib.fit.identify import identify
from calib.model.model import BoundModel, StatedConditions
from calib.regression.mls_svr import Gaussian, Kernel, Linear, choose, fit, folds_of, widths
from calib.regression.regression import (
    SETS,
    Region,
    RegressionRequest,
    evaluate,
    flipped,
    independent,
    products_of,
    usual,
)
from calib.saved.model_checks import content_hash
from calib.saved.model_file import load_model, save_model
from service.results.models.regressed import findings
from tests.calib.campaigns import move_rows, write_files
from tests.calib.chain import chain
from tests.calib.ur5_path import REFLECTOR, ROBOT, WORLD, rows_of, simulate, waypoints

DEG = np.pi / 180.0
LEVEL_2 = ("base", "geometry", "parallel_twist")


def samples(n: int = 40, p: int = 6, m: int = 3) -> tuple[Array, Array]:
    rng = np.random.default_rng(0)
    features = rng.normal(size=(n, p))
    return features, features @ rng.normal(size=(p, m)) + rng.normal(size=(n, m)) + 5.0


@pytest.mark.parametrize("kernel", [Linear(), Gaussian(2.0)])
@pytest.mark.parametrize(("gamma", "share"), [(3.0, 0.5), (30.0, 0.1), (100.0, 4.0)])
def test_it_is_the_dual_solution_written_out(kernel: Kernel, gamma: float, share: float) -> None:
    features, outputs = samples()
    n, m = outputs.shape
    new = np.random.default_rng(1).normal(size=(7, features.shape[1]))

    def between(one: Array, other: Array) -> Array:
        if isinstance(kernel, Linear):
            return one @ other.T
        apart = np.linalg.norm(one[:, None] - other[None], axis=2)
        return np.exp(-(apart**2) / (2.0 * kernel.width**2))

    k = between(features, features)
    h = np.kron(np.ones((m, m)), k) + np.eye(n * m) / gamma + (m / share) * np.kron(np.eye(m), k)
    p, y = np.kron(np.eye(m), np.ones((n, 1))), outputs.T.ravel()
    eta, nu = np.linalg.solve(h, p), np.linalg.solve(h, y)
    b = np.linalg.solve(p.T @ eta, eta.T @ y)
    alpha = (nu - eta @ b).reshape(m, n)
    across = between(new, features)
    dual = np.array([across @ alpha.sum(axis=0) + (m / share) * across @ alpha[i] + b[i] for i in range(m)])
    found = fit(features, outputs, kernel, gamma, share).predict(new)
    np.testing.assert_allclose(found, dual.T, rtol=0.0, atol=1e-9)


@pytest.mark.parametrize(("gamma", "near"), [(1e12, 1.0), (1e30, 1e-6), (1e300, 1e-6)])
def test_any_gamma_ends_in_least_squares(gamma: float, near: float) -> None:
    """Any gamma ends in least squares with dependent and nearly equal columns.

    The dual fails long before that.
    """
    features, outputs = samples()
    features = np.column_stack([features, features[:, 0] + features[:, 1], features[:, 2]])
    features = np.column_stack([features, features[:, 3] + near * features[:, 4] ** 2])
    columns = np.column_stack([features, np.ones(len(features))])
    plain = columns @ np.linalg.lstsq(columns, outputs, rcond=1e-12)[0]
    found = fit(features, outputs, Linear(), gamma, 1.0).predict(features)
    np.testing.assert_allclose(found, plain, rtol=0.0, atol=1e-8)


def test_the_closed_form_is_the_arm_and_the_printed_one_is_not() -> None:
    """Against the second arm. Equation (11) as printed misses away from a tool that points down."""
    rng = np.random.default_rng(3)
    anywhere, down = rng.uniform(-3.0, 3.0, (120, 6)), waypoints(rng, 120)

    def left(name: str, joints: Array) -> float:
        points = np.array([chain(ROBOT, q, {}, REFLECTOR).real[:3, 3] for q in joints])
        features = evaluate(products_of(name, ROBOT), joints)
        return float(np.abs(points - fit(features, points, Linear(), 1e20, 1.0).predict(features)).max())

    assert left("closed-form", anywhere) < 1e-6
    assert left("printed", anywhere) > 10.0
    assert left("printed", down) < 1e-6
    assert left("tool-down", down) < 1e-6
    assert independent(evaluate(products_of("closed-form", ROBOT), down)) == 29
    assert usual(ROBOT, down) == "tool-down"
    assert usual(ROBOT, anywhere) == "closed-form"
    assert usual(load_robot("abb-irb120"), anywhere) == "turns"


def test_a_flipped_wrist_is_noticed(small: Dataset) -> None:
    """With joint 5 on the other side: the smallest set of products describes one wrist, not both."""
    down = waypoints(np.random.default_rng(3), 40)
    mixed = down.copy()
    mixed[7] += np.pi * np.array([0.0, 0.0, 0.0, 1.0, 0.0, 1.0])
    mixed[7, 4] *= -1.0
    assert np.flatnonzero(flipped(mixed)).tolist() == [7]
    assert not flipped(down).any()
    assert usual(ROBOT, down) == "tool-down"
    assert usual(ROBOT, mixed) == "closed-form"
    joints = small.conditions.joints.copy()
    waypoint = waypoints_of(small)
    joints[waypoint == waypoint[0], 4] *= -1.0
    spoilt = replace(small, conditions=replace(small.conditions, joints=joints))
    with pytest.raises(DataError, match="the wrist is flipped at 1 of 30 waypoints"):
        compare(spoilt, ComparisonRequest(RegressionRequest("positions", "tool-down"), level=2))


def test_the_choice_finds_what_is_there_and_nothing_in_noise() -> None:
    rng = np.random.default_rng(5)
    group = np.repeat(np.arange(30), 4)
    features = rng.normal(size=(30, 3))[group]
    of_group = 0.03 * rng.normal(size=(30, 3))[group]
    curved = np.column_stack([np.sin(features[:, 0]), features[:, 1], 0.0 * features[:, 2]])
    assert not choose(features, of_group, group).sure
    assert not choose(features, of_group, group, widths(features)).sure
    found = choose(features, curved + of_group, group)
    assert found.sure
    assert found.rms < 0.5 * found.rms_of_nothing
    smooth = choose(features, curved + 0.01 * of_group, group, widths(features))
    assert smooth.rms < 0.7 * choose(features, curved + 0.01 * of_group, group).rms


def test_groups_are_left_out_whole() -> None:
    group = np.random.default_rng(0).integers(0, 17, 200)
    folds = folds_of(group)
    assert len(folds) == 5
    np.testing.assert_array_equal(np.sum(folds, axis=0), 1)
    for held in folds:
        assert not set(group[held]) & set(group[~held])


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    """Simulate 30 waypoints with gears that err once per turn, for a regression on residuals."""
    return simulate(tmp_path_factory.mktemp("small"), 2, count=30, samples=90, waves=8e-4)


PLAN = ComparisonRequest(RegressionRequest("residuals", "turns"), level=2, compare=True)


@pytest.fixture(scope="module")
def compared(small: Dataset) -> RegressionComparison:
    return compare(small, PLAN)


def test_what_is_left_out_takes_no_part(small: Dataset, compared: RegressionComparison) -> None:
    """Predictions of the left-out part do not change by a bit when its points move by 2 mm."""
    held = folds_of(compared.waypoint)[0]
    points = small.points.copy()
    points[compared.rows[held]] += (2.0, -1.0, 0.5)
    again = compare(replace(small, points=points), PLAN)
    for one, other in zip(compared.scored, again.scored, strict=True):
        before = small.points[compared.rows[held]] - one.by_waypoint[held]
        after = points[compared.rows[held]] - other.by_waypoint[held]
        np.testing.assert_allclose(after, before, rtol=0.0, atol=1e-9)
        assert np.isfinite(one.by_waypoint).all()


def test_the_names_of_the_table(compared: RegressionComparison) -> None:
    assert [s.predictor.name for s in compared.scored] == [
        NOMINAL,
        "MLS-SVR on positions",
        "level 2",
        "MLS-SVR on residuals of level 2",
        "level 3",
        "MLS-SVR on residuals of level 3",
    ]
    assert compared.asked.predictor.name == "MLS-SVR on residuals of level 2"
    np.testing.assert_allclose(mae(np.array([[1.0, -2.0, 3.0], [-1.0, 2.0, 3.0]])), [1.0, 2.0, 3.0, 2.0])


def test_waypoints_are_standstills(small: Dataset) -> None:
    """Three samples that creep at each of 30 waypoints form one waypoint each."""
    waypoint = waypoints_of(small)
    np.testing.assert_array_equal(waypoint, np.repeat(np.arange(30), 3))
    assert np.unique(small.conditions.joints, axis=0).shape[0] == 90


def test_the_region_holds_its_samples_and_no_turned_wrist() -> None:
    joints = waypoints(np.random.default_rng(0))
    region = Region.of(joints)
    assert region.holds(joints).all()
    assert region.holds(joints + 0.3 * DEG / np.sqrt(6.0)).all()
    for joint in (3, 4):  # joint 4 alone stays within its own range, but tilts the tool
        assert not region.holds(joints + 5.0 * DEG * np.eye(6)[joint]).any()
    assert not region.holds(np.full((1, 6), np.nan)).any()


def with_regression(data: Dataset, folder: Path, on: str = "residuals", features: str = "turns") -> Path:
    """A model file whose regression gained something."""
    found = compare(
        data, ComparisonRequest(RegressionRequest.of(on, features, "linear"), level=2)
    ).asked.predictor
    assert found.found is not None
    assert found.regression is not None
    save_model(folder / "model.json", found.found, regression=found.regression)
    saved = load_model(folder / "model.json")
    assert saved.regression is not None
    np.testing.assert_allclose(
        saved.regression.predict(saved.model, saved.estimate, data.conditions),
        found.predict(data.conditions),
        rtol=0.0,
        atol=1e-9,
    )
    return folder / "model.json"


@pytest.mark.parametrize(("on", "features"), [("residuals", "turns"), ("positions", "tool-down")])
def test_saved_and_corrected_with(on: str, features: str, small: Dataset, tmp_path: Path) -> None:
    """The file predicts as trained, and corrected joints reach the nominal positions."""
    saved = load_model(with_regression(small, tmp_path, on, features))
    joints = small.conditions.joints[::9]
    done = correct(
        saved.model, saved.estimate, joints, StatedConditions(loads=saved.loads), regression=saved.regression
    )
    assert done.good.all()
    there = replace(small.conditions.take(np.arange(0, len(small), 9)), joints=done.joints)
    placed_only = np.zeros_like(saved.estimate)
    placed_only[saved.model.of_base] = saved.estimate[saved.model.of_base]
    meant = BoundModel(saved.model, replace(there, joints=joints)).predict(placed_only)
    assert saved.regression is not None
    landed = saved.regression.predict(saved.model, saved.estimate, there)
    np.testing.assert_allclose(landed, meant, rtol=0.0, atol=1e-5)
    uncorrected = saved.regression.predict(saved.model, saved.estimate, replace(there, joints=joints))
    assert np.abs(uncorrected - meant).max() > 0.1
    turned = correct(
        saved.model,
        saved.estimate,
        joints + 5.0 * DEG * np.eye(6)[4],
        StatedConditions(loads=saved.loads),
        regression=saved.regression,
    )
    assert set(turned.status) == {Status.OUTSIDE_REGION}
    assert np.isnan(turned.joints).all()


def test_corrected_where_the_world_is_the_nominal_base(tmp_path: Path) -> None:
    """The base is then part of the error, and turns what the regression says: by 3 mrad here."""
    rows, header = rows_of(2, count=30, samples=90, waves=8e-4)
    leaning = np.eye(4)
    leaning[:3, :3] = Rotation.from_rotvec((0.0, 0.003, 0.0)).as_matrix()
    move_rows(rows, leaning @ np.linalg.inv(WORLD))
    data = read_dataset(write_files(tmp_path, rows, header | {"world": "nominal"}))
    found = compare(data, ComparisonRequest(RegressionRequest("residuals", "turns"), level=2)).asked.predictor
    assert found.regression is not None
    joints = data.conditions.joints[::9]
    done = correct(
        found.model, found.estimate, joints, StatedConditions(), regression=found.regression, target="T1"
    )
    moved = np.abs(done.joints - joints).max()
    assert 0.001 < moved < 0.01
    there = replace(data.conditions.take(np.arange(0, len(data), 9)), joints=done.joints)
    meant = np.array([chain(ROBOT, q, {}, REFLECTOR).real[:3, 3] for q in joints])
    np.testing.assert_allclose(found.predict(there), meant, rtol=0.0, atol=1e-5)


def test_the_diagnosis_joins_the_table(small: Dataset, monkeypatch: pytest.MonkeyPatch) -> None:
    """A diagnosis without effects repeats the rows of level 2, fitted again in every part."""
    monkeypatch.setattr(compare_module, "diagnose", lambda data: SimpleNamespace(final=identify(data)))
    found = compare(small, replace(PLAN, compare=False, diagnosed=True))
    by_name = {s.predictor.name: s for s in found.scored}
    assert list(by_name)[-2:] == ["diagnosis", "MLS-SVR on residuals of diagnosis"]
    np.testing.assert_allclose(by_name["diagnosis"].by_waypoint, by_name["level 2"].by_waypoint, atol=1e-9)
    assert any("The diagnosis leaves" in said for said in findings(found, ()))


def test_a_gaussian_kernel_comes_back_too(small: Dataset, tmp_path: Path) -> None:
    found = compare(
        small, ComparisonRequest(RegressionRequest("residuals", "tool-down", "rbf"), level=2)
    ).asked.predictor
    assert found.found is not None
    assert found.regression is not None
    save_model(tmp_path / "m.json", found.found, regression=found.regression)
    saved = load_model(tmp_path / "m.json").regression
    assert saved is not None
    assert saved.svr.kernel == found.regression.svr.kernel
    joints = small.conditions.joints
    np.testing.assert_array_equal(saved.shift(ROBOT, joints), found.regression.shift(ROBOT, joints))


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("method", "svr"),
        ("on", "angles"),
        ("features", "cubes"),
        ("kernel", "poly"),
        ("weights", [[0.0, 0.0]]),
        ("mean", None),
        ("offset_mm", [0.0, 0.0, 1e300]),
        ("trained_at_rad", [[0.0] * 6]),
        ("gamma", -1.0),
    ],
)
def test_a_spoilt_regression_is_refused_by_key(
    key: str, value: object, small: Dataset, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    document = json.loads(request.getfixturevalue("model_text"))
    document["regression"][key] = value
    path = tmp_path / "model.json"
    path.write_text(json.dumps(document), encoding="utf-8")
    with pytest.raises(DataError, match="content_sha256"):
        load_model(path)
    path.write_text(json.dumps({**document, "content_sha256": content_hash(document)}), encoding="utf-8")
    with pytest.raises(DataError, match=f"regression.{key}"):
        load_model(path)


@pytest.fixture(scope="module")
def model_text(small: Dataset, tmp_path_factory: pytest.TempPathFactory) -> str:
    return with_regression(small, tmp_path_factory.mktemp("model")).read_text(encoding="utf-8")


def test_a_regression_that_shifts_too_far_is_refused(model_text: str, tmp_path: Path) -> None:
    document = json.loads(model_text)
    document["regression"]["offset_mm"] = [40.0, 0.0, 0.0]
    document["content_sha256"] = content_hash(document)
    (tmp_path / "m.json").write_text(json.dumps(document), encoding="utf-8")
    with pytest.raises(DataError, match="shifts the point by up to 4"):
        load_model(tmp_path / "m.json")


def test_one_reflector_on_the_last_axis(small: Dataset) -> None:
    """One reflector suffices only if the last zero is kept; `regress` holds it."""
    with pytest.raises(DataError, match="hold = "):
        identify(small)
    found = identify(freeing(small, LEVEL_2))
    assert found.converged
    assert "theta6" not in found.model.index


@pytest.mark.parametrize(
    ("case", "says"),
    [
        ("one waypoint", "one waypoint"),
        ("two waypoints", "2 waypoints"),
        ("few", "parameters"),
        ("no points", "with points, and the regression"),
    ],
)
def test_what_cannot_be_compared_is_refused(case: str, says: str, small: Dataset) -> None:
    waypoint = waypoints_of(small)
    kept = {"one waypoint": waypoint < 1, "two waypoints": waypoint < 2, "few": waypoint < 4}.get(case)
    data = small
    if kept is not None:
        data = replace(small, sets=np.where(kept, "calibration", "validation"))
    else:
        data = replace(
            small, points=np.full_like(small.points, np.nan), lengths=np.ones(len(small)), sets=small.sets
        )
    with pytest.raises(DataError, match=says) as caught:
        compare(data, PLAN)
    assert small.name in str(caught.value)


def test_features_of_another_structure_are_refused(tmp_path: Path) -> None:
    for name in set(SETS) - {"turns"}:
        with pytest.raises(DataError, match="--features turns"):
            products_of(name, load_robot("abb-irb120"))
    with pytest.raises(DataError, match="--features"):
        products_of("cubes", ROBOT)
    with pytest.raises(DataError, match="--kernel"):
        RegressionRequest.of("residuals", "turns", "poly")


def test_two_targets_have_no_one_position(tmp_path: Path) -> None:
    rows, header = rows_of(2, count=20, samples=60)
    header["tool_targets"] = {"T1": list(REFLECTOR), "T2": [0.0, 0.0, 169.6]}
    for row in rows[::2]:
        row["tool_target"] = "T2"
    data = read_dataset(write_files(tmp_path, rows, header))
    with pytest.raises(DataError, match="several tool targets"):
        compare(data, ComparisonRequest(RegressionRequest("positions", "tool-down"), level=2))
