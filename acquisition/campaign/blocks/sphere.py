"""Blocks of `kind = "sphere"`: points on a sphere, the ballbar check of a calibrated robot.

The target is in the centre at the taught pose `centre_deg`. The points lie on the sphere above it, with the tool in
the taught orientation. Source: Nubiola 2.6.3, a ballbar of 300 mm in hundreds of places, 2 s pause and no suppression
of backlash. Unless the block has its own `approach`, every point is therefore reached from the one before it, also
after an interruption. Points follow a spiral of equal areas (Swinbank & Purser 2006), sorted into rings so that moves
are short. Lengths in mm.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import PrivateAttr

from acquisition.campaign.blocks.block import DECIMALS, Block, BlockVisit, Joints, Site, Stages, rounded
from acquisition.cell.reach import configurations
from acquisition.cell.transit import may_visit
from acquisition.cell.workspace import facing
from acquisition.errors import as_config_error
from acquisition.file_table import List, Text, told
from calib.arm import forward, nearest_branch
from calib.array import Array
from calib.units import DEG
from drivers.errors import ConfigError

_GOLDEN = np.pi * (3.0 - np.sqrt(5.0))
_MOST = 20  # points tried per required point


class SphereBlock(Block):
    """A block of points on a sphere about a taught centre, to check a calibrated robot."""

    usual_settle_s: ClassVar[float | None] = 2.0

    kind: Annotated[Literal["sphere"], told("The kind of block.", "sphere")]
    set: Annotated[Literal["validation", "calibration"], told("What the readings are for.", "validation")] = (
        "validation"
    )
    centre_deg: Annotated[
        List[float],
        told(
            "Joints at which the target is in the centre, deg.",
            [0.0, 20.0, 0.0, 0.0, 60.0, 0.0],
            missing="Teach the pose at which the target is in the centre.",
        ),
    ]
    radius_mm: Annotated[float, told("Radius, mm.", 300.0, ge=1.0, le=10_000.0)] = 300.0
    count: Annotated[int, told("Number of points.", 100, ge=2, le=10_000)] = 100
    above_deg: Annotated[float, told("Lowest elevation of a point, deg.", 0.0, ge=-89.0, le=89.0)] = 0.0
    base: Annotated[
        Text | None, told("The ball in the centre, for a ballbar as long as the radius.", "N1")
    ] = None
    stages: Stages = 2
    _suppress: bool = PrivateAttr(False)

    def model_post_init(self, _: Any) -> None:
        self._suppress = "approach" in self.model_fields_set  # otherwise it is driven from point to point

    @property
    def lengths(self) -> bool:
        """Whether the block is measured with a ballbar."""
        return self.base is not None

    @property
    def wanted(self) -> int | None:
        return self.count

    def visits_at(self, site: Site) -> list[BlockVisit]:
        if len(site.targets) != 1:
            raise ConfigError(
                f"block {site.number + 1}: a sphere is measured with one target",
                what_to_do="Name it in targets.",
            )
        if self.base is not None and self.base not in site.cell.nests:
            raise ConfigError(
                f"block {site.number + 1}: base = {self.base!r} is none of {', '.join(site.cell.nests)}",
                what_to_do="Name a cup of world.nests of the cell.",
            )
        nominal = float(site.cell.instrument.options.get("nominal_mm", self.radius_mm))
        stroke = site.cell.instrument.declared.stroke_mm or 0.0
        if self.base is not None and abs(self.radius_mm - nominal) > stroke:
            raise ConfigError(
                f"block {site.number + 1}: radius_mm = {self.radius_mm:g}, the ballbar is {nominal:g} mm long",
                what_to_do="Set radius_mm to the length of the bar.",
            )
        poses = self._poses(site)
        sides = site.sides()
        distances = [] if self.base is None else [(site.targets[0], self.base)]
        visits = [site.visit(f"point {i}", pose, sides, distances) for i, pose in poses.items()]
        if self._suppress:
            return visits
        return visits[:1] + [
            replace(visit, sides=_moved(before, visit.joints_deg, sides), approach_deg=before)
            for before, visit in ((a.joints_deg, b) for a, b in pairwise(visits))
        ]

    def _poses(self, site: Site) -> dict[int, Joints]:
        """Select poses evenly among those that the arm and its limits allow; keys are the numbers of the points.

        If the arm reaches fewer than `count`, every point is measured at the nearest place that it reaches, or is left
        out if that place is nearer to another point.

        Raises
        ------
        ConfigError
            The arm reaches no point of the sphere.
        """
        taught = np.array([site.posture("centre_deg", self.centre_deg)])
        found, places = np.zeros((0, taught.shape[1])), np.zeros((0, 3))
        tried = self.count
        while len(found) < self.count and tried <= _MOST * self.count:
            found, places = self._reached(site, taught, cap(tried, self.above_deg))
            tried *= 2
        if not len(found):
            raise ConfigError(
                f"block {site.number + 1}: the arm reaches no point of the sphere",
                what_to_do=f"Teach another centre, raise above_deg, or turn {site.targets[0]} to the instrument.",
            )
        if len(found) >= self.count:
            chosen = np.round(np.linspace(0, len(found) - 1, self.count)).astype(int)
            return {number: rounded(row) for number, row in enumerate(found[chosen], start=1)}
        near = places @ cap(self.count, self.above_deg).T  # (k, count) cosines
        owner, best = np.argmax(near, axis=1), np.argmax(near, axis=0)
        kept = np.flatnonzero(owner[best] == np.arange(self.count))
        return {int(point) + 1: rounded(found[best[point]]) for point in kept}

    def _reached(self, site: Site, taught: Array, directions: Array) -> tuple[Array, Array]:
        """Return the joints (k, N), deg, of the directions that the arm reaches, and these directions (k, 3).

        All are in the branch of the taught pose.
        """
        robot = site.cell.robot
        flange = forward(robot.model, robot.model_angles(taught))
        goals = np.repeat(flange, len(directions), axis=0)
        goals[:, :3, 3] += self.radius_mm * directions
        with as_config_error(f"block {site.number + 1}: "):
            branch = nearest_branch(configurations(site.cell, flange, taught[0]), taught)[0]
            if branch < 0:
                raise ConfigError(
                    f"block {site.number + 1}: centre_deg is outside the limits of the cell",
                    what_to_do="Choose a pose within limits_deg.",
                )
            joints = np.round(configurations(site.cell, goals, taught[0])[:, branch], DECIMALS)
        good = np.all(np.isfinite(joints), axis=1)
        offset = abs(site.approach.offset_deg) * np.array(site.sides()) if self._suppress else 0.0
        known = joints[good]
        good[good] = facing(site.cell, known, site.targets) & may_visit(site.cell, known, known - offset)
        return joints[good], directions[good]


def cap(count: int, above_deg: float) -> Array:
    """Return directions on the unit sphere above an elevation, evenly spread and ring by ring.

    The elevation is in deg, the result has shape (count, 3).
    """
    least = np.sin(above_deg * DEG)
    k = np.arange(count)
    height = 1.0 - (k + 0.5) / count * (1.0 - least)
    turn = (k * _GOLDEN) % (2.0 * np.pi)
    rings = max(1, round(float(np.sqrt(count / np.pi))))
    ring = np.minimum((k * rings) // count, rings - 1)
    order = np.lexsort((np.where(ring % 2, -turn, turn), ring))
    across = np.sqrt(1.0 - height**2)
    return np.column_stack([across * np.cos(turn), across * np.sin(turn), height])[order]


def _moved(before: Joints, after: Joints, usual: tuple[int, ...]) -> tuple[int, ...]:
    """Return the sides from which the joints came; a joint that did not turn has the usual side."""
    turned = np.sign(np.array(after) - np.array(before)).astype(int)
    return tuple(int(turn) or side for turn, side in zip(turned, usual, strict=True))
