"""The prior from a robot's type: Gaussian rows on parameters, and the tests whether this robot agrees with them.

A parameter that robots of the type share has the prior N(centre, spread^2) in the place of its usual size. With V its
posterior variance and h = V / spread^2 the share of it that the prior decides, the fit without this one prior row
would lie

    z = (estimate - centre) / (spread sqrt(1 - h))

standard deviations from the type: its variance is what the readings leave, V / (1 - h), and the spread. One |z| that
chance does not make among so many parameters says that this robot is no member of the type there: the row is taken
out, the usual size holds the parameter again, and everything is fitted anew. What is left is judged together by

    X^2 = d'M^+ d,    d = (estimate - centre) / spread,    M = I - V / (spread spread'),

over the directions that the readings see. Where that is too large, or too many rows were taken out, the robot is no
member of the type, and the whole prior is left out: a fit that is not sure of it is better off without.
Source: Box 1980 (prior and readings in conflict); Cook and Weisberg 1982 (deletion of rows).
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
    """A parameter of a type: mean over its robots, and standard deviation of a further robot about it (display
    unit)."""

    name: str
    unit: str
    centre: float
    spread: float


@dataclass(frozen=True)
class TypeEffect:
    """An effect beside the base model, by label and shape, and in how many robots of a type it was found."""

    label: str
    shape: Mapping[str, float]
    robots: int


@dataclass(frozen=True)
class TypePrior:
    """A prior that the robots of one type share, as a fit takes it.

    robot, robot_sha256, coupling: the type; groups: what of the robot its base model frees; redundant: parameters that
    no readings of the type determined, and what makes up for them; found: effects beside the base model; robots: how
    many it was learnt from; sha256: of the file.
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
        """The effects that are frequent in the type, with shares of one half of all tries in proportion."""
        often = [f for f in self.found if f.robots >= max(_TWICE, _FREQUENT * self.robots)]
        total = sum(f.robots for f in often)
        return tuple(TypeEffectPrior(f.label, f.shape, 0.5 * f.robots / total) for f in often)

    def refuse_other(self, robot: Robot, coupling: str, groups: Sequence[str]) -> None:
        """Raise DataError for a robot of another type, or a base model that frees something else of it."""
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
                do="Free the same groups under [model] fit: what one leaves out the others make up for.",
                key="prior",
            )


@dataclass(frozen=True)
class ParameterWeight:
    """A parameter with what decided it. decided: share of the prior, 0 to 1; z: as the module has it, nan where the
    readings say nothing; centre and spread as they were learnt."""

    name: str
    centre: float
    spread: float
    decided: float
    z: float


@dataclass(frozen=True)
class TypeFit:
    """A fit beside its type. outside: parameters whose prior was taken out, as they were then; open: those to which the
    prior cannot be put, and why; chi_square over `freedom` directions of what was left of the prior; left_out: whether
    all of it was left out in the end."""

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
        """Sentences on where this robot lies outside its type."""
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


def held_to(
    at: Linearisation, prior: TypePrior, spoken_for: frozenset[str] = frozenset()
) -> tuple[ModelStructure, TypeFit]:
    """The base model of some readings, linearised at its start, with what its type shares in the place of usual sizes.

    What was redundant in the type and is redundant here too leaves the model: the prior is of what makes up for it.
    spoken_for: parameters for which the user gave another prior.
    """
    gone, unlike = _redundant(at, prior)
    effects = tuple(_less(e, gone) for e in at.design.model.effects)
    model = replace(
        at.design.model, effects=tuple(e for e in effects if e.parameters), expected=prior.expected
    )
    wanted = frozenset(prior.shares) - spoken_for - frozenset(unlike)
    return centred(model, prior, wanted), TypeFit(prior, open=unlike)


def centred(model: ModelStructure, prior: TypePrior, names: frozenset[str]) -> ModelStructure:
    """A model in which these parameters of the robot have the prior of the type."""

    def with_prior(p: Parameter) -> Parameter:
        share = prior.shares.get(p.name)
        if p.name not in names or share is None or share.unit != p.unit:
            return p
        return replace(p, size=share.spread, centre=share.centre)

    return _with(model, with_prior, "robot")


def loosened(
    model: ModelStructure, usual: Mapping[str, Parameter], name: str | None = None
) -> ModelStructure:
    """A model in which one parameter has its usual size again; None: all of them."""
    return _with(model, lambda p: usual[p.name] if p.name in usual and name in (None, p.name) else p)


def weighed(
    model: ModelStructure, estimate: Array, covariance: Array, weight: Array
) -> tuple[ParameterWeight, ...]:
    """Every parameter that has a prior of its type, with what decided it.

    estimate (m,), covariance (m, m), internal units; weight: (m,) one over the standard deviation that the prior had
    in the fit.
    """
    out = []
    for i in np.flatnonzero(model.of_type & (weight > 0.0)):
        p = model.parameters[i]
        decided = float(np.clip(covariance[i, i] * weight[i] ** 2, 0.0, 1.0))
        off = float((estimate[i] - model.prior_mean[i]) * weight[i])
        z = off / np.sqrt(1.0 - decided) if decided < 1.0 - _SEEN else np.nan
        out.append(ParameterWeight(p.name, float(p.centre or 0.0), float(p.size or 0.0), decided, float(z)))
    return tuple(out)


def stranger(shown: tuple[ParameterWeight, ...], robots: int) -> ParameterWeight | None:
    """The parameter that lies farthest outside the type, where chance does not bring one of so many there; robots: by
    how many the spreads are known, which gives them Student's t."""
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
    """Parameters that are redundant here as they were in the type, and go; and the shared ones that made up for a
    parameter which these readings distinguish from them, with the reason why their prior does not hold."""
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
    """The model with other parameters: of the effects of one owner, or of all."""
    return replace(
        model,
        effects=tuple(
            replace(e, parameters=tuple(change(p) for p in e.parameters)) if owner in ("", e.owner) else e
            for e in model.effects
        ),
    )
