"""Line numbers in a robot file: that of a key of a link, so that a message names the line to change."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

from calib.arm import Robot
from calib.units import DEG

_MOST = 8
_NUMBERS = (("alpha", "alpha_deg", DEG), ("a", "a_mm", 1.0), ("theta", "theta_deg", DEG), ("d", "d_mm", 1.0))


def line_of(text: str, key: str, link: int | None = None) -> int | None:
    """Number of the line, from 1, of `key` in the `link`-th [[link]] (1-based), or above all tables.

    None where the file is written differently.
    """
    at, inside = 0, link is None
    for number, line in enumerate(text.splitlines(), start=1):
        if re.match(r"\s*\[", line):
            at += bool(re.match(r"\s*\[\[\s*link\s*\]\]", line))
            inside = link is not None and at == link and bool(re.match(r"\s*\[\[\s*link\s*\]\]", line))
        elif inside and re.match(rf"\s*{key}\s*=", line):
            return number
    return None


def changed_lines(path: Path, text: str, robot: Robot, other: Robot) -> Iterator[str]:
    """The lines that make `other` of `robot`: its convention, its DH numbers."""
    if other.convention != robot.convention:
        yield f'{_place(path, line_of(text, "convention"))}: convention = "{other.convention}"'
    changes = [
        f"{_place(path, line_of(text, key, k + 1))}: {key} = {_number(new[k] / unit)}   (link {k + 1}, now "
        f"{_number(old[k] / unit)})"
        for k in range(robot.joints)
        for name, key, unit in _NUMBERS
        if (old := getattr(robot, name)) and (new := getattr(other, name)) and old[k] != new[k]
    ]
    yield from changes[:_MOST]
    if len(changes) > _MOST:
        yield f"and {len(changes) - _MOST} more lines in the same way"


def theta_line(path: Path, text: str, k: int, theta_deg: float) -> str:
    """The line with theta_deg of link k (0-based), at its new value, from -180 to 180."""
    value = (theta_deg + 180.0) % 360.0 - 180.0
    shown = 180.0 if abs(value + 180.0) < 1e-9 else value
    return f"{_place(path, line_of(text, 'theta_deg', k + 1))}: theta_deg = {_number(shown)}   (link {k + 1})"


def _place(path: Path, line: int | None) -> str:
    return path.name if line is None else f"{path.name}, line {line}"


def _number(value: float) -> str:
    return repr(round(float(value), 9) + 0.0)
