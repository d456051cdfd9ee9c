"""The program, whatever its dialect: targets in the order of the file, and how new joints are written back.

A dialect reads a file into a `Program`. Each target says what the controller makes of it: joint angles as the
controller counts them, or a pose with the branch and the turns that the program asks for. Nothing here knows a
dialect; no dialect knows a model.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from calib.array import Array
from service.programs.text import Edit, edited

Window = tuple[float, float]


@dataclass(frozen=True)
class Target:
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
class Driven:
    """The new values of a target: controller angles (N,), rad, and the flange pose (4, 4), base frame, mm."""

    joints: Array
    flange: Array


class Program(Protocol):
    """A program file: its text, its targets, and the edits that give one of them new values."""

    @property
    def text(self) -> str:
        """The text as read."""
        ...

    @property
    def targets(self) -> Sequence[Target]:
        """Every target, in the order of the file."""
        ...

    def edits(self, index: int, driven: Driven) -> list[Edit]:
        """Edits that make target `index` what is to be driven."""
        ...


def rewritten(program: Program, driven: Mapping[int, Driven]) -> str:
    """The program's text with new values for some targets, everything else untouched."""
    return edited(program.text, (e for i, d in driven.items() for e in program.edits(i, d)))
