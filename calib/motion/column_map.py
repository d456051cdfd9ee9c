"""The map of the columns of a foreign recording: `time=Timestamp[ms], j1=actual_q_0[rad], ...`.

A map is a quantity, the column's name and the unit of its values, with commas between. The unit `date` of a time is a
date and a time of day.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from calib.errors import DataError
from calib.units import DEG

DATE = "date"
ANGLES = {"deg": DEG, "rad": 1.0, "mrad": 1e-3}
LENGTHS = {"mm": 1.0, "m": 1000.0, "um": 1e-3, "cm": 10.0, "in": 25.4}
_TIMES = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "min": 60.0, DATE: 1.0}
_ENTRY = re.compile(r"(\w++)\s*+=\s*+(\S.*)\[\s*+(\w++)\s*+\]")


@dataclass(frozen=True)
class Column:
    """One column of a file, the unit of its numbers, and by what they are multiplied."""

    name: str
    unit: str
    factor: float


def parse_map(text: str, quantities: Sequence[str], key: str) -> dict[str, Column]:
    """Quantity -> column. Raises DataError (key) for a map that cannot be read or does not name every quantity once."""
    found: dict[str, Column] = {}
    names = f"Name {', '.join(quantities)}, each once."
    for part in re.split(r"(?<=\])\s*+,", text):
        match = _ENTRY.fullmatch(part.strip())
        if match is None:
            raise DataError(
                f"{part.strip()[:100]!r} cannot be read.",
                do="Write quantity=column[unit], e.g. time=Timestamp[ms].",
                key=key,
            )
        quantity, name, unit = match.groups()
        if quantity not in quantities or quantity in found:
            raise DataError(f"names '{quantity}'.", do=names, key=key)
        known = _TIMES if quantity == "time" else ANGLES if quantity[0] == "j" else LENGTHS
        if unit not in known:
            raise DataError(f"gives {quantity} the unit '{unit}'.", do=f"Use {', '.join(known)}.", key=key)
        found[quantity] = Column(name.strip(), unit, known[unit])
    for quantity in quantities:
        if quantity not in found:
            raise DataError(f"does not name '{quantity}'.", do=names, key=key)
    return found
