"""Random poses of a cell: uniform within its joint limits, arm and tool clear.

The approach point is clear too. The sides of approach are drawn before the pose is judged, independently of it and of
each other, or are the same on every joint. If a longest length is given, the length of the last move is drawn too:
with moves of one length, a lag behind the move looks like backlash. The straight moves from and to the home of the
cell are clear (`cell.transit`). Targets that declare a normal face the instrument at the pose. Joints in deg, or in mm
if they slide; an approach covers as many mm as deg.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from acquisition.cell.cell import Cell
from acquisition.cell.transit import may_visit
from acquisition.cell.workspace import beyond_cone, is_allowed
from calib.arm import forward
from calib.array import Array
from drivers.errors import ConfigError

_BATCH, _LOOKED_AT = 500, 50
_FRUITLESS = 200  # batches: stop after 100,000 random poses without a good one
_MOST = 1000  # batches in all
START_AND_STOP_S = 0.3  # of a move


class Pose(NamedTuple):
    """A pose with its approach.

    `sides` states from where each joint arrives (+1 from below, -1 from above). The last move starts `reach_deg` away
    on every joint.
    """

    joints_deg: tuple[float, ...]
    sides: tuple[int, ...]
    reach_deg: float


def draw_poses(
    cell: Cell,
    most: int,
    rng: np.random.Generator,
    offset_deg: float,
    *,
    both: bool,
    longest_deg: float | None = None,
    decimals: int = 4,
    targets: Sequence[str] | None = None,
    fewest: int | None = None,
    one_target: bool = False,
    within: Callable[[Array], NDArray[np.bool_]] | None = None,
) -> list[Pose]:
    """Draw random poses with their approach.

    Pose and approach point q - side x length are within the limits and clear of table, boxes and fixtures.

    Parameters
    ----------
    most, fewest
        Largest and smallest number of poses. Default of `fewest`: `most`.
    offset_deg
        Signed offset of the approach point; without `both`, its sign is the side.
    both
        Whether the side is drawn for each joint.
    longest_deg
        The length of each approach is drawn between |offset_deg| and this, within the limits. Default: always
        |offset_deg|.
    targets
        Targets that must be visible at the pose. Default: all of the cell.
    one_target
        Whether it is enough if one of them is visible.
    within
        Selects poses by their joint angles (n, N). Default: all.

    Raises
    ------
    ConfigError
        The cell leaves fewer than `fewest` such poses.
    """
    fewest = most if fewest is None else fewest
    targets = tuple(cell.tool.targets) if targets is None else targets
    low, high = np.array(cell.robot.limits_deg).T
    reach = abs(offset_deg)
    if np.any(high - low <= 2.0 * reach):
        tight = int(np.argmin(high - low))
        raise ConfigError(
            f"{cell.robot.named(tight)}: the limits leave no room for an approach of {reach:g} "
            f"{cell.robot.model.units[tight]}",
            what_to_do="Use a smaller offset_deg of the approach, or wider limits_deg.",
        )
    longer = rng.spawn(1)[0]  # separate: poses and sides are the same whether lengths vary or not
    found: list[Pose] = []
    for batch in range(_MOST):
        if len(found) == most or (batch == _FRUITLESS and not found):
            break
        shape = (_BATCH, len(low))
        sides = rng.choice((-1, 1), size=shape) if both else np.full(shape, 1 if offset_deg < 0 else -1)
        # The approach point of a joint moves the range on that side only.
        least, most_deg = low + reach * (sides > 0), high - reach * (sides < 0)
        joints = np.round(rng.uniform(least, most_deg), decimals)
        room = np.min(np.where(sides > 0, joints - low, high - joints), axis=1)
        lengths = np.full(_BATCH, reach)
        if longest_deg is not None:
            drawn = np.minimum(longer.uniform(reach, longest_deg, _BATCH), room)
            # Rounded down, so that the limits hold; the shortest is what it is.
            lengths = np.maximum(np.floor(drawn * 10**decimals) / 10**decimals, reach)
        before = joints - sides * lengths[:, None]
        inside = beyond_cone(cell, joints, targets) >= 0.0
        seen = inside.any(axis=1) if one_target else inside.all(axis=1)
        seen = seen if within is None else seen & within(joints)
        joints, sides, lengths, before = joints[seen], sides[seen], lengths[seen], before[seen]
        # They were drawn within the limits, but rounding may have left them.
        clear = is_allowed(cell, joints) & is_allowed(cell, before)
        joints, sides, lengths, before = joints[clear], sides[clear], lengths[clear], before[clear]
        # The moves cost most: only as many are checked as will probably be needed.
        for i in range(0, len(joints), _LOOKED_AT):
            if len(found) < most:
                some = slice(i, i + _LOOKED_AT)
                good = may_visit(cell, joints[some], before[some])
                found += [
                    Pose(tuple(float(q) for q in pose), tuple(int(side) for side in signs), float(length))
                    for pose, signs, length in zip(
                        joints[some][good], sides[some][good], lengths[some][good], strict=True
                    )
                ]
        found = found[:most]
    if len(found) < fewest:
        raise too_few(cell, len(found), fewest, targets, one_target=one_target)
    return found


def too_few(
    cell: Cell, found: int, needed: int, targets: Sequence[str] | None, *, one_target: bool = False
) -> ConfigError:
    """Return the error for too few random poses; it names the normals if they are the reason."""
    names = cell.tool.targets if targets is None else targets
    looking = [name for name in names if name in cell.tool.normals]
    named = (" or " if one_target else ", ").join(looking)
    seen = (
        f" and turn {named} to the instrument within {cell.instrument.declared.cone_deg:g} deg"
        if looking
        else ""
    )
    return ConfigError(
        f"only {found} random poses clear table, keep-out boxes and fixtures{seen}; {needed} are needed"
    )


def moves_s(cell: Cell, start_deg: Array, end_deg: Array, speed_deg_s: Array | float) -> Array:
    """Compute the durations (n,) s of n moves between joint angles (n, N).

    `speed_deg_s`, (n,) or one for all, are the speeds of the leading joint.
    """
    slides = np.array([kind == "slides" for kind in cell.robot.model.kinds])
    joints = np.where(slides, 0.0, np.abs(end_deg - start_deg)).max(axis=1) / speed_deg_s
    ends = (
        forward(cell.robot.model, cell.robot.model_angles(each))[:, :3, 3] for each in (start_deg, end_deg)
    )
    straight = np.linalg.norm(np.subtract(*ends), axis=1) / cell.robot.speed_mm_s
    slowest = np.maximum(joints, straight)
    return np.where(slowest > 0.0, slowest + START_AND_STOP_S, 0.0)
