"""Target tables (.csv) of joints or poses.

The columns are `target_id, j1_deg...`, or `target_id, x_mm, y_mm, z_mm, rot_w...rot_z, config`.

A row holds joints, as the controller counts them, `j3_mm` of a slide and `e1_mm` of a track. Or it holds a pose
of the tool point in the base frame with its branch (`front/up/noflip`; `right` of a SCARA). Other columns are
kept. Cells that a spreadsheet would compute are written as text (`without_formulas`) and read as they were
meant.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from calib.arm import Robot
from calib.array import Array
from calib.compensate import inverse_poses
from calib.errors import DataError
from calib.text import LONGEST_LINE, MOST_COLUMNS, meant_by, no_formula, other_mark
from service.programs import frames
from service.programs.frames import UNNAMED, KnownFrames
from service.programs.program import NewTarget, ProgramTarget
from service.programs.text import Edit, decimal, edited

PLACES = 9

_AXIS = re.compile(r"([je]\d{1,9})(?:_(deg|mm))?")
_EXTERNAL = re.compile(r"e\d{1,9}_(?:deg|mm)")
_QUOTED = re.compile(r'"(?:[^"]|"")*+"(?=,|$)')
_POSITION = ("x_mm", "y_mm", "z_mm")
_QUATERNION = ("rot_w", "rot_x", "rot_y", "rot_z")


class _Cell(NamedTuple):
    start: int
    end: int
    text: str


class TargetTable:
    """A table of targets for a robot.

    Raises
    ------
    DataError
        The table is wrong; the message names line and column.
    """

    def __init__(self, text: str, file: str, robot: Robot, known: KnownFrames) -> None:
        self.text = text
        self._file = file
        self._robot, self._known = robot, known
        self._tool = known.tools.get(UNNAMED, np.eye(4))
        self._joints = robot.joint_columns
        rows = self._rows()
        if not rows:
            raise self._refuse("is empty.", "Give a header row.", 1)
        header = [cell.text for cell in rows[0][1]]
        self._check_header(header)
        found = [self._row(line, header, cells) for line, cells in rows[1:]]
        self.targets: Sequence[ProgramTarget] = tuple(target for target, _ in found)
        self._cells = tuple(cells for _, cells in found)
        seen: set[str] = set()
        for target in self.targets:
            if target.name in seen:
                raise self._refuse(
                    f"target '{target.name}' is there twice.", "Give every target its own id.", target.line
                )
            seen.add(target.name)

    def edits(self, index: int, driven: NewTarget) -> list[Edit]:
        """Return edits of the cells that differ."""
        target, cells = self.targets[index], self._cells[index]
        if target.joints is not None:
            values = dict(zip(self._joints, driven.joints / self._robot.joint_units, strict=True))
        else:
            pose = driven.flange @ target.tool
            old = [float(cells[name].text) for name in _QUATERNION]
            values = dict(zip(_POSITION, pose[:3, 3], strict=True))
            values |= dict(zip(_QUATERNION, frames.quaternion(pose, old), strict=True))
        return [
            Edit(cells[name].start, cells[name].end, decimal(float(value), PLACES))
            for name, value in values.items()
            if abs(float(cells[name].text) - value) > 0.5 * 10.0**-PLACES
        ]

    def _rows(self) -> list[tuple[int, list[_Cell]]]:
        """Line number and cells of every line that is not blank."""
        out = []
        for number, begin, bare in _lines(self.text):
            if len(bare) > LONGEST_LINE:
                raise self._refuse(f"has {len(bare)} characters.", f"Give at most {LONGEST_LINE}.", number)
            if bare.strip():
                out.append((number, _cells(bare, begin)))
                if len(out[-1][1]) > MOST_COLUMNS:
                    raise self._refuse("has too many columns.", f"Give at most {MOST_COLUMNS}.", number)
        return out

    def _check_header(self, header: list[str]) -> None:
        if (other := other_mark(header)) is not None:
            raise self._refuse(
                f"is separated by {other}.", "Save it with commas between the cells and decimal points.", 1
            )
        if "target_id" not in header:
            raise self._refuse("column 'target_id' is missing.", "Add it.", 1)
        for name in header:
            if header.count(name) > 1:
                raise self._refuse(f"column '{name}' is there twice.", "Remove one.", 1)
            self._check_joint(name)
        first = self._joints[0]
        if not {*self._joints, "x_mm"} & {*header}:
            raise self._refuse("has neither joint angles nor poses.", f"Add {first}... or x_mm...", 1)
        for group in (self._joints, (*_POSITION, *_QUATERNION, "config")):
            if any(name in header for name in group):
                for name in group:
                    if name not in header:
                        raise self._refuse(f"column '{name}' is missing.", "Add it.", 1)

    def _check_joint(self, name: str) -> None:
        """Refuse a column of a joint that the robot lacks, or in a wrong unit.

        Raises
        ------
        DataError
            The column is refused.
        """
        found = _AXIS.fullmatch(name)
        if found is None:
            return
        axis, unit = found.groups()
        if axis in self._robot.axes:
            column = self._joints[self._robot.axes.index(axis)]
            if unit is None:
                raise self._refuse(f"column '{name}' has no unit.", f"Name it {column}.", 1)
            if name != column:
                does = "slides" if column.endswith("_mm") else "turns"
                raise self._refuse(f"column '{name}': this joint {does}.", f"Give {column}.", 1)
        elif axis.startswith("j"):
            count = sum(each.startswith("j") for each in self._robot.axes)
            raise self._refuse(
                f"column '{name}': the robot has {count} joints.", "Use the model of this robot.", 1
            )

    def _row(
        self, line: int, header: list[str], cells: list[_Cell]
    ) -> tuple[ProgramTarget, dict[str, _Cell]]:
        if len(cells) != len(header):
            raise self._refuse(f"has {len(cells)} cells, the header {len(header)}.", "Correct the row.", line)
        row = dict(zip(header, cells, strict=True))
        target = ProgramTarget(meant_by(row["target_id"].text), line)
        if not target.name:
            raise self._refuse("column 'target_id' is empty.", "Give every target an id.", line)
        others = [name for name in header if _EXTERNAL.fullmatch(name) and name not in self._joints]
        try:
            notes = self._known.note_external(used=any(row[name].text for name in others))
        except ValueError as error:
            return replace(target, refused=str(error)), row
        target = replace(target, notes=notes)
        first = self._joints[0]
        if first in row and row[first].text:
            if "x_mm" in row and row["x_mm"].text:
                return replace(
                    target, refused="has joints and a pose: leave the cells of one of them empty"
                ), row
            joints = np.array(self._numbers(row, self._joints, line)) * self._robot.joint_units
            try:
                joints = frames.joint_positions(joints, self._robot.kinds)
                return replace(target, joints=joints, tool=self._tool), row
            except ValueError as error:
                return replace(target, refused=str(error)), row
        if "x_mm" not in row:
            raise self._refuse(f"column '{first}' is empty.", "Give the joints of every target.", line)
        branch = row["config"].text
        position, rotation = self._numbers(row, _POSITION, line), self._numbers(row, _QUATERNION, line)
        try:
            pose = frames.of_quaternion(position, rotation)
        except ValueError as error:
            return replace(target, refused=str(error)), row
        flange: Array = pose @ inverse_poses(self._tool)
        return replace(target, flange=flange, tool=self._tool, branch=branch), row

    def _numbers(self, row: dict[str, _Cell], names: Sequence[str], line: int) -> list[float]:
        out = []
        for name in names:
            try:
                out.append(float(row[name].text))
            except ValueError:
                out.append(math.nan)
            if not math.isfinite(out[-1]):
                raise self._refuse(f"column '{name}' is '{row[name].text}'.", "Write a number.", line)
        return out

    def _refuse(self, what: str, do: str, line: int) -> DataError:
        return DataError(what, do=do, file=self._file, line=line)


def without_formulas(text: str) -> str:
    """Return a table's text in which a spreadsheet computes no cell, heading or target.

    Each such cell begins with `'`.
    """
    return edited(
        text,
        (
            Edit(at, at, "'")
            for _, begin, line in _lines(text)
            for start, end, cell in _cells(line, begin)
            if no_formula(cell) != cell
            for at in [text.index(cell[0], start, end)]
        ),
    )


def _lines(text: str) -> Iterator[tuple[int, int, str]]:
    """Return number, position and content of each line, without its end and byte order mark."""
    at = 0
    for number, line in enumerate(text.splitlines(keepends=True), start=1):
        bare = line.rstrip("\r\n").removeprefix("\ufeff")
        yield number, at + line.index(bare), bare
        at += len(line)


def _cells(line: str, begin: int) -> list[_Cell]:
    """Return the cells of a line that begins at `begin` of the text."""
    cells, place = [], 0
    while place <= len(line):
        quoted = _QUOTED.match(line, place)
        end = line.find(",", place) if quoted is None else quoted.end()
        end = len(line) if end < 0 else end
        cells.append(_Cell(begin + place, begin + end, line[place:end].strip().strip('"')))
        place = end + 1
    return cells
