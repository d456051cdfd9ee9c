"""`kind = "poses"`: poses of one set, drawn at random, chosen by observability, or given in the file or beside it."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, cast

from acquisition.campaign.blocks.block import DECIMALS, BlockVisit, Joints, RandomStream, Site
from acquisition.campaign.observability import CANDIDATES, select_poses
from acquisition.campaign.poses import Pose, draw_poses
from acquisition.errors import as_config_error
from calib.text import TomlTable, read_text, rows_of
from drivers.errors import ConfigError

Select = Literal["random", "file", "list", "observability"]
DRAWN = ("random", "observability")
_JOINT = re.compile(r"[je]\d+_(deg|mm)")
KEYS = ("count", "select", "file", "joints_deg")
OWN_KEYS = (*KEYS, "approach_sides", "readings")
_MOST = 100  # readings of a target in one visit


@dataclass(frozen=True)
class PoseSource:
    """The source of poses. `joints_deg`: the poses themselves where they are given, else drawn; `sides`: the side of
    approach of every joint at each of them, where they are given too."""

    select: Select
    count: int
    joints_deg: tuple[Joints, ...] = ()
    sides: tuple[tuple[int, ...], ...] = ()

    def poses(self, site: Site, longest_deg: float | None) -> list[Pose]:
        """The poses with their approach; longest_deg: as `campaign.poses.draw_poses`. Raises ConfigError."""
        if self.select not in DRAWN:
            return self._given(site, longest_deg)
        approach, rng, chosen = site.approach, site.rng(RandomStream.POSE), self.select == "observability"
        with as_config_error(f"block {site.number + 1}: "):
            drawn = draw_poses(
                site.cell,
                CANDIDATES if chosen else self.count,
                rng,
                approach.offset_deg,
                both=approach.sides == "both",
                longest_deg=longest_deg,
                decimals=DECIMALS,
                targets=site.targets,
                fewest=self.count,
            )
            return select_poses(site.cell, drawn, self.count, rng, site.targets) if chosen else drawn

    def _given(self, site: Site, longest_deg: float | None) -> list[Pose]:
        poses = [site.posture(f"pose {i}", pose) for i, pose in enumerate(self.joints_deg, start=1)]
        shape = (len(poses), site.cell.robot.model.joints)
        sides = [(site.approach.side,) * shape[1]] * shape[0]
        if self.sides:
            sides = list(self.sides)
        elif site.approach.sides == "both":
            drawn = site.rng(RandomStream.SIDE).choice((-1, 1), size=shape)
            sides = [tuple(int(side) for side in row) for row in drawn]
        shortest = abs(site.approach.offset_deg)
        lengths = [shortest] * len(poses)
        if longest_deg is not None:
            lengths = site.rng(RandomStream.REACH).uniform(shortest, longest_deg, len(poses)).tolist()
        return [Pose(*each) for each in zip(poses, sides, lengths, strict=True)]


@dataclass(frozen=True)
class Poses:
    """Visits each pose once and reads every target so often while the arm rests. Last moves to drawn poses are of many
    lengths; those to given poses, where it is asked."""

    source: PoseSource
    readings: int = 1
    ordered = False
    lengths = False

    def visits_at(self, site: Site) -> list[BlockVisit]:
        drawn = self.source.select in DRAWN
        longest = site.approach.usual_longest_deg if drawn else site.approach.longest_deg
        visits = [
            site.visit(f"pose {i}", pose.joints_deg, pose.sides, reach_deg=pose.reach_deg)
            for i, pose in enumerate(self.source.poses(site, longest), start=1)
        ]
        return [replace(visit, readings=self.readings) for visit in visits]


def read(table: TomlTable, folder: Path | None) -> Poses:
    """The block of a table of the campaign. Raises ConfigError.

    folder: where pose files are; None: they are not read again.
    """
    source = read_source(table, folder)
    readings = table.whole("readings", 1, low=1, high=_MOST)
    return Poses(replace(source, sides=_sides(table, source)), readings)


def _sides(table: TomlTable, source: PoseSource) -> tuple[tuple[int, ...], ...]:
    """Read `approach_sides` beside `joints_deg`: +1 from below or -1 from above, for every joint of every pose."""
    if "approach_sides" not in table.values:
        return ()
    shape = [len(pose) for pose in source.joints_deg]
    if source.select != "list":
        raise table.refuse("approach_sides", "goes with given poses only.", "Use select = 'list'.")
    rows = table.rows("approach_sides", shape[0])
    if len(rows) != len(shape) or any(abs(side) != 1.0 for row in rows for side in row):
        raise table.refuse(
            "approach_sides",
            "is not one row a pose.",
            "Give +1 (from below) or -1 for every joint of every pose.",
        )
    return tuple(tuple(int(side) for side in row) for row in rows)


def read_source(table: TomlTable, folder: Path | None, count: int | None = None) -> PoseSource:
    """Read `select`, `count`, `file` and `joints_deg`; `count`: how many unless the file says. Raises ConfigError."""
    select = table.text("select", "random", (*DRAWN, "file", "list"))
    poses: tuple[Joints, ...] = ()
    if select == "list":
        poses = _listed(table)
    elif select == "file" and folder is not None:
        poses = read_poses(folder / table.text("file"))
    number = table.whole("count", count, low=1) if select in DRAWN else len(poses)
    return PoseSource(cast(Select, select), number, poses)


def _listed(table: TomlTable) -> tuple[Joints, ...]:
    rows = table.values.get("joints_deg")
    if not isinstance(rows, Sequence) or not rows:
        raise table.refuse("joints_deg", "is missing or empty.", "select = 'list' needs the poses.")
    width = len(rows[0]) if isinstance(rows[0], Sequence) else 0
    return tuple(table.rows("joints_deg", width))


@as_config_error()
def read_poses(path: Path) -> tuple[Joints, ...]:
    """Poses of a CSV file with columns `j1_deg`, `j2_deg`, ..., or those of its own robot (`e1_mm`) in the order of its
    joints. Raises ConfigError naming the line."""
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
                raise ConfigError(f"{path}, line {number}: a joint angle is not a number.") from error
            if not all(math.isfinite(q) for q in pose):
                raise ConfigError(f"{path}, line {number}: a joint angle is not finite.")
            poses.append(pose)
    if not poses:
        raise ConfigError(f"{path}: has no poses.")
    return tuple(poses)
