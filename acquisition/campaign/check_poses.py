"""Poses from which the check poses of a watch are chosen: random poses, stances and touches.

Random poses are for points, stances for a ballbar, touches for balls. Each pose is within the limits and clear, with
the side from which every joint arrives. If a pose is also visited from the opposite side, both approach points are
clear. Angles in deg.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from acquisition.campaign.blocks.block import DECIMALS, Approach, Site
from acquisition.campaign.blocks.hexapod import HexapodBlock
from acquisition.campaign.poses import Pose, draw_poses
from acquisition.cell.cell import Cell
from acquisition.cell.reach import configurations
from acquisition.cell.transit import may_visit
from acquisition.cell.workspace import Array
from calib.arm import forward
from drivers.errors import ConfigError

Read = tuple[tuple[str, str], ...]
"""Targets that are read in a pose, each with the ball on the base to which it has its distance or which it touches."""

_FRUITLESS = 20  # batches of touches without a pose that is clear


@dataclass(frozen=True)
class ApproachRule:
    """The arrival at poses.

    Attributes
    ----------
    offset_deg
        Length of the last move, deg.
    both
        Whether the side is drawn for each joint; otherwise all joints arrive from below.
    opposite
        Whether the opposite sides must be clear too.
    """

    offset_deg: float
    both: bool
    opposite: bool = False

    def sides(self, shape: tuple[int, int], rng: np.random.Generator) -> NDArray[np.int64]:
        """Draw the sides of approach, shape (n, N)."""
        return rng.choice((-1, 1), size=shape) if self.both else np.ones(shape, dtype=np.int64)

    def good(self, cell: Cell, joints: Array, sides: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Check which poses (n, N) may be visited with these sides."""
        found = may_visit(cell, joints, joints - sides * self.offset_deg)
        if self.opposite:
            found[found] = may_visit(cell, joints[found], (joints + sides * self.offset_deg)[found])
        return found


def drawn_poses(
    cell: Cell,
    most: int,
    fewest: int,
    targets: Sequence[str],
    arrival: ApproachRule,
    rng: np.random.Generator,
) -> tuple[list[Pose], list[Read]]:
    """Draw between `fewest` and `most` random poses, at each of which all targets are read.

    Raises
    ------
    ConfigError
        Fewer than `fewest` poses are clear.
    """
    found = draw_poses(
        cell,
        most,
        rng,
        -arrival.offset_deg,
        both=arrival.both,
        decimals=DECIMALS,
        targets=targets,
        fewest=fewest,
    )
    if arrival.opposite:
        joints = np.array([pose.joints_deg for pose in found])
        good = arrival.good(cell, joints, np.array([pose.sides for pose in found]))
        found = [pose for pose, is_good in zip(found, good, strict=True) if is_good]
    if len(found) < fewest:
        raise ConfigError(f"only {len(found)} random poses are clear from both sides; {fewest} are needed")
    return found, [tuple((name, "") for name in targets)] * len(found)


def stance_poses(
    cell: Cell, draws: int, arrival: ApproachRule, rng: np.random.Generator
) -> tuple[list[Pose], list[Read]]:
    """Return every stance of the cell's ballbar between its first three balls and targets.

    Each stance comes in every branch and, if `arrival.both`, with `draws` choices of sides.

    Raises
    ------
    ConfigError
        The arm reaches no stance.
    """
    targets = tuple(cell.tool.targets)[:3]
    site = Site(cell, 0, 0, targets, Approach(offset_deg=-arrival.offset_deg))
    every = HexapodBlock(kind="hexapod", stages=1, configurations="all").visits_at(site)
    times = draws if arrival.both else 1
    joints = np.repeat([visit.joints_deg for visit in every], times, axis=0)
    sides = arrival.sides(joints.shape, rng)
    good = arrival.good(cell, joints, sides)
    reads: list[Read] = [tuple(visit.distances) for visit in every for _ in range(times)]
    return _poses(joints, sides, arrival, good), [reads[i] for i in np.flatnonzero(good)]


def touch_poses(
    cell: Cell, most: int, target: str, balls: Sequence[str], arrival: ApproachRule, rng: np.random.Generator
) -> tuple[list[Pose], list[Read]]:
    """Draw poses in which a target of the tool sits in the balls of the cell.

    The tool has any orientation; the balls take turns.

    Raises
    ------
    ConfigError
        The arm does not reach a ball.
    """
    robot = cell.robot.model
    limits = np.array(cell.robot.limits_deg).T
    tool = np.array(cell.tool.targets[target])
    joints: list[Array] = []
    reads: list[Read] = []
    for name in balls:
        found: list[Array] = []
        for _ in range(_FRUITLESS):
            flange = forward(
                robot, cell.robot.model_angles(rng.uniform(*limits, size=(200, limits.shape[1])))
            )
            flange[:, :3, 3] = np.array(cell.nests[name]) - flange[:, :3, :3] @ tool
            some = np.round(configurations(cell, flange).reshape(-1, robot.joints), DECIMALS)
            some = some[np.all(np.isfinite(some), axis=1)]
            found += list(some[cell.clearance.clear_at(some)] if len(some) else some)
            if len(found) * len(balls) >= 2 * most:
                break
        if not found:
            raise ConfigError(
                f"the arm reaches no clear pose in which {target} sits in {name}; move the ball"
            )
        joints += found[: 2 * most // len(balls)]
        reads += [((target, name),)] * len(found[: 2 * most // len(balls)])
    every = np.array(joints)
    sides = arrival.sides(every.shape, rng)
    good = arrival.good(cell, every, sides)
    return _poses(every, sides, arrival, good), [reads[i] for i in np.flatnonzero(good)]


def _poses(
    joints: Array, sides: NDArray[np.int64], arrival: ApproachRule, good: NDArray[np.bool_]
) -> list[Pose]:
    return [
        Pose(tuple(float(q) for q in pose), tuple(int(s) for s in side), arrival.offset_deg)
        for pose, side in zip(joints[good], sides[good], strict=True)
    ]
