"""The arrivals of the robot, reading by reading: order in time, joint angles before, and side of approach.

Sides and previous angles are used as recorded; else they are derived from the order of the rows within a series. A
series does not show how the next one began.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from calib.array import Array
from calib.data.header import Header
from calib.text.columns import Columns
from calib.units import DEG

STILL = 1e-5 * DEG
"""rad; a joint that turned less did not turn: files have four decimals of a degree, sums of them rounding errors."""


def order_of(time: Array, series: NDArray[np.int64]) -> NDArray[np.int64]:
    """(n,) rank of every row: series by series as they first appear, in time within each.

    Rows without a time count in the order that they have in the file. Clocks of two series may both start at zero.
    """
    _, first = np.unique(series, return_index=True)
    appearance = np.argsort(np.argsort(first))[series]
    key = time if np.all(np.isfinite(time)) else np.arange(len(time))
    order = np.empty(len(time), dtype=np.int64)
    order[np.lexsort((np.arange(len(time)), key, appearance))] = np.arange(len(time))
    return order


def arrivals_of(
    table: Columns, header: Header, joints: Array, order: NDArray[np.int64], series: NDArray[np.int64]
) -> tuple[Array, Array]:
    """Side of approach (n, N), +1 from below or -1 from above, and previous model joints (n, N), rad or mm.

    Raises DataError for a recorded side that is neither.
    """
    robot = header.robot
    in_time = np.argsort(order)
    begins = np.append(True, series[in_time[1:]] != series[in_time[:-1]])
    before = np.empty_like(joints)
    before[in_time[1:]] = joints[in_time[:-1]]
    before[in_time[begins]] = joints[in_time[begins]]
    recorded = np.column_stack([table.numbers(name) for name in robot.previous_columns]) * robot.joint_units
    recorded = robot.model_angles(recorded, header.coupling)
    previous = np.where(np.isfinite(recorded), recorded, before)
    side = np.column_stack([table.numbers(name) for name in robot.approach_columns])
    for i, k in np.argwhere(np.isfinite(side) & ~np.isin(side, (-1.0, 1.0))):
        raise table.refuse(
            int(i), robot.approach_columns[k], f"is {side[i, k]:g}", "Use +1 (from below) or -1 (from above)"
        )
    if header.coupling != "none":
        matrix = np.array(header.robot.joint_matrices[header.coupling].matrix)
        side = side * np.sign(np.diag(matrix))
        # A model joint that several controller joints turn has no side of its own on record: derive it.
        side[:, np.count_nonzero(matrix, axis=1) > 1] = np.nan
    derived = _derived(_last_move(joints, previous, before), in_time, begins)
    return np.where(np.isfinite(side), side, derived), previous


def _last_move(joints: Array, previous: Array, before: Array) -> Array:
    """Signs of the moves (n, N) that ended last: from where the row's own move began, else of the move that led there.

    Two joints of a controller may turn against each other and leave the model joint that both turn where it is.
    """
    own, earlier = joints - previous, previous - before
    led_there = np.where(np.abs(earlier) > STILL, np.sign(earlier), 0.0)
    return np.where(np.abs(own) > STILL, np.sign(own), led_there)


def _derived(moved: Array, in_time: NDArray[np.int64], begins: NDArray[np.bool_]) -> Array:
    """Sides from the moves (n, N): a joint that did not move still rests on the side of its last move."""
    in_order = moved[in_time]
    rank = np.arange(len(moved))[:, None]
    start = np.maximum.accumulate(np.where(begins, np.arange(len(moved)), 0))[:, None]
    last = np.maximum(np.maximum.accumulate(np.where(in_order != 0.0, rank, 0), axis=0), start)
    derived = np.empty_like(moved)
    derived[in_time] = np.take_along_axis(in_order, last, axis=0)
    derived[derived == 0.0] = 1.0
    return derived
