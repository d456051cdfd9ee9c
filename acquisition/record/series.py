"""The series of several data sets brought into one: a pair of one robot and one instrument each.

The robot of a data set is one, because its errors are its own: another one is refused unless somebody accepts it. The
instrument may be another one. Where a device does not report who it is, it is taken for the one of the first data set.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

from acquisition.errors import OtherIndividual
from acquisition.record.individuals import (
    ROLES,
    Acceptance,
    Individual,
    header_table,
    individual_of,
    series_of,
)

Pair = dict[str, Individual]  # by role; what is not known is left out


class SeriesOfSets:
    """The series of the data sets joined so far, from their headers. `accepted`: another robot than the first's."""

    def __init__(self, header: Mapping[str, Any], name: str, accepted: Acceptance | None) -> None:
        self._first, self._accepted = name, accepted
        self._pairs = _pairs_of(header)
        self._names: dict[str, str] = {}  # of series: in the data set joined last -> in the whole

    def join(self, header: Mapping[str, Any], name: str) -> None:
        """Add a data set. Raises OtherIndividual."""
        first = next(iter(self._pairs.values()))
        self._names = {}
        for own, pair in _pairs_of(header).items():
            whole = dict(first)
            for role, each in pair.items():
                first.setdefault(role, each)  # what the first does not report, a later one does
                whole[role] = self._known(role, each) or self._new(role, each, name)
            known = (known for known, devices in self._pairs.items() if devices == whole)
            self._names[own] = next(known, series_of(*map(whole.get, ROLES)))
            self._pairs.setdefault(self._names[own], whole)

    def named(self, header: Mapping[str, Any], rows: Sequence[Mapping[str, str]]) -> list[dict[str, str]]:
        """Rows of the data set that was joined last, each with its series."""
        alone = next(iter(_pairs_of(header)))
        own = [row.get("series") or alone for row in rows]
        return [{**row, "series": self._names.get(name, name)} for row, name in zip(rows, own, strict=True)]

    @property
    def header(self) -> dict[str, Any]:
        """The table of the series in the header of the whole."""
        tables = [header_table(each, name) for name, pair in self._pairs.items() for each in pair.values()]
        return {"device": tables} if tables else {}

    def _known(self, role: str, each: Individual) -> Individual | None:
        known = (pair[role] for pair in self._pairs.values() if role in pair)
        return next((one for one in known if not one.is_other_than(each)), None)

    def _new(self, role: str, each: Individual, name: str) -> Individual:
        """A device that is not among those known; a robot must be accepted."""
        if role != "robot":
            return each
        if self._accepted is None or not self._accepted.names(each):
            first = next(iter(self._pairs.values()))["robot"]
            raise OtherIndividual(f"{name}: was measured with {each}, {self._first} with {first}")
        leave = {"accepted_by": self._accepted.by, "reason": self._accepted.reason}
        return Individual(**asdict(each) | leave)


def _pairs_of(header: Mapping[str, Any]) -> dict[str, Pair]:
    """The devices of every series; one series without any where the header names none."""
    pairs: dict[str, Pair] = {}
    for table in header.get("device", ()):
        each = individual_of(table)
        pairs.setdefault(str(table["series"]), {})[each.role] = each
    return pairs or {series_of(None, None): {}}
