"""Readings that could be taken: the data set that a baseline would predict in some visits."""

from __future__ import annotations

from dataclasses import replace
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
from calib.model.model import Design
from calib.model.stated import conditions_at
from calib.saved import SavedModel
from calib.watch.planning.visits import Visits

VISIT_S = 60.0
"""How long a visit takes, s: ten poses are ten minutes."""


def planned(saved: SavedModel, header: Header, visits: Visits) -> Dataset:
    """The readings of some visits as the baseline predicts them: points, with the turn of the tool where the header has
    noise of one, or distances to base targets. Raises DataError for a target or a base target that the
    baseline has not."""
    series = next(iter(saved.model.targets))
    read = [pair for each in visits.read for pair in each]
    targets, bases = (list(names) for names in zip(*read, strict=True))
    for name, known, what in (
        *((name, saved.model.targets[series], "target") for name in dict.fromkeys(targets)),
        *((name, saved.model.anchors, "base target") for name in dict.fromkeys(bases) if name),
    ):
        if name not in known:
            raise DataError(
                f"is no {what} of the baseline, which has {', '.join(known) or 'none'}.",
                do="Plan with what it was calibrated with.",
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
    frames = Design(saved.model, conditions).frames(saved.estimate, ())
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
