"""One table while its columns are assigned: map, findings and open questions.

The module also assigns columns of words and conditions: names of poses and targets, time, temperature,
status, set.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from calib.array import Array
from calib.errors import DataError
from calib.foreign.files.layout import Layout
from calib.foreign.files.number import Notation, is_number, seconds_of
from calib.foreign.map.map_file import UNDECIDED, FileMap, sequence_of
from calib.foreign.meanings.words import ColumnMeaning

Answers = Mapping[str, str]
LEAVE = "leave"
Set = tuple[str, ...]

_GOOD = {
    "ok",
    "valid",
    "good",
    "gültig",
    "gueltig",
    "gut",
    "1",
    "true",
    "yes",
    "ja",
    "io",
    "i.o.",
    "pass",
    "measured",
    "gemessen",
}

_BAD = {"nok", "invalid", "bad", "ungültig", "0", "false", "no", "nein", "nio", "n.i.o.", "lost", "fail", "failed",
"error",
        "rejected", "not measured", "fehler"}  # fmt: skip

_OTHER_DEGREES = re.compile(r"(?:[\[(_\s/°]|deg)(?:f|k|fahrenheit|kelvin)\b", re.IGNORECASE)
_OF_COLUMN = re.compile(r"\s*(?:\d\.)?column\.")
_WARMEST_C = 60.0  # air temperature at which no one calibrates
_SETS = {"calibration", "reference", "repeat", "validation"}


def answers_of(texts: Sequence[str], where: str) -> dict[str, str]:
    """Return answers `KEY=CHOICE` by key.

    Parameters
    ----------
    texts : sequence of str
        The answers. `column.NAME=CHOICE` is divided at its last `=`, which a name may hold, others at the first.
    where : str
        Option or field that held them, for the error.

    Raises
    ------
    DataError
        A text is no answer.
    """
    out = {}
    for text in texts:
        key, mark, choice = text.rpartition("=") if _OF_COLUMN.match(text) else text.partition("=")
        if not mark or not key.strip() or not choice.strip():
            raise DataError(f"{text!r} is not an answer.", do="Write KEY=CHOICE.", file=where)
        out[key.strip()] = choice.strip()
    return out


@dataclass(frozen=True)
class ColumnQuestion:
    """A question that the files do not answer.

    Attributes
    ----------
    key : str
        Name in `--answer KEY=CHOICE`.
    choices : tuple of str
        Possible answers.
    proposed : str
        The likeliest answer.
    evidence : bool
        Whether the nominal robot can decide the question.
    """

    key: str
    text: str
    choices: tuple[str, ...]
    proposed: str = ""
    evidence: bool = False


@dataclass(frozen=True)
class ColumnFinding:
    """Meaning and unit of a column, with the reason.

    `read_as` is the meaning, '' if the column is left out.
    """

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
    found: dict[str, ColumnFinding] = field(default_factory=dict)
    questions: list[ColumnQuestion] = field(default_factory=list)
    keys: set[str] = field(default_factory=set)  # what may be answered
    choices: tuple[str, ...] = ()  # what a column may be stated to be
    lacking: list[str] = field(default_factory=list)  # quantities that no column is, after such statements

    def ask(self, question: ColumnQuestion) -> str:
        """Return the answer to a question; if there is none, add it to the open ones and return `?`.

        Raises
        ------
        DataError
            The answer is none of the choices.
        """
        self.keys.add(question.key)
        answer = self.answers.get(question.key)
        if answer is None:
            self.questions.append(question)
            return UNDECIDED
        if question.choices and answer not in question.choices:
            if question.key.endswith("rotation") and sequence_of(answer) is not None:
                return answer  # any convention
            raise DataError(
                f"{question.key} = {answer!r} is not one of the answers.",
                do=f"Answer with one of {', '.join(question.choices)}.",
                file=self.layout.sheet.shown,
                key=question.key,
            )
        return answer

    def reason(self, key: str) -> str:
        """Return the reason for which an answer is taken."""
        return "only so the robot reaches the points" if key in self.told else "as answered"

    def take(self, column: str, read_as: str, unit: str = "", why: str = "its name") -> None:
        """Record the meaning of a column."""
        self.found[column] = ColumnFinding(column, read_as, unit, why)

    def aside(self, column: str, why: str) -> None:
        """Note why a column is left aside."""
        self.found.setdefault(column, ColumnFinding(column, "", "", why))

    @property
    def made(self) -> FileMap:
        """The map of the file."""
        return FileMap(
            names=self.layout.names, columns=self.columns, targets=self.targets, sheet=self.layout.sheet.name,
            separator=self.layout.sheet.separator, decimal=self.notation.decimal, thousands=self.notation.thousands,
            rotation=self.rotation, status_ok=self.status_ok,
        )  # fmt: skip

    @property
    def findings(self) -> tuple[ColumnFinding, ...]:
        """The findings of all columns, in their order."""
        return tuple(self.found[name] for name in self.layout.names if name in self.found)

    def values(self, columns: Sequence[str]) -> Array:
        """Parse the numbers of columns, shape (rows, columns); NaN if a cell has no number."""
        cells = self.layout.cells
        rows = [[self.notation.number(cell) for cell in cells[name]] for name in columns]
        return np.array([[np.nan if v is None else v for v in row] for row in rows], dtype=np.float64).T


def occurrence(name: str) -> str:
    _, mark, number = name.rpartition("#")
    return f"#{number}" if mark and number.isdigit() else ""


def names_of_rows(to: Assigned, meanings: Mapping[str, ColumnMeaning]) -> None:
    cells = to.layout.cells
    for name, meaning in meanings.items():
        if name in to.found or not any(cells[name]):
            continue
        kind, filled = meaning.kind, [cell for cell in cells[name] if cell]
        if kind in ("id", "target") and any(is_number(cell) and not cell.isdecimal() for cell in filled):
            continue  # measured numbers are no names
        if kind == "time" and "time" not in to.columns:
            _time(to, name, meaning, filled)
        elif kind == "temperature" and "t_air" not in to.columns and np.isfinite(to.values([name])).all():
            if _OTHER_DEGREES.search(name) or np.max(np.abs(to.values([name]))) > _WARMEST_C:
                to.aside(
                    name,
                    "a temperature that is not in degC as its name or its numbers show: convert it first",
                )
                continue
            to.columns["t_air"] = f"{name}[c]"
            to.take(name, "temperature of the air", "c")
        elif (
            kind == "target"
            and "target" not in to.columns
            and not to.targets
            and len(filled) == len(cells[name])
        ):
            to.columns["target"] = name
            to.take(name, "target")
        elif kind == "set" and set(filled) <= _SETS:
            to.columns["set"] = name
            to.take(name, "set")
        elif kind == "status":
            _status(to, name)
        elif kind in ("series", "waypoint", "visit") and kind not in to.columns:
            to.columns[kind] = name
            to.take(name, kind)
        elif kind == "id" and len(filled) == len(cells[name]):
            unique = len(set(filled)) == len(filled)
            key = "id" if unique and "id" not in to.columns else "pose"
            if key not in to.columns:
                to.columns[key] = name
                to.take(name, "name of the reading" if key == "id" else "name of the pose")


def _time(to: Assigned, name: str, meaning: ColumnMeaning, filled: Sequence[str]) -> None:
    if all(seconds_of(cell) is not None for cell in filled) and len(filled) == len(to.layout.rows):
        to.columns["time"] = f"{name}[date]"
        to.take(name, "time", "date", "its cells are dates with a time of day")
    elif np.isfinite(to.values([name])).all() and meaning.unit in ("s", "ms", "us", "min"):
        to.columns["time"] = f"{name}[{meaning.unit}]"
        to.take(name, "time", meaning.unit)
    elif np.isfinite(to.values([name])).all() and (
        of := dict(zip(to.layout.names, to.layout.units, strict=False)).get(name)
    ):
        to.columns["time"] = f"{name}[{of}]"
        to.take(name, "time", of, "the row of units")
    else:
        to.aside(name, 'a time without unit or date; a map may name it: time = "...[s]"')


def _status(to: Assigned, name: str) -> None:
    words = dict.fromkeys(cell for cell in to.layout.cells[name])
    good = [word for word in words if word.lower() in _GOOD]
    unknown = [word for word in words if word.lower() not in _GOOD | _BAD]
    if unknown and not (unknown == [""] and not good):
        shown = ", ".join(f"'{word}'" for word in list(words)[:8])
        text = (
            f"Column '{name}' holds {shown}. Which of these mean that a reading counts "
            "(with commas between; 'all' to leave the column aside)?"
        )
        answer = to.ask(ColumnQuestion(f"{to.prefix}status", text, ()))
        if answer == "all":
            to.aside(name, "as answered")
            return
        good = [word.strip() for word in answer.split(",")]
        if answer == UNDECIDED:
            to.columns["status"] = UNDECIDED
            return
    elif unknown:  # empty where nothing was wrong
        good = [""]
    to.columns["status"] = name
    to.status_ok = tuple(word for word in good if word)
    to.take(name, "status", "", f"counts where it is {' or '.join(map(repr, good))}")
