"""A data set: the readings of a campaign as arrays, with their header. Frozen once read.

`read_dataset` reads `NAME.csv` + `NAME.toml` (`truepose-dataset/1`) and refuses, by file, line and column, what
it cannot trust. Rows of `set = validation` never enter a fit or a choice: `fit_rows` leaves them out.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calib.arrivals import arrivals_of, order_of
from calib.columns import Columns
from calib.conditions import Conditions
from calib.errors import DataError
from calib.expected import expected_points
from calib.header import FARTHEST_MM, LEAST, Header, read_header
from calib.kinematics import Array, statics
from calib.plausible import refuse_implausible
from calib.units import DEG

_FEWEST_A_SERIES = 3
_MOST_DEG = 1e5
_BEYOND_DEG = 2.0  # by which a joint may exceed its limit: limits are set a little apart in many a controller
SETS = ("calibration", "reference", "repeat", "validation")
_UNITLESS = ("x", "y", "z", "t", "length", "t_air")


@dataclass(frozen=True)
class Dataset:
    """n readings and what holds for all of them."""

    path: Path
    header: Header
    reading_id: tuple[str, ...]
    sets: NDArray[np.str_]  # (n,)
    status: NDArray[np.str_]  # (n,) empty or "ok", else "rejected:REASON"
    conditions: Conditions
    points: Array  # (n, 3) mm, NaN where not measured
    orientation: Array  # (n, 4) quaternion, scalar first, NaN where not measured
    lengths: Array  # (n,) mm from the tool target to the base target, NaN where not measured
    u_point: Array  # (n, 3) mm, NaN where the header's noise holds
    u_rotation: Array  # (n,) rad, likewise
    u_length: Array  # (n,) mm, likewise
    sha256: str

    def __len__(self) -> int:
        return len(self.reading_id)

    @property
    def name(self) -> str:
        """Name of the file."""
        return self.path.name

    @cached_property
    def pointed(self) -> NDArray[np.bool_]:
        """(n,) a point was measured."""
        return np.isfinite(self.points[:, 0])

    @cached_property
    def turned(self) -> NDArray[np.bool_]:
        """(n,) an orientation was measured, and its noise declared: without, nobody knows what it is worth."""
        weighed = np.isfinite(self.u_rotation) | (self.header.noise.rotation > 0.0)
        return np.isfinite(self.orientation[:, 0]) & weighed

    @cached_property
    def spanned(self) -> NDArray[np.bool_]:
        """(n,) a distance was measured."""
        return np.isfinite(self.lengths)

    @cached_property
    def usable(self) -> NDArray[np.bool_]:
        """(n,) measured and not rejected."""
        return np.isin(self.status, ("", "ok")) & (self.pointed | self.spanned)

    @cached_property
    def fit_rows(self) -> NDArray[np.bool_]:
        """(n,) rows that may enter a fit."""
        return self.usable & (self.sets != "validation")

    @cached_property
    def validation_rows(self) -> NDArray[np.bool_]:
        """(n,) measured rows that only ever judge."""
        return self.usable & (self.sets == "validation")

    @cached_property
    def numbers(self) -> int:
        """How many numbers were measured in the rows that enter a fit."""
        rows = self.fit_rows
        return int(
            3 * (self.pointed & rows).sum() + 3 * (self.turned & rows).sum() + (self.spanned & rows).sum()
        )


def read_dataset(path: Path | str) -> Dataset:
    """Read `NAME.csv` and the `NAME.toml` beside it. Raises DataError (file, line or key, what to do)."""
    path = Path(path)
    table = Columns(path)
    header = read_header(path.with_suffix(".toml"))
    _refuse_without_units(table)
    joints = _joints(table, header)
    reading_id = tuple(str(name) for name in table.text("reading_id"))
    if "reading_id" not in table:
        reading_id = tuple(str(number) for number in table.lines)
    for i, name in enumerate(reading_id):
        if not name:
            raise table.refuse(i, "reading_id", "is empty", "Give every reading an id")
    if len(set(reading_id)) != len(reading_id):
        seen: set[str] = set()
        for i, name in enumerate(reading_id):
            if name in seen:
                raise table.refuse(i, "reading_id", f"'{name}' stands twice", "Give every reading its own id")
            seen.add(name)
    sets = table.text("set", "calibration")
    for i, name in enumerate(sets):
        if name not in SETS:
            raise table.refuse(i, "set", f"is '{name}'", f"Use {', '.join(SETS)}")
    status = _status(table)
    points, orientation = _measured(table, status)
    series, target = _names(table, header)
    time = table.numbers("t_s")
    loading = statics(header.robot, joints, header.loads, header.gravity)
    series_names, series_index = np.unique(series, return_inverse=True)
    order = order_of(time, series_index)
    side, previous = arrivals_of(table, header, joints, order, series_index)
    target_names, target_index = np.unique(target, return_inverse=True)
    anchor_names, anchor_index = _base_targets(table, header)
    fitted = np.isin(status, ("", "ok")) & (sets != "validation")
    located = np.where(fitted[:, None], points, np.nan)
    conditions = Conditions(
        joints=joints,
        previous=previous,
        side=side,
        torque=loading.torque,
        moment=loading.moment,
        overturning=loading.overturning,
        unit_load=loading.unit_load,
        time=time,
        order=order.astype(np.float64),
        temperature=table.numbers("t_air_c"),
        point=expected_points(header, joints, series, target, located),
        series=series_index,
        target=target_index,
        anchor=anchor_index,
        series_names=tuple(str(name) for name in series_names),
        target_names=tuple(str(name) for name in target_names),
        anchor_names=anchor_names,
    )
    dataset = Dataset(
        path=path,
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
    )
    _refuse_unfit(dataset, table)
    refuse_implausible(dataset)
    if not header.beyond_limits:
        _refuse_beyond_limits(dataset, table)
    return dataset


def _refuse_without_units(table: Columns) -> None:
    for name in table.names:
        stem = name.lower()
        if stem in _UNITLESS or (stem.startswith("j") and stem[1:].isdigit()):
            unit = {"t": "s", "t_air": "c"}.get(stem, "deg" if stem.startswith("j") else "mm")
            raise DataError(
                f"column '{name}' has no unit in its name.",
                do=f"Name it '{name}_{unit}' if its values are in that unit; convert them first if not.",
                file=table.path,
                line=1,
            )
        for wrong, right in (("_rad", "_deg"), ("_m", "_mm")):
            known = any(stem.startswith(start) for start in ("j", "x", "y", "z", "length"))
            if known and stem.endswith(wrong) and not stem.endswith("_mm") and len(stem.split("_")) == 2:
                raise DataError(
                    f"column '{name}' is not in the unit of the format.",
                    do=f"Convert its values and name it '{name[: -len(wrong)]}{right}'.",
                    file=table.path,
                    line=1,
                )


def _joints(table: Columns, header: Header) -> Array:
    count = header.robot.joints
    for k in range(1, count + 1):
        table.require(
            f"j{k}_deg", f"The robot {header.robot.name} has {count} joints: give j1_deg to j{count}_deg."
        )
    if f"j{count + 1}_deg" in table:
        raise DataError(
            f"column 'j{count + 1}_deg' is there, but the robot {header.robot.name} has {count} joints.",
            do="Correct the robot in the header, or remove the column.",
            file=table.path,
            line=1,
        )
    degrees = np.column_stack([table.numbers(f"j{k}_deg", required=True) for k in range(1, count + 1)])
    if len(degrees) >= 5 and np.max(np.abs(degrees)) <= 2.0 * np.pi + 1e-3:
        raise DataError(
            f"no joint angle exceeds {np.max(np.abs(degrees)):.3f}: these can only be radians.",
            do="Columns j1_deg... hold degrees: multiply by 180/pi.",
            file=table.path,
            key="j1_deg",
        )
    for i, k in np.argwhere(np.abs(degrees) > _MOST_DEG):
        raise table.refuse(
            int(i), f"j{k + 1}_deg", f"is {degrees[i, k]:g}", "Give degrees, not encoder counts"
        )
    return header.robot.model_angles(degrees * DEG, header.coupling)


def _refuse_beyond_limits(dataset: Dataset, table: Columns) -> None:
    """No robot goes there: a typing error, or another robot."""
    robot, conditions = dataset.header.robot, dataset.conditions
    angles = robot.controller_angles(conditions.joints, dataset.header.coupling) / DEG
    lower, upper = np.array(robot.lower) / DEG, np.array(robot.upper) / DEG
    beyond = (angles < lower - _BEYOND_DEG) | (angles > upper + _BEYOND_DEG)
    for i, k in np.argwhere(beyond & dataset.usable[:, None])[:1]:
        raise table.refuse(
            int(i),
            f"j{k + 1}_deg",
            f"is {angles[i, k]:g}, and joint {k + 1} of {robot.name} goes from {lower[k]:g} to {upper[k]:g} deg",
            "Correct it, or write beyond_limits = true in the header where the robot really went there",
        )


def _status(table: Columns) -> NDArray[np.str_]:
    status = np.array([cell.lower() if cell.lower() == "ok" else cell for cell in table.text("status")])
    for i, cell in enumerate(status):
        if cell not in ("", "ok") and not cell.startswith("rejected"):
            raise table.refuse(i, "status", f"is '{cell}'", "Use ok, rejected:REASON, or leave it empty")
    return status


def _base_targets(table: Columns, header: Header) -> tuple[tuple[str, ...], NDArray[np.int64]]:
    """Names of the base targets, and the index of each row's, -1 where the row has none."""
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


def _measured(table: Columns, status: NDArray[np.str_]) -> tuple[Array, Array]:
    for axis in "xyz" if "length_mm" not in table else "":
        table.require(
            f"{axis}_mm", "Every reading has a measured point x_mm, y_mm, z_mm (empty where not measured)."
        )
    points = np.column_stack([table.numbers(f"{axis}_mm") for axis in "xyz"])
    for i in np.flatnonzero(np.isfinite(points).any(axis=1) & ~np.isfinite(points).all(axis=1)):
        raise table.refuse(int(i), "x_mm, y_mm, z_mm", "are only partly filled", "Fill all three or none")
    zero = np.all(points == 0.0, axis=1) & np.isin(status, ("", "ok"))
    for i in np.flatnonzero(zero):
        raise table.refuse(
            int(i), "x_mm, y_mm, z_mm", "are 0, 0, 0: what trackers send for nothing", "Leave them empty"
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


def _names(table: Columns, header: Header) -> tuple[NDArray[np.str_], NDArray[np.str_]]:
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


def _refuse_unfit(dataset: Dataset, table: Columns) -> None:
    rows = dataset.fit_rows
    if not rows.any():
        raise DataError(
            "has no calibration rows that were measured.",
            do="Mark some rows set = calibration; validation rows never enter a fit.",
            file=table.path,
            key="set",
        )
    pointed = dataset.points[rows & dataset.pointed]
    if len(np.unique(dataset.conditions.joints[rows], axis=0)) == 1 or (
        len(pointed) == int(rows.sum()) and np.ptp(pointed, axis=0).max() < 1.0
    ):
        raise DataError(
            "all calibration readings are the same.",
            do="Measure poses all over the joint ranges.",
            file=table.path,
            key="j1_deg.. x_mm..",
        )
    conditions = dataset.conditions
    for s, name in enumerate(conditions.series_names):
        few = int(rows[conditions.series == s].sum())
        if few < _FEWEST_A_SERIES:
            raise DataError(
                f"series '{name}' has {few} calibration readings: they cannot say where its base stands.",
                do=f"Measure {_FEWEST_A_SERIES} or more with set = calibration, or leave the series out.",
                file=table.path,
                key="set",
            )
    if "tool" in dataset.header.groups:
        pairs = {
            (int(s), int(t)) for s, t in zip(conditions.series[rows], conditions.target[rows], strict=True)
        }
        for i, pair in enumerate(zip(conditions.series, conditions.target, strict=True)):
            if (int(pair[0]), int(pair[1])) not in pairs:
                raise table.refuse(
                    i,
                    "tool_target",
                    f"names {conditions.target_names[pair[1]]}, which no calibration reading measured",
                    "With 'tool' under [model] fit every target needs calibration readings of its series",
                )
    given = np.isfinite(dataset.u_point)
    for i in np.flatnonzero(given.any(axis=1) & ~(given & (dataset.u_point >= LEAST)).all(axis=1)):
        raise table.refuse(
            int(i),
            "u_x_mm, u_y_mm, u_z_mm",
            "are not all above zero",
            "Give all three, or none for [noise] to hold",
        )
    if dataset.header.noise.kind == "per-row":
        pointed_rows = dataset.usable & dataset.pointed
        for i in np.flatnonzero(pointed_rows & ~np.all(dataset.u_point >= LEAST, axis=1)):
            raise table.refuse(
                int(i),
                "u_x_mm",
                "is empty or zero, and [noise] kind is 'per-row'",
                "Give u_x_mm, u_y_mm, u_z_mm",
            )
    _refuse_without_noise(dataset, table)


def _refuse_without_noise(dataset: Dataset, table: Columns) -> None:
    """Distances weigh by their own noise, which cannot be guessed."""
    for of_row, column in ((dataset.u_rotation, "u_rot_mrad"), (dataset.u_length, "u_length_mm")):
        for i in np.flatnonzero(np.isfinite(of_row) & ~(of_row >= LEAST * 1e-3)):
            raise table.refuse(int(i), column, "is not above zero", "Leave it empty for [noise] to hold")
    missing = np.flatnonzero(dataset.usable & dataset.spanned & ~np.isfinite(dataset.u_length))
    if dataset.header.noise.length_mm == 0.0 and len(missing):
        raise DataError(
            f"is missing or zero, but line {table.lines[int(missing[0])]} of {dataset.path.name} holds a distance.",
            do="Give its standard uncertainty under [noise], or fill the column u_length_mm.",
            file=dataset.path.with_suffix(".toml"),
            key="noise.length_mm",
        )
