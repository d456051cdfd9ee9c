"""Number of visits and readings of a watch: the fewest that detect every required cause.

Repeated readings during a rest average the instrument's noise and cost a second or two. Another visit from the opposite
sides also averages the robot's repeatability, shows backlash by itself, and costs a move. Neither helps against the
uncertainty of the baseline, its unmodelled scatter, or a frame that is set up again. A cause that these hide must be
detected at about the size at which the largest number of readings detects it.

`proposals` suggests how to detect more: other targets at the same poses, more readings in a visit, more visits.

A different choice of poses does not help a wrist, but a longer lever does. For joint 6 every pose shows the same: the
distance of its targets from the axis. With the lever r, n readings and their noise s a zero is detected from about
5 s / (r sqrt(n)), backlash from twice as much. Targets farther from the axis, more targets, and more readings in each
rest therefore help, and so do more visits, which cost most.
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
_MOVE = 4  # cost of an arrival, in readings
_NEAR = 1.1  # fewer readings are preferred up to this multiple of the smallest detectable size


@dataclass(frozen=True)
class Repetitions:
    """Number of visits to each pose, and of readings of everything in each visit."""

    times: int = 1
    repeats: int = 1

    def of(self, visits: PlannedVisits) -> PlannedVisits:
        """Repeat the visits and their readings."""
        return visits.read_again(self.repeats).again(self.times)

    def cost(self, visits: PlannedVisits) -> float:
        """Compute the cost of the rounds, in readings."""
        return self.times * (_MOVE * len(visits) + self.repeats * visits.readings)


@dataclass(frozen=True)
class RepetitionOptions:
    """Possible repetitions of some readings.

    Attributes
    ----------
    limit : float
        P-value of an alarm.
    lack : array of shape (N,) or None
        Unmodelled scatter, as in `WhitenedReadings.of`.
    """

    saved: CalibratedModel
    header: Header
    limit: float
    frame_known: bool = True
    lack: Array | None = None

    def sizes(self, visits: PlannedVisits, rounds: Repetitions) -> dict[str, float]:
        """Compute the smallest detected size of every cause with a required size.

        The size is infinite if no reading shows the cause.
        """
        would = planned(self.saved, self.header, rounds.of(visits))
        seen = WhitenedReadings.of(self.saved, would, frame_known=self.frame_known, lack=self.lack)
        return seen_from(seen, self.limit)

    def goal(self, visits: PlannedVisits) -> dict[str, float]:
        """Return the size at which every cause should be detected.

        If no number of readings at these poses detects it at the required size, the goal is 1.1 times the smallest
        size.
        """
        best = self.sizes(visits, Repetitions(_times(visits)[-1], REPEATS[-1]))
        return {
            label: wanted(label) if size <= wanted(label) else _NEAR * size for label, size in best.items()
        }


@dataclass(frozen=True)
class DetectionResult:
    """Sizes that some rounds detect, and the sizes that they should detect."""

    rounds: Repetitions
    sizes: Mapping[str, float]
    goal: Mapping[str, float] = field(repr=False)

    @property
    def worst(self) -> str:
        """Cause that is farthest from its required size."""
        return max(self.sizes, key=lambda each: self.sizes[each] / wanted(each))

    @property
    def beyond(self) -> tuple[str, ...]:
        """Causes that no number of readings detects at the required size."""
        return tuple(label for label, size in self.goal.items() if size > wanted(label))

    @property
    def short(self) -> float:
        """Ratio of detected size to goal of the worst cause; no goal is missed up to 1."""
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
    """Find the cheapest rounds of visits that reach a goal, or those that come nearest.

    Pass `times` or `repeats` to fix the number of visits or of readings.
    """

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
    """Return the numbers of visits to try.

    It is one if every joint always arrives from one side, since the next visit would come from the other side.
    """
    return TIMES[:1] if np.all(visits.sides == visits.sides[:1]) else TIMES


def _first(
    tried: Callable[[Repetitions], DetectionResult], most: DetectionResult, repeats: tuple[int, ...]
) -> DetectionResult:
    """Find the fewest sufficient repeats by bisection: more repeats never show less."""
    low, high, best = 0, len(repeats) - 1, most
    while low < high:
        middle = (low + high) // 2
        if (found := tried(Repetitions(most.rounds.times, repeats[middle]))).short <= 1.0:
            high, best = middle, found
        else:
            low = middle + 1
    return best


def wanted(label: str) -> float:
    """Return the size at which the cause of a label should be detected, deg or mm."""
    return WANTED[label.partition(":")[0]]


@dataclass(frozen=True)
class WatchPlanProposal:
    """Proposal for a watch with some targets at every pose.

    Attributes
    ----------
    targets : tuple of str
        Targets to measure.
    rounds : int
        Number of visits to each pose.
    readings : int
        Number of readings in total.
    label : str
        Cause that is farthest from its required size.
    size : float
        Smallest size at which that cause is detected, deg or mm.
    reached : bool
        Whether every cause is detected at its required size.
    repeats : int
        Number of times that everything is read in a visit.
    beyond : tuple of (str, float)
        Causes that no number of readings of these targets detects at the required size, with the size that these
        readings detect.
    """

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
    """Propose the cheapest rounds of visits for each choice of targets.

    The rounds detect every cause at its required size. A cause that no number of readings detects there is detected
    nearly as well as possible.

    Parameters
    ----------
    choices : sequence of tuple of str
        Choices of targets.
    limit : float
        P-value of an alarm.

    Returns
    -------
    tuple of WatchPlanProposal
        First those that detect most causes, then the cheapest.
    """
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
