"""The model: a nominal robot, where it is mounted, and a tuple of effects. Diagnosing appends to that tuple.

`RobotModel` is constant. `Design` binds it to the conditions of n readings, with every regressor evaluated once;
it turns an estimate (m,) in internal units into slot values, frames, and Jacobian columns.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from calib.arm.kinematics import Chain, Frames, Placement, nominal_values, propagate
from calib.arm.robot import Robot
from calib.array import Array
from calib.data.conditions import Conditions
from calib.data.spans import Span
from calib.model.effect import Effect, Owner, Parameter
from calib.model.expected import Expected
from calib.model.regressors import GearCurve
from calib.units import to_internal

ALL_OWNERS: tuple[Owner, ...] = ("robot", "mounting", "instrument")


@dataclass(frozen=True)
class RobotModel:
    """A model of a robot in the world: nominal robot, mounting and effects.

    placements: series -> (4, 4) constant pose from which the base parameters count, mm;
    targets: series -> target -> (x, y, z) nominal in the flange frame, mm; station: (x, y, z) mm in the world;
    turns: series -> (3, 3) constant orientation of the tool frame on the flange from which its turns count;
    anchors: base target -> (x, y, z) mm in the world, nominal or where its own parameters start;
    curves: errors of gears that were found and are held; spans: measured distances between balls of one body;
    expected: effects that robots of the type were found to have.
    """

    robot: Robot
    effects: tuple[Effect, ...]
    targets: Mapping[str, Mapping[str, tuple[float, float, float]]]
    placements: Mapping[str, Array] = field(default_factory=dict)
    station: tuple[float, float, float] = (0.0, 0.0, 0.0)
    turns: Mapping[str, Array] = field(default_factory=dict)
    anchors: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)
    curves: tuple[GearCurve, ...] = ()
    spans: tuple[Span, ...] = ()
    expected: tuple[Expected, ...] = ()

    @cached_property
    def chain(self) -> Chain:
        """The chain of elementary motions."""
        return Chain.of(self.robot)

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """Every parameter in order; positions in an estimate follow it."""
        return tuple(p for effect in self.effects for p in effect.parameters)

    @cached_property
    def index(self) -> dict[str, int]:
        """Name of a parameter -> its position. Raises ValueError when two share a name."""
        index = {p.name: i for i, p in enumerate(self.parameters)}
        if len(index) != len(self.parameters):
            raise ValueError("two effects of the model share a parameter name")
        return index

    def positions(self, effect: Effect) -> list[int]:
        """Positions of the parameters of one of the model's effects."""
        return [self.index[p.name] for p in effect.parameters]

    @cached_property
    def of_base(self) -> list[int]:
        """Positions of the parameters that say where the base of each series is."""
        own = [e for e in self.effects if e.group == "base model" and e.places == {"base"}]
        return [position for effect in own for position in self.positions(effect)]

    def owned(self, owners: Iterable[Owner]) -> Array:
        """(m,) 1 where a parameter belongs to one of `owners`, else 0."""
        wanted = set(owners)
        return np.array([float(e.owner in wanted) for e in self.effects for _ in e.parameters])

    @cached_property
    def prior_std(self) -> Array:
        """(m,) standard deviation of the prior of every parameter, internal units; infinite where free."""
        return np.array([np.inf if p.size is None else to_internal(p.size, p.unit) for p in self.parameters])

    @cached_property
    def prior_mean(self) -> Array:
        """(m,) mean of the prior of every parameter, internal units; zero, nominal, where robots of the type share
        nothing."""
        return np.array([0.0 if p.centre is None else to_internal(p.centre, p.unit) for p in self.parameters])

    @cached_property
    def of_type(self) -> NDArray[np.bool_]:
        """(m,) parameters whose prior is what robots of the type share."""
        return np.array([p.centre is not None for p in self.parameters], dtype=bool)

    @cached_property
    def unit(self) -> Array:
        """(m,) one unit of every parameter as it is shown, internal units."""
        return np.array([to_internal(1.0, p.unit) for p in self.parameters])

    @cached_property
    def measured(self) -> NDArray[np.bool_]:
        """(m,) parameters whose prior is a measurement, not a usual size: a mounting known to what was declared, and
        what measured robots of the type share."""
        return np.array(
            [
                p.centre is not None
                or (e.group == "base model" and e.owner == "mounting" and p.size is not None)
                for e in self.effects
                for p in e.parameters
            ],
            dtype=bool,
        )

    def beyond(self, conditions: Conditions) -> dict[str, Array]:
        """Name of a quantity -> (n,) distance beyond the range in which carried terms were measured, as a share of its
        width; 0 within it."""
        found: dict[str, Array] = {}
        for effect in self.effects:
            for name, distance in effect.beyond(conditions).items():
                found[name] = np.maximum(found.get(name, 0.0), distance)
        return found

    def append(self, *effects: Effect) -> RobotModel:
        """The model with more effects at the end."""
        return replace(self, effects=(*self.effects, *effects))

    def without(self, *labels: str) -> RobotModel:
        """The model without the effects of these labels."""
        return replace(self, effects=tuple(e for e in self.effects if e.label not in labels))


class Design:
    """A model bound to the conditions of n readings."""

    def __init__(self, model: RobotModel, conditions: Conditions) -> None:
        self.model = model
        self.conditions = conditions
        n = len(conditions)
        self._nominal = nominal_values(model.robot, conditions.joints)
        nominal_targets = np.zeros((n, 3))
        for s, series in enumerate(conditions.series_names):
            for t, target in enumerate(conditions.target_names):
                rows = (conditions.series == s) & (conditions.target == t)
                if rows.any():
                    nominal_targets[rows] = model.targets[series][target]
        self._place("target", nominal_targets)
        if model.anchors and (conditions.anchor >= 0).any():
            # index -1 (no distance) reads the row of zeros at the end
            known = [model.anchors[name] for name in conditions.anchor_names]
            self._place("anchor", np.array([*known, (0.0, 0.0, 0.0)])[conditions.anchor])
        for curve in model.curves:
            slot = f"theta{curve.joint}"
            self._nominal[slot] = self._nominal[slot] + curve.evaluate(conditions)
        poses = _of_series(model.placements, 4, conditions)
        self._placement = Placement(poses[:3, :3], poses[:3, 3])
        self._turn = _of_series(model.turns, 3, conditions) if model.turns else None
        self._station = np.array(model.station)
        # (parameter position, slot, weight x regressor)
        self.terms: list[tuple[int, str, Array | float]] = []
        for effect in model.effects:
            for term in effect.terms:
                value = term.regressor.evaluate(conditions)
                self.terms.append((model.index[term.parameter], term.slot, term.weight * value))

    def _place(self, name: str, points: Array) -> None:
        for k, axis in enumerate("xyz"):
            self._nominal[f"{name}.{axis}"] = points[:, k]

    @cached_property
    def slots(self) -> tuple[str, ...]:
        """Slots on which some parameter acts, in the order of the terms."""
        return tuple(dict.fromkeys(slot for _, slot, _ in self.terms))

    def values(self, estimate: Array) -> dict[str, Array | float]:
        """Slot -> value, nominal plus everything the estimate (m,) adds."""
        values = dict(self._nominal)
        for position, slot, drive in self.terms:
            amount = float(estimate[position])
            if amount != 0.0:
                values[slot] = values.get(slot, 0.0) + amount * drive
        return values

    def frames(self, estimate: Array, record: Collection[str] | None = None) -> Frames:
        """The chain at the estimate (m,), with the axes of the slots of `record` (None: of all)."""
        values = self.values(estimate)
        return propagate(self.model.chain, values, self._placement, self._station, record, self._turn)

    def predict(self, estimate: Array, owners: Iterable[Owner] = ALL_OWNERS) -> Array:
        """(n, 3) points, mm, with the effects of `owners` only."""
        frames = self.frames(estimate * self.model.owned(owners), record=())
        return np.broadcast_to(frames.p, (3, len(self.conditions))).T.copy()

    def columns(self, slot_columns: Array) -> Array:
        """Jacobian (k n, m): sum over terms of slot column x drive, flattened.

        slot_columns: (S, k, n) the observation's derivative for a unit of every slot of `slots`.
        """
        place = {slot: i for i, slot in enumerate(self.slots)}
        jacobian = np.zeros((len(self.model.parameters), *slot_columns.shape[1:]))
        begun: set[int] = set()
        for position, slot, drive in self.terms:
            column = slot_columns[place[slot]]
            if not isinstance(drive, float) or drive != 1.0:
                column = column * drive
            if position in begun:
                jacobian[position] += column
            else:
                jacobian[position] = column
                begun.add(position)
        return jacobian.reshape(len(jacobian), math.prod(slot_columns.shape[1:])).T

    def point_columns(self, frames: Frames) -> Array:
        """(3 n, m) derivative of the predicted points, mm for internal units; row j n + i: axis j of reading i."""
        return self.columns(frames.velocities(self.slots))


def _of_series(constants: Mapping[str, Array], size: int, conditions: Conditions) -> Array:
    """(size, size, n or 1) constant matrices by series, the identity where a series has none."""
    matrices = np.stack([constants.get(name, np.eye(size)) for name in conditions.series_names])
    if len(matrices) > 1:
        matrices = matrices[conditions.series]
    return matrices.transpose(1, 2, 0)
