"""A kind of effect apart from its mathematics: what a technician checks, and what distinguishes it from others.

Every file of the library declares its kinds; reports and follow-ups use only these declarations.
"""

from __future__ import annotations

from dataclasses import dataclass

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
class Kind:
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


def distinguishing(one: Kind, other: Kind) -> list[str]:
    """The procedures that distinguish two kinds, those that several kinds share first."""
    proposed = dict.fromkeys([*one.apart, *other.apart])
    if one.by_clock and other.by_clock:
        proposed.pop(OTHER_WARMTH, None)
    shared = [each for each in PROCEDURES if each in proposed]
    return [*shared, *(each for each in proposed if each not in PROCEDURES)]
