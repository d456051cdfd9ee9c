"""What a fit would swallow and an engineer would not: a mirrored frame, a wrong unit, readings that stand twice.

A left-handed frame or a wrong unit leaves the readings consistent among themselves, and the least squares distant by
decimetres. Each is tried in turn: where the nominal robot then fits ten times better, the readings are refused by that
name. `remarks` says what is no error but limits what the readings can tell.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from calib.errors import DataError
from calib.kinematics import Array, forward
from calib.start import align, base_and_tool, base_target, tool_turn
from calib.units import DEG

if TYPE_CHECKING:  # a data set is checked by this module as it is read
    from calib.dataset import Dataset

_UNITS = {"metres": 1000.0, "inches": 25.4, "centimetres": 10.0, "micrometres": 0.001}
_GOOD = (
    0.05  # miss of the nominal robot, as a share of the extent of the readings (or rad), that explains itself
)
_BETTER = 0.1  # share of the miss that may be left when it is explained
_NARROW = 20.0 * DEG
_MIRROR = np.array([-1.0, 1.0, 1.0])
_FEWEST = 8  # readings that can tell


def refuse_implausible(dataset: Dataset) -> None:
    """Raise DataError where points are mirrored, points or lengths not in mm, or quaternions in another order."""
    conditions = dataset.conditions
    flange = forward(dataset.header.robot, conditions.joints)
    targets = np.zeros((len(dataset), 3))
    for s, series in enumerate(conditions.series_names):
        known = dataset.header.targets_of(series)
        of = np.array([known.get(name, (0.0, 0.0, 0.0)) for name in conditions.target_names])
        targets[conditions.series == s] = of[conditions.target[conditions.series == s]]
    nominal = flange[:, :3, 3] + np.einsum("nij,nj->ni", flange[:, :3, :3], targets)
    for s, series in enumerate(conditions.series_names):
        rows = dataset.fit_rows & (conditions.series == s)
        pointed, spanned = rows & dataset.pointed, rows & dataset.spanned
        if pointed.sum() >= _FEWEST:
            _refuse_points(dataset, series, flange[pointed], nominal[pointed], pointed)
        turned = rows & dataset.turned
        if turned.sum() >= _FEWEST:
            _refuse_turns(dataset, series, flange[turned], nominal[turned], turned)
        if spanned.sum() >= _FEWEST:
            _refuse_lengths(dataset, series, nominal[spanned], spanned)


def _refuse_points(
    dataset: Dataset, series: str, flange: Array, nominal: Array, rows: NDArray[np.bool_]
) -> None:
    points, conditions = dataset.points[rows], dataset.conditions
    rotation, translation = align(nominal, points, np.ones(len(points)))
    miss = np.linalg.norm(points - nominal @ rotation.T - translation, axis=1)
    extent = np.linalg.norm(np.std(nominal, axis=0))
    if np.median(miss) < _GOOD * extent:
        return
    known = dataset.header.targets_of(series)
    tools = np.array([known.get(name, (0.0, 0.0, 0.0)) for name in conditions.target_names])

    def left(measured: Array) -> float:
        """Median miss with the tool as it may be, so that a wrong tool explains nothing."""
        which = conditions.target[rows]
        pose, found = base_and_tool(flange, tools, which, measured, tool_unknown=True)
        there = flange[:, :3, 3] + np.einsum("nij,nj->ni", flange[:, :3, :3], found[which])
        return float(np.median(np.linalg.norm(measured - there @ pose[:3, :3].T - pose[:3, 3], axis=1)))

    limit = min(_BETTER * left(points), _GOOD * extent)
    if left(points * _MIRROR) < limit:
        raise DataError(
            f"the measured frame of series '{series}' is left-handed: mirrored, its points fit the robot.",
            do="Change the sign of one axis, or swap two columns, as the instrument's manual has it.",
            file=dataset.path,
            key="x_mm, y_mm, z_mm",
        )
    for unit, factor in _UNITS.items():
        if left(points * factor) < limit:
            raise _wrong_unit(dataset, "x_mm, y_mm, z_mm", series, unit, factor)


def _refuse_lengths(dataset: Dataset, series: str, nominal: Array, rows: NDArray[np.bool_]) -> None:
    lengths, anchors = dataset.lengths[rows], dataset.conditions.anchor[rows]
    zero_unknown = dataset.header.frees_length_zero

    def left(factor: float) -> float:
        """Median miss of the lengths from where they say that their base targets are; infinite where they cannot."""
        miss = []
        for a in np.unique(anchors):
            of = anchors == a
            if of.sum() < _FEWEST:
                continue
            place = base_target(nominal[of], factor * lengths[of], zero_unknown=zero_unknown)
            if place is not None:
                off = factor * lengths[of] - np.linalg.norm(nominal[of] - place, axis=1)
                miss.append(np.abs(off - zero_unknown * np.median(off)))
        return float(np.median(np.concatenate(miss))) if miss else np.inf

    plain, extent = left(1.0), float(np.linalg.norm(np.std(nominal, axis=0)))
    if plain < _GOOD * extent or not np.isfinite(plain):
        return
    for unit, factor in _UNITS.items():
        if left(factor) < min(_BETTER * plain, _GOOD * extent):
            raise _wrong_unit(dataset, "length_mm", series, unit, factor)


def _refuse_turns(
    dataset: Dataset, series: str, flange: Array, nominal: Array, rows: NDArray[np.bool_]
) -> None:
    base = np.eye(4)
    base[:3, :3], _ = align(nominal, dataset.points[rows], np.ones(len(nominal)))
    orientation = dataset.orientation[rows]

    def left(read: Array) -> float:
        """Median turn, rad, that remains behind a constant turn of the tool."""
        turn = base[:3, :3] @ flange[:, :3, :3] @ tool_turn(flange, base, read)
        off = Rotation.from_matrix(turn).inv() * Rotation.from_quat(read, scalar_first=True)
        return float(np.median(off.magnitude()))

    if (plain := left(orientation)) < _GOOD:
        return
    readings = {
        "hold the scalar last": orientation[:, [3, 0, 1, 2]],
        "turn the other way, from the tool to the world": orientation * (1.0, -1.0, -1.0, -1.0),
    }
    for what, read in readings.items():
        if left(read) < min(_BETTER * plain, _GOOD):
            raise DataError(
                f"the quaternions of series '{series}' {what}: read so, they fit the robot.",
                do="Write the orientation of the tool frame in the world, rot_w the scalar.",
                file=dataset.path,
                key="rot_w..rot_z",
            )


def _wrong_unit(dataset: Dataset, column: str, series: str, unit: str, factor: float) -> DataError:
    return DataError(
        f"the numbers of series '{series}' are {unit}, not millimetres: times {factor:g} they fit the robot.",
        do=f"Multiply them by {factor:g}.",
        file=dataset.path,
        key=column,
    )


def refuse_mirrored(dataset: Dataset, here: Mapping[str, Array], declared: Mapping[str, Array]) -> None:
    """Raise DataError where base targets, declared in the world, lie mirrored to `here`, their places by the lengths.

    Both in mm; needs four that do not lie in a plane.
    """
    if len(here) < 4:
        return
    found, goal = np.array(list(here.values())), np.array([declared[name] for name in here])

    def left(places: Array) -> float:
        rotation, translation = align(found, places, np.ones(len(found)))
        return float(np.linalg.norm(places - found @ rotation.T - translation, axis=1).max())

    plain = left(goal)
    if plain > _GOOD * np.linalg.norm(np.std(goal, axis=0)) and left(goal * _MIRROR) < _BETTER * plain:
        raise DataError(
            "lie mirrored to where the lengths find them: the frame they are given in is left-handed.",
            do="Change the sign of one axis of all of them.",
            file=dataset.path.with_suffix(".toml"),
            key="base_targets",
        )


def remarks(dataset: Dataset) -> list[str]:
    """What limits the readings of a fit, sentence by sentence: rows that stand twice, narrow joints, one approach."""
    rows = dataset.fit_rows
    out = []
    twice = _repeated(dataset, rows)
    if twice:
        ids = ", ".join(twice[:4]) + (", ..." if len(twice) > 4 else "")
        out.append(
            f"{len(twice)} {'reading repeats' if len(twice) == 1 else 'readings repeat'} an earlier one to the last "
            f"digit, joints and measured numbers ({ids}): counted twice, they make errors look smaller."
        )
    joints = dataset.conditions.joints[rows]
    low, high = joints.min(axis=0) / DEG, joints.max(axis=0) / DEG
    for k in np.flatnonzero(np.ptp(joints, axis=0) < _NARROW):
        out.append(
            f"Joint {k + 1} moves only from {low[k]:.1f} to {high[k]:.1f} deg: its parameters are hardly seen, and "
            "poses beyond are a guess."
        )
    side = dataset.conditions.side[rows]
    one_sided = np.flatnonzero(np.ptp(side, axis=0) == 0.0)
    if len(one_sided):
        names = ", ".join(str(k + 1) for k in one_sided)
        out.append(
            f"{'Joint' if len(one_sided) == 1 else 'Joints'} {names} always arrived from the same side: backlash "
            "there is invisible, and the result holds for that approach."
        )
    return out


def _repeated(dataset: Dataset, rows: NDArray[np.bool_]) -> list[str]:
    """Ids of readings that equal an earlier one. A length alone is one number, so its time must be the same too."""
    time = np.where(dataset.pointed, 0.0, dataset.conditions.time)
    numbers = np.nan_to_num(
        np.column_stack(
            [dataset.conditions.joints, dataset.points, dataset.orientation, dataset.lengths, time]
        )
    )
    seen: set[bytes] = set()
    out = []
    for i in np.flatnonzero(rows):
        key = numbers[i].tobytes()
        if key in seen:
            out.append(dataset.reading_id[i])
        seen.add(key)
    return out
