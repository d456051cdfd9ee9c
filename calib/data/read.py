"""Data sets read from `NAME.csv` and `NAME.toml` (`truepose-dataset/1`), or from tables.

Implausible values are refused with file, line and column. Columns that look like misspelt missing ones
are refused too: with a misspelt `status` rejected rows would be used.

Expected points are the positions of the target for each reading, by the nominal robot in its fitted
place. An error of scale is in proportion to them. It never refers to the measured point, which a
validation row must not lend to its own prediction. A nominal robot errs by some millimetres; of that, a
scale of 10e-6 makes less than 0.0001 mm.

Readings of one visit share the position in which the robot came to rest. The column `visit` (any text)
names them. Without it, consecutive readings of one pose that was reached by the same move are one visit.
A target that is read again after the robot has moved begins a new visit; one that is read again without
a move does not.

The arrivals of the robot are its order in time, its joint angles before, and its sides of approach, for
each reading. Sides and previous angles are used as recorded, otherwise derived from the order of the
rows within a series. A series does not show how the next one began.
"""

from __future__ import annotations

import hashlib
import re
from dataclasses import replace
from difflib import get_close_matches
from itertools import chain
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calib.arm.kinematics import forward, statics
from calib.arm.robot import Robot
from calib.arm.start import base_and_tool
from calib.array import Array
from calib.data.conditions import Conditions, numbered
from calib.data.dataset import SETS, Dataset
from calib.data.header import Header, read_header
from calib.data.plausible import refuse_implausible, turned_apart
from calib.data.spans import take_spans
from calib.data.unfit import refuse_beyond_limits, refuse_unfit
from calib.errors import DataError
from calib.text.columns import TextTable
from calib.text.toml_table import FARTHEST_MM
from calib.units import DEG

_MOST_DEG = 1e5
_OF_AXIS = re.compile(r"([je]\d+)_(?:deg|mm)")
_MOST_WAYPOINTS = 1e9
_WARMEST_C = 100.0  # air, above or below zero, in which no one measures
_UNITLESS = ("x", "y", "z", "t", "length", "t_air")
_FEWEST = 3  # points that say where a robot is
_NEAR = 0.88  # likeness, of 1: one letter too many, too few or swapped in a name of eight

_ONCE = (
    *(
        "reading_id",
        "series",
        "set",
        "t_s",
        "tool_target",
        "base_target",
        "other_target",
        "x_mm",
        "y_mm",
        "z_mm",
    ),
    *(
        "rot_w",
        "rot_x",
        "rot_y",
        "rot_z",
        "length_mm",
        "u_x_mm",
        "u_y_mm",
        "u_z_mm",
        "u_length_mm",
        "u_rot_mrad",
    ),
    *("t_air_c", "waypoint", "visit", "status"),
)

_FOR_PEOPLE = re.compile(r"[je]\d+_read_(deg|mm)|t_.+_c")
_DIGITS = re.compile(r"\d+")
STILL = 1e-5 * DEG
"""rad; a joint that turned less did not turn: files have four decimals of a degree, sums of them rounding errors."""


def read_dataset(path: Path | str) -> Dataset:
    """Read `NAME.csv` and the `NAME.toml` in the same folder.

    Raises
    ------
    DataError
        The files are not a data set; the error names file, line or key, and the remedy.
    """
    path = Path(path)
    return dataset_of(TextTable.read(path), read_header(path.with_suffix(".toml")))


def dataset_of(table: TextTable, header: Header) -> Dataset:
    """Build the data set of a table and its header.

    Raises
    ------
    DataError
        They are not a data set; the error names file, line or key, and the remedy.
    """
    _refuse_without_units(table, header.robot)
    refuse_misspelt(table, header.robot)
    _refuse_without_ids(table)
    spans, table = take_spans(table, header)
    if not len(table):
        raise DataError(
            "has distances between balls only, and no reading of the arm.",
            do="Measure poses of the robot too.",
            file=table.path,
        )
    joints = _joints(table, header)
    reading_id = tuple(str(name) for name in table.text("reading_id"))
    if "reading_id" not in table:
        reading_id = tuple(str(number) for number in table.lines)
    sets = table.text("set", "calibration")
    for i, name in enumerate(sets):
        if name not in SETS:
            raise table.refuse(i, "set", f"is '{name}'", f"Use {', '.join(SETS)}")
    status = _status(table)
    points, orientation = _measured(table, status, header)
    series, target = _names(table, header)
    time = table.numbers("t_s")
    loading = statics(header.robot, joints, header.loads, header.gravity)
    series_names, series_index = np.unique(series, return_inverse=True)
    order = order_of(time, series_index)
    side, previous = arrivals_of(table, header, joints, order, series_index)
    target_names, target_index = np.unique(target, return_inverse=True)
    anchor_names, anchor_index = _base_targets(table, header)
    fitted = usable = np.isin(status, ("", "ok"))
    if (usable & (sets != "validation")).any():  # else the rows place themselves (`Dataset.placing`)
        fitted = usable & (sets != "validation")
    located = np.where(fitted[:, None], points, np.nan)
    conditions = Conditions(
        joints=joints,
        previous=previous,
        earlier=np.zeros_like(joints),
        side=side,
        torque=loading.torque,
        moment=loading.moment,
        overturning=loading.overturning,
        unit_load=loading.unit_load,
        time=time,
        order=order.astype(np.float64),
        temperature=_air(table),
        point=expected_points(header, joints, series, target, located),
        series=series_index,
        target=target_index,
        anchor=anchor_index,
        waypoint=_waypoints(table),
        visit=np.arange(len(table)),
        series_names=tuple(str(name) for name in series_names),
        target_names=tuple(str(name) for name in target_names),
        anchor_names=anchor_names,
        axis_names=header.robot.axes,
        unit_names=header.robot.units,
    )
    conditions = with_visits(conditions, table.text("visit"))
    conditions = replace(conditions, earlier=moves_before_the_last(conditions))
    dataset = Dataset(
        path=table.path,
        header=header,
        reading_id=reading_id,
        sets=sets,
        status=status,
        conditions=conditions,
        points=points,
        orientation=orientation,
        lengths=table.numbers("length_mm"),
        u_rotation=table.numbers("u_rot_mrad") * 1e-3,
        u_length=table.numbers("u_length_mm"),
        u_point=np.column_stack([table.numbers(f"u_{axis}_mm") for axis in "xyz"]),
        sha256=hashlib.sha256((table.sha256 + header.text).encode()).hexdigest(),
        read_apart=_read_apart(table, header.robot),
        arrivals_told=any(
            name in table for name in (header.robot.approach_columns[0], header.robot.previous_columns[0])
        ),
        spans=spans,
    )
    refuse_unfit(dataset.placing, table)
    refuse_implausible(dataset.placing)
    if not header.beyond_limits:
        refuse_beyond_limits(dataset, table)
    return dataset


def _read_apart(table: TextTable, robot: Robot) -> Array | None:
    """Read the joints as read back minus those commanded, shape (n, N); None without.

    They are controller joints, rad or mm.
    """
    names = [f"{axis}_read_{unit}" for axis, unit in zip(robot.axes, robot.units, strict=True)]
    if not any(name in table for name in names):
        return None
    read, commanded = (
        np.column_stack([table.numbers(name) for name in columns]) for columns in (names, robot.joint_columns)
    )
    return turned_apart((read - commanded) * robot.joint_units, robot.units)


def _air(table: TextTable) -> Array:
    """Read the air temperature, shape (n,), degC.

    Raises
    ------
    DataError
        The numbers have another unit.
    """
    air = table.numbers("t_air_c")
    for i in np.flatnonzero(np.abs(air) > _WARMEST_C):
        raise table.refuse(int(i), "t_air_c", f"is {air[i]:g}", "Give the temperature of the air in degC")
    return air


def _refuse_without_units(table: TextTable, robot: Robot) -> None:
    of_joints = dict(zip(robot.axes, robot.units, strict=True))
    for name in table.names:
        stem = name.lower().replace("_read", "", 1)
        if stem in _UNITLESS or stem in of_joints or (stem.startswith("j") and stem[1:].isdigit()):
            unit = {"t": "s", "t_air": "c", **of_joints}.get(stem, "deg" if stem.startswith("j") else "mm")
            raise DataError(
                f"column '{name}' has no unit in its name.",
                do=f"Name it '{name}_{unit}' if its values are in that unit; convert them first if not.",
                file=table.path,
                line=1,
            )
        for wrong, right in (("_rad", "_deg"), ("_m", "_mm")):
            known = any(stem.startswith(start) for start in ("j", "x", "y", "z", "length", *robot.axes))
            if known and stem.endswith(wrong) and not stem.endswith("_mm") and len(stem.split("_")) == 2:
                raise DataError(
                    f"column '{name}' is not in the unit of the format.",
                    do=f"Convert its values and name it '{name[: -len(wrong)]}{right}'.",
                    file=table.path,
                    line=1,
                )


def _refuse_without_ids(table: TextTable) -> None:
    """Raise DataError if a reading has no id, or that of another.

    In a file without the column the line numbers are the ids.
    """
    if "reading_id" not in table:
        return
    seen: set[str] = set()
    for i, name in enumerate(table.text("reading_id").tolist()):
        if not name:
            raise table.refuse(i, "reading_id", "is empty", "Give every reading an id")
        if name in seen:
            raise table.refuse(i, "reading_id", f"'{name}' is given twice", "Give each reading its own id")
        seen.add(name)


def _joints(table: TextTable, header: Header) -> Array:
    robot = header.robot
    _refuse_other_axes(table, robot)
    first, last = robot.joint_columns[0], robot.joint_columns[-1]
    # what follows other joints stays at 0 in its own column, which may then be left out
    held = {robot.joint_columns[k] for k in robot.followers(header.coupling)}
    for name in robot.joint_columns:
        if name in held and name not in table:
            continue
        table.require(name, f"The robot {robot.name} has {robot.joints} joints: give {first} to {last}.")
    shown = np.column_stack(
        [
            np.zeros(len(table)) if name in held and name not in table else table.numbers(name, required=True)
            for name in robot.joint_columns
        ]
    )
    degrees = shown[:, [kind == "turns" for kind in robot.kinds]]
    if len(degrees) >= 5 and degrees.size and np.max(np.abs(degrees)) <= 2.0 * np.pi + 1e-3:
        name = robot.joint_columns[robot.kinds.index("turns")]
        raise DataError(
            f"no joint angle exceeds {np.max(np.abs(degrees)):.3f}: these can only be radians.",
            do=f"Columns {name}... in degrees: multiply radians by 180/pi.",
            file=table.path,
            key=name,
        )
    for i, k in np.argwhere(np.abs(shown) > _MOST_DEG):
        unit = "degrees" if robot.kinds[k] == "turns" else "mm"
        raise table.refuse(
            int(i), robot.joint_columns[k], f"is {shown[i, k]:g}", f"Give {unit}, not encoder counts"
        )
    return robot.model_angles(shown * robot.joint_units, header.coupling)


def _refuse_other_axes(table: TextTable, robot: Robot) -> None:
    """Raise DataError for a joint that the robot does not have or has in another unit.

    An external axis that never moved is no part of the arm, and may be there.
    """
    kinds = dict(zip(robot.axes, robot.kinds, strict=True))
    for name in table.names:
        if name in robot.joint_columns or not (match := _OF_AXIS.fullmatch(name)):
            continue
        axis = match[1]
        if axis in kinds:
            right = robot.joint_columns[robot.axes.index(axis)]
            raise DataError(
                f"column '{name}' is there, but {axis} of the robot {robot.name} {kinds[axis]}.",
                do=f"Give {right}, or correct the robot file.",
                file=table.path,
                line=1,
            )
        if axis.startswith("e") and np.ptp(np.nan_to_num(table.numbers(name))) == 0.0:
            continue
        raise DataError(
            f"column '{name}' is there, but the robot {robot.name} has {robot.joints} joints: "
            f"{', '.join(robot.axes)}.",
            do="Correct the robot in the header, or remove the column.",
            file=table.path,
            line=1,
        )


def _status(table: TextTable) -> NDArray[np.str_]:
    status = np.array([cell.lower() if cell.lower() == "ok" else cell for cell in table.text("status")])
    for i, cell in enumerate(status):
        if cell not in ("", "ok") and not cell.startswith("rejected"):
            raise table.refuse(i, "status", f"is '{cell}'", "Use ok, rejected:REASON, or leave it empty")
    return status


def _waypoints(table: TextTable) -> NDArray[np.int64]:
    number = table.numbers("waypoint")
    counts = (number >= 0.0) & (number <= _MOST_WAYPOINTS) & (number % 1.0 == 0.0)
    for i in np.flatnonzero(np.isfinite(number) & ~counts):
        raise table.refuse(int(i), "waypoint", f"is {number[i]:g}", "Number the poses 0, 1, 2, ...")
    return np.where(counts, number, -1.0).astype(np.int64)


def _base_targets(table: TextTable, header: Header) -> tuple[tuple[str, ...], NDArray[np.int64]]:
    """Return the names of the base targets, and the index of each row's; -1 without one."""
    named = table.text("base_target")
    lengths = table.numbers("length_mm")
    for i, (name, length) in enumerate(zip(named, lengths, strict=True)):
        if np.isfinite(length) and not name:
            raise table.refuse(i, "base_target", "is empty", "A distance needs the base target it ends at")
        if name and not header.knows_base_target(str(name)):
            raise table.refuse(
                i,
                "base_target",
                f"names '{name}', which the header does not",
                f'Add it under [base_targets], with its position in the world or as {name} = "free"',
            )
        if abs(length) > FARTHEST_MM:
            raise table.refuse(i, "length_mm", f"is {length:g}: no wire is that long", "Give it in mm")
        if length <= 0.0 and not header.frees_length_zero:
            raise table.refuse(
                i,
                "length_mm",
                f"is {length:g}",
                "A distance is above zero; free the group 'length_zero' where lengths count from an unknown zero",
            )
    names = tuple(sorted({str(name) for name in named if name}))
    return names, np.array([names.index(str(name)) if name else -1 for name in named], dtype=np.int64)


def _measured(table: TextTable, status: NDArray[np.str_], header: Header) -> tuple[Array, Array]:
    for axis in "xyz" if "length_mm" not in table else "":
        table.require(
            f"{axis}_mm", "Every reading has a measured point x_mm, y_mm, z_mm (empty where not measured)."
        )
    points = np.column_stack([table.numbers(f"{axis}_mm") for axis in "xyz"])
    for i in np.flatnonzero(np.isfinite(points).any(axis=1) & ~np.isfinite(points).all(axis=1)):
        raise table.refuse(int(i), "x_mm, y_mm, z_mm", "are only partly filled", "Fill all three or none")
    zero = np.all(points == 0.0, axis=1) & np.isin(status, ("", "ok"))
    for i in np.flatnonzero(zero & (not header.at_origin)):
        raise table.refuse(
            int(i),
            "x_mm, y_mm, z_mm",
            "are 0, 0, 0: what trackers send when they see nothing",
            "Leave them empty; or write measured_at_origin = true in the header where a point was measured there",
        )
    for i in np.flatnonzero(np.max(np.abs(np.nan_to_num(points)), axis=1) > FARTHEST_MM):
        raise table.refuse(
            int(i), "x_mm, y_mm, z_mm", "are farther than anything on earth", "Give them in mm"
        )
    orientation = np.column_stack([table.numbers(f"rot_{q}") for q in "wxyz"])
    norm = np.linalg.norm(orientation, axis=1)
    for i in np.flatnonzero(np.abs(norm - 1.0) > 1e-3):
        raise table.refuse(int(i), "rot_w..rot_z", f"have the norm {norm[i]:.4f}", "A quaternion has norm 1")
    partly = np.isfinite(orientation).any(axis=1) & ~np.isfinite(orientation).all(axis=1)
    for i in np.flatnonzero(partly):
        raise table.refuse(int(i), "rot_w..rot_z", "are only partly filled", "Fill all four or none")
    for i in np.flatnonzero(np.isfinite(norm) & ~np.isfinite(points).all(axis=1)):
        raise table.refuse(
            int(i),
            "x_mm, y_mm, z_mm",
            "are empty beside an orientation",
            "A pose has both; give the point too",
        )
    return points, orientation / norm[:, None]


def _names(table: TextTable, header: Header) -> tuple[NDArray[np.str_], NDArray[np.str_]]:
    series = table.text("series", "main")
    for i, name in enumerate(series):
        if header.series_targets and name not in header.series_targets and not header.targets:
            raise table.refuse(i, "series", f"names '{name}'", "Add [series.NAME] to the header")
    everything = set(header.targets).union(*(names for names in header.series_targets.values()))
    if not everything:
        raise DataError(
            "names no tool target.",
            do="Add [tool_targets] with their nominal positions in the flange frame, e.g. T1 = [0.0, 0.0, 125.0].",
            file=table.path.with_suffix(".toml"),
            key="tool_targets",
        )
    only = next(iter(everything)) if len(everything) == 1 else ""
    target = table.text("tool_target", only)
    for i, (name, of_series) in enumerate(zip(target, series, strict=True)):
        if name not in header.targets_of(of_series):
            what = (
                f"names '{name}', which the header does not"
                if name
                else "is empty, and the header has several targets"
            )
            raise table.refuse(i, "tool_target", what, f"Use one of {', '.join(sorted(everything))}")
    return series, target


def expected_points(
    header: Header, joints: Array, series: NDArray[np.str_], target: NDArray[np.str_], measured: Array
) -> Array:
    """Compute the expected points in the world, shape (n, 3), mm.

    If the world is free, every series is brought to its measured points; one without them stays in the
    base frame.

    Parameters
    ----------
    joints : array of shape (n, N)
        Model angles, rad.
    series, target : array of str, shape (n,)
        Names.
    measured : array of shape (n, 3)
        Measured points, mm; NaN in rows that may not enter a fit.
    """
    flange = forward(header.robot, joints)
    points = np.empty_like(measured)
    for name in np.unique(series):
        of = series == name
        known = header.targets_of(str(name))
        which = np.array([list(known).index(t) for t in target[of]])
        tools = np.array(list(known.values()))
        poses = flange[of]
        here = poses[:, :3, 3] + np.einsum("nij,nj->ni", poses[:, :3, :3], tools[which])
        seen = np.isfinite(measured[of, 0])
        if header.world == "free" and seen.sum() >= _FEWEST:
            pose, _ = base_and_tool(poses[seen], tools, which[seen], measured[of][seen], tool_unknown=False)
            here = here @ pose[:3, :3].T + pose[:3, 3]
        points[of] = here
    return points


def refuse_misspelt(table: TextTable, robot: Robot) -> None:
    """Raise DataError for an unknown column that must be a misspelt known one.

    A name that differs only in its number is accepted as it is: a seventh axis.
    """
    of_joint = zip(robot.joint_columns, robot.approach_columns, robot.previous_columns, strict=True)
    read_back = [re.sub("_", "_read_", name, count=1) for name in robot.joint_columns]
    known = [*_ONCE, *chain.from_iterable(zip(*of_joint, strict=True)), *read_back]
    absent = [name for name in known if name not in table]
    for name in table.names:
        if name in known or _FOR_PEOPLE.fullmatch(name):
            continue
        near = get_close_matches(name.strip().lower(), absent, n=1, cutoff=_NEAR)
        if near and _typed_for(name, near[0]):
            raise DataError(
                f"column '{name}' is not known.",
                do=f"Did you mean '{near[0]}'? Correct it, or give it a name less like it.",
                file=table.path,
                line=1,
            )


def _typed_for(name: str, known: str) -> bool:
    """Test whether a name may be a known one with a typing error.

    It is none if a number differs, a word was added, or another single letter stands for one
    (`d_length_mm` for `u_length_mm`).
    """
    if _DIGITS.sub("", known) == _DIGITS.sub("", name):
        return False
    words, others = (text.strip().lower().split("_") for text in (name, known))
    if len(words) != len(others):
        return "".join(words) == "".join(others)
    return all(len(a) > 1 or len(b) > 1 for a, b in zip(words, others, strict=True) if a != b)


def with_visits(conditions: Conditions, named: NDArray[np.str_]) -> Conditions:
    """Add the visits to the conditions of all n readings of a data set.

    `named` (n,) are the recorded names, empty if not recorded. Two records may count their visits alike,
    so readings of one name with another pose between them are two visits.
    """
    visit, unnamed = visits_of(conditions), named == ""
    if unnamed.all():
        return replace(conditions, visit=visit)
    stay = np.empty(len(visit), dtype=np.int64)
    in_time = np.argsort(conditions.order, kind="stable")
    stay[in_time] = np.cumsum(_goes_elsewhere(conditions, in_time))
    name = np.unique(named, return_inverse=True)[1].reshape(-1)
    return replace(conditions, visit=numbered(np.column_stack([stay, name, np.where(unnamed, visit, -1)])))


def visits_of(conditions: Conditions) -> NDArray[np.int64]:
    """Number the visit of every reading from the moves of the robot, shape (n,)."""
    in_time = np.argsort(conditions.order, kind="stable")
    joints, previous, side = (of[in_time] for of in (conditions.joints, conditions.previous, conditions.side))
    begins = _goes_elsewhere(conditions, in_time)
    still = ~begins & (_farthest(previous[1:] - joints[:-1]) <= STILL)
    same_move = _farthest(np.diff(previous, axis=0)) <= STILL
    # joints that were interpolated between two samples seem to turn, a little, while the robot stands
    turned = np.any(np.diff(side, axis=0, prepend=side[:1]) != 0.0, axis=1)
    turned &= ~still | (conditions.waypoint[in_time] < 0)
    stop = np.cumsum(begins | turned | ~(still | same_move))
    what = np.column_stack(
        [stop, still.astype(np.int64), conditions.target[in_time], conditions.anchor[in_time]]
    )
    visit = np.empty(len(stop), dtype=np.int64)
    visit[in_time] = numbered(np.column_stack([stop, np.where(still, 0, _times_before(what))]))
    return visit


def moves_before_the_last(conditions: Conditions) -> Array:
    """Compute the move before the last for every reading, shape (n, N).

    It is the same in all readings of a visit. It leads from the reading before to the start of the last
    move. If the robot had not moved between, it is that reading's own last move. Effects of moves
    further back than the last on a joint show only in this quantity.
    """
    in_time = np.argsort(conditions.order, kind="stable")
    _, first, place = np.unique(conditions.visit[in_time], return_index=True, return_inverse=True)
    rows = in_time[np.sort(first)]  # the first reading of every visit, in order of time
    joints, previous, series = conditions.joints[rows], conditions.previous[rows], conditions.series[rows]
    led = previous[1:] - joints[:-1]
    own = joints[:-1] - previous[:-1]
    moves = np.zeros_like(joints)
    moved = np.max(np.abs(led), axis=1, initial=0.0) > STILL
    moves[1:] = np.where(moved[:, None], led, own)
    moves[1:][series[1:] != series[:-1]] = 0.0
    out = np.empty_like(conditions.joints)
    out[in_time] = moves[np.argsort(np.argsort(first))[place.reshape(-1)]]
    return out


def _goes_elsewhere(conditions: Conditions, in_time: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Mark readings of another pose or series than the one before, shape (n,), in order of time."""
    place = np.column_stack([conditions.series, conditions.pose])[in_time]
    return np.any(np.diff(place, axis=0, prepend=-1) != 0, axis=1)


def _farthest(moves: Array) -> Array:
    """Compute the largest turn of a joint in each of moves (n, N), shape (n + 1,).

    It is infinite before the first.
    """
    return np.append(np.inf, np.max(np.abs(moves), axis=1))


def _times_before(keys: NDArray[np.int64]) -> NDArray[np.int64]:
    """Count the equal rows before each row of keys (n, c), shape (n,)."""
    which = numbered(keys)
    sorted_by = np.argsort(which, kind="stable")
    first = np.searchsorted(which[sorted_by], which[sorted_by])
    times = np.empty(len(which), dtype=np.int64)
    times[sorted_by] = np.arange(len(which)) - first
    return times


def order_of(time: Array, series: NDArray[np.int64]) -> NDArray[np.int64]:
    """Rank every row, shape (n,): series by series as they first appear, in time within each.

    Rows without a time count in the order that they have in the file. Clocks of two series may both
    start at zero.
    """
    _, first = np.unique(series, return_index=True)
    appearance = np.argsort(np.argsort(first))[series]
    key = time if np.all(np.isfinite(time)) else np.arange(len(time))
    order = np.empty(len(time), dtype=np.int64)
    order[np.lexsort((np.arange(len(time)), key, appearance))] = np.arange(len(time))
    return order


def arrivals_of(
    table: TextTable, header: Header, joints: Array, order: NDArray[np.int64], series: NDArray[np.int64]
) -> tuple[Array, Array]:
    """Return the sides of approach and the previous model joints, both (n, N).

    The sides are +1 from below or -1 from above; the joints are in rad or mm.

    Raises
    ------
    DataError
        A recorded side is neither +1 nor -1.
    """
    robot = header.robot
    in_time = np.argsort(order)
    begins = np.append(True, series[in_time[1:]] != series[in_time[:-1]])
    before = np.empty_like(joints)
    before[in_time[1:]] = joints[in_time[:-1]]
    before[in_time[begins]] = joints[in_time[begins]]
    recorded = np.column_stack([table.numbers(name) for name in robot.previous_columns]) * robot.joint_units
    recorded = robot.model_angles(recorded, header.coupling)
    previous = np.where(np.isfinite(recorded), recorded, before)
    side = np.column_stack([table.numbers(name) for name in robot.approach_columns])
    for i, k in np.argwhere(np.isfinite(side) & ~np.isin(side, (-1.0, 1.0))):
        raise table.refuse(
            int(i), robot.approach_columns[k], f"is {side[i, k]:g}", "Use +1 (from below) or -1 (from above)"
        )
    if header.coupling != "none":
        matrix = np.array(header.robot.joint_matrices[header.coupling].matrix)
        side = side * np.sign(np.diag(matrix))
        # A model joint that several controller joints turn has no separate recorded side: derive it.
        side[:, np.count_nonzero(matrix, axis=1) > 1] = np.nan
    derived = _derived(_last_move(joints, previous, before), in_time, begins)
    return np.where(np.isfinite(side), side, derived), previous


def _last_move(joints: Array, previous: Array, before: Array) -> Array:
    """Return the signs of the last moves (n, N).

    A move starts where the row's own move began. If a joint did not move then, the move that led to that
    place counts. Two joints of a controller may turn against each other and leave the model joint that
    both turn where it is.
    """
    own, earlier = joints - previous, previous - before
    led_there = np.where(np.abs(earlier) > STILL, np.sign(earlier), 0.0)
    return np.where(np.abs(own) > STILL, np.sign(own), led_there)


def _derived(moved: Array, in_time: NDArray[np.int64], begins: NDArray[np.bool_]) -> Array:
    """Derive the sides of approach from the signs of the moves (n, N).

    A joint that did not move still rests on the side of its last move.
    """
    in_order = moved[in_time]
    rank = np.arange(len(moved))[:, None]
    start = np.maximum.accumulate(np.where(begins, np.arange(len(moved)), 0))[:, None]
    last = np.maximum(np.maximum.accumulate(np.where(in_order != 0.0, rank, 0), axis=0), start)
    derived = np.empty_like(moved)
    derived[in_time] = np.take_along_axis(in_order, last, axis=0)
    derived[derived == 0.0] = 1.0
    return derived
