"""Effects: linear parameters that act on slots of the chain in proportion to regressors.

Through the exact chain, the value of a slot is the nominal one plus the sum of weight x parameter x
regressor. A column of the Jacobian is the derivative, the sum of twist of the slot x weight x regressor.

Level-2 geometry, level-3 compliance and all findings of the diagnosis are effects of different length.
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
    """A linear parameter of an effect.

    Attributes
    ----------
    name : str
        Unique name.
    unit : str
        Unit in which it is shown.
    size : float or None
        Usual size, the standard deviation of a Gaussian prior that holds the parameter weakly if the
        data do not determine it. None: the parameter is free.
    centre : float or None
        Mean over the robots of the type; `size` is then their spread about it (`calib.prior`). None: unknown.
    low, high : float or None
        Bounds that physics sets; None for no bound. They never limit a fit: an estimate beyond them
        shows that this effect is not the real one.
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
    """A term of an effect: `parameter` moves `slot` by weight x regressor.

    The weight is in internal units.
    """

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
        """Parts of the chain on which the effect acts.

        They are names such as `theta3`, `base`, `tool`, `target`, `anchor` or `length`.
        """
        return frozenset(term.slot.partition(".")[0] for term in self.terms)

    @property
    def wave(self) -> tuple[int, frozenset[str]] | None:
        """The joint whose angle drives a harmonic, with its slots; None for other effects."""
        joints = {t.regressor.joint for t in self.terms if isinstance(t.regressor, Cosine | Sine)}
        if "order" not in self.shape or len(joints) != 1:
            return None
        return joints.pop(), frozenset(term.slot for term in self.terms)

    @property
    def is_carried(self) -> bool:
        """Whether this is a carried term.

        Such a term is confirmed by left-out readings, but has no named cause.
        """
        return self.group == "carried"

    @property
    def is_usable(self) -> bool:
        """Whether all quantities that drive the effect are known when the model is used.

        This is the case in compensation and export.
        """
        return not self.is_carried or not any(
            isinstance(term.regressor, _OF_THE_CAMPAIGN)
            or getattr(term.regressor, "quantity", "angle") not in WHEN_USED
            for term in self.terms
        )

    def beyond(self, conditions: Conditions) -> dict[str, Array]:
        """Return the distance (n,) beyond the measured range by quantity that drives a carried term.

        It is a share of the width of the range. The result is empty for named effects, which hold
        wherever their law holds.
        """
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
        """Return the size of the effect, its standard error and its unit.

        The size is the root sum of squares over the parameters of one unit. For one parameter it is the
        parameter itself; for a curve of many waves, its root mean square over a turn. If units differ,
        the unit with the surest parameters is used: the angle of a tool that turned, not its small
        shift. `values` (p,) and `covariance` (p, p) are in internal units.
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
        """Make the names of the parameters unique, with `prefix` and a dot before each."""
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
        """Read the effect that `to_json` wrote.

        Raises
        ------
        KeyError
            A key is missing, or the kind of a regressor is unknown.
        """
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
    """Build an effect from a brief notation.

    Parameters are kept in internal units, independent of the unit in which they are shown. Outside the
    base model their names start with the label.

    Parameters
    ----------
    label, group, owner, meaning, shape
        As in `Effect`.
    acts : mapping
        Short parameter name -> (unit, expected size in that unit, [(slot, regressor[, weight]), ...][,
        (lowest, highest) that physics allows, in that unit]).

    Raises
    ------
    KeyError
        A unit is not in `units.FACTORS`.
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
