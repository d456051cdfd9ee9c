"""The body of an arm: capsules that enclose its links, in the frames of these links.

A capsule is the set of points within a radius of a straight line. One link may have several, and a housing that turns
about its own axis may as well belong to the link before. Read from the `[[capsule]]` tables of a robot file; an arm
whose file has none is taken as thick as `WITHOUT_FILE` of its length, straight from joint to joint. Lengths mm.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from calib.errors import DataError

Point = tuple[float, float, float]

WITHOUT_FILE = 0.15
"""Radius over length of an arm whose file has no capsules: what the widest of the built-in robots have."""
_WIDEST_MM = 2000.0  # a larger radius is a mistyped one


@dataclass(frozen=True)
class Capsule:
    """A capsule that encloses a link, or part of it.

    It contains all points within `radius_mm` of the line from `from_mm` to `to_mm`, two points in the
    frame of link `link` (1-based).
    """

    name: str
    link: int
    from_mm: Point
    to_mm: Point
    radius_mm: float


def parse_capsules(entries: Any, joints: int, path: Path | str) -> tuple[Capsule, ...]:
    """Parse the `[[capsule]]` tables of a robot file.

    Raises
    ------
    DataError
        A capsule is not physical, or its table has a missing or unknown key.
    """
    if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
        raise _refused("is not a list of tables.", "Write every capsule as [[capsule]].", path)
    return tuple(_capsule(entry, joints, path) for entry in entries)


def _capsule(entry: Mapping[str, Any], joints: int, path: Path | str) -> Capsule:
    what = "Give name, link (a joint's number), from_mm and to_mm = [x, y, z], radius_mm."
    known = {"name", "link", "from_mm", "to_mm", "radius_mm"}
    if entry.keys() != known:
        key = min(entry.keys() ^ known)
        raise _refused(f"{key} is {'missing' if key in known else 'not known here'}.", what, path)
    name, link, radius = entry["name"], entry["link"], entry["radius_mm"]
    if not isinstance(name, str) or not name:
        raise _refused(f"a capsule has the name {name!r}.", what, path)
    if type(link) is not int or not 1 <= link <= joints:
        raise _refused(f"'{name}' names link {link!r}.", f"Use a link from 1 to {joints}.", path)
    if not _is_length(radius) or not 0.0 < radius <= _WIDEST_MM:
        raise _refused(
            f"'{name}' has the radius {radius!r}.", f"Give it in mm, above 0, up to {_WIDEST_MM:g}.", path
        )
    start, end = (_point(name, entry[key], path) for key in ("from_mm", "to_mm"))
    return Capsule(name, link, start, end, float(radius))


def _point(name: str, value: Any, path: Path | str) -> Point:
    if not isinstance(value, list) or len(value) != 3 or not all(_is_length(x) for x in value):
        raise _refused(f"'{name}' has an end that is no point.", "Give [x, y, z] in mm.", path)
    x, y, z = value
    return float(x), float(y), float(z)


def _is_length(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e5


def _refused(what: str, do: str, path: Path | str) -> DataError:
    return DataError(what, do=do, file=path, key="capsule")


def default_capsules(
    convention: str, alpha: Sequence[float], a: Sequence[float], d: Sequence[float]
) -> tuple[Capsule, ...]:
    """Build straight capsules from joint to joint for an arm whose file has none.

    All have the same radius. Angles in rad, lengths in mm.
    """
    count = len(a)
    lengths = [math.hypot(x, z) for x, z in zip(a[1:], d[1:], strict=True)]
    radius = WITHOUT_FILE * sum(lengths)
    capsules = []
    for k in range(count):
        if convention == "dh":  # the link lies before its frame
            c, s = math.cos(alpha[k]), math.sin(alpha[k])
            end = (-a[k], -d[k] * s, -d[k] * c)
        elif k + 1 < count:  # it lies behind, up to the next frame
            c, s = math.cos(alpha[k + 1]), math.sin(alpha[k + 1])
            end = (a[k + 1], -d[k + 1] * s, d[k + 1] * c)
        else:
            end = (0.0, 0.0, 0.0)
        capsules.append(Capsule(f"link {k + 1}", k + 1, (0.0, 0.0, 0.0), end, radius))
    return tuple(capsules)
