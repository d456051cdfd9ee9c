"""The kinematic rows of a UR's `calibration.conf`, and the frames that they leave over.

    [mounting]
    delta_theta = [ .., .., .., .., .., .. ]      rad, and so on: delta_a, delta_d in m, delta_alpha in rad

The controller adds them to the DH numbers of its type: T_k = Rz(q + delta_theta) Tz(d + delta_d) Tx(a + delta_a)
Rx(alpha + delta_alpha). Between two axes four numbers hold every geometry, the twist of parallel axes too. The common
normal of axes that are nearly parallel is far away. So d is large there (a hundred metres in the files of real arms),
and theta and a belong to this normal. Parts in front of axis 1, and parts behind axis 6 except along it, have no
place. Their geometry is written as a base frame and a tool.

    O_{k+1} = Rz(t) Tz(s) Tx(a) Rx(alpha) Rz(t') Tz(s')

is solved for each frame O between two axes (`calib.compensate.joint_origins`); t', s' pass to the next joint.

The layout and the sum q + delta_theta are from `configs/calibration.conf` and `data` of
github.com/weijieyong/UR_kinematics_calib. These formulas meet its controller's own poses within 0.08 mm. A second file
is `.urcontrol` of github.com/philipmarschner/dmp_project. The DH numbers of the types are from Universal Robots, "DH
parameters for calculations of kinematics and dynamics". No file was loaded into a controller.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping

import numpy as np

from calib.arm import Robot
from calib.array import Array
from calib.compensate import constant_slots, inverse_poses, joint_origins
from calib.errors import DataError
from service.exports.frames import NOT_TRIED, UR, comment, of_ur
from service.exports.request import ExportRequest, Format, for_maker

_ROWS = ("delta_theta", "delta_a", "delta_d", "delta_alpha")
_METRE = 1000.0
_PARALLEL = 1e-8  # sine of a twist below which the common normal is taken where the type has it
_NEAR = 3.0  # mm, between a robot file and the type that it is of
_ALPHA = (math.pi / 2, 0.0, 0.0, math.pi / 2, -math.pi / 2, 0.0)
_A_D: Mapping[
    str, tuple[float, float, float, float, float, float]
] = {  # a_2, a_3, d_1, d_4, d_5, d_6 of the types, m
    "UR3": (-0.24365, -0.21325, 0.1519, 0.11235, 0.08535, 0.0819),
    "UR5": (-0.425, -0.39225, 0.089159, 0.10915, 0.09465, 0.0823),
    "UR10": (-0.612, -0.5723, 0.1273, 0.163941, 0.1157, 0.0922),
    "UR3e": (-0.24355, -0.2132, 0.15185, 0.13105, 0.08535, 0.0921),
    "UR5e": (-0.425, -0.3922, 0.1625, 0.1333, 0.0997, 0.0996),
    "UR10e": (-0.6127, -0.57155, 0.1807, 0.17415, 0.11985, 0.11655),
    "UR16e": (-0.4784, -0.36, 0.1807, 0.17415, 0.11985, 0.11655),
    "UR20": (-0.862, -0.7287, 0.2363, 0.201, 0.1593, 0.1543),
    "UR30": (-0.637, -0.5037, 0.2363, 0.201, 0.1593, 0.1543),
}


def _type_of(robot: Robot) -> tuple[str, Array]:
    """Return the type of an arm, and its theta, a, d, alpha (4, 6), rad and m.

    Raises
    ------
    DataError
        The numbers of the robot file are near those of no type.
    """
    frames, _ = joint_origins(robot, {})
    ours = _dh(frames, 0.0)[1:3]
    best, least = "", math.inf
    for name in _A_D:
        away = _METRE * float(np.max(np.abs(ours - _numbers(name)[1:3])))
        best, least = (name, away) if away < least else (best, least)
    if least > _NEAR:
        raise DataError(
            f"the lengths of {robot.name} are near those of no known type ({', '.join(_A_D)}).",
            do="Use a robot file with the DH numbers of its type.",
            key="--format",
        )
    return best, _numbers(best)


def _numbers(name: str) -> Array:
    a_2, a_3, d_1, d_4, d_5, d_6 = _A_D[name]
    return np.array([[0.0] * 6, [0.0, a_2, a_3, 0.0, 0.0, 0.0], [d_1, 0.0, 0.0, d_4, d_5, d_6], _ALPHA])


def _dh(origins: Array, behind_mm: float) -> Array:
    """Solve the frames (6, 4, 4), mm, between joints for theta, a, d, alpha (4, 6), rad and m.

    The first frame must be a turn about z and a shift along it. The flange is `behind_mm` further along axis 6.
    """
    theta, a, d, alpha = np.zeros((4, 6))
    theta[0] = math.atan2(origins[0, 1, 0], origins[0, 0, 0])
    d[0] = origins[0, 2, 3] / _METRE
    for k in range(5):
        rotation, place = origins[k + 1, :3, :3], origins[k + 1, :3, 3] / _METRE
        sine = math.hypot(rotation[0, 2], rotation[1, 2])
        if sine < _PARALLEL:
            turn, a[k], shift = math.atan2(place[1], place[0]), math.hypot(place[0], place[1]), place[2]
        else:
            # The third column of the rotation is Rz(turn) (0, -sin alpha, cos alpha)
            sign = -1.0 if _ALPHA[k] < 0.0 else 1.0
            alpha[k] = math.atan2(sign * sine, rotation[2, 2])
            turn = math.atan2(sign * rotation[0, 2], -sign * rotation[1, 2])
            x, y = np.array([math.cos(turn), math.sin(turn)]), np.array([-math.sin(turn), math.cos(turn)])
            a[k] = place[:2] @ x
            shift = -(place[:2] @ y) / math.sin(alpha[k])
        if _ALPHA[k] == 0.0 < a[k]:  # a normal has two directions: the lengths of the types are negative
            turn, a[k], alpha[k] = turn + math.pi, -a[k], -alpha[k]
        rest = (_rx(alpha[k]).T @ _rz(turn).T) @ rotation
        theta[k] += turn
        d[k] += place[2] - shift * math.cos(alpha[k])
        theta[k + 1] += math.atan2(rest[1, 0], rest[0, 0])
        d[k + 1] += shift
    d[5] += behind_mm / _METRE
    return np.stack([np.remainder(theta + math.pi, 2.0 * math.pi) - math.pi, a, d, alpha])


def _rz(angle: float) -> Array:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _rx(angle: float) -> Array:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])


def _parts(export: ExportRequest) -> tuple[str, Array, Array, Array]:
    """Return the type, the rows (4, 6), and the poses (4, 4), mm, before joint 1 and behind 6."""
    name, published = _type_of(export.robot)
    origins, tip = joint_origins(export.robot, export.carried.values)
    origins, along = origins.copy(), np.eye(4)
    along[2, 3] = _METRE * published[2, 0]
    base, origins[0] = origins[0] @ inverse_poses(along), along
    found = _dh(origins, tip[2, 3])
    behind = tip.copy()
    behind[2, 3] = 0.0
    return name, found - published, base, behind


def _writes(export: ExportRequest) -> str:
    name, rows, base, behind = _parts(export)
    lines = comment(export.about, "# ")
    lines += comment(
        [
            f"The four rows replace those of the {name}'s own /root/.urcontrol/calibration.conf. Keep a copy of it, "
            "and keep its other lines (joint_checksum, joint_raw_offset and so on): they belong to the joints. Arm "
            "off; power cycle afterwards. At the same joint angles the shown pose of the flange then changes, the "
            "arm does not move.",
            "In front of the rows: targets x in the frame of the robot's base as the readings have it become "
            "pose_trans(base, x); put the tool `flange` in front of your own: pose_trans(flange, tool).",
        ],
        "# ",
    )
    for called, pose in (("base", inverse_poses(base)), ("flange", behind)):
        lines.append(f"# {called} = p[{', '.join(UR.numbers(pose))}]")
    lines.append("[mounting]")
    lines += [
        f"{row} = [ {', '.join(f'{value + 0.0:.18g}' for value in values)}]"
        for row, values in zip(_ROWS, rows, strict=True)
    ]
    return "\n".join([*lines, ""])


def _reads(text: str, export: ExportRequest) -> Array:
    rows = []
    for row in _ROWS:
        found = re.search(rf"^{row} = \[(.*?)\]", text, re.MULTILINE)
        assert found is not None, f"the file lacks {row}"
        rows.append([float(value) for value in found[1].split(",")])
    base, behind = (
        of_ur([float(value) for value in numbers.split(",")])
        for numbers in re.findall(r"^# (?:base|flange) = p\[(.*?)\]", text, re.MULTILINE)
    )
    theta, a, d, alpha = _type_of(export.robot)[1] + np.array(rows)
    joints = export.carried.joints
    reached = np.tile(inverse_poses(base), (len(joints), 1, 1))
    for k in range(6):
        step = np.zeros((len(joints), 4, 4))
        c, s = np.cos(joints[:, k] + theta[k]), np.sin(joints[:, k] + theta[k])
        ca, sa = math.cos(alpha[k]), math.sin(alpha[k])
        step[:, 0] = np.stack([c, -s * ca, s * sa, _METRE * a[k] * c], axis=1)
        step[:, 1] = np.stack([s, c * ca, -c * sa, _METRE * a[k] * s], axis=1)
        step[:, 2] = 0.0, sa, ca, _METRE * d[k]
        step[:, 3, 3] = 1.0
        reached = reached @ step
    return reached @ behind


def _suits(robot: Robot) -> None:
    for_maker("universal robots", "UR")(robot)
    _type_of(robot)


UR_CALIBRATION = Format(
    constant_slots,
    _writes,
    _reads,
    "the controller's own DH numbers, a base frame and a tool",
    _suits,
    lambda export: (NOT_TRIED, "A UR checks its joints against this file: have the maker's service at hand."),
)
