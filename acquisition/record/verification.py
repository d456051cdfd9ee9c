"""The landings of the robot: readings of a second campaign in the world frame of the first.

The instrument has not been moved between the two, so its readings stay in the world frame of campaign 1. The identified
base already contains the noise of that frame; a frame from the nests measured again would add its own, about 0.05 mm
at the tool. Effects of the instrument (drift, scale) are removed with the model, on the clock of campaign 1. Only if
the nests show that the instrument did move, its readings are tied to the nests measured again.

The floor is the RMS distance that a perfect correction would show, from the declared noise of the instrument and the
robot's repeatability, sqrt(mean trace(C_tracker + J C_joints J')).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from acquisition.campaign.observability import setup_of
from acquisition.campaign.plan import DECIMALS
from acquisition.cell.cell import Cell, cell_of_record
from acquisition.cell.workspace import targets_at
from acquisition.cell.world_frame import WorldFrame
from acquisition.errors import RecordError
from acquisition.record.device_serials import Individual, Individuals, series_among
from acquisition.record.readings import readings_of
from acquisition.record.store import RecordStore
from calib.array import Array
from calib.data import Conditions
from calib.fit import ErrorStatistics, expanded, statistics_of
from calib.model import BoundModel, ModelStructure, StatedConditions, conditions_at
from calib.saved import CalibratedModel

FRAME_HOLDS_MM = 1.0  # nests displaced by more than any drift: the instrument was moved

_FEWEST_FOR_A_LINE = 3
_MOST_CHANGE_K = 1.0  # the air of a hall does not change faster; a line through a noisy sensor may


@dataclass(frozen=True)
class Landings:
    """Readings of driven targets.

    Attributes
    ----------
    driven_deg
        Joints as commanded, shape (n, N).
    joints, previous
        Model angles of these and of their approach points, shape (n, N), rad.
    points
        Points in the instrument's frame, shape (n, 3), mm.
    time
        Times on the record's own clock, shape (n,), s.
    own, nests
        World frame of the record and its nests in the instrument's frame.
    devices
        Robot and instrument by role.
    """

    driven_deg: Array
    joints: Array
    previous: Array
    target: tuple[str, ...]
    points: Array
    time: Array
    temperature: Array
    own: WorldFrame
    nests: Mapping[str, Array]
    devices: Mapping[str, Individual] = field(default_factory=dict)  # robot and instrument, by role


@dataclass(frozen=True)
class Landing:
    """One reading of a verification.

    Attributes
    ----------
    pose
        Number of the new pose, from 1.
    joints_deg
        Joints of the pose, not corrected, deg or mm as the controller counts.
    wanted_mm
        Where the target must be in the world, mm.
    error_mm
        Measured minus wanted, mm.
    off_mm
        Its length, mm.
    u_mm
        Expanded uncertainty (k = 2) of the error in its most uncertain direction, mm: noise of the instrument and
        repeatability of the robot, without that of the world frame.
    """

    pose: int
    target: str
    corrected: bool
    joints_deg: tuple[float, ...]
    wanted_mm: tuple[float, ...]
    error_mm: tuple[float, ...]
    off_mm: float
    u_mm: float


@dataclass(frozen=True)
class Verification:
    """The verification of corrected targets.

    The statistics are those of the distances to the required points, mm, over all targets of all poses, or with
    `of_lengths` those of the errors of lengths along the bar of a ballbar.
    """

    uncorrected: ErrorStatistics | None  # the same poses, driven as the nominal robot would
    verified: ErrorStatistics
    floor_mm: float
    poses: int
    refused: tuple[str, ...]  # why targets were left out
    nests_off_mm: float | None  # between the nests measured again and the frame of campaign 1
    approach: str
    accepted: tuple[str, ...] = ()  # other devices than in campaign 1, who accepted them and why
    of_lengths: bool = False
    landings: tuple[Landing, ...] = ()  # in the order of measurement

    @property
    def ratio(self) -> float:
        """Verified RMS divided by the floor from noise and repeatability."""
        return self.verified.rms / self.floor_mm


def read_landings(record: Path) -> Landings:
    """Return the readings of poses of a record.

    Raises
    ------
    RecordError
        The record has no reading of a pose yet.
    """
    with RecordStore.reading(record) as store:
        rows = [row for row in readings_of(store) if row.counts]
        world, nests = store.world, store.nests_mm()
        robot = cell_of_record(store.campaign["cell"], str(store.database.path)).robot
        devices = Individuals(store).now()
    if world is None or not rows:
        raise RecordError(f"{record}: holds no reading of a pose yet")
    driven = np.array([row.joints for row in rows], dtype=np.float64)
    return Landings(
        driven_deg=driven,
        joints=robot.model_angles(driven),
        previous=robot.model_angles([row.approach for row in rows]),
        target=tuple(row.target for row in rows),
        points=np.array([row.point for row in rows]),
        time=np.array([row.t_s for row in rows]),
        temperature=np.array([np.nan if row.t_air_c is None else row.t_air_c for row in rows], dtype=float),
        own=world,
        nests={name: np.array(point) for name, point in nests.items()},
        devices=devices,
    )


def first_reading_s(record: Path) -> float:
    """Return the time from the first nest to the middle of the first pose's readings, s.

    Raises
    ------
    RecordError
        There is no record.
    """
    with RecordStore.reading(record) as store:
        begin = store.database.query("SELECT min(began_t_s) FROM attempt")[0][0]
        first = store.database.query(
            "SELECT avg(ended_t_s) FROM attempt WHERE kind = 'measure' AND status = 'good' AND visit = "
            "(SELECT min(visit) FROM attempt WHERE status = 'good' AND arrival IS NOT NULL)"
        )[0][0]
    return 0.0 if first is None else max(0.0, first - begin)


def expected_temperature(record: Path, at_s: float, window_s: float) -> float:
    """Predict the air temperature, degC, at `at_s` on the record's clock.

    It is NaN if none was recorded. The prediction is a line through the readings of the last `window_s`, or the last
    reading if there are too few.

    Raises
    ------
    RecordError
        There is no record.
    """
    with RecordStore.reading(record) as store:
        rows = store.database.query(
            "SELECT ended_t_s, t_air_c FROM attempt WHERE t_air_c IS NOT NULL AND ended_t_s IS NOT NULL AND "
            "ended_t_s >= (SELECT max(ended_t_s) FROM attempt WHERE t_air_c IS NOT NULL) - ? ORDER BY id",
            (window_s,),
        )
    if not rows:
        return float("nan")
    time, air = np.array([tuple(row) for row in rows], dtype=np.float64).T
    if len(time) < _FEWEST_FOR_A_LINE or np.ptp(time) <= 0.0:
        return float(air[-1])
    slope = float(np.polyfit(time - time[-1], air, 1)[0])
    change = float(np.clip(slope * (at_s - float(np.mean(time))), -_MOST_CHANGE_K, _MOST_CHANGE_K))
    return float(np.mean(air)) + change


def world_of(record: Path) -> WorldFrame:
    """Return the world frame of a record.

    Raises
    ------
    RecordError
        There is no record, or it has no world frame yet.
    """
    store = RecordStore.open(record, writer=False)
    try:
        world = store.world
    finally:
        store.close()
    if world is None:
        raise RecordError(f"{record}: its nests have not been measured")
    return world


def nests_off(landings: Landings, world: WorldFrame, nests_mm: Mapping[str, Sequence[float]]) -> float:
    """Return the largest distance, mm, of a nest measured again from its place.

    The nests are compared in the frame `world`.
    """
    return max(
        float(np.linalg.norm(world.to_world(point) - np.asarray(nests_mm[name], dtype=np.float64)))
        for name, point in landings.nests.items()
    )


def frame_holds(
    landings: Landings,
    world: WorldFrame,
    nests_mm: Mapping[str, Sequence[float]],
    devices: Mapping[str, Individual],
) -> bool:
    """Check whether the frame `world`, found with `devices`, is valid for later landings.

    It is not if the nests show that a person moved the instrument, or if it is another one; then the later frame must
    be used. A drift is allowed, because the model removes it; within one record it is not (`cell.station`).
    """
    mine, other = landings.devices.get("instrument"), devices.get("instrument")
    another = mine is not None and other is not None and mine.is_other_than(other)
    return not another and nests_off(landings, world, nests_mm) <= FRAME_HOLDS_MM


def landed_points(
    landings: Landings,
    world: WorldFrame,
    model: ModelStructure,
    estimate: Array,
    later_s: float,
    *,
    holds: bool,
) -> Array:
    """Compute the positions (n, 3), mm, of the targets in the world.

    Effects of the instrument are removed. `world` is the frame of campaign 1, the record's clock began `later_s`
    seconds after the first, and `holds` is the result of `frame_holds`.
    """
    if not holds:
        return landings.own.to_world(landings.points)
    points = world.to_world(landings.points)
    design = BoundModel(model, conditions_of(landings, model, later_s))
    return points - (design.predict(estimate) - design.predict(estimate, owners=("robot", "mounting")))


def conditions_of(landings: Landings, model: ModelStructure, later_s: float) -> Conditions:
    """Return the conditions of the readings, on the clock of campaign 1, after all its steps."""
    series = series_among(model.targets, landings.devices)
    at = conditions_at(model, landings.joints, StatedConditions(series=series))
    moved = np.sign(landings.joints - landings.previous)
    return replace(
        at,
        previous=landings.previous,
        side=np.where(moved == 0.0, 1.0, moved),
        time=landings.time + later_s,
        temperature=landings.temperature,
        target=np.array([at.target_names.index(name) for name in landings.target]),
    )


def covariance_of_readings(
    cell: Cell, world: WorldFrame, model: ModelStructure, estimate: Array, conditions: Conditions
) -> Array:
    """Compute the covariance (n, 3, 3), mm2, of readings of points in the world.

    It is that of the instrument's declared noise and of the robot's repeatability.
    """
    noise = replace(setup_of(cell, list(cell.tool.targets)).noise, station_mm=tuple(map(float, world.origin)))
    robot = model.robot
    frames = BoundModel(model, conditions).frames(estimate, robot.joint_slots)
    points = np.broadcast_to(frames.p, (3, len(conditions))).T
    covariance = noise.of_points(points, np.full(points.shape, np.nan))
    return covariance + noise.of_joints(frames.velocities(robot.joint_slots), robot.kinds)


@dataclass(frozen=True)
class JudgedLandings:
    """Errors of landings, mm.

    Without nests, as with a ballbar, the errors are those of lengths, along the bar.

    Attributes
    ----------
    errors
        Landed minus required points, shape (n, 3).
    corrected
        Whether each was driven corrected, shape (n,).
    floor_mm
        RMS distance that a perfect correction would show in the record of each, shape (n,).
    off_mm
        By how much the nests were off; None without nests.
    u_mm
        Expanded uncertainty of each, shape (n,).
    goals_deg
        Joints of the poses, not corrected, shape (n, N).
    wanted
        Required points, shape (n, 3).
    target
        Name of the target of each.
    """

    errors: Array
    corrected: NDArray[np.bool_]
    floor_mm: Array
    off_mm: float | None
    u_mm: Array
    goals_deg: Array
    wanted: Array
    target: tuple[str, ...]


def judge(
    landings: Landings,
    wanted: Mapping[tuple[float, ...], tuple[float, ...]],
    saved: CalibratedModel,
    world: WorldFrame,
    cell: Cell,
    later_s: float,
    devices: Mapping[str, Individual],
) -> JudgedLandings:
    """Compare landings with the positions of the targets on the nominal robot.

    `wanted` maps driven joints to target joints, deg, both as commanded; joints without an entry were driven
    uncorrected. `devices` are those of campaign 1, whose frame is `world`. The record began `later_s` after the clock
    of the model.
    """
    holds = frame_holds(landings, world, cell.nests, devices)
    points = landed_points(landings, world, saved.model, saved.estimate, later_s, holds=holds)
    driven = [tuple(np.round(row, DECIMALS).tolist()) for row in landings.driven_deg]
    goals = np.array([wanted.get(joints, joints) for joints in driven])
    conditions = conditions_of(landings, saved.model, later_s)
    required = nominal_points(cell, goals, landings.target)
    covariance = covariance_of_readings(cell, world, saved.model, saved.estimate, conditions)
    floor = float(np.sqrt(np.mean(np.trace(covariance, axis1=1, axis2=2))))
    return JudgedLandings(
        errors=points - required,
        corrected=np.array([joints in wanted for joints in driven]),
        floor_mm=np.full(len(points), floor),
        off_mm=nests_off(landings, world, cell.nests),
        u_mm=expanded(covariance),
        goals_deg=goals,
        wanted=required,
        target=landings.target,
    )


def nominal_points(cell: Cell, joints_deg: Array, names: Sequence[str]) -> Array:
    """Compute where the nominal robot of a cell puts target `names[i]` at row i of the joints.

    The joints (n, N) are in deg, the result (n, 3) in mm.
    """
    at = targets_at(cell, joints_deg)
    known = list(cell.tool.targets)
    return at[np.arange(len(at)), [known.index(name) for name in names]]


def verification_of(
    judged: Sequence[JudgedLandings],
    poses: int,
    refused: Sequence[str],
    approach: str,
    accepted: Sequence[str] = (),
) -> Verification:
    """Combine all batches.

    Raises
    ------
    ValueError
        No corrected target was measured.
    """
    errors, corrected, floors, u_mm, goals, wanted = (
        np.concatenate(part)
        for part in zip(
            *((j.errors, j.corrected, j.floor_mm, j.u_mm, j.goals_deg, j.wanted) for j in judged), strict=True
        )
    )
    distances = np.linalg.norm(errors, axis=1)
    number = {goal: n for n, goal in enumerate(dict.fromkeys(map(tuple, goals.tolist())), start=1)}
    names = [name for j in judged for name in j.target]
    verified = statistics_of(distances[corrected])
    if verified is None:
        raise ValueError("no corrected target was measured")
    off_mm = [j.off_mm for j in judged if j.off_mm is not None]
    return Verification(
        uncorrected=statistics_of(distances[~corrected]),
        verified=verified,
        floor_mm=float(np.sqrt(np.mean(floors[corrected] ** 2))),
        poses=poses,
        refused=tuple(refused),
        nests_off_mm=max(off_mm, default=None),
        approach=approach,
        accepted=tuple(accepted),
        of_lengths=not off_mm,
        landings=tuple(
            Landing(number[tuple(goal)], name, bool(by), tuple(goal), tuple(point), tuple(error), off, u)
            for goal, name, by, point, error, off, u in zip(
                goals.tolist(),
                names,
                corrected,
                wanted.tolist(),
                errors.tolist(),
                distances.tolist(),
                u_mm.tolist(),
                strict=True,
            )
        ),
    )
