"""Check of a robot file with a few readings: usual mistakes and corrected lines.

The hypotheses are those with which every data set is checked before a fit (`calib.data.hypotheses`). If
no single one explains the readings, the joints are tried in every combination of directions, with and
without a coupling of two neighbours. A controller that counts differently from the table seldom differs
in one joint only. A message names the line of the robot file to change.

The check readings are joints, points, and the measured tool targets. A data set has a header in the same
folder. Only its tool targets and joint matrix are used, since the other values do not matter before a
fit. Without a header, or if it frees the tool, they are unknown and follow from the readings.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import chain, product
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calib.arm import Robot
from calib.array import Array
from calib.data import (
    FEWEST_MEANT,
    Hypothesis,
    InterpretedReadings,
    explained,
    of_directions,
    of_joints,
    of_points,
    of_robot,
)
from calib.data.hypotheses import JointCounting, of_rows, of_table
from calib.errors import DataError
from calib.robot_file.draft import matrix_lines
from calib.text import TextTable, TomlTable, read_toml
from calib.units import DEG

_MOST_RIVALS = 4
_NAME = "counted"
_MOST = 8
_NUMBERS = (("alpha", "alpha_deg", DEG), ("a", "a_mm", 1.0), ("theta", "theta_deg", DEG), ("d", "d_mm", 1.0))
_POINT = ("x_mm", "y_mm", "z_mm")
_HANDFUL_MOST = 300
_ACCEPTED = ("", "ok")


@dataclass(frozen=True)
class RobotFileMistake:
    """A mistake that explains the readings, and the corrected lines."""

    what: str
    lines: tuple[str, ...]


@dataclass(frozen=True)
class RobotFileVerdict:
    """Verdict of the check readings on a robot file.

    Attributes
    ----------
    mistakes : tuple of RobotFileMistake
        The likeliest first; empty if the file explains the readings, or if no mistake does.
    miss_mm : float
        Distance within which the nominal robot, in its best place, comes to three quarters of the readings.
    left_mm : float
        The same with the mistake corrected.
    extent_mm : float
        Extent of the readings.
    """

    readings: int
    mistakes: tuple[RobotFileMistake, ...]
    miss_mm: float
    left_mm: float
    extent_mm: float
    tool_unknown: bool

    @property
    def explained(self) -> bool:
        """Whether the file as it is explains the readings."""
        return not self.mistakes and self.miss_mm < 0.02 * self.extent_mm


def held_against(path: Path, text: str, handful: CheckReadings) -> RobotFileVerdict:
    """Judge the robot file `path` with the text `text` by readings."""
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
        return RobotFileVerdict(len(handful.rows), (), miss, miss, extent, handful.tool_unknown)
    # The user's own file before another robot that the readings fit as well
    causes = sorted(
        (why.cause, *why.equals, *why.rivals),
        key=lambda each: each.what.startswith("the readings are not of"),
    )
    mistakes = tuple(
        RobotFileMistake(each.what, tuple(lines_of(each, meaning, path, text)))
        for each in causes[: 1 + max(_MOST_RIVALS, len(why.equals))]
    )
    return RobotFileVerdict(len(handful.rows), mistakes, why.miss, why.left, extent, handful.tool_unknown)


def of_counting(meaning: InterpretedReadings) -> Iterator[Hypothesis]:
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
            counting = JointCounting(matrix, np.zeros(last))
            yield Hypothesis(
                f"the controller counts otherwise than the table: {' and '.join(said)}",
                "Use a joint matrix.",
                "header",
                "joint_coupling",
                counting.of(meaning),
                counting,
            )


def lines_of(cause: Hypothesis, meaning: InterpretedReadings, path: Path, text: str) -> Iterator[str]:
    """Yield the lines to change, with their numbers and their new text.

    They are lines of the robot file, or of the data.
    """
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


def _combined(robot: Robot, coupling: str, counting: JointCounting) -> tuple[Array, Array]:
    """Combine the joint matrix and offset of `counting` with those of `coupling`, rad and mm.

    `counting` is applied first.
    """
    if coupling == "none":
        return counting.matrix, counting.offset
    before = robot.joint_matrices[coupling]
    matrix = np.array(before.matrix)
    return matrix @ counting.matrix, matrix @ counting.offset + np.array(before.offset)


def line_of(text: str, key: str, link: int | None = None) -> int | None:
    """Find the line number, from 1, of `key` in the `link`-th [[link]], or above all tables.

    `link` is 1-based. Returns None if the file is written differently.
    """
    at, inside = 0, link is None
    for number, line in enumerate(text.splitlines(), start=1):
        if re.match(r"\s*\[", line):
            at += bool(re.match(r"\s*\[\[\s*link\s*\]\]", line))
            inside = link is not None and at == link and bool(re.match(r"\s*\[\[\s*link\s*\]\]", line))
        elif inside and re.match(rf"\s*{key}\s*=", line):
            return number
    return None


def changed_lines(path: Path, text: str, robot: Robot, other: Robot) -> Iterator[str]:
    """Yield the lines that turn `robot` into `other`, with its convention and its DH numbers."""
    if other.convention != robot.convention:
        yield f'{_place(path, line_of(text, "convention"))}: convention = "{other.convention}"'
    changes = [
        f"{_place(path, line_of(text, key, k + 1))}: {key} = {_number(new[k] / unit)}   (link {k + 1}, now "
        f"{_number(old[k] / unit)})"
        for k in range(robot.joints)
        for name, key, unit in _NUMBERS
        if (old := getattr(robot, name)) and (new := getattr(other, name)) and old[k] != new[k]
    ]
    yield from changes[:_MOST]
    if len(changes) > _MOST:
        yield f"and {len(changes) - _MOST} more lines in the same way"


def theta_line(path: Path, text: str, k: int, theta_deg: float) -> str:
    """Write the line with theta_deg of link k (0-based), at its new value, from -180 to 180."""
    value = (theta_deg + 180.0) % 360.0 - 180.0
    shown = 180.0 if abs(value + 180.0) < 1e-9 else value
    return f"{_place(path, line_of(text, 'theta_deg', k + 1))}: theta_deg = {_number(shown)}   (link {k + 1})"


def _place(path: Path, line: int | None) -> str:
    return path.name if line is None else f"{path.name}, line {line}"


def _number(value: float) -> str:
    return repr(round(float(value), 9) + 0.0)


@dataclass(frozen=True)
class CheckReadings:
    """Readings with which a robot file is checked.

    Attributes
    ----------
    everything : InterpretedReadings
        All rows as the files have them.
    rows : array of int, shape (n,)
        Usable rows of `everything`.
    tools : array of shape (T, 3)
        Tool targets, mm.
    """

    everything: InterpretedReadings
    rows: NDArray[np.int64]
    usable: NDArray[np.bool_]
    tools: Array
    tool_unknown: bool

    @property
    def meaning(self) -> InterpretedReadings:
        """The usable readings."""
        whole, rows = self.everything, self.rows
        assert whole.points is not None
        return InterpretedReadings(
            whole.robot, whole.coupling, whole.angles[rows], whole.which[rows], whole.points[rows]
        )


def read_handful(robot: Robot, data: Path, coupling: str | None = None) -> CheckReadings:
    """Read the check readings of DATA.csv with the joints of `robot`.

    Raises
    ------
    DataError
        A column or key is missing or wrong; the error names it.
    """
    table = TextTable.read(data)
    for name in (*robot.joint_columns, *_POINT):
        table.require(name, "A check needs the joints of the robot file and a measured point in every row.")
    header = _header(data.with_suffix(".toml"))
    coupling = coupling or ("none" if header is None else header.text("joint_coupling", "none"))
    if coupling != "none" and coupling not in robot.joint_matrices:
        raise DataError(
            f"is '{coupling}', which the robot file does not have.",
            do=f"Use one of {', '.join(('none', *robot.joint_matrices))}.",
            file=data.with_suffix(".toml"),
            key="joint_coupling",
        )
    names, which = np.unique(table.text("tool_target", "T1"), return_inverse=True)
    known = {} if header is None else header.vectors("tool_targets")
    listed = [str(name) for name in names]
    if header is not None and len(known) == 1 and listed == ["T1"]:
        listed = list(known)  # the only one of the header needs no column
    points = np.column_stack([table.numbers(name) for name in _POINT])
    angles = np.column_stack([table.numbers(name) for name in robot.joint_columns]) * robot.joint_units
    usable = np.isfinite(points).all(axis=1) & np.isfinite(angles).all(axis=1)
    usable &= np.isin(table.text("status"), _ACCEPTED)
    usable &= table.text("series", "main") == table.text("series", "main")[0]
    rows = np.flatnonzero(usable)
    if len(rows) < FEWEST_MEANT:
        raise DataError(
            f"has {len(rows)} readings of one series with joints and a point.",
            do=f"Give {FEWEST_MEANT} or more; 20 over the whole range of every joint are a good number.",
            file=data,
        )
    fitted = header is not None and "tool" in (header.table("model").names("fit") or ())
    return CheckReadings(
        everything=InterpretedReadings(robot, coupling, angles, which.astype(np.int64), points),
        rows=rows[:: -(-len(rows) // _HANDFUL_MOST)],
        usable=usable,
        tools=np.array([known.get(name, (0.0, 0.0, 0.0)) for name in listed]),
        tool_unknown=fitted or not all(name in known for name in listed),
    )


def _header(path: Path) -> TomlTable | None:
    return TomlTable(read_toml(path)[1], path) if path.is_file() else None
