"""Survey of the current readings: the input from which the library makes its offers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from calib.arm.freedoms import HELD
from calib.arm.robot import Load, Robot
from calib.array import Array
from calib.data.conditions import Conditions
from calib.data.dataset import Dataset
from calib.fit.identification import IdentificationFit
from calib.model.effect import Effect
from calib.model.model import ModelStructure
from calib.model.regressors import Regressor, Torque

_LEAST_MOMENT = 20.0  # N.mm: 2 um at 100 mm by a gear of 1e-6 rad/(N.mm); friction and cables do more


@dataclass(frozen=True)
class Survey:
    """Robot, conditions of the readings in the fit, and content of their model.

    Attributes
    ----------
    everywhere : Conditions or None
        Conditions of all rows, including rows that are only to be predicted.
    freed : frozenset of (str, Regressor)
        Slots and regressors of the base model.
    compliance : mapping of int to float
        Estimated compliance of each joint, rad/(N.mm).
    loads : tuple of Load or None
        None for those of the robot.
    station : (float, float, float)
        Position of the instrument, mm.
    curves : frozenset of int
        Joints with a curve over their angle in the model, which includes all their lower orders.
    weightless : frozenset of int
        Joints that gravity loads although no load is known.
    """

    robot: Robot
    conditions: Conditions
    everywhere: Conditions | None = None
    freed: frozenset[tuple[str, Regressor]] = frozenset()
    compliance: Mapping[int, float] = field(default_factory=dict)
    loads: tuple[Load, ...] | None = None
    station: tuple[float, float, float] = (0.0, 0.0, 0.0)
    curves: frozenset[int] = frozenset()
    weightless: frozenset[int] = frozenset()

    @classmethod
    def of(cls, fitted: IdentificationFit, dataset: Dataset) -> Survey:
        """Build the survey of a fit."""
        model = fitted.model
        return cls(
            robot=model.robot,
            conditions=fitted.readings.conditions,
            everywhere=dataset.conditions,
            freed=frozenset(
                (term.slot, term.regressor)
                for effect in model.effects
                for term in effect.terms
                if effect.group == "base model"
            ),
            compliance=compliance_of(model, fitted.estimate),
            loads=fitted.header.loads,
            station=model.station,
            curves=frozenset(curve.joint for curve in model.curves),
            weightless=frozenset(dataset.weightless),
        )

    def frees(self, effect: Effect) -> bool:
        """Check if the base model has a parameter for every term of an effect."""
        return all((term.slot, term.regressor) in self.freed for term in effect.terms)

    @property
    def frees_tool(self) -> bool:
        """Whether the base model estimates the positions of the tool targets."""
        return any(slot.startswith("target.") for slot, _ in self.freed)

    @property
    def payload(self) -> Load | None:
        """Outermost load on the last link: the tool, if one is declared."""
        loads = self.robot.loads if self.loads is None else self.loads
        return next((load for load in reversed(loads) if load.link == self.robot.joints), None)

    def recorded(self, name: str) -> bool:
        """Check if 'time' or 'temperature' is known for every row, including rows to be predicted."""
        return all(
            bool(np.all(np.isfinite(getattr(c, name))))
            for c in (self.conditions, self.everywhere)
            if c is not None
        )

    @property
    def air_c(self) -> float | None:
        """Mean air temperature, if it was recorded and varied; otherwise None.

        Without variation no effect of the air can be detected.
        """
        temperature = self.conditions.temperature
        if not (self.recorded("temperature") and self.varies(temperature)):
            return None
        return float(np.mean(temperature))

    @property
    def joint_numbers(self) -> range:
        """Numbers of the joints, 1 to N."""
        return range(1, self.robot.joints + 1)

    @property
    def moving(self) -> list[int]:
        """Joints that turned.

        For a joint that never turned, no reading shows the error of its gear. A joint that rods hold has no gear.
        """
        return [k for k in self._moved if k not in self.robot.slides]

    @property
    def sliding(self) -> list[int]:
        """Joints that slid."""
        return [k for k in self._moved if k in self.robot.slides]

    @property
    def _moved(self) -> list[int]:
        held = np.subtract(self.robot.upper, self.robot.lower) < HELD
        moved = [k for k in self.joint_numbers if self.varies(self.conditions.joints[:, k - 1])]
        return [k for k in moved if not held[k - 1]]

    def turns(self, joint: int) -> float:
        """Return the share of a turn that the readings span on a joint."""
        angles = self.conditions.joints[:, joint - 1]
        return float(np.ptp(angles)) / (2.0 * np.pi)

    def varies(self, values: Array) -> bool:
        """Check if a quantity is recorded for every reading and not constant."""
        return bool(np.all(np.isfinite(values)) and np.ptp(values) > 1e-9 * (1.0 + np.max(np.abs(values))))

    def loaded(self, joint: int) -> bool:
        """Check if gravity loads a joint by a torque that varies."""
        return self.strains(self.conditions.torque[:, joint - 1])

    def strains(self, moment: Array) -> bool:
        """Check if a torque or moment (n,), N.mm, is large enough to deflect, and varies."""
        return self.varies(moment) and self.largest(moment) > _LEAST_MOMENT

    @staticmethod
    def largest(moment: Array) -> float:
        """Return the largest magnitude of some values."""
        return float(np.max(np.abs(moment)))


def compliance_of(model: ModelStructure, estimate: Array) -> dict[int, float]:
    """Return the compliance of each joint, rad/(N.mm), of a model at an estimate (m,)."""
    compliance: dict[int, float] = {}
    for term in (term for effect in model.effects for term in effect.terms):
        if isinstance(term.regressor, Torque) and term.slot == f"theta{term.regressor.joint}":
            share = term.weight * float(estimate[model.index[term.parameter]])
            compliance[term.regressor.joint] = compliance.get(term.regressor.joint, 0.0) + share
    return compliance
