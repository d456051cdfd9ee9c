"""Proposals to see more: other targets at the same poses, more readings in a visit, more visits.

The readings of a wrist are short of lever, not of choice: of joint 6 every pose shows the same, by how much its targets
are off the axis. With the lever r, n readings and their noise s a zero is seen from about 5 s / (r sqrt(n)), play from
twice as much; so what helps are targets farther off, more targets, more readings in each rest, and more
visits, which cost most.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from calib.data.header import Header
from calib.saved import SavedModel
from calib.watch.planning.rounds import Ways, fewest
from calib.watch.planning.visits import Visits


@dataclass(frozen=True)
class Proposal:
    """Some targets at every pose, how often each is visited, and how often everything is read in a visit; what the
    readings are, and the cause that is furthest from the size that should be seen, with the size from which it is;
    reached: whether every cause is seen from there; beyond: causes that no readings of these targets show from there,
    by label with the size from which these do."""

    targets: tuple[str, ...]
    rounds: int
    readings: int
    label: str
    size: float
    reached: bool
    repeats: int = 1
    beyond: tuple[tuple[str, float], ...] = ()


def proposals(
    saved: SavedModel,
    header: Header,
    visits: Visits,
    choices: Sequence[tuple[str, ...]],
    limit: float,
    *,
    frame_known: bool = True,
) -> tuple[Proposal, ...]:
    """The proposals: of each choice of targets the cheapest rounds of the visits that show every cause from the size
    that it should be seen at, and a cause that no readings show from there about as well as any do; first what shows
    most causes, then what costs least. limit: p-value of an alarm."""
    ways, found = Ways(saved, header, limit, frame_known), []
    for targets in choices:
        those = Visits.of_points(visits.joints, visits.sides, visits.reach, targets)
        tried = fewest(ways, those, ways.goal(those))
        each = Proposal(
            targets,
            tried.rounds.times,
            tried.rounds.of(those).readings,
            tried.worst,
            tried.sizes[tried.worst],
            not tried.beyond,
            tried.rounds.repeats,
            tuple((label, tried.sizes[label]) for label in tried.beyond),
        )
        found.append(((len(each.beyond), tried.rounds.cost(those)), each))
    return tuple(each for _, each in sorted(found, key=lambda pair: pair[0]))
