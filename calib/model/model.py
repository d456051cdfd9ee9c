"""Models of robots: a nominal robot, its mounting and a tuple of effects.

The diagnosis appends to that tuple. `ModelStructure` is constant. `BoundModel` binds it to the
conditions of n readings, with every regressor evaluated once; it turns an estimate (m,) in internal
units into slot values, frames, and Jacobian columns.

`TypeEffectPrior`: effects that were found in other robots of the type get half of the total chance of a
false effect. A search that may err once in a number of tries (`calib.scan.scores`) can distribute them
freely. The shares must be fixed before the readings and add up to one; a place with share w counts for 1
/ w tries. So effects that are frequent in a type need less evidence and all others twice as much, and
false effects on faultless robots stay as rare. Source: Genovese, Roeder and Wasserman 2006 (weighted
p-values).

`ties`: measured distances between balls of one body tie their positions.

    residual  (L - |p - q|) / u,      derivative  e.(dp - dq) / u,   e the unit vector from q to p

p and q are the positions of the two balls in the model: nominal, or their estimate if they are
parameters. The arm takes no part. Lengths are in mm.

`without`: a model without some of its effects, with all other parameters adapted as a new fit would, to
first order. Let x be the estimate, C its covariance and e the parameters of the effects. Under the
condition that these effects are zero, the estimate is x - C_e C_ee^-1 x_e and its covariance C - C_e
C_ee^-1 C_e'.

`check_effect`: the conformance check that every effect must pass, of the library or of another package.

`conditions_at`: the conditions for which a correction holds, and the robot's conditions at any joint
angles under them. A corrected target is valid only for the approach, temperature and time for which it
was computed. Conditions that follow from the joints are computed for every pose of the iteration
(gravity torque, the joints before the last move). Stated ones stay (side of approach, temperature, time,
"after the last step").
"""

from __future__ import annotations

import json
import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from calib.arm.kinematics import BESIDE, BasePoses, Chain, Frames, forward, nominal_values, propagate, statics
from calib.arm.robot import Load, Robot
from calib.array import Array
from calib.data.conditions import Conditions
from calib.data.spans import Span
from calib.model.effect import Effect, Owner, Parameter
from calib.model.observations import Observations
from calib.model.regressors import GearCurve
from calib.units import DEG, FACTORS, to_internal

_DIFFERENCE = 1e-4  # of the expected size: far above rounding, far below curvature
_TOLERANCE = 1e-5
FLANGE = ""
"""The tool point of the flange itself; no target can have this name."""

AFTER_EVERYTHING = 1e12
"""Rank of a reading behind every step of the campaign."""


@dataclass(frozen=True)
class TypeEffectPrior:
    """An effect by its label and shape, and its share of all tries."""

    label: str
    shape: Mapping[str, float]
    share: float

    @property
    def place(self) -> Effect:
        """The effect without its parameters: enough to find its place in a scan."""
        return Effect(self.label, "transmission", "robot", "", (), (), self.shape)


ALL_OWNERS: tuple[Owner, ...] = ("robot", "mounting", "instrument")


@dataclass(frozen=True)
class ModelStructure:
    """A model of a robot in the world: nominal robot, mounting and effects.

    Attributes
    ----------
    targets : mapping
        By series and target: nominal position in the flange frame, mm.
    placements : mapping of str to array of shape (4, 4)
        By series: constant pose from which the base parameters count, mm.
    station : tuple of float
        Position of the instrument in the world, mm.
    turns : mapping of str to array of shape (3, 3)
        By series: constant orientation of the tool frame on the flange from which its turns count.
    anchors : mapping of str to tuple of float
        Base targets in the world, mm, nominal or where their parameters start.
    curves : tuple of GearCurve
        Errors of gears that were found and are held.
    spans : tuple of Span
        Measured distances between balls of one body.
    expected : tuple of TypeEffectPrior
        Effects that were found in robots of the type.
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
    expected: tuple[TypeEffectPrior, ...] = ()

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
        """Position of each parameter by name.

        Raises
        ------
        ValueError
            Two parameters share a name.
        """
        index = {p.name: i for i, p in enumerate(self.parameters)}
        if len(index) != len(self.parameters):
            raise ValueError("two effects of the model share a parameter name")
        return index

    def positions(self, effect: Effect) -> list[int]:
        """Return the positions of an effect's parameters; the effect belongs to the model."""
        return [self.index[p.name] for p in effect.parameters]

    @cached_property
    def of_base(self) -> list[int]:
        """Positions of the parameters of the base poses, of all series."""
        own = [e for e in self.effects if e.group == "base model" and e.places == {"base"}]
        return [position for effect in own for position in self.positions(effect)]

    def owned(self, owners: Iterable[Owner]) -> Array:
        """Return 1 for parameters that belong to one of `owners`, otherwise 0, shape (m,)."""
        wanted = set(owners)
        return np.array([float(e.owner in wanted) for e in self.effects for _ in e.parameters])

    @cached_property
    def prior_std(self) -> Array:
        """Standard deviations of the priors, shape (m,), internal units; infinite if free."""
        return np.array([np.inf if p.size is None else to_internal(p.size, p.unit) for p in self.parameters])

    @cached_property
    def prior_mean(self) -> Array:
        """Means of the priors, shape (m,), internal units.

        They are zero, which is nominal, unless robots of the type share another value.
        """
        return np.array([0.0 if p.centre is None else to_internal(p.centre, p.unit) for p in self.parameters])

    @cached_property
    def of_type(self) -> NDArray[np.bool_]:
        """Mask of the parameters whose prior robots of the type share, shape (m,)."""
        return np.array([p.centre is not None for p in self.parameters], dtype=bool)

    @cached_property
    def unit(self) -> Array:
        """Display unit of every parameter in internal units, shape (m,)."""
        return np.array([to_internal(1.0, p.unit) for p in self.parameters])

    @cached_property
    def measured(self) -> NDArray[np.bool_]:
        """Mask of the parameters whose prior is a measurement, not a usual size, shape (m,).

        These are positions of a mounting with a declared uncertainty, and parameters that measured
        robots of the type share.
        """
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
        """Return the distance (n,) beyond the range in which carried terms were measured.

        It is given by name of the quantity, as a share of the width of the range, 0 within it.
        """
        found: dict[str, Array] = {}
        for effect in self.effects:
            for name, distance in effect.beyond(conditions).items():
                found[name] = np.maximum(found.get(name, 0.0), distance)
        return found

    def append(self, *effects: Effect) -> ModelStructure:
        """Add effects at the end of the model."""
        return replace(self, effects=(*self.effects, *effects))

    def without(self, *labels: str) -> ModelStructure:
        """Remove the effects of these labels from the model."""
        return replace(self, effects=tuple(e for e in self.effects if e.label not in labels))


class BoundModel:
    """A model bound to the conditions of n readings."""

    def __init__(self, model: ModelStructure, conditions: Conditions) -> None:
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
        self._placement = BasePoses(poses[:3, :3], poses[:3, 3])
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
        """Compute the chain at the estimate (m,), with the axes of the slots of `record`.

        None records all slots.
        """
        values = self.values(estimate)
        return propagate(self.model.chain, values, self._placement, self._station, record, self._turn)

    def predict(self, estimate: Array, owners: Iterable[Owner] = ALL_OWNERS) -> Array:
        """Predict the points with the effects of `owners` only, shape (n, 3), mm."""
        frames = self.frames(estimate * self.model.owned(owners), record=())
        return np.broadcast_to(frames.p, (3, len(self.conditions))).T.copy()

    def columns(self, slot_columns: Array) -> Array:
        """Compute the Jacobian (k n, m): the sum over terms of slot column x drive, flattened.

        `slot_columns` (S, k, n) is the observation's derivative for a unit of every slot of `slots`.
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
        """Differentiate the predicted points, shape (3 n, m), mm per internal unit.

        Row j n + i is axis j of reading i.
        """
        return self.columns(frames.velocities(self.slots))


def _of_series(constants: Mapping[str, Array], size: int, conditions: Conditions) -> Array:
    """Select constant matrices by series, shape (size, size, n or 1).

    A series without one has the identity.
    """
    matrices = np.stack([constants.get(name, np.eye(size)) for name in conditions.series_names])
    if len(matrices) > 1:
        matrices = matrices[conditions.series]
    return matrices.transpose(1, 2, 0)


def ties(model: ModelStructure, estimate: Array) -> tuple[Array, Array]:
    """Compute the residuals of the ball distances of a model, and their derivative.

    Returns the whitened residual (q,), and the derivative of the prediction (q, m).
    """
    residual = np.zeros(len(model.spans))
    columns = np.zeros((len(model.spans), len(model.parameters)))
    several = len(model.targets) > 1
    for row, span in enumerate(model.spans):
        places = model.targets[span.series] if span.series else model.anchors
        suffix = f"[{span.series}]" if span.series and several else ""
        between, moves = np.zeros(3), np.zeros((3, len(model.parameters)))
        for name, sign in ((span.one, 1.0), (span.other, -1.0)):
            between += sign * np.array(places[name])
            for k, axis in enumerate("xyz"):
                position = model.index.get(f"{name}{suffix}.{axis}", model.index.get(f"{name}.{axis}"))
                if position is not None:
                    between[k] += sign * estimate[position]
                    moves[k, position] = sign
        apart = float(np.linalg.norm(between))
        residual[row] = (span.length_mm - apart) / span.u_mm
        columns[row] = between @ moves / (max(apart, 1e-12) * span.u_mm)
    return residual, columns


Reduced = tuple[ModelStructure, Array, Array]
"""Model, estimate (m,) and covariance (m, m) in internal units."""


def conditional(
    model: ModelStructure, estimate: Array, covariance: Array, effects: Collection[Effect]
) -> tuple[Array, Array]:
    """Compute estimate (m,) and covariance (m, m) if some effects are zero.

    Both remain those of the whole model.
    """
    gone = [i for effect in effects for i in model.positions(effect)]
    live = [i for i in gone if covariance[i, i] > 0.0]
    scale = np.sqrt(np.diag(covariance)[live])
    within = covariance[np.ix_(live, live)] / np.outer(scale, scale)
    pull = np.linalg.lstsq(within, covariance[live] / scale[:, None], rcond=None)[0] / scale[:, None]
    estimate, covariance = estimate - estimate[live] @ pull, covariance - covariance[:, live] @ pull
    estimate[gone], covariance[gone], covariance[:, gone] = 0.0, 0.0, 0.0
    return estimate, covariance


def without(
    model: ModelStructure, estimate: Array, covariance: Array, effects: Collection[Effect]
) -> Reduced:
    """Remove some effects from a model, its estimate (m,) and covariance (m, m).

    All are in internal units and become smaller.
    """
    if not effects:
        return model, estimate, covariance
    estimate, covariance = conditional(model, estimate, covariance, effects)
    less = model.without(*(effect.label for effect in effects))
    kept = [model.index[p.name] for p in less.parameters]
    return less, estimate[kept], covariance[np.ix_(kept, kept)]


def named_only(model: ModelStructure, estimate: Array, covariance: Array) -> Reduced:
    """Remove the carried terms from a model."""
    return without(model, estimate, covariance, [e for e in model.effects if e.is_carried])


def check_effect(effect: Effect, model: ModelStructure, conditions: Conditions) -> None:
    """Check one effect on a model (without it) and some conditions.

    The effect must have a label, a meaning and units, and do nothing at zero. Its columns must be the
    derivative of the exact chain (central differences, relative 1e-5), and it must survive JSON.

    Raises
    ------
    AssertionError
        A check failed; the message names it.
    """
    assert effect.label, "the effect has no label"
    assert not any(c.isspace() for c in effect.label), f"{effect.label!r}: a label has no spaces"
    assert effect.meaning.endswith("."), (
        f"{effect.label}: its meaning is one sentence and ends in a full stop"
    )
    assert effect.parameters, f"{effect.label}: it has no parameter"
    for parameter in effect.parameters:
        assert parameter.unit in FACTORS, f"{parameter.name}: unknown unit {parameter.unit!r}"
        assert parameter.size is None or parameter.size > 0.0, (
            f"{parameter.name}: its size must be above zero"
        )
    shown = {parameter.short for parameter in effect.parameters}
    assert effect.group == "base model" or len(shown) == len(effect.parameters), (
        f"{effect.label}: two parameters are shown under one name"
    )
    assert {t.parameter for t in effect.terms} == {p.name for p in effect.parameters}, (
        f"{effect.label}: terms and parameters do not name each other"
    )
    unknown = {t.slot for t in effect.terms} - {*model.chain.slots, *BESIDE}
    assert not unknown, f"{effect.label}: no such slot: {', '.join(sorted(unknown))}"
    assert Effect.from_json(json.loads(json.dumps(effect.to_json()))) == effect, (
        f"{effect.label}: JSON changes it"
    )

    plain = BoundModel(model, conditions)
    extended = BoundModel(model.append(effect), conditions)
    at_zero = np.zeros(len(extended.model.parameters))
    before = plain.predict(at_zero[: len(plain.model.parameters)])
    assert np.array_equal(before, extended.predict(at_zero)), f"{effect.label}: it acts although it is zero"

    frames = extended.frames(at_zero)
    observed = _everything(frames, len(conditions))
    jacobian = extended.columns(observed.columns(frames, extended.slots))
    for position in extended.model.positions(effect):
        parameter = extended.model.parameters[position]
        step = _DIFFERENCE * to_internal(1.0 if parameter.size is None else parameter.size, parameter.unit)
        moved = at_zero.copy()
        moved[position] = step
        ahead, behind = (observed.residual(extended.frames(x)) for x in (moved, -moved))
        difference = (behind - ahead).ravel() / (2.0 * step)
        scale = max(float(np.max(np.abs(difference))), 1e-12)
        error = float(np.max(np.abs(jacobian[:, position] - difference))) / scale
        assert error < _TOLERANCE, f"{parameter.name}: its column errs by {error:.1e} against differences"
        assert scale > 1e-12, f"{parameter.name}: it moves nothing under these conditions"


def _everything(frames: Frames, n: int) -> Observations:
    """Build unit-weight observations of everything that frames predict.

    They are point, orientation and distance of every reading.
    """
    points = np.broadcast_to(frames.p, (3, n))
    lengths = np.linalg.norm(points - frames.anchor, axis=0)
    weights = np.broadcast_to(np.eye(7)[:, :, None], (7, 7, n))
    return Observations(points, frames.rotation.transpose(1, 2, 0), lengths, weights, np.full(n, 7))


@dataclass(frozen=True)
class StatedConditions:
    """Conditions that hold for every target of a correction.

    Attributes
    ----------
    side : tuple of float or float
        +1 from below (angle growing), -1 from above; one for each joint or one for all.
    approach : tuple of float or float
        Distance before the target at which the last move begins, rad; one for each joint or one for all.
    temperature_c : float
        Air temperature.
    time_s : float
        Time since the start of the campaign. NaN if not stated; effects that need it then refuse.
    loads : tuple of Load or None
        None for those of the robot.
    gravity : tuple of float
        In the base frame, m/s2.
    series : str or None
        Set-up of base and tool; None for the only one.
    """

    side: tuple[float, ...] | float = 1.0
    approach: tuple[float, ...] | float = 5.0 * DEG
    temperature_c: float = np.nan
    time_s: float = np.nan
    order: float = AFTER_EVERYTHING
    loads: tuple[Load, ...] | None = None
    gravity: tuple[float, float, float] = (0.0, 0.0, -9.81)
    series: str | None = None


def series_of(model: ModelStructure, stated: StatedConditions) -> str:
    """Return the series of the stated conditions.

    Raises
    ------
    ValueError
        It is unknown, or there are several and none is named.
    """
    names = tuple(model.targets)
    if stated.series is None and len(names) == 1:
        return names[0]
    if stated.series not in names:
        raise ValueError(f"series {stated.series!r} is not one of {', '.join(names)}")
    return stated.series


def tool_point(model: ModelStructure, series: str, target: str) -> Array:
    """Return the nominal tool point in the flange frame, shape (3,), mm.

    Raises
    ------
    ValueError
        The target is unknown.
    """
    if target == FLANGE:
        return np.zeros(3)
    known = model.targets[series]
    if target not in known:
        raise ValueError(f"target {target!r} is not one of {', '.join(known)}")
    return np.array(known[target], dtype=np.float64)


def nominal_poses(model: ModelStructure, joints: Array, tool: Array) -> Array:
    """Compute the poses of the nominal robot's tool point, shape (n, 4, 4), base frame, mm.

    `joints` (n, N) are in rad, `tool` (3,) in mm.
    """
    poses = forward(model.robot, joints)
    poses[:, :3, 3] += poses[:, :3, :3] @ tool
    return poses


def conditions_of(
    model: ModelStructure, joints: Array, previous: Array, stated: StatedConditions, targets: Sequence[str]
) -> Conditions:
    """Build the conditions of n readings, each of its own target.

    Parameters
    ----------
    joints, previous
        Model joints (n, N) of the pose, and of the point from which the last move comes, rad or mm.
    stated
        Everything else; its sides and lengths of approach are not used.
    targets
        Names of the n targets.

    Raises
    ------
    ValueError
        The series or a target is unknown.
    """
    parts = {name: conditions_at(model, joints, stated, name) for name in dict.fromkeys(targets)}
    made = next(iter(parts.values()))
    points = np.stack([part.point for part in parts.values()])
    which = np.array([list(parts).index(name) for name in targets])
    return replace(
        made,
        side=np.where(joints >= previous, 1.0, -1.0),
        previous=previous,
        point=points[which, np.arange(len(which))],
        target=np.array([made.target_names.index(name) for name in targets]),
    )


def conditions_at(
    model: ModelStructure, joints: Array, stated: StatedConditions, target: str = FLANGE
) -> Conditions:
    """Build the stated conditions of n poses at model angles `joints` (n, N), rad.

    Raises
    ------
    ValueError
        The series or target is unknown, or the sides are neither one nor one per joint.
    """
    n, count = joints.shape
    series = series_of(model, stated)
    side = np.asarray(stated.side, dtype=np.float64)
    if side.shape not in ((), (count,)) or not np.all(np.isin(side, (-1.0, 1.0))):
        raise ValueError(f"side is {stated.side!r}; give +1 or -1, for all joints or for each of {count}")
    sides = np.broadcast_to(side, (n, count)).copy()
    tool = tool_point(model, series, target)
    target_names = (FLANGE, *model.targets[series])
    loading = statics(model.robot, joints, stated.loads, stated.gravity)
    place = model.placements.get(series, np.eye(4))
    return Conditions(
        joints=joints,
        earlier=np.zeros_like(joints),
        previous=joints - sides * np.asarray(stated.approach) * model.robot.steps,
        side=sides,
        torque=loading.torque,
        moment=loading.moment,
        overturning=loading.overturning,
        unit_load=loading.unit_load,
        time=np.full(n, stated.time_s),
        order=np.full(n, stated.order),
        temperature=np.full(n, stated.temperature_c),
        point=nominal_poses(model, joints, tool)[:, :3, 3] @ place[:3, :3].T + place[:3, 3],
        series=np.full(n, tuple(model.targets).index(series)),
        target=np.full(n, target_names.index(target)),
        anchor=np.full(n, -1),
        waypoint=np.full(n, -1),
        visit=np.arange(n),
        series_names=tuple(model.targets),
        target_names=target_names,
        axis_names=model.robot.axes,
        unit_names=model.robot.units,
    )
