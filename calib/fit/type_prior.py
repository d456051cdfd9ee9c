"""Prior from the type of a robot, and the tests whether this robot agrees with it.

A parameter that robots of the type share has the prior N(centre, spread^2) instead of its usual size.
With V its posterior variance and h = V / spread^2 the share of it that the prior decides, the fit
without this one prior row would lie

    z = (estimate - centre) / (spread sqrt(1 - h))

standard deviations from the type. Its variance is the sum of V / (1 - h), from the readings, and the
squared spread. If |z| is too large for chance among this number of parameters, this robot is no member
of the type in that parameter. The row is then taken out, the parameter has its usual size again, and the
fit is repeated. The remaining rows are judged together by

    X^2 = d'M^+ d,    d = (estimate - centre) / spread,    M = I - V / (spread spread'),

over the directions that the readings see. If X^2 is too large, or too many rows were taken out, the
robot is no member of the type, and the whole prior is left out: an uncertain fit is better off without
it.

Sources: Box 1980 (prior and readings in conflict), Cook and Weisberg 1982 (deletion of rows).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.special import chdtrc, stdtrit

from calib.arm.robot import Robot, robot_hash
from calib.array import Array
from calib.errors import DataError
from calib.fit.least_squares import DroppedParameter, Linearisation
from calib.model.effect import Effect, Parameter
from calib.model.model import ModelStructure, TypeEffectPrior

OUTSIDE = 0.01  # chance that any parameter of a robot of the type is called outside it
TOGETHER = 0.001  # chance that all of them together are
MOST_OUTSIDE = 3  # parameters outside the type, beyond which the robot is no member of it
_SEEN = 0.01  # share of a parameter, or of a direction, that the readings decide before it is judged
_TWICE, _FREQUENT = 2, 0.1  # robots, and share of all, from which an effect is frequent
_SAME = 1e-5  # of a column: what may be left of it where others make up for it


@dataclass(frozen=True)
class TypeParameter:
    """A parameter of a type: mean over its robots, and spread of a further robot about it.

    The spread is a standard deviation. Both are in the display unit.
    """

    name: str
    unit: str
    centre: float
    spread: float


@dataclass(frozen=True)
class TypeEffect:
    """An effect added to the base model, and the number of robots that have it."""

    label: str
    shape: Mapping[str, float]
    robots: int


@dataclass(frozen=True)
class TypePrior:
    """A prior that the robots of one type share.

    Attributes
    ----------
    robot, robot_sha256, coupling : str
        The type.
    groups : tuple of str
        Groups of the robot's parameters that its base model frees.
    shares : mapping of str to TypeParameter
        The shared parameters by name.
    redundant : tuple of DroppedParameter
        Parameters that no readings of the type determined, and those that make up for them.
    found : tuple of TypeEffect
        Effects added to the base model.
    robots : int
        Number of robots from which the prior was learned.
    sha256 : str
        Hash of the file.
    """

    robot: str
    robot_sha256: str
    coupling: str
    groups: tuple[str, ...]
    shares: Mapping[str, TypeParameter]
    redundant: tuple[DroppedParameter, ...]
    found: tuple[TypeEffect, ...]
    robots: int
    sha256: str

    @property
    def expected(self) -> tuple[TypeEffectPrior, ...]:
        """Effects that are frequent in the type, with their prior shares.

        The shares add up to one half of all tries, in proportion to the numbers of robots.
        """
        often = [f for f in self.found if f.robots >= max(_TWICE, _FREQUENT * self.robots)]
        total = sum(f.robots for f in often)
        return tuple(TypeEffectPrior(f.label, f.shape, 0.5 * f.robots / total) for f in often)

    def refuse_other(self, robot: Robot, coupling: str, groups: Sequence[str]) -> None:
        """Raise DataError for a robot of another type, or a base model that frees other groups."""
        if self.robot_sha256 != robot_hash(robot):
            other = "another table of it" if robot.name == self.robot else f"'{robot.name}'"
            raise DataError(
                f"is of robots of the type '{self.robot}', these readings are of {other}.",
                do="Give the prior of this type.",
                key="prior",
            )
        if self.coupling != coupling:
            raise DataError(
                f"was learnt with joint_coupling = {self.coupling!r}, the header has {coupling!r}.",
                do="Learn from models that count their joints as these readings do.",
                key="prior",
            )
        if set(self.groups) != set(groups):
            raise DataError(
                f"was learnt with {', '.join(self.groups)} freed, here the model frees {', '.join(groups)}.",
                do="Free the same groups under [model] fit, because the others compensate for a missing group.",
                key="prior",
            )


@dataclass(frozen=True)
class ParameterWeight:
    """Weight of prior and readings in a parameter.

    Attributes
    ----------
    centre, spread : float
        The prior as it was learned.
    decided : float
        Share of the prior, 0 to 1.
    z : float
        Distance from the type (see the module); NaN if the readings do not determine it.
    """

    name: str
    centre: float
    spread: float
    decided: float
    z: float


@dataclass(frozen=True)
class TypeFit:
    """A fit compared with its type.

    Attributes
    ----------
    outside : tuple of ParameterWeight
        Parameters whose prior was taken out, as they were then.
    open : mapping of str to str
        Parameters to which the prior cannot apply, with the reason.
    chi_square, freedom : float, int
        Chi-square of the remaining prior, and its number of directions.
    left_out : bool
        Whether the whole prior was left out in the end.
    """

    prior: TypePrior
    outside: tuple[ParameterWeight, ...] = ()
    open: Mapping[str, str] = field(default_factory=dict)
    chi_square: float = 0.0
    freedom: int = 0
    left_out: bool = False

    @property
    def p_value(self) -> float:
        """Chance of so large a chi-square of the prior terms for a robot of the type."""
        return float(chdtrc(self.freedom, self.chi_square)) if self.freedom else 1.0

    @property
    def no_member(self) -> bool:
        """Whether this robot lies so far outside that the whole prior is left out."""
        return len(self.outside) > MOST_OUTSIDE or self.p_value < TOGETHER

    def warnings(self) -> list[str]:
        """List sentences on the parameters in which this robot lies outside its type."""
        out = [
            f"{each.name} lies {abs(each.z):.1f} spreads outside what {self.prior.robots} robots of the type share: "
            "the prior was left out for it."
            for each in self.outside
        ]
        if self.left_out:
            out.append(
                f"This robot as a whole lies outside what {self.prior.robots} robots of the type share (chi-squared "
                f"{self.chi_square:.0f} over {self.freedom}): the prior was left out."
            )
        return [*out, *(f"The prior of {name} was left out: {why}." for name, why in self.open.items())]


def with_type_prior(
    at: Linearisation, prior: TypePrior, spoken_for: frozenset[str] = frozenset()
) -> tuple[ModelStructure, TypeFit]:
    """Put the type's prior in the place of the usual sizes of a base model.

    Parameters that were redundant in the type and are redundant here leave the model: the prior refers
    to the parameters that make up for them.

    Parameters
    ----------
    at : Linearisation
        The base model of some readings, linearised at its start.
    prior : TypePrior
        Prior of the type.
    spoken_for : frozenset of str, optional
        Parameters for which the user gave another prior.
    """
    gone, unlike = _redundant(at, prior)
    effects = tuple(_less(e, gone) for e in at.design.model.effects)
    model = replace(
        at.design.model, effects=tuple(e for e in effects if e.parameters), expected=prior.expected
    )
    wanted = frozenset(prior.shares) - spoken_for - frozenset(unlike)
    return centred(model, prior, wanted), TypeFit(prior, open=unlike)


def centred(model: ModelStructure, prior: TypePrior, names: frozenset[str]) -> ModelStructure:
    """Give some parameters of the robot the prior of the type."""

    def with_prior(p: Parameter) -> Parameter:
        share = prior.shares.get(p.name)
        if p.name not in names or share is None or share.unit != p.unit:
            return p
        return replace(p, size=share.spread, centre=share.centre)

    return _with(model, with_prior, "robot")


def without_type_prior(
    model: ModelStructure, usual: Mapping[str, Parameter], name: str | None = None
) -> ModelStructure:
    """Give one parameter of a model its usual size again, or all if `name` is None."""
    return _with(model, lambda p: usual[p.name] if p.name in usual and name in (None, p.name) else p)


def weighed(
    model: ModelStructure, estimate: Array, covariance: Array, weight: Array
) -> tuple[ParameterWeight, ...]:
    """Compute the weight of prior and readings for every parameter with a prior of its type.

    `estimate` (m,) and `covariance` (m, m) are in internal units. `weight` (m,) is one over the standard
    deviation that the prior had in the fit.
    """
    out = []
    for i in np.flatnonzero(model.of_type & (weight > 0.0)):
        p = model.parameters[i]
        decided = float(np.clip(covariance[i, i] * weight[i] ** 2, 0.0, 1.0))
        off = float((estimate[i] - model.prior_mean[i]) * weight[i])
        z = off / np.sqrt(1.0 - decided) if decided < 1.0 - _SEEN else np.nan
        out.append(ParameterWeight(p.name, float(p.centre or 0.0), float(p.size or 0.0), decided, float(z)))
    return tuple(out)


def farthest_from_type(shown: tuple[ParameterWeight, ...], robots: int) -> ParameterWeight | None:
    """Find the parameter farthest outside the type; None if chance explains its distance.

    Chance is judged for the number of parameters tested. `robots` is the number of robots from which the
    spreads are known, which gives Student's t.
    """
    seen = [each for each in shown if np.isfinite(each.z)]
    if not seen:
        return None
    worst = max(seen, key=lambda each: abs(each.z))
    limit = -float(stdtrit(robots - 1, 0.5 * OUTSIDE / len(seen)))
    return worst if abs(worst.z) > limit else None


def together(model: ModelStructure, estimate: Array, covariance: Array, weight: Array) -> tuple[float, int]:
    """Chi-square of all prior terms, and the number of directions that the readings see."""
    which = np.flatnonzero(model.of_type & (weight > 0.0))
    if not len(which):
        return 0.0, 0
    d = (estimate - model.prior_mean)[which] * weight[which]
    seen = np.eye(len(which)) - covariance[np.ix_(which, which)] * np.outer(weight[which], weight[which])
    values, vectors = np.linalg.eigh(seen)
    known = values > _SEEN
    return float(np.sum((vectors.T @ d)[known] ** 2 / values[known])), int(known.sum())


def _redundant(at: Linearisation, prior: TypePrior) -> tuple[frozenset[str], dict[str, str]]:
    """Find parameters that are redundant in the type and here, and priors that do not hold here.

    The former are removed. The latter belong to shared parameters that made up for a parameter which
    these readings distinguish from them; the reason is given by name.
    """
    index, columns = at.design.model.index, at.columns
    gone, unlike = set[str](), dict[str, str]()
    for drop in prior.redundant:
        shared = [name for name, _ in drop.stand_ins if name in prior.shares]
        if drop.name not in index or not shared:
            continue
        own = columns[:, index[drop.name]]
        left = own.copy()
        for name, move in drop.stand_ins:
            if name in index:
                left = left - move * columns[:, index[name]]
        if np.linalg.norm(left) <= _SAME * max(float(np.linalg.norm(own)), 1.0):
            gone.add(drop.name)
        else:
            unlike |= dict.fromkeys(
                shared, f"these readings tell {drop.name} from it, those of the type did not"
            )
    return frozenset(gone), unlike


def _less(effect: Effect, gone: frozenset[str]) -> Effect:
    if not any(p.name in gone for p in effect.parameters):
        return effect
    return replace(
        effect,
        parameters=tuple(p for p in effect.parameters if p.name not in gone),
        terms=tuple(t for t in effect.terms if t.parameter not in gone),
    )


def _with(model: ModelStructure, change: Callable[[Parameter], Parameter], owner: str = "") -> ModelStructure:
    """Change the parameters of a model: of the effects of one owner, or of all."""
    return replace(
        model,
        effects=tuple(
            replace(e, parameters=tuple(change(p) for p in e.parameters)) if owner in ("", e.owner) else e
            for e in model.effects
        ),
    )
