"""Columns without meaningful names: what their numbers and values may be.

`arm1 .. arm6` may be six joints, sixteen columns of which the last four are 0, 0, 0, 1 a pose, and nine
columns without any names joints and a point. None is taken for granted: the choice is a question, which
the robot may decide.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

import numpy as np

from calib.arm.robot import Robot
from calib.array import Array
from calib.foreign.map.map_file import UNDECIDED
from calib.foreign.meanings.assigned import Assigned, ColumnQuestion, Set
from calib.foreign.meanings.words import ColumnMeaning, meaning_of

_NAMELESS = re.compile(r"column \d+")
_NUMBERED = re.compile(r"(.*?\D)_?\[?(\d{1,2})\]?(\D*)")
_OF_MATRIX = re.compile(r"(.*?\D)?[_\[(]*([0-4])[\])_, ]*([0-4])[\])]*")
_PROPER = 1e-2  # by which a rotation matrix may be off
_JOINTS = (6, 7, 5, 4)  # of robots, where none is named
_POINT: tuple[ColumnMeaning, ...] = tuple(ColumnMeaning("point", k) for k in range(3))
_POSES: Mapping[str, tuple[ColumnMeaning, ...]] = {
    "x y z": _POINT,
    "x y z rx ry rz": (*_POINT, *(ColumnMeaning("angle", k, "", "rx") for k in range(3))),
    "x y z q1 q2 q3 q4": (*_POINT, *(ColumnMeaning("quaternion", k, "", "numbered") for k in range(4))),
}


def _matrices(to: Assigned, meanings: dict[str, ColumnMeaning]) -> None:
    """Take columns `T11 .. T44` (3 x 3, 3 x 4 or 4 x 4) that hold rotation matrices as such."""
    groups: dict[str, dict[tuple[int, int], str]] = {}
    for name in to.layout.names:
        if (match := _OF_MATRIX.fullmatch(_without_unit(name))) is not None:
            groups.setdefault(match[1] or "", {})[int(match[2]), int(match[3])] = name
    for prefix, of in groups.items():
        first = min(min(place) for place in of)
        for shape in ((4, 4), (3, 4), (3, 3)):
            places = [(row + first, column + first) for row in range(shape[0]) for column in range(shape[1])]
            if set(of) == set(places):
                _take_matrix(to, meanings, [of[place] for place in places], shape, prefix)


def _without_unit(name: str) -> str:
    """Remove the unit behind a name."""
    return re.sub(r"\s*[\[(](?:mm|m|deg|rad)[\])]$", "", name)


def _take_matrix(
    to: Assigned,
    meanings: dict[str, ColumnMeaning],
    names: Sequence[str],
    shape: tuple[int, int],
    prefix: str,
) -> bool:
    """Take columns for a matrix, row by row, where their numbers are one; whether they are."""
    values = to.values(names).reshape(-1, *shape)
    values = values[np.isfinite(values).all(axis=(1, 2))]
    if not len(values) or not _proper(values[:, :3, :3]):
        return False
    role = meaning_of(prefix).role
    cells = np.array(names).reshape(shape)
    turned = shape == (4, 4) and not np.allclose(values[:, 3], (0.0, 0.0, 0.0, 1.0), atol=_PROPER)
    if turned:  # points as rows: the transposed matrix
        if not np.allclose(values[:, :, 3], (0.0, 0.0, 0.0, 1.0), atol=_PROPER):
            return False
        cells = cells.T
    for row in range(3):
        for column in range(3):
            meanings[str(cells[row, column])] = ColumnMeaning("matrix", 3 * row + column, role)
        if shape[1] == 4:
            meanings[str(cells[row, 3])] = ColumnMeaning(
                "point", row, role, unit=meaning_of(str(cells[row, 3])).unit
            )
    if shape[0] == 4:
        for name in cells[3]:
            meanings.pop(str(name), None)
            to.aside(str(name), "the last row of a matrix")
    return True


def _proper(values: Array) -> bool:
    off = np.abs(values @ values.transpose(0, 2, 1) - np.eye(3)).max()
    return bool(off < _PROPER and np.linalg.det(values).min() > 0.0)


def _families(to: Assigned, leave: Sequence[str] = ()) -> list[Set]:
    """Find columns of numbers whose names differ only in a number that counts from 0 or 1.

    Columns in `leave` are left out.
    """
    found: dict[tuple[str, str], dict[int, str]] = {}
    for name in to.layout.names:
        match = _NUMBERED.fullmatch(_without_unit(name))
        meaning = meaning_of(name)
        other = meaning.kind in ("spread", "deviation") or meaning.role in ("own", "nominal")
        if match is not None and name not in leave and not other and np.isfinite(to.values([name])).any():
            found.setdefault((match[1], match[3]), {}).setdefault(int(match[2]), name)
    out = []
    for of in found.values():
        numbers = sorted(of)
        if numbers[0] <= 1 and numbers == list(range(numbers[0], numbers[0] + len(numbers))):
            out.append(tuple(of[k] for k in numbers))
    return out


def unnamed(to: Assigned, meanings: dict[str, ColumnMeaning], robot: Robot | None) -> None:
    """Ask for the meaning of numbered or nameless columns.

    This is needed if no others are named as joints or as a point.
    """
    _matrices(to, meanings)
    if _ask_nameless(to, meanings, robot):
        return
    kinds = [(meaning.kind, meaning.role, meaning.family + meaning.group) for meaning in meanings.values()]
    joints = max((kinds.count(key) for key in kinds if key[0] == "joint"), default=0) > 1
    point = max((kinds.count(key) for key in kinds if key[0] == "point"), default=0) > 2
    one_file = not to.prefix  # of two files each holds one of both
    if not joints and (one_file or not point):
        _ask_joints(to, meanings, robot)
    if not point and (one_file or not joints):
        _ask_point(to, meanings)


def _ask_joints(to: Assigned, meanings: dict[str, ColumnMeaning], robot: Robot | None) -> None:
    """Ask which numbered columns are the joints, if no name states it."""
    counts = _counts(robot)
    fitting = {of[0]: of for of in _families(to) if len(of) in counts}
    if not fitting:
        return
    shown = "; ".join(f"{of[0]} .. {of[-1]}" for of in fitting.values())
    text = f"No columns are named as joints. Are these: {shown}?"
    question = ColumnQuestion(
        f"{to.prefix}joints", text, (*fitting, "none"), next(iter(fitting)), evidence=True
    )
    answer = to.ask(question)
    if answer == UNDECIDED:
        to.columns["j1"] = UNDECIDED
    elif answer in fitting:
        for k, name in enumerate(fitting[answer], start=1):
            meanings[name] = ColumnMeaning("joint", k, "", "asked", unit=meaning_of(name).unit)


def _ask_point(to: Assigned, meanings: dict[str, ColumnMeaning]) -> None:
    """Ask which numbered columns are the measured point or pose, if no name states it."""
    joints = [name for name, meaning in meanings.items() if meaning.kind == "joint"]
    sizes = {len(of): of for of in _POSES.values()}
    fitting = {
        of[0]: of
        for of in sorted(_families(to, joints), key=lambda of: len(of) == 6)  # which rather are joints
        if len(of) in sizes or (len(of) in (12, 16) and _is_matrix(to, of))
    }
    if not fitting:
        return
    shown = "; ".join(f"{of[0]} .. {of[-1]}" for of in fitting.values())
    text = f"No columns are named as measured coordinates. Are these: {shown}?"
    question = ColumnQuestion(
        f"{to.prefix}points", text, (*fitting, "none"), next(iter(fitting)), evidence=True
    )
    answer = to.ask(question)
    if answer == UNDECIDED:
        to.columns.update(dict.fromkeys("xyz", UNDECIDED))
    elif answer in fitting and len(fitting[answer]) not in sizes:
        _take_matrix(to, meanings, fitting[answer], (len(fitting[answer]) // 4, 4), "")
    elif answer in fitting:
        for name, meaning in zip(fitting[answer], sizes[len(fitting[answer])], strict=True):
            meanings[name] = meaning


def _ask_nameless(to: Assigned, meanings: dict[str, ColumnMeaning], robot: Robot | None) -> bool:
    """Ask how the columns of a table follow each other if no line names them.

    Returns whether no line names them.
    """
    if not all(_NAMELESS.fullmatch(name) for name in to.layout.names):
        return False
    names = [name for name in to.layout.names if np.isfinite(to.values([name])).all()]
    texts = [name for name in to.layout.names if name not in names and all(to.layout.cells[name])]
    for name in texts:
        if len(set(to.layout.cells[name])) == len(to.layout.rows):
            meanings[name] = ColumnMeaning("id")
    if names and _counts_rows(to.values(names[:1])[:, 0]):
        meanings[names[0]] = ColumnMeaning("id")
        names = names[1:]
    arrangements: dict[str, tuple[ColumnMeaning, ...]] = {}
    for count in _counts(robot):
        joints = tuple(ColumnMeaning("joint", k, "", "asked") for k in range(1, count + 1))
        arrangements |= {f"j1..j{count}": joints, **_POSES}
        for shown, pose in _POSES.items():
            arrangements[f"j1..j{count} {shown}"] = (*joints, *pose)
            arrangements[f"{shown} j1..j{count}"] = (*pose, *joints)
        for size, shown in ((16, "matrix"), (12, "matrix of 12")):
            matrix = tuple(ColumnMeaning("other") for _ in range(size))
            for at, text, parts in (
                (count, f"j1..j{count} {shown}", (*joints, *matrix)),
                (0, f"{shown} j1..j{count}", (*matrix, *joints)),
                (0, shown, matrix),
            ):
                if len(parts) == len(names) and _is_matrix(to, names[at : at + size]):
                    arrangements[text] = parts
    fitting = {text: parts for text, parts in arrangements.items() if len(parts) == len(names)}
    if not fitting:
        return True
    text = f"No line names the columns. What are the {len(names)} columns of numbers from '{names[0]}' on?"
    key = f"{to.prefix}columns"
    to.keys.add(key)
    likely = next(iter(fitting))
    answer = to.ask(ColumnQuestion(key, text, (*fitting, "none"), likely, evidence=True))
    if answer == UNDECIDED:
        to.columns.update({"j1": UNDECIDED} if "j1" in likely else {})
        to.columns.update(dict.fromkeys("xyz", UNDECIDED) if "x y z" in likely or "matrix" in likely else {})
    for name, meaning in zip(names, fitting.get(answer, ()), strict=False):
        meanings[name] = meaning
    if "matrix" in answer:
        at = next(i for i, name in enumerate(names) if meanings[name].kind == "other")
        size = 12 if "12" in answer else 16
        _take_matrix(to, meanings, names[at : at + size], (size // 4, 4), "")
    return True


def _counts(robot: Robot | None) -> Sequence[int]:
    """Return the numbers of columns that the joints of a robot may have."""
    if robot is None:
        return _JOINTS
    held = len(robot.followers(robot.rods))
    return tuple(dict.fromkeys((robot.joints, robot.joints - held)))


def _is_matrix(to: Assigned, names: Sequence[str]) -> bool:
    values = to.values(names).reshape(-1, len(names) // 4, 4)
    return _proper(values[:, :3, :3])


def _counts_rows(values: Array) -> bool:
    step = np.diff(values)
    return len(step) > 0 and step[0] >= 1.0 and step[0] % 1.0 == 0.0 and bool(np.all(step == step[0]))
