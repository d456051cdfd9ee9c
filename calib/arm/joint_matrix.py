"""Joint matrices of a robot file: how the joints that a controller counts turn those of the model."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from calib.arm.joint_kinds import FACTORS, UNITS, JointKind
from calib.errors import DataError
from calib.text.unknown_keys import refuse_unknown

KEYS = ("matrix", "offset_deg", "offset_mm")


@dataclass(frozen=True)
class JointMatrix:
    """model joint = matrix @ controller joint + offset; rad, and mm of joints that slide."""

    matrix: tuple[tuple[float, ...], ...]
    offset: tuple[float, ...]


def parse_joint_matrix(
    entry: dict[str, Any], kinds: Sequence[JointKind], path: Path, key: str
) -> JointMatrix:
    """A joint matrix, whose numbers are those of a file (deg, mm): model joint = matrix @ controller joint + offset."""
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
