"""The price of a pose: what the prediction of positions would lose without it, and what time it takes again.

U as `calib.selection` predicts it: k = 2, along the worst direction, for a model that is complete, at postures drawn
over the joint limits of the cell; mm. A reading that is measured again takes the place of the one before, so U is then
as planned.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from acquisition.campaign import setup_of
from acquisition.cell import cell_of_record
from acquisition.record import RecordStore
from acquisition.run import forecast_of
from calib.errors import DataError
from calib.fit import expanded
from calib.selection import Candidates, candidates_of

FORMAT = "truepose-price/1"
_PLACES = 400  # postures at which U is predicted
_WORST_CONDITION = 1e12  # of the information: beyond it these poses do not determine the model


def price_of(record: Path, number: int) -> dict[str, Any] | None:
    """The price of a visit; None where the plan has none of this number. `u_mm` null: the poses left do not suffice.

    Raises DataError for a campaign of distances, RecordError, StorageError.
    """
    with RecordStore.reading(record) as store:
        cell = cell_of_record(store.campaign["cell"], str(record))
        planned = [each for each in store.plan() if each.visit.counted]
    own = [each for each in planned if each.visit.number == number]
    if not own:
        return None
    if cell.instrument.declared.measures_lengths:
        raise DataError(
            f"a campaign with the {cell.instrument.name} measures distances, which have no price here.",
            do="Measure the pose again where its reading is in doubt.",
        )
    forecast = forecast_of(record)
    first = planned.index(own[0])
    after = first + len(own)
    fitted = [
        each for each in planned if each.visit.set not in ("validation", "nest") and each.status != "skipped"
    ]
    names = list(dict.fromkeys(each.target for each in fitted))
    u, without = None, None
    if fitted:
        low, high = np.array(cell.robot.limits_deg).T
        drawn = np.random.default_rng(0).uniform(low, high, (_PLACES, len(low)))
        joints = np.vstack([[each.visit.joints_deg for each in fitted], drawn])
        found = candidates_of(setup_of(cell, names), cell.robot.model_angles(joints))
        mine = np.array([each.visit.number == number for each in fitted])
        which = np.array([names.index(each.target) for each in fitted], dtype=np.int64)
        u, without = (_predicted(found, rows, which) for rows in (np.ones(len(mine), dtype=bool), ~mine))
    return {
        "format": FORMAT,
        "visit": number,
        "name": own[0].visit.name,
        "set": own[0].visit.set,
        "seconds": round(forecast.seconds_left(first, first) - forecast.seconds_left(after, after), 1),
        "coverage_factor": 2,
        "u_mm": u,
        "u_without_mm": without,
    }


def _predicted(
    found: Candidates, rows: NDArray[np.bool_], which: NDArray[np.int64]
) -> dict[str, float] | None:
    """U over the drawn postures from the readings of a mask (n,), of target `which` (n,) each."""
    n = len(which)
    width = found.rows.shape[-1]
    each = found.rows[:n].reshape(n, -1, 3, width)[np.arange(n), which]
    used = each[rows].reshape(-1, width)
    information = used.T @ used
    if not rows.any() or np.linalg.cond(information) > _WORST_CONDITION:
        return None
    points = found.points[n:].reshape(-1, 3, width)
    spread = points @ np.linalg.inv(np.linalg.cholesky(information)).T
    u = expanded(spread @ spread.transpose(0, 2, 1) + found.repeatability[n:].reshape(-1, 3, 3))
    return {
        "median": float(np.median(u)),
        "p95": float(np.quantile(u, 0.95)),
        "max": float(u.max()),
    }
