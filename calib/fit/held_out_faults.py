"""Held-out readings that are no readings of what they say: another tool target, or a gross error.

They say nothing about the model, so its error is stated with and without them. They are examined after the fit and
change nothing in it: each is compared with its own prediction, whose uncertainty counts, and with those of all other
tool targets of its series. The limit is that by which readings are rejected in a fit (`calib.fit.robust`), with the
scale of the held-out readings themselves, so that a model which does not hold there makes no reading faulty.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calib.array import Array
from calib.data.dataset import Dataset
from calib.fit import robust
from calib.fit.held_out import errors_on
from calib.fit.identification import Identification
from calib.fit.readings import Readings, linearised, readings_of
from calib.fit.statistics import ErrorStatistics, statistics_of


@dataclass(frozen=True)
class HeldOutFault:
    """A held-out reading that is faulty: its target as the file has it, the one that it fits if any, its error, mm."""

    reading_id: str
    target: str
    fits: str | None
    error_mm: float


@dataclass(frozen=True)
class HeldOutFaults:
    """The faulty held-out readings, a mask (n,) of them over the data set, and the error of all others, mm."""

    faults: tuple[HeldOutFault, ...]
    rows: NDArray[np.bool_]
    error_without: ErrorStatistics | None


def held_out_faults(dataset: Dataset, found: Identification) -> HeldOutFaults:
    """Examine the validation rows of a data set by a fitted model."""
    rows, faulty = dataset.validation_rows, np.zeros(len(dataset), dtype=np.bool_)
    if not rows.any():
        return HeldOutFaults((), faulty, None)
    readings = readings_of(dataset, rows, found.model, found.estimate)
    observed = readings.observed
    distance = _distances(found, readings)
    scale = max(robust.scale_of(distance, observed.freedom), 1.0)
    limit = robust.limits(observed.freedom) * scale
    suspects = np.flatnonzero(distance > limit)
    errors = errors_on(dataset, rows, found.model, found.estimate)
    fits: dict[int, str] = {}
    conditions = readings.conditions
    for t, name in enumerate(conditions.target_names):
        known = [name in found.model.targets[conditions.series_names[s]] for s in conditions.series[suspects]]
        trial = suspects[np.array(known, dtype=bool) & (conditions.target[suspects] != t)]
        if len(trial):
            few = readings.taken(trial)
            few = replace(few, conditions=replace(few.conditions, target=np.full(len(trial), t)))
            fits |= {int(i): name for i in trial[_distances(found, few) < limit[trial]] if int(i) not in fits}
    faulty[readings.rows[suspects]] = True
    return HeldOutFaults(
        tuple(
            HeldOutFault(
                dataset.reading_id[readings.rows[i]],
                conditions.target_names[conditions.target[i]],
                fits.get(int(i)),
                float(errors[i]),
            )
            for i in suspects
        ),
        faulty,
        statistics_of(errors[~faulty[rows]]),
    )


def _distances(found: Identification, readings: Readings) -> Array:
    """(n,) standardised distances of readings from their predictions, whose own uncertainty counts."""
    alone = replace(readings, observed=readings.observed.alone)
    noise = max(found.noise_scale, 1.0) ** 2
    out = np.zeros(len(readings.rows))
    for part, residual, columns in linearised(found.model, alone, found.estimate):
        k, n = residual.shape
        by_reading = columns.reshape(k, n, -1).transpose(1, 0, 2)
        spread = by_reading @ found.covariance @ by_reading.transpose(0, 2, 1) + noise * np.eye(k)
        solved = np.linalg.solve(spread, residual.T[:, :, None])[:, :, 0]
        out[part] = np.sqrt(np.maximum(np.sum(residual.T * solved, axis=1), 0.0))
    return out
