"""Readings that could be taken: the data set that a baseline would predict at some poses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calib.arm.kinematics import statics
from calib.array import Array
from calib.data.conditions import Conditions
from calib.data.dataset import Dataset
from calib.data.header import Header
from calib.errors import DataError
from calib.model.model import Design
from calib.model.stated import conditions_at
from calib.saved import SavedModel


def planned(
    saved: SavedModel, header: Header, joints: Array, sides: Array, reach: Array, targets: Sequence[str]
) -> Dataset:
    """Points of `targets` at poses (v, N), rad, each in one visit, arrived at from `sides` (v, N) after last moves of
    length `reach` (v,), rad; pose after pose. Raises DataError for a target that the baseline has not."""
    series = next(iter(saved.model.targets))
    for name in targets:
        if name not in saved.model.targets[series]:
            raise DataError(
                f"is no target of the baseline, which has {', '.join(saved.model.targets[series])}.",
                do="Plan with a target that it was calibrated with.",
                key=name,
            )
    visits, each = len(joints), len(targets)
    conditions = conditions_at(
        saved.model, np.repeat(joints, each, axis=0), replace(saved.usual, loads=header.loads)
    )
    loading = statics(saved.model.robot, conditions.joints, header.loads, header.gravity)
    side = np.repeat(sides, each, axis=0)
    names = conditions.target_names
    conditions = replace(
        conditions,
        side=side,
        previous=conditions.joints - side * np.repeat(reach, each)[:, None],
        target=np.tile([names.index(name) for name in targets], visits),
        visit=np.repeat(np.arange(visits), each),
        torque=loading.torque,
        time=np.arange(visits * each, dtype=np.float64),
    )
    points = Design(saved.model, conditions).predict(saved.estimate)
    return _dataset(header, replace(conditions, point=points), points)


def _dataset(header: Header, conditions: Conditions, points: Array) -> Dataset:
    n = len(points)
    nothing: Array = np.full(n, np.nan)
    text: NDArray[np.str_] = np.full(n, "calibration")
    return Dataset(
        path=Path("planned"),
        header=header,
        reading_id=tuple(str(i + 1) for i in range(n)),
        sets=text,
        status=np.full(n, "ok"),
        conditions=conditions,
        points=points,
        orientation=np.full((n, 4), np.nan),
        lengths=nothing,
        u_point=np.full((n, 3), np.nan),
        u_rotation=nothing,
        u_length=nothing,
        sha256="",
    )
