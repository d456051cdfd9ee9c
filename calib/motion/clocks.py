"""Offset of two clocks from the speeds alone: the start of the alignment.

The speed of the tool does not depend on the positions of base and instrument. The correlation of the two
speeds gives the offset of the clocks to some hundredths of a second. That of windows gives their rate,
and shows whether one of them was set while both were running. `calib.motion.alignment` does the rest.

A clock that was set forward while it ran leaves a gap in the times of its stream, without a missing
sample. Before and after the longest gap of a stream, the speeds are compared with the other stream
separately. If the two offsets agree, samples were lost. If they differ by no more than the length of the
gap, and in the direction that it allows, the clock was set. A clock that was set back makes times that
decrease: those streams are refused when they are read.

A clock that was set while both were running makes a step in the offset along a recording (`step_in`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calib.array import Array
from calib.errors import DataError
from calib.motion.streams import JointStream, PointStream, covered
from calib.units import percent

_STEP_S = 0.02  # of the common time on which speeds are compared
_MOST_STEPS = 300_000
_OVER_S = 0.05  # to either side: a speed is the mean of a tenth of a second
_WINDOW_S, _MOST_WINDOWS = 40.0, 20

# Seconds by which the offset of a window may differ from that of the whole, as long as most windows agree
_REACH_S = 2.0
_LEAST_LIKENESS = 0.5
_SAME = 0.01  # likenesses no farther apart are equal: of those the longest overlap is taken
_LEAST_EXTENT_MM = 5.0
_FEWEST_WINDOWS = 4

# Rate at most: no clock, and hardly a count of samples, errs so much: windows that say so are of other moves
_FASTEST = 0.01
LEAST_STEP_S = 0.05
"""A smaller step of a clock is not visible in speeds."""

_SHORTEST_GAP_S, _SHORTEST_PART_S = 0.2, 15.0
SURE = 0.9
"""Correlation from which on two stretches show the same moves."""

_ROUNDING = 1e-9  # of the transform, as a share of the largest sum of squares
_SIGMA = 6.0
_BESIDE, _FEWEST = 6, 3  # offsets to either side of a step that are compared
_OF_MEDIAN = 1.2533  # standard error of a median over that of a mean
_LEAST_S = 1e-6


@dataclass(frozen=True)
class ClockRelation:
    """Relation of the two clocks: robot's time = t + offset + rate (t - middle).

    t is an instant of the instrument's clock; all are in s, the rate is a ratio. From the instant
    `step_at` on, `step` is added: one of the clocks was set while both were running.
    """

    offset: float
    rate: float
    middle: float
    step: float = 0.0
    step_at: float = math.inf

    def robot_time(self, time: Array) -> Array:
        """Convert instants of the instrument to the robot's clock, shape (k,)."""
        return time + self.offset + self.rate * (time - self.middle) + self.step * (time >= self.step_at)


@dataclass(frozen=True)
class CorrelationGrid:
    """Grid of instants at which two streams are compared.

    `step` is its step, s, and `over` the time to either side over which a speed is taken, s.
    """

    step: float
    over: float


def common_grain(*streams: JointStream | PointStream) -> CorrelationGrid:
    """Choose the grid of both streams, coarser for recordings of hours.

    It is common, because a speed over another time has another lag.
    """
    longest = max(float(stream.time[-1] - stream.time[0]) for stream in streams)
    return CorrelationGrid(
        max(_STEP_S, longest / _MOST_STEPS), max(_OVER_S, *(stream.period for stream in streams))
    )


def speeds_of(time: Array, places: Array, period: float, grain: CorrelationGrid, name: str) -> Speeds:
    """Compute speeds from places (n, 3), mm, at times (n,), s.

    Raises
    ------
    DataError
        Nothing moves; the error names the stream.
    """
    extent = float(np.linalg.norm(np.ptp(np.quantile(places, (0.01, 0.99), axis=0), axis=0)))
    if extent < _LEAST_EXTENT_MM:
        raise DataError(
            f"nothing moves in it: all of it lies within {extent:.2g} mm.",
            do="Record while the robot drives its path; streams of a robot at rest cannot be aligned. If it did "
            "move, the stated unit of the numbers is wrong.",
            file=name,
        )
    grid, over = np.arange(time[0], time[-1], grain.step), grain.over
    ends = [
        np.column_stack([np.interp(grid + side, time, axis) for axis in places.T]) for side in (-over, over)
    ]
    seen = covered(time, period, grid)
    return Speeds(
        float(time[0]), grain.step, np.linalg.norm(ends[1] - ends[0], axis=1) / (2.0 * over) * seen, seen
    )


def no_faster(speeds: Speeds, highest: float) -> Speeds:
    """Mark instants faster than `highest`, mm/s, as not seen.

    A few of them would outweigh all others.
    """
    seen = speeds.seen & (speeds.speed <= highest)
    return replace(speeds, speed=speeds.speed * seen, seen=seen)


def correlated(
    robot: Speeds, tracker: Speeds, robot_name: str, tracker_name: str
) -> tuple[ClockRelation, float | None]:
    """Compute offset, rate and any large step of the clocks from the speeds.

    Also returns another offset, s, at which the speeds are as similar, or None.

    Raises
    ------
    DataError
        At no offset are the speeds similar.
    """
    step, middle = robot.step, 0.5 * len(tracker.speed)
    if (cut := set_at_gap(robot, tracker)) is not None:
        before, added, at = cut
        return ClockRelation(before, 0.0, tracker.begin + middle * step, added, at), None
    lags, alike, both = correlation_by_lag(robot, tracker)
    highest = float(alike.max())
    good = np.flatnonzero(alike >= (highest - _SAME if highest > SURE else highest))
    best = int(good[np.argmax(both[good])])
    if alike[best] < _LEAST_LIKENESS:
        raise DataError(
            f"and the {robot_name} do not show one motion: at no offset of the clocks are their speeds alike (at best "
            f"{percent(max(float(alike[best]), 0.0))}).",
            do="Give two streams of one recording, which overlap in time, and the robot and tool that were measured.",
            file=tracker_name,
        )
    far = good[np.abs(lags[good] - lags[best]) * step > _REACH_S]
    begins = robot.begin - tracker.begin
    rival = float(lags[far[0]] * step + begins) if len(far) else None
    whole = int(lags[best])
    places, windows = _windows(robot, tracker, whole, round(_REACH_S / step))
    if len(windows) < 0.75 * _window_count(tracker):
        places, windows = _windows(robot, tracker, whole, len(robot.speed) + len(tracker.speed))
    clocks = ClockRelation(
        offset=peak(alike, best, lags) * step + begins, rate=0.0, middle=tracker.begin + middle * step
    )  # fmt: skip
    if len(windows) < _FEWEST_WINDOWS:
        return clocks, rival
    jump = step_in(windows * step, LEAST_STEP_S)
    first = None if jump is None else jump.cut
    parts = [np.arange(len(windows))] if first is None else [np.arange(first), np.arange(first, len(windows))]
    rate = float(np.median(np.concatenate([_slopes(places[part], windows[part]) for part in parts])))
    if abs(rate) > _FASTEST:
        return clocks, rival
    levels = [float(np.median(windows[part] - rate * (places[part] - middle))) * step for part in parts]
    if first is None:
        return ClockRelation(levels[0] + begins, rate, clocks.middle), rival
    at = tracker.begin + 0.5 * float(places[first - 1] + places[first]) * step
    return ClockRelation(levels[0] + begins, rate, clocks.middle, levels[1] - levels[0], at), rival


def _window_count(tracker: Speeds) -> int:
    length = len(tracker.speed) * tracker.step
    return int(np.clip(length / _WINDOW_S, _FEWEST_WINDOWS, _MOST_WINDOWS))


def _windows(robot: Speeds, tracker: Speeds, whole: int, reach: int) -> tuple[Array, Array]:
    """Find the lags of windows of the tracker's series, in steps.

    They lie within `reach` of the lag of the whole. Returns the middles (w,) and the lags (w,); windows
    that are similar to nothing there are left out.
    """
    places, lags = [], []
    for part in np.array_split(np.arange(len(tracker.speed)), _window_count(tracker)):
        first = max(int(part[0]) + whole - reach, 0)
        last = min(int(part[-1]) + whole + reach + 1, len(robot.speed))
        if last - first < len(part) // 2:
            continue
        window = Speeds(0.0, robot.step, tracker.speed[part], tracker.seen[part])
        stretch = Speeds(0.0, robot.step, robot.speed[first:last], robot.seen[first:last])
        lag, alike, _ = correlation_by_lag(stretch, window)
        best = int(np.argmax(alike))
        if alike[best] >= SURE:
            places.append(float(part.mean()))
            lags.append(peak(alike, best, lag) + first - int(part[0]))
    return np.array(places), np.array(lags)


def _slopes(places: Array, lags: Array) -> Array:
    """Compute the slopes of all pairs.

    Their median (Theil and Sen) is not affected by a single window without similarity.
    """
    first, second = np.triu_indices(len(lags), 1)
    return (lags[second] - lags[first]) / (places[second] - places[first])


def set_at_gap(robot: Speeds, tracker: Speeds) -> tuple[float, float, float] | None:
    """Find the step of a clock that was set forward in the longest gap of a stream.

    Returns the offset of the robot's clock before, the step that is added afterwards, and the tracker's
    instant of it, all s. The result is None if there is no such step.
    """
    for cut, other, sign in ((robot, tracker, 1.0), (tracker, robot, -1.0)):
        parts = _parted(cut)
        if parts is None:
            continue
        before, after = parts
        gap_s = after.begin - before.begin - len(before.speed) * cut.step
        offsets = [sign * offset for part in parts if (offset := _offset(part, other)) is not None]
        if len(offsets) < len(parts):
            continue
        step = offsets[1] - offsets[0]
        if LEAST_STEP_S < sign * step < gap_s + 2.0 * LEAST_STEP_S:
            at = after.begin if sign < 0.0 else before.begin + len(before.speed) * cut.step - offsets[0]
            return offsets[0], step, at
    return None


def _parted(stream: Speeds) -> tuple[Speeds, Speeds] | None:
    """Split a stream at its longest gap.

    Returns None if no gap is long enough, or if the gap is near its ends.
    """
    edges = np.flatnonzero(np.diff(np.concatenate([[True], stream.seen, [True]]).astype(int)))
    begins, ends = edges[::2], edges[1::2]
    if not len(begins):
        return None
    longest = int(np.argmax(ends - begins))
    begin, end = int(begins[longest]), int(ends[longest])
    if (end - begin) * stream.step < _SHORTEST_GAP_S:
        return None
    if min(begin, len(stream.speed) - end) * stream.step < _SHORTEST_PART_S:
        return None
    after = stream.begin + end * stream.step
    return (
        Speeds(stream.begin, stream.step, stream.speed[:begin], stream.seen[:begin]),
        Speeds(after, stream.step, stream.speed[end:], stream.seen[end:]),
    )


def _offset(part: Speeds, other: Speeds) -> float | None:
    """Compute the clock of a part minus the other one, s; None if the speeds may differ."""
    lags, alike, _ = correlation_by_lag(part, other)
    best = int(np.argmax(alike))
    if alike[best] < SURE:
        return None
    return part.begin + peak(alike, best, lags) * part.step - other.begin


@dataclass(frozen=True)
class Speeds:
    """Speeds of one stream at equal steps of its clock from `begin`, s.

    `speed` (m,) is in mm/s, 0 if it is not `seen` (m,).
    """

    begin: float
    step: float
    speed: Array
    seen: NDArray[np.bool_]


def correlation_by_lag(robot: Speeds, tracker: Speeds) -> tuple[NDArray[np.int64], Array, Array]:
    """Correlate two series by lag.

    Returns
    -------
    lags : array of int, shape (l,)
        Steps by which the tracker's series begins later in the robot's.
    alike : array of shape (l,)
        Correlation over the steps that both have seen. It is -1 if these are fewer than a third of those
        of the shorter series.
    both : array of shape (l,)
        Number of these steps.
    """
    count = len(robot.speed) + len(tracker.speed) - 1
    size = 1 << (count - 1).bit_length()
    one, two = (
        np.fft.rfft([s.seen * 1.0, s.speed * s.seen, s.speed**2 * s.seen], size) for s in (robot, tracker)
    )
    pairs = ((0, 0), (1, 0), (0, 1), (1, 1), (2, 0), (0, 2))  # powers of the two speeds in each sum
    sums = np.fft.irfft(np.stack([one[i] * np.conj(two[k]) for i, k in pairs]), size)
    both, a, b, ab, aa, bb = np.roll(sums, len(tracker.speed) - 1, axis=1)[:, :count]
    enough = both > min(robot.seen.sum(), tracker.seen.sum()) / 3.0
    n = np.maximum(both, 1.0)
    spread = np.maximum(aa - a * a / n, _ROUNDING * aa.max()) * np.maximum(
        bb - b * b / n, _ROUNDING * bb.max()
    )
    alike = np.where(enough & (spread > 0.0), (ab - a * b / n) / np.sqrt(np.maximum(spread, 1e-300)), -1.0)
    return np.arange(count) - (len(tracker.speed) - 1), alike, both


def peak(values: Array, best: int, lags: NDArray[np.int64]) -> float:
    """Place of the maximum between lags, by a parabola through three of them."""
    if not 0 < best < len(values) - 1:
        return float(lags[best])
    left, top, right = values[best - 1 : best + 2]
    curve = left - 2.0 * top + right
    return float(lags[best]) + (0.5 * (left - right) / curve if curve < 0.0 else 0.0)


@dataclass(frozen=True)
class ClockStep:
    """A step of `size` s among offsets, at index `cut`; `level` is the offset before it, s."""

    cut: int
    size: float
    level: float


def step_in(offsets: Array, least: float) -> ClockStep | None:
    """Find the clearest step among offsets (b,) of equal stretches of a recording, s.

    Medians of some offsets before and after are compared, after removing the slope of all between them.
    A step is more than `least` seconds and six standard errors. Scatter and slope are those from one
    offset to the next (their medians), so neither a few wild offsets nor a second step hide the first
    one. Returns None if there is no step.
    """
    if len(offsets) < 2 * _FEWEST:
        return None
    difference = np.diff(offsets)
    slope = float(np.median(difference))
    scatter = max(1.4826 * float(np.median(np.abs(difference - slope))) / np.sqrt(2.0), _LEAST_S)
    strongest, best = _SIGMA, None
    for cut in range(_FEWEST, len(offsets) - _FEWEST + 1):
        before, after = offsets[max(cut - _BESIDE, 0) : cut], offsets[cut : cut + _BESIDE]
        level = float(np.median(before))
        size = float(np.median(after)) - level - 0.5 * (len(before) + len(after)) * slope
        u = scatter * _OF_MEDIAN * float(np.sqrt(1.0 / len(before) + 1.0 / len(after)))
        if abs(size) > max(least, strongest * u):
            strongest, best = abs(size) / u, ClockStep(cut, size, level)
    return best
