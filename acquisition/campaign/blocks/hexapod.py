"""Blocks of `kind = "hexapod"`: the tool on six ballbar legs between base and tool balls.

Every pose gives six distances between three balls on the base and three on the tool, and with them the position and
orientation of the tool. The poses are all stances of the balls (`calib.arm.hexapod`) that the arm reaches within the
limits, including the approach point. All legs lie on the side away from the flange. Stances whose leg labels agree
follow one another, and between two consecutive legs one end of the bar stays in place.

A stance is taken in its first branch of the arm (`one`), in each (`all`), or the branches alternate (`mixed`, as the
thesis mixes flip and noflip); the block may restrict the branches. A validation pose is never one to which an earlier
block fits, and comes from another stance if possible. A robot misses by millimetres, the stroke of the bar is one.
With `stages = 2`, the legs outside the stroke are therefore measured after a calibration from those inside
(`run.ballbar.second_stage`). Source: Nubiola, thesis, sections 4.2 to 4.4.
"""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator

from acquisition.campaign.blocks.block import DECIMALS, Balls, Block, BlockVisit, Set, Site, Stages
from acquisition.cell.reach import configurations
from acquisition.cell.transit import may_visit
from acquisition.cell.workspace import Array
from acquisition.file_table import Once, Text, refused, told
from calib.arm import BRANCHES, LEGS, forward, stances_among
from calib.errors import DataError
from drivers.errors import ConfigError

_SAME_MM = 0.05  # entries of two flange poses that are one stance
_ONE_END = ((2, 0), (0, 0), (0, 1), (1, 1), (1, 0), (1, 2))
"""The legs of a design (`calib.arm.hexapod.LEGS`) in an order in which a person moves one end of the bar at a time."""
_ORDER = tuple(LEGS.index(leg) for leg in _ONE_END)


def _known(branches: tuple[str, ...]) -> tuple[str, ...]:
    for name in branches:
        if not any(branch == name or branch.startswith(f"{name}/") for branch in BRANCHES):
            do = f"Name branches of the arm, or what they begin with: {', '.join(BRANCHES)}."
            raise refused("", f"names {name!r}.", do)
    return branches


class HexapodBlock(Block):
    """A block in which the tool stands on six ballbar legs."""

    of_lengths: ClassVar[bool] = True

    kind: Annotated[Literal["hexapod"], told("The kind of block.", "hexapod")]
    set: Set = "calibration"
    base: Balls = None
    count: Annotated[
        int | None, told("Number of stances at most; left out: all.", 48, ge=1, le=1_000_000)
    ] = None
    stages: Stages = 2
    configurations: Annotated[
        Literal["one", "mixed", "all"],
        told("Stances in one, in every, or in one after the other configuration of the arm.", "one"),
    ] = "one"
    branches: Annotated[
        Annotated[Once[Text], AfterValidator(_known)] | None,
        told("Branches of the arm that are used; left out: all.", ["front/up", "back/down/flip"]),
    ] = None

    def visits_at(self, site: Site) -> list[BlockVisit]:
        base = self.base or tuple(site.cell.nests)[:3]
        if len(set(base)) < 3 or len(site.targets) != 3 or not set(base) <= set(site.cell.nests):
            raise ConfigError(
                f"block {site.number + 1}: a hexapod lies between three balls of world.nests and three targets, "
                f"not {', '.join(base)} and {', '.join(site.targets)}",
                what_to_do="Name three cups in base and three balls of the tool in targets.",
            )
        cell = site.cell
        tool = np.array([cell.tool.targets[name] for name in site.targets])
        try:
            found = stances_among(
                np.array([cell.nests[name] for name in base]), tool, cell.instrument.nominal_mm
            )
            flange = found.flange[found.outward]
            joints = configurations(cell, flange)
        except (DataError, ValueError) as error:
            raise ConfigError(
                f"block {site.number + 1}: {error}",
                what_to_do="Correct the positions of the balls in the cell file.",
            ) from error
        which, joints = self._allowed(site, joints, flange)
        if not len(which):
            raise ConfigError(
                f"block {site.number + 1}: the arm reaches no stance of the legs between {', '.join(base)} and "
                f"{', '.join(site.targets)}{self._within()}",
                what_to_do="Move the balls, or widen limits_deg.",
            )
        legs = list(zip(found.base[found.outward][which], found.tool[found.outward][which], strict=True))
        sides = site.sides()
        return [
            site.visit(
                f"hexapod pose {i}",
                tuple(float(q) for q in pose),
                sides,
                [(site.targets[leg[1][k]], base[leg[0][k]]) for k in _ORDER],
            )
            for i, (pose, leg) in enumerate(zip(joints, legs, strict=True), start=1)
        ]

    def _within(self) -> str:
        return "" if self.branches is None else f" in {' or '.join(self.branches)}"

    def _allowed(self, site: Site, joints_deg: Array, flange: Array) -> tuple[NDArray[np.int64], Array]:
        """Select the configurations that may be driven.

        Takes configurations (n, 8, N), deg, at flange poses (n, 4, 4). Returns the stance (k,) and the joints (k, N),
        deg, of each selected configuration.
        """
        n, branches, axes = joints_deg.shape
        flat = np.round(joints_deg.reshape(-1, axes), DECIMALS)
        approach = flat - abs(site.approach.offset_deg) * np.array(site.sides())
        good = np.all(np.isfinite(flat), axis=1)
        good[good] = may_visit(site.cell, flat[good], approach[good])
        good = good.reshape(n, branches)
        if self.branches is not None:
            good &= np.array([name.startswith(self.branches) for name in BRANCHES])
        fresh = np.ones(n, dtype=bool)
        if site.taken:
            good &= ~np.any(
                np.all(flat.reshape(n, branches, 1, axes) == np.array(site.taken), axis=3), axis=2
            )
            robot = site.cell.robot
            there = forward(robot.model, robot.model_angles(site.taken))
            fresh = ~np.any(np.all(np.abs(flange[:, None] - there) < _SAME_MM, axis=(2, 3)), axis=1)
        if self.configurations == "one":
            good &= np.cumsum(good, axis=1) == 1  # the first of every stance
        elif self.configurations == "mixed":
            good = _in_turn(good)
        which, branch = np.nonzero(good)
        if self.count is not None and self.count < len(which):
            some = _spread(np.flatnonzero(fresh[which]), self.count)
            some = np.union1d(some, _spread(np.flatnonzero(~fresh[which]), self.count - len(some)))
            which, branch = which[some], branch[some]
        return which, np.round(joints_deg[which, branch], DECIMALS)


def _in_turn(good: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Select one branch of every stance, mask (n, b): the branch that was selected least so far."""
    taken = np.zeros(good.shape[1], dtype=np.int64)
    out = np.zeros_like(good)
    for i in np.flatnonzero(good.any(axis=1)):
        branch = int(np.argmin(np.where(good[i], taken, len(good))))
        out[i, branch], taken[branch] = True, taken[branch] + 1
    return out


def _spread(some: NDArray[np.int64], count: int) -> NDArray[np.int64]:
    """Select at most `count` of the poses, evenly spread."""
    if count >= len(some):
        return some
    return some[np.round(np.linspace(0, len(some) - 1, count)).astype(int)]
