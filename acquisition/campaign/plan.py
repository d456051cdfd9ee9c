"""The plan of a campaign: every visit of the robot to a pose, in the order of the campaign, drawn from its seed.

A visit is the robot at rest in one pose once, where one or more targets are measured; `campaign.blocks` says what a
block calls for. World nests are visits without joints and come first. A shuffled campaign mixes the poses of its
blocks; what has an order of its own (sweeps, repeats) stays together. With one SMR every pose is visited once a
target, all poses of one target together, so that the SMR is moved as seldom as possible. Nothing is mixed across a
new station of the instrument. Angles deg.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import groupby
from typing import Literal

import numpy as np

from acquisition.campaign.blocks.block import DECIMALS, Approach, Block, Joints, Site, Stream
from acquisition.campaign.campaign import Campaign
from acquisition.campaign.poses import draw_poses
from acquisition.cell.cell import Cell
from drivers.errors import ConfigError

__all__ = ["DECIMALS", "Visit", "make_plan"]

Kind = Literal["nest", "pose"]


@dataclass(frozen=True)
class Visit:
    """The robot at rest in one pose once. `name` is shown to people; joints, sides and approach are empty where the arm
    takes no part: for a nest, and for distances between two balls of one body, which are of kind `nest` as well.

    base_targets: where distances are measured, the ball on the base to which each of `targets` has its distance.
    waypoints: of a path, where it goes on to from `joints_deg`, one after the other.
    """

    number: int
    name: str
    kind: Kind
    set: str
    block: int
    targets: tuple[str, ...]
    joints_deg: Joints = ()
    sides: tuple[int, ...] = ()
    approach_deg: Joints = ()
    base_targets: tuple[str, ...] = ()
    waypoints: tuple[Joints, ...] = ()

    @property
    def readings(self) -> list[tuple[str, str | None]]:
        """Targets with their base targets; these are None where points are measured."""
        return list(zip(self.targets, self.base_targets or (None,) * len(self.targets), strict=True))

    @property
    def between_balls(self) -> bool:
        """Distances between two balls of one body."""
        return self.kind == "nest" and bool(self.base_targets)

    @property
    def counted(self) -> bool:
        """Whether the readings of the visit are what the campaign is for; nests only place the instrument."""
        return self.kind == "pose" or self.between_balls

    @property
    def stops(self) -> list[Visit]:
        """Every rest of the robot: this one, and of a path all that follow, which have no approach."""
        further = enumerate(self.waypoints, start=2)
        return [
            self,
            *(
                replace(self, name=f"waypoint {k} of {self.name}", joints_deg=q, approach_deg=q, waypoints=())
                for k, q in further
            ),
        ]


def make_plan(cell: Cell, campaign: Campaign) -> list[Visit]:
    """Every visit of the campaign, nests first. Raises ConfigError for unknown targets or impossible poses."""
    _fits_instrument(cell, campaign)
    visits = []
    if not cell.instrument.declared.measures_lengths:
        visits = [Visit(0, f"nest {name}", "nest", "nest", -1, (name,)) for name in list(cell.nests)[:3]]
    reference = _reference(cell, campaign) if campaign.reference_every or campaign.warm_up else None
    order = np.random.default_rng([campaign.seed, Stream.ORDER])
    numbers, fitted = range(len(campaign.blocks)), list[Joints]()
    for _, station in groupby(numbers, key=campaign.station_of):
        units = []
        for number in station:
            taken = fitted if campaign.blocks[number].set == "validation" else ()
            found = _units(cell, campaign, number, tuple(taken))
            units += found
            if campaign.blocks[number].set == "calibration":
                fitted += [visit.joints_deg for unit in found for visit in unit if visit.joints_deg]
        if campaign.shuffled:
            units = [units[i] for i in order.permutation(len(units))]
        poses = [visit for unit in units for visit in unit]
        for group in _one_target_each(poses, cell) if cell.instrument.one_smr else [poses]:
            visits += group if reference is None else _with_references(campaign, group, reference)
    return [replace(visit, number=i) for i, visit in enumerate(visits)]


def _fits_instrument(cell: Cell, campaign: Campaign) -> None:
    """Raises ConfigError for points that a ballbar, or distances that another instrument should measure, and for a path
    whose devices send no stream."""
    lengths = cell.instrument.declared.measures_lengths
    silent = [
        f"{role} (driver {section.driver!r})"
        for role, section in (("robot", cell.robot), ("instrument", cell.instrument))
        if not section.declared.streams
    ]
    for number, block in enumerate(campaign.blocks, start=1):
        if campaign.path_of(number - 1) is not None and silent:
            raise ConfigError(
                f"block {number}: kind = 'path' records while the robot moves, and the {' and the '.join(silent)} of "
                "this cell cannot be recorded in motion; use kind = 'poses', which stops to measure"
            )
        if block.recipe.lengths != lengths:
            blocks = "use kind = 'hexapod' or 'ballbar_geometry', or 'sphere' with its base"
            hint = blocks if lengths else "it needs a ballbar"
            raise ConfigError(
                f"block {number}: kind = {block.kind!r} does not go with the {cell.instrument.name}; {hint}"
            )
    stations = any(block.new_station for block in campaign.blocks)
    if lengths and (campaign.reference_every or campaign.warm_up or campaign.nest_check or stations):
        raise ConfigError(
            "reference_every, warm_up, nest_check and new_station need an instrument that measures points"
        )
    if campaign.zero_every and not lengths:
        raise ConfigError("zero_every needs a ballbar")


def _units(cell: Cell, campaign: Campaign, number: int, taken: tuple[Joints, ...]) -> list[list[Visit]]:
    """The visits of a block: what must stay together, together. taken: as in its site."""
    block, site = campaign.blocks[number], replace(site_of(cell, campaign, number), taken=taken)
    visits = [
        Visit(
            0,
            f"{visit.what} of block {number + 1} ({block.set})",
            "pose" if visit.joints_deg else "nest",
            block.set,
            number,
            tuple(target for target, _ in visit.distances)
            or tuple(target for target in site.targets for _ in range(visit.readings)),
            visit.joints_deg,
            visit.sides,
            visit.approach_deg,
            tuple(base for _, base in visit.distances),
            visit.waypoints,
        )
        for visit in block.recipe.visits_at(site)
    ]
    return [visits] if block.recipe.ordered else [[visit] for visit in visits]


def site_of(cell: Cell, campaign: Campaign, number: int) -> Site:
    """The site of a block, counted from 0. Raises ConfigError for targets that the cell does not have."""
    block = campaign.blocks[number]
    return Site(cell, campaign.seed, number, _targets(cell, block, number), block.approach)


def _targets(cell: Cell, block: Block, number: int) -> tuple[str, ...]:
    targets = tuple(cell.tool.targets) if block.targets is None else block.targets
    for name in targets:
        if name not in cell.tool.targets:
            raise ConfigError(
                f"block {number + 1} measures target {name!r}, the cell has {', '.join(cell.tool.targets)}"
            )
    return targets


def _reference(cell: Cell, campaign: Campaign) -> Visit:
    """One pose that shows its targets: with one SMR each of them, else the first."""
    rng = np.random.default_rng([campaign.seed, Stream.REFERENCE])
    approach = Approach(campaign.blocks[0].approach.offset_deg)
    targets = tuple(cell.tool.targets)[: None if cell.instrument.one_smr else 1]
    ((pose, sides, _),) = draw_poses(
        cell, 1, rng, approach.offset_deg, both=False, decimals=DECIMALS, targets=targets
    )
    point = approach.point(pose, sides)
    return Visit(0, "reference pose", "pose", "reference", 0, targets, pose, sides, point)


def _with_references(campaign: Campaign, visits: list[Visit], reference: Visit) -> Iterator[Visit]:
    """The reference pose before the first reading and after every so many; with one SMR, of the target in hand."""
    targets = reference.targets if len(reference.targets) == 1 else visits[0].targets[:1]
    since = 0
    yield replace(reference, block=visits[0].block, targets=targets)
    for visit in visits:
        yield visit
        since += len(visit.targets)
        if campaign.reference_every and since >= campaign.reference_every:
            yield replace(reference, block=visit.block, targets=targets)
            since = 0


def _one_target_each(visits: list[Visit], cell: Cell) -> Iterator[list[Visit]]:
    for name in cell.tool.targets:
        group = [
            replace(visit, targets=tuple(target for target in visit.targets if target == name))
            for visit in visits
            if name in visit.targets
        ]
        if group:
            yield group
