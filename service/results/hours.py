"""Hours of use: what the counters of robots showed, from a table that a person or a PLC keeps.

Between two readings of a counter the robot is taken to have been used evenly; before the first and after the last
nobody knows.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import pairwise
from pathlib import Path

from calib.errors import DataError
from calib.text import read_text, rows_of

COLUMNS = ["serial", "at", "hours"]


@dataclass(frozen=True)
class Hours:
    """Readings (time, hours) of every serial number, oldest first."""

    readings: Mapping[str, Sequence[tuple[datetime, float]]]

    def at(self, serial: str, moment: datetime) -> float | None:
        """Hours that a counter showed at a time; None where no readings are around it."""
        readings = self.readings.get(serial, ())
        for then, hours in readings:
            if then == moment:
                return hours
        for (a, before), (b, after) in pairwise(readings):
            if a < moment < b:
                return before + (after - before) * ((moment - a) / (b - a))
        return None


def read_hours(path: Path) -> Hours:
    """Read `serial,at,hours`; times as 2026-03-02 or 2026-03-02T09:15, UTC. Raises DataError naming the line."""
    rows = rows_of(read_text(path), path)
    if not rows or rows[0][1] != COLUMNS:
        raise DataError(
            f"has no columns {','.join(COLUMNS)}.", do="Name them in its first line.", file=path, line=1
        )
    found: dict[str, list[tuple[datetime, float]]] = defaultdict(list)
    for line, cells in rows[1:]:
        try:
            serial, at, hours = cells
            moment, count = datetime.fromisoformat(at), float(hours)
        except ValueError as error:
            raise DataError(
                f"is no reading of a counter ({error}).",
                do="Write e.g. 120-4711,2026-03-02,1840.",
                file=path,
                line=line,
            ) from error
        found[serial].append((moment if moment.tzinfo else moment.replace(tzinfo=UTC), count))
    return Hours({serial: sorted(readings) for serial, readings in found.items()})
