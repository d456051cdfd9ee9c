"""Corrected targets: joint angles that make the real robot land where the nominal one would."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from calib.array import Array
from calib.compensate import (
    Calibrated,
    Correction,
    Usable,
    correct,
    model_sides,
    nominal_of,
    sides_that_move,
)
from calib.errors import DataError
from calib.fit import radius_95
from calib.model import FLANGE
from calib.units import DEG
from truepose.arguments import angles_of, joints_of, number_of, refuse_no_model
from truepose.frames import frame
from truepose.model import Model

if TYPE_CHECKING:
    import pandas


@dataclass(frozen=True)
class Corrected:
    """n corrected targets.

    Attributes
    ----------
    joints_deg :
        Joints to drive, (n, N), as the controller counts. They are NaN for refused targets. Never drive those.
    radius_95_mm :
        Radius that contains 95 % of the positions that the model allows, (n,) mm. It is NaN if no joints were found.

    >>> model = truepose.identify("irb120.csv")
    >>> wanted = [[10, 20, -30, 40, 50, 60], [400, 20, -30, 40, 50, 60]]
    >>> corrected = truepose.compensate(model, joints_deg=wanted)
    >>> corrected.good
    array([ True, False])
    >>> corrected.joints_deg[corrected.good].shape
    (1, 6)
    """

    joints_deg: Array
    wanted_deg: Array
    found: Correction
    usable: Usable
    radius_95_mm: Array
    _columns: tuple[str, ...] = ()

    @property
    def good(self) -> NDArray[np.bool_]:
        """Mask of the targets that may be driven, shape (n,)."""
        return self.found.good

    @property
    def targets(self) -> pandas.DataFrame:
        """Table of the targets, one row each.

        It has j1_deg and so on to drive, radius_95_mm, status, the reason of a refusal, and notes. A note names, for
        example, joints outside the measured range.
        """
        columns: dict[str, Any] = dict(zip(self._columns, self.joints_deg.T, strict=True))
        status = [str(status) for status in self.found.status]
        return frame(
            {
                **columns,
                "radius_95_mm": self.radius_95_mm,
                "status": status,
                "reason": list(self.found.reasons),
                "notes": list(self.found.notes),
            }
        )

    def __repr__(self) -> str:
        return f"<{len(self.good)} targets, {int(self.good.sum())} corrected>"


def compensate(
    model: Model,
    *,
    joints_deg: Any,
    target: str = FLANGE,
    side: tuple[int, ...] | int = 1,
    approach_deg: float = 5.0,
    temperature_c: float | None = None,
    time_s: float | None = None,
    series: str | None = None,
    limits_deg: Any = None,
    inverse: bool = False,
    named_only: bool = False,
    most_uncertainty: float = math.inf,
) -> Corrected:
    """Correct joint targets; `truepose compensate` does the same to a program.

    Terms that depend on conditions known only in the campaign are always left out. `Corrected.usable` lists them
    with their cost.

    Parameters
    ----------
    joints_deg: (n, N) array, or DataFrame with j1_deg and so on
        Joint targets as the controller counts.
    target :
        Tool target that must land. Default: the flange, which carries all targets.
    side :
        Side from which every joint arrives, +1 from below, -1 from above.
    approach_deg :
        Length of the last move of every joint, deg.
    temperature_c :
        Temperature of the air, for effects that need it.
    time_s :
        Time since the start of the campaign, for effects that need it.
    series :
        Series of a model that holds several.
    limits_deg: (N, 2) array
        Joint limits. Default: those of the robot.
    inverse :
        Correct targets that were taught on the real robot to those of the nominal one.
    named_only :
        Leave out carried terms.
    most_uncertainty :
        Largest radius that contains 95 % of the allowed positions, mm. Targets above it are refused.

    Raises
    ------
    DataError
        An argument cannot be used, or a condition that the model needs is missing.

    >>> model = truepose.identify("irb120.csv")
    >>> corrected = truepose.compensate(model, joints_deg=[[10, 20, -30, 40, 50, 60]], target="T1")
    >>> bool(abs(corrected.joints_deg - corrected.wanted_deg).max() < 0.5)  # deg
    True
    """
    refuse_no_model(model, Model)
    saved, usable = model.saved.for_use(named_only=named_only)
    joints = joints_of(joints_deg, saved)
    count = saved.model.robot.joints
    stated = model.stated(
        side=_sides(side, model),
        temperature_c=temperature_c,
        time_s=time_s,
        series=series,
        approach_rad=approach_deg * DEG,
    )
    limits = None if limits_deg is None else np.asarray(limits_deg, dtype=np.float64)
    if limits is not None and limits.shape != (count, 2):
        raise DataError(f"has the shape {limits.shape}.", do=f"Give ({count}, 2).", key="limits_deg")
    if limits is not None:
        limits = limits * saved.model.robot.joint_units[:, None]
    try:
        found = (nominal_of if inverse else correct)(
            saved.model,
            saved.estimate,
            joints,
            stated,
            target=target,
            limits=limits,
            coupling=saved.coupling,
            regression=saved.regression,
        )
    except ValueError as error:
        if isinstance(error, DataError):
            raise
        raise DataError(f"{error}.", do="Use one of those.", key="target") from error
    radius = np.full(len(joints), np.nan)
    if found.good.any():
        at = (joints if inverse else found.joints)[found.good]
        calibrated = Calibrated(saved.model, saved.estimate, stated, target)
        radius[found.good] = radius_95(calibrated.covariance_of_points(at, saved.covariance))
    most = number_of(most_uncertainty, math.inf, 0.0, math.inf, "most_uncertainty")
    found = found.without_uncertain(radius > most)
    return Corrected(
        angles_of(found.joints, saved),
        angles_of(joints, saved),
        found,
        usable,
        radius,
        saved.model.robot.joint_columns,
    )


def _sides(side: tuple[int, ...] | int, model: Model) -> tuple[float, ...]:
    """Return one side for each joint of the model, from sides as the controller counts."""
    saved = model.saved
    count = saved.model.robot.joints
    given = np.asarray(side, dtype=np.float64)
    if given.shape not in ((), (count,)) or not np.all(np.isin(given, (-1.0, 1.0))):
        raise DataError(f"is {side!r}.", do=f"Give +1 or -1, once or {count} times.", key="side")
    try:
        turned = model_sides(saved.model.robot, np.broadcast_to(given, (count,)), saved.coupling)
    except ValueError as error:
        moves = sides_that_move(saved.model.robot, saved.coupling)
        raise DataError(f"{error}.", do=f"State other sides, such as {moves}.", key="side") from error
    return tuple(float(each) for each in turned)
