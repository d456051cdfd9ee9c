"""Six axes whose wrist axes do not meet (Fanuc CRX, xArm): all branches by a search.

Axes 2 and 3 are parallel and axes 4 and 5 meet in c; axis 6 may pass c anywhere. For a given theta_6 the
place of c and of axis 5 are known. The point c gives theta_1 to theta_3 in up to four branches, and then axis 4
either has the angle to axis 5 that it has by construction, or it has not:

    f(theta_6) = z_4 . z_5 - (z_4 . z_5 at the zero pose)

Every zero of f over a whole turn is a solution; there are up to sixteen. The search starts where f
changes its sign, where |f| has a minimum without a change of sign, and next to the edges of reach.
Newton's method on the six equations ends it. Source: the equation in one unknown of Abbes & Poisson 2024
(CRX), here over theta_6.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.arm.inverse_kinematics.solutions import (
    BRANCHES,
    REACHED,
    SINGULAR_SINE,
    BranchResult,
    Mask,
    Solutions,
    Vector,
    turn_back,
    wrapped,
)
from calib.arm.inverse_kinematics.turns import TwoLinks
from calib.arm.inverse_kinematics.zero_pose import (
    MEETING_MM,
    ZeroPose,
    meeting,
    parallel,
    square,
    turns_about,
)
from calib.array import Array

STEPS = 240  # of theta_6 in a turn
BLOCK = 200  # poses at once: the search holds every step of every branch in memory
_FLAT = 0.05  # |f| below which a least value may hide two zeros
_ROUNDS, _LONGEST = 12, 0.3  # of Newton's method; rad a step
_ENDED_MM, _ENDED_RAD = 3e-10, 1e-11
_SAME = 1e-6  # rad
_HALVINGS, _SHARES = 30, (0.0, 0.5, 0.9, 0.99, 0.9999, 1.0)
_OF_A_NAME = 4  # solutions that bear the same name

Begun = tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64], Array]
"""Branch (front, up), row of the pose and theta_6 of places where a solution is begun."""


@dataclass(frozen=True)
class OffsetWrist:
    """Zero pose of an arm with an offset wrist.

    The centre c (3,) is in the base frame, mm. `links` are the first three axes. `sense` is +1 or -1 if
    axis 3 points along axis 2 or against it.
    """

    zero: ZeroPose
    centre: Array
    links: TwoLinks
    sense: float

    kind = "by a search over one joint, offset wrist"
    branches = (*BRANCHES, *(f"{name}/{k}" for k in range(2, _OF_A_NAME + 1) for name in BRANCHES))

    @classmethod
    def of(cls, zero: ZeroPose) -> OffsetWrist | None:
        """Find the structure of an arm from its zero pose.

        Returns None if axes 4 and 5 do not meet squarely, or if the arm is of another kind.
        """
        axes, points = zero.axes, zero.points
        if not (square(axes[0], axes[1]) and parallel(axes[1], axes[2]) and square(axes[3], axes[4])):
            return None
        centre, gap = meeting(points[4], axes[4], points[3], axes[3])
        if gap > MEETING_MM or abs(float(axes[4] @ axes[5])) > 1.0 - 1e-6:
            return None
        return cls(zero, centre, TwoLinks.of(zero, centre, centre), float(np.sign(axes[1] @ axes[2])))

    def solve(self, poses: Array, seed: Array) -> Solutions:
        """Solve all branches of flange poses (n, 4, 4), base frame, mm.

        Further solutions of the same name are called `.../2`, and so on.
        """
        blocks = [
            self._block(poses[i : i + BLOCK], seed[i : i + BLOCK])
            for i in range(0, max(len(poses), 1), BLOCK)
        ]
        return Solutions(
            np.concatenate([joints for joints, _ in blocks]),
            np.concatenate([state for _, state in blocks]),
            self.branches,
        )

    def _block(self, poses: Array, seed: Array) -> tuple[Array, NDArray[np.int8]]:
        rows, joints = self._begun(poses, seed)
        joints, ended = self._ended(poses[rows], joints)
        rows, joints = rows[ended], wrapped(joints[ended], self.zero.turns)
        name, singular = self._named(joints)
        # By pose, name and theta_6; the same solution, begun twice, is kept once.
        order = np.lexsort((joints[:, 5], name, rows))
        rows, joints, name, singular = rows[order], joints[order], name[order], singular[order]
        again = np.zeros(len(rows), dtype=bool)
        for back in range(1, 12):
            apart = np.abs(wrapped(joints[back:] - joints[:-back], self.zero.turns)).max(axis=1, initial=0.0)
            again[back:] |= (rows[back:] == rows[:-back]) & (apart < _SAME) & ~again[:-back]
        rows, joints, name, singular = rows[~again], joints[~again], name[~again], singular[~again]
        group = rows * len(BRANCHES) + name
        nth = np.arange(len(group)) - np.searchsorted(group, group)
        there = nth < _OF_A_NAME
        place = name + len(BRANCHES) * nth
        out = np.full((len(poses), len(self.branches), 6), np.nan)
        state = np.full(out.shape[:2], REACHED.index(BranchResult.TOO_FAR), dtype=np.int8)
        out[rows[there], place[there]] = joints[there]
        state[rows[there], place[there]] = np.where(
            singular, REACHED.index(BranchResult.WRIST), REACHED.index(BranchResult.YES)
        )[there]
        return out, state

    def _first_three(
        self, poses: Array, theta_6: Array, seed: Array
    ) -> tuple[tuple[Array, Array, Array], Mask, Array]:
        """Compute theta_1 to theta_3 for values of theta_6 (k, n).

        Returns the angles, each (2, 2, k, n), whether they reach the pose, and the value of f.
        """
        zero, links = self.zero, self.links
        flange = zero.flange
        back = turns_about(zero.axes[5], -theta_6)
        turned = links.base @ poses[:, :3, :3] @ flange[:3, :3].T
        # Link 5 stands where the flange does with theta_6 taken back.
        from_6 = zero.points[5] + back @ (self.centre - zero.points[5]) - flange[:3, 3]
        origin = (poses[:, :3, 3] - links.origin) @ links.base.T
        centre = _spread(origin + np.einsum("nij,knj->kni", turned, from_6))
        axis_5 = _spread(np.einsum("nij,knj->kni", turned, back @ zero.axes[4]))
        theta_1, near, _ = links.shoulder(centre, seed)
        centre, axis_5 = (turn_back(v, theta_1, (2, 0)) for v in (centre, axis_5))
        theta_2, bend, far, _ = links.elbow(links.from_axis_2(centre))
        axis_5 = turn_back(axis_5, theta_2 + bend, (0, 1))
        axis_4 = links.base @ zero.axes[3]
        f = axis_5[0] * axis_4[0] + axis_5[1] * axis_4[1] + axis_5[2] * axis_4[2]
        shape = f.shape
        angles = tuple(np.broadcast_to(a, shape) for a in (theta_1, theta_2, self.sense * bend))
        return (angles[0], angles[1], angles[2]), np.broadcast_to(~(near | far), shape), f

    def _begun(self, poses: Array, seed: Array) -> tuple[NDArray[np.int64], Array]:
        """Find rows (m,) of poses and joints (m, 6) near solutions."""
        n = len(poses)
        grid = np.linspace(-np.pi, np.pi, STEPS, endpoint=False)
        theta_6 = np.broadcast_to(grid[:, None], (STEPS, n))
        angles, valid, f = self._first_three(poses, theta_6, seed[:, 0])
        after, reaches = np.roll(f, -1, axis=2), np.roll(valid, -1, axis=2)
        before, reached = np.roll(f, 1, axis=2), np.roll(valid, 1, axis=2)
        crosses = valid & reaches & (f * after <= 0.0)
        step = 2.0 * np.pi / STEPS
        begun = [self._crossing(poses, seed, np.nonzero(crosses), grid, np.full(int(crosses.sum()), step))]
        flat = valid & reaches & reached & (np.abs(f) <= np.abs(after)) & (np.abs(f) <= np.abs(before))
        least = np.nonzero(flat & (np.abs(f) < _FLAT))
        # The parabola through three steps, at its zeros or where it is least.
        curve, slope = (0.5 * (after + before) - f)[least], 0.5 * (after - before)[least]
        curve = np.where(curve == 0.0, 1e-300, curve)
        wide = np.sqrt(np.maximum(slope**2 - 4.0 * curve * f[least], 0.0))
        for sign in (-1.0, 1.0):
            share = np.clip((-slope + sign * wide) / (2.0 * curve), -1.0, 1.0)
            begun.append((least[0], least[1], least[3], grid[least[2]] + share * step))
        for edge, way in ((valid & ~reaches, step), (valid & ~reached, -step)):
            begun += self._beside(poses, seed, np.nonzero(edge), grid, way)
        front, up, rows, found = (np.concatenate(each) for each in zip(*begun, strict=True))
        angles, _, _ = self._first_three(poses[rows], found[None], seed[rows, 0])
        each = np.arange(len(rows))
        joints = np.stack([a[front, up, 0, each] for a in angles], axis=1)
        joints = np.hstack([joints, np.zeros((len(rows), 2)), found[:, None]])
        # What joints 4 and 5 turn of axis 5 and of what is square to it.
        zero = self.zero
        arm = np.broadcast_to(np.eye(3), (len(rows), 3, 3))
        for k in range(3):
            arm = arm @ turns_about(zero.axes[k], joints[:, k])
        rest = arm.transpose(0, 2, 1) @ poses[rows][:, :3, :3] @ zero.flange[:3, :3].T
        rest = rest @ turns_about(zero.axes[5], -joints[:, 5])
        z4, z5 = zero.axes[3], zero.axes[4]
        across = np.cross(z4, z5)
        turned = rest @ z5
        joints[:, 3] = np.arctan2(turned @ across, turned @ z5)
        turned = (turns_about(z4, -joints[:, 3]) @ rest) @ z4
        joints[:, 4] = np.arctan2(-(turned @ across), turned @ z4)
        return rows, joints

    def _crossing(
        self, poses: Array, seed: Array, chosen: tuple[NDArray[np.int64], ...], grid: Array, steps: Array
    ) -> Begun:
        """Find the zeros of f between steps of `grid` and points `steps` (m,) further, by halving."""
        front, up, at, rows = chosen
        begin, share = self._at(poses, seed, chosen, grid[at])[1], np.zeros(len(rows))
        for k in range(1, _HALVINGS + 1):
            there = share + 0.5**k
            valid, f = self._at(poses, seed, chosen, grid[at] + steps * there)
            share = np.where(valid & (f * begin > 0.0), there, share)
        return front, up, rows, grid[at] + steps * share

    def _beside(
        self, poses: Array, seed: Array, chosen: tuple[NDArray[np.int64], ...], grid: Array, step: float
    ) -> list[Begun]:
        """Find places between the last step that reaches and the edge of reach, by halving."""
        front, up, at, rows = chosen
        inside = np.zeros(len(rows))
        for k in range(1, _HALVINGS + 1):
            there = inside + 0.5**k
            inside = np.where(self._at(poses, seed, chosen, grid[at] + step * there)[0], there, inside)
        return [
            self._crossing(poses, seed, chosen, grid, step * inside),
            *((front, up, rows, grid[at] + step * share * inside) for share in _SHARES),
        ]

    def _at(
        self, poses: Array, seed: Array, chosen: tuple[NDArray[np.int64], ...], theta_6: Array
    ) -> tuple[Mask, Array]:
        """Test whether the branches of some rows reach at theta_6 (m,), and compute f there."""
        front, up, _, rows = chosen
        _, valid, f = self._first_three(poses[rows], theta_6[None], seed[rows, 0])
        each = np.arange(len(rows))
        return valid[front, up, 0, each], f[front, up, 0, each]

    def _ended(self, poses: Array, joints: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Apply Newton's method to joints (m, 6).

        Returns the joints, and whether they reach the poses (m, 4, 4).
        """
        ended = np.zeros(len(joints), dtype=bool)
        for _ in range(_ROUNDS):
            reached, jacobian = self.zero.reached(joints)
            turn = poses[:, :3, :3] @ reached[:, :3, :3].transpose(0, 2, 1)
            skew = turn - turn.transpose(0, 2, 1)
            miss = np.hstack(
                [
                    poses[:, :3, 3] - reached[:, :3, 3],
                    0.5 * np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], axis=1),
                ]
            )
            ended = (np.linalg.norm(miss[:, :3], axis=1) < _ENDED_MM) & (
                np.linalg.norm(poses[:, :3, :3] - reached[:, :3, :3], axis=(1, 2)) < _ENDED_RAD
            )
            if ended.all():
                break
            jacobian[:, 3:] *= 300.0
            miss[:, 3:] *= 300.0
            square_of = jacobian.transpose(0, 2, 1) @ jacobian
            square_of += 1e-14 * np.trace(square_of, axis1=1, axis2=2)[:, None, None] * np.eye(6)
            step = np.linalg.solve(square_of, jacobian.transpose(0, 2, 1) @ miss[:, :, None])[:, :, 0]
            longest = np.abs(step).max(axis=1, keepdims=True)
            step *= np.minimum(1.0, _LONGEST / np.maximum(longest, 1e-300))
            joints = np.where(ended[:, None], joints, joints + step)
        return joints, ended

    def _named(self, joints: Array) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
        """Index (m,) into `BRANCHES`, and whether the pose is singular."""
        zero, links = self.zero, self.links
        jacobian = zero.reached(joints)[1]
        z4, z5, z6 = (jacobian[:, 3:, k] for k in (3, 4, 5))
        noflip = np.sum(z5 * np.cross(z4, z6), axis=1) >= 0.0
        # The arm at theta_1 = 0: w in the plane across axis 2.
        between = self.sense * joints[:, 2] + links.forearm[0] - links.upper_arm[0]
        upper = joints[:, 1] + links.upper_arm[0]
        reach = (
            links.offset[0] + links.upper_arm[1] * np.cos(upper) + links.forearm[1] * np.cos(upper + between)
        )
        front, up = reach * links.front >= 0.0, np.sin(between) >= 0.0
        jacobian[:, 3:] *= 300.0
        values = np.linalg.svd(jacobian, compute_uv=False)
        name = 4 * (~front).astype(np.int64) + 2 * (~up).astype(np.int64) + (~noflip).astype(np.int64)
        return name, values[:, -1] < SINGULAR_SINE * values[:, 0]


def _spread(vectors: Array) -> Vector:
    """Return the components of (k, n, 3) vectors, each (1, 1, k, n)."""
    x, y, z = (np.ascontiguousarray(vectors[..., i])[None, None] for i in range(3))
    return x, y, z
