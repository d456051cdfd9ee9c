"""The uncertainty of nests, cups and tool targets in the cell file.

It is one standard deviation per axis, mm:

    [world]                                   [tool]
    u_mm = 0.3                                u_mm = 0.05
    nests_u_mm = { B2 = 0.02 }                targets_u_mm = { T3 = 0.01 }

A data set of distances uses such positions with their uncertainty, never as exact. If it is not stated, a cup counts as
taught by a robot as delivered, and a tool target as turned or milled according to a drawing. Measured points determine
the tool and their frame themselves; there a tool target is freed if the cell file states its uncertainty.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence

from calib.data import LEAST
from calib.text import TomlTable

TAUGHT_MM = 1.0
"""A cup touched by an uncalibrated robot. Nubiola, thesis, Table 4.3: 1.355 mm on the average, 1.029 mm of scatter."""
MADE_MM = 0.2
"""A ball on a tool made by drawing: ISO 2768-1 medium allows 0.3 mm from 120 to 400 mm, as a rectangle 0.17 mm."""
_MOST_MM = 1000.0


def unstated_in_words(names: Sequence[str]) -> str:
    """Return a sentence on balls whose position uncertainty the cell file does not state."""
    return (
        f"The cell file does not state how well {', '.join(names)} are known: {TAUGHT_MM:g} mm is assumed of a cup, "
        f"{MADE_MM:g} mm of a ball on the tool. State u_mm under [world] and [tool] before the campaign begins."
    )


def stated(table: TomlTable, key: str, names: Collection[str]) -> dict[str, float]:
    """Return the uncertainties that a table states, in mm by name.

    The table has `u_mm` for all of them, or an entry for each under `key`. Zero means exact.

    Raises
    ------
    ConfigError
        A number is not plausible, or a name is not one of `names`.
    """
    own = table.table(key)
    own.only(names)
    common = dict.fromkeys(names, _number(table, "u_mm")) if "u_mm" in table.values else {}
    return common | {name: _number(own, name) for name in own.values}


def _number(table: TomlTable, key: str) -> float:
    u_mm = table.number(key, low=0.0, high=_MOST_MM)
    if 0.0 < u_mm < LEAST:
        raise table.refuse(key, f"is {u_mm!r}: too small to be true.", "Use 0 for exact.")
    return u_mm
