"""Corrected targets for one cell: what a diagnosis says to command, where the cell can take it, and as a campaign.

Corrections hold for an approach from one side, and for the time and the air temperature at which they are measured.
Angles deg.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from acquisition.campaign.campaign import FORMAT, Campaign, campaign_from
from acquisition.campaign.plan import DECIMALS
from acquisition.cell.cell import Cell
from acquisition.cell.robot_section import RobotSection
from acquisition.cell.transit import may_visit
from calib.array import Array
from calib.compensate import Correction, Usable, correct, usable
from calib.data import Dataset
from calib.diagnose import Diagnosis
from calib.model import FLANGE, RobotModel, StatedConditions, series_of

APPROACH_DEG = -5.0  # from below on every joint (Nubiola 2.5): the condition for which corrections hold
_LEVER_MM = 500.0  # that turns an angle into a length
_FOLLOWS_MM = 0.002  # movement within a quarter of an hour or 0.3 K below which it does not


def correction(cell: Cell, diagnosis: Diagnosis, goals_deg: Array, stated: StatedConditions) -> Correction:
    """Corrections of joint targets (n, N), deg or mm, within the cell's limits with room for the approach.

    Targets and corrected joints are the controller's; the sides of `stated` are replaced by those of the approach.
    """
    robot, limits = cell.robot, np.array(cell.robot.limits_deg)
    units = cell.robot.model.joint_units
    final = _used(diagnosis, cell.robot.coupling)
    room = 10.0**-DECIMALS  # what rounding may add
    limits = np.column_stack([limits[:, 0] - APPROACH_DEG + room, limits[:, 1] - room]) * units[:, None]
    done = correct(
        final.model,
        final.estimate,
        robot.model_angles(goals_deg),
        _approached(robot, stated),
        target=_landing(final.model, stated),
        limits=limits,
        coupling=robot.coupling,
    )
    return replace(done, joints=robot.model.controller_angles(done.joints, robot.coupling))


def _used(diagnosis: Diagnosis, coupling: str) -> Usable:
    """The model that corrects, as a saved one would: without terms that follow what only the campaign knew."""
    final = diagnosis.final
    return usable(final.model, final.estimate, final.covariance, StatedConditions(), coupling=coupling)


def _landing(model: RobotModel, stated: StatedConditions) -> str:
    """The frame that is brought to its nominal place: the flange, and every target on it.

    An arm of fewer than six joints cannot correct every tilt of the flange: there it is the target, where it is the
    only one.
    """
    names = tuple(model.targets[series_of(model, stated)])
    return names[0] if model.robot.joints < 6 and len(names) == 1 else FLANGE


def _approached(robot: RobotSection, stated: StatedConditions) -> StatedConditions:
    """Conditions with the last moves of the model's joints when every joint of the controller comes from
    `APPROACH_DEG`."""
    zero = np.zeros((1, robot.model.joints))
    moves = (robot.model_angles(zero) - robot.model_angles(zero + APPROACH_DEG))[0]
    return replace(stated, side=tuple(np.sign(moves)), approach=tuple(np.abs(moves)))


def clear(cell: Cell, joints_deg: Array) -> NDArray[np.bool_]:
    """(n,) whether arm and tool are clear at the targets, their approach points, and on the moves from and to home."""
    joints = np.nan_to_num(joints_deg)
    return may_visit(cell, joints, joints + APPROACH_DEG)


def follows_conditions(dataset: Dataset, diagnosis: Diagnosis, goals_deg: Array) -> bool:
    """Whether the corrected joints depend on time or temperature more than a little."""
    header = dataset.header
    final = _used(diagnosis, header.coupling)
    series = next(iter(final.model.targets))
    stated = StatedConditions(series=series, temperature_c=22.0, time_s=3600.0, loads=dataset.header.loads)
    robot = header.robot
    joints = robot.model_angles(goals_deg * robot.joint_units, header.coupling)
    lever = np.where([kind == "slides" for kind in robot.kinds], 1.0, _LEVER_MM)
    at = correct(final.model, final.estimate, joints, stated).joints
    for other in (replace(stated, temperature_c=22.3), replace(stated, time_s=4500.0)):
        moved = np.abs(correct(final.model, final.estimate, joints, other).joints - at) * lever
        if float(np.nanmax(moved, initial=0.0)) > _FOLLOWS_MM:
            return True
    return False


def campaign_of(like: Campaign, corrected_deg: Array, wanted_deg: Array) -> Campaign:
    """Corrected targets first, then the same uncorrected; settle time, samples and retries as in `like`."""
    return campaign_from(
        {
            "format": FORMAT,
            "seed": like.seed,
            "approach": {"offset_deg": APPROACH_DEG, "sides": "one"},
            "settle_s": like.settle_s,
            "samples": like.samples,
            "retries": like.retries,
            "block": [_block(corrected_deg), _block(wanted_deg)],
        },
        "verification campaign",
    )


def _block(joints_deg: Array) -> dict[str, Any]:
    rows: Sequence[Sequence[float]] = joints_deg.tolist()
    return {"kind": "poses", "set": "validation", "select": "list", "joints_deg": rows}
