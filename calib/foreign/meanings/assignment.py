"""Assignment of a table's columns to quantities, by names, units, numbers or questions.

Columns of orientations are quaternions or angles. The convention follows from their names or is asked.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calib.arm.robot import load_robot
from calib.data.plausible import READ_APART, turned_apart
from calib.foreign.files.layout import Layout
from calib.foreign.files.number import Notation, notation_of
from calib.foreign.map.entry import ANGLES, LENGTHS
from calib.foreign.map.map_file import ANGLES_OF, MATRIX, NAME_OF, UNDECIDED, USUAL
from calib.foreign.meanings.assigned import (
    LEAVE,
    Answers,
    Assigned,
    ColumnQuestion,
    Set,
    names_of_rows,
    occurrence,
)
from calib.foreign.meanings.stated import column_choices, set_stated, stated_columns, take_stated
from calib.foreign.meanings.units import units_of_columns
from calib.foreign.meanings.unnamed import unnamed
from calib.foreign.meanings.words import ColumnMeaning, Role, meaning_of
from calib.units import DEG

_Key = tuple[Role, str, str]  # role, family of angles or name of the target, and which of equal names
_YASKAWA = ("s", "l", "u", "r", "b", "t")


def assign(
    layout: Layout, answers: Answers, prefix: str = "", told: frozenset[str] = frozenset()
) -> Assigned:
    """Assign the columns of a table, if they are known.

    Parameters
    ----------
    layout : Layout
        The table.
    answers : mapping of str to str
        Answers to earlier questions, by key.
    prefix : str, optional
        Prefix of the keys of questions, for a second file.
    told : frozenset of str, optional
        Keys of answers that the nominal robot gave.
    """
    to = Assigned(layout, answers, prefix, told)
    meanings = {name: meaning_of(name) for name in layout.names}
    plain = {
        name.lower().split("#")[0].split("[")[0].split("(")[0].strip(): name
        for name in reversed(layout.names)
    }
    if all(letter in plain for letter in _YASKAWA):
        for k, letter in enumerate(_YASKAWA, start=1):
            meanings[plain[letter]] = ColumnMeaning(
                "joint", k, "", "slurbt", unit=meanings[plain[letter]].unit
            )
    _notation(to)
    _copies(to, meanings)
    robot = load_robot(to.answers["robot"], Path.cwd()) if to.answers.get("robot") else None
    to.choices = column_choices(robot)
    unnamed(to, meanings, robot)
    stated = stated_columns(to)
    set_stated(to, meanings, stated)
    _joints(to, meanings, () if robot is None else robot.followers(robot.rods))
    _points(to, meanings)
    take_stated(to, meanings, stated, robot)
    orientations(to, meanings)
    names_of_rows(to, meanings)
    for name in layout.names:
        meaning = meanings.get(name)
        why = "not known; a map may name it"
        if meaning is not None:
            why = {
                "deviation": "a deviation, not a reading",
                "spread": "an uncertainty of unknown coverage",
            }.get(meaning.kind, why)
            why = {"nominal": "nominal, not measured", "own": "the controller's own, not measured"}.get(
                meaning.role, why
            )
        if not any(layout.cells[name]):
            why = "empty"
        to.aside(name, why)
    return to


def _notation(to: Assigned) -> None:
    found = notation_of([cell for cell in cells if cell] for cells in to.layout.cells.values())
    to.keys.add(f"{to.prefix}decimal")
    answer = to.answers.get(f"{to.prefix}decimal")
    if answer in (".", ","):
        other = "," if answer == "." else "."
        uses = any(
            other in cell
            for cells in to.layout.cells.values()
            for cell in cells
            if Notation(answer, other).number(cell)
        )
        to.notation = Notation(answer, other if uses else "")
    elif found is None:
        text = (
            "Points and commas in the numbers contradict each other, or may be decimals or thousands. "
            "Which mark stands before decimals?"
        )
        to.ask(ColumnQuestion(f"{to.prefix}decimal", text, (".", ",")))
        to.notation = Notation(UNDECIDED)
    else:
        to.notation = found


def _copies(to: Assigned, meanings: dict[str, ColumnMeaning]) -> None:
    """Leave out columns that repeat another of the same name with the same contents."""
    for name in to.layout.names:
        first, mark, number = name.rpartition("#")
        if (
            mark
            and number.isdigit()
            and first in meanings
            and to.layout.cells[name] == to.layout.cells[first]
        ):
            to.aside(name, f"the same as '{first}'")
            del meanings[name]


def _joints(to: Assigned, meanings: dict[str, ColumnMeaning], followers: Sequence[int]) -> None:
    sets: dict[_Key, dict[int, str]] = {}
    for name, meaning in meanings.items():
        if meaning.kind == "joint":
            key = (meaning.role, meaning.family, occurrence(name))
            sets.setdefault(key, {}).setdefault(meaning.index, name)
    whole = {}
    for key, by_index in sets.items():
        start = min(by_index)
        gaps = set(range(start, max(by_index) + 1)) - set(by_index)
        if start > 1 or not gaps <= {start + k for k in followers} or len(by_index) < 2:
            continue
        whole[key] = tuple(by_index[k] for k in sorted(by_index))
    for key in list(whole):  # q1..q4 next to joints are a quaternion, as is q0..q3 of norm 1
        if key[1] == "q" and len(whole[key]) == 4 and (len(whole) > 1 or _normed(to, whole[key])):
            for k, name in enumerate(whole.pop(key)):
                meanings[name] = ColumnMeaning("quaternion", k, key[0], "numbered")
    commanded = {key: names for key, names in whole.items() if key[0] != "read"}
    read = {key: names for key, names in whole.items() if key[0] == "read"}
    sets_of_joints = [*(commanded or read).values()]
    chosen = _one_of(to, "joints", "Several sets of columns may be the joints as commanded", sets_of_joints)
    if not chosen:
        return
    is_read = chosen in read.values()
    beside = [names for names in read.values() if not is_read and len(names) == len(chosen)]
    note = _read_back(to, chosen, beside[0] if len(beside) == 1 else None, meanings, is_read=is_read)
    if to.read_back and not is_read:
        for name in chosen:
            to.aside(name, "commanded; those read back are used, as answered")
        chosen, beside = beside[0], []
    for names, quantity, said, remark in (
        (chosen, "j", "", note),
        *((names, "read", " as read back", "") for names in beside[:1] if len(beside) == 1),
    ):
        units, why = units_of_columns(to, names, meanings, "angles", ("deg", "rad"))
        first = meanings[names[0]].index
        for name, unit, reason in zip(names, units, why, strict=True):
            number = meanings[name].index - first + 1
            to.columns[f"{quantity}{number}"] = f"{name}[{unit}]"
            to.take(name, f"joint {number}{said}", unit, reason + remark)
    _further(to, meanings, meanings[chosen[-1]].index - meanings[chosen[0]].index + 1)


def _read_back(
    to: Assigned, chosen: Set, read: Set | None, meanings: dict[str, ColumnMeaning], *, is_read: bool
) -> str:
    """Ask whether commanded or read-back joints count, and return a remark on the choice.

    The question arises if only read-back joints are there, or if they differ from those commanded.
    """
    key = f"{to.prefix}joints.read"
    to.keys.add(key)
    if is_read:
        text = (
            f"{chosen[0]} .. {chosen[-1]} look like joints that the controller read back, and no commanded ones are "
            "there. Read-back joints hold the controller's error of position, which looks like play. Which are they?"
        )
    elif read is not None and (largest := _apart_deg(to, chosen, read, meanings)) > READ_APART:
        text = (
            f"The joints read back ({read[0]} ..) differ from those commanded ({chosen[0]} ..) by up to {largest:.3g} "
            "deg. A correction of targets needs the commanded ones; where the robot did not stand where it was sent, "
            "those read back describe the arm. Which are used?"
        )
    else:
        return ""
    answer = to.ask(ColumnQuestion(key, text, ("commanded", "read"), "read" if is_read else "commanded"))
    to.read_back = answer == "read"
    return "; what the controller read back" if to.read_back else ""


def _apart_deg(to: Assigned, commanded: Set, read: Set, meanings: dict[str, ColumnMeaning]) -> float:
    """Compute the largest difference of two sets of joints, deg or mm; 0 if a unit is unknown."""
    shown = []
    for names in (commanded, read):
        asked = len(to.questions)
        units, _ = units_of_columns(to, names, meanings, "angles", ("deg", "rad"))
        del to.questions[asked:]  # asked when the joints are taken
        if not all(unit in ANGLES or unit in LENGTHS for unit in units):
            return 0.0
        factors = [ANGLES[unit] if unit in ANGLES else LENGTHS[unit] for unit in units]
        shown.append(to.values(names) * factors)
    kinds = ["deg" if unit in ANGLES else "mm" for unit in units]
    apart = turned_apart(shown[1] - shown[0], kinds) / [DEG if kind == "deg" else 1.0 for kind in kinds]
    return float(np.nanmax(np.abs(apart), initial=0.0))


def _further(to: Assigned, meanings: dict[str, ColumnMeaning], joints: int) -> None:
    """Assign external axes that move, and columns that state how joints arrived."""
    for name, meaning in meanings.items():
        bare = name.lower()
        if meaning.kind == "external" and f"e{meaning.index}" not in to.columns and meaning.role != "read":
            values = to.values([name])[:, 0]
            if np.nanmax(np.abs(values), initial=0.0) == 0.0:
                to.aside(name, "an external axis that is 0 throughout")
                continue
            unit, why = units_of_columns(
                to, (name,), meanings, f"e{meaning.index}", ("mm", "m", "deg", "rad")
            )
            to.columns[f"e{meaning.index}"] = f"{name}[{unit[0]}]"
            to.take(name, f"external axis {meaning.index}", unit[0], why[0])
        for start, end in (("approach", ""), ("prev", "_deg")):
            number = bare.removeprefix(start).removesuffix(end)
            if bare == f"{start}{number}{end}" and number.isdigit() and int(number) <= joints:
                to.columns[f"{start}{number}"] = name + ("[deg]" if end else "")
                to.take(name, f"{start} of joint {number}", end[1:])


def _normed(to: Assigned, names: Sequence[str]) -> bool:
    norm = np.linalg.norm(to.values(names), axis=1)
    return bool(len(norm) and np.nanmax(np.abs(norm - 1.0)) < 1e-2)


def _one_of(to: Assigned, what: str, text: str, sets: Sequence[Set]) -> Set | None:
    """Return the only set of columns, or the one in the answer.

    Returns None if there is no set, or the question is open.
    """
    if not sets:
        return None
    if len(sets) == 1:
        return sets[0]
    choices = {names[0]: names for names in sets}
    shown = "; ".join(f"{names[0]} .. {names[-1]}" for names in sets)
    answer = to.ask(
        ColumnQuestion(f"{to.prefix}{what}", f"{text}: {shown}. Which?", tuple(choices), evidence=True)
    )
    if answer in choices:
        return choices[answer]
    for names in sets:
        for name in names:
            to.aside(name, "open: see the question")
    to.columns.update(dict.fromkeys(("j1",) if what == "joints" else "xyz", UNDECIDED))
    return None


def _points(to: Assigned, meanings: dict[str, ColumnMeaning]) -> None:
    sets: dict[_Key, dict[int, str]] = {}
    for name, meaning in meanings.items():
        if meaning.kind == "point":
            sets.setdefault((meaning.role, meaning.group, occurrence(name)), {}).setdefault(
                meaning.index, name
            )
    whole = {key: tuple(of[k] for k in range(3)) for key, of in sets.items() if len(of) == 3}
    for role in ("measured", ""):
        if candidates := {key: names for key, names in whole.items() if key[0] == role}:
            break
    else:
        candidates = {}
    if not candidates and whole:
        shown = "; ".join(f"{names[0]} ({key[0]})" for key, names in whole.items())
        choices = {names[0]: names for names in whole.values()}
        text = f"No coordinates are named as measured, only {shown}. Which were measured by an instrument?"
        answer = to.ask(ColumnQuestion(f"{to.prefix}points", text, (*choices, "none")))
        if answer in choices:
            candidates = {("", "", ""): choices[answer]}
        elif answer == UNDECIDED:
            to.columns.update(dict.fromkeys("xyz", UNDECIDED))
    groups = {key[1]: names for key, names in candidates.items() if key[1]}
    if groups and len(groups) == len(candidates) and not any(group.isdigit() for group in groups):
        _unit_of_points(to, [name for names in groups.values() for name in names], meanings)
        for group, names in groups.items():
            to.targets[group] = {
                axis: to.columns.pop(f"{axis}@{name}") for axis, name in zip("xyz", names, strict=True)
            }
            for axis, name in zip("xyz", names, strict=True):
                of = to.found[name]
                to.found[name] = replace(of, read_as=f"{axis} of target {group}")
        return
    chosen = _one_of(
        to, "points", "Several sets of columns may be the measured point", [*candidates.values()]
    )
    if chosen:
        _unit_of_points(to, chosen, meanings)
        for axis, name in zip("xyz", chosen, strict=True):
            to.columns[axis] = to.columns.pop(f"{axis}@{name}")


def at_zero(to: Assigned) -> NDArray[np.int64]:
    """Find the rows that count and have a point at exactly 0, 0, 0."""
    zero = np.zeros(len(to.layout.rows), dtype=bool)
    for axes in (to.columns, *to.targets.values()):
        named = [axes[axis].rpartition("[")[0] for axis in "xyz" if axes.get(axis, UNDECIDED) != UNDECIDED]
        if len(named) == 3 and all(name in to.layout.cells for name in named):
            zero |= (to.values(named) == 0.0).all(axis=1)
    if to.columns.get("status", UNDECIDED) != UNDECIDED:
        good = {word.lower() for word in to.status_ok} or {""}
        zero &= np.array([cell.lower() in good for cell in to.layout.cells[to.columns["status"]]])
    return np.flatnonzero(zero)


def _unit_of_points(to: Assigned, names: Sequence[str], meanings: dict[str, ColumnMeaning]) -> None:
    """Add entries `x@NAME` of columns of coordinates; the caller moves them to their place."""
    units, why = units_of_columns(to, names, meanings, "points", ("mm", "m", "in", "um"))
    for k, (name, unit, reason) in enumerate(zip(names, units, why, strict=True)):
        to.columns[f"{'xyz'[k % 3]}@{name}"] = f"{name}[{unit}]"
        to.take(name, f"{'xyz'[k % 3]} measured", unit, reason)


def orientations(to: Assigned, meanings: dict[str, ColumnMeaning]) -> None:
    """Orientation, where x, y and z are decided and of the same origin."""
    taken = [name for name, found in to.found.items() if found.read_as.endswith(" measured")]
    if not taken:
        return
    role = meanings[taken[0]].role
    sets: dict[tuple[str, ...], dict[int, str]] = {}
    for name, meaning in meanings.items():
        if meaning.kind in ("angle", "quaternion", "matrix"):
            sets.setdefault((meaning.kind, meaning.role, meaning.family, occurrence(name)), {}).setdefault(
                meaning.index, name
            )
    sizes = {"angle": 3, "quaternion": 4, "matrix": 9}
    whole = {key: of for key, of in sets.items() if len(of) == sizes[key[0]]}
    for key, of in whole.items():
        if key[1] != role:
            for name in of.values():
                to.aside(name, "an orientation of another origin than the measured point")
    whole = {key: of for key, of in whole.items() if key[1] == role}
    if len(whole) > 1:
        for of in whole.values():
            for name in of.values():
                to.aside(name, "several orientations are there; a map may name one")
        return
    for key, of in whole.items():
        names = tuple(of[k] for k in sorted(of))
        if key[0] == "quaternion":
            _quaternion(to, names, key[2])
        elif key[0] == "matrix":
            for place, name in zip(MATRIX, names, strict=True):
                to.columns[place] = name
                to.take(name, f"matrix {place[-2:]}", "", "its numbers: they are a rotation matrix")
        else:
            _angles(to, names, key[2], meanings)


def _quaternion(to: Assigned, names: Set, family: str) -> None:
    why, order = "its name", "wxyz"
    if family == "numbered":
        key = f"{to.prefix}quaternion"
        order = to.ask(ColumnQuestion(key, f"Is {names[0]} .. {names[3]} a quaternion with the scalar first or last?",
                                ("wxyz", "xyzw", LEAVE), "wxyz", evidence=True))  # fmt: skip
        why = to.reason(key)
    if order == LEAVE:
        return
    if order == UNDECIDED:
        to.columns["rot_w"] = UNDECIDED
        return
    for part, name in zip(order, names, strict=True):
        to.columns[f"rot_{part}"] = name
        to.take(name, f"quaternion {part}", "", why)


def _angles(to: Assigned, names: Set, family: str, meanings: Mapping[str, ColumnMeaning]) -> None:
    convention, why = ANGLES_OF.get(family, ("", ""))
    key = f"{to.prefix}rotation"
    to.keys.add(key)
    if not convention or key in to.answers:
        shown = ", ".join(names)
        usual = [NAME_OF.get((family, each), each) for each in USUAL]
        convention = to.ask(ColumnQuestion(key, f"By which convention are {shown} an orientation?", (*usual, LEAVE),
                                     "roll-pitch-yaw" if family == "rpy" else "", evidence=True))  # fmt: skip
        why = to.reason(key)
    if convention == LEAVE:
        return
    to.rotation = convention
    units, reason = units_of_columns(to, names, meanings, "rotation", ("deg", "rad"))
    for k, name in enumerate(names, start=1):
        to.columns[f"rot_{k}"] = f"{name}[{units[k - 1]}]"
        to.take(name, f"angle {k} of {convention}", units[k - 1], f"{reason[k - 1]}; {why}")
