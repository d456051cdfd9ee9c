"""Plan of a watch: visits, sides of approach and readings, and the changes they detect.

The module also finds the distance from the last axis that a target needs to show the required changes of the wrist.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from calib.array import Array
from calib.data.header import Header
from calib.errors import DataError
from calib.saved import CalibratedModel
from calib.units import DEG
from calib.watch.baseline import unmodelled_scatter
from calib.watch.judge import RATE, odds_of
from calib.watch.planning.choose import choose
from calib.watch.planning.planned import PlannedVisits, planned
from calib.watch.planning.rounds import DetectionResult, RepetitionOptions, Repetitions, fewest, wanted
from calib.watch.planning.sizes import DetectableSizes, shown
from calib.watch.whitened_readings import WhitenedReadings

FEWEST = 4
_MOST = 60  # largest number of poses that is tried
_TRIES = 3
_STEPS = 6
_NEAR = 0.02
_FARTHEST_MM = 1000.0


@dataclass(frozen=True)
class WatchPlan:
    """Plan of a watch.

    Attributes
    ----------
    chosen : tuple of int
        Indices of the chosen candidates.
    visits : PlannedVisits
        All visits, with each chosen candidate `rounds` times.
    shown : DetectableSizes
        Sizes that the plan detects.
    rounds : int
        Number of visits to each chosen candidate.
    repeats : int
        Number of times that everything is read in a visit.
    enough : int or None
        Number of poses that would detect all causes at the required size, or all others, with the same rounds and
        repeats. None if this plan does so, or if no number of poses would.
    beyond : tuple of str
        Labels of causes that no number of readings detects at the required size.
    lever : (str, float) or None
        If a cause of the last joint is detected worst: its label, and the distance from the axis, mm, that the only
        target would need.
    """

    chosen: tuple[int, ...]
    visits: PlannedVisits
    shown: DetectableSizes
    rounds: int = 1
    repeats: int = 1
    enough: int | None = None
    beyond: tuple[str, ...] = ()
    lever: tuple[str, float] | None = None


def plan(
    saved: CalibratedModel,
    header: Header,
    candidates: PlannedVisits,
    count: int,
    rate: float = RATE,
    *,
    times: int | None = 1,
    repeats: int | None = 1,
    frame_known: bool = True,
) -> WatchPlan:
    """Plan a watch: choose poses among candidates, and the visits and readings at each.

    Every other visit to a pose comes from the opposite sides.

    Parameters
    ----------
    header : Header
        Header of the data set that the readings would have.
    candidates : PlannedVisits
        Candidates, each with the same number of readings.
    count : int
        Number of poses to choose.
    rate : float, optional
        False-alarm rate of the watch.
    times, repeats : int or None, optional
        Visits to each pose, and readings of everything in each visit. None: the fewest that detect every cause at the
        required size, or at nearly the smallest size that any number detects.
    frame_known : bool, optional
        False if the position of the instrument or the artefact will not be compared.

    Raises
    ------
    DataError
        The number of poses is too small to show anything, or exceeds the number of candidates.
    """
    if not FEWEST <= count <= len(candidates):
        raise DataError(f"is {count}.", do=f"Give {FEWEST} to {len(candidates)} poses.", key="--poses")
    both = times is None or times > 1
    offered = candidates.again(2 if both else 1)
    would = planned(saved, header, offered)
    lack = unmodelled_scatter(saved, would)
    # The unmodelled scatter differs with each pose, as the repeatability does with each visit. The noise has one
    # value for all joints: that of a wrist, which may be off by ten times as much, would hide the others.
    noise, usual = header.noise, float(np.median(lack))
    rougher = replace(
        noise,
        repeatability=float(np.hypot(noise.repeatability, usual)),
        repeatability_mm=float(np.hypot(noise.repeatability_mm, usual / DEG)),
    )
    would = replace(would, header=replace(header, noise=rougher))
    seen = WhitenedReadings.of(saved, would, frame_known=frame_known, lack=np.zeros_like(lack))
    which = seen.visit % len(candidates)
    chosen = choose(seen, which, count)
    once = candidates.take(chosen)
    _, odds = odds_of(
        WhitenedReadings.of(saved, planned(saved, header, once), frame_known=frame_known, lack=lack)
    )
    ways = RepetitionOptions(saved, header, odds.limit(rate), frame_known, lack)
    goal = ways.goal(once)
    best = fewest(ways, once, goal, times=times, repeats=repeats)
    visits = best.rounds.of(once)
    found = judged(saved, header, visits, rate, frame_known=frame_known, lack=lack)

    def enough(goal: Mapping[str, float]) -> int | None:
        """Return the number of poses that reach a goal with the same rounds.

        None if the current poses reach it, or if no number that is tried does.
        """
        poses, tried, most = count, replace(best, goal=goal), min(len(candidates), _MOST)
        for _ in range(_TRIES):
            if not 1.0 < tried.short < np.inf:
                break
            poses = int(np.ceil(poses * tried.short**2))
            if poses > most:
                return None
            more = candidates.take(choose(seen, which, poses))
            tried = DetectionResult(best.rounds, ways.sizes(more, best.rounds), goal)
        return poses if poses > count and tried.short <= 1.0 else None

    strict = {label: wanted(label) for label in goal}
    lever = None
    if best.short > 1.0 and best.worst.endswith(f":j{saved.model.robot.joints}"):
        # possibly nothing shows it: a target on the axis, or too few readings
        now = next((c.lever_mm for c in found.causes if c.label == best.worst), None)
        long = None if now is None else lever_needed(ways, once, best.rounds, best.worst, now)
        lever = None if long is None else (best.worst, long)
    return WatchPlan(
        tuple(chosen),
        visits,
        found,
        best.rounds.times,
        best.rounds.repeats,
        enough(strict) or enough(goal),
        best.beyond,
        lever,
    )


def judged(
    saved: CalibratedModel,
    header: Header,
    visits: PlannedVisits,
    rate: float = RATE,
    *,
    frame_known: bool = True,
    lack: Array | None = None,
) -> DetectableSizes:
    """Compute the sizes of the causes that some visits detect.

    The unmodelled scatter `lack` is used as in `WhitenedReadings.of`.
    """
    seen = WhitenedReadings.of(saved, planned(saved, header, visits), frame_known=frame_known, lack=lack)
    return shown(seen, rate)


def lever_needed(
    ways: RepetitionOptions, visits: PlannedVisits, rounds: Repetitions, label: str, lever_mm: float
) -> float | None:
    """Find the distance from the last axis that a target needs for a cause to be detected.

    The noise of the arm grows with the lever, so the size falls more slowly than the lever rises.

    Parameters
    ----------
    label : str
        Label of a cause of the last joint.
    lever_mm : float
        Current distance of the only target from the axis, mm.

    Returns
    -------
    float or None
        Required distance, mm. None if there are several targets, if the last axis is not the axis of the flange, or if
        no practicable lever is long enough.
    """
    series, targets = next(iter(ways.saved.model.targets.items()))
    names = {target for each in visits.read for target, _ in each}
    (name, *others) = sorted(names)
    x, y, z = targets[name]
    if others or not np.isclose(np.hypot(x, y), lever_mm, rtol=0.01):
        return None
    factor, short = 1.0, np.inf
    for _ in range(_STEPS):
        if factor * lever_mm > _FARTHEST_MM:
            return None
        moved = {**targets, name: (factor * x, factor * y, z)}
        model = replace(ways.saved.model, targets={**ways.saved.model.targets, series: moved})
        there = replace(ways, saved=replace(ways.saved, model=model))
        short = there.sizes(visits, rounds)[label] / wanted(label)
        if 1.0 - _NEAR < short <= 1.0:
            break
        factor *= (1.0 + 0.5 * _NEAR) * short if short > 1.0 else np.sqrt(short)
    return factor * lever_mm if short <= 1.0 else None
