"""The clearance of straight moves in joint space from all obstacles, at every instant.

A move is halved until each piece is proven clear or found touching. At the middle of a piece the nearest points of a
capsule and an obstacle give a direction n. The obstacle reaches up to a plane across n and no farther. The ends of the
capsule lie above that plane at both ends of the piece, and in between at most by its bend (`cell.arm`) lower:

    min over ends and both instants of n.p - bend w^2 / 8 - radius - reach(n) >= 0  =>  clear over the whole piece.

No instant is left out, and the result does not depend on a step size. A move that passes by `NEAREST_MM` or more is
found clear; one that comes nearer is refused. Angles deg, lengths mm.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from acquisition.cell.arm import CellArm
from acquisition.cell.obstacles import Array, Obstacle, Post
from calib.units import percent

NEAREST_MM = 1.0  # anything nearer counts as touching
_AT_ONCE = 256  # moves, to bound the memory
_STILL_MM = 1e-6  # anything that moves less is at rest: a foot that turns about its own axis
_STANCES = 16  # of joints 1 and 2 each
_HALVINGS = 24  # then a piece is micrometres long; an undecided piece counts as touching

Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Contact:
    """A contact of a part of the arm with an obstacle during a move.

    `share` is the share of the move at which it occurs, `depth_mm` its minimum depth, mm.
    """

    part: str
    obstacle: str
    share: float
    depth_mm: float

    def __str__(self) -> str:
        return f"{self.part} comes {max(self.depth_mm, 0.0):.0f} mm into {self.obstacle}"

    @property
    def during(self) -> str:
        """The contact as text, for a move."""
        return f"{self} at {percent(self.share)} of the move"


@dataclass(frozen=True)
class Clearance:
    """The clearance of an arm from its obstacles.

    `pairs` (c, o) states whether capsule i must keep clear of obstacle j.
    """

    arm: CellArm
    obstacles: tuple[Obstacle, ...]
    pairs: Mask

    @classmethod
    def of(cls, arm: CellArm, obstacles: Sequence[Obstacle]) -> Clearance:
        """Return the clearance of all pairs that may not touch.

        Pairs of the mounting are excluded; the links from the elbow on must also keep clear of the robot's own foot. An
        obstacle counts as the mounting if a part of the first two links touches it at all angles of joints 1 and 2,
        over the whole range of the robot. It is then the table, foot or box on which or in which the robot is mounted.
        """
        pairs = np.ones((len(arm.capsules), len(obstacles)), dtype=bool)
        everything = cls(arm, tuple(obstacles), pairs)
        lines = arm.lines(_stances(arm))
        touching = everything.distances(lines) < NEAREST_MM
        near = (arm.links <= 2)[:, None]
        still = np.ptp(lines, axis=0).max(axis=(1, 2)) < _STILL_MM
        feet = tuple(
            Post.model_construct(  # which may be thinner than one of a cell file
                name=f"the robot's own {capsule.name}",
                from_mm=tuple(ends[0]),
                to_mm=tuple(ends[1]),
                radius_mm=capsule.radius_mm,
            )
            for capsule, ends, stays in zip(arm.capsules, lines[0].tolist(), still, strict=True)
            if stays
        )
        pairs = np.hstack([~(touching.all(axis=0) & near), np.repeat(~near, len(feet), axis=1)])
        return cls(arm, (*obstacles, *feet), pairs)

    def distances(self, lines: Array) -> Array:
        """Compute the distances (n, c, o), mm, between capsules and obstacles.

        The capsules have centre lines (n, c, 2, 3). Pairs that may touch have the distance inf.
        """
        out = np.full((*lines.shape[:2], len(self.obstacles)), np.inf)
        for o, obstacle in enumerate(self.obstacles):
            which = self.pairs[:, o]
            flat = lines[:, which].reshape(-1, 2, 3)
            apart = np.linalg.norm(obstacle.towards(flat), axis=1)
            out[:, which, o] = apart.reshape(len(lines), int(which.sum())) - self.arm.radii[which]
        return out

    def at(self, joints_deg: Array) -> list[Contact | None]:
        """Return the deepest contact of each posture (n, N)."""
        if not len(joints_deg):
            return []
        apart = self.distances(self.arm.lines(joints_deg))
        flat = apart.reshape(len(apart), -1)
        deepest = np.argmin(flat, axis=1)
        return [
            self._contact(*divmod(int(i), len(self.obstacles)), 0.0, float(row[i]))
            if row[i] < NEAREST_MM
            else None
            for row, i in zip(flat, deepest, strict=True)
        ]

    def clear_at(self, joints_deg: Array) -> Mask:
        """Check that nothing touches in postures (n, N), mask (n,)."""
        apart = self.distances(self.arm.lines(joints_deg))
        return np.all(apart >= NEAREST_MM, axis=(1, 2))

    def clear_between(self, start_deg: Array, goal_deg: Array) -> Mask:
        """Check that the straight moves from (n, N) to (n, N) are clear, both ends included."""
        return np.array([contact is None for contact in self.contacts(start_deg, goal_deg)], dtype=bool)

    def contacts(self, start_deg: Array, goal_deg: Array) -> list[Contact | None]:
        """Return a contact of each straight move from (n, N) to (n, N), or None if it is clear.

        Both ends are included.
        """
        out: list[Contact | None] = []
        for i in range(0, len(start_deg), _AT_ONCE):
            some = slice(i, i + _AT_ONCE)
            out += self._contacts(np.asarray(start_deg[some]), np.asarray(goal_deg[some]))
        return out

    def _contacts(self, start: Array, goal: Array) -> list[Contact | None]:
        found = self.at(start)
        for i, contact in enumerate(self.at(goal)):
            if found[i] is None and contact is not None:
                found[i] = replace(contact, share=1.0)
        pieces = _Pieces.whole(self, start, goal, [i for i, contact in enumerate(found) if contact is None])
        bends = self.arm.bends(start, goal)
        for halving in range(_HALVINGS):
            if not len(pieces.move):
                break
            share = pieces.begins + 0.5 ** (halving + 1)
            at = start[pieces.move] + share[:, None] * (goal - start)[pieces.move]
            middle = self.arm.lines(at)
            slack = bends[pieces.move] * 0.25 ** (halving + 1) / 8.0
            left, right, touching = self._halves(pieces, middle, slack)
            for piece, capsule, obstacle, apart in touching:
                found[pieces.move[piece]] = self._contact(capsule, obstacle, float(share[piece]), apart)
            alive = np.array([found[move] is None for move in pieces.move])
            pieces = pieces.halved(middle, share, left & alive[:, None, None], right & alive[:, None, None])
        for piece, move in enumerate(pieces.move):
            capsule, obstacle = np.argwhere(pieces.open[piece])[0]
            found[move] = self._contact(int(capsule), int(obstacle), float(pieces.begins[piece]), 0.0)
        return found

    def _halves(
        self, pieces: _Pieces, middle: Array, slack: Array
    ) -> tuple[Mask, Mask, list[tuple[int, int, int, float]]]:
        """Return the pairs that are still open in each half, and those that touch in the middle."""
        left, right = np.zeros_like(pieces.open), np.zeros_like(pieces.open)
        touching: list[tuple[int, int, int, float]] = []
        for o, obstacle in enumerate(self.obstacles):
            piece, capsule = np.nonzero(pieces.open[:, :, o])
            if not len(piece):
                continue
            lines, radius = middle[piece, capsule], self.arm.radii[capsule]
            towards = obstacle.towards(lines)
            length = np.linalg.norm(towards, axis=1)
            apart = length - radius
            for i in np.flatnonzero(apart < NEAREST_MM).tolist():
                touching.append((int(piece[i]), int(capsule[i]), o, float(apart[i])))
            across = towards / np.maximum(length, 1e-9)[:, None]
            level = obstacle.reach(across) + radius + slack[piece, capsule]
            here = _lowest(lines, across)
            left[piece, capsule, o] = np.minimum(here, _lowest(pieces.first[piece, capsule], across)) < level
            right[piece, capsule, o] = np.minimum(here, _lowest(pieces.last[piece, capsule], across)) < level
        return left, right, touching

    def _contact(self, capsule: int, obstacle: int, share: float, apart_mm: float) -> Contact:
        part, what = self.arm.capsules[capsule].name, self.obstacles[obstacle].name
        return Contact(part, what, share, -apart_mm)


@dataclass(frozen=True)
class _Pieces:
    """Pieces of moves, all of one length, with the pairs that are not yet decided.

    `move` and `begins` (k,) state the move and the share at which the piece begins; `first` and `last` (k, c, 2, 3) are
    the lines of the arm at both ends, mm. `open` (k, c, o) marks the undecided pairs.
    """

    move: NDArray[np.int64]
    begins: Array
    first: Array
    last: Array
    open: Mask

    @classmethod
    def whole(cls, room: Clearance, start: Array, goal: Array, moves: Sequence[int]) -> _Pieces:
        move = np.array(moves, dtype=np.int64)
        first, last = room.arm.lines(start[move]), room.arm.lines(goal[move])
        return cls(move, np.zeros(len(move)), first, last, np.repeat(room.pairs[None], len(move), axis=0))

    def halved(self, middle: Array, share: Array, left: Mask, right: Mask) -> _Pieces:
        """Return the halves that have open pairs."""
        one, two = (np.any(half, axis=(1, 2)) for half in (left, right))
        return _Pieces(
            np.concatenate([self.move[one], self.move[two]]),
            np.concatenate([self.begins[one], share[two]]),
            np.concatenate([self.first[one], middle[two]]),
            np.concatenate([middle[one], self.last[two]]),
            np.concatenate([left[one], right[two]]),
        )


def _lowest(lines: Array, across: Array) -> Array:
    """Compute the lower end (p,), mm, of each line (p, 2, 3) along its direction (p, 3)."""
    return np.einsum("pkj,pj->pk", lines, across).min(axis=1)


def _stances(arm: CellArm) -> Array:
    """Return postures (n, N), deg, with joints 1 and 2 over the whole range of the robot.

    The other joints are at zero.
    """
    robot = arm.robot
    first, second = (
        np.linspace(robot.lower[j], robot.upper[j], _STANCES) / robot.joint_units[j] for j in (0, 1)
    )
    out = np.zeros((_STANCES**2, robot.joints))
    out[:, 0], out[:, 1] = (grid.ravel() for grid in np.meshgrid(first, second))
    return out
