"""The readings that a fit left out, and their errors."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calib.array import Array
from calib.data.dataset import Dataset
from calib.fit.held_out import errors_on
from calib.fit.identification import Identification
from calib.fit.readings import Readings, readings_of
from calib.fit.robust import distances
from calib.model.model import Design


@dataclass(frozen=True)
class LeftOut:
    """A reading that took no part: joints as the controller counts them, deg or mm; target; error in mm, and how many
    times the declared noise that is (length of the whitened residual)."""

    reading_id: str
    joints_deg: tuple[float, ...]
    target: str
    error_mm: float
    times_noise: float


def all_readings(dataset: Dataset, fitted: Identification) -> tuple[Readings, NDArray[np.bool_]]:
    """All readings that may enter a fit, under the targets that the fit believes, and a mask (n,) of those left out."""
    readings = readings_of(dataset, dataset.fit_rows, fitted.model, fitted.estimate)
    left_out = ~np.isin(readings.rows, fitted.readings.rows)
    target = readings.conditions.target.copy()
    target[~left_out] = fitted.readings.conditions.target
    return replace(readings, conditions=replace(readings.conditions, target=target)), left_out


def left_out(dataset: Dataset, fitted: Identification) -> tuple[LeftOut, ...]:
    """The readings that a fit left out, the worst first."""
    if not fitted.faulty_rows:
        return ()
    readings, out = all_readings(dataset, fitted)
    readings = readings.take(out)
    mask = np.zeros(len(dataset), dtype=np.bool_)
    mask[readings.rows] = True
    frames = Design(fitted.model, readings.conditions).frames(fitted.estimate, ())
    lengths: Array = distances(readings.observed.alone.residual(frames))
    errors = errors_on(dataset, mask, fitted.model, fitted.estimate)
    header, conditions = dataset.header, readings.conditions
    angles = header.robot.controller_angles(conditions.joints, header.coupling) / header.robot.joint_units
    return tuple(
        LeftOut(
            dataset.reading_id[readings.rows[i]],
            tuple(np.round(angles[i], 4).tolist()),
            conditions.target_names[conditions.target[i]],
            float(errors[i]),
            float(lengths[i]),
        )
        for i in np.argsort(-lengths)
    )
