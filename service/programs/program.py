"""The program, whatever its dialect: targets in the order of the file, and how new joints are written back.

A dialect reads a file into a `RobotProgram`. Each target says what the controller makes of it: joint angles as the
controller counts them, or a pose with the branch and the turns that the program asks for. Nothing here knows a
dialect; no dialect knows a model.
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
    """One target of a program, or why it cannot be read.

    joints: (N,) controller angles, rad; or flange: (4, 4) in the nominal base frame, mm. tool: (4, 4) tool point on
    the flange. branch: of a pose target, None for the one nearest to the target before. windows: joint (from 0) ->
    range of its controller angle, rad, within which the controller keeps it; among: branches of which the one that
    fits all windows is meant, and of two elbows the one with the larger angle of joint 3 where `larger_elbow` says
    so, the smaller where it is False; turns_written: whether the dialect can write other turns than those read, but
    for those of the joints `kept`. refused: why it is not corrected, as a sentence part. empty: the position holds
    nothing yet and stays so. notes: what to know beside it.
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
    """The new values of a target: controller angles (N,), rad, and the flange pose (4, 4), base frame, mm."""

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
        """Edits that make target `index` what is to be driven."""
        ...


class Rule(NamedTuple):
    """What statements that match `pattern` do beside the targets of a program.

    drives: to a target that is not read, and stays as it is; displaces: poses of the program, so that a correction
    would be made at a place that is not driven to; shifts: joint targets as well; loads: they change the payload, for
    which the correction counts; turns: the controller may take a posture that is not the one written.
    """

    pattern: re.Pattern[str]
    does: Does


def rules(**words: str) -> tuple[Rule, ...]:
    """Rules from regular expressions, by what the statements do."""
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
    """Targets with their places, as the statements (position, code without comments) that the reader does not follow
    leave them: one more, refused, for each that drives; every pose refused where one displaces, and every target where
    one shifts; a note where one changes the payload or the posture."""
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
    """The program's text with new values for some targets, everything else untouched."""
    return edited(program.text, (e for i, d in driven.items() for e in program.edits(i, d)))
