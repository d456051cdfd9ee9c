"""Units of a table's columns.

The unit of a column comes from its name, the row of units, the cells or the preamble. If none of them
states it, it is asked, unless the numbers permit only one unit (angles above two turns are degrees). It
is also asked if the numbers cannot have the stated unit.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from calib.array import Array
from calib.foreign.files.layout import unit_of
from calib.foreign.files.number import suffix_of
from calib.foreign.map.entry import ANGLES, FEW, HUGE_MM, LARGE_DEG, LENGTHS, MOST_RAD, SMALL_MM
from calib.foreign.map.map_file import UNDECIDED
from calib.foreign.meanings.assigned import Assigned, ColumnQuestion
from calib.foreign.meanings.words import ColumnMeaning


def units_of_columns(
    to: Assigned,
    names: Sequence[str],
    meanings: Mapping[str, ColumnMeaning],
    what: str,
    choices: tuple[str, ...],
) -> tuple[list[str], list[str]]:
    """Find the units of columns of one kind, each with the reason; `?` if it is asked."""
    layout = to.layout
    of_row = dict(zip(layout.names, layout.units, strict=False))
    units, why = [], []
    for name in names:
        suffixes = {unit_of(suffix_of(cell)) for cell in layout.cells[name] if cell} - {""}
        said = [
            (meanings[name].unit, "its name"),
            (of_row.get(name, ""), "the row of units"),
            (suffixes.pop() if len(suffixes) == 1 else "", "its cells"),
        ]
        given = [(unit, reason) for unit, reason in said if unit]
        if len({unit for unit, _ in given}) > 1:
            given = [("?", " and ".join(f"{reason} says {unit}" for unit, reason in given))]
        units.append(given[0][0] if given else "")
        why.append(given[0][1] if given else "")
    key = f"{to.prefix}unit.{what}"
    to.keys.add(key)
    if key in to.answers:
        unit = to.ask(ColumnQuestion(key, "", choices))
        return [unit] * len(names), [to.reason(key)] * len(names)
    stated = layout.stated_unit
    if what == "points" and stated and not any(units):
        units, why = (
            [stated[0]] * len(names),
            [f"the preamble: '{layout.above[stated[1]][:40]}'"] * len(names),
        )
    values = to.values(names)
    if not np.isfinite(values).any(axis=0).all():  # nothing to judge by: what the file states counts
        return [unit or UNDECIDED for unit in units], [reason or "open" for reason in why]
    doubt = _doubt(values, units, why, what)
    if doubt:
        likely = _likely(values, what)
        if not doubt[1] and likely == "deg" and what != "points":
            return ["deg"] * len(names), [
                f"up to {np.nanmax(np.abs(values)):.0f}: only degrees are so large"
            ] * len(names)
        to.ask(ColumnQuestion(key, doubt[0], choices, likely.rstrip("?"), evidence=True))
        return [UNDECIDED] * len(names), ["open: see the question"] * len(names)
    return units, why


def _doubt(values: Array, units: Sequence[str], why: Sequence[str], what: str) -> tuple[str, bool] | None:
    """Return the reason why the units of numbers (n, c) are open, and whether they are stated.

    Returns None if the units are not in doubt.
    """
    size = float(np.nanmax(np.abs(values), initial=0.0))
    if any(unit == "?" for unit in units):
        return (
            f"The unit of the {what} is none that is taken: "
            f"{next(w for u, w in zip(units, why, strict=True) if u == '?')}. Which?",
            True,
        )
    if not all(units):
        return f"Nothing states the unit of the {what}; they go up to {size:.4g}. Which is it?", any(units)
    if what.startswith("e"):
        return None
    lengths = all(unit in LENGTHS for unit in units)
    if what == "points":
        if not lengths:
            return f"Coordinates are said to be in {units[0]} ({why[0]}). Which is it?", True
        extent = (
            float(np.nanmax(np.nanmax(values, axis=0) - np.nanmin(values, axis=0), initial=0.0))
            * LENGTHS[units[0]]
        )
        if len(values) >= FEW and not SMALL_MM <= extent <= HUGE_MM:
            return (
                f"As {units[0]} ({why[0]}) the points span {extent:.4g} mm, and no robot is measured so. Which is it?",
                True,
            )
        return None
    known = (ANGLES, LENGTHS) if what == "angles" else (ANGLES,)  # a joint may slide
    if not all(any(unit in of for of in known) for unit in units):
        return f"Angles are said to be in {', '.join(dict.fromkeys(units))}. Which is it?", True
    if len(values) >= FEW and set(units) == {"deg"} and size <= LARGE_DEG and what == "angles":
        return (
            f"As deg ({why[0]}) no joint exceeds {size:.3f} deg, which looks like radians. Which is it?",
            True,
        )
    if (
        "rad" in units
        and np.nanmax(np.abs(values[:, [k for k, u in enumerate(units) if u == "rad"]])) > MOST_RAD
    ):
        return f"As rad ({why[0]}) they go up to {size:.4g}, which only degrees do. Which is it?", True
    return None


def _likely(values: Array, what: str) -> str:
    """Guess the unit of numbers from their size.

    Angles are `deg` if only degrees are so large.
    """
    size = float(np.nanmax(np.abs(values), initial=0.0))
    if what == "points":
        return (
            "mm"
            if float(np.nanmax(np.nanmax(values, axis=0) - np.nanmin(values, axis=0), initial=0.0)) > 150.0
            else "m"
        )
    return "deg" if size > MOST_RAD else "rad" if size <= LARGE_DEG else "deg?"
