"""Kinds of effects without their mathematics, and the entries of the library.

A kind states what a technician checks, and what distinguishes it from other kinds. Every module of the library declares
its kinds; reports and follow-ups use only these declarations.

An entry of the library is a `Row`, one parameter of one joint on one slot, or an `EffectModule` with separate code.
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
    """Kind of effect, identified by its name, the part of a label up to the first colon.

    Texts may contain {joint} or {name} if the label has one.

    Attributes
    ----------
    check : str
        First check for a technician, and how to verify the finding, in a sentence or two. It is no work order: the
        robot's own manual states how to repair a gear or a bearing.
    apart : tuple of str
        Procedures, as the end of a sentence, that distinguish the kind from another if no pose within the limits does.
        Empty if none is known.
    by_clock : bool
        Whether time alone drives the effect. A temperature that does not follow the clock cannot distinguish two such
        kinds.
    words : str
        Name for readers who do not know labels: a few words without a verb. May contain {times} ("once", "17 times").
    changed, remedy : str
        Description and remedy if the kind has set in between two campaigns, with {joint} and {size}. Empty if it never
        does.
    """

    name: str
    check: str
    apart: tuple[str, ...]
    by_clock: bool = False
    words: str = ""
    changed: str = ""
    remedy: str = ""

    def check_of(self, label: str) -> str:
        """Return advice on what to check for the effect of this label of the kind."""
        return self.check.format(**_named(label))

    def words_of(self, label: str) -> str:
        """Return the name in reports of the effect of this label, or the label if there is none."""
        return self.words.format(**_named(label)) or label

    def changed_of(self, label: str, size: str) -> str:
        """Describe the change for the effect of this label of the kind."""
        return self.changed.format(**_named(label), size=size)

    def remedy_of(self, label: str, size: str) -> str:
        """Return advice on the remedy for the effect of this label of the kind."""
        return self.remedy.format(**_named(label), size=size)


def _named(label: str) -> dict[str, str]:
    """Return name, joints and numbers of a label as text.

    For example, "periodic:j2:n3" is joint 2 and 3 times, and "coupling:j4-j5" is joints 4 and 5.
    """
    name, _, order = label.partition(":")[2].partition(":")
    joint = " and ".join(part.removeprefix("j") for part in name.split("-"))
    times = order.removeprefix("n")
    return {
        "name": name,
        "joint": joint,
        "times": {"1": "once", "2": "twice", "": "several times"}.get(times, f"{times} times"),
    }


def distinguishing(one: EffectKind, other: EffectKind) -> list[str]:
    """List the procedures that distinguish two kinds, shared procedures first."""
    proposed = dict.fromkeys([*one.apart, *other.apart])
    if one.by_clock and other.by_clock:
        proposed.pop(OTHER_WARMTH, None)
    shared = [each for each in PROCEDURES if each in proposed]
    return [*shared, *(each for each in proposed if each not in PROCEDURES)]


class Offers(Protocol):
    """Entry of the library or of another package: kinds, and candidates for some readings."""

    @property
    def KINDS(self) -> tuple[EffectKind, ...]:
        """Kinds that the entry offers."""
        ...

    def offer(self, survey: Survey, /) -> Sequence[Family]:
        """Return the candidates for some readings."""
        ...


@dataclass(frozen=True)
class EffectModule:
    """Kinds of effects with one law, their candidates, and the effects that may have begun.

    `changes` returns the effects that may have begun since a calibration.
    """

    law: str
    KINDS: tuple[EffectKind, ...]
    offer: Callable[[Survey], Sequence[Family]]
    changes: Callable[[Survey], list[Effect]] | None = None


@dataclass(frozen=True)
class Row:
    """Effect of one joint: `parameter` moves a `slot` by weight x parameter x regressor.

    The slot is that of the joint. The effect may have begun since a calibration if its kind describes the change.

    Attributes
    ----------
    law : str
        Description in a sentence and a formula.
    means : str
        One sentence with {joint}.
    size, bounds
        Usual size and physical bounds, in `unit`.
    where : callable
        Returns the joints for which the readings can show the effect.
    measure : callable or None
        Returns a value of the readings for a joint. The usual size depends on it, or the effect keeps it as the
        constant `shape` of its regressor.
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
        """Build the effect of `joint`; `measured` is the value from `measure`, if the row has one."""
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
        """Kind of the row."""
        return (self.kind,)

    def offer(self, survey: Survey) -> list[Candidate]:
        """Return one candidate for each joint for which the readings can show the effect."""
        joints = self.where(survey)
        if self.measure is None:
            return [Candidate(self(joint)) for joint in joints]
        return [Candidate(self(joint, self.measure(survey, joint))) for joint in joints]

    @property
    def changes(self) -> Callable[[Survey], list[Effect]] | None:
        """Function that lists the effects that may have begun since a calibration, or None."""
        return (lambda survey: [self(joint) for joint in self.where(survey)]) if self.kind.changed else None
