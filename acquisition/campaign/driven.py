"""Poses that are driven through a saved model: the real robot takes the poses that the block states.

A robot as delivered misses its poses by millimetres, and the stroke of a ballbar is one. With `model = "m.json"` the
joints of a block are corrected by a model of the same robot, also one that another instrument identified. The plan and
the data set hold the joints as commanded. The flange is corrected, for the usual side of approach of the block and the
loads of the cell. Angles in deg. Source: Nubiola, thesis, section 2.6.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from acquisition.campaign.blocks.block import Approach, Joints, rounded
from acquisition.cell.cell import Cell
from acquisition.errors import as_config_error
from calib.compensate import correct
from calib.errors import DataError
from calib.saved import CalibratedModel, load_model, refuse_other_table
from calib.units import DEG


def commanded(
    cell: Cell, file: Path, where: str, joints_deg: Sequence[Joints], approach: Approach
) -> list[Joints | None]:
    """Compute the joints to command, deg, so that the real robot takes the poses of n nominal joints.

    None replaces a pose that the real robot does not reach. `where` names the key of the campaign in errors.

    Raises
    ------
    ConfigError
        The model cannot be used, is of another robot, or needs a condition that a plan does not have.
    """
    robot = cell.robot
    with as_config_error(f"{where}: "):
        saved = load_model(file)
        refuse_other_robot(cell, saved, file)
        saved = saved.for_use()[0]
        stated = replace(
            saved.usual,
            side=float(approach.side),
            approach=abs(approach.offset_deg) * DEG,
            time_s=0.0,
            loads=cell.loads or saved.loads,
        )
        try:
            found = correct(
                saved.model,
                saved.estimate,
                robot.model_angles(joints_deg),
                stated,
                limits=robot.limits,
                coupling=robot.coupling,
                regression=saved.regression,
            )
        except ValueError as error:  # a condition that is not stated, or several series
            do = "Give a model of one series that needs loads and temperature alone."
            raise DataError(f"cannot correct the poses of a plan: {error}.", do=do, file=file) from error
    joints = robot.counted(found.joints)
    return [rounded(row) if good else None for row, good in zip(joints, found.good, strict=True)]


def refuse_other_robot(cell: Cell, saved: CalibratedModel, file: Path) -> None:
    """Refuse the model of another robot than that of a cell, or of another absolute accuracy.

    Raises
    ------
    DataError
        It is of another robot; file and key are named.
    """
    robot, own = saved.model.robot, cell.robot.model
    if robot.name != own.name:
        raise DataError(
            f"is a model of the robot '{robot.name}', and the cell has '{own.name}'.",
            do="Give a model of the robot of the cell.",
            file=file,
            key="robot",
        )
    refuse_other_table(robot, own, file)
    saved.refuse_other_accuracy(cell.robot.absolute_accuracy, file)
