"""A robot file checked with a handful of readings: names the usual mistakes, and the lines that correct them.

The hypotheses are those with which every data set is checked before a fit (`calib.data.hypotheses`). Where no single
one explains the readings, the joints are tried in every combination of directions, with and without a coupling of two
neighbours: a controller that counts otherwise than the table seldom differs in one joint only.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import chain, product
from pathlib import Path

import numpy as np

from calib.arm import Robot
from calib.array import Array
from calib.data import Hypothesis, Meaning, explained, of_directions, of_joints, of_points, of_robot
from calib.data.hypotheses import Counting, of_rows, of_table
from calib.robot_file.draft import matrix_lines
from calib.robot_file.handful import Handful
from calib.robot_file.lines import changed_lines, theta_line
from calib.units import DEG

_MOST_RIVALS = 4
_NAME = "counted"


@dataclass(frozen=True)
class Mistake:
    """A mistake that explains the readings: what is wrong, and the corrected lines."""

    what: str
    lines: tuple[str, ...]


@dataclass(frozen=True)
class Verdict:
    """The verdict of a handful of readings on a robot file.

    mistakes: the likeliest first, none where the file explains the readings or nothing does. miss_mm: distance within
    which the nominal robot, in its best place, comes to three quarters of the readings; left_mm: the same with the
    mistake mended; extent_mm: of the readings.
    """

    readings: int
    mistakes: tuple[Mistake, ...]
    miss_mm: float
    left_mm: float
    extent_mm: float
    tool_unknown: bool

    @property
    def explained(self) -> bool:
        """Whether the file as it is explains the readings."""
        return not self.mistakes and self.miss_mm < 0.02 * self.extent_mm


def held_against(path: Path, text: str, handful: Handful) -> Verdict:
    """The verdict of readings on the robot file `path` with the text `text`."""
    meaning, robot = handful.meaning, handful.meaning.robot
    options = {"tool_unknown": handful.tool_unknown, "zero_unknown": False}
    miss, extent = meaning.miss(handful.tools, **options)

    def single() -> Iterator[Hypothesis]:
        return chain(
            of_table(meaning),
            of_joints(meaning),
            of_points(meaning),
            of_directions(meaning),
            of_rows(handful.everything, handful.rows, handful.usable),
            (
                each
                for each in of_robot(meaning)
                if each.meaning.robot.name != robot.name or each.key != "robot"
            ),
        )

    why = explained(meaning, single, handful.tools, **options)
    why = why or explained(meaning, lambda: of_counting(meaning), handful.tools, **options)
    if why is None:
        return Verdict(len(handful.rows), (), miss, miss, extent, handful.tool_unknown)
    # The user's own file before another robot that the readings fit as well
    causes = sorted(
        (why.cause, *why.equals, *why.rivals),
        key=lambda each: each.what.startswith("the readings are not of"),
    )
    mistakes = tuple(
        Mistake(each.what, tuple(lines_of(each, meaning, path, text)))
        for each in causes[: 1 + max(_MOST_RIVALS, len(why.equals))]
    )
    return Verdict(len(handful.rows), mistakes, why.miss, why.left, extent, handful.tool_unknown)


def of_counting(meaning: Meaning) -> Iterator[Hypothesis]:
    """Several joints turn in the other direction, with or without a coupling of joints 2 and 3."""
    last = meaning.angles.shape[1]
    couplings: list[tuple[float, str]] = [(0.0, "")]
    if last > 2:
        couplings += [
            (1.0, "joint 3 is coupled with joint 2 (+)"),
            (-1.0, "joint 3 is coupled with joint 2 (-)"),
        ]
    for signs in product((1.0, -1.0), repeat=last):
        for share, words in couplings:
            matrix = np.diag(signs)
            if share:
                matrix[2, 1] = share
            turned = [str(k) for k, sign in enumerate(signs, start=1) if sign < 0.0]
            said = [words] * bool(words) + [f"joints {', '.join(turned)} turn in the other direction"] * bool(
                turned
            )
            if len(said) < 1 or (not words and len(turned) == 1):
                continue
            counting = Counting(matrix, np.zeros(last))
            yield Hypothesis(
                f"the controller counts otherwise than the table: {' and '.join(said)}",
                "Use a joint matrix.",
                "header",
                "joint_coupling",
                counting.of(meaning),
                counting,
            )


def lines_of(cause: Hypothesis, meaning: Meaning, path: Path, text: str) -> Iterator[str]:
    """The lines to change, with their numbers, and their new text: of the robot file, or of the data."""
    robot, other = meaning.robot, cause.meaning.robot
    counting = cause.counting
    if other.name != robot.name or (counting is None and other == robot):
        yield cause.do
        return
    if counting is None:
        yield from changed_lines(path, text, robot, other)
        return
    shifted = np.flatnonzero(counting.offset)
    if len(shifted) == 1 and meaning.coupling == "none":
        k = int(shifted[0])
        yield theta_line(path, text, k, (robot.theta[k] + counting.offset[k]) / DEG)
        yield f"or in the data: {cause.do}"
        return
    yield f"{path.name}: add"
    matrix, offset = _combined(robot, meaning.coupling, counting)
    units = robot.joint_units
    shown = matrix * units[None, :] / units[:, None]
    slides = [unit == "mm" for unit in robot.units]
    yield from (f"    {line}" for line in matrix_lines(_NAME, shown, offset / units, slides))
    yield f'and in the header of the data and the cell file: joint_coupling = "{_NAME}"'
    if len(np.flatnonzero(matrix - np.eye(len(matrix)))) == 1:
        yield f"or in the data: {cause.do}"


def _combined(robot: Robot, coupling: str, counting: Counting) -> tuple[Array, Array]:
    """The joint matrix and offset, rad and mm, that count first as `counting` and then as `coupling`."""
    if coupling == "none":
        return counting.matrix, counting.offset
    before = robot.joint_matrices[coupling]
    matrix = np.array(before.matrix)
    return matrix @ counting.matrix, matrix @ counting.offset + np.array(before.offset)
