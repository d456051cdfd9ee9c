"""Convert the six legs of a ballbar hexapod to points.

The result is a separate data set. A visit of the robot in which all six legs were measured becomes three points,
the balls of the tool. The pose follows from the direct kinematics in closed form of `calib.arm.hexapod`.

The sides of the triangles are those that the ballbar measured, otherwise those of the stated positions. Of the
assembly modes, the one nearest to the nominal robot is used. The frame is that of the stated base balls, over which
the measured triangle is laid.

`identify` fits such points like those of a tracker. Fitting the legs themselves also uses visits in which some were
out of stroke, and the constraints between the three balls. Lengths are in mm. Source: Nubiola, thesis, sections 3.2
and 4.3.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calib.arm.hexapod import LEGS, HexapodPoses, solve_pose
from calib.arm.start import align
from calib.array import Array
from calib.convert.table import ConvertedTable
from calib.data.dataset import Dataset
from calib.data.header import Vector
from calib.data.read import read_dataset
from calib.data.spans import OTHER
from calib.errors import DataError
from calib.fit.placing import base_model_of
from calib.model.model import BoundModel
from calib.text.columns import TextTable

FAR_MM = 30.0
"""A pose farther from the nominal robot is none of this robot, or one of its legs is another."""
_OF_BASE, _OF_TOOL = (np.bincount([leg[side] for leg in LEGS], minlength=3) for side in (0, 1))
_SIDES = ((0, 1), (1, 2), (2, 0))
_FIRST_LEG = tuple(next(i for i, leg in enumerate(LEGS) if leg[1] == ball) for ball in range(3))
_NOISE = re.compile(r'(^\[noise\]$[^\[]*?^kind\s*=\s*)"[^"\n]*"', re.MULTILINE)


@dataclass(frozen=True)
class _Visit:
    """A visit with all six legs.

    `rows` are the readings of the legs in the order of the design. `base` and `tool` name its three balls each.
    """

    rows: tuple[int, ...]
    base: tuple[str, ...]
    tool: tuple[str, ...]
    series: str


@dataclass(frozen=True)
class SolvedPoses:
    """The solved poses of n visits.

    `points` (n, 3, 3) are T1, T2 and T3 of each design in the world, mm, one per row, and `u_mm` their standard
    uncertainties. `far_mm` (n,) is the largest distance of a point from its place according to the nominal robot.
    """

    visits: tuple[_Visit, ...]
    points: Array
    u_mm: Array
    far_mm: Array


def read(path: Path) -> ConvertedTable:
    """Convert a data set of legs to a table of points.

    Raises
    ------
    DataError
        No visit has all six legs, or none is near the nominal robot, or the header cannot be converted.
    """
    dataset = read_dataset(path)
    solved = solved_poses(dataset)
    if not np.any(solved.far_mm <= FAR_MM):
        raise DataError(
            "has no visit whose six legs meet near the nominal robot.",
            do="Check whether the legs are labelled with the balls that they join, and whether it is this robot.",
            file=path,
        )
    rows = TextTable.read(path)
    rows = rows.where(rows.text(OTHER) == "")
    kept = [
        name
        for name in rows.names
        if name not in ("base_target", OTHER, "length_mm", "u_length_mm", "status")
    ]
    cells = {name: rows.text(name) for name in kept}
    out: dict[str, list[str]] = {name: [] for name in (*kept, *_named("{}_mm"), *_named("u_{}_mm"), "status")}
    for visit, points, u_points, far in zip(
        solved.visits, solved.points, solved.u_mm, solved.far_mm, strict=True
    ):
        why = "" if far <= FAR_MM else f"rejected:its legs meet {far:.0f} mm from where the robot is"
        for ball, point, u_mm in zip(visit.tool, points, u_points, strict=True):
            for name in kept:
                out[name].append(str(cells[name][visit.rows[-1]]))
            out["reading_id"][-1] += f"-{ball}"
            out["tool_target"][-1] = ball
            out["status"].append(why or "ok")
            for axis, value, u in zip("xyz", point, u_mm, strict=True):
                out[f"{axis}_mm"].append("" if why else f"{value:.6f}")
                out[f"u_{axis}_mm"].append("" if why else f"{u:.6f}")
    header, found = _NOISE.subn(r'\1"per-row"', dataset.header.text)
    if found != 1:
        raise DataError(
            "has no table [noise] with its own line for 'kind'.",
            do='Write it as [noise] and, on a separate line, kind = "isotropic".',
            file=path.with_suffix(".toml"),
            key="noise",
        )
    return ConvertedTable(out, header)


def solved_poses(dataset: Dataset) -> SolvedPoses:
    """Solve the pose of each visit with all six legs.

    Raises
    ------
    DataError
        There is no such visit, or a ball has no position.
    """
    visits = tuple(_visits(dataset))
    if not visits:
        raise DataError(
            "has no visit of the robot in which all six legs of a hexapod were measured.",
            do="Give the data set of a campaign with a block of kind 'hexapod'.",
            file=dataset.path,
        )
    lengths, u_mm = (np.array(each) for each in zip(*(_lengths(dataset, s) for s in visits), strict=True))
    poses = solve_pose(lengths)
    covariance = poses.ball_covariance(u_mm).reshape(len(visits), -1, 3, 3, 3, 3)
    own = np.einsum("nmkikj->nmkij", covariance)  # of each ball by itself
    turn, shift = _frames(dataset, visits, poses)
    there = np.einsum("nij,nmkj->nmki", turn, poses.tool) + shift[:, None, None]
    model = base_model_of(dataset)
    nominal = BoundModel(model, dataset.conditions).predict(np.zeros(len(model.parameters)))
    rows = np.array([[visit.rows[leg] for leg in _FIRST_LEG] for visit in visits])
    off = np.linalg.norm(there - nominal[rows][:, None], axis=3).max(axis=2)  # (n, 8)
    mode = np.argmin(np.where(np.isfinite(off), off, np.inf), axis=1)
    each = np.arange(len(visits))
    spread = np.einsum("nia,nkab,nib->nki", turn, own[each, mode], turn)
    far = np.where(np.isfinite(off[each, mode]), off[each, mode], np.inf)
    return SolvedPoses(visits, there[each, mode], np.sqrt(spread), far)


def _frames(dataset: Dataset, visits: tuple[_Visit, ...], poses: HexapodPoses) -> tuple[Array, Array]:
    """Compute the frames that lay the measured base triangles over the stated base balls.

    Returns
    -------
    turn : array of shape (n, 3, 3)
        Rotations.
    shift : array of shape (n, 3)
        Shifts, mm.
    """
    turn, shift = np.zeros((len(visits), 3, 3)), np.zeros((len(visits), 3))
    labels = [visit.base for visit in visits]
    for base in dict.fromkeys(labels):  # six at most
        of = np.array([label == base for label in labels])
        stated = np.array(
            [_place(dataset.header.base_targets, name, dataset, "base_targets") for name in base]
        )
        turn[of], shift[of] = align(poses.base[of][0], stated, np.ones(3))
    return turn, shift


def _visits(dataset: Dataset) -> Iterable[_Visit]:
    """Yield the visits in which all six legs of one design were measured.

    If a leg was measured twice, the last reading counts. If no visit of a pose has all six, for example because a
    leg was measured again later, the legs of that pose are combined.
    """
    conditions = dataset.conditions
    left = np.flatnonzero(dataset.usable & dataset.spanned)
    # of one pose in another series, or held out, the legs are of another tool or for another purpose
    _, pose = np.unique(
        np.column_stack([conditions.pose, conditions.series, dataset.sets == "validation"]),
        axis=0,
        return_inverse=True,
    )
    pose = pose.reshape(-1)
    whole: list[int] = []
    for stay in (conditions.visit, pose):
        left = left[~np.isin(pose[left], whole)]
        _, which = np.unique(np.column_stack([pose, stay])[left], axis=0, return_inverse=True)
        which = which.reshape(-1)
        for of in np.split(left[np.argsort(which, kind="stable")], np.cumsum(np.bincount(which))[:-1]):
            visit = _of_legs(dataset, of)
            if visit is not None:
                whole.append(int(pose[of[0]]))
                yield visit


def _of_legs(dataset: Dataset, rows: NDArray[np.int64]) -> _Visit | None:
    """Combine legs to a visit; None if they make no design.

    Of several readings of a leg, the last counts.
    """
    conditions = dataset.conditions
    legs = {
        (
            conditions.anchor_names[conditions.anchor[row]],
            conditions.target_names[conditions.target[row]],
        ): row
        for row in rows.tolist()
    }
    design = _design(legs)
    if design is None:
        return None
    base, tool = design
    in_order = tuple(legs[base[b], tool[t]] for b, t in LEGS)
    return _Visit(in_order, base, tool, conditions.series_names[conditions.series[in_order[0]]])


def _design(legs: Iterable[tuple[str, str]]) -> tuple[tuple[str, ...], tuple[str, ...]] | None:
    """Return the balls of the base and of the tool in the order of the design of the legs.

    None if the legs make no design.
    """
    legs = set(legs)
    found = []
    for side, wanted in ((0, _OF_BASE), (1, _OF_TOOL)):
        ends = [leg[side] for leg in legs]
        by_count = {ends.count(name): name for name in ends}
        if set(by_count) != set(wanted.tolist()) or len(set(ends)) != 3:
            return None
        found.append(tuple(by_count[count] for count in wanted.tolist()))
    base, tool = found
    return (base, tool) if legs == {(base[b], tool[t]) for b, t in LEGS} else None


def _lengths(dataset: Dataset, visit: _Visit) -> tuple[list[float], list[float]]:
    """Return the twelve lengths of a visit and their uncertainties, mm.

    The order is that of `calib.arm.hexapod.LENGTHS`.
    """
    header = dataset.header
    declared = np.where(np.isfinite(dataset.u_length), dataset.u_length, header.noise.length_mm)
    legs = [(float(dataset.lengths[row]), float(declared[row])) for row in visit.rows]
    sides = (
        [_side(dataset, visit.base[i], visit.base[j], "") for i, j in _SIDES],
        [_side(dataset, visit.tool[i], visit.tool[j], visit.series) for i, j in _SIDES],
    )
    order = (0, 2, 5, 1, 3, 4)  # of LEGS: r11 r12 r21 r22 r23 r31 -> r11 r21 r31 r12 r22 r23
    both = [*sides[0], *(legs[leg] for leg in order), *sides[1]]
    return [length for length, _ in both], [u for _, u in both]


def _side(dataset: Dataset, one: str, other: str, series: str) -> tuple[float, float]:
    """Return the distance of two balls of one body and its uncertainty, mm.

    It is the distance that the ballbar measured, otherwise that of the stated positions.
    """
    measured = [s for s in dataset.spans if s.series == series and {s.one, s.other} == {one, other}]
    if measured:
        u = max(span.u_mm for span in measured) / np.sqrt(len(measured))
        return float(np.mean([span.length_mm for span in measured])), float(u)
    header = dataset.header
    places, key = (
        (header.targets_of(series), "tool_targets") if series else (header.base_targets, "base_targets")
    )
    known = header.tool_targets_u_mm if series else header.base_targets_u_mm
    ends = [np.array(_place(places, name, dataset, key)) for name in (one, other)]
    u = np.hypot(known.get(one, 0.0), known.get(other, 0.0))
    return float(np.linalg.norm(ends[0] - ends[1])), float(max(u, header.noise.length_mm))


def _place(places: Mapping[str, Vector], name: str, dataset: Dataset, key: str) -> Vector:
    if name not in places:
        raise DataError(
            f"has no position of {name}, without which no pose can be solved.",
            do="Give its position.",
            file=dataset.path.with_suffix(".toml"),
            key=key,
        )
    return places[name]


def _named(name: str) -> list[str]:
    return [name.format(axis) for axis in "xyz"]
