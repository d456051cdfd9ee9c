"""What it would take to see more: other targets at the same poses, and more rounds of visits.

The readings of a wrist are short of lever, not of choice: of joint 6 every pose shows the same, by how much its targets
are off the axis. With the lever r, n readings and their noise s a zero is seen from about 5 s / (r sqrt(n)); so what
helps are more targets, targets farther off, or more rounds, in that order of cost.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib.data.header import Header
from calib.saved import SavedModel
from calib.watch.planned import planned
from calib.watch.seen import Seen
from calib.watch.sizes import WANTED, seen_from
from calib.watch.visits import Visits

ROUNDS = (1, 2, 3, 4, 6, 8)


@dataclass(frozen=True)
class Proposal:
    """Some targets at every pose, and how often each is visited; what the readings are, and the cause that is furthest
    from the size that should be seen, with the size from which it is; reached: whether every cause is seen from there.
    """

    targets: tuple[str, ...]
    rounds: int
    readings: int
    label: str
    size: float
    reached: bool


def proposals(
    saved: SavedModel,
    header: Header,
    visits: Visits,
    choices: Sequence[tuple[str, ...]],
    limit: float,
    *,
    frame_known: bool = True,
) -> tuple[Proposal, ...]:
    """Of each choice of targets the fewest rounds of the visits that show every cause from the size that it should be
    seen at, or the most rounds that were tried; fewest readings first, then what comes
    nearest. limit: p-value of an alarm."""
    found = [_fewest(saved, header, visits, targets, limit, frame_known=frame_known) for targets in choices]
    return tuple(
        sorted(found, key=lambda each: (each.readings, 0.0) if each.reached else (np.inf, each.size))
    )


def _fewest(
    saved: SavedModel,
    header: Header,
    visits: Visits,
    targets: tuple[str, ...],
    limit: float,
    *,
    frame_known: bool,
) -> Proposal:
    tried: list[Proposal] = []
    for rounds in ROUNDS:
        those = Visits.of_points(visits.joints, visits.sides, visits.reach, targets).again(rounds)
        seen = Seen.of(saved, planned(saved, header, those), frame_known=frame_known)
        sizes = seen_from(seen, limit)
        label = max(sizes, key=lambda each: sizes[each] / WANTED[each.partition(":")[0]])
        reached = sizes[label] <= WANTED[label.partition(":")[0]]
        tried.append(Proposal(targets, rounds, those.readings, label, sizes[label], reached))
        if reached:
            break
    return tried[-1]
