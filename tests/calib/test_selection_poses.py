"""Test the selection of real poses: gain of a candidate, content of the list, prediction."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from calib import DataError, StatedConditions, choose, load_robot
from calib.array import Array
from calib.data import Noise
from calib.fit import expanded
from calib.model import BoundModel, conditions_at
from calib.selection import Curve, Setup, candidates_of, curve_of
from calib.selection.coverage import cells_of, filling, missing
from calib.selection.exchange import best_of_starts, log_det, optimum
from calib.selection.pose_rows import PoseRows
from calib.units import DEG

ROBOT = load_robot("abb-irb120")
TARGETS = {"T1": (0.0, 0.0, 125.0), "T2": (75.0, 93.675, 215.0), "T3": (150.0, 0.0, 125.0)}
# Nubiola 2.5.2: the torque keeps its sign
LOW = np.array([-90, 0, -80, -150, -90, -180]) * DEG
HIGH = np.array([90, 110, 70, 150, 90, 180]) * DEG
STILL = Noise("isotropic", sigma_mm=0.02)
TRACKER = Noise(
    "tracker",
    station_mm=(2400.0, -900.0, 350.0),
    range_mm=0.01,
    range_ppm=2.0,
    transverse_mm=0.01,
    transverse_ppm=6.0,
    repeatability=0.0008 * DEG,
)


def setup(targets: Sequence[str] = ("T1", "T2", "T3"), noise: Noise = TRACKER) -> Setup:
    return Setup(ROBOT, {name: TARGETS[name] for name in targets}, noise)


def poses(n: int, seed: int = 1) -> Array:
    return np.random.default_rng(seed).uniform(LOW, HIGH, (n, 6))


def test_rows_are_the_whitened_derivative_of_the_prediction() -> None:
    joints = poses(40)
    given = setup(("T2", "T3"), STILL)
    found = candidates_of(given, joints)
    model = given.model()
    assert found.rows.shape == (40, 6, len(found.parameters))
    assert np.mean(np.sum(found.rows**2, axis=1), axis=0) == pytest.approx(1.0)
    for t, target in enumerate(("T2", "T3")):
        design = BoundModel(model, conditions_at(model, joints, StatedConditions(), target))
        for j in (0, 5, 12, len(found.parameters) - 1):
            step = np.zeros(len(model.parameters))
            step[model.index[found.parameters[j].name]] = 1e-4 * found.unit[j]
            difference = (design.predict(step) - design.predict(-step)) / 2e-4
            assert found.points[:, t, :, j] == pytest.approx(difference, rel=1e-5, abs=1e-7)
            assert found.rows[:, 3 * t : 3 * t + 3, j] == pytest.approx(difference / 0.02, rel=1e-5, abs=1e-5)


def test_noise_along_and_across_the_beam_weighs_the_rows() -> None:
    """The information about a shift of the base is the inverse covariance of the reading itself."""
    quiet = replace(TRACKER, repeatability=0.0)
    given = replace(setup(("T2",), quiet), groups=("base",))
    found = candidates_of(given, poses(5))
    shift = found.rows[:, :, :3] / found.unit[:3]
    model = given.model()
    conditions = conditions_at(model, found.joints, StatedConditions(), "T2")
    covariance = quiet.of_points(conditions.point, np.full((5, 3), np.nan))
    assert shift.transpose(0, 2, 1) @ shift == pytest.approx(np.linalg.inv(covariance), rel=1e-9)


def test_what_the_candidates_cannot_tell_is_dropped_and_named() -> None:
    assert {d.name: d.confounded_with for d in candidates_of(setup(), poses(50)).dropped} == {"d3": ("d2",)}
    on_axis = candidates_of(setup(("T1",)), poses(50)).dropped
    assert {d.name for d in on_axis} == {"d3", "alpha6", "a6", "theta6", "c6"}
    assert {d.name: d.confounded_with for d in on_axis}["c6"] == ()


@pytest.mark.parametrize(("targets", "count"), [(("T2",), 50), (("T1", "T2", "T3"), 38)])
def test_five_thousand_candidates_reach_the_bound(targets: Sequence[str], count: int) -> None:
    blocks = PoseRows.of(candidates_of(setup(targets, STILL), poses(5000)).rows)
    best = optimum(blocks)
    found = best_of_starts(blocks, best, count)
    assert best.efficiency(log_det(blocks, found), count) >= 0.985
    random = log_det(blocks, np.arange(count))
    assert best.efficiency(random, count) < 0.85


def test_list_visits_every_part_of_every_range_at_little_cost() -> None:
    found = candidates_of(setup(), poses(800))
    choice = choose(setup(), found, 40, starts=2, seed=3)
    assert len(set(choice.selection.tolist())) == 40
    assert not missing(cells_of(found.joints), choice.selection).any()
    assert 0 < len(choice.filling) <= 8
    assert set(choice.filling) <= set(choice.selection.tolist())
    assert choice.efficiency_core - 0.02 < choice.efficiency < choice.efficiency_core < 1.0
    assert choice.warnings == ()
    again = choose(setup(), found, 40, starts=2, seed=3)
    assert again.selection.tolist() == choice.selection.tolist()


def test_list_without_filling_is_the_core_and_names_what_it_leaves_out() -> None:
    found = candidates_of(setup(("T2",)), poses(800))
    choice = choose(setup(("T2",)), found, 20, share=0.0, starts=2)
    assert choice.filling == ()
    assert choice.efficiency == choice.efficiency_core
    assert any("Joint" in text and "has no pose from" in text for text in choice.warnings)
    assert any("only T2" in text and "joint 6" in text for text in choice.warnings)
    with pytest.raises(DataError, match="share"):
        choose(setup(), found, 20, share=1.5)


def test_predicted_standard_errors_are_those_of_the_information() -> None:
    found = candidates_of(setup(), poses(300))
    choice = choose(setup(), found, 30, starts=1)
    rows = (found.rows / found.unit)[choice.selection].reshape(90 * 3, -1)
    size = np.linalg.norm(rows, axis=0)
    inverse = np.linalg.pinv(rows / size)
    assert choice.std == pytest.approx(np.linalg.norm(inverse, axis=1) / size, rel=1e-6)


def test_a_parameter_that_is_hardly_seen_is_named() -> None:
    loud = Noise("isotropic", sigma_mm=2.0)
    choice = choose(setup(noise=loud), candidates_of(setup(noise=loud), poses(200)), 20, starts=1)
    assert any(text.startswith("c6 will hardly be seen") for text in choice.warnings)


def test_filling_takes_the_candidate_that_fills_most() -> None:
    joints = np.array([[0.0, 0.0], [1.0, 1.0], [1.0, 0.0], [0.0, 1.0]])
    cells = cells_of(joints, bins=2)
    wanted = missing(cells, [0])
    assert wanted.tolist() == [[False, True], [False, True]]
    assert filling(cells, wanted, 5, np.ones(4)) == [1]
    assert filling(cells, wanted, 0, np.ones(4)) == []
    assert filling(cells, missing(cells, [1]), 5, np.arange(4.0)) == [0]


def test_curve_is_the_uncertainty_of_the_prediction() -> None:
    given = setup(("T2", "T3"))
    found = candidates_of(given, poses(400))
    choice = choose(given, found, 30, starts=1)
    curve = curve_of(found, choice.selection)
    assert curve.counts.tolist() == [10, 20, 30, 40, 50, 60]
    assert np.all(np.diff(curve.mean) < 0.0)
    assert np.all(curve.of_model < curve.largest)
    rows = found.rows[choice.selection].reshape(-1, len(found.parameters))
    covariance = np.linalg.inv(rows.T @ rows)
    of_t3 = np.einsum("nam,mk,nbk->nab", found.points[:, 1], covariance, found.points[:, 1])
    of_t2 = np.einsum("nam,mk,nbk->nab", found.points[:, 0], covariance, found.points[:, 0])
    largest = max(expanded(of_t2).max(), expanded(of_t3).max())
    assert curve.of_model[2] == pytest.approx(largest, rel=1e-6)
    with_robot = max(
        expanded(of_t2 + found.repeatability[:, 0]).max(), expanded(of_t3 + found.repeatability[:, 1]).max()
    )
    assert curve.at(30) == pytest.approx(with_robot, rel=1e-6)


def test_stopping_rule() -> None:
    u = np.array([0.10, 0.08, 0.07, 0.069, 0.0689])
    curve = Curve(np.array([10, 20, 30, 40, 50]), u, u, u)
    assert curve.enough() == 30
    assert curve.enough(0.001) is None
    assert curve.reaches(0.08) == 20
    assert curve.reaches(0.01) is None


@pytest.mark.parametrize(
    ("change", "joints", "words"),
    [
        ({"groups": ("base", "wings")}, poses(30), "'wings' is not a group"),
        ({"groups": ()}, poses(30), "nothing to select for"),
        ({"targets": {}}, poses(30), "nothing to select for"),
        ({"noise": Noise("isotropic")}, poses(30), "noise is zero"),
        ({}, poses(30)[:, :5], r"Give \(poses, 6\)"),
        ({}, poses(0), r"Give \(poses, 6\)"),
        ({}, np.where(np.eye(30, 6) > 0, np.nan, poses(30)), "not finite"),
    ],
)
def test_bad_input_is_refused(change: dict[str, object], joints: Array, words: str) -> None:
    with pytest.raises(DataError, match=words):
        candidates_of(replace(setup(), **change), joints)  # type: ignore[arg-type]
