"""Columns of one table are assigned to quantities by their names, the row of units and the numbers, or by asking.

A unit is what the name, the row of units, the cells or the preamble say. Where none does it is asked, unless the
numbers leave one possibility (angles above two turns are degrees); where numbers cannot be what the name says it is
asked as well.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calib.arm.robot import load_robot
from calib.data.plausible import READ_APART, turned_apart
from calib.foreign.files.layout import Layout
from calib.foreign.files.number import Notation, notation_of
from calib.foreign.map.entry import ANGLES, LENGTHS
from calib.foreign.map.map_file import UNDECIDED
from calib.foreign.meanings.assigned import Answers, Assigned, Question, Set, occurrence
from calib.foreign.meanings.names_of_rows import names_of_rows
from calib.foreign.meanings.orientations import orientations
from calib.foreign.meanings.units_of_columns import units_of_columns
from calib.foreign.meanings.unnamed import unnamed
from calib.foreign.meanings.words import Meaning, Role, meaning_of
from calib.units import DEG

_Key = tuple[Role, str, str]  # role, family of angles or name of the target, and which of equal names
_YASKAWA = ("s", "l", "u", "r", "b", "t")


def assign(
    layout: Layout, answers: Answers, prefix: str = "", told: frozenset[str] = frozenset()
) -> Assigned:
    """The assignment of every column of a table, as far as it is known. prefix: of the keys of questions, for a
    second file; told: answers that the robot gave."""
    to = Assigned(layout, answers, prefix, told)
    meanings = {name: meaning_of(name) for name in layout.names}
    plain = {
        name.lower().split("#")[0].split("[")[0].split("(")[0].strip(): name
        for name in reversed(layout.names)
    }
    if all(letter in plain for letter in _YASKAWA):
        for k, letter in enumerate(_YASKAWA, start=1):
            meanings[plain[letter]] = Meaning("joint", k, "", "slurbt", unit=meanings[plain[letter]].unit)
    _notation(to)
    _copies(to, meanings)
    robot = load_robot(to.answers["robot"], Path.cwd()) if to.answers.get("robot") else None
    unnamed(to, meanings, robot)
    _joints(to, meanings, () if robot is None else robot.followers(robot.rods))
    _points(to, meanings)
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
        to.ask(Question(f"{to.prefix}decimal", text, (".", ",")))
        to.notation = Notation(UNDECIDED)
    else:
        to.notation = found


def _copies(to: Assigned, meanings: dict[str, Meaning]) -> None:
    """Columns given twice with the same contents count once."""
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


def _joints(to: Assigned, meanings: dict[str, Meaning], followers: Sequence[int]) -> None:
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
    for key in list(whole):  # q1..q4 beside joints are a quaternion, as is q0..q3 of norm 1
        if key[1] == "q" and len(whole[key]) == 4 and (len(whole) > 1 or _normed(to, whole[key])):
            for k, name in enumerate(whole.pop(key)):
                meanings[name] = Meaning("quaternion", k, key[0], "numbered")
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
    to: Assigned, chosen: Set, read: Set | None, meanings: dict[str, Meaning], *, is_read: bool
) -> str:
    """Ask which joints count where only those read back are there, or where they are not those commanded; a remark on
    the chosen columns."""
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
    answer = to.ask(Question(key, text, ("commanded", "read"), "read" if is_read else "commanded"))
    to.read_back = answer == "read"
    return "; what the controller read back" if to.read_back else ""


def _apart_deg(to: Assigned, commanded: Set, read: Set, meanings: dict[str, Meaning]) -> float:
    """The largest difference of two sets of joints, deg or mm; 0 where a unit is not known."""
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


def _further(to: Assigned, meanings: dict[str, Meaning], joints: int) -> None:
    """External axes that move, and what says how joints arrived."""
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
    """The only set, or the one that was answered; None where there is none, or it is open."""
    if not sets:
        return None
    if len(sets) == 1:
        return sets[0]
    choices = {names[0]: names for names in sets}
    shown = "; ".join(f"{names[0]} .. {names[-1]}" for names in sets)
    answer = to.ask(Question(f"{to.prefix}{what}", f"{text}: {shown}. Which?", tuple(choices), evidence=True))
    if answer in choices:
        return choices[answer]
    for names in sets:
        for name in names:
            to.aside(name, "open: see the question")
    to.columns.update(dict.fromkeys(("j1",) if what == "joints" else "xyz", UNDECIDED))
    return None


def _points(to: Assigned, meanings: dict[str, Meaning]) -> None:
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
        answer = to.ask(Question(f"{to.prefix}points", text, (*choices, "none")))
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
    """The rows that count and have a point at exactly 0, 0, 0."""
    zero = np.zeros(len(to.layout.rows), dtype=bool)
    for axes in (to.columns, *to.targets.values()):
        named = [axes[axis].rpartition("[")[0] for axis in "xyz" if axes.get(axis, UNDECIDED) != UNDECIDED]
        if len(named) == 3 and all(name in to.layout.cells for name in named):
            zero |= (to.values(named) == 0.0).all(axis=1)
    if to.columns.get("status", UNDECIDED) != UNDECIDED:
        good = {word.lower() for word in to.status_ok} or {""}
        zero &= np.array([cell.lower() in good for cell in to.layout.cells[to.columns["status"]]])
    return np.flatnonzero(zero)


def _unit_of_points(to: Assigned, names: Sequence[str], meanings: dict[str, Meaning]) -> None:
    """Entries `x@NAME` of columns of coordinates, for the caller to put where they belong."""
    units, why = units_of_columns(to, names, meanings, "points", ("mm", "m", "in", "um"))
    for k, (name, unit, reason) in enumerate(zip(names, units, why, strict=True)):
        to.columns[f"{'xyz'[k % 3]}@{name}"] = f"{name}[{unit}]"
        to.take(name, f"{'xyz'[k % 3]} measured", unit, reason)
