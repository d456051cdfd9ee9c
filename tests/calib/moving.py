"""Simulated UR5 that is driven through waypoints and followed by a tracker.

Both streams have separate clocks, and the truth is returned as well. The code is independent of `calib`: it uses
4x4 matrices and the DH table of Khanesar et al. (2022). The joints are functions of true time, so both streams are
exact except for the errors that are added.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from tests.calib.bending import ALPHA, A, D, Gears

Array = NDArray[np.float64]

TOOL = (55.0, 12.0, 169.5)
JOINT_STEP = 1e-5  # rad: what the encoders resolve


@dataclass(frozen=True)
class Moving:
    """Streams of a moving robot and of a tracker, and the truth.

    Attributes
    ----------
    robot_time, joints : arrays of shape (n,) and (n, 6)
        Robot clock, s, and joints, rad.
    tracker_time, points, true_points : arrays of shape (k,), (k, 3) and (k, 3)
        Tracker clock, s, and points with and without noise, mm.
    offset : float
        Robot's clock less the tracker's at the middle of the tracker's recording, s.
    rate : float
        Rate as a ratio.
    waypoints, legs
        Joints at rest (w, 6), and the order in which they are visited.
    """

    robot_time: Array
    joints: Array
    tracker_time: Array
    points: Array
    true_points: Array
    offset: float
    rate: float
    waypoints: Array
    legs: NDArray[np.int64]


def tool_points(joints: Array, errors: Array, tool: tuple[float, float, float] = TOOL) -> Array:
    """Compute tool points in the base frame, (n, 3); errors (4, 6) of a, d, alpha, theta."""
    point = np.broadcast_to(np.append(tool, 1.0), (len(joints), 4))[:, :, None]
    for k in range(5, -1, -1):
        a, d, alpha = A[k] + errors[0, k], D[k] + errors[1, k], ALPHA[k] + errors[2, k]
        c, s = np.cos(joints[:, k] + errors[3, k]), np.sin(joints[:, k] + errors[3, k])
        link = np.zeros((len(joints), 4, 4))
        link[:, 0] = np.stack([c, -s * np.cos(alpha), s * np.sin(alpha), a * c], axis=1)
        link[:, 1] = np.stack([s, c * np.cos(alpha), -c * np.sin(alpha), a * s], axis=1)
        link[:, 2] = [0.0, np.sin(alpha), np.cos(alpha), d]
        link[:, 3, 3] = 1.0
        point = link @ point
    return point[:, :3, 0]


def path(waypoints: Array, legs: NDArray[np.int64], leg_s: float, rest_s: float, time: Array) -> Array:
    """Compute joints (n, 6) at true times (n,): rests, and moves of the fifth order between."""
    k = np.clip((time / leg_s).astype(int), 0, len(legs) - 2)
    u = np.clip((time - k * leg_s - 0.5 * rest_s) / (leg_s - rest_s), 0.0, 1.0)
    s = u**3 * (10.0 - 15.0 * u + 6.0 * u * u)
    here, there = waypoints[legs[k]], waypoints[legs[k + 1]]
    return here + (there - here) * s[:, None]


def sides(
    waypoints: Array, legs: NDArray[np.int64], leg_s: float, rest_s: float, time: Array, gap: Array
) -> Array:
    """Return the side of its gap (6,), rad, on which every joint lies, (n, 6), -1 to 1.

    The times are true times (n,); before the first leg the side is 1. A joint that turns back crosses its gap
    before the arm follows.
    """
    moves = np.sign(np.diff(waypoints[legs], axis=0))
    begun = np.clip(np.floor((time - 0.5 * rest_s) / leg_s).astype(int), -1, len(moves) - 1)
    before = np.vstack([np.ones(6), np.ones(6), moves])[begun + 1]
    after = np.vstack([np.ones(6), moves])[begun + 1]
    turned = np.abs(path(waypoints, legs, leg_s, rest_s, time) - waypoints[legs[np.maximum(begun, 0)]])
    return before + (after - before) * np.clip(turned / np.maximum(gap, 1e-12), 0.0, 1.0)


def simulate(
    seed: int,
    *,
    legs: int = 38,
    duration: float = 600.0,
    rest: float = 1.0,
    robot_hz: float = 125.0,
    tracker_hz: float = 10.0,
    noise_mm: float = 0.02,
    waypoints: int | None = None,
    jump: tuple[float, float] = (np.inf, 0.0),
    lag_s2_mm: float = 0.0,
    gears_of: Callable[[np.random.Generator], Gears] | None = None,
    repeatability_rad: float = 0.0,
) -> Moving:
    """Simulate the paper's set-up: 38 waypoints in 600 s at 125 Hz and 10 Hz.

    The clocks differ in offset and rate.

    Parameters
    ----------
    waypoints : int, optional
        Number of waypoints; if fewer than legs, they are visited again in turn.
    jump : tuple of float
        True time, s, and the number of seconds that the tracker's clock shows less from then on.
    lag_s2_mm : float
        Lag of the point along its path over its speed squared, mm per (mm/s)^2.
    gears_of : callable, optional
        Draws the gears of the arm; None for stiff gears without errors.
    repeatability_rad : float
        Error of a joint that every move and the rest after it share.
    """
    rng = np.random.default_rng(seed)
    count = legs if waypoints is None else waypoints
    low, high = [-1.0, -1.9, 1.2, -2.2, -2.0, -1.5], [1.0, -1.1, 2.0, -1.0, -1.1, 1.5]
    places = rng.uniform(low, high, (count, 6))
    order = np.arange(legs) % count
    leg_s = duration / (legs - 1)
    offset, rate = float(rng.uniform(-20.0, 20.0)), float(rng.uniform(-100e-6, 100e-6))
    errors = rng.normal(size=(4, 6)) * np.array([[0.3], [0.3], [5e-4], [1e-3]])
    pose = Rotation.from_euler("xyz", rng.uniform(-3.0, 3.0, 3))
    at = rng.uniform(-3000.0, 3000.0, 3)

    gears = None if gears_of is None else gears_of(rng)
    arrivals = repeatability_rad * np.random.default_rng([seed, 1]).normal(size=(legs, 6))

    def placed(time: Array) -> Array:
        joints = path(places, order, leg_s, rest, time)
        if gears is not None:
            joints = gears.turned(joints, sides(places, order, leg_s, rest, time, gears.play))
        joints = (
            joints + arrivals[np.clip(np.floor((time - 0.5 * rest) / leg_s).astype(int) + 1, 0, legs - 1)]
        )
        return pose.apply(tool_points(joints, errors)) + at

    true_robot = np.arange(0.0, duration, 1.0 / robot_hz)
    true_tracker = np.arange(1.0, duration - 2.0, 1.0 / tracker_hz) + rng.uniform(0.0, 0.02)
    middle = 0.5 * (true_tracker[0] + true_tracker[-1])
    # robot's clock = true time; tracker's clock t has  true = t + offset + rate (t - middle of t)
    tracker_time = middle - offset + (true_tracker - middle) / (1.0 + rate)
    tracker_time = tracker_time - jump[1] * (true_tracker >= jump[0])
    points = placed(true_tracker)
    if lag_s2_mm:
        velocity = (placed(true_tracker + 1e-4) - placed(true_tracker - 1e-4)) / 2e-4
        points = points - velocity * np.linalg.norm(velocity, axis=1)[:, None] * lag_s2_mm
    joints = np.round(path(places, order, leg_s, rest, true_robot) / JOINT_STEP) * JOINT_STEP
    return Moving(
        robot_time=true_robot,
        joints=joints,
        tracker_time=tracker_time,
        points=points + rng.normal(0.0, noise_mm, points.shape),
        true_points=points,
        offset=offset,
        rate=rate,
        waypoints=places,
        legs=order,
    )


def write_robot(path: Path, moving: Moving, *, zero: float = 0.0) -> Path:
    """The robot's stream as a file, its clock beginning at `zero`."""
    header = ",".join(["t_s", *(f"j{k}_deg" for k in range(1, 7))])
    rows = np.column_stack([moving.robot_time + zero, np.degrees(moving.joints)])
    np.savetxt(path, rows, "%.6f", delimiter=",", header=header, comments="")
    return path


def write_tracker(path: Path, moving: Moving) -> Path:
    """The tracker's stream as a file."""
    rows = np.column_stack([moving.tracker_time, moving.points])
    np.savetxt(path, rows, "%.6f", delimiter=",", header="t_s,x_mm,y_mm,z_mm", comments="")
    return path
