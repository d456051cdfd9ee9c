"""Fixtures that carry a ball of the base, its cup or its post: they are where the ball is. Lengths mm."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from acquisition.cell.cell import Cell
from acquisition.cell.obstacles import Array, Box, Obstacle, Post
from calib.text import Vector

CARRIES_MM = 30.0  # a fixture that comes so near to the centre of a ball carries it


def carries(fixture: Obstacle, balls: Array) -> bool:
    """Whether a fixture carries one of the balls (n, 3)."""
    points = np.repeat(balls[:, None], 2, axis=1)
    return bool((np.linalg.norm(fixture.towards(points), axis=1) < CARRIES_MM).any())


def moved(fixture: Obstacle, pose: Array) -> Obstacle:
    """A post where the motion (4, 4) takes it; a box becomes the upright box about its corners."""
    if isinstance(fixture, Post):
        start, end = taken(np.array([fixture.from_mm, fixture.to_mm]), pose)
        return replace(fixture, from_mm=point(start), to_mm=point(end))
    if isinstance(fixture, Box):
        corners = np.array(np.meshgrid(*zip(fixture.low_mm, fixture.high_mm, strict=True))).reshape(3, -1).T
        there = taken(corners, pose)
        return replace(fixture, low_mm=point(there.min(axis=0)), high_mm=point(there.max(axis=0)))
    return fixture


def with_nests(cell: Cell, nests_mm: Mapping[str, Vector]) -> Cell:
    """The cell with some of its nests elsewhere, each with the fixtures that carry it."""
    fixtures = list(cell.fixtures)
    for name, place in nests_mm.items():
        pose = np.eye(4)
        pose[:3, 3] = np.subtract(place, cell.nests[name])
        ball = np.array([cell.nests[name]])
        fixtures = [
            moved(now, pose) if carries(was, ball) else now
            for was, now in zip(cell.fixtures, fixtures, strict=True)
        ]
    return replace(cell, nests={**cell.nests, **nests_mm}, fixtures=tuple(fixtures))


def taken(points: Array, pose: Array) -> Array:
    """Points (n, 3) where the motion (4, 4) takes them."""
    return points @ pose[:3, :3].T + pose[:3, 3]


def point(place: Array) -> Vector:
    """A place (3,) as a cell has it, to a tenth of a micrometre."""
    x, y, z = (round(float(c), 4) for c in place)
    return x, y, z
