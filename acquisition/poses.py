"""Random poses of a cell: uniform within its joint limits, arm and tool clear, approach point included.

The sides of approach are drawn before the pose is judged, independently of it and of each other, or are the
same on every joint. Angles deg.
"""

from __future__ import annotations

import numpy as np

from acquisition.cell import Cell
from acquisition.workspace import above_table, outside_boxes, points_of_arm
from drivers.errors import ConfigError

_BATCH = 500
_BATCHES = 200  # give up after 100,000 candidates

Pose = tuple[tuple[float, ...], tuple[int, ...]]


def draw_poses(
    cell: Cell, count: int, rng: np.random.Generator, offset_deg: float, *, both: bool, decimals: int = 4
) -> list[Pose]:
    """`count` pairs of joint angles (deg) and sides of approach (+1 from below, -1 from above).

    offset_deg: signed offset of the approach point; its sign is the side where not `both`. Pose and approach
    point q - side x |offset| are within the limits and clear of table and boxes. Raises ConfigError when the
    cell leaves hardly any such pose.
    """
    low, high = np.array(cell.robot.limits_deg).T
    reach = abs(offset_deg)
    if np.any(high - low <= 2.0 * reach):
        raise ConfigError(
            f"joint {int(np.argmin(high - low)) + 1}: the limits leave no room for an approach of {reach:g} deg"
        )
    found: list[Pose] = []
    for _ in range(_BATCHES):
        shape = (_BATCH, len(low))
        sides = rng.choice((-1, 1), size=shape) if both else np.full(shape, 1 if offset_deg < 0 else -1)
        # The approach point of a joint moves the range on that side only.
        least, most = low + reach * (sides > 0), high - reach * (sides < 0)
        joints = np.round(rng.uniform(least, most), decimals)
        clear = np.ones(_BATCH, dtype=bool)
        for stand in (joints, joints - sides * reach):
            points = points_of_arm(cell, stand)
            clear &= above_table(cell, points) & outside_boxes(cell, points)
            clear &= np.all((stand >= low) & (stand <= high), axis=1)  # rounding may have left them
        chosen = np.flatnonzero(clear)[: count - len(found)]
        found += [(tuple(float(q) for q in joints[i]), tuple(int(side) for side in sides[i])) for i in chosen]
        if len(found) == count:
            return found
    raise ConfigError(
        f"only {len(found)} of {_BATCH * _BATCHES} random poses clear the table and the keep-out boxes; "
        f"{count} are needed"
    )
