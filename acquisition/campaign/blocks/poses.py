"""Blocks of `kind = "poses"`: poses of one set, random, chosen by observability, or given.

Given poses are in the campaign file or in a CSV file in the same folder.
"""

from __future__ import annotations

import math
import re
from dataclasses import replace
from pathlib import Path
from typing import Annotated, ClassVar, Literal, Self

import numpy as np
from pydantic import PrivateAttr, ValidationInfo, model_validator

from acquisition.campaign.blocks.block import DECIMALS, Block, BlockVisit, Joints, RandomStream, Set, Site
from acquisition.campaign.blocks.legs import SidesOfPoses, refuse_other_shape
from acquisition.campaign.observability import CANDIDATES, select_poses
from acquisition.campaign.poses import Pose, draw_poses
from acquisition.cell.workspace import beyond_cone
from acquisition.errors import as_config_error
from acquisition.file_table import OnlyInFiles, Rows, Text, refused, told
from calib.text import read_text, rows_of
from drivers.errors import ConfigError

DRAWN = ("random", "observability")
_JOINT = re.compile(r"[je]\d+_(deg|mm)")


class Chosen(Block):
    """A block whose poses are drawn, chosen, or given.

    Given poses are in the campaign file or in a CSV file in the same folder.
    """

    usual_count: ClassVar[int | None] = None

    select: Annotated[
        Literal["random", "observability", "file", "list"],
        OnlyInFiles("file"),
        told(
            "How poses are chosen. `file` would be one of the server where it comes by HTTP, and is refused.",
            "list",
        ),
    ] = "random"
    count: Annotated[int | None, told("Number of poses that are drawn.", 60, ge=1, le=1_000_000)] = None
    file: Annotated[
        Text | None, OnlyInFiles(), told("A CSV of `j1_deg`, `j2_deg`, ... beside the campaign.", "poses.csv")
    ] = None
    joints_deg: Annotated[
        Rows | None,
        told("The poses of `select = list`, deg, one row a pose.", [[12.0, 45.0, -10.0, 80.0, -35.0, 10.0]]),
    ] = None
    _given: tuple[Joints, ...] = PrivateAttr(())

    @model_validator(mode="after")
    def _has_poses(self, info: ValidationInfo) -> Self:
        folder: Path | None = (info.context or {}).get("folder")
        if self.select == "list":
            if self.joints_deg is None:
                raise refused("joints_deg", "is missing or empty.", "select = 'list' needs the poses.")
            self._given = self.joints_deg
        elif self.select == "file" and folder is not None:
            if self.file is None:
                raise refused("file", "is missing.", "Add it; the unit of a number is in the key's name.")
            self._given = read_poses(folder / self.file)
        elif self.select in DRAWN and self.number is None:
            raise refused("count", "is missing.", "Add it; the unit of a number is in the key's name.")
        return self

    @property
    def number(self) -> int | None:
        """Number of poses."""
        return (self.count or self.usual_count) if self.select in DRAWN else len(self._given)

    @property
    def given_sides(self) -> tuple[tuple[int, ...], ...]:
        return ()

    def poses(self, site: Site, longest_deg: float | None, *, one_target: bool = False) -> list[Pose]:
        """Return the poses with their approach; `longest_deg` and `one_target` as in `campaign.poses.draw_poses`.

        Raises
        ------
        ConfigError
            The cell leaves too few poses, or a given pose is not one of this robot.
        """
        if self.select not in DRAWN:
            return self._listed(site, longest_deg)
        number = self.number or 0
        approach, rng, chosen = site.approach, site.rng(RandomStream.POSE), self.select == "observability"
        with as_config_error(f"block {site.number + 1}: "):
            drawn = draw_poses(
                site.cell,
                CANDIDATES if chosen else number,
                rng,
                approach.offset_deg,
                both=approach.sides == "both",
                longest_deg=longest_deg,
                decimals=DECIMALS,
                targets=site.targets,
                fewest=number,
                one_target=one_target,
            )
            return select_poses(site.cell, drawn, number, rng, site.targets) if chosen else drawn

    def _listed(self, site: Site, longest_deg: float | None) -> list[Pose]:
        poses = [site.posture(f"pose {i}", pose) for i, pose in enumerate(self._given, start=1)]
        shape = (len(poses), site.cell.robot.model.joints)
        sides = [(site.approach.side,) * shape[1]] * shape[0]
        if self.given_sides:
            sides = list(self.given_sides)
        elif site.approach.sides == "both":
            drawn = site.rng(RandomStream.SIDE).choice((-1, 1), size=shape)
            sides = [tuple(int(side) for side in row) for row in drawn]
        shortest = abs(site.approach.offset_deg)
        lengths = [shortest] * len(poses)
        if longest_deg is not None:
            lengths = site.rng(RandomStream.REACH).uniform(shortest, longest_deg, len(poses)).tolist()
        return [Pose(*each) for each in zip(poses, sides, lengths, strict=True)]


class PosesBlock(Chosen):
    """A block that visits each pose once and reads every target while the arm rests.

    Last moves to drawn poses have various lengths; those to given poses only if the block requests it.
    """

    ordered: ClassVar[bool] = False

    kind: Annotated[Literal["poses"], told("Left out: this kind.", "poses")] = "poses"
    set: Set = "calibration"
    approach_sides: SidesOfPoses = ()
    readings: Annotated[
        int, told("Number of readings of every target while the arm rests there.", 3, ge=1, le=100)
    ] = 1
    one_target: Annotated[
        bool,
        told(
            "Measure in each pose the one of `targets` that faces the instrument best, by its normal in the cell.",
            True,
        ),
    ] = False

    @model_validator(mode="after")
    def _sides_of_given_poses(self) -> Self:
        if self.one_target and self.select == "observability":
            what = "does not go with select = 'observability', which counts on every target in every pose."
            raise refused("one_target", what, "Use select = 'random', or give the poses.")
        if self.approach_sides and self.select != "list":
            raise refused("approach_sides", "goes with given poses only.", "Use select = 'list'.")
        refuse_other_shape(self.approach_sides, self._given)
        return self

    @property
    def given_sides(self) -> tuple[tuple[int, ...], ...]:
        return self.approach_sides

    @property
    def wanted(self) -> int | None:
        return self.number

    def visits_at(self, site: Site) -> list[BlockVisit]:
        drawn = self.select in DRAWN
        longest = site.approach.usual_longest_deg if drawn else site.approach.longest_deg
        visits = [
            site.visit(f"pose {i}", pose.joints_deg, pose.sides, reach_deg=pose.reach_deg)
            for i, pose in enumerate(self.poses(site, longest, one_target=self.one_target), start=1)
        ]
        if not self.one_target:
            return [replace(visit, readings=self.readings) for visit in visits]
        joints = np.array([visit.joints_deg for visit in visits])
        best = np.argmax(beyond_cone(site.cell, joints, site.targets), axis=1)
        return [
            replace(visit, readings=self.readings, targets=(site.targets[k],))
            for visit, k in zip(visits, best.tolist(), strict=True)
        ]


@as_config_error()
def read_poses(path: Path) -> tuple[Joints, ...]:
    """Read poses from a CSV file with the columns `j1_deg`, `j2_deg`, ...

    A robot from the user's own file may have other columns (`e1_mm`), in the order of its joints.

    Raises
    ------
    ConfigError
        The file has no such columns or no poses, or a value is not a finite number; the message names the line.
    """
    lines = rows_of(read_text(path), path)
    names = [name.strip() for name in lines[0][1]] if lines else []
    columns = []
    while f"j{len(columns) + 1}_deg" in names:
        columns.append(names.index(f"j{len(columns) + 1}_deg"))
    joints = [i for i, name in enumerate(names) if _JOINT.fullmatch(name)]
    if len(joints) > len(columns):
        columns = joints
    if not columns:
        raise ConfigError(f"{path}, line 1: has no columns j1_deg, j2_deg, ...")
    poses = []
    for number, line in lines[1:]:
        if any(cell.strip() for cell in line):
            try:
                pose = tuple(float(line[column]) for column in columns)
            except (ValueError, IndexError) as error:
                raise ConfigError(
                    f"{path}, line {number}: a joint angle is not a number.",
                    what_to_do="Give every joint a number.",
                ) from error
            if not all(math.isfinite(q) for q in pose):
                raise ConfigError(
                    f"{path}, line {number}: a joint angle is not finite.",
                    what_to_do="Give every joint a finite number.",
                )
            poses.append(pose)
    if not poses:
        raise ConfigError(f"{path}: has no poses.", what_to_do="Add a line per pose below the header.")
    return tuple(poses)
