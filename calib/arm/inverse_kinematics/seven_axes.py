"""Seven axes with shoulder and wrist in a point each (iiwa), in closed form.

Axes 1, 2, 3 meet in s, axes 5, 6, 7 in w; axis 4 is the elbow. The arm can turn about the line from s to
w without moving its flange. Of these postures the one is taken whose elbow lies in the same half-plane,
seen from that line, as at the seed, which is the posture that was taught. The angles follow in this
order:

    elbow      |w - s| gives theta_4, up and down
    shoulder   the rotation of axes 1 to 3 takes w - s and the half-plane of the elbow to where they belong: front, back
    wrist      the rotation that is left: noflip and flip

Source: Shimizu et al. 2008, with the posture of the seed in place of a reference plane.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.arm.inverse_kinematics.solutions import BRANCHES, BranchResult, Mask, Solutions, Vector
from calib.arm.inverse_kinematics.turns import FRONT, UP, axes_of_turns, bent, three_turns, tilt_of
from calib.arm.inverse_kinematics.zero_pose import MEETING_MM, ZeroPose, meeting, square, turns_about
from calib.array import Array

_NOFLIP = np.array([1.0, -1.0]).reshape(1, 1, 2, 1)
_IN_LINE = 1e-12  # of the arm's length


@dataclass(frozen=True)
class SevenAxes:
    """Zero pose of an arm of seven axes; vectors (3,), mm, in the base frame.

    Attributes
    ----------
    shoulder, wrist : array of shape (3,)
        The points s and w.
    to_elbow, from_elbow : array of shape (3,)
        Vectors from s to axis 4 and from axis 4 to w, both square to axis 4.
    bend : float
        Angle between the two about axis 4, rad.
    """

    zero: ZeroPose
    shoulder: Array
    wrist: Array
    to_elbow: Array
    from_elbow: Array
    bend: float

    kind = "in closed form, seven axes; the elbow stays"
    branches = BRANCHES

    @classmethod
    def of(cls, zero: ZeroPose) -> SevenAxes:
        """Find the structure of an arm from its zero pose.

        Raises
        ------
        DataError
            The arm has another structure; the message states which condition fails.
        """
        if zero.joints != 7 or not all(zero.turns):
            raise zero.refused(f"it has {zero.joints} joints, of which {sum(zero.turns)} turn, not 7")
        shoulder, wrist = (_centre(zero, first) for first in (0, 4))
        axis, point = zero.axes[3], zero.points[3]
        to_elbow = point - shoulder - ((point - shoulder) @ axis) * axis
        from_elbow = wrist - point - ((wrist - point) @ axis) * axis
        if min(np.linalg.norm(to_elbow), np.linalg.norm(from_elbow)) <= MEETING_MM:
            raise zero.refused("axis 4 passes through the shoulder or the wrist")
        bend = np.arctan2(np.cross(to_elbow, from_elbow) @ axis, to_elbow @ from_elbow)
        return cls(zero, shoulder, wrist, to_elbow, from_elbow, float(bend))

    def solve(self, poses: Array, seed: Array) -> Solutions:
        """Solve all eight branches of flange poses (n, 4, 4), base frame, mm.

        `seed` (n, 7), rad, determines the half-plane of the elbow.
        """
        zero = self.zero
        turned = poses[:, :3, :3] @ zero.flange[:3, :3].T
        reach = poses[:, :3, 3] + turned @ (self.wrist - zero.flange[:3, 3]) - self.shoulder
        theta_4, far, stretched = self._elbow(np.linalg.norm(reach, axis=1))
        # From s to w with axes 1 to 3 at zero, (up, n, 3).
        fore = turns_about(zero.axes[3], theta_4)
        straight = self._point_on_axis_4() + fore @ (self.wrist - zero.points[3])
        elbow = _turned_by(zero, seed) @ self.to_elbow
        at_zero = _frame(straight, self.to_elbow, zero.axes[3])
        shoulder = _frame(reach, elbow, zero.axes[0])[None] @ at_zero.swapaxes(-1, -2)
        wrist = fore.swapaxes(-1, -2) @ shoulder.swapaxes(-1, -2) @ turned
        free = seed.T
        first, above = self._three(0, shoulder, FRONT, free[0])
        last, in_line = self._three(4, wrist, _NOFLIP, free[4])
        joints = (*first, theta_4[None, :, None], *last)
        states = (
            (BranchResult.WRIST, in_line),
            (BranchResult.SHOULDER, above),
            (BranchResult.ELBOW, stretched[None, :, None]),
            (BranchResult.TOO_FAR, far[None, :, None]),
        )
        return Solutions.of(self.branches, joints, states, zero.turns, len(poses))

    def _point_on_axis_4(self) -> Array:
        return self.zero.points[3] - self.shoulder

    def _elbow(self, distance: Array) -> tuple[Array, Mask, Mask]:
        """Compute theta_4, shape (up, n), from the distance between s and w.

        Also returns whether s and w cannot be that far apart, and whether the arm is in line, both (up, n).
        """
        axis = self.zero.axes[3]
        along = (self.wrist - self.shoulder) @ axis
        planar = np.sqrt(np.maximum(distance**2 - along**2, 0.0))
        upper, fore = float(np.linalg.norm(self.to_elbow)), float(np.linalg.norm(self.from_elbow))
        between, _, far, stretched = bent((planar, np.zeros_like(planar)), upper, fore, UP)
        shape = (1, 2, 1, len(distance))
        angle = np.broadcast_to(between - self.bend, shape)[0, :, 0]
        return angle, np.broadcast_to(far, shape)[0, :, 0], np.broadcast_to(stretched, shape)[0, :, 0]

    def _three(self, first: int, rotation: Array, sign: Array, free: Array) -> tuple[tuple[Array, ...], Mask]:
        """Compute the angles of three axes that make a rotation (up, n, 3, 3).

        Also returns whether it is singular.
        """
        begin, middle, last = self.zero.axes[first : first + 3]
        rows = axes_of_turns(begin, middle)
        one, two, three, singular = three_turns(
            rows, tilt_of(rows, last), _spread(rotation @ last), _spread(rotation @ middle), sign, free
        )
        return (one, two, three), singular


def _centre(zero: ZeroPose, first: int) -> Array:
    """Find the point in which three axes meet, (3,) mm.

    Raises
    ------
    DataError
        The axes do not meet, or are not square to each other.
    """
    for k in (first, first + 1):
        if not square(zero.axes[k], zero.axes[k + 1]):
            raise zero.refused(f"axes {k + 1} and {k + 2} are not square")
    at, gap = meeting(zero.points[first + 1], zero.axes[first + 1], zero.points[first], zero.axes[first])
    if gap > MEETING_MM:
        raise zero.refused(f"axes {first + 1} and {first + 2} pass each other at {gap:.6g} mm")
    off = at - zero.points[first + 2]
    axis = zero.axes[first + 2]
    gap = float(np.linalg.norm(off - (off @ axis) * axis))
    if gap > MEETING_MM:
        raise zero.refused(f"axis {first + 3} passes the point of the two before it at {gap:.6g} mm")
    return at


def _turned_by(zero: ZeroPose, joints: Array) -> Array:
    """Return the rotation by the first three axes at joints (n, N), rad, shape (n, 3, 3)."""
    first, second, third = (turns_about(zero.axes[k], joints[:, k]) for k in range(3))
    return first @ second @ third


def _frame(along: Array, towards: Array, otherwise: Array) -> Array:
    """Build frames from two vectors (..., 3), axes in columns, shape (..., 3, 3).

    The first axis points along `along`, the second is square to it towards `towards`, and the third is
    square to both. `otherwise` (3,) replaces `towards` if that is in line with `along`.
    """
    x = _unit(along)
    towards = np.broadcast_to(towards, x.shape)
    y = towards - np.sum(towards * x, axis=-1, keepdims=True) * x
    small = np.linalg.norm(y, axis=-1, keepdims=True) < _IN_LINE * np.linalg.norm(
        towards, axis=-1, keepdims=True
    )
    # `otherwise` may be in line as well: then one of two cannot be.
    spare = np.cross(x, otherwise)
    spare = np.where(
        np.linalg.norm(spare, axis=-1, keepdims=True) < 1e-6, np.cross(x, otherwise[[2, 0, 1]]), spare
    )
    y = _unit(np.where(small, spare, y))
    # Again: near a stretched arm the first difference is little but rounding.
    y = _unit(y - np.sum(y * x, axis=-1, keepdims=True) * x)
    return np.stack([x, y, np.cross(x, y)], axis=-1)


def _unit(vectors: Array) -> Array:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-300)


def _spread(vectors: Array) -> Vector:
    """Return the components of (up, n, 3) vectors, each (1, up, 1, n)."""
    x, y, z = (np.ascontiguousarray(vectors[..., i])[None, :, None] for i in range(3))
    return x, y, z
