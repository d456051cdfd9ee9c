"""Kinds of joints, their units in files, and the joint matrices of a robot file.

A joint that turns counts in deg, one that slides in mm. An axis has a name, by which columns are called
(`j1_deg`, `e1_mm`). The joints of the arm are j1, j2, ...; external axes, which the robot file names,
are e1, e2, ... (a track, a lifting column, a positioner).

A joint matrix states how the joints that a controller counts turn those of the model.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from calib.errors import DataError
from calib.text.toml_table import refuse_unknown
from calib.units import DEG

JointKind = Literal["turns", "slides"]
KINDS: tuple[JointKind, ...] = ("turns", "slides")
UNITS: Mapping[JointKind, str] = {"turns": "deg", "slides": "mm"}
"""In which a joint is read and written outside."""

FACTORS: Mapping[JointKind, float] = {"turns": DEG, "slides": 1.0}
"""One of these units inside: rad, mm."""

_LIMITS: Mapping[JointKind, tuple[str, str]] = {
    kind: (f"min_{unit}", f"max_{unit}") for kind, unit in UNITS.items()
}

_KEYS = ("alpha_deg", "a_mm", "theta_deg", "d_mm", "joint", "axis")
_MEANT = {"kind": "joint", "type": "joint", "joint_type": "joint", "name": "axis"}
_EXTERNAL = re.compile(r"e[1-9][0-9]?")
KEYS = ("matrix", "offset_deg", "offset_mm")


def kind_of(link: Mapping[str, Any], number: int, path: Path) -> JointKind:
    """Read the kind of the joint of a `[[link]]` and check the keys of the table.

    Raises
    ------
    DataError
        The kind or a key is not valid; the error names the key.
    """
    given = link.get("joint", "turns")
    prefix = f"link[{number}]."
    if given not in KINDS:
        raise DataError(
            f"is {given!r}.", do='Use joint = "turns" or joint = "slides".', file=path, key=f"{prefix}joint"
        )
    kind: JointKind = "slides" if given == "slides" else "turns"
    other: JointKind = "turns" if kind == "slides" else "slides"
    for wrong, right in zip(_LIMITS[other], _LIMITS[kind], strict=True):
        if wrong in link:
            raise DataError(
                f"is the limit of a joint that {other}, but this joint {kind}.",
                do=f'Give {right} in {UNITS[kind]}, or write joint = "{other}".',
                file=path,
                key=f"{prefix}{wrong}",
            )
    refuse_unknown(link, (*_KEYS, *_LIMITS[kind]), path, prefix, _MEANT)
    return kind


def limits_of(link: Mapping[str, Any], kind: JointKind) -> tuple[float, float]:
    """Read the lower and upper limit of a joint, rad or mm.

    Raises
    ------
    KeyError, TypeError, ValueError
        A limit is missing or is not a number.
    """
    lower, upper = (float(link[key]) * FACTORS[kind] for key in _LIMITS[kind])
    return lower, upper


def external_of(links: Sequence[Mapping[str, Any]], path: Path) -> tuple[tuple[int, str], ...]:
    """Read the link and name of every external axis.

    Raises
    ------
    DataError
        A name is not e1, e2, ..., or is given twice.
    """
    found: dict[str, int] = {}
    for number, link in enumerate(links, start=1):
        if "axis" not in link:
            continue
        name = link["axis"]
        if not isinstance(name, str) or not _EXTERNAL.fullmatch(name):
            raise DataError(
                f"is {name!r}.",
                do="Name an external axis e1, e2, ...; joints of the arm are j1, j2, ... without being named.",
                file=path,
                key=f"link[{number}].axis",
            )
        if name in found:
            raise DataError(
                f"names '{name}', as link {found[name]} does.",
                do="Name each axis once.",
                file=path,
                key=f"link[{number}].axis",
            )
        found[name] = number
    return tuple((number, name) for name, number in found.items())


@dataclass(frozen=True)
class JointMatrix:
    """model joint = matrix @ controller joint + offset; rad, and mm of joints that slide."""

    matrix: tuple[tuple[float, ...], ...]
    offset: tuple[float, ...]


def parse_joint_matrix(
    entry: dict[str, Any], kinds: Sequence[JointKind], path: Path, key: str
) -> JointMatrix:
    """Parse a joint matrix: model joint = matrix @ controller joint + offset.

    The numbers of the file are in deg and mm.

    Raises
    ------
    DataError
        A key is unknown, or an offset has the unit of the other kind of joint.
    """
    refuse_unknown(entry, KEYS, path, f"{key}.")
    offset = [0.0] * len(kinds)
    for kind, unit in UNITS.items():
        given = [float(x) for x in entry.get(f"offset_{unit}", [0.0] * len(kinds))]
        misplaced = [
            k for k, x in enumerate(given, start=1) if x and k <= len(kinds) and kinds[k - 1] != kind
        ]
        if misplaced:
            raise DataError(
                f"gives an offset in {unit} for joint {misplaced[0]}, which {kinds[misplaced[0] - 1]}.",
                do="Give offset_deg for joints that turn, offset_mm for those that slide, 0 in the other.",
                file=path,
                key=f"{key}.offset_{unit}",
            )
        if f"offset_{unit}" in entry:
            offset = [x * FACTORS[kind] or y for x, y in itertools.zip_longest(given, offset, fillvalue=0.0)]
    factor = [FACTORS[kind] for kind in kinds]
    rows = [
        [float(x) * (factor[i] / factor[j] if max(i, j) < len(kinds) else 1.0) for j, x in enumerate(row)]
        for i, row in enumerate(entry["matrix"])
    ]
    return JointMatrix(tuple(tuple(row) for row in rows), tuple(offset))
