"""Check poses of a ballbar: joints at which the baseline has every leg as long as the bar.

A stance is drawn for the nominal robot, which misses it by millimetres; the bar shows one. With the model that the
calibration found the joints are moved until the legs have their length, by Gauss-Newton on the exact chain:

    dq = J+ (length - predicted),    J (6, N): u . dp/dq of each leg, u the unit vector from its ball on the base
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calib.array import Array
from calib.data.header import Header
from calib.model.model import Design
from calib.saved import SavedModel
from calib.watch.planning.planned import planned
from calib.watch.planning.visits import Visits

_STEPS = 6


def within_stroke(
    saved: SavedModel, header: Header, visits: Visits, length_mm: float
) -> tuple[Visits, Array]:
    """The visits with joints at which their legs, as many in each, have a length; and (V,) by how much the worst leg
    of each still differs, mm."""
    robot, count = saved.model.robot, len(visits)
    off: Array = np.full(count, np.inf)
    for _ in range(_STEPS):
        would = planned(saved, header, visits)
        frames = Design(saved.model, would.conditions).frames(saved.estimate, robot.joint_slots)
        towards = frames.p - frames.anchor
        towards = towards / np.linalg.norm(towards, axis=0)
        columns = np.einsum("an,jan->nj", towards, frames.velocities(robot.joint_slots))
        missing = (length_mm - would.lengths).reshape(count, -1)
        off = np.max(np.abs(missing), axis=1)
        moves = np.linalg.pinv(columns.reshape(count, -1, robot.joints))
        visits = replace(visits, joints=visits.joints + np.einsum("vjl,vl->vj", moves, missing))
    return visits, off
