"""Names of the branches of an arm, solutions of poses in them, and a numerical inverse.

front / back, up / down and noflip / flip are the signs of quantities that vanish if the shoulder, the
elbow or the wrist is singular. `calib.validation.judge` finds them in the same way for given joints of
six axes:

    front   the wrist centre lies on the side of axis 1 on which it lies at the zero pose
    up      the forearm turns from the upper arm in the positive sense of axis 2
    noflip  axis 6 turns from axis 4 in the positive sense of axis 5

An arm without a wrist that bends (palletizers, five axes) has no third word. For seven axes, front means
that axis 3 turns from axis 1 in the positive sense of axis 2. In the same way, up refers to axes 3, 5
and 4, and noflip to axes 5, 7 and 6. A SCARA is `right` if its forearm turns from its upper arm
anticlockwise, seen from above, as a person's right arm does, otherwise `left`.

Vectors are three arrays of components, so that every product runs over all branches and poses at once.

`nominal_inverse` inverts the nominal robot near its present pose by Newton's method on the exact chain,
batched:

    J(q) dq = twist from FK(q) to the wanted pose,   q <- q + dq

It starts at the current joints, so that the branch is kept. It works within the freedoms of the arm
(`calib.arm.freedoms`) and leaves the errors that the arm cannot correct. Rotations are weighed with
`LEVER_MM`, which makes the columns of J comparable.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from calib.arm.freedoms import Freedoms
from calib.arm.kinematics import LEVER_MM, joint_scale, nominal_jacobian, pose_difference
from calib.arm.robot import Robot
from calib.array import Array

BRANCHES = tuple(
    f"{f}/{u}/{w}" for f in ("front", "back") for u in ("up", "down") for w in ("noflip", "flip")
)

WITHOUT_WRIST = tuple(f"{f}/{u}" for f in ("front", "back") for u in ("up", "down"))
SINGULAR_SINE = 1e-6
"""Sine of the angle, or reach over the arm's length, below which a pose is reported as singular."""

Mask = NDArray[np.bool_]
Vector = tuple[Array, Array, Array]
ITERATIONS = 12
_REACHED = 1e-13  # rad: the step that no longer changes anything


class BranchResult(StrEnum):
    """The outcome for a pose in one branch."""

    YES = "reached"
    WRIST = "wrist singular: only the sum or difference of two joints is determined"
    ELBOW = "elbow singular: the arm is stretched or folded"
    SHOULDER = "shoulder singular: the wrist centre, or of seven axes the upper arm, lies above axis 1"
    TOO_NEAR = "out of reach: too near to axis 1"
    TOO_FAR = "out of reach of upper arm and forearm"
    TILTED = "out of reach: this arm cannot tilt its tool so"


REACHED = tuple(BranchResult)

UNREACHABLE = (
    REACHED.index(BranchResult.TOO_NEAR),
    REACHED.index(BranchResult.TOO_FAR),
    REACHED.index(BranchResult.TILTED),
)


@dataclass(frozen=True)
class Solutions:
    """Solutions of n poses in B branches.

    In a singular pose the joints are one of the infinitely many solutions that reach it.

    Attributes
    ----------
    joints : array of shape (n, B, N)
        Joints of the model, angles in rad from -pi to pi; NaN if a branch does not reach the pose.
    state : array of int, shape (n, B)
        Index into `REACHED`.
    branches : tuple of str
        Names of the B branches.
    """

    joints: Array
    state: NDArray[np.int8]
    branches: tuple[str, ...] = BRANCHES

    @classmethod
    def of(
        cls,
        branches: tuple[str, ...],
        joints: Sequence[Array],
        states: Sequence[tuple[BranchResult, NDArray[np.bool_]]],
        turns: tuple[bool, ...],
        n: int,
    ) -> Solutions:
        """Build solutions from the angles of N joints and masks of states.

        All of them broadcast to (branch, ..., n). A later state replaces an earlier one, so the most
        important comes last.
        """
        shape = np.broadcast_shapes(
            *(np.shape(joint) for joint in joints), *(mask.shape for _, mask in states)
        )
        found = np.stack(
            [np.broadcast_to(joint, shape).reshape(len(branches), n).T for joint in joints], axis=2
        )
        state = np.zeros(shape, dtype=np.int8)
        for what, mask in states:
            state[np.broadcast_to(mask, shape)] = REACHED.index(what)
        solutions = cls(wrapped(found, turns), state.reshape(len(branches), n).T.copy(), branches)
        solutions.joints[~solutions.valid] = np.nan
        return solutions

    @property
    def valid(self) -> NDArray[np.bool_]:
        """Whether the joints reach the pose, shape (n, B)."""
        return ~np.isin(self.state, UNREACHABLE)

    def all_of(self, row: int) -> tuple[BranchResult, ...]:
        """Return the result for one pose in all branches."""
        return tuple(REACHED[state] for state in self.state[row])


def columns(vectors: Array) -> Vector:
    """Return the components of (n, 3) vectors, each (n,)."""
    x, y, z = np.ascontiguousarray(vectors.T)
    return x, y, z


def turn_back(v: Vector, angle: Array, plane: tuple[int, int]) -> Vector:
    """Rotate v by -angle; a positive angle leads the first axis of the plane to the second."""
    i, j = plane
    c, s = np.cos(angle), np.sin(angle)
    out = list(np.broadcast_arrays(*v, angle)[:3])
    out[i], out[j] = c * v[i] + s * v[j], c * v[j] - s * v[i]
    return out[0], out[1], out[2]


def in_axes(rotation: Array, v: Vector) -> Vector:
    """Return the components of v in other axes, the rows of `rotation`."""
    x, y, z = (row[0] * v[0] + row[1] * v[1] + row[2] * v[2] for row in rotation)
    return x, y, z


def wrapped(joints: Array, turns: tuple[bool, ...]) -> Array:
    """Wrap the angles of joints (..., N) to the range from -pi to pi."""
    return joints - 2.0 * np.pi * np.round(np.where(turns, joints, 0.0) / (2.0 * np.pi))


def nominal_inverse(
    robot: Robot, poses: Array, seed: Array, tool: Array, freedoms: Freedoms | None = None
) -> Array:
    """Solve the joints that bring the nominal tool point to poses, near a seed.

    If a pose is out of reach, the result is the nearest that Newton's method found; the caller checks.

    Parameters
    ----------
    poses : array of shape (n, 4, 4)
        Target poses of the tool point, mm.
    seed : array of shape (n, N)
        Model joints to start from, rad or mm.
    tool : array of shape (3,)
        Tool point in the flange frame, mm.
    freedoms : Freedoms, optional
        Freedoms of the arm. Default: all six, with every joint free.

    Returns
    -------
    array of shape (n, N)
        Model joints, rad or mm.
    """
    arm = Freedoms(np.diag(joint_scale(robot)), 6, places=True, turns=3) if freedoms is None else freedoms
    joints, scale = seed.copy(), joint_scale(robot)
    for _ in range(ITERATIONS):
        reached, jacobian = nominal_jacobian(robot, joints, tool)
        error = pose_difference(poses, reached)
        error[:, 3:] *= LEVER_MM
        step, _ = arm.step(jacobian, error)
        joints = joints + step
        if np.max(np.abs(step / scale), initial=0.0) < _REACHED:
            break
    return joints
