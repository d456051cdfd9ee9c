"""A proposal: a map as far as it can be made, with what was found in which column and what is open."""

from __future__ import annotations

from dataclasses import dataclass

from calib.foreign.files.layout import Layout
from calib.foreign.map.map_file import Map
from calib.foreign.meanings.assigned import ColumnFinding, ColumnQuestion


@dataclass(frozen=True)
class TableProposal:
    """A table of the proposal. findings: of its columns."""

    layout: Layout
    findings: tuple[ColumnFinding, ...]


@dataclass(frozen=True)
class MapProposal:
    """A map as far as it can be made. questions: open ones; missing: what no file holds; said: what was made of the
    files; keys: of everything that may be answered."""

    made: Map
    parts: tuple[TableProposal, ...]
    questions: tuple[ColumnQuestion, ...]
    missing: tuple[str, ...]
    said: tuple[str, ...]
    keys: frozenset[str]

    @property
    def layouts(self) -> tuple[Layout, ...]:
        """The tables in the order of the map."""
        return tuple(part.layout for part in self.parts)

    @property
    def complete(self) -> bool:
        """Whether the map can be used."""
        return not self.questions and not self.missing
