"""URDF: the joints and links of a robot as ROS describes it, in m and rad, as a tree.

Only what a chain of joints needs is read: `origin`, `axis`, `limit` and `mimic` of joints, mass and centre of links.
An angle that is a multiple of 45 deg rounded to a few digits (1.5708) is read as that multiple and reported: axes that
are parallel but for a rounding have no common normal near the robot. Source: the URDF specification (joint, link).
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np
from scipy.spatial.transform import Rotation

from calib.array import Array
from calib.errors import DataError
from calib.text import read_xml

METRE = 1000.0
MOVING = ("revolute", "continuous", "prismatic")
_KINDS = (*MOVING, "fixed", "floating", "planar")
_FARTHEST_M = 100.0
_MOST_TURN = 25.0  # rad: four turns; a limit beyond is one in degrees
_EIGHTH = math.pi / 4.0
_MOST_DIGITS = 15
_LONGEST = 200  # characters of a name
_LONGEST_AXIS = 1e6
_LEAST_KG = 1e-6  # what is lighter is left out


@dataclass(frozen=True)
class Mimic:
    """A joint that follows another: its value is multiplier x that of `joint`, plus offset (rad or m)."""

    joint: str
    multiplier: float
    offset: float


@dataclass(frozen=True)
class UrdfJoint:
    """A joint: `origin` (4, 4) from the parent's frame to the joint's, mm; `axis` (3,) in it, of length 1.

    limits: rad or m, None where there are none. kind: one of `MOVING`, fixed, floating, planar.
    """

    name: str
    kind: str
    parent: str
    child: str
    origin: Array
    axis: Array
    limits: tuple[float, float] | None
    mimic: Mimic | None


@dataclass(frozen=True)
class Urdf:
    """A robot: joints by the link that they carry, mass (kg) and centre (3,), mm, of links, and remarks on reading."""

    name: str
    path: Path
    root: str
    joints: dict[str, UrdfJoint]
    masses: dict[str, tuple[float, Array]]
    remarks: tuple[str, ...]


def read_urdf(path: Path) -> Urdf:
    """The robot of a URDF file. Raises DataError naming the joint for what is no tree of joints."""
    root = read_xml(path)
    _refuse_macros(root, path)
    if root.tag != "robot":
        raise DataError(
            f"is <{root.tag[:40]}>, not a URDF.", do="A URDF has <robot> as its outermost element.", file=path
        )
    rounded: dict[str, float] = {}
    links = [_name(each, path) for each in root.findall("link")]
    joints: dict[str, UrdfJoint] = {}
    names = [_name(each, path) for each in root.findall("joint")]
    for what, given in (("link", links), ("joint", names)):
        if twice := [name for name, count in Counter(given).items() if count > 1]:
            raise _refused(path, f"{what} {min(twice)}", "is there twice.", "Give each one name.")
    declared = frozenset(links)
    for element in root.findall("joint"):
        joint = _joint(element, path, rounded)
        for end in (joint.parent, joint.child):
            if end not in declared:
                raise _refused(
                    path, f"joint {joint.name}", f"names the link '{end[:_LONGEST]}'.", "Declare that link."
                )
        if joint.child in joints:
            other = joints[joint.child].name
            raise _refused(
                path,
                f"joint {joint.name}",
                f"carries the link '{joint.child}', which {other} carries too: no tree.",
                "A URDF cannot hold closed chains; leave one of the joints out.",
            )
        joints[joint.child] = joint
    tops = [name for name in links if name not in joints]
    if len(tops) != 1:
        raise DataError(
            f"has {len(tops)} links that no joint carries ({', '.join(tops[:5])}).",
            do="One link carries all others: connect the rest, or leave it out.",
            file=path,
        )
    _refuse_rings(joints, path)
    masses = {}
    for element in root.findall("link"):
        if (found := _mass(element, path, rounded)) is not None:
            masses[_name(element, path)] = found
    said = tuple(f"{text} rad was taken as {value:g} deg exactly." for text, value in rounded.items())
    return Urdf(root.get("name") or path.stem, path, tops[0], joints, masses, said)


def _refuse_rings(joints: dict[str, UrdfJoint], path: Path) -> None:
    """Raise DataError where links carry one another: each has one joint, and none of them leads to the root."""
    grounded: set[str] = set()
    for link in joints:
        way: dict[str, None] = {}
        while link in joints and link not in grounded:
            if link in way:
                raise _refused(
                    path,
                    f"joint {joints[link].name}",
                    f"carries the link '{link}', which carries it in turn.",
                    "Let one link carry all others, directly or over others.",
                )
            way[link] = None
            link = joints[link].parent
        grounded.update(way)


def _refuse_macros(root: Element, path: Path) -> None:
    for element in root.iter():
        if ":" in element.tag or any("${" in value or "$(" in value for value in element.attrib.values()):
            raise DataError(
                f"holds macros (<{element.tag[:40]}>): it is a xacro file.",
                do="Make the URDF of it first: xacro FILE.xacro > FILE.urdf.",
                file=path,
            )


def _refused(path: Path, key: str, what: str, do: str) -> DataError:
    return DataError(what, do=do, file=path, key=key)


def _name(element: Element, path: Path) -> str:
    name = element.get("name")
    if not name:
        raise DataError(f"a <{element.tag}> has no name.", do="Give it one.", file=path)
    if len(name) > _LONGEST:
        raise DataError(
            f"a <{element.tag}> has a name of {len(name)} characters.", do="Shorten it.", file=path
        )
    return name


def _joint(element: Element, path: Path, rounded: dict[str, float]) -> UrdfJoint:
    name = _name(element, path)
    key = f"joint {name}"
    kind = element.get("type", "")
    if kind not in _KINDS:
        raise _refused(path, key, f"has the type '{kind[:40]}'.", f"Use {', '.join(_KINDS)}.")
    ends = {}
    for end in ("parent", "child"):
        found = element.find(end)
        if found is None or not found.get("link"):
            raise _refused(path, key, f"has no {end}.", f'Give <{end} link="..."/>.')
        ends[end] = str(found.get("link"))
    axis = np.array([1.0, 0.0, 0.0])
    if (found := element.find("axis")) is not None:
        axis = np.array(_numbers(found, "xyz", (1.0, 0.0, 0.0), path, key))
    length = float(np.linalg.norm(np.clip(axis, -_LONGEST_AXIS, _LONGEST_AXIS)))
    if kind in MOVING and not 1e-6 < length < _LONGEST_AXIS:
        raise _refused(path, key, "has an axis without a direction.", "Give three numbers, not all zero.")
    mimic = None
    if (found := element.find("mimic")) is not None:
        mimic = Mimic(
            found.get("joint", ""),
            _number(found, "multiplier", 1.0, path, key),
            _number(found, "offset", 0.0, path, key),
        )
    return UrdfJoint(
        name,
        kind,
        ends["parent"],
        ends["child"],
        _origin(element, path, key, rounded),
        axis / length if length else axis,
        _limits(element, kind, path, key),
        mimic,
    )


def _limits(element: Element, kind: str, path: Path, key: str) -> tuple[float, float] | None:
    found = element.find("limit")
    if kind not in ("revolute", "prismatic"):
        return None
    if found is None or found.get("lower") is None or found.get("upper") is None:
        raise _refused(
            path,
            key,
            "has no limits.",
            'Give <limit lower="..." upper="..."/> (rad or m) from the data sheet.',
        )
    low, high = _number(found, "lower", 0.0, path, key), _number(found, "upper", 0.0, path, key)
    if low > high:
        raise _refused(
            path, key, f"has its limits swapped: lower {low:g}, upper {high:g}.", "Exchange the two."
        )
    if low == high:
        raise _refused(
            path, key, f"may not move: both limits are {low:g}.", "Give its limits, or make it fixed."
        )
    most, unit, other = (_MOST_TURN, "rad", "deg") if kind == "revolute" else (_FARTHEST_M, "m", "mm")
    if max(abs(low), abs(high)) > most:
        raise _refused(
            path,
            key,
            f"has the limits {low:g} and {high:g} {unit}: they are in {other}.",
            f"A URDF has {unit}.",
        )
    return low, high


def _origin(element: Element, path: Path, key: str, rounded: dict[str, float]) -> Array:
    """The frame (4, 4) of an origin, mm: R = Rz(yaw) Ry(pitch) Rx(roll)."""
    pose = np.eye(4)
    found = element.find("origin")
    if found is None:
        return pose
    xyz = np.array(_numbers(found, "xyz", (0.0, 0.0, 0.0), path, key))
    if np.abs(xyz).max() > _FARTHEST_M:
        raise _refused(path, key, f"is {np.abs(xyz).max():g} m away: written in mm?", "A URDF has metres.")
    angles = _numbers(found, "rpy", (0.0, 0.0, 0.0), path, key)
    if max(map(abs, angles)) > _MOST_TURN:
        raise _refused(path, key, f"is turned by {max(map(abs, angles)):g} rad.", "A URDF has radians.")
    rpy = [
        _exact(word, angle, rounded)
        for word, angle in zip(
            found.get("rpy", "0 0 0").split(),
            angles,
            strict=True,
        )
    ]
    pose[:3, :3] = Rotation.from_euler("xyz", rpy).as_matrix()
    # Rounding of sines: what is meant as square is square to the last digit
    pose[:3, :3][np.abs(pose[:3, :3]) < 1e-15] = 0.0
    pose[:3, 3] = METRE * xyz
    return pose


def _exact(word: str, angle: float, rounded: dict[str, float]) -> float:
    """The multiple of 45 deg of which `word` has the first digits; else the angle as it is."""
    multiple = round(angle / _EIGHTH)
    meant = multiple * _EIGHTH
    digits = len(word.lower().partition("e")[0].partition(".")[2])
    digits = min(digits, _MOST_DIGITS)
    cut = math.trunc(meant * 10.0**digits) / 10.0**digits
    if multiple == 0 or digits < 2 or min(abs(angle - round(meant, digits)), abs(angle - cut)) > 1e-14:
        return angle
    if abs(angle - meant) > 1e-9:
        rounded[word] = multiple * 45.0
    return meant


def _mass(element: Element, path: Path, rounded: dict[str, float]) -> tuple[float, Array] | None:
    inertial = element.find("inertial")
    mass = None if inertial is None else inertial.find("mass")
    if inertial is None or mass is None:
        return None
    key = f"link {element.get('name')}"
    value = _number(mass, "value", 0.0, path, key)
    if value < 0.0:
        raise _refused(path, key, f"has the mass {value:g} kg.", "Give it in kg, zero or above.")
    return (value, _origin(inertial, path, key, rounded)[:3, 3]) if value >= _LEAST_KG else None


def _number(element: Element, attribute: str, default: float, path: Path, key: str) -> float:
    return _numbers(element, attribute, (default,), path, key)[0]


def _numbers(
    element: Element, attribute: str, default: tuple[float, ...], path: Path, key: str
) -> tuple[float, ...]:
    text = element.get(attribute)
    if text is None:
        return default
    try:
        values = tuple(float(word) for word in text.split())
    except ValueError:
        values = ()
    if len(values) != len(default) or not all(math.isfinite(value) for value in values):
        count = "a number" if len(default) == 1 else f"{len(default)} numbers"
        raise _refused(path, key, f"has {attribute} = '{text[:40]}' in <{element.tag}>.", f"Give {count}.")
    return values
