"""Stances of a ballbar, driven at the joints at which the real robot takes them, by the model so far.

    visits, model -> corrected joints, as far as the cell can take them

Their legs are then within the stroke of the bar. Angles deg.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from acquisition.campaign.blocks.block import rounded
from acquisition.campaign.plan import Visit
from acquisition.cell.cell import Cell
from acquisition.cell.transit import may_visit
from calib.compensate import correct
from calib.fit import IdentificationFit
from calib.model import StatedConditions


def driven(cell: Cell, found: IdentificationFit, visits: Sequence[Visit]) -> list[Visit]:
    """Return visits at the joints at which the real robot takes their poses, by a model.

    A visit that may not be driven so stays as it is.
    """
    if not visits:
        return []
    robot = cell.robot
    joints, approach = (
        np.array([getattr(visit, name) for visit in visits]) for name in ("joints_deg", "approach_deg")
    )
    done = correct(
        found.model,
        found.estimate,
        robot.model_angles(joints),
        last_of(found),
        limits=robot.limits,
        coupling=robot.coupling,
    )
    there = np.where(done.good[:, None], robot.counted(done.joints), joints)
    good = done.good & may_visit(cell, there, there + approach - joints)
    there = np.where(good[:, None], there, joints)
    return [
        replace(visit, joints_deg=rounded(pose), approach_deg=rounded(before))
        for visit, pose, before in zip(visits, there, there + approach - joints, strict=True)
    ]


def last_of(found: IdentificationFit) -> StatedConditions:
    """Return the conditions after the last reading of a fit."""
    readings = found.readings.conditions
    last = int(np.argmax(readings.order))
    return StatedConditions(
        temperature_c=_known(readings.temperature[last]),
        time_s=_known(readings.time[last]),
        loads=found.header.loads,
        gravity=found.header.gravity,
        series=readings.series_names[-1],
    )


def _known(value: float) -> float:
    return float(value) if np.isfinite(value) else 0.0
