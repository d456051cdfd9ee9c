"""Blocks of `kind = "adaptive"`: poses that are chosen while they are measured, until the accuracy is reached.

The plan has the first poses only: those that determine the base model best over the zone. Whenever they are measured,
the readings so far tell how accurate the model is and which poses to add (`acquisition.run.adaptive`). The candidates,
the poses by which the zone is judged and those that are drawn in it at random follow from the seed, so they are the
same in every execution. The zone is the workspace of the cell, a box in the world, or a list of poses, for example
those of the user's program. Lengths mm, angles deg, times s.

With a ballbar, the candidates are the stances of a hexapod, each with its six legs, from sides and over distances that
are drawn. A person moves the bar between the legs, while the robot rests. The accuracy is that of positions in the
zone, relative to the cups.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated, ClassVar, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Strict, model_validator

from acquisition.campaign.blocks.block import DECIMALS, Block, BlockVisit, Joints, RandomStream, Site
from acquisition.campaign.blocks.hexapod import HexapodBlock
from acquisition.campaign.observability import setup_of
from acquisition.campaign.poses import Pose, draw_poses, moves_s
from acquisition.cell.cell import MADE_MM, Cell
from acquisition.cell.transit import may_visit
from acquisition.cell.workspace import targets_at
from acquisition.errors import as_config_error
from acquisition.file_table import Rows, Table, refused, told
from calib.arm import LEGS
from calib.array import Array
from calib.data import Conditions, Noise
from calib.model import ModelStructure, StatedConditions, conditions_of
from calib.selection import (
    Balls,
    Design,
    WorkingZone,
    model_of_lengths,
    rows_of_visits,
    usual_covariance,
    zone_of,
)
from calib.units import DEG
from drivers.errors import ConfigError

BATCH = 5  # poses between two looks at the readings
DRAWN = 2  # of these drawn at random in the zone
LEAST = 15  # poses before the campaign may end
FIRST = 10  # poses before the first look; as many as LEAST with a single target, which gives few numbers
_CANDIDATES, _ZONE, _PROBES, _FEWEST = 500, 120, 60, 40

Range = Annotated[tuple[float, float], Strict(False)]


class ZoneTable(Table):
    """A box in the world in which the robot works; a limit that is left out is that of the workspace."""

    x_mm: Annotated[Range | None, told("Limits along x, mm.", [300.0, 550.0])] = None
    y_mm: Annotated[Range | None, told("Limits along y, mm.", [-200.0, 200.0])] = None
    z_mm: Annotated[Range | None, told("Limits along z, mm.", [100.0, 400.0])] = None

    @model_validator(mode="after")
    def _is_a_box(self) -> Self:
        for key in ("x_mm", "y_mm", "z_mm"):
            limits: tuple[float, float] | None = getattr(self, key)
            if limits is not None and not limits[0] < limits[1]:
                raise refused(key, f"is {list(limits)}.", "Give the lower limit first.")
        return self

    def within(self, cell: Cell, targets: Sequence[str], joints_deg: Array) -> NDArray[np.bool_]:
        """Check that the middle of the targets is in the box at joint angles (n, N)."""
        known = list(cell.tool.targets)
        places = targets_at(cell, joints_deg)[:, [known.index(name) for name in targets]].mean(axis=1)
        limits = np.array([each or (-np.inf, np.inf) for each in (self.x_mm, self.y_mm, self.z_mm)])
        return np.all((places >= limits[:, 0]) & (places <= limits[:, 1]), axis=1)


class AdaptiveBlock(Block):
    """A block that measures until the accuracy is reached, no more is to be gained, or the time is up."""

    ordered: ClassVar[bool] = False

    kind: Annotated[Literal["adaptive"], told("This kind.", "adaptive")]
    set: Annotated[Literal["calibration"], told("Its poses enter the fit.", "calibration")] = "calibration"
    accuracy_mm: Annotated[
        float,
        told(
            "RMS error of a reading in the zone after the calibration, to be reached with 95 % confidence, mm.",
            0.1,
            ge=0.001,
            le=100.0,
        ),
    ]
    minutes: Annotated[
        float | None,
        told(
            "No poses are added after this time since the beginning, min; left out: no limit.",
            30.0,
            ge=1.0,
            le=10_000.0,
        ),
    ] = None
    most: Annotated[int, told("Largest number of poses.", 100, ge=LEAST, le=1000)] = 100
    zone: Annotated[
        ZoneTable | None,
        told("Where the robot works; left out: the whole workspace.", {"x_mm": [300.0, 550.0]}),
    ] = None
    zone_joints_deg: Annotated[
        Rows | None,
        told(
            "Poses at which the robot works, deg, in place of a box.",
            [[12.0, 45.0, -10.0, 80.0, -35.0, 10.0]],
        ),
    ] = None

    @model_validator(mode="after")
    def _one_zone(self) -> Self:
        if self.zone is not None and self.zone_joints_deg is not None:
            raise refused("zone_joints_deg", "is given beside zone.", "Give one of the two.")
        return self

    def visits_at(self, site: Site) -> list[BlockVisit]:
        cell, pool = site.cell, pool_of(self, site)
        first, _, _ = first_of(site, pool)
        begin = np.array(cell.robot.home_deg or [0.0] * cell.robot.model.joints)
        order = in_order(cell, pool, first, begin)
        return [pool.visit(site, i, number) for number, i in enumerate(order, start=1)]


Legs = tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class Pool:
    """The poses of an adaptive block.

    `candidates` may be measured. Those from `drawn` on are drawn in the zone at random, as are the poses `zone`, at
    which the accuracy is judged and which are not measured. `legs` are those of each candidate, target and ball on the
    base; empty if points are measured.
    """

    candidates: tuple[Pose, ...]
    drawn: int
    zone: tuple[Pose, ...]
    legs: tuple[Legs, ...] = ()

    def joints(self, which: Sequence[int] | None = None) -> Array:
        """Return the joint angles (n, N) of all candidates, or of some, deg."""
        chosen = self.candidates if which is None else [self.candidates[i] for i in which]
        return np.array([pose.joints_deg for pose in chosen])

    def before(self, which: Sequence[int] | None = None) -> Array:
        """Return their approach points (n, N), deg."""
        return _before(self.candidates if which is None else [self.candidates[i] for i in which])

    def visit(self, site: Site, i: int, number: int) -> BlockVisit:
        """Return the visit of candidate i, which is the pose `number` of its block."""
        pose, legs = self.candidates[i], self.legs[i] if self.legs else ()
        return site.visit(f"pose {number}", pose.joints_deg, pose.sides, legs, pose.reach_deg)

    def goal(self, joints_deg: Joints, readings: Sequence[tuple[str, str | None]]) -> Joints:
        """Return the joints of the candidate for which a robot was driven to these joints, perhaps through a model."""
        if not self.legs:
            return joints_deg
        alike = [i for i, legs in enumerate(self.legs) if set(legs) == set(readings)]
        apart = np.abs(self.joints(alike) - np.array(joints_deg)).max(axis=1)
        return self.candidates[alike[int(np.argmin(apart))]].joints_deg


def _before(poses: Sequence[Pose]) -> Array:
    return np.array([pose.joints_deg for pose in poses]) - np.array(
        [pose.sides for pose in poses]
    ) * np.array([[pose.reach_deg] for pose in poses])


def pool_of(block: AdaptiveBlock, site: Site) -> Pool:
    """Draw the candidates and the zone of a block; the same every time.

    Raises
    ------
    ConfigError
        The cell leaves too few poses, the zone is out of its reach, or the targets cannot be measured without a person.
    """
    cell, approach = site.cell, site.approach
    if cell.instrument.one_smr and len(site.targets) > 1:
        raise ConfigError(
            f"block {site.number + 1}: kind = 'adaptive' goes from pose to pose without a person, and the only SMR of "
            f"this cell would be moved for {', '.join(site.targets)}",
            what_to_do="Name one of them as 'targets', best one that is far from the last axis.",
        )
    rng = site.rng(RandomStream.POSE)

    def drawn(most: int, fewest: int, within: ZoneTable | None) -> list[Pose]:
        return draw_poses(
            cell,
            most,
            rng,
            approach.offset_deg,
            both=approach.sides == "both",
            longest_deg=approach.usual_longest_deg,
            decimals=DECIMALS,
            targets=site.targets,
            fewest=fewest,
            within=None if within is None else lambda joints: within.within(cell, site.targets, joints),
        )

    with as_config_error(f"block {site.number + 1}: "):
        legs: list[Legs] = []
        if cell.instrument.declared.measures_lengths:
            candidates, legs = _stances(site, rng)
        else:
            candidates = drawn(_CANDIDATES, LEAST * 2, None)
        if block.zone_joints_deg is not None:
            zone = _given(block.zone_joints_deg, site, rng)
            before, joints = _before(zone), np.array([pose.joints_deg for pose in zone])
            safe = np.flatnonzero(may_visit(cell, joints, before))
            probes = [zone[i] for i in rng.permutation(safe)[:_PROBES]] or candidates[:_PROBES]
        else:
            try:
                zone = drawn(_ZONE + _PROBES, _FEWEST, block.zone)
            except ConfigError as error:
                if block.zone is None:
                    raise
                raise ConfigError(
                    f"zone: {error.message}",
                    what_to_do="Make the box larger, or move it to where the robot reaches.",
                ) from error
            probes, zone = zone[: len(zone) // 3], zone[len(zone) // 3 :]
    if legs:  # a bar cannot be put between any two places in the zone: some stances are drawn instead
        mixed = rng.permutation(len(candidates)).tolist()
        candidates, legs = [candidates[i] for i in mixed], [legs[i] for i in mixed]
        return Pool(tuple(candidates), len(candidates) - len(candidates) // 4, tuple(zone), tuple(legs))
    return Pool((*candidates, *probes), len(candidates), tuple(zone))


def _stances(site: Site, rng: np.random.Generator) -> tuple[list[Pose], list[Legs]]:
    """Return all stances of a hexapod that the arm reaches, with drawn approaches, and their legs.

    Raises
    ------
    ConfigError
        The legs lie between other than three balls each, or too few stances can be driven.
    """
    visits = HexapodBlock(kind="hexapod", configurations="all").visits_at(site)
    joints = np.array([visit.joints_deg for visit in visits])
    shape, approach = joints.shape, site.approach
    sides = (
        rng.choice((-1, 1), size=shape)
        if approach.sides == "both"
        else np.array([visits[0].sides] * len(visits))
    )
    reach = np.round(rng.uniform(abs(approach.offset_deg), approach.usual_longest_deg, len(visits)), DECIMALS)
    good = np.flatnonzero(may_visit(site.cell, joints, joints - sides * reach[:, None]))
    if len(good) < 2 * LEAST:
        raise ConfigError(
            f"the arm reaches only {len(good)} stances of the legs, {2 * LEAST} are needed; find a better place for "
            "the cups with truepose plan-ballbar"
        )
    poses = [Pose(visits[i].joints_deg, tuple(sides[i].tolist()), float(reach[i])) for i in good]
    return poses, [tuple(visits[i].distances) for i in good]


def _given(rows: Sequence[Joints], site: Site, rng: np.random.Generator) -> list[Pose]:
    poses = [site.posture(f"zone_joints_deg {i}", row) for i, row in enumerate(rows, start=1)]
    low, high = np.array(site.cell.robot.limits_deg).T
    outside = np.flatnonzero(np.any((np.array(poses) < low) | (np.array(poses) > high), axis=1))
    if len(outside):
        raise ConfigError(
            f"zone_joints_deg {outside[0] + 1} is outside limits_deg of the cell; leave out what cannot be reached"
        )
    sides = np.full((len(poses), len(poses[0])), site.approach.side)
    if site.approach.sides == "both":
        sides = rng.choice((-1, 1), size=sides.shape)
    reach = abs(site.approach.offset_deg)
    return [Pose(pose, tuple(row), reach) for pose, row in zip(poses, sides.tolist(), strict=True)]


def first_of(site: Site, pool: Pool) -> tuple[list[int], Design, float]:
    """Choose the first candidates for the base model; return what is known after them, and the floor of the zone, mm.

    They are chosen for what they tell, whatever the way to them costs: time saved on them would cost more later.

    Raises
    ------
    ConfigError
        The robot or the targets cannot be calibrated so.
    """
    with as_config_error(f"block {site.number + 1}: "):
        model, noise = unmeasured(site)
        stated = StatedConditions(loads=site.cell.loads)
    estimate = np.zeros(len(model.parameters))
    rows, zone = seen_by(site, pool, model, estimate, stated, noise)
    design = Design(rows, zone.spread, usual_covariance(model))
    chosen, design = design.best(LEAST if len(site.targets) == 1 else FIRST)
    return chosen, design, zone.floor_mm


def unmeasured(site: Site) -> tuple[ModelStructure, Noise]:
    """Return the base model before any reading, and the noise of the readings.

    Raises
    ------
    DataError
        The robot or the targets cannot be calibrated so.
    """
    cell = site.cell
    if not cell.instrument.declared.measures_lengths:
        setup = setup_of(cell, site.targets)
        return setup.model(), setup.noise
    tool = {name: cell.tool.targets[name] for name in site.targets}
    stated_mm = {name: cell.tool.stated_mm.get(name, MADE_MM) for name in tool}
    noise = Noise(
        "isotropic",
        length_mm=cell.instrument.noise.length_mm,
        repeatability=cell.robot.repeatability_deg * DEG,
        repeatability_mm=cell.robot.repeatability_mm,
    )
    return model_of_lengths(cell.robot.model, Balls(tool, cell.nests, stated_mm)), noise


def seen_by(
    site: Site, pool: Pool, model: ModelStructure, estimate: Array, stated: StatedConditions, noise: Noise
) -> tuple[Array, WorkingZone]:
    """Return the whitened rows of the candidates and the zone, as a model sees them."""
    candidates = visits_of(site, pool.candidates, model, stated, pool.legs)
    zone = visits_of(site, pool.zone, model, stated)
    return (
        rows_of_visits(model, estimate, candidates, noise, readings_in(site)),
        zone_of(model, estimate, zone, noise),
    )


def readings_in(site: Site) -> int:
    """Return the number of readings in each pose: one of every target, or of every leg."""
    return len(LEGS) if site.cell.instrument.declared.measures_lengths else len(site.targets)


def numbers_in(site: Site) -> int:
    """Return how many numbers are measured in each pose: three for a point, one for a length."""
    return readings_in(site) * (1 if site.cell.instrument.declared.measures_lengths else 3)


def visits_of(
    site: Site,
    poses: Sequence[Pose],
    model: ModelStructure,
    stated: StatedConditions,
    legs: Sequence[Legs] = (),
) -> Conditions:
    """Return the conditions of poses in which every target of the block is read, or every leg."""
    robot, many = site.cell.robot, len(legs[0]) if legs else len(site.targets)
    joints = np.repeat(robot.model_angles(np.array([pose.joints_deg for pose in poses])), many, axis=0)
    before = np.repeat(robot.model_angles(_before(poses)), many, axis=0)
    targets = [target for each in legs for target, _ in each] or site.targets * len(poses)
    conditions = conditions_of(model, joints, before, stated, targets)
    if not legs:
        return conditions
    balls = tuple(model.anchors)
    anchor = np.array([balls.index(ball) for each in legs for _, ball in each])
    visit = np.repeat(np.arange(len(poses)), many)
    return replace(conditions, anchor=anchor, anchor_names=balls, visit=visit)


def seconds_to(cell: Cell, pool: Pool, here_deg: Array, which: Sequence[int] | None = None) -> Array:
    """Return the durations (n,) s of the moves from a pose over the approach points to candidates."""
    joints, before = pool.joints(which), pool.before(which)
    here = np.broadcast_to(np.asarray(here_deg, dtype=np.float64), joints.shape)
    speed = cell.robot.speed_deg_s
    return moves_s(cell, here, before, speed) + moves_s(cell, before, joints, speed)


def in_order(cell: Cell, pool: Pool, which: Sequence[int], here_deg: Array) -> list[int]:
    """Order candidates so that the next one is always the nearest in time."""
    left, order = list(which), list[int]()
    while left:
        nearest = left[int(np.argmin(seconds_to(cell, pool, here_deg, left)))]
        left.remove(nearest)
        order.append(nearest)
        here_deg = pool.joints([nearest])[0]
    return order
