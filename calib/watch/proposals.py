"""What it would take to see more: other targets at the same poses, more readings in a visit, more visits.

The readings of a wrist are short of lever, not of choice: of joint 6 every pose shows the same, by how much its targets
are off the axis. With the lever r, n readings and their noise s a zero is seen from about 5 s / (r sqrt(n)), play from
twice as much; so what helps are targets farther off, more targets, more readings while the robot stands, and more
visits, which cost most.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from calib.data.header import Header
from calib.saved import SavedModel
from calib.watch.rounds import fewest
from calib.watch.visits import Visits


@dataclass(frozen=True)
class Proposal:
    """Some targets at every pose, how often each is visited, and how often everything is read in a visit; what the
    readings are, and the cause that is furthest from the size that should be seen, with the size from which it is;
    reached: whether every cause is seen from there."""

    targets: tuple[str, ...]
    rounds: int
    readings: int
    label: str
    size: float
    reached: bool
    repeats: int = 1


def proposals(
    saved: SavedModel,
    header: Header,
    visits: Visits,
    choices: Sequence[tuple[str, ...]],
    limit: float,
    *,
    frame_known: bool = True,
) -> tuple[Proposal, ...]:
    """Of each choice of targets the cheapest rounds of the visits that show every cause from the size that it should
    be seen at, or what comes near the best; cheapest first, then what comes nearest. limit: p-value of an alarm."""
    found = []
    for targets in choices:
        those = Visits.of_points(visits.joints, visits.sides, visits.reach, targets)
        tried = fewest(saved, header, those, limit, frame_known=frame_known)
        readings, reached = tried.rounds.of(those).readings, tried.short <= 1.0
        order = (0.0, tried.rounds.cost(those)) if reached else (1.0, tried.short)
        each = Proposal(
            targets, tried.rounds.times, readings, tried.label, tried.size, reached, tried.rounds.repeats
        )
        found.append((order, each))
    return tuple(each for _, each in sorted(found, key=lambda pair: pair[0]))
