"""URDF: the joints and links of a robot as ROS describes it, in m and rad, as a tree.

Only the elements that a chain of joints needs are read: `origin`, `axis`, `limit` and `mimic` of joints,
mass and centre of links. An angle that is a multiple of 45 deg rounded to a few digits (1.5708) is read
as that multiple and reported. The reason is that axes which are parallel but for a rounding have no
common normal near the robot. Source: the URDF specification (joint, link).
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np
from scipy.spatial.transform import Rotation

from calib.array import Array
from calib.errors import DataError
from calib.robot_file.dh_words import exact_turn
from calib.text import read_xml

METRE = 1000.0
MOVING = ("revolute", "continuous", "prismatic")
_KINDS = (*MOVING, "fixed", "floating", "planar")
_FARTHEST_M = 100.0
_MOST_TURN = 25.0  # rad: four turns; a limit beyond is one in degrees
_LONGEST = 200  # characters of a name
_LONGEST_AXIS = 1e6
_LEAST_KG = 1e-6  # what is lighter is left out
_MOST_KG = 5_000.0  # the heaviest arms weigh less as a whole
_FARTHEST_CENTRE_MM = 10_000.0


@dataclass(frozen=True)
class Mimic:
    """A joint that follows another.

    Its value is multiplier x that of `joint`, plus offset (rad or m).
    """

    joint: str
    multiplier: float
    offset: float


@dataclass(frozen=True)
class UrdfJoint:
    """A joint of a URDF.

    Attributes
    ----------
    kind : str
        One of `MOVING`, or fixed, floating, planar.
    origin : array of shape (4, 4)
        From the parent's frame to the joint's, mm.
    axis : array of shape (3,)
        Axis in the joint's frame, of length 1.
    limits : tuple of float or None
        Limits, rad or m; None without any.
    refused : DataError or None
        Reason why the joint cannot be part of a chain; its origin, axis and limits then mean nothing.
    """

    name: str
    kind: str
    parent: str
    child: str
    origin: Array
    axis: Array
    limits: tuple[float, float] | None
    mimic: Mimic | None
    refused: DataError | None = None


@dataclass(frozen=True)
class Urdf:
    """A robot of a URDF.

    Attributes
    ----------
    links : frozenset of str
        Names of the links.
    roots : tuple of str
        Links that no joint carries.
    joints : dict of str to UrdfJoint
        Joints by the link that they carry.
    masses : dict
        Mass (kg) and centre (3,), mm, by link, or the reason why they cannot be read.
    remarks : tuple of str
        Remarks on reading.
    """

    name: str
    path: Path
    links: frozenset[str]
    roots: tuple[str, ...]
    joints: dict[str, UrdfJoint]
    masses: dict[str, tuple[float, Array] | DataError]
    remarks: tuple[str, ...]


def read_urdf(path: Path) -> Urdf:
    """Read the robot of a URDF file.

    A joint that cannot be part of a chain is refused only by a chain through it: a wheel or a gripper
    does not concern an arm.

    Raises
    ------
    DataError
        The file is no URDF.
    """
    return urdf_of(read_xml(path), path)


def urdf_of(root: Element, path: Path) -> Urdf:
    """Build the robot from a URDF's outermost element.

    Raises
    ------
    DataError
        As `read_urdf`.
    """
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
                what = f"names the link '{end[:_LONGEST]}'."
                joint = replace(
                    joint, refused=_refused(path, f"joint {joint.name}", what, "Declare that link.")
                )
        if joint.child in joints:
            what = f"carries the link '{joint.child}', which {joints[joint.child].name} carries too: no tree."
            do = "A URDF cannot hold closed chains; leave one of the joints out."
            joint = replace(joint, refused=_refused(path, f"joint {joint.name}", what, do))
        joints[joint.child] = joint
    masses = {}
    for element in root.findall("link"):
        if (found := _mass(element, path, rounded)) is not None:
            masses[_name(element, path)] = found
    said = tuple(f"{text} was taken as {value:g} deg exactly." for text, value in rounded.items())
    roots = tuple(name for name in links if name not in joints)
    return Urdf(root.get("name") or path.stem, path, declared, roots, joints, masses, said)


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
    ends = {}
    for end in ("parent", "child"):
        found = element.find(end)
        if found is None or not found.get("link"):
            raise _refused(path, key, f"has no {end}.", f'Give <{end} link="..."/>.')
        ends[end] = str(found.get("link"))
    plain = UrdfJoint(
        name, kind, ends["parent"], ends["child"], np.eye(4), np.array([1.0, 0.0, 0.0]), None, None
    )
    try:
        return _moved(element, plain, path, rounded)
    except DataError as error:
        return replace(plain, refused=error)


def _moved(element: Element, joint: UrdfJoint, path: Path, rounded: dict[str, float]) -> UrdfJoint:
    """Add origin, axis, limits and mimic to a joint.

    Raises
    ------
    DataError
        One of them is not valid.
    """
    kind, key = joint.kind, f"joint {joint.name}"
    if kind not in _KINDS:
        raise _refused(path, key, f"has the type '{kind[:40]}'.", f"Use {', '.join(_KINDS)}.")
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
    return replace(
        joint,
        origin=_origin(element, path, key, rounded),
        axis=axis / length if length else axis,
        limits=_limits(element, kind, path, key),
        mimic=mimic,
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
    """Read the frame (4, 4) of an origin, mm: R = Rz(yaw) Ry(pitch) Rx(roll)."""
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
        exact_turn(word, angle, rounded)
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


def _mass(element: Element, path: Path, rounded: dict[str, float]) -> tuple[float, Array] | DataError | None:
    inertial = element.find("inertial")
    mass = None if inertial is None else inertial.find("mass")
    if inertial is None or mass is None:
        return None
    key = f"link {element.get('name')}"
    try:
        value = _number(mass, "value", 0.0, path, key)
        if value < 0.0:
            return _refused(path, key, f"has the mass {value:g} kg.", "Give it in kg, zero or above.")
        if value > _MOST_KG:
            return _refused(path, key, f"has the mass {value:g} kg: written in g?", "A URDF has kg.")
        centre = _origin(inertial, path, key, rounded)[:3, 3]
        if np.abs(centre).max() > _FARTHEST_CENTRE_MM:
            far = f"has its mass {np.abs(centre).max() / METRE:g} m away: written in mm?"
            return _refused(path, key, far, "A URDF has metres.")
        return (value, centre) if value >= _LEAST_KG else None
    except DataError as error:
        return error


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
