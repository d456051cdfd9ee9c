"""The uncertainty of nests, cups and tool targets in the cell file: one standard deviation per axis, mm.

    [world]                                   [tool]
    u_mm = 0.3                                u_mm = 0.05
    nests_u_mm = { B2 = 0.02 }                targets_u_mm = { T3 = 0.01 }

A data set of distances has such positions as they are known, never as exact: where nobody stated it, a cup counts as
taught by a robot as it came, and a tool target as turned or milled by drawing. Points see the tool and their frame
themselves; there a tool target is freed where the cell file says how well it is known.
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
    """A sentence on balls of whose positions the cell file does not say how well they are known."""
    return (
        f"The cell file does not state how well {', '.join(names)} are known: {TAUGHT_MM:g} mm is assumed of a cup, "
        f"{MADE_MM:g} mm of a ball on the tool. State u_mm under [world] and [tool] before the campaign begins."
    )


def stated(table: TomlTable, key: str, names: Collection[str]) -> dict[str, float]:
    """The uncertainties that a table states, in mm by name: `u_mm` for all of them, or each under `key`.

    Zero means exact. Raises ConfigError for a number that cannot be meant, or a name that is not one of `names`.
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
