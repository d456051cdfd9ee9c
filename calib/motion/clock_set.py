"""A clock that was set forward while it ran leaves a gap in the times of its stream; no sample is missing there.

On either side of the longest gap of a stream the speeds are compared with the other stream by themselves. Where the two
offsets differ by no more than the gap is long, and to the side that it allows, the clock was set; where they agree,
samples were lost. A clock that was set back makes times that decrease: those streams are refused when they are read.
"""

from __future__ import annotations

import numpy as np

from calib.motion.likeness import SURE, Speeds, likeness, peak

LEAST_STEP_S = 0.05
"""A smaller step of a clock is not visible in speeds."""
_SHORTEST_GAP_S, _SHORTEST_PART_S = 0.2, 15.0


def set_at_gap(robot: Speeds, tracker: Speeds) -> tuple[float, float, float] | None:
    """The longest gap of a stream, where one clock was set forward in it: the offset of the robot's clock before, what
    is added from then on, and the tracker's instant of that, s. None where none was."""
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
    """The stream before and after its longest gap; None where it has none worth the name, or one beside its ends."""
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
    """The clock of a part less the other one, s; None where their speeds are not surely alike."""
    lags, alike, _ = likeness(part, other)
    best = int(np.argmax(alike))
    if alike[best] < SURE:
        return None
    return part.begin + peak(alike, best, lags) * part.step - other.begin
