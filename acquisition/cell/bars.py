"""The lengths to which a ballbar can be built: its body and any of its extension bars, each at most once.

A QC20-W of 100 mm with bars of 50, 150 and 300 mm reads 100, 150, 250, 300 ... 600 mm, give or take its stroke: 150 mm
along the tool triangle, 300 mm along the base triangle and the legs. Source: Nubiola, thesis, section 4.2.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from acquisition.cell.cell import Cell
from acquisition.cell.position_uncertainty import MADE_MM, TAUGHT_MM

_STRAY = 3.0  # standard deviations by which two balls may be apart from what the cell file says


@dataclass(frozen=True)
class Bar:
    """A ballbar as a person has built it, lengths mm."""

    body_mm: float
    extensions_mm: tuple[float, ...]

    @property
    def length_mm(self) -> float:
        """The length from ball to ball in the middle of the stroke."""
        return self.body_mm + sum(self.extensions_mm)

    def in_words(self) -> str:
        """The sentence that says to a person how to build the bar."""
        if not self.extensions_mm:
            return f"the ballbar of {self.length_mm:g} mm, without extension bars"
        bars = " and ".join(f"{each:g}" for each in self.extensions_mm)
        many = "bars" if len(self.extensions_mm) > 1 else "bar"
        return (
            f"the ballbar of {self.length_mm:g} mm: {self.body_mm:g} mm and the extension {many} of {bars} mm"
        )


def bars_of(cell: Cell) -> tuple[Bar, ...]:
    """Every bar that can be built in this cell, the one of the legs first, then by the number of extensions."""
    declared, legs = cell.instrument.declared, cell.instrument.nominal_mm
    kit = [
        Bar(declared.body_mm, some)
        for count in range(len(declared.extensions_mm) + 1)
        for some in combinations(declared.extensions_mm, count)
    ]
    for_legs = next((bar for bar in kit if bar.length_mm == legs), Bar(legs, ()))
    return (for_legs, *(bar for bar in kit if bar != for_legs))


def apart_mm(cell: Cell, one: str, other: str) -> float:
    """Distance of two balls of the base, or two of the tool, by the cell file, mm."""
    places = cell.nests if one in cell.nests else cell.tool.targets
    return float(np.linalg.norm(np.subtract(places[one], places[other])))


def bar_between(cell: Cell, one: str, other: str) -> Bar | None:
    """The bar that fits between two balls of one body, as well as the cell file knows them; None where none does."""
    apart = apart_mm(cell, one, other)
    known, assumed = {**cell.nests_u_mm, **cell.tool.u_mm}, TAUGHT_MM if one in cell.nests else MADE_MM
    stray = float(np.hypot(known.get(one, assumed), known.get(other, assumed)))
    reach = (cell.instrument.declared.stroke_mm or 0.0) + _STRAY * stray
    best = min(bars_of(cell), key=lambda bar: abs(bar.length_mm - apart))
    return best if abs(best.length_mm - apart) <= reach else None


def bar_for(cell: Cell, target: str, base_target: str) -> Bar:
    """The bar for a planned reading: of a leg, or between two balls of one body."""
    leg = (target in cell.nests) != (base_target in cell.nests)
    between = None if leg else bar_between(cell, target, base_target)
    return bars_of(cell)[0] if between is None else between
