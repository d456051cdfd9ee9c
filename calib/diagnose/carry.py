"""The carry-over of a diagnosis: the effects found in one data set, judged on another one of the same robot.

Three models are fitted to the calibration rows of the other data set and judged on its validation rows: its own
base model without effects; the robot unchanged and only its mounting fitted (base, tool, and effects that lean or
load the arm); and the base model and the amplitudes of the effects fitted again, at the orders found.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calib.array import Array
from calib.data.dataset import Dataset
from calib.diagnose.diagnosis import Diagnosis
from calib.errors import DataError
from calib.fit import robust
from calib.fit.held_out import errors_on
from calib.fit.identification import Identification
from calib.fit.identify import carry, identify
from calib.fit.least_squares import Linearisation, find_dependent, solve
from calib.fit.placing import base_model_of, place_nominal
from calib.fit.readings import readings_of
from calib.fit.statistics import ErrorStatistics, statistics_of
from calib.model.effect import Effect
from calib.model.model import Design, RobotModel
from calib.units import percent


@dataclass(frozen=True)
class CarryOver:
    """Errors on the validation rows of the other data set, mm."""

    name: str
    base: ErrorStatistics | None
    frozen: ErrorStatistics | None
    refitted: ErrorStatistics | None

    @property
    def finding(self) -> str:
        """The carry-over in a sentence; empty where the other set has no validation rows."""
        if self.base is None or self.frozen is None or self.refitted is None:
            return ""
        frozen, refitted = (1.0 - errors.rms / self.base.rms for errors in (self.frozen, self.refitted))
        if frozen <= 0.0:
            said = (
                f"Frozen as found, the effects do not carry over: they raise the error by {percent(-frozen)}."
            )
        else:
            said = f"Frozen as found, the effects take {percent(frozen)} of the base model's error away."
        if refitted <= 0.0:
            return f"{said} Fitted anew, their amplitudes do not help either."
        return f"{said} With their amplitudes fitted anew they take {percent(refitted)} away."


def carry_over(diagnosis: Diagnosis, other: Dataset) -> CarryOver:
    """Judge the effects of `diagnosis` on another data set. Raises DataError when it is of another robot."""
    if other.header.robot.name != diagnosis.dataset.header.robot.name:
        raise DataError(
            f"is of the robot '{other.header.robot.name}', not '{diagnosis.dataset.header.robot.name}'.",
            do="Give another data set of the same robot.",
            file=other.path,
            key="robot",
        )
    own = identify(other)
    found = (*(f.effect for f in diagnosis.effects), *(t.effect for t in diagnosis.carried))
    effects = tuple(e for e in found if _carries(e))
    effects = (*(e for e in effects if not e.is_curve), *(e for e in effects if e.is_curve))
    base = base_model_of(other)
    model = replace(base, effects=(*base.effects, *effects))
    placed, placed_estimate = place_nominal(other, base)
    start = carry(placed, placed_estimate, model)
    final = diagnosis.final.model
    for effect in model.effects:
        if effect.owner == "robot":
            for parameter in effect.parameters:
                if parameter.name in final.index:
                    start[model.index[parameter.name]] = diagnosis.final.estimate[final.index[parameter.name]]
    mounting = [i for e in model.effects if e.owner == "mounting" for i in model.positions(e)]
    frozen = _fit(other, model, start, mounting, own)
    refitted = _fit(other, model, start, range(len(start)), own)
    rows = other.validation_rows
    return CarryOver(
        name=other.name,
        base=statistics_of(errors_on(other, rows, own.model, own.estimate)),
        frozen=statistics_of(errors_on(other, rows, model, frozen)),
        refitted=statistics_of(errors_on(other, rows, model, refitted)),
    )


def _carries(effect: Effect) -> bool:
    """Whether an effect carries over: gears and mounting do; drifts, steps and temperatures belong to one session.

    What leans or loads the arm shares its columns with the compliances: without it these would carry a part of it.
    """
    if effect.is_carried:
        return effect.is_usable and effect.owner == "robot"
    return effect.owner != "instrument" and effect.group != "thermal" and "rank" not in effect.shape


def _fit(
    other: Dataset, model: RobotModel, start: Array, free: list[int] | range, own: Identification
) -> Array:
    """Least squares over the `free` parameters, on the readings that fitted the other set's own base model."""
    belongs = np.zeros(len(other), dtype=bool)
    belongs[own.readings.rows] = True
    readings = readings_of(other, belongs, model, start)
    design = Design(model, readings.conditions)
    observed = readings.observed
    # The sizes that evidence gave the curves of gears hold what these readings leave open of them.
    others = replace(model, effects=tuple(e for e in model.effects if not e.is_curve))
    active = np.ones(len(start), dtype=bool)
    count = len(others.parameters)
    active[:count], dropped = find_dependent(
        Linearisation(Design(others, readings.conditions), observed, start[:count])
    )
    allowed = np.zeros(len(start), dtype=bool)
    allowed[list(free)] = True
    at = Linearisation(design, observed, start)
    for _ in range(2):
        at = solve(at, active & allowed, dropped, scale=robust.noise_scale(at.residual, observed.freedom)).at
    return at.estimate
