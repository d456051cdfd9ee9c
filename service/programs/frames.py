"""Poses as controllers write them: quaternion (ABB), W P R (Fanuc), rotation vector (UR).

Inside, a pose is (4, 4) in mm. W, P, R turn about the fixed x, y and z axes in this order: R = Rz(R) Ry(P)
Rx(W). Tools and frames that a program names without holding them come from the command line in the same form.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation

from calib.arm import FARTHEST_MM, MOST_TURN
from calib.array import Array
from calib.errors import DataError
from calib.units import DEG

NORM_TOLERANCE = 1e-3  # how far from 1 the norm of a quaternion may be, that was written with four digits
UNNAMED = ""
_FEWEST_PULSES, _MOST_PULSES = 1.0, 1e6  # a degree


@dataclass(frozen=True)
class KnownFrames:
    """Tools on the flange and frames in the controller's world, by name or number.

    `pulses_per_deg` has a value for each axis, for programs that count in pulses; it is empty if unknown.
    `external_apart` says that the external axes carry neither the robot nor the workpiece, so that they keep their
    values and change nothing.
    """

    tools: Mapping[str, Array] = field(default_factory=dict)
    frames: Mapping[str, Array] = field(default_factory=dict)
    pulses_per_deg: tuple[float, ...] = ()
    external_apart: bool = False

    def note_external(self, *, used: bool) -> tuple[str, ...]:
        """Return the notes of a target that uses external axes.

        Raises
        ------
        ValueError
            External axes may change the place of the tool.
        """
        if used and not self.external_apart:
            raise ValueError(
                "it positions an external axis, which may carry the robot or the work "
                "(--fixed-external-axes: it does not)"
            )
        return ("its external axes stay as they are",) if used else ()


def joint_angles(angles: Sequence[float] | Array) -> Array:
    """Return joint angles (N,), rad.

    Raises
    ------
    ValueError
        An angle is larger than that of any joint.
    """
    if not np.all(np.abs(angles) <= MOST_TURN):
        raise ValueError(f"a joint angle is beyond {MOST_TURN / DEG:g} deg")
    return np.array(angles, dtype=np.float64)


def joint_positions(joints: Array, kinds: Sequence[str]) -> Array:
    """Return joints (N,), rad or mm.

    Raises
    ------
    ValueError
        A rotation or travel is larger than that of any joint.
    """
    slides = np.array(kinds) == "slides"
    joint_angles(joints[~slides])
    if not np.all(np.abs(joints[slides]) <= FARTHEST_MM):
        raise ValueError(f"a slide is farther than {FARTHEST_MM / 1000:g} m away")
    return joints


def pose_of(position: Sequence[float], rotation: Rotation) -> Array:
    """Return the pose (4, 4) of a position in mm and a rotation.

    Raises
    ------
    ValueError
        No robot reaches the position.
    """
    if not np.all(np.abs(position) <= FARTHEST_MM):
        raise ValueError(f"it is farther than {FARTHEST_MM / 1000:g} m away")
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation.as_matrix(), position
    return pose


def of_quaternion(position: Sequence[float], wxyz: Sequence[float]) -> Array:
    """Return the pose of a scalar-first quaternion.

    Raises
    ------
    ValueError
        The norm of the quaternion is not 1; the message states it.
    """
    norm = math.sqrt(sum(x * x for x in wxyz))
    if not abs(norm - 1.0) <= NORM_TOLERANCE:
        raise ValueError(f"its quaternion has norm {norm:.6g}, not 1")
    w, x, y, z = wxyz
    return pose_of(position, Rotation.from_quat([x, y, z, w]))


def quaternion(pose: Array, near: Sequence[float]) -> list[float]:
    """Return the scalar-first quaternion of a pose.

    Of the two equivalent ones, it is the one on the side of `near`.
    """
    x, y, z, w = Rotation.from_matrix(pose[:3, :3]).as_quat()
    found = np.array([w, x, y, z])
    return list(-found if found @ np.asarray(near) < 0.0 else found)


def of_wpr(position: Sequence[float], wpr_deg: Sequence[float]) -> Array:
    """Return the pose of W, P, R in degrees.

    Raises
    ------
    ValueError
        No robot has this position or angle.
    """
    joint_angles(np.radians(wpr_deg))
    return pose_of(position, Rotation.from_euler("xyz", wpr_deg, degrees=True))


def wpr(pose: Array, near: Sequence[float]) -> list[float]:
    """Return W, P, R in degrees, -180 to 180.

    Of the two equivalent triples, it is the one nearest to `near`. At P = +-90, where W and R turn about the same
    axis, W keeps its value.
    """
    rotation = pose[:3, :3]
    cosine = math.hypot(rotation[0, 0], rotation[1, 0])
    if cosine < 1e-9:
        w = math.radians(near[0])
        p = math.atan2(-rotation[2, 0], cosine)
        sign = 1.0 if p > 0.0 else -1.0
        r = sign * w - math.atan2(sign * rotation[0, 1], rotation[1, 1])
        candidates = [(w, p, r)]
    else:
        w = math.atan2(rotation[2, 1], rotation[2, 2])
        p = math.atan2(-rotation[2, 0], cosine)
        r = math.atan2(rotation[1, 0], rotation[0, 0])
        candidates = [(w, p, r), (w + math.pi, math.pi - p, r + math.pi)]
    near = [math.radians(angle) for angle in near]

    def away(candidate: Sequence[float]) -> float:
        return sum(math.remainder(a - b, 2.0 * math.pi) ** 2 for a, b in zip(candidate, near, strict=True))

    return [math.degrees(math.remainder(angle, 2.0 * math.pi)) for angle in min(candidates, key=away)]


def of_vector(position: Sequence[float], vector: Sequence[float]) -> Array:
    """Return the pose of a rotation vector in rad.

    Raises
    ------
    ValueError
        No robot has this position or angle.
    """
    joint_angles(vector)
    return pose_of(position, Rotation.from_rotvec(vector))


def rotation_vector(pose: Array, near: Sequence[float]) -> list[float]:
    """Return the rotation vector of a pose, rad.

    Of those that differ by whole turns, it is the one nearest to `near`.
    """
    vector = Rotation.from_matrix(pose[:3, :3]).as_rotvec()
    angle = float(np.linalg.norm(vector))
    if angle < 1e-12:
        return list(vector)
    axis = vector / angle
    turns = round((float(axis @ np.asarray(near)) - angle) / (2.0 * math.pi))
    return list(axis * (angle + 2.0 * math.pi * turns))


def named_frames(option: str, texts: Sequence[str]) -> dict[str, Array]:
    """Parse poses from `NAME=x,y,z,w,p,r` or, unnamed, `x,y,z,w,p,r` (mm, deg).

    Raises
    ------
    DataError
        A text is no pose; the message names the option.
    """
    out: dict[str, Array] = {}
    for text in texts:
        name, equals, numbers = text.rpartition("=")
        key = name.strip() if equals else UNNAMED
        try:
            x, y, z, w, p, r = (float(part) for part in numbers.split(","))
            pose = of_wpr((x, y, z), (w, p, r))
        except ValueError as error:
            raise DataError(
                f"'{text}' is not a frame.", do="Write NAME=x,y,z,w,p,r in mm and degrees.", key=option
            ) from error
        if key.lower() in out:
            raise DataError(f"'{key}' is given twice.", do="Give it once.", key=option)
        out[key.lower()] = pose
    return out


def pulses_of(option: str, text: str) -> tuple[float, ...]:
    """Parse the pulses per degree of every axis from `p1,p2,...`; none from an empty text.

    Raises
    ------
    DataError
        The text is no list of pulses; the message names the option.
    """
    try:
        pulses = tuple(float(part) for part in text.split(",")) if text.strip() else ()
    except ValueError:
        pulses = (math.nan,)
    if not all(_FEWEST_PULSES <= abs(each) <= _MOST_PULSES for each in pulses):
        raise DataError(
            f"'{text[:60]}' is not a list of pulses per degree.",
            do=f"Give a number for each axis, {_FEWEST_PULSES:g} to {_MOST_PULSES:g}, with ',' between.",
            key=option,
        )
    return pulses
