"""The way from one stand to the next: straight in joint space where that is clear, else over the home of the cell.

Controllers drive a joint move with all axes in proportion, so the way is a straight line of joint angles. It is
looked at every few degrees of the widest joint: no part of arm or tool (`acquisition.workspace`) below the table or in
a keep-out box. Home is the `home_deg` of the cell file, or else a posture that keeps arm and tool high above the table.
Poses that the program draws are such that the straight ways between them and home are clear, so there always is one. A
robot that stands too low already, parked or after an interruption, may rise from there, but not go lower. Angles deg.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from acquisition.cell import Cell
from acquisition.errors import NoClearWay
from acquisition.workspace import Array, may_stand, outside_boxes, points_of_arm

LEAVES_WITHIN_MM = 100.0  # that a robot which stands too low may go before it is clear
STEP_DEG, STEP_BY_BOXES_DEG = 4.0, 2.0
"""Between two looks a turning arm sags by less than a millimetre towards a table, but may pass a thin box."""
_POSTURES = 500  # of which the highest is home
_AT_ONCE = 64  # ways, to bound the memory
_SLACK_MM = 0.5  # by which a robot that rises may seem to sink: read-back is rounded

Joints = tuple[float, ...]


class Transit:
    """Ways of one cell."""

    def __init__(self, cell: Cell) -> None:
        self._cell = cell
        self._home = home_of(cell)

    def way(self, start_deg: Sequence[float], goal_deg: Sequence[float]) -> list[Joints]:
        """Where to go one after the other; `goal_deg` comes last. Raises NoClearWay."""
        start, goal = np.array([start_deg]), np.array([goal_deg])
        if clear_ways(self._cell, start, goal)[0]:
            return [tuple(goal_deg)]
        if self._home is not None:
            home = np.array([self._home])
            if clear_ways(self._cell, np.vstack([start, home]), np.vstack([home, goal])).all():
                return [self._home, tuple(goal_deg)]
        shown = ", ".join(f"{q:.1f}" for q in start_deg)
        raise NoClearWay(f"no way from {shown} deg is clear of table and keep-out boxes", command="move")


def home_of(cell: Cell) -> Joints | None:
    """The home of a cell; None where no posture is clear."""
    if cell.robot.home_deg is not None:
        return cell.robot.home_deg
    low, high = np.array(cell.robot.limits_deg).T
    postures = np.round(np.random.default_rng(0).uniform(low, high, (_POSTURES, len(low))), 1)
    postures = postures[may_stand(cell, postures)]
    if not len(postures):
        return None
    lowest = points_of_arm(cell, postures)[:, :, 2].min(axis=1)
    return tuple(float(q) for q in postures[np.argmax(lowest)])


def may_visit(cell: Cell, joints_deg: Array, approach_deg: Array) -> NDArray[np.bool_]:
    """(n,) stands and their approach points, both (n, N), within limits and clear; so are the ways between and home."""
    good = may_stand(cell, joints_deg) & may_stand(cell, approach_deg)
    home = home_of(cell)
    if home is None:
        return good
    joints, approach = joints_deg[good], approach_deg[good]
    homes = np.broadcast_to(home, joints.shape)
    ways = ((homes, approach), (approach, joints), (joints, homes))
    good[good] = np.all([clear_ways(cell, start, goal) for start, goal in ways], axis=0)
    return good


def clear_ways(cell: Cell, start_deg: Array, goal_deg: Array) -> NDArray[np.bool_]:
    """(n,) whether the straight ways from (n, N) to (n, N) are clear, both ends included."""
    parts = range(0, len(start_deg), _AT_ONCE)
    done = [_clear_ways(cell, start_deg[i : i + _AT_ONCE], goal_deg[i : i + _AT_ONCE]) for i in parts]
    return np.concatenate(done) if done else np.zeros(0, dtype=bool)


def _clear_ways(cell: Cell, start_deg: Array, goal_deg: Array) -> NDArray[np.bool_]:
    widest = float(np.abs(goal_deg - start_deg).max(initial=0.0))
    step = STEP_BY_BOXES_DEG if cell.robot.keep_out_mm else STEP_DEG
    share = np.linspace(0.0, 1.0, 2 + int(widest / step))
    path = start_deg[:, None] + share[None, :, None] * (goal_deg - start_deg)[:, None]
    points = points_of_arm(cell, path.reshape(-1, path.shape[2]))
    low = points[:, :, 2].min(axis=1).reshape(path.shape[:2])
    outside = outside_boxes(cell, points).reshape(path.shape[:2])
    clear = (low > cell.robot.table_z_mm) & outside
    # Out of what is too low the arm may only rise, and only a little: farther on nobody knows what stands beside it.
    before = np.cumsum(clear, axis=1) == 0
    rises = np.diff(low, axis=1, prepend=low[:, :1]) >= -_SLACK_MM
    placed = points.reshape(*path.shape[:2], -1, 3)
    gone = np.linalg.norm(placed - placed[:, :1], axis=3).max(axis=2)
    leaves = before & outside & rises & (gone <= LEAVES_WITHIN_MM)
    return np.all(clear | leaves, axis=1) & clear[:, -1]
