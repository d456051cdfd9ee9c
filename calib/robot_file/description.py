"""Description of the arm in a robot file, in values to compare with a data sheet.

The values are reach, wrist, parallel axes, named postures and the inverse kinematics that applies.
Remarks report unusual values: axes that nearly meet, a zero pose outside the limits, a length in metres.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.arm import BasePoses, Chain, Robot, forward, nominal_values, propagate
from calib.arm.inverse_kinematics import arm_of
from calib.array import Array
from calib.errors import DataError
from calib.units import DEG

_SAMPLES = 20_000
_MEET_MM = 1e-6
_NEARLY_MM = 5.0  # axes that miss each other by less were meant to meet, or the number is a small offset
_PARALLEL = 1e-9
_SHORT_MM = 20.0  # an arm with a smaller reach has its lengths in metres


@dataclass(frozen=True)
class Described:
    """Description of a robot file.

    Attributes
    ----------
    postures : dict of str to (array, array)
        By name: joints (N,), rad or mm, and flange pose (4, 4), mm.
    reach_mm : float
        Largest distance of the flange from axis 1 in random postures.
    span_mm : float
        Sum of the lengths of all links.
    axes, points : array of shape (N, 3)
        Directions of the joints' axes and points on them, mm, with all joints at zero.
    wrist, inverse : str
        Sentences.
    remarks : tuple of str
        Unusual values.
    """

    postures: dict[str, tuple[Array, Array]]
    reach_mm: float
    span_mm: float
    axes: Array
    points: Array
    wrist: str
    inverse: str
    remarks: tuple[str, ...]


def described(robot: Robot, home: Array | None = None) -> Described:
    """Describe a robot; `home` (N,) is the user's own posture, rad or mm."""
    zero, middle = np.zeros(robot.joints), (np.array(robot.lower) + np.array(robot.upper)) / 2.0
    named = {"all zero": zero, "middle of the ranges": middle} | ({} if home is None else {"home": home})
    poses = forward(robot, np.stack(list(named.values())))
    axes, points = axes_of(robot, zero)
    drawn = np.random.default_rng(1).uniform(robot.lower, robot.upper, (_SAMPLES, robot.joints))
    flange = forward(robot, drawn)[:, :3, 3] - points[0]
    along = flange @ axes[0]
    reach = float(np.sqrt(np.sum(flange**2, axis=1) - along**2).max())
    span = float(np.sum(np.hypot(robot.a, robot.d)))
    wrist, odd = _wrist(axes, points)
    return Described(
        postures={name: (joints, pose) for (name, joints), pose in zip(named.items(), poses, strict=True)},
        reach_mm=reach,
        span_mm=span,
        axes=axes,
        points=points,
        wrist=wrist,
        inverse=_inverse(robot),
        remarks=(*odd, *_oddities(robot, axes, points, span)),
    )


def axes_of(robot: Robot, joints: Array) -> tuple[Array, Array]:
    """Return directions (N, 3) and points (N, 3), mm, of the joints' axes in the base frame.

    `joints` (N,) are model joints.
    """
    frames = propagate(Chain.of(robot), nominal_values(robot, joints[None, :]), BasePoses())
    slots = [f"theta{k}" for k in range(1, robot.joints + 1)]
    axes = [np.broadcast_to(frames.axis[slot], (3, 1))[:, 0] for slot in slots]
    points = [np.broadcast_to(frames.origin[slot], (3, 1))[:, 0] for slot in slots]
    return np.stack(axes), np.stack(points)


def gap_mm(axes: Array, points: Array, i: int, j: int) -> float:
    """Shortest distance, mm, of the axes i and j (0-based)."""
    across, span = np.cross(axes[i], axes[j]), points[j] - points[i]
    sine = float(np.linalg.norm(across))
    if sine <= _PARALLEL:
        return float(np.linalg.norm(span - (span @ axes[i]) * axes[i]))
    return abs(float(span @ across)) / sine


def _wrist(axes: Array, points: Array) -> tuple[str, list[str]]:
    """Describe the last three axes in a sentence, and list remarks on unusual values."""
    count = len(axes)
    if count < 6:
        return f"{count} joints: there is no wrist of three axes", []
    last = [count - 3, count - 2, count - 1]
    pairs = [(last[0], last[1]), (last[1], last[2]), (last[0], last[2])]
    gaps = {(i + 1, j + 1): gap_mm(axes, points, i, j) for i, j in pairs}
    names = ", ".join(str(k + 1) for k in last)
    if max(gaps.values()) <= _MEET_MM:
        centre = _meeting(axes[last], points[last])
        if float(np.linalg.norm(np.cross(axes[last], points[last] - centre), axis=1).max()) <= _MEET_MM:
            place = ", ".join(f"{x:.6g}" for x in np.round(centre, 6) + 0.0)
            return f"spherical: axes {names} meet in [{place}] mm at all zero", []
        return f"axes {names} meet in pairs, but not in one point", []
    apart = {pair: gap for pair, gap in gaps.items() if gap > _MEET_MM}
    what = ", ".join(f"{i} and {j} pass each other at {gap:.6g} mm" for (i, j), gap in apart.items())
    odd = [
        f"Axes {i} and {j} nearly meet, at {gap:.4g} mm: if the maker says that they meet, "
        f"look at a_mm and d_mm of links {i} and {j}."
        for (i, j), gap in apart.items()
        if gap < _NEARLY_MM
    ]
    return f"not spherical: of axes {names}, {what}", odd


def _meeting(axes: Array, points: Array) -> Array:
    """Find the point nearest to lines (k, 3) by least squares, shape (3,)."""
    across = np.eye(3) - axes[:, :, None] * axes[:, None, :]
    return np.linalg.lstsq(across.sum(axis=0), np.einsum("kij,kj->i", across, points), rcond=None)[0]


def _inverse(robot: Robot) -> str:
    try:
        return arm_of(robot).kind
    except DataError as error:
        return error.what.rstrip(".")


def _oddities(robot: Robot, axes: Array, points: Array, span: float) -> list[str]:
    out = []
    if 0.0 < span < _SHORT_MM:
        out.append(f"All links together are {span:.3g} mm long: are a_mm and d_mm in metres?")
    if largest_angle(robot) < 2.0 * np.pi * DEG and largest_angle(robot) > 0.0:
        out.append("No angle of the table exceeds 6.3 deg: are alpha_deg and theta_deg in radians?")
    outside = [
        name
        for name, low, high in zip(robot.axes, robot.lower, robot.upper, strict=True)
        if not low <= 0.0 <= high
    ]
    if outside:
        out.append(f"All zero lies outside the limits of {', '.join(outside)}.")
    parallel = [
        k + 1
        for k in range(1, robot.joints)
        if float(np.linalg.norm(np.cross(axes[k - 1], axes[k]))) <= _PARALLEL
        and gap_mm(axes, points, k - 1, k) > _MEET_MM
    ]
    behind = 1 if robot.convention == "dh" else 0  # the robot keeps links, the file names axes
    missing = [k for k in parallel if k - behind not in robot.parallel_axes]
    if missing:
        out.append(
            f"Axes {', '.join(f'{k - 1} and {k}' for k in missing)} are parallel: parallel_axes = {parallel} has their "
            "twist identified, which d and alpha alone cannot follow."
        )
    return out


def largest_angle(robot: Robot) -> float:
    """Return the largest angle of the table, rad."""
    return max(abs(x) for x in (*robot.alpha, *robot.theta))
