"""The likelier meaning of two streams that do not fit together: another sign, order or unit, a mirrored frame, another
robot. The hypotheses are those about data sets (`calib.data.hypotheses`)."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain

import numpy as np

from calib.arm.robot import Robot
from calib.array import Array
from calib.data import FEWEST_MEANT, Hypothesis, Meaning, explained, of_joints, of_points, of_robot
from calib.errors import DataError
from calib.motion.clocks import Clocks
from calib.motion.streams import JointStream, PointStream

_LOOKED_AT = 300
_SLOWER = 0.5  # share of the samples that is looked at: the slow ones, which a wrong clock displaces least
_OF_AN_ARM = 0.02  # of the standard deviation of the points
_OPTIONS = {"robot": "--robot", "joint_coupling": "--coupling"}
_MOST_RIVALS = 2


def _near(meaning: Meaning, tool: Array) -> bool:
    """Whether the nominal arm with its nominal tool comes as near as an arm does: a free tool and another unit can draw
    the points of another motion together."""
    miss, extent = meaning.miss(tool[None], tool_unknown=False, zero_unknown=False)
    return miss < _OF_AN_ARM * extent


def refuse_misread(
    robot: Robot, moved: JointStream, tracked: PointStream, tool: Array, clocks: Clocks
) -> None:
    """Raise DataError where the nominal arm fits the points clearly better with another meaning of a stream.

    tool: (3,) mm, nominal; clocks: by the speeds alone.
    """
    joints, rates, used = moved.at(clocks.robot_time(tracked.time))
    rows = np.flatnonzero(used)
    turning = np.abs(rates[rows]).max(axis=1)
    rows = rows[turning <= np.quantile(turning, _SLOWER)]
    rows = rows[:: max(1, -(-len(rows) // _LOOKED_AT))]
    if len(rows) < FEWEST_MEANT:
        return
    meaning = Meaning(
        robot,
        moved.coupling,
        robot.controller_angles(joints[rows], moved.coupling),
        np.zeros(len(rows), dtype=np.int64),
        tracked.points[rows],
    )

    def others() -> Iterator[Hypothesis]:
        return chain(of_points(meaning), of_joints(meaning), of_robot(meaning))

    why = explained(meaning, others, tool[None], tool_unknown=False, zero_unknown=False)
    if why is None or not _near(why.cause.meaning, tool):
        return
    said = dict.fromkeys(f" As likely: {rival.what}. {rival.do}" for rival in why.rivals)
    said.pop(f" As likely: {why.cause.what}. {why.cause.do}", None)
    rivals = "".join(list(said)[:_MOST_RIVALS])
    key = _OPTIONS.get(why.cause.key, why.cause.key)
    raise DataError(
        f"{why.cause.what}. The nominal robot misses half of the points by {why.miss:.3g} mm and more, read in that "
        f"way by {why.left:.3g} mm.",
        do=why.cause.do + rivals,
        file=tracked.name if key.startswith("x_mm") else moved.name,
        key=key,
    )
