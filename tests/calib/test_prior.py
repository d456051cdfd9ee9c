"""Test type priors: learned without earlier priors, and overruled by the readings."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from calib import DataError, Dataset, choose, identify, save_model
from calib.data import Noise
from calib.fit.type_prior import MOST_OUTSIDE, TypeEffect, TypePrior
from calib.prior import TypeMember, learn, load_prior, save_prior
from calib.prior.reml import hierarchy
from calib.saved import as_saved
from calib.saved.model_checks import content_hash
from calib.selection import Setup, beside_type, candidates_of, curve_of
from calib.units import to_internal
from tests.benchmarks.coverage import RANGE, ROBOT, TARGETS
from tests.benchmarks.priors import CELLS, Type, a_type, data_of, first_poses, learnt

CELL, ROBOTS = CELLS[0], 8


@pytest.fixture(scope="module")
def kind() -> Type:
    return a_type(1)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("type")


@pytest.fixture(scope="module")
def prior(kind: Type, folder: Path) -> TypePrior:
    return learnt(CELL, kind, 1, folder, ROBOTS)


def new_robot(kind: Type, seed: int = 3, /, **off: float) -> Dataset:
    """Simulate a further robot of the type; `off` gives offsets of parameters in spreads."""
    return data_of(CELL, kind.robot(np.random.default_rng(seed), off), seed)[0]


def members_of(folder: Path) -> list[TypeMember]:
    return [TypeMember.read(folder / f"{i}.json") for i in range(ROBOTS)]


def test_mean_and_spread_of_values_known_alike_are_those_of_the_books() -> None:
    """With equally known robots, mean and spread are those of textbooks.

    The mean is plain, and the spread is that of the values less their own errors.
    """
    rng = np.random.default_rng(2)
    values, own = rng.normal(3.0, 1.0, (25, 2)), np.array([0.3, 0.4])
    precision = np.broadcast_to(np.diag(own**-2), (25, 2, 2))
    found = hierarchy(precision, values * own**-2, np.ones(2))
    assert found.member.all()
    np.testing.assert_allclose(found.mean, values.mean(axis=0), rtol=1e-9)
    variance = values.var(axis=0, ddof=1)
    np.testing.assert_allclose(found.spread**2, variance - own**2, rtol=2e-3)
    np.testing.assert_allclose(found.mean_std**2, variance / 25, rtol=2e-3)
    np.testing.assert_allclose(  # of a variance by its own chi-square
        (found.spread + found.spread_std) ** 2 - found.spread**2, variance * np.sqrt(2 / 24), rtol=1e-2
    )


def test_readings_that_leave_a_direction_open_still_tell_the_others() -> None:
    """Means of the type are recovered if half of the robots know only a sum of two parameters."""
    rng = np.random.default_rng(5)
    truth = np.array([1.0, -2.0]) + 0.1 * rng.normal(size=(40, 2))
    rows = np.where(np.arange(40)[:, None, None] % 2, np.eye(2) * 50.0, np.array([[50.0, 50.0], [0.0, 0.0]]))
    precision = rows.transpose(0, 2, 1) @ rows
    right = (precision @ truth[:, :, None])[:, :, 0]
    found = hierarchy(precision, right, np.ones(2))
    assert np.all(np.abs(found.mean - (1.0, -2.0)) < 4.0 * found.mean_std)
    assert np.all((found.mean_std < 0.05) & (found.spread > 0.06) & (found.spread < 0.15))


def test_a_stranger_among_robots_is_named_and_teaches_nothing() -> None:
    rng = np.random.default_rng(8)
    values = rng.normal(0.0, 1.0, (30, 3))
    precision = np.broadcast_to(100.0 * np.eye(3), (30, 3, 3))
    clean = hierarchy(precision, 100.0 * values, np.ones(3))
    values[7, 1] = 25.0
    found = hierarchy(precision, 100.0 * values, np.ones(3))
    assert np.argwhere(~found.member).tolist() == [[7, 1]]
    assert found.z[7, 1] > 15.0
    assert found.spread[1] < 1.2 * clean.spread[1]
    np.testing.assert_allclose(found.mean[[0, 2]], clean.mean[[0, 2]], rtol=1e-6)


def test_a_type_comes_back_from_its_robots(kind: Type, folder: Path, prior: TypePrior) -> None:
    lesson = learn(members_of(folder))
    assert not lesson.outliers
    assert not lesson.left_out
    assert [d.name for d in lesson.redundant] == ["d3"]  # d2 stands for both
    for p in lesson.parameters:
        off = to_internal(p.mean, p.unit) - kind.mean[p.name]
        assert abs(off) < 4.5 * to_internal(p.mean_std, p.unit), p.name
        assert p.spread + 4.0 * p.spread_std > p.spread_std
    assert {"a3", "d2", "c3"} <= set(prior.shares)
    assert "d3" not in prior.shares
    assert not any(name.startswith("base") for name in prior.shares)


def test_a_robot_that_knew_the_type_teaches_what_its_readings_alone_say(kind: Type, prior: TypePrior) -> None:
    """A prior does not confirm itself: it is removed from a robot before learning."""
    dataset = new_robot(kind)
    names = list(prior.shares)
    plain, beside = (
        TypeMember(Path("m.json"), "", as_saved(found)).told(names)
        for found in (identify(dataset), identify(dataset, prior=prior))
    )
    size = np.sqrt(np.diag(plain[0]))
    np.testing.assert_allclose(beside[0] / np.outer(size, size), plain[0] / np.outer(size, size), atol=0.02)
    said = np.linalg.solve(plain[0] + np.diag(1e-3 * size**2), plain[1])
    again = np.linalg.solve(beside[0] + np.diag(1e-3 * size**2), beside[1])
    assert np.max(np.abs(said - again) * size) < 0.1


def test_a_fit_beside_its_type_is_the_product_of_both(kind: Type, prior: TypePrior) -> None:
    dataset = first_poses(new_robot(kind), 24)
    plain, beside = identify(dataset), identify(dataset, prior=prior)
    assert beside.beside is not None
    assert not beside.beside.outside
    names = [p.name for p in beside.model.parameters]
    at = [plain.model.index[name] for name in names]
    usual = np.diag(1.0 / plain.held_std[at] ** 2)
    alone = np.linalg.inv(plain.covariance[np.ix_(at, at)]) - usual
    noise = max(plain.noise_scale, 1.0) / max(beside.noise_scale, 1.0)
    both = noise**2 * alone + np.diag(1.0 / beside.held_std**2)
    mean = beside.model.prior_mean
    right = noise**2 * alone @ plain.estimate[at] + np.diag(1.0 / beside.held_std**2) @ mean
    spread = beside.standard_errors
    assert np.max(np.abs(np.linalg.solve(both, right) - beside.estimate) / spread) < 0.2  # one is linear
    np.testing.assert_allclose(np.sqrt(np.diag(np.linalg.inv(both))), spread, rtol=0.05)
    decided = {w.name: w.decided for w in beside.weighed}
    assert set(decided) == set(prior.shares)
    assert max(decided.values()) > 0.5  # 24 poses in a third of the ranges do not say everything


def test_validation_rows_never_touch_the_prior(kind: Type, prior: TypePrior) -> None:
    dataset = new_robot(kind)
    points = dataset.points.copy()
    points[dataset.validation_rows] += 77.0
    one, other = (identify(each, prior=prior) for each in (dataset, replace(dataset, points=points)))
    np.testing.assert_array_equal(one.estimate, other.estimate)
    assert one.beside == other.beside


def test_a_parameter_outside_the_type_is_the_readings_alone(kind: Type, prior: TypePrior) -> None:
    dataset = new_robot(kind, a3=12.0)
    found, plain = identify(dataset, prior=prior), identify(dataset)
    assert found.beside is not None
    assert [each.name for each in found.beside.outside] == ["a3"]
    assert not found.beside.left_out
    assert any("a3 lies" in warning for warning in found.warnings)
    off = found.estimate[found.model.index["a3"]] - plain.estimate[plain.model.index["a3"]]
    assert abs(off) < 2.0 * plain.standard_errors[plain.model.index["a3"]]
    assert "a3" not in {w.name for w in found.weighed}


def test_a_robot_that_is_no_member_is_fitted_without_its_type(kind: Type, prior: TypePrior) -> None:
    names = [name for name in kind.mean if "." not in name and name != "d3"]
    dataset = new_robot(kind, **dict.fromkeys(names, 6.0))
    found, plain = identify(dataset, prior=prior), identify(dataset)
    assert found.beside is not None
    assert found.beside.left_out
    assert len(found.beside.outside) <= MOST_OUTSIDE + 1
    assert not found.model.of_type.any()
    rows = dataset.conditions.take(dataset.validation_rows)
    one, other = found.predict(rows), plain.predict(rows)
    assert np.sqrt(np.mean((one - other) ** 2)) < 0.01


def test_what_is_frequent_in_a_type_takes_half_of_the_tries(prior: TypePrior) -> None:
    often = replace(
        prior,
        found=(
            TypeEffect("backlash:j4", {}, 6),
            TypeEffect("periodic:j2:n2", {"order": 2.0}, 2),
            TypeEffect("x", {}, 0),
        ),
    )
    assert [(e.label, e.share) for e in often.expected] == [("backlash:j4", 0.375), ("periodic:j2:n2", 0.125)]
    assert prior.expected == ()


def test_a_prior_that_knows_nothing_saves_no_pose_and_one_that_knows_saves_some(prior: TypePrior) -> None:
    rng = np.random.default_rng(1)
    middle, half = RANGE.mean(axis=1), np.ptp(RANGE, axis=1) / 6.0
    joints = rng.uniform(middle - half, middle + half, (120, 6))
    setup = Setup(ROBOT, {"T2": TARGETS["T2"]}, Noise("isotropic", sigma_mm=0.1), ("base", *prior.groups))
    found = candidates_of(setup, joints)
    selection = choose(setup, found, 30, starts=1).selection
    without = curve_of(found, selection)
    saved = beside_type(found, selection, without, prior)
    assert saved.reached is not None
    assert saved.reached < 24
    assert f"{saved.reached} of 30 poses" in saved.in_words
    assert np.all(saved.curve.largest < without.largest)
    silent = beside_type(found, selection, without, replace(prior, shares={}))
    assert silent.reached == 30
    assert silent.known == ()
    assert "still takes 30" in silent.in_words


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda d: d.update(format="truepose-prior/2"), "format"),
        (lambda d: d.update(program="0.0.9"), "program"),
        (lambda d: d.update(robots=2), "robots"),
        (lambda d: d["parameters"][3].update(of_next=0.0), "must be above 0"),
        (lambda d: d["parameters"][3].update(of_next=-1.0), "must be above 0"),
        (lambda d: d["parameters"][3].update(mean=None), "a finite number is needed"),
        (lambda d: d["parameters"][3].update(unit="inch"), "inch"),
        (lambda d: d["parameters"].append(d["parameters"][3]), "given twice"),
        (lambda d: d.pop("redundant"), "redundant"),
    ],
)
def test_a_prior_that_cannot_be_used_is_refused_by_name(
    prior: TypePrior, folder: Path, tmp_path: Path, change: Callable[[dict[str, Any]], Any], said: str
) -> None:
    document = json.loads((folder / "prior.json").read_text(encoding="utf-8"))
    change(document)
    document["content_sha256"] = content_hash(document)
    path = tmp_path / "prior.json"
    path.write_text(json.dumps(document), encoding="utf-8")
    with pytest.raises(DataError, match=said):
        load_prior(path)


@pytest.mark.parametrize("text", ["NaN", "Infinity", "1e999"])
def test_a_spread_that_is_no_number_is_refused(
    prior: TypePrior, folder: Path, tmp_path: Path, text: str
) -> None:
    written = (folder / "prior.json").read_text(encoding="utf-8")
    first = json.loads(written)["parameters"][0]["of_next"]
    path = tmp_path / "prior.json"
    path.write_text(written.replace(f'"of_next": {first}', f'"of_next": {text}'), encoding="utf-8")
    with pytest.raises(DataError):
        load_prior(path)


def test_a_changed_prior_is_refused(prior: TypePrior, folder: Path, tmp_path: Path) -> None:
    written = (folder / "prior.json").read_text(encoding="utf-8")
    path = tmp_path / "prior.json"
    path.write_text(written.replace('"robots": 8', '"robots": 9', 1), encoding="utf-8")
    with pytest.raises(DataError, match="content_sha256"):
        load_prior(path)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"robot_sha256": "0"}, "another table"),
        ({"robot": "ur5", "robot_sha256": "0"}, "type 'ur5'"),
        ({"coupling": "parallelogram"}, "joint_coupling"),
        ({"groups": ("geometry",)}, "freed"),
    ],
)
def test_the_prior_of_another_type_is_refused(
    kind: Type, prior: TypePrior, change: dict[str, Any], said: str
) -> None:
    with pytest.raises(DataError, match=said):
        identify(new_robot(kind), prior=replace(prior, **change))


def test_models_that_cannot_be_learnt_from_are_refused(
    prior: TypePrior, folder: Path, kind: Type, tmp_path: Path
) -> None:
    members = members_of(folder)
    with pytest.raises(DataError, match=r"too few models.*: 4\."):
        learn(members[:4])
    with pytest.raises(DataError, match="count twice"):
        learn([*members, members[2]])
    real = replace(members[1], saved=replace(members[1].saved, simulated=True))
    with pytest.raises(DataError, match="simulated"):
        learn([members[0], real, *members[2:]])
    older = replace(members[1], saved=replace(members[1].saved, held_std=None))
    with pytest.raises(DataError, match="held_std"):
        learn([members[0], older, *members[2:]])
    lean = identify(new_robot(kind), groups=("base", "geometry", "parallel_twist"))
    save_model(tmp_path / "lean.json", lean)
    found = learn([*members, TypeMember.read(tmp_path / "lean.json")])
    assert [name for name, _ in found.left_out] == ["lean.json"]
    assert "compliance" in found.left_out[0][1]
    save_prior(tmp_path / "p.json", found)
    assert load_prior(tmp_path / "p.json").shares == prior.shares
