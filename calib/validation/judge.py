"""Judgement of a calibration on readings: positions, orientations, pairs and groups.

If poses repeat, `judge_repeats` adds the criteria of ISO 9283. The orientation error is the angle of the rotation from
the predicted to the measured orientation (its log map).

**Groups.** The same errors are grouped by target, series, branch, side of approach, and distance from a point.
A grouping gives every reading a name, and a group is summarised like the whole. Figure 4.7 of Nubiola's thesis is the
grouping by distance.

**Branch.** The branch of a six-axis robot's configuration is front or back, up or down, flip or noflip, according to
the nominal axes. It consists of the signs of the quantities that vanish in the three singular surfaces, both for arms
with a spherical wrist and for the URs. z_i is the axis of joint i, and o_i a point on it. Axes 5 and 6 meet in w,
which is the wrist centre of a spherical wrist.

    front / back    (z_1 x z_2) . (w - o_1), relative to its sign at the zero pose: the wrist lies before or behind
                    axis 1; for an arm that is upright at zero, its own sign
    up / down       z_2 . ((o_3 - o_2) x (e - o_3)) > 0 is up: the branch of theta_3; e is w, or a point on axis 4
                    where axes 3 and 4 are parallel (URs)
    flip / noflip   z_5 . (z_4 x z_6) > 0 is noflip: the sign of sin theta_5

The product of the three has, up to one sign per robot, the sign of the Jacobian's determinant. The words are those of
Nubiola, thesis 4. Other sources may call 'up' by another name.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from calib.arm.kinematics import BasePoses, Chain, nominal_values, propagate
from calib.arm.robot import Robot
from calib.array import Array
from calib.data.conditions import Conditions
from calib.data.dataset import Dataset
from calib.errors import DataError
from calib.fit.held_out import length_errors
from calib.fit.statistics import distances
from calib.model.model import BoundModel, ModelStructure
from calib.saved.model_file import CalibratedModel
from calib.validation.ballbar import (
    LengthRepeats,
    SphereTest,
    over_the_fixture,
    repeats_of_lengths,
    sphere_tests,
)
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

MOST_BINS = 10
_PARALLEL = 1e-6
_MEETING_MM = 1e-7


@dataclass(frozen=True)
class Grouping:
    """Errors of readings grouped by one property; `groups` are in display order."""

    title: str
    groups: tuple[tuple[str, Summary], ...]


def grouped(title: str, names: Sequence[str], errors: Array) -> Grouping | None:
    """Summarise errors (n,) by name.

    The result is None if all have the same name, since there is nothing to compare.
    """
    labels = np.array(names)
    kinds = list(dict.fromkeys(sorted(labels)))
    if len(kinds) < 2:
        return None
    found = [(str(kind), summarise(errors[labels == kind])) for kind in kinds]
    return Grouping(title, tuple((kind, summary) for kind, summary in found if summary is not None))


def groupings(robot: Robot, conditions: Conditions, errors: Array) -> list[Grouping]:
    """Group errors (n,) of readings by target, series, branch and side of approach.

    A property that is the same for all readings is left out.
    """
    return [grouping for grouping in _groupings(robot, conditions, errors) if grouping is not None]


def _groupings(robot: Robot, conditions: Conditions, errors: Array) -> Iterator[Grouping | None]:
    yield grouped("target", [conditions.target_names[t] for t in conditions.target], errors)
    yield grouped("series", [conditions.series_names[s] for s in conditions.series], errors)
    configurations = branches(robot, conditions.joints)
    if configurations is not None:
        yield grouped("branch", configurations, errors)
    for k, side in enumerate(conditions.side.T, start=1):
        words = np.select([side > 0.0, side < 0.0], ["from below", "from above"], "unknown")
        yield grouped(f"approach of j{k}", words.tolist(), errors)


def by_distance(points: Array, reference: Array, errors: Array) -> Grouping:
    """Group errors (n,) by the distance of points (n, 3) from a reference point (3,), mm.

    The bins have a round width.
    """
    distance = np.linalg.norm(points - reference, axis=1)
    width = _round_width(float(np.ptp(distance)) / MOST_BINS)
    bins = np.floor(distance / width).astype(int)
    found = []
    for k in np.unique(bins):
        summary = summarise(errors[bins == k])
        if summary is not None:
            found.append((f"{k * width:g} to {(k + 1) * width:g} mm", summary))
    return Grouping("distance from the point", tuple(found))


def _round_width(least: float) -> float:
    """Return the smallest of 1, 2, 5, 10, 20, 50 ... mm that is not below `least`."""
    decade = 10.0 ** np.floor(np.log10(max(least, 1.0)))
    return float(next(step * decade for step in (1.0, 2.0, 5.0, 10.0) if step * decade >= max(least, 1.0)))


def branches(robot: Robot, joints: Array) -> list[str] | None:
    """Name the branch of each configuration (n, N), rad, such as 'front/up/noflip'.

    The angles are those of the model. The result is None for robots without six joints, or whose axes 5 and 6 do not
    meet at an angle.
    """
    if robot.joints != 6:
        return None
    z, o = _axes(robot, np.vstack([joints, np.zeros((1, 6))]))
    across = np.cross(z[4], z[5])
    size = np.sum(across**2, axis=1)
    if size.min() < _PARALLEL or np.abs(np.sum((o[5] - o[4]) * across, axis=1)).max() > _PARALLEL * 1e3:
        return None
    along = np.sum(np.cross(o[5] - o[4], z[5]) * across, axis=1) / size
    wrist = o[4] + along[:, None] * z[4]
    parallel = np.linalg.norm(np.cross(z[2], z[3]), axis=1).max() < _PARALLEL
    elbow = o[3] if parallel else wrist
    reach = np.sum(np.cross(z[0], z[1]) * (wrist - o[0]), axis=1)
    front = reach * (-1.0 if reach[-1] < -_MEETING_MM else 1.0) >= 0.0
    up = np.sum(z[1] * np.cross(o[2] - o[1], elbow - o[2]), axis=1) >= 0.0
    noflip = np.sum(z[4] * np.cross(z[3], z[5]), axis=1) >= 0.0
    words = zip(front[:-1], up[:-1], noflip[:-1], strict=True)
    return [
        f"{'front' if f else 'back'}/{'up' if u else 'down'}/{'noflip' if w else 'flip'}" for f, u, w in words
    ]


def _axes(robot: Robot, joints: Array) -> tuple[Array, Array]:
    """Return directions and points (6, n, 3) of the nominal joint axes, base frame."""
    frames = propagate(Chain.of(robot), nominal_values(robot, joints), BasePoses())
    n = len(joints)

    def stacked(by_slot: dict[str, Array]) -> Array:
        return np.stack([np.broadcast_to(by_slot[f"theta{k}"], (3, n)).T for k in range(1, 7)])

    return stacked(frames.axis), stacked(frames.origin)


Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Judgement:
    """Judgement of one model on some readings; lengths in mm, angles in rad.

    A summary is None if nothing was measured for it.

    Attributes
    ----------
    length : Summary or None
        Errors of measured distances to base targets.
    pairs : mapping of str to Summary
        For each series, distance errors over all pairs of its points, since each series has a separate frame.
    groupings : tuple of Grouping
        Groups of position errors, or of length errors if no point was measured.
    spheres : tuple of SphereTest
        Sphere tests among the distances.
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
        """Position errors, or length errors if no point was measured."""
        found = self.position or self.length
        assert found is not None
        return found


def judge(
    name: str,
    dataset: Dataset,
    rows: Mask,
    model: ModelStructure,
    estimate: Array,
    reference: tuple[float, float, float] | None = None,
) -> Judgement:
    """Judge a model on the points and distances of some rows (mask), as it is mounted.

    Parameters
    ----------
    reference : (float, float, float), optional
        Point in the world, mm, for the grouping by distance. Default for distances to three balls: the point over them.

    Raises
    ------
    DataError
        No row was measured, or the model does not know a series, a tool target or a base target.
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


def _refuse_unknown_ends(dataset: Dataset, rows: Mask, model: ModelStructure) -> None:
    """Refuse distances that end at a base target that the model does not know."""
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
    """ISO 9283 results of the poses that a data set visits more than once.

    Rows are those of the data set.

    Attributes
    ----------
    lengths : LengthRepeats or None
        Scatter of measured distances that were repeated.
    """

    poses: tuple[PoseFigures, ...]
    distances: tuple[DistanceFigures, ...]
    lengths: LengthRepeats | None = None


def judge_repeats(dataset: Dataset, model: ModelStructure, estimate: Array) -> Repeats:
    """Compute the ISO 9283 results of every pose visited twice or more.

    The visits have one target and one series, and may belong to any set. Repeatability needs no model. Accuracy is
    relative to the position where `model` expects the target. Poses of the set `repeat` come first, reference poses
    last, and among equals those with more visits first. Distances are those from every pose to the next.
    """
    usable = dataset.usable & dataset.pointed
    rows, conditions = np.flatnonzero(usable), dataset.conditions
    same = conditions.take(usable)
    found = [rows[visits] for visits in repeated_poses(same.joints, same.series, same.target)]
    kinds = [set(dataset.sets[visits].tolist()) for visits in found]
    keys = [
        ("repeat" not in kind, kind == {"reference"}, -len(visits))
        for kind, visits in zip(kinds, found, strict=True)
    ]
    poses = [found[k] for k in sorted(range(len(found)), key=keys.__getitem__)]
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


def _compared(dataset: Dataset, rows: Mask, model: ModelStructure, estimate: Array) -> tuple[Array, Array]:
    """Return predicted points (k, 3), mm, and rotation vectors (k, 3), rad.

    The vectors are from predicted to measured orientation, NaN if not measured.
    """
    frames = BoundModel(model, dataset.conditions.take(rows)).frames(estimate, ())
    predicted = np.broadcast_to(frames.p, (3, int(rows.sum()))).T
    turned = dataset.turned[rows]
    vectors = np.full((len(turned), 3), np.nan)
    vectors[turned] = rotation_vectors(frames.rotation[turned], dataset.orientation[rows][turned])
    return predicted, vectors


def refuse_other_robot(saved: CalibratedModel, dataset: Dataset, file: Path) -> None:
    """Refuse a model of another robot than that of a data set.

    Raises
    ------
    DataError
        The robots have different names.
    """
    if saved.model.robot.name != dataset.header.robot.name:
        raise DataError(
            f"is a model of the robot '{saved.model.robot.name}', and {dataset.name} is of "
            f"'{dataset.header.robot.name}'.",
            do="Give a model of the same robot.",
            file=file,
            key="robot",
        )


def refuse_unplaced(dataset: Dataset, rows: Mask, model: ModelStructure) -> None:
    """Refuse a model that does not know a tool target in one of the series of some rows.

    Raises
    ------
    DataError
        The model does not know a series, or a target in it.
    """
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
    """Return the rotation vectors from predicted to measured orientations.

    The angle is that of the shorter way: q and -q are the same orientation.

    Parameters
    ----------
    predicted : array of shape (n, 3, 3)
        Rotation matrices.
    measured : array of shape (n, 4)
        Quaternions, scalar first.

    Returns
    -------
    array of shape (n, 3)
        Rotation vectors, rad, world axes.
    """
    turn = Rotation.from_quat(measured, scalar_first=True) * Rotation.from_matrix(predicted).inv()
    return turn.as_rotvec()
