"""Target tables (.csv): `target_id, j1_deg...`, or `target_id, x_mm, y_mm, z_mm, rot_w...rot_z, config`.

A row holds joint angles, as the controller counts them, or a pose of the tool point in the base frame with the
branch it is meant in (`front/up/noflip`). Other columns are kept as they are.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from calib.arm import BRANCHES
from calib.array import Array
from calib.compensate import inverse_poses
from calib.errors import DataError
from calib.text import LONGEST_LINE, MOST_COLUMNS
from calib.units import DEG
from service.programs import frames
from service.programs.frames import UNNAMED, KnownFrames
from service.programs.program import Driven, Target
from service.programs.text import Edit, decimal

PLACES = 9

_QUOTED = re.compile(r'"(?:[^"]|"")*+"(?=,|$)')
_POSITION = ("x_mm", "y_mm", "z_mm")
_QUATERNION = ("rot_w", "rot_x", "rot_y", "rot_z")


class _Cell(NamedTuple):
    start: int
    end: int
    text: str


class TargetTable:
    """A table of targets for a robot of so many joints. Raises DataError naming line and column."""

    def __init__(self, text: str, file: str, joints: int, known: KnownFrames) -> None:
        self.text = text
        self._file = file
        self._tool = known.tools.get(UNNAMED, np.eye(4))
        self._angles = tuple(f"j{k}_deg" for k in range(1, joints + 1))
        rows = self._rows()
        if not rows:
            raise self._refuse("is empty.", "Give a header row.", 1)
        header = [cell.text for cell in rows[0][1]]
        self._check_header(header, joints)
        found = [self._row(line, header, cells) for line, cells in rows[1:]]
        self.targets: Sequence[Target] = tuple(target for target, _ in found)
        self._cells = tuple(cells for _, cells in found)
        seen: set[str] = set()
        for target in self.targets:
            if target.name in seen:
                raise self._refuse(
                    f"target '{target.name}' is there twice.", "Give every target its own id.", target.line
                )
            seen.add(target.name)

    def edits(self, index: int, driven: Driven) -> list[Edit]:
        """Edits of the cells that differ."""
        target, cells = self.targets[index], self._cells[index]
        if target.joints is not None:
            values = dict(zip(self._angles, np.degrees(driven.joints), strict=True))
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
        out, at = [], 0
        for number, line in enumerate(self.text.splitlines(keepends=True), start=1):
            bare = line.rstrip("\r\n").removeprefix("﻿")
            begin = at + line.index(bare)
            at += len(line)
            if len(bare) > LONGEST_LINE:
                raise self._refuse(f"has {len(bare)} characters.", f"Give at most {LONGEST_LINE}.", number)
            if bare.strip():
                out.append((number, _cells(bare, begin)))
                if len(out[-1][1]) > MOST_COLUMNS:
                    raise self._refuse("has too many columns.", f"Give at most {MOST_COLUMNS}.", number)
        return out

    def _check_header(self, header: list[str], joints: int) -> None:
        if "target_id" not in header:
            raise self._refuse("column 'target_id' is missing.", "Add it.", 1)
        for name in header:
            if header.count(name) > 1:
                raise self._refuse(f"column '{name}' is there twice.", "Remove one.", 1)
            angle = re.fullmatch(r"j(\d{1,9})(_deg)?", name)
            if angle and not angle[2]:
                raise self._refuse(f"column '{name}' has no unit.", f"Name it {name}_deg.", 1)
            if angle and int(angle[1]) > joints:
                raise self._refuse(
                    f"column '{name}': the robot has {joints} joints.", "Use the model of this robot.", 1
                )
        if "j1_deg" not in header and "x_mm" not in header:
            raise self._refuse("has neither joint angles nor poses.", "Add j1_deg... or x_mm...", 1)
        for group in (self._angles, (*_POSITION, *_QUATERNION, "config")):
            if any(name in header for name in group):
                for name in group:
                    if name not in header:
                        raise self._refuse(f"column '{name}' is missing.", "Add it.", 1)

    def _row(self, line: int, header: list[str], cells: list[_Cell]) -> tuple[Target, dict[str, _Cell]]:
        if len(cells) != len(header):
            raise self._refuse(f"has {len(cells)} cells, the header {len(header)}.", "Correct the row.", line)
        row = dict(zip(header, cells, strict=True))
        target = Target(row["target_id"].text, line)
        if not target.name:
            raise self._refuse("column 'target_id' is empty.", "Give every target an id.", line)
        if "j1_deg" in row and row["j1_deg"].text:
            angles = np.array(self._numbers(row, self._angles, line)) * DEG
            try:
                return replace(target, joints=frames.joint_angles(angles)), row
            except ValueError as error:
                return replace(target, refused=str(error)), row
        if "x_mm" not in row:
            raise self._refuse("column 'j1_deg' is empty.", "Give the angles of every target.", line)
        branch = row["config"].text
        position, rotation = self._numbers(row, _POSITION, line), self._numbers(row, _QUATERNION, line)
        try:
            pose = frames.of_quaternion(position, rotation)
            if branch not in BRANCHES:
                raise ValueError(f"its config '{branch}' is not one of {', '.join(BRANCHES)}")
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


def _cells(line: str, begin: int) -> list[_Cell]:
    """The cells of a line that begins at `begin` of the text."""
    cells, place = [], 0
    while place <= len(line):
        quoted = _QUOTED.match(line, place)
        end = line.find(",", place) if quoted is None else quoted.end()
        end = len(line) if end < 0 else end
        cells.append(_Cell(begin + place, begin + end, line[place:end].strip().strip('"')))
        place = end + 1
    return cells
