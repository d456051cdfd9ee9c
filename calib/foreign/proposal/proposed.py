"""Proposal of a map, with the findings about its columns and the open questions."""

from __future__ import annotations

from dataclasses import dataclass

from calib.foreign.files.layout import Layout
from calib.foreign.map.map_file import Map
from calib.foreign.meanings.assigned import ColumnFinding, ColumnQuestion


@dataclass(frozen=True)
class TableProposal:
    """A table of the proposal, with the findings about its columns."""

    layout: Layout
    findings: tuple[ColumnFinding, ...]


@dataclass(frozen=True)
class MapProposal:
    """A proposed map, complete or with open questions.

    Attributes
    ----------
    questions : tuple of ColumnQuestion
        Open questions.
    missing : tuple of str
        Information that no file holds.
    said : tuple of str
        Remarks on how the files were read.
    keys : frozenset of str
        Keys of everything that may be answered.
    """

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
