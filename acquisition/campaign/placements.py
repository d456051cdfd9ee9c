"""Placements of the base balls of a ballbar hexapod, and the stances reached from each.

The balls move together: they are shifted, and turned about a vertical line through their middle. A survey finds for
every placement the stances that the arm reaches within its limits in each of the eight branches, with arm and tool
clear of everything. A proof of one placement checks more: approach points, straight moves, and that no leg of the
ballbar passes through the arm. Fixtures that carry a ball move with it. Source: Nubiola, thesis, section 4.2.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from acquisition.campaign.blocks.block import DECIMALS
from acquisition.cell.cell import Cell, carries, moved, point, taken, with_places
from acquisition.cell.obstacles import Array, Obstacle, between_lines
from acquisition.cell.reach import configurations
from acquisition.cell.transit import may_visit
from acquisition.cell.workspace import targets_at
from calib.arm import BRANCHES, Stances, stances_among
from calib.selection import Balls, Lengths, uncertainty_of
from calib.units import DEG
from drivers.errors import ConfigError

LEG_RADIUS_MM = 15.0  # half of the thickness of a QC20-W with its bars
_PLACES = 300
_DRAWN = 40_000
_AT_ONCE = 40  # placements, to bound the memory
_WRIST = 5  # links from here on hold the tool, between whose balls the legs end

Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class BallPlacement:
    """A shift, mm, and a turn, deg, of the base balls relative to the cell file."""

    shift_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    turn_deg: float = 0.0

    def pose(self, middle: Array) -> Array:
        """Return the motion in the world, (4, 4); `middle` (3,) mm stays in place under the turn."""
        c, s = np.cos(self.turn_deg * DEG), np.sin(self.turn_deg * DEG)
        pose = np.eye(4)
        pose[:2, :2] = [[c, -s], [s, c]]
        pose[:3, 3] = middle - pose[:3, :3] @ middle + self.shift_mm
        return pose


@dataclass(frozen=True)
class ReachResult:
    """The reach of the arm at a placement.

    The joints (s, 8, N), deg, are those of s stances by branch, NaN if a stance is not reached.
    """

    placement: BallPlacement
    joints_deg: Array

    @property
    def there(self) -> Mask:
        """Whether each stance is reached in each branch, shape (s, 8)."""
        return np.isfinite(self.joints_deg[:, :, 0])

    @property
    def poses(self) -> int:
        """Number of stances that are reached in some branch."""
        return int(self.there.any(axis=1).sum())

    @property
    def configurations(self) -> int:
        """Number of reached pairs of stance and branch."""
        return int(self.there.sum())

    @property
    def by_branch(self) -> dict[str, int]:
        """Number of stances reached in each branch."""
        return dict(zip(BRANCHES, self.there.sum(axis=0).tolist(), strict=True))

    @property
    def by_arm(self) -> dict[str, int]:
        """Configurations by the branch of shoulder and elbow, with either turn of the wrist."""
        out: dict[str, int] = {}
        for name, count in self.by_branch.items():
            arm = name.rpartition("/")[0]
            out[arm] = out.get(arm, 0) + count
        return out


class HexapodSurvey:
    """The ballbar hexapod of a cell for any placement of its base balls, on any three of them.

    Raises
    ------
    ValueError
        The balls carry no tool.
    """

    def __init__(self, cell: Cell, base: Sequence[str], tool: Sequence[str]) -> None:
        self.cell = cell
        self.base = tuple(base)
        self.tool = tuple(tool)
        self._balls = np.array([cell.nests[name] for name in base])
        self._tool = np.array([cell.tool.targets[name] for name in tool])
        found = stances_among(self._balls, self._tool, cell.instrument.nominal_mm)
        out = found.outward
        self.stances = Stances(found.flange[out], found.base[out], found.tool[out], found.outward[out])

    def survey(
        self, placements: Sequence[BallPlacement], progress: Callable[[int], None] = lambda _: None
    ) -> list[ReachResult]:
        """Determine the reach of the arm at each placement.

        `progress` is called with the number of finished placements. Cups are left out here, because they may move with
        the balls; `prove` includes them.

        Raises
        ------
        DataError
            The robot has no inverse kinematics in closed form.
        """
        bare = with_places(self.cell, {}, [f for f in self.cell.fixtures if not self._carries(f)])
        out: list[ReachResult] = []
        for i in range(0, len(placements), _AT_ONCE):
            some = placements[i : i + _AT_ONCE]
            motion = np.stack([each.pose(self._balls.mean(axis=0)) for each in some])
            flange = motion[:, None] @ self.stances.flange
            joints = configurations(bare, flange.reshape(-1, 4, 4))
            joints[~_clear(bare, joints)] = np.nan
            joints = joints.reshape(len(some), -1, *joints.shape[1:])
            out += [ReachResult(each, found) for each, found in zip(some, joints, strict=True)]
            progress(len(out))
        return out

    def prove(self, reached: ReachResult, offset_deg: float) -> ReachResult:
        """Restrict a placement to the configurations that may be driven.

        Their approach points `offset_deg` away and the moves between pose, approach and home are clear, and the legs
        pass by the arm.
        """
        cell = self.moved(reached.placement)
        joints = np.round(reached.joints_deg, DECIMALS)
        which = np.argwhere(reached.there)
        flat = joints[which[:, 0], which[:, 1]]
        good = may_visit(cell, flat, flat - abs(offset_deg))
        good[good] = self._legs_free(cell, flat[good], which[good, 0])
        joints[which[~good, 0], which[~good, 1]] = np.nan
        return replace(reached, joints_deg=joints)

    def uncertainty(self, reached: Sequence[ReachResult], places: Array) -> Array:
        """Predict U of the first tool ball, (p,) mm, at joint angles `places` (p, N) rad.

        The prediction assumes that six legs of every configuration at every placement were measured
        (`calib.selection.uncertainty_of`).
        """
        cell = self.cell
        base: dict[str, tuple[float, float, float]] = {}
        joints, tool, anchors = [], list[str](), list[str]()
        for k, each in enumerate(reached):
            nests = self.moved(each.placement).nests
            base |= {f"{name}.{k}": nests[name] for name in self.base}
            which, branch = np.nonzero(each.there)
            angles = cell.robot.model_angles(each.joints_deg[which, branch])
            joints.append(np.repeat(angles, self.stances.base.shape[1], axis=0))
            tool += [self.tool[t] for t in self.stances.tool[which].ravel()]
            anchors += [f"{self.base[b]}.{k}" for b in self.stances.base[which].ravel()]
        return uncertainty_of(
            cell.robot.model,
            Balls(
                {name: cell.tool.targets[name] for name in self.tool},
                base,
                {name: u for name, u in cell.tool.stated_mm.items() if name in self.tool},
            ),
            Lengths(np.concatenate(joints), tool, anchors),
            places,
            noise_mm=cell.instrument.noise.length_mm,
            repeatability=cell.robot.repeatability_deg * DEG,
            loads=cell.loads,
        )

    def places_in(self, centre_mm: Sequence[float], radius_mm: float) -> Array:
        """Draw postures whose first tool ball lies in a sphere of the world, (p, N) rad.

        They are within the limits.

        Raises
        ------
        ConfigError
            No drawn posture brings the ball into the sphere.
        """
        robot = self.cell.robot
        low, high = np.array(robot.limits_deg).T
        drawn = np.random.default_rng(0).uniform(low, high, (_DRAWN, len(low)))
        at = targets_at(self.cell, drawn)[:, list(self.cell.tool.targets).index(self.tool[0])]
        inside = np.linalg.norm(at - np.asarray(centre_mm), axis=1) <= radius_mm
        if not inside.any():
            raise ConfigError(
                f"none of {_DRAWN} random postures brings {self.tool[0]} within {radius_mm:g} mm of "
                f"{', '.join(f'{x:g}' for x in centre_mm)}",
                what_to_do="Name a zone that the arm reaches.",
            )
        return robot.model_angles(drawn[inside][:_PLACES])

    def moved(self, placement: BallPlacement) -> Cell:
        """Return the cell with its base balls, and the fixtures that carry them, at a placement."""
        pose = placement.pose(self._balls.mean(axis=0))
        balls = taken(self._balls, pose)
        nests = {n: point(p) for n, p in zip(self.base, balls, strict=True)}
        fixtures = [moved(f, pose) if self._carries(f) else f for f in self.cell.fixtures]
        return with_places(self.cell, nests, fixtures)

    def same_balls(self, placement: BallPlacement) -> tuple[tuple[float, ...], ...]:
        """Return the ball positions without regard to their names.

        Placements with equal positions reach the same stances.
        """
        balls = taken(self._balls, placement.pose(self._balls.mean(axis=0)))
        return tuple(sorted(tuple(ball) for ball in np.round(balls, 1).tolist()))

    def _carries(self, fixture: Obstacle) -> bool:
        return carries(fixture, self._balls)

    def _legs_free(self, cell: Cell, joints_deg: Array, stance: NDArray[np.int64]) -> Mask:
        """Check that all six legs of each stance pass by the arm up to its wrist, mask (n,)."""
        arm = cell.clearance.arm
        near = arm.links < _WRIST
        lines = arm.lines(joints_deg)[:, near]
        pose = self._flange_at(cell)[stance]
        balls = np.array([cell.nests[name] for name in self.base])
        ends = np.einsum("nij,nlj->nli", pose[:, :3, :3], self._tool[self.stances.tool[stance]])
        legs = np.stack([balls[self.stances.base[stance]], ends + pose[:, None, :3, 3]], axis=2)
        n, links, count = len(joints_deg), lines.shape[1], legs.shape[1]
        apart = between_lines(
            np.repeat(lines, count, axis=1).reshape(-1, 2, 3),
            np.tile(legs, (1, links, 1, 1)).reshape(-1, 2, 3),
        )
        free = np.linalg.norm(apart, axis=1).reshape(n, links, count) - arm.radii[near][:, None]
        return np.all(free >= LEG_RADIUS_MM, axis=(1, 2))

    def _flange_at(self, cell: Cell) -> Array:
        """Return the flange of every stance, (s, 4, 4), for the base balls of a moved cell."""
        balls = np.array([cell.nests[name] for name in self.base])
        turn = _frame(balls) @ _frame(self._balls).T
        pose = np.eye(4)
        pose[:3, :3] = turn
        pose[:3, 3] = balls[0] - turn @ self._balls[0]
        return pose @ self.stances.flange


def grid(shifts: Sequence[Sequence[float]], turns: Sequence[float]) -> list[BallPlacement]:
    """Return every combination of shifts along x, y, z, mm, and turns, deg.

    The placement of the cell file is always included.
    """
    x, y, z = shifts
    found = [
        BallPlacement((float(a), float(b), float(c)), float(t))
        for t in turns
        for c in z
        for b in y
        for a in x
    ]
    own = BallPlacement()
    return found if own in found else [own, *found]


def best_first(reached: Sequence[ReachResult]) -> list[ReachResult]:
    """Sort the placements by poses, then by configurations, then by nearness to the cell file's."""
    return sorted(
        reached,
        key=lambda r: (
            -r.poses,
            -r.configurations,
            float(np.linalg.norm(r.placement.shift_mm)),
            abs(r.placement.turn_deg),
        ),
    )


def _clear(cell: Cell, joints_deg: Array) -> Mask:
    """Check that arm and tool are clear at joints (n, 8, N); False for branches that are NaN."""
    flat = joints_deg.reshape(-1, joints_deg.shape[2])
    good = np.isfinite(flat[:, 0])
    good[good] = cell.clearance.clear_at(flat[good])
    return good.reshape(joints_deg.shape[:2])


def _frame(balls: Array) -> Array:
    """Return the axes (3, 3) of the frame through three balls (3, 3)."""
    x = balls[1] - balls[0]
    z = np.cross(x, balls[2] - balls[0])
    x, z = x / float(np.linalg.norm(x)), z / float(np.linalg.norm(z))
    return np.asarray(np.column_stack([x, np.cross(z, x), z]), dtype=np.float64)
