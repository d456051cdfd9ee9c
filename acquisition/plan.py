"""The plan of a campaign: every visit of the robot to a pose, in the order of the campaign, drawn from its seed.

A visit is one standing of the robot, reached over its approach point q - side x |offset| (Nubiola, thesis 2.5),
in which one or more targets are measured. World nests are visits without joints and come first. With one SMR
every pose is visited once a target, all poses of one target together, so that the SMR is moved as seldom as
possible. Angles deg, rounded to what every controller takes; the rounded values are the record.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from acquisition.campaign import DRAWN, Block, Campaign, Joints
from acquisition.cell import Cell
from acquisition.observability import select_poses
from acquisition.poses import Pose, draw_poses
from calib.errors import DataError
from drivers.errors import ConfigError

DECIMALS = 4  # a stock open_abb request carries four
_POSE_STREAM, _SIDE_STREAM, _ORDER_STREAM, _REFERENCE_STREAM = range(4)

Kind = Literal["nest", "pose"]


@dataclass(frozen=True)
class Visit:
    """One standing. `name` is shown to people; joints, sides and approach are empty for a nest."""

    number: int
    name: str
    kind: Kind
    set: str
    block: int
    targets: tuple[str, ...]
    joints_deg: Joints = ()
    sides: tuple[int, ...] = ()
    approach_deg: Joints = ()


@dataclass(frozen=True)
class _Stand:
    """A pose to be visited, before it has its place in the order."""

    name: str
    set: str
    block: int
    targets: tuple[str, ...]
    joints_deg: Joints
    sides: tuple[int, ...]
    approach_deg: Joints


def approach_point(joints_deg: Joints, sides: tuple[int, ...], offset_deg: float) -> Joints:
    """Where the last move starts, deg: from below (side +1) it lies below the pose."""
    return tuple(
        round(q - side * abs(offset_deg), DECIMALS) for q, side in zip(joints_deg, sides, strict=True)
    )


def make_plan(cell: Cell, campaign: Campaign) -> list[Visit]:
    """Every visit of the campaign, nests first. Raises ConfigError for unknown targets or impossible poses."""
    stands = [stand for i, block in enumerate(campaign.blocks) for stand in _stands(cell, campaign, block, i)]
    if campaign.shuffled:
        order = np.random.default_rng([campaign.seed, _ORDER_STREAM]).permutation(len(stands))
        stands = [stands[i] for i in order]
    if campaign.reference_every:
        stands = _with_references(cell, campaign, stands)
    if cell.instrument.one_smr:
        stands = list(_one_target_each(stands, list(cell.tool.targets)))
    visits = [
        Visit(i, f"nest {name}", "nest", "nest", -1, (name,)) for i, name in enumerate(list(cell.nests)[:3])
    ]
    return visits + [
        Visit(
            len(visits) + i,
            stand.name,
            "pose",
            stand.set,
            stand.block,
            stand.targets,
            stand.joints_deg,
            stand.sides,
            stand.approach_deg,
        )
        for i, stand in enumerate(stands)
    ]


def _stands(cell: Cell, campaign: Campaign, block: Block, number: int) -> list[_Stand]:
    targets = tuple(cell.tool.targets) if block.targets is None else block.targets
    for name in targets:
        if name not in cell.tool.targets:
            raise ConfigError(
                f"block {number + 1} measures target {name!r}, the cell has {', '.join(cell.tool.targets)}"
            )
    offset = block.approach.offset_deg
    both = block.approach.sides == "both"
    if block.select in DRAWN:
        draw = draw_poses if block.select == "random" else select_poses
        rng = np.random.default_rng([campaign.seed, _POSE_STREAM, number])
        try:
            poses = draw(cell, block.count, rng, offset, both=both, decimals=DECIMALS, targets=targets)
        except DataError as error:
            raise ConfigError(f"block {number + 1}: {error}") from error
    else:
        poses = _given(cell, campaign, block, number)
    return [
        _Stand(
            f"pose {i} of block {number + 1} ({block.set})",
            block.set,
            number,
            targets,
            pose,
            sides,
            approach_point(pose, sides, offset),
        )
        for i, (pose, sides) in enumerate(poses, start=1)
    ]


def _given(cell: Cell, campaign: Campaign, block: Block, number: int) -> list[Pose]:
    joints = cell.robot.model.joints
    rng = np.random.default_rng([campaign.seed, _SIDE_STREAM, number])
    usual = (1 if block.approach.offset_deg < 0 else -1,) * joints
    out: list[Pose] = []
    for i, pose in enumerate(block.joints_deg, start=1):
        if len(pose) != joints:
            raise ConfigError(f"block {number + 1}, pose {i} has {len(pose)} joints, the robot {joints}")
        both = block.approach.sides == "both"
        sides = tuple(int(s) for s in rng.choice((-1, 1), size=joints)) if both else usual
        out.append((tuple(round(q, DECIMALS) for q in pose), sides))
    return out


def _with_references(cell: Cell, campaign: Campaign, stands: list[_Stand]) -> list[_Stand]:
    """The same pose, its first target, before the first reading and after every `reference_every` readings."""
    rng = np.random.default_rng([campaign.seed, _REFERENCE_STREAM])
    offset = campaign.blocks[0].approach.offset_deg
    target = next(iter(cell.tool.targets))
    ((pose, sides),) = draw_poses(cell, 1, rng, offset, both=False, decimals=DECIMALS, targets=(target,))
    reference = _Stand(
        "reference pose", "reference", -1, (target,), pose, sides, approach_point(pose, sides, offset)
    )
    out, since = [reference], 0
    for stand in stands:
        out.append(stand)
        since += len(stand.targets)
        if since >= campaign.reference_every:
            out.append(reference)
            since = 0
    return out


def _one_target_each(stands: list[_Stand], targets: list[str]) -> Iterator[_Stand]:
    for name in targets:
        for stand in stands:
            if name in stand.targets:
                yield replace(stand, targets=(name,))
