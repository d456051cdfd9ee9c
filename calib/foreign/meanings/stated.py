"""Columns whose meaning a person states, `column.NAME=QUANTITY`, whatever their names tell.

A quantity that is stated replaces what was read as it, and its unit is found anew.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from calib.arm.robot import Robot
from calib.errors import DataError
from calib.foreign.map.map_file import UNDECIDED
from calib.foreign.meanings.assigned import LEAVE, Assigned
from calib.foreign.meanings.units import units_of_columns
from calib.foreign.meanings.words import ColumnMeaning, Kind, meaning_of

_KINDS: Mapping[str, Kind] = {
    "id": "id",
    "target": "target",
    "time": "time",
    "t_air": "temperature",
    "status": "status",
    "set": "set",
    "series": "series",
    "waypoint": "waypoint",
}
_FEWEST_JOINTS = 7  # that are offered, for a robot that is not named yet
_GROUPS = (
    ("joints", "angles", ("deg", "rad")),
    ("points", "points", ("mm", "m", "in", "um")),
)


def column_choices(robot: Robot | None) -> tuple[str, ...]:
    """Return what a column may be stated to be: nothing, a joint, a coordinate, a name or a condition."""
    joints = max(_FEWEST_JOINTS, 0 if robot is None else robot.joints)
    return (LEAVE, *(f"j{k}" for k in range(1, joints + 1)), *"xyz", *_KINDS)


def stated_columns(to: Assigned) -> dict[str, str]:
    """Return the quantity of each column that an answer states.

    Raises
    ------
    DataError
        An answer is none of the choices, or two columns are stated to be the same.
    """
    keys = {f"{to.prefix}column.{name}": name for name in to.layout.names}
    to.keys |= keys.keys()
    out: dict[str, str] = {}
    for key, name in keys.items():
        quantity = to.answers.get(key)
        if quantity is None:
            continue
        where = to.layout.sheet.shown
        if quantity not in to.choices:
            raise DataError(
                f"{key} = {quantity!r} is not one of the answers.",
                do=f"Answer with one of {', '.join(to.choices)}.",
                file=where,
                key=key,
            )
        if quantity != LEAVE and quantity in out.values():
            raise DataError(
                f"two columns are stated as {quantity}, '{name}' among them.",
                do="State only one of them.",
                file=where,
                key=key,
            )
        out[name] = quantity
    return out


def set_stated(to: Assigned, meanings: dict[str, ColumnMeaning], stated: Mapping[str, str]) -> None:
    """Replace the meanings of columns that are left aside, or stated to be names or conditions."""
    kinds = {_KINDS[quantity] for quantity in stated.values() if quantity in _KINDS}
    for name, meaning in meanings.items():
        if meaning.kind in kinds and name not in stated:
            meanings[name] = replace(meaning, kind="other")
    for name, quantity in stated.items():
        if quantity == LEAVE or quantity in _KINDS:
            meanings[name] = ColumnMeaning(_KINDS.get(quantity, "other"), unit=meaning_of(name).unit)
            to.found.pop(name, None)
        if quantity == LEAVE:
            to.aside(name, "as answered")


def take_stated(
    to: Assigned, meanings: dict[str, ColumnMeaning], stated: Mapping[str, str], robot: Robot | None
) -> None:
    """Take the columns that are stated to be joints or coordinates, in place of those taken before."""
    wanted = {
        quantity: name for name, quantity in stated.items() if quantity != LEAVE and quantity not in _KINDS
    }
    touched = {_group(quantity) for quantity in wanted}
    if "points" in touched:
        for axes in to.targets.values():
            _give_up(to, *axes.values())
        to.targets.clear()
    for quantity, entry in list(to.columns.items()):
        given = quantity in wanted or _name(entry) in wanted.values()
        if given or (entry == UNDECIDED and _group(quantity) in touched):
            del to.columns[quantity]
            _give_up(to, entry)
    asked = touched | ({"columns"} if len(touched) == len(_GROUPS) else set())
    to.questions = [each for each in to.questions if each.key.removeprefix(to.prefix) not in asked]
    for group, what, choices in _GROUPS:
        if group in touched:
            _take_group(to, meanings, wanted, group, what, choices)
            to.lacking += [q for q in _whole(to, group, robot) if q not in to.columns]


def _take_group(
    to: Assigned,
    meanings: dict[str, ColumnMeaning],
    wanted: Mapping[str, str],
    group: str,
    what: str,
    choices: tuple[str, ...],
) -> None:
    """Take the joints, or the coordinates, with the units of these columns."""
    of = {q: _name(entry) for q, entry in to.columns.items() if _group(q) == group} | {
        q: name for q, name in wanted.items() if _group(q) == group
    }
    quantities = sorted(of, key=lambda q: (len(q), q))
    names = [of[q] for q in quantities]
    for name in names:
        meanings.setdefault(name, meaning_of(name))
    to.questions = [each for each in to.questions if each.key != f"{to.prefix}unit.{what}"]
    units, why = units_of_columns(to, names, meanings, what, choices)
    for q, name, unit, reason in zip(quantities, names, units, why, strict=True):
        to.columns[q] = f"{name}[{unit}]"
        told = "as answered" if q in wanted else "its name"
        shown = f"joint {q[1:]}" if group == "joints" else f"{q} measured"
        to.take(name, shown, unit, reason if reason == told else f"{told}; unit: {reason}")


def _whole(to: Assigned, group: str, robot: Robot | None) -> list[str]:
    """Return the quantities that a table with some of a group must have."""
    if group == "points":
        return list("xyz")
    follow = () if robot is None else robot.followers(robot.rods)
    count = max(int(q[1:]) for q in to.columns if _group(q) == group) if robot is None else robot.joints
    return [f"j{k + 1}" for k in range(count) if k not in follow]


def _give_up(to: Assigned, *entries: str) -> None:
    for entry in entries:
        to.found.pop(_name(entry), None)
        if _name(entry) in to.layout.cells:
            to.aside(_name(entry), "another column is read in its place, as answered")


def _group(quantity: str) -> str:
    if quantity in ("x", "y", "z"):
        return "points"
    return "joints" if quantity.startswith("j") and quantity[1:].isdigit() else ""


def _name(entry: str) -> str:
    """Return the column of an entry `name[unit]`, or `name` alone."""
    return entry.rpartition("[")[0] or entry
