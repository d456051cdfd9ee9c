"""The visits of a campaign: which readings were taken during one rest of the robot.

Readings of one visit share the position in which the robot came to rest. The column `visit` (any text) names them;
without it, consecutive readings of one pose that was reached by the same move are one visit. A target that is read
again after the robot has moved begins a new visit; one that is read again without a move does not.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from calib.array import Array
from calib.data.arrivals import STILL
from calib.data.conditions import Conditions, numbered


def with_visits(conditions: Conditions, named: NDArray[np.str_]) -> Conditions:
    """Conditions of all n readings of a data set with their visits; named: (n,) as recorded, empty where it is not.

    Two records may count their visits alike: readings of one name with another pose between them are two visits.
    """
    visit, unnamed = visits_of(conditions), named == ""
    if unnamed.all():
        return replace(conditions, visit=visit)
    stay = np.empty(len(visit), dtype=np.int64)
    in_time = np.argsort(conditions.order, kind="stable")
    stay[in_time] = np.cumsum(_goes_elsewhere(conditions, in_time))
    name = np.unique(named, return_inverse=True)[1].reshape(-1)
    return replace(conditions, visit=numbered(np.column_stack([stay, name, np.where(unnamed, visit, -1)])))


def visits_of(conditions: Conditions) -> NDArray[np.int64]:
    """(n,) number of the visit of every reading, from what the robot did."""
    in_time = np.argsort(conditions.order, kind="stable")
    joints, previous, side = (of[in_time] for of in (conditions.joints, conditions.previous, conditions.side))
    begins = _goes_elsewhere(conditions, in_time)
    still = ~begins & (_farthest(previous[1:] - joints[:-1]) <= STILL)
    same_move = _farthest(np.diff(previous, axis=0)) <= STILL
    # joints that were interpolated between two samples seem to turn, a little, while the robot stands
    turned = np.any(np.diff(side, axis=0, prepend=side[:1]) != 0.0, axis=1)
    turned &= ~still | (conditions.waypoint[in_time] < 0)
    stop = np.cumsum(begins | turned | ~(still | same_move))
    what = np.column_stack(
        [stop, still.astype(np.int64), conditions.target[in_time], conditions.anchor[in_time]]
    )
    visit = np.empty(len(stop), dtype=np.int64)
    visit[in_time] = numbered(np.column_stack([stop, np.where(still, 0, _times_before(what))]))
    return visit


def moves_before_the_last(conditions: Conditions) -> Array:
    """(n, N) the move before the last of every reading, the same in all readings of a visit: from the reading before to
    where the last move began or, where the robot had not moved between, that reading's own last move. What a joint
    keeps of moves that lie further back than the last shows in nothing else."""
    in_time = np.argsort(conditions.order, kind="stable")
    _, first, place = np.unique(conditions.visit[in_time], return_index=True, return_inverse=True)
    rows = in_time[np.sort(first)]  # the first reading of every visit, in order of time
    joints, previous, series = conditions.joints[rows], conditions.previous[rows], conditions.series[rows]
    led = previous[1:] - joints[:-1]
    own = joints[:-1] - previous[:-1]
    moves = np.zeros_like(joints)
    moved = np.max(np.abs(led), axis=1, initial=0.0) > STILL
    moves[1:] = np.where(moved[:, None], led, own)
    moves[1:][series[1:] != series[:-1]] = 0.0
    out = np.empty_like(conditions.joints)
    out[in_time] = moves[np.argsort(np.argsort(first))[place.reshape(-1)]]
    return out


def _goes_elsewhere(conditions: Conditions, in_time: NDArray[np.int64]) -> NDArray[np.bool_]:
    """(n,) in order of time: readings of another pose or series than the one before."""
    place = np.column_stack([conditions.series, conditions.pose])[in_time]
    return np.any(np.diff(place, axis=0, prepend=-1) != 0, axis=1)


def _farthest(moves: Array) -> Array:
    """(n + 1,) largest turn of a joint in moves (n, N), infinite before the first."""
    return np.append(np.inf, np.max(np.abs(moves), axis=1))


def _times_before(keys: NDArray[np.int64]) -> NDArray[np.int64]:
    """(n,) how many rows before each of keys (n, c) are the same."""
    which = numbered(keys)
    sorted_by = np.argsort(which, kind="stable")
    first = np.searchsorted(which[sorted_by], which[sorted_by])
    times = np.empty(len(which), dtype=np.int64)
    times[sorted_by] = np.arange(len(which)) - first
    return times
