"""Columns of orientations: quaternions and angles by the conventions that their names give, or that are asked for."""

from __future__ import annotations

from collections.abc import Mapping

from calib.foreign.map.map_file import MATRIX, UNDECIDED
from calib.foreign.map.rotations import ANGLES_OF, NAME_OF, USUAL
from calib.foreign.meanings.assigned import LEAVE, Assigned, Question, Set, occurrence
from calib.foreign.meanings.units_of_columns import units_of_columns
from calib.foreign.meanings.words import Meaning


def orientations(to: Assigned, meanings: dict[str, Meaning]) -> None:
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
        order = to.ask(Question(key, f"Is {names[0]} .. {names[3]} a quaternion with the scalar first or last?",
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


def _angles(to: Assigned, names: Set, family: str, meanings: Mapping[str, Meaning]) -> None:
    convention, why = ANGLES_OF.get(family, ("", ""))
    key = f"{to.prefix}rotation"
    to.keys.add(key)
    if not convention or key in to.answers:
        shown = ", ".join(names)
        usual = [NAME_OF.get((family, each), each) for each in USUAL]
        convention = to.ask(Question(key, f"By which convention are {shown} an orientation?", (*usual, LEAVE),
                                     "roll-pitch-yaw" if family == "rpy" else "", evidence=True))  # fmt: skip
        why = to.reason(key)
    if convention == LEAVE:
        return
    to.rotation = convention
    units, reason = units_of_columns(to, names, meanings, "rotation", ("deg", "rad"))
    for k, name in enumerate(names, start=1):
        to.columns[f"rot_{k}"] = f"{name}[{units[k - 1]}]"
        to.take(name, f"angle {k} of {convention}", units[k - 1], f"{reason[k - 1]}; {why}")
