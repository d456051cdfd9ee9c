"""Joint fit of two clocks, the frame of the instrument and the geometry of a moving arm.

A wrong offset of the clocks displaces every point along its velocity; a wrong frame or geometry
displaces it by the position of the arm. One least-squares problem holds both (`calib.motion.solve`).
Speeds alone err by 4 to 61 ms and are its start. Its residuals show whether a clock was set while both
were running.

If two streams do not fit together, their likelier meaning is reported: another sign, order or unit, a
mirrored frame, another robot. The hypotheses are those about data sets (`calib.data.hypotheses`).

**Errors of the path** are stated along and across it, by speed, static and dynamic. An error is measured minus
predicted, at the joints that the robot reported for that instant. One part of the nominal arm's error is static and
depends on the posture only: geometry, deflection and gears, as fitted. The rest is dynamic: bending under
acceleration, the instrument's own lag, joints reported late.

The clocks were set by this same error. A lag that is the same at all speeds (along = lag x speed) is
therefore part of their offset, and only its change with speed is seen here. ISO 9283, 8.2, judges a path
by its largest distances; this table by RMS and maximum.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from calib.arm.kinematics import forward
from calib.arm.robot import Robot
from calib.arm.start import base_and_tool
from calib.array import Array
from calib.data import (
    FEWEST_MEANT,
    Hypothesis,
    InterpretedReadings,
    explained,
    of_joints,
    of_points,
    of_robot,
)
from calib.errors import DataError
from calib.motion.arm import AlignedArm
from calib.motion.clocks import ClockRelation, common_grain, correlated, no_faster, speeds_of, step_in
from calib.motion.solve import Solve, weights
from calib.motion.streams import JointStream, PointStream

_FEWEST = 50

_MOST_FITTED = 6000  # samples that take part in the fit; all are judged by it

_LEAST_STEP_S, _SIGMA = 0.003, 6.0

_STEP_OF_ROUNDING = 1.5  # times the resolution of the times: a smaller step may be their rounding

# Miss of the nominal arm in its best place, as a share of the extent, that is hardly one of an arm, and that is none
_ODD, _FOREIGN = 0.01, 0.05

_ODD_TOOL_MM = 20.0

_FAST_CLOCK = 1e-3

_WILD = 3.0  # times the robot's highest speed: a beam that was broken and found again, no motion

_SAME_OFFSET_S = 2.0  # that of windows and that of the whole may differ so far

_ASTRAY_MM = 0.1  # a fit that misses by so much more than its start has not found its end

_LOOKED_AT = 300

_SLOWER = 0.5  # share of the samples that is used: the slow ones, which a wrong clock displaces least

_OF_AN_ARM = 0.02  # of the standard deviation of the points

_OPTIONS = {"robot": "--robot", "joint_coupling": "--coupling"}

_MOST_RIVALS = 2

_BINS = 5

_PATH_ERROR_FEWEST = 20


@dataclass(frozen=True)
class Aligned:
    """Two streams on one clock, with n samples of the instrument, k of them used.

    Attributes
    ----------
    clocks : ClockRelation
        Fitted relation of the clocks.
    u_offset, u_rate, u_step : float
        Standard uncertainties of the clocks, s, 1, s.
    start : ClockRelation
        Relation of the clocks from the speeds alone.
    used : array of bool, shape (n,)
        Samples of the instrument that lie within the robot's stream and not in a gap of it.
    time : array of shape (k,)
        Robot's clock, s.
    joints : array of shape (k, N)
        Joints, rad.
    point : array of shape (k, 3)
        Measured points, mm.
    velocity : array of shape (k, 3)
        Velocity of the tool point of the fitted arm, mm/s.
    error : array of shape (k, 3)
        Measured minus fitted points, mm.
    moving : array of shape (k, 3)
        Measured points minus those of the fitted arm without its backlash, mm: errors that do not depend
        on the position of the arm.
    nominal : array of shape (k, 3)
        Error of the nominal arm in its best place, mm.
    weight : array of shape (k,)
        From 0, a gross error, to 1.
    tool : array of shape (3,)
        Tool point in the flange frame, mm.
    """

    clocks: ClockRelation
    u_offset: float
    u_rate: float
    u_step: float
    start: ClockRelation
    used: NDArray[np.bool_]
    time: Array
    joints: Array
    point: Array
    velocity: Array
    error: Array
    moving: Array
    nominal: Array
    weight: Array
    tool: Array
    warnings: tuple[str, ...]

    @property
    def speed(self) -> Array:
        """Speed of the tool point, shape (k,), mm/s."""
        return np.linalg.norm(self.velocity, axis=1)


def align(
    robot: Robot,
    moved: JointStream,
    tracked: PointStream,
    tool: tuple[float, float, float],
    *,
    tool_known: bool = False,
    progress: Callable[[str], None] = lambda _: None,
) -> Aligned:
    """Fit clock offset and rate together with the frame and the geometry of the arm.

    Parameters
    ----------
    robot : Robot
        Nominal robot.
    moved : JointStream
        Stream of the robot.
    tracked : PointStream
        Stream of the instrument.
    tool : tuple of float
        Nominal measured point in the flange frame, mm.
    tool_known : bool, optional
        Whether the tool is known.
    progress : callable, optional
        Called with the name of each step.

    Raises
    ------
    DataError
        The streams do not overlap, show different motions, or nothing moves.
    """
    progress("comparing speeds")
    start, rival = _start(robot, moved, tracked, np.array(tool))
    start, rival = _by_place(robot, moved, tracked, np.array([tool]), start, rival)
    joints, _, used = moved.at(start.robot_time(tracked.time))
    if used.sum() < _FEWEST:
        raise DataError(
            f"overlaps with the {moved.name} in {int(used.sum())} samples only.",
            do=f"Record both at the same time; {_FEWEST} samples or more are needed.",
            file=tracked.name,
        )
    progress("fitting clocks, frame and geometry together")
    fitted = np.flatnonzero(used)
    fitted = fitted[:: -(-len(fitted) // _MOST_FITTED)]
    pose, _ = _placed(robot, joints[fitted], np.array([tool]), tracked.points[fitted])
    arm = AlignedArm(robot, pose, np.array(tool), tool_known=tool_known)
    solve = Solve(arm, moved, tracked.points[fitted], tracked.time[fitted])
    coarse = max(moved.resolution, tracked.resolution)
    least_step = max(_LEAST_STEP_S, _STEP_OF_ROUNDING * coarse)
    clocks, estimate, other_jump = _solved(solve, start, least_step, progress)
    placed = solve.placed_only(clocks)
    everything = Solve(arm, moved, tracked.points, tracked.time)
    samples, nominal = everything.at(clocks, estimate), everything.at(clocks, placed)
    moving = everything.at(clocks, arm.without_play(estimate))
    known = samples.known
    miss = float(np.median(np.linalg.norm(nominal.error[known], axis=1)))
    if miss > _ODD * _extent(tracked):
        refuse_misread(robot, moved, tracked, np.array(tool), start)
    _refuse_foreign(miss, tracked, moved)
    _refuse_lost(samples.error[known], nominal.error[known], tracked, moved)
    u_offset, u_rate, u_step = solve.uncertainty(clocks, estimate)
    u_offset, u_rate = (
        math.hypot(u, *(stream.rounding[k] for stream in (moved, tracked)))
        for k, u in enumerate((u_offset, u_rate))
    )
    return Aligned(
        clocks=clocks,
        u_offset=u_offset,
        u_rate=u_rate,
        u_step=u_step,
        start=start,
        used=known,
        time=clocks.robot_time(tracked.time)[known],
        joints=samples.joints[known],
        point=tracked.points[known],
        velocity=samples.velocity[known],
        error=samples.error[known],
        moving=moving.error[known],
        nominal=nominal.error[known],
        weight=weights(samples.error[known]),
        tool=arm.tool(estimate),
        warnings=(
            *_warnings(clocks, other_jump, rival),
            *_rounded(moved, tracked),
            *_odd_arm(miss, _extent(tracked), arm.tool(estimate), np.array(tool)),
        ),
    )


def _start(
    robot: Robot, moved: JointStream, tracked: PointStream, tool: Array
) -> tuple[ClockRelation, float | None]:
    """Estimate the clocks from the speeds of the nominal and of the measured tool point."""
    grain = common_grain(moved, tracked)
    every = max(1, int(0.5 * grain.step / moved.period))
    flange = forward(robot, moved.joints[::every])
    places = flange[:, :3, :3] @ tool + flange[:, :3, 3]
    one = speeds_of(moved.time[::every], places, every * moved.period, grain, moved.name)
    other = speeds_of(tracked.time, tracked.points, tracked.period, grain, tracked.name)
    return correlated(one, no_faster(other, _WILD * float(one.speed.max())), moved.name, tracked.name)


def _placed(robot: Robot, joints: Array, tool: Array, points: Array) -> tuple[Array, float]:
    """Place the nominal arm, and compute its median distance from the points, mm.

    The place is a pose (4, 4).
    """
    flange, one = forward(robot, joints), np.zeros(len(joints), dtype=np.int64)
    pose, _ = base_and_tool(flange, tool, one, points, tool_unknown=False)
    there = (flange[:, :3, :3] @ tool[0] + flange[:, :3, 3]) @ pose[:3, :3].T + pose[:3, 3]
    return pose, float(np.median(np.linalg.norm(points - there, axis=1)))


def _by_place(
    robot: Robot,
    moved: JointStream,
    tracked: PointStream,
    tool: Array,
    start: ClockRelation,
    rival: float | None,
) -> tuple[ClockRelation, float | None]:
    """Choose, of two offsets with similar speeds, the one with similar points.

    Both are returned if the points do not distinguish them.
    """
    if rival is None or abs(rival - start.offset) < _SAME_OFFSET_S:
        return start, None
    other = replace(start, offset=rival, rate=0.0)
    foreign = []
    for clocks in (start, other):
        joints, _, used = moved.at(clocks.robot_time(tracked.time))
        miss = np.inf
        if used.sum() >= _FEWEST:
            miss = _placed(robot, joints[used], tool, tracked.points[used])[1]
        foreign.append(miss > _FOREIGN * _extent(tracked))
    if foreign[0] == foreign[1]:
        return start, rival
    return (other if foreign[0] else start), None


def _solved(
    solve: Solve, start: ClockRelation, least_step: float, progress: Callable[[str], None]
) -> tuple[ClockRelation, Array, ClockRelation | None]:
    """Fit the clocks; if one was set meanwhile, fit its step too.

    The third value is the relation with the step that is left, if any. A step that comes out too small
    is none.
    """
    if np.isfinite(start.step_at) and (found := _with_step(solve, start, least_step)) is not None:
        return *found, _jump(solve, *found, least_step)
    clocks, estimate = solve.run(replace(start, step=0.0, step_at=np.inf))
    if (jump := _jump(solve, clocks, estimate, least_step)) is None:
        return clocks, estimate, None
    progress(f"one clock seems to jump near {jump.step_at:.0f} s; fitting once more with the jump")
    if (found := _with_step(solve, jump, least_step)) is None:
        return clocks, estimate, None
    return *found, _jump(solve, *found, least_step)


def _with_step(solve: Solve, start: ClockRelation, least: float) -> tuple[ClockRelation, Array] | None:
    """Fit the clocks with a step; return None if it comes out too small."""
    clocks, estimate = solve.run(solve.step_placed(*solve.run(start)))
    sure = max(least, _SIGMA * solve.uncertainty(clocks, estimate)[2])
    return (clocks, estimate) if abs(clocks.step) > sure else None


def _jump(solve: Solve, clocks: ClockRelation, estimate: Array, least: float) -> ClockRelation | None:
    """Find a step that the clocks do not have yet, or a different one; None if none is detected."""
    begins, offsets = solve.offsets(clocks, estimate)
    if (step := step_in(offsets, least)) is None:
        return None
    at = float(begins[step.cut])
    return replace(clocks, offset=clocks.offset + step.level, step=step.size, step_at=at)


def _extent(tracked: PointStream) -> float:
    """Extent of the points, wild ones apart, mm."""
    low, high = np.quantile(tracked.points, (0.01, 0.99), axis=0)
    return float(np.linalg.norm(high - low))


def _refuse_foreign(miss: float, tracked: PointStream, moved: JointStream) -> None:
    if miss > _FOREIGN * _extent(tracked):
        raise DataError(
            f"is not the motion of the {moved.name}: at its best place the nominal robot misses half of the points by "
            f"more than {miss:.0f} mm, and all of them lie within {_extent(tracked):.0f} mm.",
            do="Check robot, tool, order, signs and unit of the joints, unit and axes of the points, and that both "
            "streams are of one recording and overlap in time.",
            file=tracked.name,
        )


def _refuse_lost(error: Array, nominal: Array, tracked: PointStream, moved: JointStream) -> None:
    fitted, placed = (float(np.median(np.linalg.norm(each, axis=1))) for each in (error, nominal))
    if fitted > placed + _ASTRAY_MM:
        raise DataError(
            f"and the {moved.name} do not fit together: where their speeds are most alike, the fit misses half of the "
            f"points by more than {fitted:.2g} mm, the nominal arm in its place by {placed:.2g} mm.",
            do="Check that the two overlap in time and are of one recording; if they are, record more waypoints with "
            "faster moves between them.",
            file=tracked.name,
        )


def _odd_arm(miss: float, extent: float, found: Array, tool: Array) -> list[str]:
    out = []
    if miss > _ODD * extent:
        out.append(
            f"At its best place the nominal robot misses half of the points by more than {miss:.0f} mm: more than an "
            "arm errs. Check robot, signs and order of the joints."
        )
    if (off := float(np.linalg.norm(found - tool))) > _ODD_TOOL_MM:
        x, y, z = found
        out.append(
            f"The measured point is {off:.0f} mm from where --tool has it, near {x:.0f}, {y:.0f}, {z:.0f} mm in the "
            "flange frame, as far as these moves show it."
        )
    return out


def _rounded(*streams: JointStream | PointStream) -> list[str]:
    return [
        f"The times of the {stream.name} are rounded to {1e3 * stream.resolution:g} ms: a jump of a clock below "
        f"{1e3 * _STEP_OF_ROUNDING * stream.resolution:g} ms is not looked for."
        for stream in streams
        if _STEP_OF_ROUNDING * stream.resolution > _LEAST_STEP_S
    ]


def _warnings(clocks: ClockRelation, jump: ClockRelation | None, rival: float | None) -> list[str]:
    out = []
    if jump is not None:
        out.append(
            f"At {jump.step_at:.1f} s of the tracker's clock the clocks step by another amount that is not in the fit. "
            "Cut the recording there and align the parts."
        )
    if abs(clocks.rate) > _FAST_CLOCK:
        out.append(
            f"The clocks differ by {100.0 * clocks.rate:.2g} % in rate, more than any quartz: one stream's times may "
            "be counted, not measured."
        )
    if rival is not None:
        out.append(
            f"The path repeats itself: an offset of {rival:.1f} s makes the speeds as alike as the one that was taken. "
            "Say which by cutting one stream, or begin with a move that comes once."
        )
    return out


def _near(meaning: InterpretedReadings, tool: Array) -> bool:
    """Test whether the nominal arm with its nominal tool is as near as an arm should be.

    A free tool and another unit can bring the points of another motion near too.
    """
    miss, extent = meaning.miss(tool[None], tool_unknown=False, zero_unknown=False)
    return miss < _OF_AN_ARM * extent


def refuse_misread(
    robot: Robot, moved: JointStream, tracked: PointStream, tool: Array, clocks: ClockRelation
) -> None:
    """Raise DataError if the arm fits clearly better with another meaning of a stream.

    Parameters
    ----------
    tool : array of shape (3,)
        Nominal tool point, mm.
    clocks : ClockRelation
        Relation of the clocks from the speeds alone.
    """
    joints, rates, used = moved.at(clocks.robot_time(tracked.time))
    rows = np.flatnonzero(used)
    turning = np.abs(rates[rows]).max(axis=1)
    rows = rows[turning <= np.quantile(turning, _SLOWER)]
    rows = rows[:: max(1, -(-len(rows) // _LOOKED_AT))]
    if len(rows) < FEWEST_MEANT:
        return
    meaning = InterpretedReadings(
        robot,
        moved.coupling,
        robot.controller_angles(joints[rows], moved.coupling),
        np.zeros(len(rows), dtype=np.int64),
        tracked.points[rows],
    )

    def others() -> Iterator[Hypothesis]:
        return chain(of_points(meaning), of_joints(meaning), of_robot(meaning))

    why = explained(meaning, others, tool[None], tool_unknown=False, zero_unknown=False)
    if why is None or not _near(why.cause.meaning, tool):
        return
    said = dict.fromkeys(f" As likely: {rival.what}. {rival.do}" for rival in why.rivals)
    said.pop(f" As likely: {why.cause.what}. {why.cause.do}", None)
    rivals = "".join(list(said)[:_MOST_RIVALS])
    key = _OPTIONS.get(why.cause.key, why.cause.key)
    raise DataError(
        f"{why.cause.what}. The nominal robot misses half of the points by {why.miss:.3g} mm and more, read in that "
        f"way by {why.left:.3g} mm.",
        do=why.cause.do + rivals,
        file=tracked.name if key.startswith("x_mm") else moved.name,
        key=key,
    )


@dataclass(frozen=True)
class SpeedBandErrors:
    """Errors of `count` samples between two speeds, mm/s, in mm.

    `nominal_` are errors of the nominal arm in its place, `static_` its static part, and the others the
    dynamic rest. `along_mean` is below zero if points come late; `lag_ms` is the time by which they do,
    ms, beyond the offset of the clocks.
    """

    slowest: float
    fastest: float
    count: int
    nominal_along_rms: float
    nominal_across_rms: float
    static_along_rms: float
    static_across_rms: float
    along_mean: float
    along_rms: float
    across_rms: float
    across_max: float
    lag_ms: float


def by_speed(aligned: Aligned, slow_mm_s: float) -> list[SpeedBandErrors]:
    """Compute errors in bands of equal numbers of samples above `slow_mm_s`.

    Samples with a weight of zero (gross errors) are excluded.
    """
    moving = (aligned.speed >= slow_mm_s) & (aligned.weight > 0.0)
    speed = aligned.speed[moving]
    if len(speed) < _PATH_ERROR_FEWEST:
        return []
    direction = aligned.velocity[moving] / speed[:, None]
    along, across = split(aligned.moving[moving], direction)
    nominal_along, nominal_across = split(aligned.nominal[moving], direction)
    static_along, static_across = split((aligned.nominal - aligned.moving)[moving], direction)
    edges = np.quantile(speed, np.linspace(0.0, 1.0, min(_BINS, len(speed) // _PATH_ERROR_FEWEST) + 1))
    which = np.clip(np.searchsorted(edges, speed, side="right") - 1, 0, len(edges) - 2)
    return [
        SpeedBandErrors(
            slowest=float(edges[k]),
            fastest=float(edges[k + 1]),
            count=int(here.sum()),
            nominal_along_rms=_rms(nominal_along[here]),
            nominal_across_rms=_rms(nominal_across[here]),
            static_along_rms=_rms(static_along[here]),
            static_across_rms=_rms(static_across[here]),
            along_mean=float(along[here].mean()),
            along_rms=_rms(along[here]),
            across_rms=_rms(across[here]),
            across_max=float(across[here].max()),
            lag_ms=-1e3 * float(np.sum(along[here] * speed[here]) / np.sum(speed[here] ** 2)),
        )
        for k in range(len(edges) - 1)
        if (here := which == k).any()
    ]


def split(error: Array, direction: Array) -> tuple[Array, Array]:
    """Split errors (k, 3) by unit vectors (k, 3).

    Returns the signed component along each, and the length of the rest, both (k,).
    """
    along = np.sum(error * direction, axis=1)
    return along, np.linalg.norm(error - along[:, None] * direction, axis=1)


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))
