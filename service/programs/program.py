"""A program in any dialect: targets in the order of the file, and new joints written back.

A dialect reads a file into a `RobotProgram`. Each target states what the controller makes of it: joint angles
as the controller counts them, or a pose with the branch and the turns that the program requires. Nothing here
knows a dialect; no dialect knows a model.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, NamedTuple, Protocol, TypeVar, get_args

import numpy as np

from calib.array import Array
from service.programs.text import Edit, Lines, edited

Window = tuple[float, float]
Does = Literal["drives", "displaces", "shifts", "loads", "turns"]
_P = TypeVar("_P")
TWICE = "is there more than once, and which of them counts is not known"
_NOTES = {
    "loads": "changes the payload: the correction holds for the one that is stated",
    "turns": "lets the arm take another posture than is written: the correction holds for the one that is written",
}


@dataclass(frozen=True)
class ProgramTarget:
    """One target of a program, or the reason why it cannot be read.

    Attributes
    ----------
    joints : array of shape (N,), optional
        Controller angles, rad.
    flange : array of shape (4, 4), optional
        Pose in the nominal base frame, mm, of a target without joints.
    tool : array of shape (4, 4)
        Tool point on the flange.
    branch : str, optional
        Branch of a pose target; None for the one nearest to the target before.
    windows : mapping of int to Window
        Range of the controller angle of a joint (from 0), rad, within which the controller keeps it.
    among : tuple of str
        Branches; the one that fits all windows is meant.
    larger_elbow : bool, optional
        Of two elbows, whether the one with the larger angle of joint 3 is meant, or the smaller.
    turns_written : bool
        Whether the dialect can write other turns than those read, except for those of the joints `kept`.
    refused : str
        Reason why it is not corrected, as a sentence part.
    empty : bool
        The position holds nothing yet, and stays empty.
    notes : tuple of str
        Further information for the user.
    """

    name: str
    line: int
    joints: Array | None = None
    flange: Array | None = None
    tool: Array = field(default_factory=lambda: np.eye(4))
    branch: str | None = None
    windows: Mapping[int, Window] = field(default_factory=dict)
    among: tuple[str, ...] = ()
    larger_elbow: bool | None = None
    turns_written: bool = False
    kept: frozenset[int] = frozenset()
    refused: str = ""
    empty: bool = False
    notes: tuple[str, ...] = ()

    @property
    def kind(self) -> str:
        """'joints' or 'pose'; 'empty' and 'unknown' for what cannot be read."""
        if self.empty:
            return "empty"
        return "joints" if self.joints is not None else "pose" if self.flange is not None else "unknown"


@dataclass(frozen=True)
class NewTarget:
    """The new values of a target.

    They are controller angles (N,), rad, and the flange pose (4, 4), base frame, mm.
    """

    joints: Array
    flange: Array


class RobotProgram(Protocol):
    """A program file: its text, its targets, and the edits that give one of them new values."""

    @property
    def text(self) -> str:
        """The text as read."""
        ...

    @property
    def targets(self) -> Sequence[ProgramTarget]:
        """Every target, in the order of the file."""
        ...

    def edits(self, index: int, driven: NewTarget) -> list[Edit]:
        """Return edits that write the joints to be driven into target `index`."""
        ...


class Rule(NamedTuple):
    """Effect of statements that match `pattern` in addition to the targets of a program.

    The effects are:

    - "drives": the statement drives to a target that is not read, and keeps its value.
    - "displaces": it displaces poses of the program, so that a correction would be made at a place that is not
      driven to.
    - "shifts": it displaces joint targets as well.
    - "loads": it changes the payload, for which the correction holds.
    - "turns": the controller may take a posture that is not the one written.
    """

    pattern: re.Pattern[str]
    does: Does


def rules(**words: str) -> tuple[Rule, ...]:
    """Create rules from regular expressions, by the effect of the statements."""
    return tuple(
        Rule(re.compile(words[does], re.IGNORECASE), does) for does in get_args(Does) if does in words
    )


def beside(
    found: Sequence[tuple[ProgramTarget, _P]],
    statements: Iterable[tuple[int, str]],
    known: Sequence[Rule],
    lines: Lines,
    nowhere: _P,
) -> list[tuple[ProgramTarget, _P]]:
    """Apply statements that the reader does not follow to the targets and their places.

    A statement is (position, code without comments). Each one that drives adds a refused target. If one displaces,
    every pose is refused; if one shifts, every target. A change of payload or posture adds a note.
    """
    more: list[tuple[ProgramTarget, _P]] = []
    displaced, shifted, notes = "", False, dict[str, Does]()
    for at, code in statements:
        for rule in known:
            match = rule.pattern.search(code)
            if match is None:
                continue
            line, word = lines.at(at), " ".join(match.group().split())
            if rule.does == "drives":
                why = f"'{word}' is not read here: where it drives to stays as it is"
                more.append((ProgramTarget(f"line {line}", line, refused=why), nowhere))
            elif rule.does in _NOTES:
                notes[f"'{word}' in line {line} {_NOTES[rule.does]}"] = rule.does
            else:
                shifted = shifted or rule.does == "shifts"
                displaced = displaced or (
                    f"'{word}' in line {line} displaces poses while the program runs: they are not driven to where "
                    "they are written"
                )
            break

    def left(target: ProgramTarget) -> ProgramTarget:
        about = [note for note, does in notes.items() if does == "loads" or target.flange is not None]
        target = replace(target, notes=(*target.notes, *about)) if about else target
        refuse = displaced and (shifted or target.flange is not None) and not target.refused
        return replace(target, refused=displaced) if refuse else target

    return [*((left(target), place) for target, place in found), *more]


def rewritten(program: RobotProgram, driven: Mapping[int, NewTarget]) -> str:
    """Return the program's text with new values for some targets, everything else untouched."""
    return edited(program.text, (e for i, d in driven.items() for e in program.edits(i, d)))
