"""Inverse kinematics of the nominal robot in closed form: every pose in all its branches at once.

With E = (z_1 x z_2, z_1, z_2) at the zero pose every rotation of the arm is a rotation in a plane. In turn:

    shoulder   w = T M^-1 w_0;   z_2 . R_1^-1 (w - o_1) = const   gives theta_1, front and back
    elbow      |p|^2 = |l|^2 + |f|^2 + 2 |l| |f| cos(theta_3 + phi)   gives theta_3, up and down, then theta_2
    wrist      v = R z_6 = cos(psi) z_4 + sin(psi) (cos(theta_4) z_5 x z_4 + sin(theta_4) z_5)
               gives theta_4 and psi = theta_5 + tilt, noflip and flip, then theta_6

A spherical wrist takes the elbow first, with p the wrist centre. With three parallel axes the wrist comes first,
theta_4 being the sum of the three, and p is where axis 4 then lies. Sources: Pieper 1968; Paden 1986 (the
sub-problems); Hawkins 2013 (the order for the UR arms).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from calib.arm.inverse_kinematics.solutions import REACHED, SINGULAR_SINE, Reached, Solutions
from calib.arm.inverse_kinematics.structure import Structure, structure_of
from calib.arm.robot import Robot
from calib.array import Array

ROUNDING = 1e-12
"""Relative: by so much a cosine may exceed one in a pose just reached, and a sine be zero that leaves a joint free."""

# The axes of the branches come first, then the poses: (front, up, noflip, n). Every product runs over all poses.
_FRONT = np.array([1.0, -1.0]).reshape(2, 1, 1, 1)
_UP = np.array([1.0, -1.0]).reshape(1, 2, 1, 1)
_NOFLIP = np.array([1.0, -1.0]).reshape(1, 1, 2, 1)

Mask = NDArray[np.bool_]
Vector = tuple[Array, Array, Array]


def inverse_kinematics(
    robot: Robot, poses: Array, *, seed: Array | None = None, structure: Structure | None = None
) -> Solutions:
    """All branches of the flange poses (n, 4, 4), base frame, mm.

    seed: (n, 6) model angles, rad, from which a singular pose takes the joint that it leaves free; default 0.
    structure: of the robot, where it is known already. Raises DataError for a robot that has no closed form here,
    ValueError for arrays of the wrong shape or with numbers that are not finite.
    """
    poses = np.asarray(poses, dtype=np.float64)
    if poses.ndim != 3 or poses.shape[1:] != (4, 4):
        raise ValueError(f"poses have shape {poses.shape}; needed (n, 4, 4)")
    if not np.all(np.isfinite(poses)):
        raise ValueError("poses hold numbers that are not finite")
    seed = np.zeros((len(poses), 6)) if seed is None else np.asarray(seed, dtype=np.float64)
    if seed.shape != (len(poses), 6):
        raise ValueError(f"seed has shape {seed.shape}; needed ({len(poses)}, 6)")
    arm = structure_of(robot) if structure is None else structure
    return _solve(arm, poses, seed.T)


def _solve(arm: Structure, poses: Array, seed: Array) -> Solutions:
    n = len(poses)
    # What the arm as a whole turns: zero pose -> wanted pose, in the axes E.
    turned = arm.base @ poses[:, :3, :3] @ arm.flange[:3, :3].T
    in_flange = arm.flange[:3, :3].T @ (arm.centre - arm.flange[:3, 3])
    centre = _columns((poses[:, :3, 3] + poses[:, :3, :3] @ in_flange - arm.points[0]) @ arm.base.T)
    axis_6, axis_5 = _columns(turned @ arm.axes[5]), _columns(turned @ arm.axes[4])

    theta_1, near, above = _shoulder(arm, centre, seed[0])
    centre, axis_6, axis_5 = (_turn_back(v, theta_1, (2, 0)) for v in (centre, axis_6, axis_5))
    s3, s4 = arm.senses
    if arm.kind == "spherical wrist":
        theta_2, bent, far, stretched = _elbow(arm, _from_axis_2(arm, centre))
        arm_turn = theta_2 + bent
        axis_6, axis_5 = (_turn_back(v, arm_turn, (0, 1)) for v in (axis_6, axis_5))
        theta_4, theta_5, theta_6, in_line = _wrist(arm, axis_6, axis_5, seed[3])
    else:
        free = s4 * (seed[1] + s3 * seed[2]) + seed[3]
        turn_4, theta_5, theta_6, in_line = _wrist(arm, axis_6, axis_5, free)
        hand = arm.base @ (arm.centre - arm.points[3])
        angle = s4 * turn_4
        from_4 = (
            np.cos(angle) * hand[0] - np.sin(angle) * hand[1],
            np.sin(angle) * hand[0] + np.cos(angle) * hand[1],
        )
        x, y = _from_axis_2(arm, centre)
        theta_2, bent, far, stretched = _elbow(arm, (x - from_4[0], y - from_4[1]))
        theta_4 = turn_4 - s4 * (theta_2 + bent)
    angles = (theta_1, theta_2, s3 * bent, theta_4, theta_5, theta_6)

    joints = np.empty((n, 8, 6))
    for k, angle in enumerate(angles):
        joints[:, :, k] = np.broadcast_to(angle, (2, 2, 2, n)).reshape(8, n).T
    joints -= 2.0 * np.pi * np.round(joints / (2.0 * np.pi))
    state = np.zeros((2, 2, 2, n), dtype=np.int8)
    for what, mask in (  # the weightiest last: it is the one that is kept
        (Reached.WRIST, in_line),
        (Reached.ELBOW, stretched),
        (Reached.SHOULDER, above),
        (Reached.TOO_FAR, far),
        (Reached.TOO_NEAR, near),
    ):
        state[np.broadcast_to(mask, state.shape)] = REACHED.index(what)
    solutions = Solutions(joints, state.reshape(8, n).T.copy())
    joints[~solutions.valid] = np.nan
    return solutions


def _columns(vectors: Array) -> Vector:
    """Components of (n, 3) vectors, each (n,)."""
    x, y, z = np.ascontiguousarray(vectors.T)
    return x, y, z


def _turn_back(v: Vector, angle: Array, plane: tuple[int, int]) -> Vector:
    """Components of v after a rotation by -angle that leads the first axis of the plane to the second."""
    i, j = plane
    c, s = np.cos(angle), np.sin(angle)
    out = list(np.broadcast_arrays(*v, angle)[:3])
    out[i], out[j] = c * v[i] + s * v[j], c * v[j] - s * v[i]
    return out[0], out[1], out[2]


def _shoulder(arm: Structure, centre: Vector, free: Array) -> tuple[Array, Mask, Mask]:
    """theta_1 (2, 1, 1, n); where the pose is too near to axis 1; where the wrist centre lies above it."""
    size = np.hypot(centre[0], centre[2])
    short = (size - abs(arm.across)) * (size + abs(arm.across))
    scale = arm.upper_arm[1] + arm.forearm[1]
    near = short < -ROUNDING * scale**2
    reach = _FRONT * arm.front * np.sqrt(np.maximum(short, 0.0))
    theta_1 = np.arctan2(centre[0], centre[2]) - np.arctan2(reach, arm.across)
    above = np.abs(reach) < SINGULAR_SINE * scale
    undetermined = size < ROUNDING * scale
    return np.where(undetermined, free, theta_1), near, above & ~near


def _from_axis_2(arm: Structure, point: Vector) -> tuple[Array, Array]:
    """A point given from o_1 in the axes E, as seen from axis 2 in the plane across it."""
    offset = arm.base @ (arm.points[1] - arm.points[0])
    return point[0] - offset[0], point[1] - offset[1]


def _elbow(arm: Structure, end: tuple[Array, Array]) -> tuple[Array, Array, Mask, Mask]:
    """theta_2 and the turn of the forearm against the upper arm; where that is out of reach; where stretched."""
    (angle_upper, upper), (angle_fore, fore) = arm.upper_arm, arm.forearm
    x, y = end
    cosine = (x * x + y * y - upper * upper - fore * fore) / (2.0 * upper * fore)
    far = np.abs(cosine) > 1.0 + ROUNDING
    sine = _UP * np.sqrt(np.maximum((1.0 - cosine) * (1.0 + cosine), 0.0))
    between = np.arctan2(sine, cosine)  # from upper arm to forearm
    lead = np.arctan2(fore * sine, upper + fore * cosine)  # from upper arm to the end
    theta_2 = np.arctan2(y, x) - lead - angle_upper
    return theta_2, between - angle_fore + angle_upper, far, (np.abs(sine) < SINGULAR_SINE) & ~far


def _wrist(arm: Structure, axis_6: Vector, axis_5: Vector, free: Array) -> tuple[Array, Array, Array, Mask]:
    """theta_4, theta_5, theta_6 from where axes 6 and 5 of the zero pose have been turned by joints 4 to 6.

    Both in the axes E. free: theta_4 where axes 4 and 6 are in line.
    """
    to_wrist = arm.wrist @ arm.base.T
    x, y, z = _change(to_wrist, axis_6)
    across = np.hypot(x, y)
    theta_4 = np.where(across < ROUNDING, free, np.arctan2(_NOFLIP * y, _NOFLIP * x))
    psi = np.arctan2(_NOFLIP * across, z)
    c, s = np.cos(theta_4), np.sin(theta_4)
    rx, ry, rz = _change(to_wrist, axis_5)
    rx, ry = c * rx + s * ry, c * ry - s * rx
    theta_6 = np.arctan2(np.sin(psi) * rz - np.cos(psi) * rx, ry)
    return theta_4, psi - arm.tilt, theta_6, across < SINGULAR_SINE


def _change(rotation: Array, v: Vector) -> Vector:
    """Components of v in other axes: the rows of `rotation`."""
    x, y, z = (row[0] * v[0] + row[1] * v[1] + row[2] * v[2] for row in rotation)
    return x, y, z
