"""Bounds on a correction: a larger one means a wrong model, not a wrong robot.

Identified robots differ from nominal by some tenths of a degree and some millimetres; 10 deg in a joint means a file
that was changed, a model of another robot, or a failed fit. What is compared is where the flange is, with
the model and without, all over the joint ranges: single parameters may be large and cancel, as the UR's d_2 and d_3.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from calib.array import Array
from calib.compensate.calibrated import Calibrated
from calib.errors import DataError
from calib.model.model import RobotModel
from calib.model.stated import StatedConditions, nominal_poses
from calib.units import DEG

_SAMPLES = 200
_SECONDS, _AIR_C = 3600.0, 20.0  # for effects of time and temperature where none is stated


@dataclass(frozen=True)
class Bounds:
    """The largest rotation, deg, and the largest shift, mm, of the flange that a model may cause."""

    turn_deg: float = 2.0
    shift_mm: float = 15.0


def refuse_unlikely(
    model: RobotModel,
    estimate: Array,
    stated: StatedConditions,
    bounds: Bounds,
    *,
    coupling: str = "none",
    file: Path | str | None = None,
) -> None:
    """Raise DataError, naming the parameter with the largest share, where a model corrects beyond `bounds`.

    estimate: (m,) internal units. Conditions that are not stated are those of a usual room.
    """
    robot = model.robot
    counted = np.random.default_rng(1).uniform(robot.lower, robot.upper, (_SAMPLES, robot.joints))
    joints = robot.model_angles(counted, coupling)
    nominal = nominal_poses(model, joints, np.zeros(3))
    stated = replace(
        stated,
        time_s=_SECONDS if np.isnan(stated.time_s) else stated.time_s,
        temperature_c=_AIR_C if np.isnan(stated.temperature_c) else stated.temperature_c,
    )
    for series in model.targets:

        def off(values: Array, series: str = series) -> tuple[float, float]:
            """Largest shift, mm, and turn, deg."""
            poses = Calibrated(model, values, replace(stated, series=series)).poses(joints)
            shift = np.linalg.norm(poses[:, :3, 3] - nominal[:, :3, 3], axis=1)
            # |R - R0| = 2 sqrt(2) sin(angle / 2) in the norm of Frobenius
            apart = np.linalg.norm(poses[:, :3, :3] - nominal[:, :3, :3], axis=(1, 2)) / np.sqrt(8.0)
            return float(shift.max()), float(2.0 * np.arcsin(np.minimum(apart, 1.0)).max() / DEG)

        shift, turn = off(estimate)
        if shift <= bounds.shift_mm and turn <= bounds.turn_deg:
            continue
        beyond = [
            # rounded up: what exceeds a limit must not look as if it met it
            f"{np.ceil(size * 10**digits) / 10**digits:.{digits}f} {unit}, more than {limit:g} {unit}"
            for size, digits, unit, limit in (
                (shift, 1, "mm", bounds.shift_mm),
                (turn, 2, "deg", bounds.turn_deg),
            )
            if size > limit
        ]
        share = [
            max(np.divide(off(alone), (bounds.shift_mm, bounds.turn_deg))) for alone in np.diag(estimate)
        ]
        raise DataError(
            f"corrects the robot by up to {' and '.join(beyond)}; most of it by this parameter.",
            do="Use a model of this robot as it was written. Where the robot is really so far off, allow more: "
            "--largest-correction DEG MM, over HTTP largest_deg and largest_mm.",
            file=file,
            key=model.parameters[int(np.argmax(share))].name,
        )
