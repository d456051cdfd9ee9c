"""How often to visit each check pose, and how often to read there: as seldom as shows every cause that should be seen.

Reading again while the robot stands averages the instrument's noise and costs a second or two; coming again, from the
opposite sides, averages the robot's repeatability too, shows play by itself, and costs a move.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from calib.data.header import Header
from calib.saved import SavedModel
from calib.watch.planned import planned
from calib.watch.seen import Seen
from calib.watch.sizes import seen_from
from calib.watch.visits import Visits
from calib.watch.wanted import WANTED

TIMES = (1, 2, 4)
REPEATS = (1, 2, 3, 4, 6, 8, 12)
_MOVE = 4  # readings that an arrival costs
_NEAR = 1.1  # of the smallest size that was found, up to which fewer readings are preferred


@dataclass(frozen=True)
class Rounds:
    """Visits to each pose, and readings of everything in each visit."""

    times: int = 1
    repeats: int = 1

    def of(self, visits: Visits) -> Visits:
        """The visits made and read so often."""
        return visits.read_again(self.repeats).again(self.times)

    def cost(self, visits: Visits) -> float:
        """What they cost, in readings."""
        return self.times * (_MOVE * len(visits) + self.repeats * visits.readings)


@dataclass(frozen=True)
class Tried:
    """What some rounds show: the cause that is furthest from the size that should be seen, and the size from which it
    is; short: by how many times that is too large."""

    rounds: Rounds
    label: str
    size: float
    short: float


def fewest(
    saved: SavedModel,
    header: Header,
    visits: Visits,
    limit: float,
    *,
    times: int | None = None,
    repeats: int | None = None,
    frame_known: bool = True,
    lack: float | None = None,
) -> Tried:
    """The cheapest rounds of visits that show every cause from the size that it should be seen at; where none do, the
    cheapest that come near the best. limit: p-value of an alarm; times, repeats: where they are given; lack: as
    `Seen.of`."""

    def tried(rounds: Rounds) -> Tried:
        seen = Seen.of(saved, planned(saved, header, rounds.of(visits)), frame_known=frame_known, lack=lack)
        sizes = seen_from(seen, limit)
        label = max(sizes, key=lambda each: sizes[each] / WANTED[each.partition(":")[0]])
        return Tried(rounds, label, sizes[label], sizes[label] / WANTED[label.partition(":")[0]])

    each_time = TIMES if times is None else (times,)
    each_repeat = REPEATS if repeats is None else (repeats,)
    most = [tried(Rounds(t, each_repeat[-1])) for t in each_time]
    enough = max(1.0, _NEAR * min(each.short for each in most))
    found = [_first(tried, each, each_repeat, enough) for each in most if each.short <= enough]
    return min(found, key=lambda each: each.rounds.cost(visits))


def _first(tried: Callable[[Rounds], Tried], most: Tried, repeats: tuple[int, ...], enough: float) -> Tried:
    """The fewest repeats that are enough, by halving: more never show less."""
    low, high, best = 0, len(repeats) - 1, most
    while low < high:
        middle = (low + high) // 2
        if (found := tried(Rounds(most.rounds.times, repeats[middle]))).short <= enough:
            high, best = middle, found
        else:
            low = middle + 1
    return best
