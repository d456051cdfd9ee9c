"""A kind of effect apart from its mathematics: what a technician checks, and what distinguishes it from others.

Every file of the library declares its kinds; reports and follow-ups use only these declarations.

What stands in the library: rows, each one parameter of one joint on one slot, and entries with code of their own.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Protocol

from calib.effects.survey import Survey
from calib.model.effect import Bounds, Effect, Group, effect
from calib.model.regressors import Regressor
from calib.scan.families import Candidate
from calib.scan.scores import Family

OTHER_SIDE = "visit the same poses from the other side, after moves of other lengths."

OTHER_WARMTH = (
    "pause until the air has another temperature, or measure in another order, "
    "so that temperature no longer follows the clock."
)

OTHER_LOAD = "measure some poses with another payload, declared in the header."
SECOND_TARGET = "measure a second tool target, 50 mm or more off the axis of the last joint."
OTHER_STATION = "measure the world nests again, or from another station."
LATER = "visit some of the first poses again at once and an hour later: what creeps goes on, what jumped does not."
PROCEDURES = (OTHER_SIDE, OTHER_WARMTH, OTHER_LOAD, SECOND_TARGET, OTHER_STATION, LATER)
"""Procedures that several kinds share, in the order in which they are advised."""


@dataclass(frozen=True)
class EffectKind:
    """A kind of effect by its name, which is its label up to the first colon.

    check: what a technician should look at first, and how to find out whether the finding is real, a sentence or two
    with {joint} or {name} where the label has one. It is no work order: what must be done to a gear or a bearing is in
    the robot's own manual. apart: procedures, as the end of a sentence, that distinguish the kind from another where
    no pose within the limits does; empty where nothing is known to. by_clock: whether time alone drives it, so that a
    temperature that does not follow the clock distinguishes no two such kinds. words: what it is called before readers
    who do not know labels, a few words without a verb, with {joint}, {name} and {times} ("once", "17 times") where the
    label has them. changed, remedy: what has happened and what to do where the kind has
    set in between two campaigns, with {joint} and {size}; empty where it never does.
    """

    name: str
    check: str
    apart: tuple[str, ...]
    by_clock: bool = False
    words: str = ""
    changed: str = ""
    remedy: str = ""

    def check_of(self, label: str) -> str:
        """Advice on what to check for the effect of this label of the kind."""
        return self.check.format(**_named(label))

    def words_of(self, label: str) -> str:
        """The name in reports of the effect of this label of the kind; the label where the kind has no words."""
        return self.words.format(**_named(label)) or label

    def changed_of(self, label: str, size: str) -> str:
        """The sentence that says what has happened, for the effect of this label of the kind."""
        return self.changed.format(**_named(label), size=size)

    def remedy_of(self, label: str, size: str) -> str:
        """Advice on the remedy, likewise."""
        return self.remedy.format(**_named(label), size=size)


def _named(label: str) -> dict[str, str]:
    """The joints and numbers of a label, in words: "periodic:j2:n3" joint 2 and 3 times, "coupling:j4-j5" joints 4
    and 5."""
    name, _, order = label.partition(":")[2].partition(":")
    joint = " and ".join(part.removeprefix("j") for part in name.split("-"))
    times = order.removeprefix("n")
    return {
        "name": name,
        "joint": joint,
        "times": {"1": "once", "2": "twice", "": "several times"}.get(times, f"{times} times"),
    }


def distinguishing(one: EffectKind, other: EffectKind) -> list[str]:
    """The procedures that distinguish two kinds, those that several kinds share first."""
    proposed = dict.fromkeys([*one.apart, *other.apart])
    if one.by_clock and other.by_clock:
        proposed.pop(OTHER_WARMTH, None)
    shared = [each for each in PROCEDURES if each in proposed]
    return [*shared, *(each for each in proposed if each not in PROCEDURES)]


class Offers(Protocol):
    """What the library holds and what other packages bring: kinds, and candidates for some readings."""

    @property
    def KINDS(self) -> tuple[EffectKind, ...]:
        """The kinds that are offered."""
        ...

    def offer(self, survey: Survey, /) -> Sequence[Family]:
        """The candidates."""
        ...


@dataclass(frozen=True)
class EffectModule:
    """Kinds of effects by one law, what is offered of them, and what of them may have begun since a calibration."""

    law: str
    KINDS: tuple[EffectKind, ...]
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

    kind: EffectKind
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
    def KINDS(self) -> tuple[EffectKind, ...]:
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
