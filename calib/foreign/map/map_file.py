"""Map of foreign files, `map.toml` (`truepose-map/1`), and conventions of orientation.

The map states the quantity and unit of each column, and how files belong together. It is proposed once
(`calib.foreign.proposal`), kept, and used for every further file of the same form. It lists the names of
the columns for which it was made. A file with other names is refused with the difference. `?` marks an
undecided value.

A convention states how three numbers are an orientation. `intrinsic-XYZ` turns about the axes as they
have turned, `fixed-XYZ` about those that stay; the three columns are in the order in which the
convention is written. The names are those that people know. Sources: KUKA (A, B, C about Z, Y', X''),
Fanuc (W, P, R about fixed X, Y, Z), Staubli (Rx, Ry, Rz about X, Y', Z''), UR (a rotation vector, about
its direction by its length).
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w
from scipy.spatial.transform import Rotation

from calib.array import Array
from calib.errors import DataError
from calib.foreign.files.layout import Layout
from calib.foreign.files.sheet import SEPARATORS
from calib.text.toml_table import TomlTable, read_toml

FORMAT = "truepose-map/1"
UNDECIDED = "?"
BY = ("name", "order", "time")
MATRIX = tuple(f"rot_{row}{column}" for row in (1, 2, 3) for column in (1, 2, 3))
"""Quantities of a rotation matrix, row by row."""

_TEXT = ("id", "pose", "series", "set", "target", "status", "waypoint", "visit")

_NUMBER = (
    "time",
    "t_air",
    "x",
    "y",
    "z",
    "rot_1",
    "rot_2",
    "rot_3",
    "rot_w",
    "rot_x",
    "rot_y",
    "rot_z",
    *MATRIX,
)

_TOGETHER = (("x", "y", "z"), ("rot_1", "rot_2", "rot_3"), ("rot_w", "rot_x", "rot_y", "rot_z"), MATRIX)
_NUMBERED = re.compile(r"(j|e|read|prev|approach)([1-9]\d?)")
UNITLESS = ("rot_w", "rot_x", "rot_y", "rot_z")

_FILE = (
    "names",
    "sheet",
    "separator",
    "decimal",
    "thousands",
    "lines",
    "fill_down",
    "columns",
    "targets",
    "rotation",
    "status_ok",
)

NAMED = {
    "kuka-abc": "ZYX",
    "fanuc-wpr": "xyz",
    "staubli": "XYZ",
    "roll-pitch-yaw": "xyz",
}

VECTOR = "rotation-vector"
USUAL = ("kuka-abc", "fanuc-wpr", "staubli", VECTOR)
"""Conventions that are asked about, each rotation once: `roll-pitch-yaw` is `fanuc-wpr` by another name."""

_SEQUENCE = re.compile(r"(intrinsic|fixed)-([XYZ])([XYZ])([XYZ])")

ANGLES_OF = {
    "abc": ("kuka-abc", "the names A, B, C are KUKA's"),
    "wpr": ("fanuc-wpr", "the names W, P, R are Fanuc's"),
}

NAME_OF = {("rpy", "fanuc-wpr"): "roll-pitch-yaw"}
"""Family of angles and convention -> its name for these."""

FOR_PEOPLE = (*USUAL, "roll-pitch-yaw", "intrinsic-ZYX (any three axes)", "fixed-XYZ (any three axes)")


@dataclass(frozen=True)
class FileMap:
    """Map of one file.

    Attributes
    ----------
    names : tuple of str
        Names of the columns for which the map was made.
    columns : mapping of str to str
        Quantity to `name[unit]`.
    targets : mapping
        The same of x, y, z by tool target, if one row measures several.
    rotation : str
        Convention of the orientations.
    status_ok : tuple of str
        Status words of valid readings.
    """

    names: tuple[str, ...]
    columns: Mapping[str, str]
    targets: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    sheet: str = ""
    separator: str = ""
    decimal: str = "."
    thousands: str = ""
    lines: tuple[int, int] | None = None
    fill_down: tuple[str, ...] = ()
    rotation: str = ""
    status_ok: tuple[str, ...] = ()

    @property
    def with_joints(self) -> bool:
        return any(_NUMBERED.fullmatch(q) for q in self.columns)

    @property
    def with_points(self) -> bool:
        return "x" in self.columns or bool(self.targets)


@dataclass(frozen=True)
class Map:
    """Map of one file, or of one with joints and one with points.

    Attributes
    ----------
    header : mapping
        Keys of the data set's header as they will be written.
    by, within_s : str, float
        How the points are matched to the joints.
    """

    files: tuple[FileMap, ...]
    header: Mapping[str, Any]
    by: str = ""
    within_s: float = 0.0

    def refuse_undecided(self, file: Path | str) -> None:
        """Raise DataError naming every undecided key (`?`)."""
        places = [f"header.{key}" for key, value in self.header.items() if value == UNDECIDED]
        for number, each in enumerate(self.files, start=1):
            entries = {
                "sheet": each.sheet, "rotation": each.rotation, "decimal": each.decimal,
                **{f"columns.{quantity}": text for quantity, text in each.columns.items()},
                **{f"targets.{t}.{axis}": text for t, axes in each.targets.items() for axis, text in axes.items()},
            }  # fmt: skip
            places += [
                f"file {number}: {key}"
                for key, text in entries.items()
                if text == UNDECIDED or text.endswith("[?]")
            ]
        places += ["match.by"] if self.by == UNDECIDED else []
        if places:
            raise DataError(
                f"is undecided: '?' stands at {', '.join(places)}.", do="Write there what it is.", file=file
            )


def is_quantity(name: str) -> bool:
    """Test whether a map may have this key among its columns."""
    return name in _TEXT or name in _NUMBER or bool(_NUMBERED.fullmatch(name))


def read_map(path: Path) -> Map:
    """Read a map file.

    Raises
    ------
    DataError
        A key is missing, unknown or has a wrong value; the error names file and key.
    """
    _, values = read_toml(path)
    table = TomlTable(values, path)
    table.text("format", allowed=(FORMAT,))
    table.only(("format", "file", "header", "match"))
    match = table.table("match")
    match.only(("by", "within_s"))
    header = table.table("header")
    header.table("tool_targets")
    header.table("model").names("fit")
    holdout = header.table("holdout")
    holdout.only(("kind", "share", "seed"))
    holdout.text("kind", "auto", ("auto", "random", "block", "none"))
    holdout.number("share", 0.2)
    holdout.whole("seed", 1, low=0)
    files = table.tables("file")
    if not 1 <= len(files) <= 2:
        raise table.refuse(
            "file", f"there are {len(files)}.", "Give one [[file]], or one with joints and one with points."
        )
    return Map(
        tuple(_file(each) for each in files),
        header.values,
        match.text("by", "", (*BY, UNDECIDED, "")),
        match.number("within_s", 0.0, low=0.0),
    )


def _file(table: TomlTable) -> FileMap:
    table.only(_FILE)
    columns = table.table("columns")
    for quantity in columns.values:
        if not is_quantity(quantity):
            raise columns.refuse(
                quantity, "is not a quantity.", "There are j1 .., x, y, z and those of docs/files.md."
            )
    for group in _TOGETHER:
        if len(missing := [quantity for quantity in group if quantity not in columns.values]) not in (
            0,
            len(group),
        ):
            raise columns.refuse(missing[0], "is missing.", f"Name all of {', '.join(group)}, or none.")
    targets = table.table("targets")
    axes = {name: targets.table(name) for name in targets.values}
    for each in axes.values():
        each.only(("x", "y", "z"))
    rotation = table.text("rotation", "")
    if rotation not in ("", UNDECIDED) and sequence_of(rotation) is None:
        raise table.refuse("rotation", f"is {rotation!r}.", f"Use {', '.join(FOR_PEOPLE)}.")
    lines = table.numbers("lines")
    if lines is not None and (len(lines) != 2 or lines[0] > lines[1]):
        raise table.refuse("lines", f"is {list(lines)}.", "Give the first and the last line, [3, 40].")
    return FileMap(
        names=table.names("names") or (),
        columns={quantity: columns.text(quantity) for quantity in columns.values},
        targets={name: {axis: each.text(axis) for axis in ("x", "y", "z")} for name, each in axes.items()},
        sheet=table.text("sheet", ""),
        separator=table.text("separator", "", (*SEPARATORS, "")),
        decimal=table.text("decimal", ".", (".", ",", UNDECIDED)),
        thousands=table.text("thousands", "", (".", ",", "")),
        lines=None if lines is None else (int(lines[0]), int(lines[1])),
        fill_down=table.names("fill_down") or (),
        rotation=rotation,
        status_ok=table.names("status_ok") or (),
    )


def text_of(made: Map, remarks: Sequence[str] = ()) -> str:
    """Write the map as text of its file, remarks first."""
    out = [*(f"# {remark}" for remark in remarks), f'format = "{FORMAT}"', ""]
    for each in made.files:
        out.append("[[file]]")
        out.append(f"names = {json.dumps(list(each.names), ensure_ascii=False)}")
        for key in ("sheet", "separator", "decimal", "thousands", "rotation"):
            if value := getattr(each, key):
                out.append(f"{key} = {json.dumps(value, ensure_ascii=False)}")
        for key in ("lines", "fill_down", "status_ok"):
            if value := getattr(each, key):
                out.append(f"{key} = {json.dumps(list(value), ensure_ascii=False)}")
        out += ["", "[file.columns]", tomli_w.dumps(each.columns)]
        for name, axes in each.targets.items():
            out += [f"[file.targets.{json.dumps(name, ensure_ascii=False)}]", tomli_w.dumps(axes)]
    if made.by:
        within = f"within_s = {made.within_s:g}\n" if made.by == "time" else ""
        out += ["[match]", f'by = "{made.by}"', within]
    return "\n".join(out) + "\n" + tomli_w.dumps({"header": dict(made.header)})


def refuse_other(each: FileMap, layout: Layout, map_path: Path | str) -> None:
    """Raise DataError for a file of another form than that of its map, with the differences."""
    missing = [name for name in each.names if name not in layout.names]
    new = [name for name in layout.names if name not in each.names]
    if not missing and not new:
        return
    differs = [f"lacks {_some(missing)}"] * bool(missing) + [f"has {_some(new)} besides"] * bool(new)
    raise DataError(
        f"differs from the file for which the map {map_path} was made: it {' and '.join(differs)}.",
        do="Propose a new map for it: --propose.",
        file=layout.sheet.shown,
        line=layout.header_line,
    )


def _some(names: Sequence[str]) -> str:
    shown = ", ".join(f"'{name}'" for name in names[:6])
    return shown + (f" and {len(names) - 6} more" if len(names) > 6 else "")


def sequence_of(convention: str) -> str | None:
    """Return the axis sequence of a convention as scipy writes it.

    The result is `VECTOR` for a rotation vector, and None if the text is no convention.
    """
    if convention == VECTOR:
        return VECTOR
    if convention in NAMED:
        return NAMED[convention]
    match = _SEQUENCE.fullmatch(convention)
    if match is None or match[2] == match[3] or match[3] == match[4]:
        return None
    axes = match[2] + match[3] + match[4]
    return axes if match[1] == "intrinsic" else axes.lower()


def quaternions(numbers: Array, convention: str) -> Array:
    """Convert orientations (n, 3), rad, of a convention to quaternions (n, 4), scalar first.

    Rows with a NaN become NaN.

    Raises
    ------
    KeyError
        `convention` is no convention.
    """
    sequence = sequence_of(convention)
    if sequence is None:
        raise KeyError(convention)
    out = np.full((len(numbers), 4), np.nan)
    given = np.isfinite(numbers).all(axis=1)
    if given.any():
        of = numbers[given]
        turn = Rotation.from_rotvec(of) if sequence == VECTOR else Rotation.from_euler(sequence, of)
        out[given] = turn.as_quat(scalar_first=True)
    return out
