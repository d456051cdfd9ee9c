"""The plan of a campaign: every visit of the robot to a pose, in order, drawn from the seed.

In a visit the robot is at rest in one pose, and one or more targets are measured. `campaign.blocks` defines the visits
that a block needs. World nests are visits without joints and come first. A shuffled campaign mixes the poses of its
blocks; blocks with their own order (sweeps, repeats) stay together. With one SMR every pose is visited once per target,
all poses of one target together, so that the SMR is moved as seldom as possible. Poses are not mixed across a new
station of the instrument. Angles in deg.

The whole plan is checked before the first motion: limits, and contact of arm and tool with obstacles. A pose that
fails refuses the campaign (exit code 5) and is named; nothing has moved. The approach point is checked like any pose:
5 deg away from a legal pose it can leave the limits or touch the table. From every pose there must be a clear path to
the approach point of the next. If poses are driven in another order, the path is checked again before it is driven.

The duration of a campaign is estimated from its plan: moves at the cell's speeds, settling, readings and the warm-up.
A move takes as long as its widest joint or the flange needs, plus the time for starting and stopping. The time that
devices and people add is not known beforehand: `seconds_left` scales the plan by the progress of the readings so far.
Times in s of the campaign, angles in deg, lengths in mm.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from typing import Literal

import numpy as np

from acquisition.campaign.blocks import AnyBlock
from acquisition.campaign.blocks.adaptive import AdaptiveBlock
from acquisition.campaign.blocks.ballbar_geometry import BallbarGeometryBlock
from acquisition.campaign.blocks.block import (
    DECIMALS,
    Approach,
    Block,
    BlockVisit,
    Joints,
    RandomStream,
    Site,
    rounded,
)
from acquisition.campaign.campaign import Campaign
from acquisition.campaign.driven import commanded
from acquisition.campaign.poses import draw_poses, moves_s
from acquisition.cell.cell import Cell
from acquisition.cell.transit import Transit, clear_moves
from acquisition.errors import NoClearWay, UnsafePlan
from calib.array import Array
from drivers.errors import ConfigError

__all__ = ["DECIMALS", "Visit", "make_plan"]
Kind = Literal["nest", "pose"]
READING_S = 1.0  # beam and reply, in addition to the samples
SAMPLES_PER_S = 1000.0
_NUMBERED = re.compile(r"(\d+) of block")
_NAMED = 20  # poses that a sentence names


@dataclass(frozen=True)
class Visit:
    """One visit of the robot to a pose, in which it is at rest.

    Joints, sides and approach are empty if the arm takes no part. This holds for a nest, and for distances between two
    balls of one body, which are of kind `nest` as well.

    Attributes
    ----------
    name
        Shown to people.
    base_targets
        If distances are measured: the ball on the base to which each of `targets` has its distance.
    waypoints
        The waypoints of a path after `joints_deg`, in order.
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
        """Targets with their base targets, which are None if points are measured."""
        return list(zip(self.targets, self.base_targets or (None,) * len(self.targets), strict=True))

    @property
    def between_balls(self) -> bool:
        """Whether the visit measures distances between two balls of one body."""
        return self.kind == "nest" and bool(self.base_targets)

    @property
    def counted(self) -> bool:
        """Whether the readings of the visit count as results; nests only locate the instrument."""
        return self.kind == "pose" or self.between_balls

    @property
    def stops(self) -> list[Visit]:
        """Every rest of the robot in this visit.

        A path also has its further waypoints, which have no approach.
        """
        further = enumerate(self.waypoints, start=2)
        return [
            self,
            *(
                replace(self, name=f"waypoint {k} of {self.name}", joints_deg=q, approach_deg=q, waypoints=())
                for k, q in further
            ),
        ]


def make_plan(cell: Cell, campaign: Campaign) -> list[Visit]:
    """Return every visit of the campaign, nests first.

    Raises
    ------
    ConfigError
        A target is unknown or a pose is impossible.
    """
    _fits_instrument(cell, campaign)
    visits = []
    if not cell.instrument.declared.measures_lengths:
        visits = [Visit(0, f"nest {name}", "nest", "nest", -1, (name,)) for name in list(cell.nests)[:3]]
    reference = _reference(cell, campaign) if campaign.reference_every or campaign.warm_up else None
    order = np.random.default_rng([campaign.seed, RandomStream.ORDER])
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
    for number in numbers:
        visits = _driven(cell, campaign, number, visits)
    return [replace(visit, number=i) for i, visit in enumerate(visits)]


def _driven(cell: Cell, campaign: Campaign, number: int, visits: list[Visit]) -> list[Visit]:
    """Bring the visits of a block to the joints of its model; the approach moves with the pose.

    Visits that the real robot does not reach are left out (`left_out`). Reference poses stay.

    Raises
    ------
    ConfigError
        The model cannot be used, or the real robot reaches no pose of the block.
    """
    block = campaign.blocks[number]
    those = [visit for visit in visits if visit.block == number and visit.kind == "pose"]
    stops = [stop.joints_deg for visit in those if visit.set != "reference" for stop in visit.stops]
    if block.model_file is None or not stops:
        return visits
    where = f"block {number + 1}, key 'model'"
    touched = [
        i
        for i, each in enumerate(campaign.blocks, 1)
        if isinstance(each, BallbarGeometryBlock) and each.touch_with
    ]
    if touched:
        raise ConfigError(
            f"{where}: does not go with touch_with of block {touched[0]}, whose positions are those of the robot as "
            "delivered",
            what_to_do="Measure the cups, or leave touch_with out.",
        )
    there = dict(zip(stops, commanded(cell, block.model_file, where, stops, block.approach), strict=True))
    if not any(there.values()):
        raise ConfigError(
            f"{where}: by the model {block.model_file} the real robot reaches no pose of the block within its limits",
            what_to_do="Choose other poses for the block, or check that the model belongs to this robot.",
        )

    def driven(visit: Visit) -> Visit | None:
        pose, *waypoints = (there[stop.joints_deg] for stop in visit.stops)
        if pose is None or None in waypoints:
            return None
        shift = np.subtract(pose, visit.joints_deg)
        approach = there.get(visit.approach_deg) or rounded(np.add(visit.approach_deg, shift))
        name = f"{visit.name}, through {block.model}"
        return replace(
            visit, name=name, joints_deg=pose, approach_deg=approach, waypoints=tuple(filter(None, waypoints))
        )

    moved = [driven(visit) if visit in those and visit.set != "reference" else visit for visit in visits]
    return [visit for visit in moved if visit is not None]


def left_out(campaign: Campaign, visits: Sequence[Visit]) -> list[str]:
    """Return a sentence for every block of whose poses some are not in a plan, since the arm does not reach them.

    The poses of a block are numbered from 1; those that were left out are missing in the names of its visits.
    """
    out = []
    for number, block in enumerate(campaign.blocks):
        own = [visit.name for visit in visits if visit.block == number and visit.set != "reference"]
        found = {int(match[1]) for name in own if (match := _NUMBERED.search(name))}
        wanted = block.wanted or max(found, default=0)
        if missing := sorted({*range(1, wanted + 1)} - found):
            which = ", ".join(map(str, missing[:_NAMED])) + (", ..." if len(missing) > _NAMED else "")
            out.append(
                f"Block {number + 1}: the arm does not reach {len(missing)} of {wanted} poses. Left out: {which}."
            )
    return out


def _fits_instrument(cell: Cell, campaign: Campaign) -> None:
    """Refuse blocks that the devices of the cell cannot measure.

    Raises
    ------
    ConfigError
        A ballbar would measure points, another instrument distances, or the devices of a path send no stream.
    """
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
                "this cell cannot be recorded in motion",
                what_to_do="Use kind = 'poses', which stops to measure.",
            )
        if block.lengths != lengths and not isinstance(block, AdaptiveBlock):
            blocks = "Use kind = 'hexapod' or 'ballbar_geometry', or 'sphere' with its base, or 'repeat' with its legs."
            raise ConfigError(
                f"block {number}: kind = {block.kind!r} does not go with the {cell.instrument.name}",
                what_to_do=blocks if lengths else "Use a cell with a ballbar, or a block of another kind.",
            )
    stations = any(block.new_station for block in campaign.blocks)
    if lengths and (campaign.reference_every or campaign.warm_up or campaign.nest_check or stations):
        raise ConfigError(
            "reference_every, warm_up, nest_check and new_station need an instrument that measures points",
            what_to_do="Leave them out of the campaign.",
        )
    if campaign.zero_every and not lengths:
        raise ConfigError("zero_every needs a ballbar", what_to_do="Leave zero_every out of the campaign.")


def _units(cell: Cell, campaign: Campaign, number: int, taken: tuple[Joints, ...]) -> list[list[Visit]]:
    """Return the visits of a block in groups that must stay together; `taken` as in its site."""
    block, site = campaign.blocks[number], replace(site_of(cell, campaign, number), taken=taken)
    visits = [visit_of(block, site, visit) for visit in block.visits_at(site)]
    return [visits] if block.ordered else [[visit] for visit in visits]


def visit_of(block: AnyBlock, site: Site, visit: BlockVisit) -> Visit:
    """Return a visit of a block as one of a plan, which has no number yet."""
    return Visit(
        0,
        f"{visit.what} of block {site.number + 1} ({block.set})",
        "pose" if visit.joints_deg else "nest",
        block.set,
        site.number,
        tuple(target for target, _ in visit.distances)
        or tuple(target for target in visit.targets or site.targets for _ in range(visit.readings)),
        visit.joints_deg,
        visit.sides,
        visit.approach_deg,
        tuple(base for _, base in visit.distances),
        visit.waypoints,
    )


def site_of(cell: Cell, campaign: Campaign, number: int) -> Site:
    """Return the site of a block, counted from 0.

    Raises
    ------
    ConfigError
        The cell does not have a target of the block.
    """
    block = campaign.blocks[number]
    return Site(cell, campaign.seed, number, _targets(cell, block, number), block.approach)


def _targets(cell: Cell, block: Block, number: int) -> tuple[str, ...]:
    targets = tuple(cell.tool.targets) if block.targets is None else block.targets
    for name in targets:
        if name not in cell.tool.targets:
            raise ConfigError(
                f"block {number + 1} measures target {name!r}, the cell has {', '.join(cell.tool.targets)}",
                what_to_do="Name a target of the tool of the cell.",
            )
    return targets


def _reference(cell: Cell, campaign: Campaign) -> Visit:
    """Draw one pose that shows its targets: all of them with one SMR, otherwise the first."""
    rng = np.random.default_rng([campaign.seed, RandomStream.REFERENCE])
    approach = Approach(offset_deg=campaign.blocks[0].approach.offset_deg)
    targets = tuple(cell.tool.targets)[: None if cell.instrument.one_smr else 1]
    ((pose, sides, _),) = draw_poses(
        cell, 1, rng, approach.offset_deg, both=False, decimals=DECIMALS, targets=targets
    )
    point = approach.point(pose, sides)
    return Visit(0, "reference pose", "pose", "reference", 0, targets, pose, sides, point)


def _with_references(campaign: Campaign, visits: list[Visit], reference: Visit) -> Iterator[Visit]:
    """Insert the reference pose at the start and after every `reference_every` readings.

    With one SMR, it measures the current target.
    """
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


def check_plan(cell: Cell, visits: Sequence[Visit]) -> None:
    """Check every pose of a plan.

    Raises
    ------
    UnsafePlan
        A pose may not be driven; the message names the first one and the reason.
    """
    stops = [stop for visit in visits if visit.kind == "pose" for stop in visit.stops]
    if not stops:
        return
    home = cell.robot.home_deg
    if home is not None and (contact := cell.clearance.at(np.array([home]))[0]) is not None:
        raise _unsafe(f"home_deg of the cell file: {contact}")
    for what, joints in (
        ("", np.array([visit.joints_deg for visit in stops])),
        ("the approach point of ", np.array([visit.approach_deg for visit in stops])),
    ):
        _within_limits(cell, stops, joints, what)
        for visit, angles, contact in zip(stops, joints, cell.clearance.at(joints), strict=True):
            if contact is not None:
                raise _unsafe(f"{what}{visit.name} ({cell.robot.said(angles)}): {contact}")
    _moves(cell, stops)


def _moves(cell: Cell, stops: Sequence[Visit]) -> None:
    poses = np.array([visit.joints_deg for visit in stops])
    approaches = np.array([visit.approach_deg for visit in stops])
    for visit, contact in zip(stops, cell.clearance.contacts(approaches, poses), strict=True):
        if contact is not None:
            raise _unsafe(
                f"the last move to {visit.name} ({cell.robot.said(visit.joints_deg)}): {contact.during}"
            )
    transit = Transit(cell)
    for i in np.flatnonzero(~clear_moves(cell, poses[:-1], approaches[1:])).tolist():
        try:
            transit.path(poses[i], approaches[i + 1])
        except NoClearWay as error:
            there = f"{stops[i + 1].name} ({cell.robot.said(poses[i + 1])})"
            raise _unsafe(f"between {stops[i].name} and {there}: {error.message}") from error


def _unsafe(what: str) -> UnsafePlan:
    return UnsafePlan(what, command="check")


def _within_limits(cell: Cell, stops: Sequence[Visit], joints: np.ndarray, what: str) -> None:
    low, high = np.array(cell.robot.limits_deg).T
    outside = ~((joints >= low) & (joints <= high))  # NaN is outside
    if outside.any():
        i, k = (int(index) for index in np.argwhere(outside)[0])
        raise UnsafePlan(
            f"{what}{stops[i].name}: {cell.robot.named(k)} at {joints[i, k]:g} {cell.robot.model.units[k]}, "
            f"allowed {low[k]:g} to {high[k]:g}",
            command="check",
        )


class Forecast:
    """The expected time until each reading of a pose is done, in the order of the plan."""

    def __init__(self, before_s: float, readings_s: Array) -> None:
        self._done_s = before_s + np.concatenate([[0.0], np.cumsum(readings_s)])
        self._before_s = before_s

    @classmethod
    def of(cls, cell: Cell, campaign: Campaign, visits: Sequence[Visit]) -> Forecast:
        """Forecast a whole plan, with the robot already in its first pose."""
        posed = [visit for visit in visits if visit.kind == "pose"]
        gate = campaign.warm_up
        before = campaign.warm_up_s + (0.0 if gate is None else (gate.over - 1) * gate.every_s)
        reading = READING_S + campaign.samples / SAMPLES_PER_S
        if not posed:
            return cls(before, np.full(sum(len(visit.targets) for visit in visits if visit.counted), reading))
        path, firsts, speeds = [posed[0].joints_deg], [], []
        for visit in posed:
            firsts.append(len(path) - 1)
            path += [visit.approach_deg, visit.joints_deg, *visit.waypoints]
            speeds += [*[cell.robot.speed_deg_s] * 2, *[_speed(cell, campaign, visit)] * len(visit.waypoints)]
        moves = np.add.reduceat(
            moves_s(cell, np.array(path[:-1]), np.array(path[1:]), np.array(speeds)), firsts
        )
        moves += [_rests_s(campaign, visit) for visit in posed]
        settling = [campaign.settle_of(visit.block).seconds for visit in posed]
        arriving = dict(zip((visit.number for visit in posed), moves + np.array(settling), strict=True))
        seconds: list[float] = []
        for visit in visits:
            if visit.counted:
                first = float(arriving.get(visit.number, 0.0)) + reading
                seconds += [first, *[reading] * (len(visit.targets) - 1)]
        return cls(before, np.array(seconds))

    @property
    def total_s(self) -> float:
        """Seconds from the start to the last reading."""
        return float(self._done_s[-1])

    def seconds_left(
        self, done: int, done_at_start: int = 0, elapsed_s: float = 0.0, share: float = 0.0
    ) -> float:
        """Return the seconds left after `done` readings.

        Of these, `done_at_start` were done when this execution began `elapsed_s` ago. `share` is the finished part of
        the current reading, if it is known: a path reports it at every waypoint, also when it is driven again.
        """
        last = len(self._done_s) - 1
        done, begun = min(done, last), min(done_at_start, last)
        in_hand = float(self._done_s[min(done + 1, last)] - self._done_s[done])
        left = self.total_s - float(self._done_s[done]) - share * in_hand
        if done <= begun and share > 0.0:
            return left
        if done <= begun:
            return max(0.0, left + self._before_s - elapsed_s)
        expected = self._before_s + float(self._done_s[done] - self._done_s[begun])
        return left * elapsed_s / expected if elapsed_s > 0.0 else left


def _rests_s(campaign: Campaign, visit: Visit) -> float:
    """Return the seconds that a path rests in its waypoints."""
    path = campaign.path_of(visit.block)
    return 0.0 if path is None or not visit.waypoints else path.rest_s * (len(visit.waypoints) + 1)


def _speed(cell: Cell, campaign: Campaign, visit: Visit) -> float:
    """Return the speed, deg/s, at which the robot drives through the waypoints of a visit."""
    path = campaign.path_of(visit.block)
    return cell.robot.speed_deg_s if path is None or path.speed_deg_s is None else path.speed_deg_s
