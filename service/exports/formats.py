"""The formats of `truepose export`: their contents and writers.

    ur-yaml    `kinematics:` of the UR ROS driver: six joint origins (m, rad) and the robot's own hash
    urdf       joint origins of a URDF (m, rad), with the base before and the flange behind
    dh-csv     the DH table in the robot file's convention, with Hayati's beta and the pose of the base
    dh-md      the same for people
    mastering  joint offsets alone

Angles roll, pitch, yaw turn about the fixed x, y, z axes: R = Rz(yaw) Ry(pitch) Rx(roll). Sources are the URDF
specification (joint, origin) and the UR driver's kinematics files. Every file is read back from its text, so
that the stated error is that of its rounded numbers.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np
from scipy.spatial.transform import Rotation

from calib.arm import Robot
from calib.array import Array
from calib.compensate import constant_slots, joint_origins, poses_with
from calib.errors import DataError
from calib.robot_file import chain_of, urdf_of
from calib.text import parse_xml
from calib.units import DEG
from service.exports.frames import FRAME_FORMATS
from service.exports.offsets import OFFSET_FORMATS
from service.exports.request import ExportRequest, Format, for_maker
from service.exports.ur_calibration import UR_CALIBRATION
from service.programs.frames import wpr

_UR_LINKS = ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")
# A URDF must give both, and to planners zero means that the joint cannot move.
_NO_LIMITS = 'effort="1000" velocity="1"'
_PLACEHOLDERS = "Effort (N.m) and velocity (rad/s) are placeholders above zero: put the maker's limits there."
_SIX = ("x", "y", "z", "rx", "ry", "rz")
_METRE = 1000.0


def _dh_slots(robot: Robot) -> tuple[str, ...]:
    kinds = ("alpha", "beta", "a", "theta", "d")
    return (
        *(f"base.{axis}" for axis in _SIX),
        *(f"{kind}{k}" for k in range(1, robot.joints + 1) for kind in kinds),
    )


def _theta_slots(robot: Robot) -> tuple[str, ...]:
    return tuple(f"theta{k}" for k in range(1, robot.joints + 1))


def _ur_slots(robot: Robot) -> tuple[str, ...]:
    behind = {f"{kind}{robot.joints}" for kind in ("alpha", "beta", "a")}
    return tuple(s for s in constant_slots(robot) if s not in behind and not s.startswith("tool."))


_refuse_others = for_maker("universal robots", "UR")


def _ur_yaml(export: ExportRequest) -> str:
    robot = export.robot
    _refuse_others(robot)
    if export.hash is None or not export.hash.startswith("calib_"):
        raise DataError(
            "the robot's own hash is missing: its driver would complain at every start.",
            do="Give it as --hash calib_..., from the robot's factory calibration file.",
            key="--hash",
        )
    origins, _ = joint_origins(robot, export.carried.values)
    lines = [f"# {line}" for line in export.about]
    lines.append("kinematics:")
    for name, origin in zip(_UR_LINKS, origins, strict=True):
        lines.append(f"  {name}:")
        names = ("x", "y", "z", "roll", "pitch", "yaw")
        lines += [f"    {key}: {value:.12g}" for key, value in zip(names, _xyz_rpy(origin), strict=True)]
    lines.append(f"  hash: {export.hash}")
    return "\n".join(lines) + "\n"


def _ur_yaml_read(text: str, export: ExportRequest) -> Array:
    numbers = np.array(re.findall(r"^    \w+: (\S+)$", text, re.MULTILINE), dtype=float).reshape(6, 6)
    reached = np.eye(4)
    for (*place, roll, pitch, yaw), angles in zip(numbers, export.carried.joints.T, strict=True):
        origin = np.eye(4)
        origin[:3, :3] = Rotation.from_euler("xyz", [roll, pitch, yaw]).as_matrix()
        origin[:3, 3] = _METRE * np.array(place)
        turn = np.tile(np.eye(4), (len(angles), 1, 1))
        turn[:, :3, :3] = Rotation.from_euler("z", angles[:, None]).as_matrix()
        reached = reached @ origin @ turn
    # Behind the last joint this format has nothing: its reader puts the nominal flange there
    return reached @ joint_origins(export.robot, {})[1]


def _urdf(export: ExportRequest) -> str:
    robot = export.robot
    origins, tip = joint_origins(robot, export.carried.values)
    lower, upper = _model_limits(robot, export.coupling)
    lines = ['<?xml version="1.0"?>', "<!--"]
    lines += [f"  {line.replace('--', '- -')}" for line in (*export.about, _PLACEHOLDERS)]
    lines += ["-->", f"<robot name={quoteattr(robot.name)}>", '  <link name="base_link"/>']
    parent = "base_link"
    for k, origin in enumerate(origins, start=1):
        lines += [
            f'  <link name="link_{k}"/>',
            f'  <joint name="joint_{k}" type="revolute">',
            f'    <parent link="{parent}"/>',
            f'    <child link="link_{k}"/>',
            _origin(origin),
            '    <axis xyz="0 0 1"/>',
            f'    <limit lower="{lower[k - 1]:.9g}" upper="{upper[k - 1]:.9g}" {_NO_LIMITS}/>',
            "  </joint>",
        ]
        parent = f"link_{k}"
    lines += [
        '  <link name="flange"/>',
        '  <joint name="joint_flange" type="fixed">',
        f'    <parent link="{parent}"/>',
        '    <child link="flange"/>',
        _origin(tip),
        "  </joint>",
        "</robot>",
    ]
    return "\n".join(lines) + "\n"


def _urdf_read(text: str, export: ExportRequest) -> Array:
    return chain_of(urdf_of(parse_xml(text, "URDF"), Path("URDF"))).forward(export.carried.joints)


def _origin(pose: Array) -> str:
    x, y, z, roll, pitch, yaw = (f"{value:.12g}" for value in _xyz_rpy(pose))
    return f'    <origin xyz="{x} {y} {z}" rpy="{roll} {pitch} {yaw}"/>'


def _xyz_rpy(pose: Array) -> list[float]:
    """Return the attributes of an `origin`, in m and rad."""
    angles = [math.radians(angle) for angle in wpr(pose, [0.0, 0.0, 0.0])]
    return [value + 0.0 for value in (*(pose[:3, 3] / _METRE), *angles)]


def _model_limits(robot: Robot, coupling: str) -> tuple[Array, Array]:
    """Return ranges of the model's joints that hold all that the controller's may take."""
    lower, upper = np.array(robot.lower), np.array(robot.upper)
    if coupling == "none":
        return lower, upper
    matrix = np.array(robot.joint_matrices[coupling].matrix)
    offset = np.array(robot.joint_matrices[coupling].offset)
    ends = matrix[:, :, None] * np.stack([lower, upper], axis=1)[None]
    return offset + ends.min(axis=2).sum(axis=1), offset + ends.max(axis=2).sum(axis=1)


def _dh_rows(export: ExportRequest) -> tuple[list[list[float]], list[float]]:
    """alpha, beta, a, theta, d of every link, deg and mm; x, y, z, rx, ry, rz of the base."""
    robot, values = export.robot, export.carried.values
    links = []
    for k in range(1, robot.joints + 1):
        nominal = (robot.alpha[k - 1], 0.0, robot.a[k - 1], robot.theta[k - 1], robot.d[k - 1])
        kinds = ("alpha", "beta", "a", "theta", "d")
        whole = [n + values.get(f"{kind}{k}", 0.0) for kind, n in zip(kinds, nominal, strict=True)]
        links.append([w / (1.0 if kind in "ad" else DEG) for kind, w in zip(kinds, whole, strict=True)])
    base = [values.get(f"base.{axis}", 0.0) / (DEG if axis[0] == "r" else 1.0) for axis in _SIX]
    return links, base


def _convention(robot: Robot) -> str:
    product = {
        "mdh": "Rx(alpha) Ry(beta) Tx(a) Rz(theta + q) Tz(d)",
        "dh": "Rz(theta + q) Tz(d) Tx(a) Rx(alpha) Ry(beta)",
    }[robot.convention]
    d_1 = "T(x, y, z) Tz(d of link 1)" if robot.base == "thesis" else "T(x, y, z)"
    return f"{product}; base: {d_1} Rx(rx) Ry(ry) Rz(rz), before link 1" + (
        " without its d" if robot.base == "thesis" else ""
    )


def _dh_csv(export: ExportRequest) -> str:
    links, base = _dh_rows(export)
    blank = ",,,,,"
    lines = ["frame,alpha_deg,beta_deg,a_mm,theta_deg,d_mm,x_mm,y_mm,z_mm,rx_deg,ry_deg,rz_deg,convention"]
    lines.append(f"base{blank}," + ",".join(f"{v:.9g}" for v in base) + f',"{_convention(export.robot)}"')
    for k, row in enumerate(links, start=1):
        lines.append(f"link {k}," + ",".join(f"{v:.9g}" for v in row) + f",{blank},{export.robot.convention}")
    return _table(lines, export)


def _dh_csv_read(text: str, export: ExportRequest) -> Array:
    base, *links = [row.split(",") for row in text.splitlines()[1:]]
    return _dh_poses([row[1:6] for row in links], base[6:12], export)


def _dh_markdown_read(text: str, export: ExportRequest) -> Array:
    rows = [line.split("|")[1:-1] for line in text.splitlines() if re.match(r"\| -?\d", line)]
    return _dh_poses([row[1:] for row in rows[:-1]], rows[-1], export)


def _dh_poses(links: Sequence[Sequence[str]], base: Sequence[str], export: ExportRequest) -> Array:
    """Return the poses (n, 4, 4) of the flange with the numbers of `_dh_rows`."""
    robot = export.robot
    changes = {
        f"base.{axis}": float(v) * (DEG if axis[0] == "r" else 1.0)
        for axis, v in zip(_SIX, base, strict=True)
    }
    for k, row in enumerate(links):
        alpha, beta, a, theta, d = map(float, row)
        changes |= {
            f"alpha{k + 1}": alpha * DEG - robot.alpha[k],
            f"beta{k + 1}": beta * DEG,
            f"a{k + 1}": a - robot.a[k],
            f"theta{k + 1}": theta * DEG - robot.theta[k],
            f"d{k + 1}": d - robot.d[k],
        }
    return poses_with(robot, export.carried.joints, changes)


def _dh_markdown(export: ExportRequest) -> str:
    links, base = _dh_rows(export)
    lines = [f"# {export.robot.name}: DH parameters", "", *(f"{line}  " for line in export.about), ""]
    lines += [f"Convention: {_convention(export.robot)}. q: the joint angle of the model.", ""]
    lines += ["| link | alpha deg | beta deg | a mm | theta deg | d mm |", "|---|---|---|---|---|---|"]
    lines += [
        f"| {k} | " + " | ".join(f"{v:.6f}" for v in row) + " |" for k, row in enumerate(links, start=1)
    ]
    lines += ["", "| base x mm | y mm | z mm | rx deg | ry deg | rz deg |", "|---|---|---|---|---|---|"]
    lines.append("| " + " | ".join(f"{v:.6f}" for v in base) + " |")
    return "\n".join(lines) + "\n"


def _mastering(export: ExportRequest) -> str:
    robot = export.robot
    offsets = np.array([export.carried.values.get(slot, 0.0) for slot in _theta_slots(robot)])
    # The offset of the joint matrix is no error: only its turns carry over.
    zero = robot.controller_angles(np.zeros(robot.joints), export.coupling)
    counted = robot.controller_angles(offsets, export.coupling) - zero
    lines = ["joint,offset_deg,meaning"]
    lines += [
        f'{k},{value / DEG + 0.0:.6f},"to be added to the angle that the controller counts"'
        for k, value in enumerate(counted, start=1)
    ]
    return _table(lines, export)


def _mastering_read(text: str, export: ExportRequest) -> Array:
    counted = np.array([[float(row.split(",")[1]) for row in text.splitlines()[1:]]]) * DEG
    robot, coupling = export.robot, export.coupling
    offsets = robot.model_angles(counted, coupling) - robot.model_angles(np.zeros_like(counted), coupling)
    return poses_with(
        robot, export.carried.joints, dict(zip(_theta_slots(robot), map(float, offsets[0]), strict=True))
    )


def _table(lines: Sequence[str], export: ExportRequest) -> str:
    heading, *rows = lines
    if export.simulated:
        heading, rows = f"{heading},simulated", [f"{row},yes" for row in rows]
    return "\n".join([heading, *rows]) + "\n"


FORMATS: Mapping[str, Format] = {
    "ur-yaml": Format(
        _ur_slots, _ur_yaml, _ur_yaml_read, "the joint origins up to the last joint", _refuse_others
    ),
    "urdf": Format(constant_slots, _urdf, _urdf_read, "all frames between base and flange"),
    "dh-csv": Format(_dh_slots, _dh_csv, _dh_csv_read, "DH numbers, beta and the pose of the base"),
    "dh-md": Format(_dh_slots, _dh_markdown, _dh_markdown_read, "DH numbers, beta and the pose of the base"),
    "mastering": Format(_theta_slots, _mastering, _mastering_read, "constant joint offsets"),
    **FRAME_FORMATS,
    **OFFSET_FORMATS,
    "ur-calibration": UR_CALIBRATION,
}
