"""Statistics of the robots of one type, learned from the model files of some of them.

Only the readings of every robot count. The priors of each fit (usual sizes, or an earlier prior of the type) are
removed from its covariance,

    L_i = C_i^-1 - H_i,      L_i y_i = C_i^-1 x_i - H_i m_i,

C_i the covariance of the robot's own parameters for any base, tool and instrument, H_i = diag(1 / held^2) and m_i the
means of the priors. A robot that was calibrated with a type prior therefore does not pass on that prior. Effects in
addition to the base model are learned from the robots in which they were found.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calib.arm.robot import robot_hash
from calib.array import Array
from calib.compensate import Bounds
from calib.errors import DataError
from calib.fit.least_squares import DroppedParameter
from calib.fit.type_prior import TypeEffect, TypeParameter, TypePrior
from calib.model.effect import Effect, Parameter
from calib.prior.reml import TypeModel, hierarchy
from calib.saved import CalibratedModel, load_model
from calib.text import read_json
from calib.units import to_display, to_internal

_BOUNDS = Bounds(
    30.0, 500.0
)  # of a correction: nothing is driven by these models, and strangers are found anyway


@dataclass(frozen=True)
class TypeMember:
    """Robot of a type, read from its model file.

    Attributes
    ----------
    sha256 : str
        Hash of the contents, as stated in the file.
    """

    path: Path
    sha256: str
    saved: CalibratedModel

    @classmethod
    def read(cls, path: Path, *, robot_file: Path | None = None) -> TypeMember:
        """Read the model of a file.

        Raises
        ------
        DataError
            The model cannot be used; the message names file and key.
        """
        saved = load_model(path, robot_file=robot_file, bounds=_BOUNDS)
        return cls(path, str(read_json(path).get("content_sha256", "")), saved)

    @property
    def name(self) -> str:
        """Name of the model file."""
        return self.path.name

    @cached_property
    def identity(self) -> tuple[str, ...]:
        """Keys that identify this robot: hash of its data, and serial number if known."""
        serial = next((d.get("serial", "") for d in self.saved.devices if d.get("role") == "robot"), "")
        return tuple(key for key in (f"data {self.saved.data_sha256}", f"serial {serial}") if key[-1] != " ")

    @cached_property
    def groups(self) -> tuple[str, ...]:
        """Groups of parameters that its base model frees."""
        return tuple(
            e.label for e in self.saved.model.effects if e.group == "base model" and e.owner == "robot"
        )

    @cached_property
    def effects(self) -> tuple[Effect, ...]:
        """Effects found in addition to the base model.

        Curves of gears are left out, since their waves are too many to name. Events that happened once in one campaign
        are left out, and so are carried terms, whose labels are no causes.
        """
        return tuple(
            e
            for e in self.saved.model.effects
            if e.group not in ("base model", "carried")
            and e.owner == "robot"
            and not e.is_curve
            and "rank" not in e.shape
        )

    @cached_property
    def own(self) -> dict[str, Parameter]:
        """Parameters of the robot itself, by name."""
        base = [e for e in self.saved.model.effects if e.label in self.groups]
        return {p.name: p for e in (*base, *self.effects) for p in e.parameters}

    @cached_property
    def open(self) -> frozenset[str]:
        """Parameters of the robot that its readings left undetermined, and that others replace."""
        gone = frozenset(d.name for d in self.saved.dropped if d.stand_ins)
        return gone & frozenset(name for name in self.own if not self.tells(name))

    def tells(self, name: str) -> bool:
        """Check if a parameter was fitted."""
        place = self.saved.model.index.get(name)
        return place is not None and bool(self.saved.covariance[place, place] > 0.0)

    def value(self, name: str) -> float:
        """Return the estimate of a parameter in its unit."""
        place = self.saved.model.index[name]
        return to_display(float(self.saved.estimate[place]), self.saved.model.parameters[place].unit)

    def told(self, names: Sequence[str]) -> tuple[Array, Array]:
        """Compute precision (p, p) and right side (p,) of parameters from the readings alone.

        They are in internal units, and zero for parameters that this model does not have.
        """
        saved, index = self.saved, self.saved.model.index
        assert saved.held_std is not None
        places = [(k, index[name]) for k, name in enumerate(names) if self.tells(name)]
        at, of = [k for k, _ in places], [i for _, i in places]
        scale = np.sqrt(np.diag(saved.covariance)[of])
        inverse = np.linalg.inv(saved.covariance[np.ix_(of, of)] / np.outer(scale, scale))
        inverse = inverse / np.outer(scale, scale)
        held = saved.held_std[of] ** -2.0
        precision, right = np.zeros((len(names), len(names))), np.zeros(len(names))
        right[at] = inverse @ saved.estimate[of] - held * saved.model.prior_mean[of]
        precision[np.ix_(at, at)] = _positive(inverse - np.diag(held), scale)
        return precision, right


def _positive(precision: Array, scale: Array) -> Array:
    """Remove negative eigenvalues from a precision matrix.

    They result from rounding, and from priors that decided nearly everything.
    """
    values, vectors = np.linalg.eigh(precision * np.outer(scale, scale))
    return (vectors * np.maximum(values, 0.0)) @ vectors.T / np.outer(scale, scale)


FEWEST = 8
"""Robots that a type takes: of fewer the spread is so uncertain that one member in six would be called a stranger."""

_MOST_OUTSIDE = 0.3  # share of a robot's parameters beyond which the whole robot is left out


@dataclass(frozen=True)
class LearnedParameter:
    """Parameter over the robots of a type, in its unit.

    Attributes
    ----------
    mean, mean_std, spread, spread_std : float
        Mean and spread with their standard uncertainties.
    robots : int
        Number of robots whose readings determined the parameter.
    of_next : float
        Standard deviation of a further robot about the mean.
    usual : float or None
        Usual size so far; None if the parameter was free.
    """

    name: str
    unit: str
    mean: float
    mean_std: float
    spread: float
    spread_std: float
    robots: int
    of_next: float
    usual: float | None

    @property
    def kept(self) -> bool:
        """Whether the prior of the type is tighter than the usual size."""
        return self.usual is None or self.of_next < self.usual


@dataclass(frozen=True)
class Outlier:
    """Robot outside the type in one parameter, with its value and deviation z.

    The value took no part in the statistics.
    """

    robot: str
    parameter: str
    value: float
    unit: str
    z: float


@dataclass(frozen=True)
class TypeStatistics:
    """Result of learning: parameters, outliers, and robots that were left out with reasons."""

    members: tuple[TypeMember, ...]
    groups: tuple[str, ...]
    parameters: tuple[LearnedParameter, ...]
    redundant: tuple[DroppedParameter, ...]
    found: tuple[TypeEffect, ...]
    outliers: tuple[Outlier, ...]
    left_out: tuple[tuple[str, str], ...]

    def prior(self, sha256: str = "") -> TypePrior:
        """Build the prior of the type for a fit."""
        robot = self.members[0].saved.model.robot
        return TypePrior(
            robot=robot.name,
            robot_sha256=robot_hash(robot),
            coupling=self.members[0].saved.coupling,
            groups=self.groups,
            shares={
                p.name: TypeParameter(p.name, p.unit, p.mean, p.of_next) for p in self.parameters if p.kept
            },
            redundant=self.redundant,
            found=self.found,
            robots=len(self.members),
            sha256=sha256,
        )


def learn(members: Sequence[TypeMember]) -> TypeStatistics:
    """Learn the statistics of a type from the models of its robots.

    Raises
    ------
    DataError
        The models are of several types, or too few.
    """
    _refuse_unlike(members)
    alike, left_out = _alike(members)
    _refuse_few(alike, left_out)
    parameters = _common(alike)
    lesson, strangers = _learnt(alike, parameters)
    if strangers:
        left_out += tuple((m.name, "most of its parameters lie outside the type") for m in strangers)
        alike = tuple(m for m in alike if m not in strangers)
        _refuse_few(alike, left_out)
        lesson, _ = _learnt(alike, _common(alike))
    return TypeStatistics(
        members=alike,
        groups=alike[0].groups,
        parameters=lesson[0],
        redundant=tuple(d for d in alike[0].saved.dropped if d.name in alike[0].own),
        found=_found(alike),
        outliers=lesson[1],
        left_out=left_out,
    )


def _learnt(
    members: Sequence[TypeMember], parameters: Sequence[Parameter]
) -> tuple[tuple[tuple[LearnedParameter, ...], tuple[Outlier, ...]], list[TypeMember]]:
    """Learn parameters and outliers.

    Also returns the members with most parameters outside the type.
    """
    usual = np.array([to_internal(1.0 if p.size is None else p.size, p.unit) for p in parameters])
    names = [p.name for p in parameters]
    precision, right = (np.stack(each) for each in zip(*(m.told(names) for m in members), strict=True))
    found = hierarchy(precision, right, usual)
    told = np.einsum("ijj->ij", precision) > 0.0
    strange = (~found.member & told).sum(axis=1) > _MOST_OUTSIDE * told.sum(axis=1)
    if strange.any():
        return ((), ()), [m for m, gone in zip(members, strange, strict=True) if gone]
    rows = tuple(_row(p, j, found, told) for j, p in enumerate(parameters))
    outliers = tuple(
        Outlier(
            members[i].name,
            names[j],
            members[i].value(names[j]),
            parameters[j].unit,
            float(found.z[i, j]),
        )
        for i, j in np.argwhere(~found.member & told)
    )
    return (rows, outliers), []


def _row(p: Parameter, j: int, found: TypeModel, told: NDArray[np.bool_]) -> LearnedParameter:
    def shown(value: Array) -> float:
        return to_display(float(value[j]), p.unit)

    return LearnedParameter(
        name=p.name,
        unit=p.unit,
        mean=shown(found.mean),
        mean_std=shown(found.mean_std),
        spread=shown(found.spread),
        spread_std=shown(found.spread_std),
        robots=int((told & found.member)[:, j].sum()),
        of_next=shown(found.of_next),
        usual=p.size,
    )


def _common(members: Sequence[TypeMember]) -> list[Parameter]:
    """List the robot's parameters that enough of the models determined, in order."""
    counts = Counter(name for m in members for name in m.own if m.tells(name))
    known = {p.name: p for m in reversed(members) for p in m.own.values()}
    order = dict.fromkeys(name for m in members for name in m.own)
    return [known[name] for name in order if counts[name] >= FEWEST]


def _found(members: Sequence[TypeMember]) -> tuple[TypeEffect, ...]:
    """List the effects in addition to the base model, most frequent first."""
    effects: dict[str, Effect] = {}
    counts: Counter[str] = Counter()
    for m in members:
        for effect in m.effects:
            effects.setdefault(effect.label, effect)
            counts[effect.label] += 1
    return tuple(TypeEffect(label, dict(effects[label].shape), n) for label, n in counts.most_common())


def _refuse_unlike(members: Sequence[TypeMember]) -> None:
    """Refuse models of several types, of one robot twice, or simulated together with real."""
    if not members:
        raise DataError(
            "there is nothing to learn from.", do=f"Name {FEWEST} models or more.", key="MODEL..."
        )
    first = members[0]
    known: dict[str, TypeMember] = {}
    for m in members:
        for what, same in (
            ("robot", robot_hash(m.saved.model.robot) == robot_hash(first.saved.model.robot)),
            ("joint_coupling", m.saved.coupling == first.saved.coupling),
            ("simulated", m.saved.simulated == first.saved.simulated),
        ):
            if not same:
                raise DataError(
                    f"is unlike {first.name} in this value, and only models of one type can be combined.",
                    do="Learn from the models of each type by themselves.",
                    file=m.path,
                    key=what,
                )
        if m.saved.held_std is None:
            raise DataError(
                "does not state the priors of its fit: an older version wrote it, or a watch updated it.",
                do="Write the model of the calibration again with 'truepose diagnose DATA.csv --model'.",
                file=m.path,
                key="parameters.held_std",
            )
        for key in m.identity:
            if key in known:
                raise DataError(
                    f"is the same robot as {known[key].name}: it would count twice.",
                    do="Give one model per robot.",
                    file=m.path,
                    key="device.serial",
                )
            known[key] = m


def _alike(members: Sequence[TypeMember]) -> tuple[tuple[TypeMember, ...], tuple[tuple[str, str], ...]]:
    """Select the models with the most frequent set of free and undetermined parameters.

    Also returns the other models, and the reasons.
    """
    usual = Counter((m.groups, m.open) for m in members).most_common(1)[0][0]
    out = tuple(
        (
            m.name,
            f"frees {', '.join(m.groups)}, the others {', '.join(usual[0])}"
            if m.groups != usual[0]
            else f"its readings left {', '.join(sorted(m.open)) or 'nothing'} open, those of the others "
            f"{', '.join(sorted(usual[1])) or 'nothing'}",
        )
        for m in members
        if (m.groups, m.open) != usual
    )
    return tuple(m for m in members if (m.groups, m.open) == usual), out


def _refuse_few(members: Sequence[TypeMember], left_out: Sequence[tuple[str, str]]) -> None:
    if len(members) < FEWEST:
        why = "".join(f" {name}: {reason}." for name, reason in left_out)
        raise DataError(
            f"these are too few models to learn from: {len(members)}.{why}",
            do=f"Give models of at least {FEWEST} robots of the type, whose fits free the same parameters.",
            key="MODEL...",
        )
