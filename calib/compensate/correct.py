"""Corrected targets: joint angles at which the real robot stands where the nominal robot would have stood.

The controller keeps its nominal model, so it is sent a false target F instead of the wanted pose T:

    F = T;   F <- F . FK_cal(IK_nom(F))^-1 . T

until the calibrated robot at IK_nom(F) stands in T. Source: Nubiola, thesis 1.5; Nubiola & Bonev 2014. For a joint
target q the wanted pose is T = FK_nom(q). FK_cal holds what belongs to the robot and to its mounting, never what
belongs to the instrument, under stated conditions (`calib.compensate.stated`).

Frames: where the world is the nominal base frame, the identified base is part of the error and is corrected; where
the base was placed by the fit (a model with placements), the world is arbitrary, and the identified base frame takes
its place: its parameters are left out on both sides.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from calib.compensate.inverse import (
    branch_sign,
    least_singular_value,
    nominal_inverse,
    pose_difference,
)
from calib.compensate.stated import (
    FLANGE,
    StatedConditions,
    conditions_at,
    nominal_poses,
    series_of,
    tool_point,
)
from calib.errors import DataError
from calib.kinematics import Array
from calib.model import Design, RobotModel
from calib.units import DEG

MOST_ITERATIONS = 16  # all of 1000 poses of the thesis's robot land within so many; 98 % after 4
LANDED_MM, LANDED_RAD = 1e-7, 1e-9
FARTHEST = (
    30.0 * DEG
)  # tenths of a degree are usual, more near a singular wrist; beyond this the branch is left
SINGULAR = 0.004
"""Least over largest singular value below which a target is refused: the wrist within some 2 deg of singular."""

CORRECTED_OWNERS = ("robot", "mounting")


class Status(StrEnum):
    """What became of one target."""

    CORRECTED = "corrected"
    SINGULAR = "singular"
    BEYOND_LIMITS = "beyond limits"
    NOT_CONVERGED = "not converged"


_ALL = tuple(Status)
REASONS = {
    Status.CORRECTED: "",
    Status.SINGULAR: "close to a singular pose, where a small correction needs a large turn of the joints",
    Status.BEYOND_LIMITS: "a joint limit lies between the target and its correction",
    Status.NOT_CONVERGED: "the iteration did not end near the target: it would change the branch, or the model is wild",
}


@dataclass(frozen=True)
class Correction:
    """Corrected targets. `joints` (n, N) rad, NaN where refused: a refused target must never be driven.

    landed (n,) mm and turned (n,) rad: how far from the wanted pose the calibrated model stands at `joints`;
    iterations (n,): how many the target took.
    """

    joints: Array
    status: tuple[Status, ...]
    landed: Array
    turned: Array
    iterations: NDArray[np.int64]

    @property
    def good(self) -> NDArray[np.bool_]:
        """(n,) targets that may be driven."""
        return np.array([s is Status.CORRECTED for s in self.status], dtype=bool)

    @property
    def reasons(self) -> tuple[str, ...]:
        """Why each target was refused, as a sentence part; empty where it was not."""
        return tuple(REASONS[s] for s in self.status)


class Calibrated:
    """The calibrated robot at stated conditions: poses (n, 4, 4) of the tool point for joints (n, N), rad."""

    def __init__(
        self, model: RobotModel, estimate: Array, stated: StatedConditions, target: str = FLANGE
    ) -> None:
        series = series_of(model, stated)
        owned = model.owned(CORRECTED_OWNERS)
        if series in model.placements:
            own = [
                e for e in model.effects if e.label.partition("[")[0] == "base" and e.group == "base model"
            ]
            owned[[i for e in own for i in model.positions(e)]] = 0.0
        self._estimate = np.where(owned > 0.0, estimate, 0.0)
        targets = {name: {FLANGE: (0.0, 0.0, 0.0), **known} for name, known in model.targets.items()}
        self._model = replace(model, targets=targets, placements={})
        self._plain = model
        self._stated = stated
        self._target = target

    def poses(self, joints: Array) -> Array:
        """Raises DataError when the model needs a condition that was not stated."""
        n = len(joints)
        design = Design(self._model, conditions_at(self._plain, joints, self._stated, self._target))
        for position, _, drive in design.terms:
            if self._estimate[position] != 0.0 and not np.all(np.isfinite(drive)):
                name = self._model.parameters[position].name
                raise DataError(
                    f"the model holds {name}, which depends on a condition that was not stated.",
                    do="State the temperature and the time for which the correction shall hold.",
                    key="conditions",
                )
        frames = design.frames(self._estimate)
        poses = np.zeros((n, 4, 4))
        poses[:, :3, :3] = frames.rotation
        poses[:, :3, 3] = np.broadcast_to(frames.p, (3, n)).T
        poses[:, 3, 3] = 1.0
        return poses


def correct(
    model: RobotModel,
    estimate: Array,
    joints: Array,
    stated: StatedConditions,
    *,
    target: str = FLANGE,
    limits: Array | None = None,
    most_iterations: int = MOST_ITERATIONS,
) -> Correction:
    """Correct joint targets (n, N), model angles, rad: `target` then lands in the pose the nominal robot would take.

    estimate: (m,) of the model, internal units. target: a tool target by name, or the flange, which carries all
    targets with it. limits: (N, 2) rad, default the robot's. Raises DataError for a condition that is missing,
    ValueError for arrays of the wrong shape, an unknown target or series.
    """
    robot = model.robot
    joints = np.asarray(joints, dtype=np.float64)
    if joints.ndim != 2 or joints.shape[1] != robot.joints:
        raise ValueError(f"joints have shape {joints.shape}; needed (n, {robot.joints})")
    if limits is None:
        limits = np.column_stack([robot.lower, robot.upper])
    if limits.shape != (robot.joints, 2):
        raise ValueError(f"limits have shape {limits.shape}; needed ({robot.joints}, 2)")
    tool = tool_point(model, series_of(model, stated), target)
    calibrated = Calibrated(model, estimate, stated, target)
    wanted = nominal_poses(model, joints, tool)

    found = joints.copy()
    landed, turned = np.full(len(joints), np.inf), np.full(len(joints), np.inf)
    iterations = np.zeros(len(joints), dtype=np.int64)
    left, memory = np.arange(len(joints)), _Memory(len(joints), robot.joints)
    for done in range(most_iterations + 1):
        stands = calibrated.poses(found[left])
        miss = pose_difference(wanted[left], stands)
        landed[left], turned[left] = (np.linalg.norm(part, axis=1) for part in (miss[:, :3], miss[:, 3:]))
        # Only rows that are still in question go on; a wild one is given up, or it would spoil the products.
        sane = np.all(np.abs(found[left] - joints[left]) < FARTHEST, axis=1)
        on = ((landed[left] > LANDED_MM) | (turned[left] > LANDED_RAD)) & sane
        left, stands = left[on], stands[on]
        if not len(left) or done == most_iterations:
            break
        iterations[left] = done + 1
        here = found[left]
        false_target = nominal_poses(model, here, tool) @ _inverse(stands) @ wanted[left]
        shifted = nominal_inverse(robot, false_target, here, tool)
        found[left] = memory.next(left, here, shifted)

    moved = np.max(np.abs(found - joints), axis=1, initial=0.0)
    beyond = np.any((found < limits[:, 0]) | (found > limits[:, 1]), axis=1)
    singular = least_singular_value(robot, joints, tool) < SINGULAR
    # The determinant changes its sign wherever a singular surface is crossed: then the branch is another one.
    moved = np.where(np.isfinite(moved), moved, np.inf)
    kept = branch_sign(robot, np.nan_to_num(found), tool) == branch_sign(robot, joints, tool)
    lost = ~(kept & (landed <= 10.0 * LANDED_MM) & (turned <= 10.0 * LANDED_RAD) & (moved < FARTHEST))
    # The weightiest reason last: it stands.
    status = np.zeros(len(joints), dtype=np.int64)
    for reason, rows in (
        (Status.BEYOND_LIMITS, beyond),
        (Status.NOT_CONVERGED, lost),
        (Status.SINGULAR, singular),
    ):
        status[rows] = _ALL.index(reason)
    found[status != _ALL.index(Status.CORRECTED)] = np.nan
    return Correction(found, tuple(_ALL[i] for i in status), landed, turned, iterations)


class _Memory:
    """Anderson's mixing: from the last steps, where they would end.

    The pose shift alone errs by a share of what is left that grows with the joints' errors; with them the fourth
    iteration reaches 1e-6 mm in 98 % of poses, without it in 70 to 95 %. The fixed point is the same.
    Source: Walker & Ni 2011.
    """

    DEPTH = 2

    def __init__(self, rows: int, joints: int) -> None:
        self._steps = np.zeros((rows, self.DEPTH, joints))
        self._shifted = np.zeros((rows, self.DEPTH, joints))
        self._known = 0

    def next(self, rows: NDArray[np.int64], here: Array, shifted: Array) -> Array:
        """(k, N) where to go on from `here` (k, N), when the pose shift leads to `shifted`."""
        step, depth = shifted - here, min(self._known, self.DEPTH)
        out = shifted
        if depth:
            changes = step[:, None] - self._steps[rows, :depth]
            # Shares g that minimise |step - sum g change|, by normal equations; a trace of damping where they
            # say the same twice.
            normal = changes @ changes.transpose(0, 2, 1)
            normal += (1e-9 * np.trace(normal, axis1=1, axis2=2) + 1e-300)[:, None, None] * np.eye(depth)
            shares = np.linalg.solve(normal, changes @ step[:, :, None])
            shares = np.clip(shares, -0.5, 0.5)
            out = shifted - np.sum(shares * (shifted[:, None] - self._shifted[rows, :depth]), axis=1)
        self._steps[rows, 1:], self._shifted[rows, 1:] = self._steps[rows, :-1], self._shifted[rows, :-1]
        self._steps[rows, 0], self._shifted[rows, 0] = step, shifted
        self._known += 1
        return out


def _inverse(poses: Array) -> Array:
    """(n, 4, 4) inverses of rigid poses."""
    out = np.zeros_like(poses)
    turned = poses[:, :3, :3].transpose(0, 2, 1)
    out[:, :3, :3] = turned
    out[:, :3, 3] = -(turned @ poses[:, :3, 3:])[:, :, 0]
    out[:, 3, 3] = 1.0
    return out
