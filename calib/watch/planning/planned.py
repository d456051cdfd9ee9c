"""Planned visits of a watch, and the readings that the baseline predicts for them.

A visit states where the robot rests, from which side it arrives, and its readings.

For a ballbar, a stance is drawn for the nominal robot. The real robot misses it by millimetres, which the bar shows.
With the calibrated model, `within_stroke` moves the joints until every leg is as long as the bar, by Gauss-Newton on
the exact chain:

    dq = J+ (length - predicted),    J (6, N): u . dp/dq of each leg, u the unit vector from its ball on the base
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from calib.arm.kinematics import Frames, statics
from calib.array import Array
from calib.data.conditions import Conditions
from calib.data.dataset import Dataset
from calib.data.header import Header
from calib.errors import DataError
from calib.model.model import BoundModel, conditions_at
from calib.saved import CalibratedModel

VISIT_S = 60.0
"""How long a visit takes, s: ten poses are ten minutes."""

_STEPS = 6
Read = tuple[tuple[str, str], ...]
"""What is read in a visit: targets of the tool, each with the base target to which its distance is measured, or "" for
its point."""


def planned(saved: CalibratedModel, header: Header, visits: PlannedVisits) -> Dataset:
    """Predict the readings of some visits with the baseline.

    The readings are points or distances to base targets. Points include the orientation of the tool if the header
    declares noise of an orientation.

    Raises
    ------
    DataError
        The baseline does not have a target or a base target.
    """
    series = next(iter(saved.model.targets))
    read = [pair for each in visits.read for pair in each]
    targets, bases = (list(names) for names in zip(*read, strict=True))
    for name, known, what in (
        *((name, saved.model.targets[series], "target") for name in dict.fromkeys(targets)),
        *((name, saved.model.anchors, "base target") for name in dict.fromkeys(bases) if name),
    ):
        if name not in known:
            raise DataError(
                f"is not a {what} of the baseline, which has {', '.join(known) or 'none'}.",
                do="Plan with the setting of the calibration.",
                key=name,
            )
    each = [len(pairs) for pairs in visits.read]
    visit = np.repeat(np.arange(len(visits)), each)
    joints, side = visits.joints[visit], visits.sides[visit]
    loads = saved.loads_in(header)
    conditions = conditions_at(saved.model, joints, replace(saved.usual, loads=loads))
    loading = statics(saved.model.robot, joints, loads, header.gravity)
    names, anchors = conditions.target_names, tuple(saved.model.anchors)
    reach = visits.reach[visit][:, None] * saved.model.robot.steps
    conditions = replace(
        conditions,
        side=side,
        previous=joints - side * reach,
        target=np.array([names.index(name) for name in targets]),
        anchor=np.array([anchors.index(name) if name else -1 for name in bases]),
        anchor_names=anchors,
        visit=visit,
        torque=loading.torque,
        time=VISIT_S * visit,
    )
    frames = BoundModel(saved.model, conditions).frames(saved.estimate, ())
    points = np.broadcast_to(frames.p, (3, len(conditions))).T.copy()
    return _dataset(header, replace(conditions, point=points), points, frames)


def _dataset(header: Header, conditions: Conditions, points: Array, frames: Frames) -> Dataset:
    n = len(points)
    nothing: Array = np.full(n, np.nan)
    text: NDArray[np.str_] = np.full(n, "calibration")
    spanned = conditions.anchor >= 0
    lengths = np.linalg.norm(frames.p - frames.anchor, axis=0) + frames.length_zero
    orientation = np.full((n, 4), np.nan)
    if header.noise.rotation > 0.0:
        turns = np.broadcast_to(frames.rotation, (n, 3, 3))
        orientation = Rotation.from_matrix(turns).as_quat(scalar_first=True)
    return Dataset(
        path=Path("planned"),
        header=header,
        reading_id=tuple(str(i + 1) for i in range(n)),
        sets=text,
        status=np.full(n, "ok"),
        conditions=conditions,
        points=np.where(spanned[:, None], np.nan, points),
        orientation=np.where(spanned[:, None], np.nan, orientation),
        lengths=np.where(spanned, lengths, np.nan),
        u_point=np.full((n, 3), np.nan),
        u_rotation=nothing,
        u_length=nothing,
        sha256="",
    )


def within_stroke(
    saved: CalibratedModel, header: Header, visits: PlannedVisits, length_mm: float
) -> tuple[PlannedVisits, Array]:
    """Move the joints of visits until their legs have a given length.

    Every visit must have the same number of legs.

    Returns
    -------
    visits : PlannedVisits
        Visits with adjusted joints.
    off : array of shape (V,)
        Remaining difference of the worst leg of each visit, mm.
    """
    robot, count = saved.model.robot, len(visits)
    off: Array = np.full(count, np.inf)
    for _ in range(_STEPS):
        would = planned(saved, header, visits)
        frames = BoundModel(saved.model, would.conditions).frames(saved.estimate, robot.joint_slots)
        towards = frames.p - frames.anchor
        towards = towards / np.linalg.norm(towards, axis=0)
        columns = np.einsum("an,jan->nj", towards, frames.velocities(robot.joint_slots))
        missing = (length_mm - would.lengths).reshape(count, -1)
        off = np.max(np.abs(missing), axis=1)
        moves = np.linalg.pinv(columns.reshape(count, -1, robot.joints))
        visits = replace(visits, joints=visits.joints + np.einsum("vjl,vl->vj", moves, missing))
    return visits, off


@dataclass(frozen=True)
class PlannedVisits:
    """V visits of a robot.

    Attributes
    ----------
    joints : array of shape (V, N)
        Joint values, rad or mm.
    sides : array of shape (V, N)
        Side of approach, +1 from below, -1 from above.
    reach : array of shape (V,)
        Length of the last move, rad.
    read : tuple of Read
        Readings of each visit.
    """

    joints: Array
    sides: Array
    reach: Array
    read: tuple[Read, ...]

    @classmethod
    def of_points(cls, joints: Array, sides: Array, reach: Array, targets: Sequence[str]) -> PlannedVisits:
        """Plan points of the same targets in every visit."""
        return cls(joints, sides, reach, (tuple((name, "") for name in targets),) * len(joints))

    def __len__(self) -> int:
        return len(self.joints)

    @property
    def readings(self) -> int:
        """Number of readings."""
        return sum(len(each) for each in self.read)

    def take(self, index: Sequence[int] | NDArray[np.int64]) -> PlannedVisits:
        """Select some of the visits."""
        some = np.asarray(index, dtype=np.int64)
        return PlannedVisits(
            self.joints[some], self.sides[some], self.reach[some], tuple(self.read[i] for i in some)
        )

    def read_again(self, times: int) -> PlannedVisits:
        """Repeat every reading `times` times in each rest of the robot."""
        return replace(
            self, read=tuple(tuple(pair for pair in each for _ in range(times)) for each in self.read)
        )

    def again(self, times: int) -> PlannedVisits:
        """Repeat the whole round of visits `times` times, every other round from the opposite sides."""
        rounds = [replace(self, sides=self.sides * (-1.0) ** k) for k in range(times)]
        return PlannedVisits(
            np.concatenate([each.joints for each in rounds]),
            np.concatenate([each.sides for each in rounds]),
            np.concatenate([each.reach for each in rounds]),
            self.read * times,
        )
