"""Two streams of one motion: joints by the robot's clock, points by the instrument's.

Impossible streams are refused by name: times that repeat or go back, or that are not in seconds.
Samples that were lost leave a gap; nothing is interpolated across one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from calib.array import Array
from calib.errors import DataError
from calib.units import DEG

if TYPE_CHECKING:
    from scipy.interpolate import CubicHermiteSpline

GAP_PERIODS = 3.5
"""Samples farther apart than so many periods of their stream have a gap between them."""
FEWEST = 20
MEND_TIMES = (
    "Write the times with all their digits and in order; where the clock was set back, cut the recording and align the "
    "parts."
)
_LATE = 0.5  # periods by which a sample may be late
_MOST_DECIMALS = 3  # finer times are as good as exact
_ROUNDING_S = 2e-6  # of seconds since 1970
_LONGEST_S = 48.0 * 3600.0
_SHORTEST_PERIOD_S = 1e-4
_STEP = 0.005 * DEG  # of a joint that has turned to one side; less may be noise
_RATE_OVER_S = 0.02  # to either side: encoders count in steps, and a slope of two samples would show them


@dataclass(frozen=True)
class StreamGap:
    """A stretch between two samples in which about `lost` samples are missing.

    `begin` and `end` are in s of the stream's own clock.
    """

    begin: float
    end: float
    lost: int


class _Clocked:
    """Common part of both streams: their times (n,), s, increasing.

    Raises
    ------
    DataError
        The times are impossible.
    """

    time: Array
    name: str

    def __post_init__(self) -> None:
        _refuse_times(self.time, self.name)

    @cached_property
    def lost(self) -> int:
        """Number of samples that are missing between those that came, in gaps or one by one. A late one is not."""
        excess = np.diff(self.time) / self.period - 1.0
        beside = np.minimum(np.pad(excess, 1), 0.0)
        excess = np.where(excess > _LATE, excess + beside[:-2] + beside[2:], 0.0)
        return int(np.round(np.maximum(excess, 0.0)).sum())

    @cached_property
    def resolution(self) -> float:
        """Unit to which the times are rounded, s, or 0 if it does not show.

        It shows if the times are multiples of 1 s to 1 ms and unevenly spaced.
        """
        for decimals in range(_MOST_DECIMALS + 1):
            if np.abs(self.time - np.round(self.time, decimals)).max() < _ROUNDING_S:
                unit = 10.0**-decimals
                return unit if (self._uneven > 0.5 * unit).any() else 0.0
        return 0.0

    @cached_property
    def _uneven(self) -> Array:
        """Differences of every step from whole periods, shape (n - 1,), s."""
        step = np.diff(self.time)
        return np.abs(step - self.period * np.maximum(np.round(step / self.period), 1.0))

    @cached_property
    def rounding(self) -> tuple[float, float]:
        """Standard uncertainties of the clock and of its rate from rounded times, s and 1.

        They are smaller if the roundings change more often.
        """
        changes = int((self._uneven > 0.5 * self.resolution).sum())
        one = self.resolution / math.sqrt(1.0 + changes)
        return one / math.sqrt(12.0), one / float(self.time[-1] - self.time[0])

    @cached_property
    def period(self) -> float:
        """Median time between two samples, s."""
        return float(np.median(np.diff(self.time)))

    @cached_property
    def gaps(self) -> list[StreamGap]:
        """The places where samples are missing."""
        step = np.diff(self.time)
        return [
            StreamGap(float(self.time[i]), float(self.time[i + 1]), round(float(step[i]) / self.period) - 1)
            for i in np.flatnonzero(step >= GAP_PERIODS * self.period)
        ]


@dataclass(frozen=True)
class JointStream(_Clocked):
    """n samples of the robot.

    Attributes
    ----------
    time : array of shape (n,)
        Times of the robot's clock, s, increasing.
    joints : array of shape (n, N)
        Model angles, rad.
    zero : float
        Time of the file's clock at time 0, s.
    coupling : str
        Joint matrix by which the controller counts its joints.
    remarks : tuple of str
        Changes made to the recorded data.
    simulated : bool
        Whether no real robot sent the stream.
    """

    time: Array
    joints: Array
    name: str = "robot stream"
    zero: float = 0.0
    coupling: str = "none"
    remarks: tuple[str, ...] = ()
    simulated: bool = False

    @cached_property
    def _curve(self) -> CubicHermiteSpline:
        # With what it brings it is a tenth of the start of a service, which aligns in workers.
        from scipy.interpolate import CubicHermiteSpline

        # Slopes of neighbours alone, so that a gap bends the curve at its edges and nowhere else.
        return CubicHermiteSpline(self.time, self.joints, np.gradient(self.joints, self.time, axis=0), axis=0)

    def at(self, time: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
        """Interpolate joints (k, N), rad, and rates (k, N), rad/s, at instants (k,).

        The instants are of the robot's clock. The third array (k,) marks the known ones. An instant
        outside the stream or in a gap is not known; the joints there are those of the edge.
        """
        clipped = np.clip(time, self.time[0], self.time[-1])
        reach = max(_RATE_OVER_S, self.period)
        before = np.maximum(clipped - reach, self.time[0])
        after = np.minimum(clipped + reach, self.time[-1])
        rates = (self._curve(after) - self._curve(before)) / (after - before)[:, None]
        return self._curve(clipped), rates, covered(self.time, self.period, time)

    def side_at(self, time: Array) -> Array:
        """Return the side to which every joint turns or last turned at instants (k,), shape (k, N).

        The side is +1, -1, or 0 before the joint first turned.
        """
        return self._sides[np.clip(np.searchsorted(self.time, time, side="right") - 1, 0, None)]

    @cached_property
    def _sides(self) -> Array:
        """Sides of all samples, shape (n, N).

        A joint that trembles at the border of a step crosses it in one of two rows of steps only, and
        turns back in neither.
        """
        crossed = [np.diff(np.floor(self.joints / _STEP + shift), axis=0) for shift in (0.0, 0.5)]
        one, other = (_last(np.vstack([np.zeros((1, steps.shape[1])), np.sign(steps)])) for steps in crossed)
        return _last(np.where(one == other, one, 0.0))


@dataclass(frozen=True)
class PointStream(_Clocked):
    """n samples of the instrument.

    Attributes
    ----------
    time : array of shape (n,)
        Times of the instrument's clock, s, increasing.
    points : array of shape (n, 3)
        Points in its frame, mm.
    zero : float
        Time of the file's clock at time 0, s.
    remarks : tuple of str
        Changes made to the recorded data.
    simulated : bool
        Whether no real instrument sent the stream.
    """

    time: Array
    points: Array
    name: str = "tracker stream"
    zero: float = 0.0
    remarks: tuple[str, ...] = ()
    simulated: bool = False


def _last(values: Array) -> Array:
    """Return the last value of each column that is not zero, up to each row, shape (n, c).

    It is 0 before the first.
    """
    rows = np.where(values != 0.0, np.arange(len(values))[:, None], 0)
    return np.take_along_axis(values, np.maximum.accumulate(rows, axis=0), axis=0)


def covered(time: Array, period: float, at: Array) -> NDArray[np.bool_]:
    """Test whether instants (k,) lie between successive samples without a gap, shape (k,).

    `time` (n,) are the times of the samples.
    """
    after = np.clip(np.searchsorted(time, at), 1, len(time) - 1)
    near = time[after] - time[after - 1] < GAP_PERIODS * period
    return (at >= time[0]) & (at <= time[-1]) & near


def _refuse_times(time: Array, name: str) -> None:
    if len(time) < FEWEST:
        raise DataError(f"has {len(time)} samples.", do=f"Record {FEWEST} or more.", file=name)
    step = np.diff(time)
    if (step <= 0.0).any():
        at = int(np.argmax(step <= 0.0))
        same = "is given twice" if step[at] == 0.0 else f"is followed by {time[at + 1]:.6g} s"
        raise DataError(
            f"sample {at + 2}: the time {time[at]:.6g} s {same}, but times must increase.",
            do=MEND_TIMES,
            file=name,
        )
    span, period = float(time[-1] - time[0]), float(np.median(step))
    if span > _LONGEST_S or period < _SHORTEST_PERIOD_S:
        raise DataError(
            f"lasts {span:.3g} s with a sample every {period:.3g} s: the stated unit of its times is wrong, "
            "or its clock was set during the recording.",
            do="Give the unit of the times in the map of the columns; cut the recording where the clock was set.",
            file=name,
        )
