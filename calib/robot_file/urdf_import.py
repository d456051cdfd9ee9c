"""Import of robot files from URDF, exact up to a constant frame at each end of the chain.

Both frames, before the first joint and after the last, are reported.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from calib.arm import BasePoses, Chain, Load, Robot, forward, nominal_values, propagate
from calib.arm.robot import FARTHEST_MM
from calib.array import Array
from calib.errors import DataError
from calib.robot_file.draft import Draft, DraftLink, written_robot
from calib.robot_file.modified_dh import PARALLEL, DhChain, modified_dh
from calib.robot_file.serial_chain import SerialChain, chain_of
from calib.robot_file.urdf import read_urdf
from calib.units import DEG

POSTURES = 200
AGREES_MM = 1e-5
"""Numbers of a robot file have nine decimals: 1e-9 deg over a reach of 100 m is 2e-6 mm."""
_NOTHING = 1e-7


@dataclass(frozen=True)
class Imported:
    """A robot file that was created from another description.

    Attributes
    ----------
    base, tool : array of shape (4, 4)
        Constant frames of the description before and behind the chain of the file, mm.
    off_mm, off_rad : float
        Largest difference of the two chains in `POSTURES` random postures.
    remarks : tuple of str
        Facts that the user must know.
    """

    draft: Draft
    robot: Robot
    base: Array
    tool: Array
    off_mm: float
    off_rad: float
    remarks: tuple[str, ...]


def import_urdf(
    path: Path,
    *,
    base: str | None = None,
    tip: str | None = None,
    name: str | None = None,
    maker: str = "unknown",
) -> Imported:
    """Import the robot file of a URDF between two links.

    Parameters
    ----------
    path : Path
        The URDF.
    base, tip : str, optional
        The two links. Default: the link that carries all, and the only end that moves.
    name, maker : str, optional
        Name and maker of the robot.

    Raises
    ------
    DataError
        A joint cannot be part of a robot file; the error names it.
    """
    urdf = read_urdf(path)
    chain = chain_of(urdf, base, tip)
    numbers = modified_dh(chain)
    _refuse_far_normals(chain, numbers, path)
    remarks = (*chain.remarks, *_frames(chain, numbers))
    matrix = chain.coupled()
    draft = Draft(
        name=name or urdf.name,
        maker=maker,
        convention="mdh",
        source=f"URDF {path.name}, from link {chain.base} to {chain.end}",
        links=_links(chain, numbers),
        matrices={} if matrix is None else {"mimic": (matrix, chain.offsets())},
        remarks=("Written by 'truepose robot import'. docs/robot-file.md explains every key.", *remarks),
    )
    robot = written_robot(draft)
    if loads := _loads(chain, numbers, robot):
        draft = replace(draft, loads=loads)
        robot = written_robot(draft)
    off_mm, off_rad = _difference(chain, numbers, robot)
    if off_mm > AGREES_MM:
        raise DataError(
            f"the chain of the robot file misses that of the URDF by {off_mm:.3g} mm.",
            do="Axes that are parallel but for a rounding have normals far away: write their rpy with more digits.",
            file=path,
        )
    return Imported(draft, robot, numbers.base, numbers.tool, off_mm, off_rad, remarks)


def _refuse_far_normals(chain: SerialChain, numbers: DhChain, path: Path) -> None:
    """Refuse axes that are all but parallel.

    Their common normal, on which DH numbers depend, is far away.

    Raises
    ------
    DataError
        The common normal is too far away.
    """
    if np.abs([numbers.a, numbers.d]).max() <= FARTHEST_MM:
        return
    angle = np.abs(np.sin(numbers.alpha[1:]))
    k = 1 + int(np.argmin(np.where(angle > PARALLEL, angle, np.inf)))
    raise DataError(
        f"the axes of '{chain.names[k - 1]}' and '{chain.names[k]}' are parallel but for {angle[k - 1] / DEG:.2g} deg: "
        f"the common normal, by which a robot file goes, lies beyond {FARTHEST_MM / 1000.0:.0f} m.",
        do="If they are meant to be parallel, write so: rpy with all its digits, of the maker's drawing. The errors "
        "of one calibrated arm belong into a model: truepose identify.",
        file=path,
    )


def _links(chain: SerialChain, numbers: DhChain) -> tuple[DraftLink, ...]:
    out = []
    for k, name in enumerate(chain.names):
        unit = 1.0 if chain.slides[k] else DEG
        low, high = np.round(chain.limits[k] / unit, 4)  # 165 deg were 2.8798 rad
        out.append(
            DraftLink(
                float(numbers.alpha[k] / DEG),
                float(numbers.a[k]),
                float(numbers.theta[k] / DEG),
                float(numbers.d[k]),
                float(low),
                float(high),
                chain.slides[k],
                name,
            )
        )
    return tuple(out)


def _loads(chain: SerialChain, numbers: DhChain, robot: Robot) -> tuple[Load, ...]:
    """Convert the masses of the URDF's links to loads of the robot file, at the zero pose.

    Each is in the frame of the robot file's link.
    """
    zero = np.zeros((1, len(chain.names)))
    frames = propagate(Chain.of(robot), nominal_values(robot, zero), BasePoses()).link_frames
    at, joint_frames = np.eye(4), []
    for origin in chain.origins:
        at = at @ origin
        joint_frames.append(at)
    out = []
    for link, mass, centre in chain.masses:
        x, y, z, p = (np.broadcast_to(v, (3, 1))[:, 0] for v in frames[link - 1])
        frame = np.eye(4)
        frame[:3, :3], frame[:3, 3] = np.stack([x, y, z], axis=1), p
        here = np.linalg.inv(numbers.base @ frame) @ joint_frames[link - 1] @ np.append(centre, 1.0)
        out.append(Load(link, mass, (float(here[0]), float(here[1]), float(here[2]))))
    return tuple(out)


def _difference(chain: SerialChain, numbers: DhChain, robot: Robot) -> tuple[float, float]:
    """Largest distance, mm, and turn, rad, of the tip between both chains in random postures."""
    rng = np.random.default_rng(1)
    joints = rng.uniform(chain.limits[:, 0], chain.limits[:, 1], (POSTURES, len(chain.names)))
    ours = numbers.base @ forward(robot, joints) @ numbers.tool
    theirs = chain.forward(joints)
    off = np.linalg.norm(ours[:, :3, 3] - theirs[:, :3, 3], axis=1)
    turn = Rotation.from_matrix(ours[:, :3, :3]).inv() * Rotation.from_matrix(theirs[:, :3, :3])
    return float(off.max()), float(turn.magnitude().max())


def _frames(chain: SerialChain, numbers: DhChain) -> Iterator[str]:
    """Yield sentences on the constant frames that differ from the URDF's."""
    if not _is_nothing(numbers.base):
        yield f"The base frame of this file stands in the URDF's '{chain.base}' at {in_words(numbers.base)}."
    if not _is_nothing(numbers.tool):
        yield (
            f"The URDF's '{chain.end}' stands in the flange frame of this file at {in_words(numbers.tool)}: "
            "tool targets are given in the flange frame of this file."
        )


def _is_nothing(pose: Array) -> bool:
    return float(np.abs(pose - np.eye(4)).max()) < _NOTHING


def in_words(pose: Array) -> str:
    """Write a pose (4, 4), mm, as text: "xyz = [..] mm, rpy = [..] deg".

    Roll, pitch and yaw are about fixed axes.
    """
    place = ", ".join(f"{x:.6g}" for x in np.round(pose[:3, 3], 6) + 0.0)
    turn = ", ".join(f"{x:.6g}" for x in np.round(_angles(pose[:3, :3]), 6) + 0.0)
    return f"xyz = [{place}] mm, rpy = [{turn}] deg"


def _angles(rotation: Array) -> Array:
    """Return roll, pitch and yaw, deg, shape (3,). At a pitch of 90 deg the roll is 0."""
    pitch = np.arctan2(-rotation[2, 0], np.hypot(rotation[0, 0], rotation[1, 0]))
    if np.hypot(rotation[0, 0], rotation[1, 0]) < 1e-9:
        return np.array([0.0, pitch, np.arctan2(-rotation[0, 1], rotation[1, 1])]) / DEG
    roll = np.arctan2(rotation[2, 1], rotation[2, 2])
    return np.array([roll, pitch, np.arctan2(rotation[1, 0], rotation[0, 0])]) / DEG
