"""The price of a pose: the loss of accuracy without it, and the time to measure it again.

Accuracy is the U, mm, that `calib.selection` predicts for a complete model: k = 2, along the worst direction, at
postures drawn over the joint limits of the cell. A reading that is measured again replaces the one before, so that
U is then as planned.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from acquisition.campaign import setup_of
from acquisition.cell import cell_of_record
from acquisition.record import RecordStore
from acquisition.run import forecast_of
from calib.errors import DataError
from calib.fit import expanded
from calib.selection import Candidates, candidates_of
from service.results.cell.plan import VisitNumber
from service.results.shape import ResponseBody, told

_PLACES = 400  # postures at which U is predicted
_WORST_CONDITION = 1e12  # of the information: beyond it these poses do not determine the model


class UncertaintyResponse(ResponseBody):
    """Expanded uncertainty (k = 2) of predicted positions over the joint limits of the cell.

    It is that of the worst direction.
    """

    median: Annotated[float, told("In the middle of all postures, mm.", 0.031)]
    p95: Annotated[float, told("Not exceeded in 95 of 100 postures, mm.", 0.052)]
    max: Annotated[float, told("In the worst posture, mm.", 0.071)]


class PriceShown(ResponseBody):
    """The price of a visit."""

    format: Annotated[str, told("Name of this format.", "truepose-price/1")]
    visit: VisitNumber
    name: Annotated[str, told("The name of the visit.", "pose 9 of block 1 (calibration)")]
    set: Annotated[str, told("The set of its readings; validation only judges.", "calibration")]
    seconds: Annotated[float, told("What it takes to measure it again, s.", 17.9)]
    coverage_factor: Annotated[int, told("k of the uncertainties, a number.", 2)]
    u_mm: Annotated[
        UncertaintyResponse | None,
        told(
            "Predicted U as planned, and with the visit measured again, mm; null where it cannot be said.", {}
        ),
    ]
    u_without_mm: Annotated[
        UncertaintyResponse | None,
        told("Predicted U without the visit, mm; null where it cannot be said.", {}),
    ]


def price_of(record: Path, number: int) -> PriceShown | None:
    """Compute the price of a visit; None if the plan has no visit of this number.

    `u_mm` and `u_without_mm` are null if the poses used for them do not determine the model.

    Raises
    ------
    DataError
        The campaign measures distances.
    RecordError, StorageError
        The record cannot be read.
    """
    with RecordStore.reading(record) as store:
        cell = cell_of_record(store.campaign["cell"], str(record))
        planned = [each for each in store.plan() if each.visit.counted]
    own = [each for each in planned if each.visit.number == number]
    if not own:
        return None
    if cell.instrument.declared.measures_lengths:
        raise DataError(
            f"a campaign with the {cell.instrument.name} measures distances, for which no cost of a pose is computed.",
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
    return PriceShown(
        format="truepose-price/1",
        visit=number,
        name=own[0].visit.name,
        set=own[0].visit.set,
        seconds=round(forecast.seconds_left(first, first) - forecast.seconds_left(after, after), 1),
        coverage_factor=2,
        u_mm=u,
        u_without_mm=without,
    )


def _predicted(
    found: Candidates, rows: NDArray[np.bool_], which: NDArray[np.int64]
) -> UncertaintyResponse | None:
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
    return UncertaintyResponse(
        median=float(np.median(u)), p95=float(np.quantile(u, 0.95)), max=float(u.max())
    )
