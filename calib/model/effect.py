"""An effect: a label, an owner, and linear parameters, each acting on slots in proportion to regressors.

value of a slot = nominal + sum of weight x parameter x regressor, through the exact chain;
a column of the Jacobian = sum of twist of the slot x weight x regressor, its derivative.
Level-2 geometry, level-3 compliance and everything that the diagnosis finds are effects of different length.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np

from calib.array import Array
from calib.data.conditions import Conditions
from calib.model import regressors
from calib.model.carried_regressors import WHEN_USED, Held, HeldPair, OfTime
from calib.model.regressors import (
    Cosine,
    CreepBetween,
    LastMove,
    Regressor,
    Sine,
    StepAt,
    Time,
    WarmTravel,
    WarmUpRegressor,
)
from calib.units import FACTORS, to_display, to_internal

Owner = Literal["robot", "mounting", "instrument"]
Group = Literal[
    "base model",
    "transmission",
    "structure",
    "frames and tool",
    "instrument",
    "thermal",
    "procedure",
    "carried",
]


_OF_THE_CAMPAIGN = (OfTime, Time, WarmUpRegressor, StepAt, CreepBetween, LastMove, WarmTravel)
_CURVE = 6  # parameters of one unit above which they are the waves of one curve, not directions of one thing


@dataclass(frozen=True)
class Parameter:
    """A linear parameter: unique name, unit in which it is shown, and its usual size in that unit.

    A parameter with a `size` is held to it weakly where the data say nothing (a Gaussian prior of that standard
    deviation); without one it is free. centre: where robots of the type have it, in that unit, and `size` is then their
    spread about it (`calib.prior`); None: nobody knows. low, high: between which physics allows it; None: no bound.
    Bounds never hold a fit back: an estimate beyond them says that the effect is not what is there.
    """

    name: str
    unit: str
    size: float | None = None
    low: float | None = None
    high: float | None = None
    centre: float | None = None

    @property
    def short(self) -> str:
        """Name without the label in front: 'gap' of 'backlash:j4.gap'."""
        return self.name.rpartition(".")[2]

    @property
    def bounds(self) -> tuple[float, float]:
        """The bounds that physics sets, internal units; infinite where there is no bound."""
        low = -math.inf if self.low is None else to_internal(self.low, self.unit)
        high = math.inf if self.high is None else to_internal(self.high, self.unit)
        return low, high


@dataclass(frozen=True)
class EffectTerm:
    """A term of an effect: `parameter` moves `slot` by weight x regressor (weight in internal units)."""

    parameter: str
    slot: str
    weight: float
    regressor: Regressor


@dataclass(frozen=True)
class Effect:
    """A physical cause in the robot, its mounting or the instrument, linear in its parameters.

    `shape` holds what was scanned or fixed (harmonic order, change point), by name, for the report.
    """

    label: str
    group: Group
    owner: Owner
    meaning: str
    parameters: tuple[Parameter, ...]
    terms: tuple[EffectTerm, ...]
    shape: Mapping[str, float] = field(default_factory=dict)

    @cached_property
    def places(self) -> frozenset[str]:
        """The parts of the chain on which the effect acts: `theta3`, `base`, `tool`, `target`, `anchor`, `length`."""
        return frozenset(term.slot.partition(".")[0] for term in self.terms)

    @property
    def wave(self) -> tuple[int, frozenset[str]] | None:
        """The joint whose angle drives a harmonic, and the slots on which it acts; None for other effects."""
        joints = {t.regressor.joint for t in self.terms if isinstance(t.regressor, Cosine | Sine)}
        if "order" not in self.shape or len(joints) != 1:
            return None
        return joints.pop(), frozenset(term.slot for term in self.terms)

    @property
    def is_carried(self) -> bool:
        """Whether this is a carried term: confirmed by left-out readings, but without a cause that has a name."""
        return self.group == "carried"

    @property
    def is_usable(self) -> bool:
        """Whether all that drives the effect is known when the model is used, as for compensation and export."""
        return not self.is_carried or not any(
            isinstance(term.regressor, _OF_THE_CAMPAIGN)
            or getattr(term.regressor, "quantity", "angle") not in WHEN_USED
            for term in self.terms
        )

    def beyond(self, conditions: Conditions) -> dict[str, Array]:
        """Name of a quantity that drives a carried term -> (n,) distance beyond its measured range, as a share of its
        width; empty for named effects, which hold wherever their law holds."""
        regressors = {t.regressor for t in self.terms if isinstance(t.regressor, Held | HeldPair | OfTime)}
        found: dict[str, Array] = {}
        for regressor in regressors:
            for name, distance in regressor.beyond(conditions).items():
                found[name] = np.maximum(found.get(name, 0.0), distance)
        return found

    @property
    def is_curve(self) -> bool:
        """Whether the effect is a curve over a turn, a sum of waves of several orders."""
        return len({t.regressor.order for t in self.terms if isinstance(t.regressor, Cosine | Sine)}) > 1

    def amplitude(self, values: Array, covariance: Array) -> tuple[float, float, str]:
        """Size of the effect, its standard error and unit: root sum of squares of the parameters of one unit.

        values (p,) and covariance (p, p) in internal units. For one parameter it is the parameter itself; for a curve
        of many waves, its root mean square over a turn. Where units differ, of those of which the readings are surest:
        the angle of a tool that turned, not its small shift.
        """
        units = dict.fromkeys(p.unit for p in self.parameters)
        of_unit = {unit: [i for i, p in enumerate(self.parameters) if p.unit == unit] for unit in units}

        def sure(unit: str) -> float:
            at = of_unit[unit]
            return float(values[at] @ np.linalg.pinv(covariance[np.ix_(at, at)], hermitian=True) @ values[at])

        unit = max(of_unit, key=sure) if len(of_unit) > 1 else self.parameters[0].unit
        same = of_unit[unit]
        v, c = values[same], covariance[np.ix_(same, same)]
        if len(same) == 1:
            return to_display(float(v[0]), unit), to_display(math.sqrt(float(c[0, 0])), unit), unit
        if len(same) > _CURVE:
            v, c = v / math.sqrt(2.0), c / 2.0
        size = float(np.linalg.norm(v))
        spread = math.sqrt(float(v @ c @ v)) / size if size > 0.0 else math.sqrt(float(np.trace(c)))
        return to_display(size, unit), to_display(spread, unit), unit

    def apart(self, prefix: str) -> Effect:
        """The effect with unique names of its parameters: `prefix` and a dot before each."""
        return replace(
            self,
            parameters=tuple(replace(p, name=f"{prefix}.{p.name}") for p in self.parameters),
            terms=tuple(replace(t, parameter=f"{prefix}.{t.parameter}") for t in self.terms),
        )

    def to_json(self) -> dict[str, Any]:
        """Plain dictionary that `from_json` reads back."""
        return {
            "label": self.label,
            "group": self.group,
            "owner": self.owner,
            "meaning": self.meaning,
            "shape": dict(self.shape),
            "parameters": [asdict(parameter) for parameter in self.parameters],
            "terms": [
                {
                    "parameter": t.parameter,
                    "slot": t.slot,
                    "weight": t.weight,
                    "regressor": regressors.to_json(t.regressor),
                }
                for t in self.terms
            ],
        }

    @classmethod
    def from_json(cls, table: Mapping[str, Any]) -> Effect:
        """The effect that `to_json` wrote. Raises KeyError when a key or a kind of regressor is unknown."""
        return cls(
            label=table["label"],
            group=table["group"],
            owner=table["owner"],
            meaning=table["meaning"],
            shape=dict(table["shape"]),
            parameters=tuple(
                Parameter(p["name"], p["unit"], p["size"], p.get("low"), p.get("high"), p.get("centre"))
                for p in table["parameters"]
            ),
            terms=tuple(
                EffectTerm(t["parameter"], t["slot"], t["weight"], regressors.from_json(t["regressor"]))
                for t in table["terms"]
            ),
        )


Acts = tuple[str, Regressor] | tuple[str, Regressor, float]
Bounds = tuple[float | None, float | None]
Written = tuple[str, float | None, Sequence[Acts]] | tuple[str, float | None, Sequence[Acts], Bounds]


def effect(
    label: str,
    group: Group,
    owner: Owner,
    meaning: str,
    acts: Mapping[str, Written],
    shape: Mapping[str, float] | None = None,
) -> Effect:
    """An effect from a brief notation.

    acts: short parameter name -> (unit, expected size in that unit, [(slot, regressor[, weight]), ...][, (lowest,
    highest) that physics allows, in that unit]).
    Parameters are kept in internal units whatever the unit they are shown in. Outside the base model their
    names start with the label. Raises KeyError for a unit that `units.FACTORS` does not hold.
    """
    prefix = "" if group == "base model" else f"{label}."
    parameters, terms = [], []
    for name, (unit, size, places, *bounds) in acts.items():
        if unit not in FACTORS:
            raise KeyError(unit)
        parameters.append(Parameter(prefix + name, unit, size, *(bounds[0] if bounds else ())))
        for slot, regressor, *weight in places:
            terms.append(EffectTerm(prefix + name, slot, float(weight[0]) if weight else 1.0, regressor))
    return Effect(label, group, owner, meaning, tuple(parameters), tuple(terms), dict(shape or {}))
