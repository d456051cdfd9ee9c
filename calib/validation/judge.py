"""A calibration judged on readings: positions, orientations, all pairs, groups, and ISO 9283 where poses repeat.

Orientation error: the angle of the rotation from the predicted to the measured orientation (its log map).
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from calib.array import Array
from calib.data.dataset import Dataset
from calib.errors import DataError
from calib.fit.held_out import length_errors
from calib.fit.statistics import distances
from calib.model.model import Design, RobotModel
from calib.saved.model_file import SavedModel
from calib.validation.ballbar import (
    LengthRepeats,
    SphereTest,
    over_the_fixture,
    repeats_of_lengths,
    sphere_tests,
)
from calib.validation.groups import Grouping, by_distance, groupings
from calib.validation.iso9283 import (
    DistanceFigures,
    PoseFigures,
    figures_between,
    figures_of_pose,
    repeated_poses,
    unidirectional,
)
from calib.validation.pairs import pair_errors
from calib.validation.summary import Summary, summarise

Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Judgement:
    """The judgement of one model on some readings. Lengths mm, angles rad; None where nothing was measured to judge by.

    length: of measured distances to base targets; spheres: sphere tests among these. pairs: series -> distance errors
    over all pairs of its points; series have each their own frame. groupings: of positions, or of lengths where no
    point was measured.
    """

    name: str
    position: Summary | None
    length: Summary | None
    pairs: Mapping[str, Summary]
    orientation: Summary | None
    groupings: tuple[Grouping, ...]
    spheres: tuple[SphereTest, ...] = ()

    @property
    def error(self) -> Summary:
        """The error of positions, or of lengths where no point was measured."""
        found = self.position or self.length
        assert found is not None
        return found


def judge(
    name: str,
    dataset: Dataset,
    rows: Mask,
    model: RobotModel,
    estimate: Array,
    reference: tuple[float, float, float] | None = None,
) -> Judgement:
    """Judge a model on the points and distances of some rows (mask), in the place where it is mounted.

    reference: (x, y, z) mm in the world, from which the distance of every point is taken; for distances measured to
    three balls it is the point over them where it is not given. Raises DataError when no row was measured, or the model
    does not know a series, a tool target or a base target.
    """
    pointed, spanned = rows & dataset.pointed, rows & dataset.spanned
    refuse_unplaced(dataset, pointed | spanned, model)
    _refuse_unknown_ends(dataset, spanned, model)
    position, length, orientation = None, None, None
    pairs: dict[str, Summary] = {}
    parts: list[Grouping] = []
    if pointed.any():
        conditions, measured = dataset.conditions.take(pointed), dataset.points[pointed]
        predicted, vectors = _compared(dataset, pointed, model, estimate)
        errors = distances(predicted, measured)
        position = summarise(errors)
        parts = groupings(model.robot, conditions, errors)
        if reference is not None:
            parts.append(by_distance(measured, np.array(reference), errors))
        for s in np.unique(conditions.series):
            of = conditions.series == s
            summary = pair_errors(measured[of], predicted[of])
            if summary is not None:
                pairs[conditions.series_names[s]] = summary
        angles = np.linalg.norm(vectors, axis=1)
        orientation = summarise(angles[np.isfinite(angles)])
    if spanned.any():
        errors = length_errors(dataset, spanned, model, estimate)
        length = summarise(errors)
        if not pointed.any():
            conditions = dataset.conditions.take(spanned)
            parts = groupings(model.robot, conditions, errors)
            above = over_the_fixture(dataset) if reference is None else np.array(reference)
            if above is not None:
                parts.append(by_distance(conditions.point, above, errors))
    if position is None and length is None:
        raise DataError(
            "has no measured points or distances to judge by.",
            do="Mark some measured rows set = validation, or judge on all rows with --all.",
            file=dataset.path,
            key="set",
        )
    spheres = sphere_tests(dataset, spanned, model, estimate)
    return Judgement(name, position, length, pairs, orientation, tuple(parts), spheres)


def _refuse_unknown_ends(dataset: Dataset, rows: Mask, model: RobotModel) -> None:
    """Raise DataError when a distance ends at a base target that the model does not know."""
    for name in dataset.conditions.anchor_names if rows.any() else ():
        if name not in model.anchors:
            raise DataError(
                f"has distances to the base target '{name}', of which the model does not know where it is.",
                do="Judge a model that was identified from distances to it.",
                file=dataset.path,
                key="base_target",
            )


@dataclass(frozen=True)
class Repeats:
    """ISO 9283 figures of the poses that a data set visits more than once; rows are those of the data set.

    lengths: the scatter of measured distances that were repeated.
    """

    poses: tuple[PoseFigures, ...]
    distances: tuple[DistanceFigures, ...]
    lengths: LengthRepeats | None = None


def judge_repeats(dataset: Dataset, model: RobotModel, estimate: Array) -> Repeats:
    """ISO 9283 figures of every pose visited twice or more with one target in one series, whatever its set.

    Repeatability needs no model; the commands that accuracy counts from are where `model` expects the target.
    Distances are those from every such pose to the next, in the order of their first visits.
    """
    usable = dataset.usable & dataset.pointed
    rows, conditions = np.flatnonzero(usable), dataset.conditions
    same = conditions.take(usable)
    poses = [rows[visits] for visits in repeated_poses(same.joints, same.series, same.target)]
    lengths = repeats_of_lengths(dataset)
    if not poses:
        return Repeats((), (), lengths)
    refuse_unplaced(dataset, usable, model)
    predicted, angles = _compared(dataset, usable, model, estimate)
    commands, turned = np.full((2, len(dataset), 3), np.nan)
    commands[usable] = predicted
    turned[usable] = angles
    between = [
        figures_between(
            unidirectional(a, conditions.side), unidirectional(b, conditions.side), dataset.points, commands
        )
        for a, b in itertools.pairwise(poses)
        if conditions.series[a[0]] == conditions.series[b[0]]
        and conditions.target[a[0]] == conditions.target[b[0]]
    ]
    return Repeats(
        tuple(figures_of_pose(visits, dataset.points, commands, turned, conditions.side) for visits in poses),
        tuple(between),
        lengths,
    )


def _compared(dataset: Dataset, rows: Mask, model: RobotModel, estimate: Array) -> tuple[Array, Array]:
    """Predicted points (k, 3), mm, and rotation vectors (k, 3) from predicted to measured, rad, NaN if not measured."""
    frames = Design(model, dataset.conditions.take(rows)).frames(estimate, ())
    predicted = np.broadcast_to(frames.p, (3, int(rows.sum()))).T
    turned = dataset.turned[rows]
    vectors = np.full((len(turned), 3), np.nan)
    vectors[turned] = rotation_vectors(frames.rotation[turned], dataset.orientation[rows][turned])
    return predicted, vectors


def refuse_other_robot(saved: SavedModel, dataset: Dataset, file: Path) -> None:
    """Raise DataError when a model is of another robot than a data set."""
    if saved.model.robot.name != dataset.header.robot.name:
        raise DataError(
            f"is a model of the robot '{saved.model.robot.name}', and {dataset.name} is of "
            f"'{dataset.header.robot.name}'.",
            do="Give a model of the same robot.",
            file=file,
            key="robot",
        )


def refuse_unplaced(dataset: Dataset, rows: Mask, model: RobotModel) -> None:
    """Raise DataError when a model does not know where the base of a series is or where a tool target sits."""
    conditions = dataset.conditions
    for s, t in {
        (int(s), int(t)) for s, t in zip(conditions.series[rows], conditions.target[rows], strict=True)
    }:
        series, target = conditions.series_names[s], conditions.target_names[t]
        if target not in model.targets.get(series, {}):
            raise DataError(
                f"has readings of series '{series}' with target '{target}', which the model does not know.",
                do="Place the model's robot on the calibration rows with --place.",
                file=dataset.path,
                key="series",
            )


def rotation_vectors(predicted: Array, measured: Array) -> Array:
    """(n, 3) rotation vectors, rad, world axes, from predicted (n, 3, 3) to measured quaternions (n, 4), scalar first.

    The angle is that of the shorter way: q and -q are the same orientation.
    """
    turn = Rotation.from_quat(measured, scalar_first=True) * Rotation.from_matrix(predicted).inv()
    return turn.as_rotvec()
