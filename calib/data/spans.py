"""Distances between two balls of the base, or two of the tool, without the arm.

    tool_target  base_target  other_target  length_mm
    T1                        T2            150.0031     two balls of the tool
                 B1           B2            299.9974     two balls of the base

A ballbar measures them by itself. Their rows have no joint angles, and they tie the positions of the
balls to each other in every fit (`calib.model.model`). Source: Nubiola, thesis, section 4.2.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from calib.data.header import LEAST, Header
from calib.errors import DataError
from calib.text.columns import TextTable

OTHER = "other_target"
_GROSS_MM, _GROSS_SIGMA = 10.0, 6.0  # beyond both, it was another bar or another ball


@dataclass(frozen=True)
class Span:
    """The measured distance of two balls, mm, with its standard uncertainty.

    `series` is that of the tool that carries them; empty for two balls of the base.
    """

    reading_id: str
    one: str
    other: str
    series: str
    length_mm: float
    u_mm: float

    @property
    def name(self) -> str:
        """The name of the side, for people."""
        return f"{self.one} to {self.other}"


def take_spans(table: TextTable, header: Header) -> tuple[tuple[Span, ...], TextTable]:
    """Separate the distances between balls of one body from the readings of the arm.

    Returns those that count, and the table of the other rows.

    Raises
    ------
    DataError
        A distance cannot be that of the two balls that it names; the error names line and column.
    """
    of_span = table.text(OTHER) != ""
    if not of_span.any():
        return (), table
    rows = table.where(of_span)
    status = np.char.lower(rows.text("status"))
    counts = np.isin(status, ("", "ok")) & (rows.text("set", "calibration") != "validation")
    spans = {int(i): _span(rows, int(i), header) for i in np.flatnonzero(counts)}
    for i, span in spans.items():
        _refuse_another(rows, i, span, header)
    _refuse_impossible(list(spans.values()), table)
    return tuple(spans.values()), table.where(~of_span)


def _span(rows: TextTable, i: int, header: Header) -> Span:
    tool, base, other = (str(rows.text(name)[i]) for name in ("tool_target", "base_target", OTHER))
    one, series = tool or base, str(rows.text("series", "main")[i]) if tool else ""
    if bool(tool) == bool(base) or one == other:
        raise rows.refuse(
            i,
            OTHER,
            f"is '{other}' beside tool_target '{tool}' and base_target '{base}'",
            "Name the first of two different balls as tool_target where both are on the tool, else as base_target",
        )
    for name in (one, other):
        if not (name in header.targets_of(series) if tool else header.knows_base_target(name)):
            key = "tool_targets" if tool else "base_targets"
            raise rows.refuse(
                i, OTHER, f"leads to '{name}', which the header does not have", f"Add it under [{key}]"
            )
    length, own = float(rows.numbers("length_mm")[i]), float(rows.numbers("u_length_mm")[i])
    if not length > 0.0:
        raise rows.refuse(
            i, "length_mm", "holds no distance", "Give it in mm, or write rejected:REASON as status"
        )
    u_mm = own if np.isfinite(own) else header.noise.length_mm
    if not u_mm >= LEAST:
        raise rows.refuse(i, "u_length_mm", "is not above zero", "Fill it, or give length_mm under [noise]")
    return Span(str(rows.text("reading_id")[i]) or str(rows.lines[i]), one, other, series, length, u_mm)


def _refuse_another(rows: TextTable, i: int, span: Span, header: Header) -> None:
    """Raise DataError for a distance that the stated positions exclude.

    It is then of other balls, or was measured with another bar.
    """
    places = header.targets_of(span.series) if span.series else header.base_targets
    if span.one not in places or span.other not in places:
        return  # a position that is free
    known = header.tool_targets_u_mm if span.series else header.base_targets_u_mm
    apart = float(np.linalg.norm(np.subtract(places[span.one], places[span.other])))
    u_mm = float(np.hypot(known.get(span.one, 0.0), known.get(span.other, 0.0)))
    if abs(span.length_mm - apart) > max(_GROSS_MM, _GROSS_SIGMA * u_mm):
        raise rows.refuse(
            i,
            "length_mm",
            f"has {span.length_mm:g} from {span.name}, which the header puts {apart:.1f} mm apart",
            "Check whether the bar had another extension or sat on other balls, and correct or reject the row",
        )


def _refuse_impossible(spans: Sequence[Span], table: TextTable) -> None:
    """Raise DataError for three distances of one body that make no triangle."""
    sides: dict[tuple[str, frozenset[str]], Span] = {
        (span.series, frozenset((span.one, span.other))): span for span in spans
    }
    for series in {span.series for span in spans}:
        balls = sorted({name for span in spans if span.series == series for name in (span.one, span.other)})
        for three in combinations(balls, 3):
            found = [sides.get((series, frozenset(two))) for two in combinations(three, 2)]
            lengths = [span.length_mm for span in found if span is not None]
            if len(lengths) == 3 and 2.0 * max(lengths) >= sum(lengths):
                raise DataError(
                    f"has distances of {lengths[0]:g}, {lengths[1]:g} and {lengths[2]:g} mm between "
                    f"{', '.join(three)}: they make no triangle.",
                    do="Measure the three again; one of them was read on another ball or with another bar.",
                    file=table.path,
                    key="length_mm",
                )
