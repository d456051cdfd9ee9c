"""Table representation of a model as constants, and the error without the rest.

A DH table, a URDF or joint offsets hold numbers for the slots of the chain. At stated conditions some
effects are such numbers: geometry, joint offsets, thermal growth at the stated temperature, half the
backlash at the stated side. Effects that follow the joints are left out (compliance, gear errors,
encoder scale).

The kind of the effect does not matter. A term is carried if its regressor is the same in every pose, and
the table holds its slot. If a term is left out, the numbers are fitted again to the poses of the whole
model, so that they represent as much of it as they can.

    loss = |FK_full(q) - FK_file(q)| of the flange, over random q within the joint limits
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np

from calib.arm.kinematics import TOOL, BasePoses, Chain, nominal_values, propagate
from calib.arm.robot import Robot
from calib.array import Array
from calib.compensate.calibrated import Calibrated, poses_of
from calib.fit.statistics import ErrorStatistics, statistics_of
from calib.model.model import ModelStructure, StatedConditions

_SAMPLES = 1000
_LEVER_MM = 100.0  # a turn of the flange counts as what it moves a tool of this length
_STEPS = 4
_SEEN = 1e-3  # of the best seen direction: what is seen less stays as it is
_AXES = np.eye(3)


@dataclass(frozen=True)
class RepresentableModel:
    """Part of a model that constants of slots represent.

    Attributes
    ----------
    values : dict of str to float
        Change from nominal by slot, rad or mm.
    left_out : tuple of str
        Names of the parameters of which something is lost.
    joints : array of shape (n, N)
        Model angles, rad.
    poses : array of shape (n, 4, 4)
        Poses of the flange there by the whole model, mm.
    """

    robot: Robot
    values: dict[str, float]
    left_out: tuple[str, ...]
    joints: Array
    poses: Array

    def off(self, poses: Array) -> ErrorStatistics:
        """Compute the position errors of flange poses (n, 4, 4) at `joints`, mm."""
        found = statistics_of(np.linalg.norm(self.poses[:, :3, 3] - poses[:, :3, 3], axis=1))
        assert found is not None  # there are poses
        return found


def carried(
    model: ModelStructure,
    estimate: Array,
    stated: StatedConditions,
    slots: Collection[str],
    *,
    coupling: str = "none",
    joints: Array | None = None,
) -> RepresentableModel:
    """Compute the part of a model that the slots can carry.

    Parameters
    ----------
    model : ModelStructure
        The whole model.
    estimate : array of shape (m,)
        Internal units.
    stated : StatedConditions
        Conditions for which the constants hold.
    slots : collection of str
        Slots that the table holds.
    coupling : str, optional
        Joint matrix of the controller.
    joints : array of shape (n, N), optional
        Model angles at which the result must be close, rad. Default: random ones within the limits.

    Raises
    ------
    DataError
        A condition is missing.
    """
    robot = model.robot
    if joints is None:
        counted = np.random.default_rng(1).uniform(robot.lower, robot.upper, (_SAMPLES, robot.joints))
        joints = robot.model_angles(counted, coupling)
    calibrated = Calibrated(model, estimate, stated)
    design = calibrated.design(joints)
    values: dict[str, float] = {}
    lost: dict[str, None] = {}
    for position, slot, drive in design.terms:
        amounts = calibrated.estimate[position] * np.asarray(drive)
        if not np.any(amounts):
            continue
        if slot in slots and np.ptp(amounts) <= 1e-12 * np.max(np.abs(amounts)):
            values[slot] = values.get(slot, 0.0) + float(np.mean(amounts))
        else:
            lost[model.parameters[position].name] = None
    poses = poses_of(design.frames(calibrated.estimate, record=()), len(joints))
    if lost and slots:
        values = _projected(robot, joints, poses, {slot: values.get(slot, 0.0) for slot in slots})
    return RepresentableModel(robot, values, tuple(lost), joints, poses)


def poses_with(robot: Robot, joints: Array, changes: dict[str, float]) -> Array:
    """Compute flange poses of the nominal robot with changed slots, shape (n, 4, 4), mm.

    `joints` (n, N) are model angles.
    """
    values = changed(robot, joints, changes)
    return poses_of(propagate(Chain.of(robot), values, BasePoses(), record=()), len(joints))


def _projected(robot: Robot, joints: Array, poses: Array, start: dict[str, float]) -> dict[str, float]:
    """Fit the changes that come closest to `poses` (n, 4, 4) at `joints` (n, N).

    The fit is by least squares from `start`. Positions and turns count, a turn by `_LEVER_MM`: without
    turns, a tool would lose accuracy that the flange gains.
    """
    slots, chain = tuple(start), Chain.of(robot)
    changes = np.array([start[slot] for slot in slots])
    for _ in range(_STEPS):
        values = changed(robot, joints, dict(zip(slots, changes.tolist(), strict=True)))
        frames = propagate(chain, values, BasePoses(), record=slots)
        # Columns r of the rotation reached and w of the wanted one differ by the turn sum(r x w) / 2
        both = frames.rotation @ poses[:, :3, :3].transpose(0, 2, 1)
        turned = np.cross(frames.rotation, poses[:, :3, :3], axis=1).sum(axis=2) / 2.0
        off = np.concatenate([poses[:, :3, 3] - frames.p.T, _LEVER_MM * turned]).ravel()
        turning = (np.trace(both, axis1=1, axis2=2)[:, None, None] * np.eye(3) - both) / 2.0
        turns = np.einsum("nij,sjn->nis", turning, frames.turnings(slots), optimize=True)
        moves = frames.velocities(slots).transpose(2, 1, 0)
        slopes = np.concatenate([moves, _LEVER_MM * turns]).reshape(len(off), -1)
        scale = np.linalg.norm(slopes, axis=0)
        scale[scale == 0.0] = 1.0
        changes = changes + np.linalg.lstsq(slopes / scale, off, rcond=_SEEN)[0] / scale
    return dict(zip(slots, changes.tolist(), strict=True))


def changed(robot: Robot, joints: Array, changes: dict[str, float]) -> dict[str, Array | float]:
    """Slot values of the nominal robot at model angles (n, N), with the changes."""
    values = nominal_values(robot, joints)
    for slot, change in changes.items():
        values[slot] = values.get(slot, 0.0) + change
    return values


def constant_slots(robot: Robot) -> tuple[str, ...]:
    """List every slot from base to flange that a table of frames can hold, in order."""
    chain = Chain.of(robot)
    motions = (*chain.base, *(motion for link in chain.links for motion in link), *TOOL)
    return tuple(motion.slot for motion in motions)


def joint_origins(robot: Robot, changes: dict[str, float]) -> tuple[Array, Array]:
    """Compute the constant frames between the joints, mm.

    Returns the frames (N, 4, 4) from each joint's moving frame to where the next one turns about z, the
    first from the base. The second result is the frame (4, 4) from the last joint to the flange. The
    pose of the flange is the product of origin_k Rz(q_k) over the joints, times that last frame.
    """
    chain = Chain.of(robot)
    values = changed(robot, np.zeros((1, robot.joints)), changes)
    motions = [*chain.base, *(motion for link in chain.links for motion in link), *TOOL]
    for i, motion in enumerate(motions[:-1]):
        # Rz(theta) Tz(d) = Tz(d) Rz(theta): a joint turns about z where its d has led.
        if motion.slot.startswith("theta") and motions[i + 1].slot == motion.slot.replace("theta", "d"):
            motions[i : i + 2] = motions[i + 1], motion
    origins, here = [], np.eye(4)
    for motion in motions:
        here = here @ _motion(
            motion.axis, float(np.squeeze(values.get(motion.slot, 0.0))), turns=motion.turns
        )
        if motion.slot.startswith("theta"):
            origins.append(here)
            here = np.eye(4)
    return np.stack(origins), here


def rigid_frames(robot: Robot, changes: Mapping[str, float]) -> tuple[Array, Array]:
    """Compute what the slots of base and tool do as constant frames, (4, 4) each, mm.

    The pose of the flange with them is the product of the first, the pose without them, and the second. Other slots
    are ignored.
    """
    rest = np.zeros((1, robot.joints))
    nominal, base, tool = (
        poses_with(robot, rest, {slot: value for slot, value in changes.items() if slot.startswith(kind)})[0]
        for kind in ("nothing", "base.", "tool.")
    )
    back = np.linalg.inv(nominal)
    return base @ back, back @ tool


def _motion(axis: int, amount: float, *, turns: bool) -> Array:
    out = np.eye(4)
    if not turns:
        out[:3, 3] = amount * _AXES[axis]
        return out
    i, j = (axis + 1) % 3, (axis + 2) % 3
    c, s = np.cos(amount), np.sin(amount)
    out[i, i], out[j, j], out[i, j], out[j, i] = c, c, -s, s
    return out
