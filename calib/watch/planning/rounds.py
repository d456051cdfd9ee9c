"""The rounds of a watch, visits to each check pose and readings there: as seldom as shows every cause that should be
seen.

Repeated readings during a rest average the instrument's noise and cost a second or two. Another visit from the opposite
sides also averages the robot's repeatability, shows play by itself, and costs a move. Neither helps against
what the baseline does not know, what it lacks, or a frame that is set up anew: a cause that these hide is to be seen
from about where the most readings see it.

Proposals to see more: other targets at the same poses, more readings in a visit, more visits.

The readings of a wrist are short of lever, not of choice: of joint 6 every pose shows the same, by how much its targets
are off the axis. With the lever r, n readings and their noise s a zero is seen from about 5 s / (r sqrt(n)), play from
twice as much; so what helps are targets farther off, more targets, more readings in each rest, and more
visits, which cost most.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from calib.array import Array
from calib.data.header import Header
from calib.saved import CalibratedModel
from calib.watch.planning.planned import PlannedVisits, planned
from calib.watch.planning.sizes import WANTED, seen_from
from calib.watch.whitened_readings import WhitenedReadings

TIMES = (1, 2, 4)
REPEATS = (1, 2, 3, 4, 6, 8, 12)
_MOVE = 4  # readings that an arrival costs
_NEAR = 1.1  # of the smallest size that any readings show, up to which fewer are preferred


@dataclass(frozen=True)
class Repetitions:
    """Visits to each pose, and readings of everything in each visit."""

    times: int = 1
    repeats: int = 1

    def of(self, visits: PlannedVisits) -> PlannedVisits:
        """The visits made and read so often."""
        return visits.read_again(self.repeats).again(self.times)

    def cost(self, visits: PlannedVisits) -> float:
        """The cost of the rounds, in readings."""
        return self.times * (_MOVE * len(visits) + self.repeats * visits.readings)


@dataclass(frozen=True)
class RepetitionOptions:
    """The possible repetitions of some readings. limit: p-value of an alarm; lack: as
    `WhitenedReadings.of`."""

    saved: CalibratedModel
    header: Header
    limit: float
    frame_known: bool = True
    lack: Array | None = None

    def sizes(self, visits: PlannedVisits, rounds: Repetitions) -> dict[str, float]:
        """The size from which every cause is seen that has one at which it should be; infinite where nothing shows
        it."""
        would = planned(self.saved, self.header, rounds.of(visits))
        seen = WhitenedReadings.of(self.saved, would, frame_known=self.frame_known, lack=self.lack)
        return seen_from(seen, self.limit)

    def goal(self, visits: PlannedVisits) -> dict[str, float]:
        """The size from which every cause should be seen, where any number of readings at these poses can show it."""
        best = self.sizes(visits, Repetitions(_times(visits)[-1], REPEATS[-1]))
        return {
            label: wanted(label) if size <= wanted(label) else _NEAR * size for label, size in best.items()
        }


@dataclass(frozen=True)
class DetectionResult:
    """The sizes that some rounds show: from which size every cause is seen, and from which it should be."""

    rounds: Repetitions
    sizes: Mapping[str, float]
    goal: Mapping[str, float] = field(repr=False)

    @property
    def worst(self) -> str:
        """The cause that is furthest from the size that should be seen."""
        return max(self.sizes, key=lambda each: self.sizes[each] / wanted(each))

    @property
    def beyond(self) -> tuple[str, ...]:
        """The causes that no readings show from the size at which they should be seen."""
        return tuple(label for label, size in self.goal.items() if size > wanted(label))

    @property
    def short(self) -> float:
        """The factor by which the size is too large, of the cause that is furthest from its goal; none above 1."""
        factors = (
            self.sizes.get(each, np.inf) / goal for each, goal in self.goal.items() if np.isfinite(goal)
        )
        return max(factors, default=0.0)


def fewest(
    ways: RepetitionOptions,
    visits: PlannedVisits,
    goal: Mapping[str, float],
    *,
    times: int | None = None,
    repeats: int | None = None,
) -> DetectionResult:
    """The cheapest rounds of visits that reach a goal; where none do, what comes nearest. times, repeats: where they
    are given."""

    def tried(rounds: Repetitions) -> DetectionResult:
        return DetectionResult(rounds, ways.sizes(visits, rounds), goal)

    each_time = _times(visits) if times is None else (times,)
    each_repeat = REPEATS if repeats is None else (repeats,)
    most = [tried(Repetitions(t, each_repeat[-1])) for t in each_time]
    found = [_first(tried, each, each_repeat) for each in most if each.short <= 1.0]
    if not found:
        return min(most, key=lambda each: each.short)
    return min(found, key=lambda each: each.rounds.cost(visits))


def _times(visits: PlannedVisits) -> tuple[int, ...]:
    """The numbers of visits to try: once where every joint always comes from one side, since the next visit would
    come from the other."""
    return TIMES[:1] if np.all(visits.sides == visits.sides[:1]) else TIMES


def _first(
    tried: Callable[[Repetitions], DetectionResult], most: DetectionResult, repeats: tuple[int, ...]
) -> DetectionResult:
    """The fewest repeats that are enough, by halving: more never show less."""
    low, high, best = 0, len(repeats) - 1, most
    while low < high:
        middle = (low + high) // 2
        if (found := tried(Repetitions(most.rounds.times, repeats[middle]))).short <= 1.0:
            high, best = middle, found
        else:
            low = middle + 1
    return best


def wanted(label: str) -> float:
    """The size at which the cause of a label should be seen, deg or mm."""
    return WANTED[label.partition(":")[0]]


@dataclass(frozen=True)
class WatchPlanProposal:
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
    saved: CalibratedModel,
    header: Header,
    visits: PlannedVisits,
    choices: Sequence[tuple[str, ...]],
    limit: float,
    *,
    frame_known: bool = True,
) -> tuple[WatchPlanProposal, ...]:
    """The proposals: of each choice of targets the cheapest rounds of the visits that show every cause from the size
    that it should be seen at, and a cause that no readings show from there about as well as any do; first what shows
    most causes, then what costs least. limit: p-value of an alarm."""
    ways, found = RepetitionOptions(saved, header, limit, frame_known), []
    for targets in choices:
        those = PlannedVisits.of_points(visits.joints, visits.sides, visits.reach, targets)
        tried = fewest(ways, those, ways.goal(those))
        each = WatchPlanProposal(
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
