"""What stands in the library: rows, each one parameter of one joint on one slot, and entries with code of their own."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Protocol

from calib.effects.kind import Kind
from calib.effects.survey import Survey
from calib.model.effect import Bounds, Effect, Group, effect
from calib.model.regressors import Regressor
from calib.scan.families import Candidate
from calib.scan.scores import Family


class Offers(Protocol):
    """What the library holds and what other packages bring: kinds, and candidates for some readings."""

    @property
    def KINDS(self) -> tuple[Kind, ...]:
        """The kinds that are offered."""
        ...

    def offer(self, survey: Survey, /) -> Sequence[Family]:
        """The candidates."""
        ...


@dataclass(frozen=True)
class Entry:
    """Kinds of effects by one law, what is offered of them, and what of them may have begun since a calibration."""

    law: str
    KINDS: tuple[Kind, ...]
    offer: Callable[[Survey], Sequence[Family]]
    changes: Callable[[Survey], list[Effect]] | None = None


@dataclass(frozen=True)
class Row:
    """An effect of one joint: `parameter` moves the `slot` of the joint by weight x parameter x regressor.

    law: what it does, in a sentence and a formula; means: one sentence with {joint}; size, bounds: usual size and what
    physics allows, in `unit`; where: the joints of which the readings can show it. measure: a figure of the readings
    for a joint, by which the usual size goes, or which the effect keeps as the constant `shape` of its regressor. It
    may have begun since a calibration if its kind says what has changed.
    """

    kind: Kind
    law: str
    means: str
    parameter: str
    unit: str
    size: float | Callable[[float], float]
    slot: str
    regressor: Callable[..., Regressor]
    where: Callable[[Survey], Iterable[int]]
    weight: float = 1.0
    bounds: Bounds = (None, None)
    group: Group = "transmission"
    measure: Callable[[Survey, int], float] | None = None
    shape: str = ""

    def __call__(self, joint: int, measured: float = 0.0) -> Effect:
        """The effect of `joint`; measured: the figure of `measure`, where the row has one."""
        shape = {self.shape: measured} if self.shape else {}
        acts = [(f"{self.slot}{joint}", self.regressor(joint, *shape.values()), self.weight)]
        size = self.size(measured) if callable(self.size) else self.size
        return effect(
            f"{self.kind.name}:j{joint}",
            self.group,
            "robot",
            self.means.format(joint=joint),
            {self.parameter: (self.unit, size, acts, self.bounds)},
            shape,
        )

    @property
    def KINDS(self) -> tuple[Kind, ...]:
        """The kind."""
        return (self.kind,)

    def offer(self, survey: Survey) -> list[Candidate]:
        """The candidates, one for each joint of which the readings can show it."""
        joints = self.where(survey)
        if self.measure is None:
            return [Candidate(self(joint)) for joint in joints]
        return [Candidate(self(joint, self.measure(survey, joint))) for joint in joints]

    @property
    def changes(self) -> Callable[[Survey], list[Effect]] | None:
        """The effects that may have begun since a calibration; None where it never begins."""
        return (lambda survey: [self(joint) for joint in self.where(survey)]) if self.kind.changed else None
