"""The path from one pose to the next: straight in joint space, or over the home of the cell.

Controllers drive a joint move with all axes in proportion, so a move is a straight line of joint angles. It is clear
when arm and tool touch nothing at any instant of it (`cell.clearance`). If the straight line is not clear, the path
goes over home. Home is the `home_deg` of the cell file; without one, it is a posture that keeps arm and tool high above
the table. The program draws poses such that the straight moves between them and home are clear, so a path always
exists. A robot that is too low already, parked or after an interruption, may rise from there, but not go lower.
Angles in deg.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from acquisition.cell.cell import Cell
from acquisition.cell.clearance import NEAREST_MM, Clearance, Contact
from acquisition.cell.obstacles import FloorObstacle
from acquisition.cell.workspace import Array, is_allowed, lowest_of
from acquisition.errors import NoClearWay

# How far a robot that is too low may go before it is clear; half of it is its thickness.
LEAVES_WITHIN_MM = 200.0
_POSTURES = 500  # of which the highest is home
_LOOKS = 200  # for where a robot that rises is clear; from there on and before it is proven
_SLACK_MM = 0.5  # by which a robot that rises may seem to sink: read-back is rounded

Joints = tuple[float, ...]


class Transit:
    """The paths between the poses of one cell."""

    def __init__(self, cell: Cell) -> None:
        self._cell = cell
        self._home = home_of(cell)

    def path(self, start_deg: Sequence[float], goal_deg: Sequence[float]) -> list[Joints]:
        """Return the poses to go to, one after the other; `goal_deg` is the last.

        Raises
        ------
        NoClearWay
            Neither the straight move nor the way over home is clear.
        """
        start, goal = np.array([start_deg]), np.array([goal_deg])
        contact = contacts_on_moves(self._cell, start, goal)[0]
        if contact is None:
            return [tuple(goal_deg)]
        tried = [f"straight, {contact.during}"]
        if self._home is not None:
            home = np.array([self._home])
            legs = (("to home", start, home), ("from home on", home, goal))
            over = [(where, contacts_on_moves(self._cell, one, other)[0]) for where, one, other in legs]
            if all(found is None for _, found in over):
                return [self._home, tuple(goal_deg)]
            tried += [f"{where}, {found.during}" for where, found in over if found is not None]
        shown = self._cell.robot.said(start_deg, 1)
        raise NoClearWay(f"no way from {shown} is clear: {'; '.join(tried)}", command="move")


def home_of(cell: Cell) -> Joints | None:
    """Return the home of a cell, or None if no posture is clear."""
    if cell.robot.home_deg is not None:
        return cell.robot.home_deg
    low, high = np.array(cell.robot.limits_deg).T
    postures = np.round(np.random.default_rng(0).uniform(low, high, (_POSTURES, len(low))), 1)
    postures = postures[is_allowed(cell, postures)]
    if not len(postures):
        return None
    return tuple(float(q) for q in postures[np.argmax(lowest_of(cell, postures))])


def may_visit(cell: Cell, joints_deg: Array, approach_deg: Array) -> NDArray[np.bool_]:
    """Check which poses and approach points, both (n, N), are within the limits and clear.

    The moves between them and home must be clear as well.
    """
    good = is_allowed(cell, joints_deg) & is_allowed(cell, approach_deg)
    home = home_of(cell)
    if home is None:
        return good
    joints, approach = joints_deg[good], approach_deg[good]
    homes = np.broadcast_to(home, joints.shape)
    starts, goals = np.vstack([homes, approach, joints]), np.vstack([approach, joints, homes])
    clear = cell.clearance.clear_between(starts, goals)
    good[good] = clear.reshape(3, -1).all(axis=0)
    return good


def clear_moves(cell: Cell, start_deg: Array, goal_deg: Array) -> NDArray[np.bool_]:
    """Check that the straight moves from (n, N) to (n, N) are clear, both ends included."""
    return np.array([contact is None for contact in contacts_on_moves(cell, start_deg, goal_deg)], dtype=bool)


def contacts_on_moves(cell: Cell, start_deg: Array, goal_deg: Array) -> list[Contact | None]:
    """Return the contacts of straight moves from (n, N) to (n, N).

    A move that is clear, or that rises from the table, has None.
    """
    found = cell.clearance.contacts(start_deg, goal_deg)
    for i, contact in enumerate(found):
        if contact is not None and contact.share == 0.0 and _rises(cell.clearance, start_deg[i], goal_deg[i]):
            found[i] = None
    return found


def _rises(room: Clearance, start: Array, goal: Array) -> bool:
    """Check whether a move only rises a little from a pose that is too low, and then is clear.

    The rise must be small, because farther on the surroundings of the arm are not known.
    """
    share = np.linspace(0.0, 1.0, _LOOKS)
    path = start + share[:, None] * (goal - start)
    clear = np.flatnonzero(room.clear_at(path))
    if not len(clear):
        return False
    out = path[: clear[0] + 1]
    lines = room.arm.lines(out)
    gone = float(np.linalg.norm(lines - lines[:1], axis=3).max())
    bend = float(room.arm.bends(start[None], goal[None]).max()) * share[1] ** 2 / 8.0
    if gone + bend > LEAVES_WITHIN_MM:
        return False
    first = _not_lower(room, lines[0]).clear_between(out[:1], out[-1:])
    return bool(first[0] and room.clear_between(out[-1:], goal[None])[0])


def _not_lower(room: Clearance, lines: Array) -> Clearance:
    """Return the clearance with a lower table for the parts of the arm that are too low now.

    `lines` (c, 2, 3) are those of the arm; each such part has the table at its present height.
    """
    bottom = lines[:, :, 2].min(axis=1) - room.arm.radii - NEAREST_MM - _SLACK_MM
    is_table = np.array([isinstance(obstacle, FloorObstacle) for obstacle in room.obstacles])
    heights = [obstacle.z_mm for obstacle in room.obstacles if isinstance(obstacle, FloorObstacle)]
    floors = [FloorObstacle(min(*heights, float(z))) for z in bottom]
    others = [obstacle for obstacle in room.obstacles if not isinstance(obstacle, FloorObstacle)]
    own = np.diag(room.pairs[:, is_table].all(axis=1))
    return Clearance(room.arm, (*others, *floors), np.hstack([room.pairs[:, ~is_table], own]))
