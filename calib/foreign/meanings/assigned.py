"""The state of one table while its columns are assigned: the map so far, the findings and the open questions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from calib.array import Array
from calib.errors import DataError
from calib.foreign.files.layout import Layout
from calib.foreign.files.number import Notation
from calib.foreign.map.map_file import UNDECIDED, FileMap
from calib.foreign.map.rotations import sequence_of

Answers = Mapping[str, str]
LEAVE = "leave"
Set = tuple[str, ...]


@dataclass(frozen=True)
class Question:
    """A question that the files leave open. key: what `--answer KEY=CHOICE` names; choices: the answers; proposed: the
    likeliest; evidence: whether the robot can decide it."""

    key: str
    text: str
    choices: tuple[str, ...]
    proposed: str = ""
    evidence: bool = False


@dataclass(frozen=True)
class Finding:
    """The finding about a column: what it is read as, its unit and why; `read_as` is '' for one that is left aside."""

    column: str
    read_as: str
    unit: str
    why: str


@dataclass
class Assigned:
    """A table while its columns are assigned: its map so far, the findings and the questions."""

    layout: Layout
    answers: Answers
    prefix: str = ""
    told: frozenset[str] = frozenset()  # answers that the robot gave
    notation: Notation = field(default_factory=Notation)
    columns: dict[str, str] = field(default_factory=dict)
    targets: dict[str, dict[str, str]] = field(default_factory=dict)
    rotation: str = ""
    status_ok: tuple[str, ...] = ()
    at_origin: bool | None = (
        None  # whether points at exactly 0, 0, 0 were measured there; None without such points
    )
    read_back: bool = False  # whether the joints are those that the controller read back
    found: dict[str, Finding] = field(default_factory=dict)
    questions: list[Question] = field(default_factory=list)
    keys: set[str] = field(default_factory=set)  # what may be answered

    def ask(self, question: Question) -> str:
        """The answer to a question, or `?`, and the question is open. Raises DataError for an answer that is none."""
        self.keys.add(question.key)
        answer = self.answers.get(question.key)
        if answer is None:
            self.questions.append(question)
            return UNDECIDED
        if question.choices and answer not in question.choices:
            if question.key.endswith("rotation") and sequence_of(answer) is not None:
                return answer  # any convention
            raise DataError(
                f"{question.key} = {answer!r} is none of the answers.",
                do=f"Answer with one of {', '.join(question.choices)}.",
                file=self.layout.sheet.shown,
                key=question.key,
            )
        return answer

    def reason(self, key: str) -> str:
        """The reason for which an answer is taken."""
        return "only so the robot reaches the points" if key in self.told else "as answered"

    def take(self, column: str, read_as: str, unit: str = "", why: str = "its name") -> None:
        """Note as what a column is read."""
        self.found[column] = Finding(column, read_as, unit, why)

    def aside(self, column: str, why: str) -> None:
        """Note why a column is left aside."""
        self.found.setdefault(column, Finding(column, "", "", why))

    @property
    def made(self) -> FileMap:
        """The map of the file."""
        return FileMap(
            names=self.layout.names, columns=self.columns, targets=self.targets, sheet=self.layout.sheet.name,
            separator=self.layout.sheet.separator, decimal=self.notation.decimal, thousands=self.notation.thousands,
            rotation=self.rotation, status_ok=self.status_ok,
        )  # fmt: skip

    @property
    def findings(self) -> tuple[Finding, ...]:
        """The findings of all columns, in their order."""
        return tuple(self.found[name] for name in self.layout.names if name in self.found)

    def values(self, columns: Sequence[str]) -> Array:
        """(rows, columns) of the numbers that are there."""
        cells = self.layout.cells
        rows = [[self.notation.number(cell) for cell in cells[name]] for name in columns]
        return np.array([[np.nan if v is None else v for v in row] for row in rows], dtype=np.float64).T


def occurrence(name: str) -> str:
    _, mark, number = name.rpartition("#")
    return f"#{number}" if mark and number.isdigit() else ""
