"""Test placing, judging, groups, hold-outs and the comparison of two calibrations.

The campaigns are simulated.
"""

from __future__ import annotations

import copy
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from calib.arm.robot import load_robot
from calib.data.dataset import Dataset
from calib.data.read import read_dataset
from calib.errors import DataError
from calib.fit.identification import IdentificationFit
from calib.fit.identify import identify
from calib.fit.placing import base_model_of, place_nominal
from calib.fit.statistics import distances
from calib.model.model import BoundModel
from calib.saved.model_file import CalibratedModel, load_model, save_model
from calib.validation import (
    apart,
    differences,
    hold_outs,
    judge,
    judge_repeats,
    place,
    refuse_incomparable,
    refuse_other_robot,
)
from calib.validation.holdout import without
from calib.validation.judge import by_distance, grouped, groupings, rotation_vectors
from mocks.campaign import make_campaign
from tests.calib.campaigns import dataset_of, exact, move_rows, with_points, write_files
from tests.calib.cells import NOISE, Cell

POSE = np.eye(4)
POSE[:3, :3] = Rotation.from_rotvec([0.4, -0.7, 1.9]).as_matrix()
POSE[:3, 3] = (1500.0, -300.0, 250.0)


def saved_of(found: IdentificationFit, path: Path) -> CalibratedModel:
    save_model(path, found)
    return load_model(path)


@pytest.fixture(scope="module")
def night(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    """Simulate two series of one robot in two frames, without noise.

    The target names are shared, their positions are not.
    """
    rows, header = exact(make_campaign(seed=5, n=120, n_validation=40, effects=[], repeatability_deg=0.0))
    later = copy.deepcopy(rows)
    move_rows(later, POSE)
    for name, part in (("day", rows), ("night", later)):
        for row in part:
            row |= {"series": name, "reading_id": f"{name}-{row['reading_id']}"}
    header |= {
        "world": "free",
        "model": {"fit": ["base", "geometry", "parallel_twist", "compliance", "tool"]},
    }
    return read_dataset(write_files(tmp_path_factory.mktemp("night"), [*rows[::2], *later[1::2]], header))


@pytest.fixture(scope="module")
def day(tmp_path_factory: pytest.TempPathFactory) -> tuple[Dataset, IdentificationFit]:
    campaign = make_campaign(seed=4, n=90, n_validation=60, effects=[], reference_every=10)
    dataset = dataset_of(campaign, tmp_path_factory.mktemp("day"))
    return dataset, identify(dataset)


class TestPlacing:
    def test_a_robot_is_found_again_in_another_frame(self, day: tuple[Dataset, IdentificationFit]) -> None:
        dataset, found = day
        moved = with_points(dataset, dataset.points @ POSE[:3, :3].T + POSE[:3, 3])
        model, estimate = place(moved, found.model, found.estimate)
        here = place(dataset, found.model, found.estimate)
        expected = BoundModel(here[0], dataset.conditions).predict(here[1]) @ POSE[:3, :3].T + POSE[:3, 3]
        assert np.abs(BoundModel(model, moved.conditions).predict(estimate) - expected).max() < 1e-6
        # near the identification's own prediction, which weighs the readings by their noise
        own = found.predict(dataset.conditions)
        assert distances(BoundModel(here[0], dataset.conditions).predict(here[1]), own).max() < 0.02

    def test_targets_are_fitted_where_the_model_frees_them(self, night: Dataset) -> None:
        found = identify(night)
        model, estimate = place(night, found.model, found.estimate)
        errors = distances(BoundModel(model, night.conditions).predict(estimate), night.points)
        assert errors[night.usable].max() < 1e-4
        assert not any(effect.owner != "robot" for effect in model.effects)

    def test_gross_errors_do_not_steer(self, day: tuple[Dataset, IdentificationFit]) -> None:
        dataset, found = day
        clean = place(dataset, found.model, found.estimate)
        points = dataset.points.copy()
        points[np.flatnonzero(dataset.fit_rows)[::12]] += 30.0
        spoilt = place(with_points(dataset, points), found.model, found.estimate)
        apart_ = distances(*(BoundModel(m, dataset.conditions).predict(e) for m, e in (clean, spoilt)))
        assert apart_.max() < 0.05

    def test_a_series_without_readings_is_refused(self, night: Dataset) -> None:
        found = identify(night)
        few = night.conditions.series != 1
        with pytest.raises(DataError, match="series 'night' has 0 points"):
            place(night, found.model, found.estimate, night.fit_rows & few)


class TestJudging:
    def test_figures_are_those_of_the_rows(self, day: tuple[Dataset, IdentificationFit]) -> None:
        dataset, found = day
        rows = dataset.validation_rows
        errors = distances(found.predict(dataset.conditions.take(rows)), dataset.points[rows])
        judged = judge("m", dataset, rows, found.model, found.estimate, (300.0, 0.0, 400.0))
        assert judged.position is not None
        assert judged.position.n == 60
        assert judged.position.mean == pytest.approx(errors.mean())
        assert judged.position.max == pytest.approx(errors.max())
        assert judged.pairs["main"].n == 60 * 59 // 2
        assert judged.orientation is None
        titles = [grouping.title for grouping in judged.groupings]
        assert titles[0] == "target"
        assert {"branch", "approach of j6", "distance from the point"} <= set(titles)
        for grouping in judged.groupings:
            assert sum(found.n for _, found in grouping.groups) == 60
            assert max(found.max for _, found in grouping.groups) == judged.position.max

    def test_distances_are_judged_by_their_lengths(self, tmp_path: Path) -> None:
        cell = Cell(place=POSE)
        cell.measure("l", 160, noise=NOISE, validation=40)
        dataset = cell.dataset(tmp_path)
        found = identify(dataset)
        judged = judge("m", dataset, dataset.validation_rows, found.model, found.estimate)
        assert (judged.position, judged.orientation, judged.pairs) == (None, None, {})
        assert judged.error is judged.length
        assert judged.error.n == 40
        assert judged.error.rms < 3.0 * NOISE["l"]
        nominal = judge(
            "n", dataset, dataset.validation_rows, *place_nominal(dataset, base_model_of(dataset))
        )
        assert nominal.error.rms > 10.0 * judged.error.rms
        with pytest.raises(DataError, match="base target 'B1', of which"):
            judge("m", dataset, dataset.usable, replace(found.model, anchors={}), found.estimate)

    def test_pairs_stay_within_a_series(self, night: Dataset) -> None:
        found = identify(night)
        judged = judge("m", night, night.usable, found.model, found.estimate)
        counts = [int((night.conditions.series == s).sum()) for s in range(2)]
        assert {name: pairs.n for name, pairs in judged.pairs.items()} == {
            name: n * (n - 1) // 2 for name, n in zip(("day", "night"), counts, strict=True)
        }

    def test_orientations_are_judged_where_they_were_measured(
        self, day: tuple[Dataset, IdentificationFit]
    ) -> None:
        dataset, found = day
        rotation = BoundModel(found.model, dataset.conditions).frames(found.estimate).rotation
        off = Rotation.from_rotvec([0.0, 0.003, 0.004])
        turned = off * Rotation.from_matrix(rotation)
        quaternions = -turned.as_quat(scalar_first=True)  # the other sign is the same orientation
        quaternions[::2] = np.nan
        known = replace(dataset, orientation=quaternions, u_rotation=np.full(len(dataset), 1e-4))
        judged = judge("m", known, dataset.usable, found.model, found.estimate)
        assert judged.orientation is not None
        assert judged.orientation.n == len(dataset) // 2
        assert judged.orientation.mean == pytest.approx(0.005)
        assert judged.orientation.max == pytest.approx(0.005)
        worthless = replace(
            known, u_rotation=np.full(len(dataset), np.nan)
        )  # nor does the header tell their noise
        assert judge("m", worthless, dataset.usable, found.model, found.estimate).orientation is None
        vectors = rotation_vectors(rotation[1::2], quaternions[1::2])
        assert vectors == pytest.approx(np.tile([0.0, 0.003, 0.004], (len(vectors), 1)))

    def test_the_reference_pose_repeats(self, day: tuple[Dataset, IdentificationFit]) -> None:
        dataset, found = day
        (pose,) = judge_repeats(dataset, found.model, found.estimate).poses
        reference = np.flatnonzero(dataset.sets == "reference")
        assert (pose.reading, pose.visits) == (reference[0], len(reference))
        visits = dataset.points[reference]
        from_centre = np.linalg.norm(visits - visits.mean(axis=0), axis=1)
        assert pose.repeatability == pytest.approx(from_centre.mean() + 3.0 * from_centre.std(ddof=1))
        command = found.predict(dataset.conditions)[reference].mean(axis=0)
        assert pose.accuracy == pytest.approx(np.linalg.norm(visits.mean(axis=0) - command))

    def test_nothing_measured_and_another_series_are_refused(
        self, day: tuple[Dataset, IdentificationFit], night: Dataset
    ) -> None:
        dataset, found = day
        nothing = np.zeros(len(dataset), dtype=bool)
        with pytest.raises(DataError, match="no measured points or distances to judge by"):
            judge("m", dataset, nothing, found.model, found.estimate)
        with pytest.raises(DataError, match=r"series 'day'.*--place"):
            judge("m", night, night.usable, found.model, found.estimate)

    def test_another_robot_is_refused(self, day: tuple[Dataset, IdentificationFit], tmp_path: Path) -> None:
        dataset, found = day
        saved = saved_of(found, tmp_path / "m.json")
        other = replace(dataset, header=replace(dataset.header, robot=load_robot("ur5")))
        with pytest.raises(DataError, match=r"m\.json.*'abb-irb120'.*'ur5'"):
            refuse_other_robot(saved, other, tmp_path / "m.json")


class TestGroups:
    @given(st.integers(0, 2**32 - 1), st.integers(1, 100), st.floats(0.01, 1e4))
    @settings(deadline=None, max_examples=40)
    def test_bins_of_distance_hold_every_reading_once(self, seed: int, n: int, size: float) -> None:
        rng = np.random.default_rng(seed)
        points, errors = rng.normal(0.0, size, (n, 3)), rng.uniform(0.0, 1.0, n)
        reference = np.array([10.0, 0.0, 0.0])
        grouping = by_distance(points, reference, errors)
        assert sum(summary.n for _, summary in grouping.groups) == n
        assert len(grouping.groups) <= 11
        distance = np.linalg.norm(points - reference, axis=1)
        for name, summary in grouping.groups:
            low, high = (float(word) for word in name.removesuffix(" mm").split(" to "))
            inside = (distance >= low) & (distance < high)
            assert summary.mean == pytest.approx(errors[inside].mean())

    def test_what_is_the_same_everywhere_is_no_grouping(self) -> None:
        errors = np.array([1.0, 2.0, 3.0])
        assert grouped("target", ["T1", "T1", "T1"], errors) is None
        found = grouped("target", ["T2", "T1", "T2"], errors)
        assert found is not None
        assert [(name, summary.mean) for name, summary in found.groups] == [("T1", 2.0), ("T2", 2.0)]

    def test_sides_by_name(self, day: tuple[Dataset, IdentificationFit]) -> None:
        dataset, _ = day
        errors = np.where(dataset.conditions.side[:, 3] > 0.0, 2.0, 1.0)
        (fourth,) = [
            g for g in groupings(dataset.header.robot, dataset.conditions, errors) if "j4" in g.title
        ]
        assert {name: summary.mean for name, summary in fourth.groups} == {
            "from above": 1.0,
            "from below": 2.0,
        }


class TestHoldOuts:
    def test_every_reading_of_the_fit_is_held_out_once(self, day: tuple[Dataset, IdentificationFit]) -> None:
        dataset, _ = day
        found = hold_outs(dataset, folds=3)
        assert [each.kind for each in found] == ["random", "region", "time"]
        for each in found:
            assert each.errors is not None
            assert (each.errors.n, each.left_out, each.folds) == (int(dataset.fit_rows.sum()), 0, 3)
            assert each.errors.rms < 0.2

    def test_a_waypoint_is_held_out_whole(self, day: tuple[Dataset, IdentificationFit]) -> None:
        dataset, _ = day
        numbered = replace(dataset.conditions, waypoint=np.arange(len(dataset)) % 4)
        with pytest.raises(DataError, match="4 poses"):
            hold_outs(replace(dataset, conditions=numbered), folds=5)

    def test_validation_rows_take_no_part(self, day: tuple[Dataset, IdentificationFit]) -> None:
        dataset, _ = day
        points = dataset.points.copy()
        points[dataset.validation_rows] += 100.0
        one, other = (hold_outs(each, folds=2) for each in (dataset, with_points(dataset, points)))
        assert [each.errors for each in one] == [each.errors for each in other]

    def test_a_series_is_judged_by_the_robot_of_the_other(self, night: Dataset) -> None:
        found = {each.kind: each for each in hold_outs(night, folds=2)}
        assert set(found) == {"random", "region", "time", "series"}
        series = found["series"]
        assert series.errors is not None
        # the other half of every series placed the robot
        assert series.errors.n == pytest.approx(int(night.fit_rows.sum()) / 2, abs=2)
        assert series.errors.max < 0.01  # without noise the robot is the same in both

    def test_nothing_to_hold_out_is_refused(self, day: tuple[Dataset, IdentificationFit]) -> None:
        dataset, _ = day
        points = np.where(dataset.sets[:, None] == "reference", dataset.points, np.nan)
        with pytest.raises(DataError, match="1 poses with a measured point"):
            hold_outs(with_points(dataset, points))

    def test_rows_held_out_are_out_of_the_fit(self, day: tuple[Dataset, IdentificationFit]) -> None:
        dataset, _ = day
        held = dataset.fit_rows & (np.arange(len(dataset)) % 3 == 0)
        assert np.array_equal(without(dataset, held).fit_rows, dataset.fit_rows & ~held)


class TestComparing:
    def test_the_same_calibration_differs_in_nothing(
        self, day: tuple[Dataset, IdentificationFit], tmp_path: Path
    ) -> None:
        dataset, found = day
        saved = saved_of(found, tmp_path / "m.json")
        for each in differences(saved, saved):
            assert each.difference in (0.0, None)
            assert each.e_n in (0.0, None)
        standing = place(dataset, saved.model, saved.estimate)
        between = apart(dataset, dataset.validation_rows, standing, standing)
        assert between is not None
        assert between.max == 0.0

    def test_normalised_error_by_hand(self, day: tuple[Dataset, IdentificationFit], tmp_path: Path) -> None:
        _, found = day
        first = saved_of(found, tmp_path / "m.json")
        a3, dropped = first.model.index["a3"], next(drop.name for drop in found.dropped)
        estimate, covariance = first.estimate.copy(), first.covariance.copy()
        estimate[a3] += 0.5
        covariance[a3, a3] = 0.04
        first = replace(
            first, covariance=np.where(np.eye(len(estimate)) * covariance == 0.04, 0.0225, first.covariance)
        )
        second = replace(first, estimate=estimate, covariance=covariance)
        found_ = {each.name: each for each in differences(first, second)}
        assert found_["a3"].difference == pytest.approx(0.5)
        assert found_["a3"].e_n == pytest.approx(0.5 / (2.0 * 0.25))  # u 0.15 and 0.2 mm: 0.25 together
        assert (found_[dropped].difference, found_[dropped].e_n) == (None, None)
        assert not any(name.startswith("base") for name in found_)

    def test_two_campaigns_of_one_robot_agree_within_their_uncertainties(self, tmp_path: Path) -> None:
        """The same simulated arm measured twice; E_n above 1 is rarer than one parameter in five."""
        campaign = make_campaign(seed=4, n=160, n_validation=20, effects=[])
        rows = [row for row in campaign.rows if row["set"] == "calibration"]
        halves = [read_dataset(write_files(tmp_path / str(k), rows[k::2], campaign.header)) for k in (0, 1)]
        found = [identify(half) for half in halves]
        one, other = (saved_of(each, tmp_path / f"{k}.json") for k, each in enumerate(found))
        e_n = [each.e_n for each in differences(one, other) if each.e_n is not None]
        assert len(e_n) > 20
        assert np.mean(np.array(e_n) > 1.0) < 0.2
        standing = [place(halves[0], each.model, each.estimate) for each in (one, other)]
        between = apart(halves[0], halves[0].usable, *standing)
        assert between is not None
        assert 0.0 < between.mean < 0.1

    def test_other_robots_and_other_tables_are_refused(
        self, day: tuple[Dataset, IdentificationFit], tmp_path: Path
    ) -> None:
        _, found = day
        saved = saved_of(found, tmp_path / "m.json")
        robot = saved.model.robot
        renamed = replace(saved, model=replace(saved.model, robot=replace(robot, name="another")))
        with pytest.raises(DataError, match=r"n\.json.*'another', not 'abb-irb120'"):
            refuse_incomparable(saved, renamed, tmp_path / "n.json")
        longer = replace(saved, model=replace(saved.model, robot=replace(robot, a=(1.0, *robot.a[1:]))))
        with pytest.raises(DataError, match=r"nominal robot: a differ"):
            refuse_incomparable(saved, longer, tmp_path / "n.json")


def test_distances_are_held_out_like_points() -> None:
    """Without errors, distances of a fifth follow from those of the rest.

    The tolerance is the rounding of the certified file.
    """
    ballbar = Path(__file__).parents[1] / "certified" / "irb120_ballbar.csv"
    found = hold_outs(read_dataset(ballbar), folds=3)
    assert [each.kind for each in found] == ["random", "region", "time"]
    for each in found:
        assert each.errors is not None
        assert each.left_out == 0
        assert (
            0.01 < each.errors.rms < 0.03
        )  # noise of 2 um and repeatability of 0.8 mdeg, through a fit of few rows


def test_poses_of_iso_9283_come_before_others_that_repeat(tmp_path: Path) -> None:
    """The reference pose is measured first and most often; a repeat block is what the standard asks for."""
    campaign = make_campaign(seed=4, n=20, n_validation=4, effects=[], reference_every=2)
    rows, header = exact(campaign)
    single = [row for row in rows if (row["set"], row["tool_target"]) == ("calibration", "T2")][:2]
    more = [row | {"set": "repeat"} for _ in range(3) for row in single]
    for k, row in enumerate([*rows, *more]):
        row["reading_id"] = k
    read = read_dataset(write_files(tmp_path, [*rows, *more], header))
    found = identify(read)
    repeats = judge_repeats(read, found.model, found.estimate)
    sets = [str(read.sets[pose.reading]) for pose in repeats.poses]
    assert sets[-1] == "reference"
    assert len(repeats.poses) == 3
    assert [each.visits for each in repeats.poses[:2]] == [4, 4]
    assert repeats.poses[-1].visits > 4
    assert repeats.distances[0].readings == tuple(each.reading for each in repeats.poses[:2])
