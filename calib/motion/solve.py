"""Least-squares problem of a moving robot: base, tool, geometry and clocks.

    m_i = p(q(c(t_i)); x) + noise,      c(t) = t + offset + rate (t - middle) + step [t >= step_at]

p is the tool point of the arm with errors x of its terms (`calib.motion.arm`), q the joints of the
robot's stream. The method is Gauss-Newton; the column of the offset is the velocity of the point.
Weights are bisquare by the length of the residual of the last round. Geometry has its usual sizes as
priors.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calib.array import Array
from calib.motion.arm import NOISE_MM, AlignedArm, AlignedArmState
from calib.motion.clocks import ClockRelation
from calib.motion.streams import JointStream

CLOCKS = 3  # columns of the clocks, the last ones: offset, rate, step
_NO_STEP = 1.0  # weight, mm/s: holds the step at zero where none was seen, and is negligible compared with one that was
_ROUNDS = 12
_PLACING_ROUNDS = 4
_SETTLED_S = 1e-7
_BLOCKS = 60
SLOW_MM_S = 2.0  # the tool of a robot at rest is slower
_MOVING = 0.1  # of the mean motion of a block: one with less says nothing of the clocks
_SLIGHT = 1e-6  # the same, of what weights leave of it


@dataclass(frozen=True)
class Samples:
    """The arm at n instants.

    Attributes
    ----------
    error : array of shape (n, 3)
        Measured minus predicted points.
    velocity : array of shape (n, 3)
        Velocity of the tool point.
    joints : array of shape (n, N)
        Joints of the robot's stream.
    known : array of bool, shape (n,)
        Whether the robot's stream has joints there; otherwise error and velocity are zero.
    """

    error: Array
    velocity: Array
    joints: Array
    known: NDArray[np.bool_]
    arm: AlignedArmState


class Solve:
    """The problem for points (n, 3) that were measured at times (n,) of the instrument's clock."""

    def __init__(self, arm: AlignedArm, moved: JointStream, points: Array, time: Array) -> None:
        self.arm, self._moved, self._points, self._time = arm, moved, points, time
        self._prior = np.append(arm.prior, (0.0, 0.0, _NO_STEP))

    def at(self, clocks: ClockRelation, estimate: Array) -> Samples:
        """Compute the samples with these clocks and errors (s,) of the arm's terms."""
        time = clocks.robot_time(self._time)
        joints, rates, known = self._moved.at(time)
        arm = self.arm.at(joints, rates, self._moved.side_at(time), estimate)
        seen = known[:, None]
        return Samples((self._points - arm.point) * seen, arm.velocity * seen, joints, known, arm)

    def run(self, clocks: ClockRelation) -> tuple[ClockRelation, Array]:
        """Solve for the clocks and the errors of the terms (s,), from a start."""
        estimate = np.zeros(len(self.arm.terms))
        for _ in range(_ROUNDS):
            samples = self.at(clocks, estimate)
            columns = self._columns(samples, clocks)
            normal, right = _normal(columns, samples.error, weights(samples.error), self._prior)
            right[: len(estimate)] -= self.arm.prior**2 * estimate
            change = solved(normal, right)
            estimate = estimate + change[:-CLOCKS]
            offset, rate, step = (float(x) for x in change[-CLOCKS:])
            clocks = replace(
                clocks, offset=clocks.offset + offset, rate=clocks.rate + rate, step=clocks.step + step
            )
            if max(abs(offset), abs(step), abs(rate) * float(np.ptp(self._time))) < _SETTLED_S:
                break
        return clocks, estimate

    def offsets(self, clocks: ClockRelation, estimate: Array) -> tuple[Array, Array]:
        """Compute the offset that every block of the recording would add alone.

        Returns the instants (b,) at which the blocks begin, and the offsets (b,), s. Blocks are related
        through frame and geometry alone, so their offsets are eliminated one by one.
        """
        samples = self.at(clocks, estimate)
        parts = blocks(len(self._time))
        moving = np.array([float(np.sum(samples.velocity[part] ** 2)) for part in parts])
        # by the mean: where the robot rests most of the time, the median is the rounding of its joints
        parts = [part for part, much in zip(parts, moving, strict=True) if much > _MOVING * moving.mean()]
        weight = weights(samples.error)
        of_arm = self._of_arm(samples)
        normal, right = _normal(of_arm, samples.error, weight, self.arm.prior)
        right -= self.arm.prior**2 * estimate
        heavy = samples.velocity * weight[:, None]
        own = np.array([float(np.sum(heavy[part] * samples.velocity[part])) for part in parts])
        # The fit may have followed one side of a step: of the other, only slow samples count, which is enough.
        slight = _SLIGHT * float(moving.mean())
        parts = [part for part, much in zip(parts, own, strict=True) if much > slight]
        own = own[own > slight]
        if not parts:
            return np.empty(0), np.empty(0)
        cross = np.array([np.einsum("nx,nxs->s", heavy[part], of_arm[part]) for part in parts])
        score = np.array([float(np.sum(heavy[part] * samples.error[part])) for part in parts])
        shared = solved(normal - cross.T @ (cross / own[:, None]), right - cross.T @ (score / own))
        return np.array([self._time[part[0]] for part in parts]), (score - cross @ shared) / own

    def step_placed(self, clocks: ClockRelation, estimate: Array) -> ClockRelation:
        """Move the step of the clocks to the sample that minimises the sum of the errors.

        The errors are those before the step without it, and those after the step with it.
        """
        without = self.at(replace(clocks, step_at=np.inf), estimate)
        with_it = self.at(replace(clocks, step_at=-np.inf), estimate)
        both = without.known & with_it.known
        if not both.any():  # a step longer than the recording: it is where the stream has its gap
            return clocks
        before, after = (np.sum(samples.error**2, axis=1) for samples in (without, with_it))
        ceiling = float(np.quantile(np.minimum(before, after), 0.99))  # a lost target must not decide
        gain = (np.minimum(before, ceiling) - np.minimum(after, ceiling)) * both
        return replace(clocks, step_at=float(self._time[int(np.argmin(np.cumsum(gain) - gain))]))

    def uncertainty(self, clocks: ClockRelation, estimate: Array) -> tuple[float, float, float]:
        """Estimate standard errors of offset, rate and step (s, 1, s) by a jackknife.

        Parts of the recording are left out in turn. The robot's own error varies slowly along the path,
        and the place at which a move ends differs each time by the robot's repeatability. Errors within
        a block of time, or within a move with the rest behind it, may therefore be correlated; only
        these parts are taken for independent. The larger of both estimates counts. A part that is left
        out cannot hide its error from its own fit. Each takes one step of Gauss-Newton. Source: Bell and
        McCaffrey 2002 (the jackknife of clusters).
        """
        samples = self.at(clocks, estimate)
        columns, weight = self._columns(samples, clocks), weights(samples.error)
        nothing = np.zeros_like(self._prior)
        normal, _ = _normal(columns, samples.error, weight, self._prior)
        scatter = np.zeros(CLOCKS)
        for parts in (blocks(len(weight)), moves(samples.velocity)):
            changes = []
            for part in parts:
                own, score = _normal(columns[part], samples.error[part], weight[part], nothing)
                changes.append(solved(normal - own, score)[-CLOCKS:])
            share = (len(changes) - 1) / len(changes)
            scatter = np.maximum(scatter, share * np.sum(np.square(changes), axis=0))
        held = solved(normal, np.diag(self._prior))[-CLOCKS:] * NOISE_MM
        offset, rate, step = np.sqrt(scatter + np.sum(np.square(held), axis=1))
        return float(offset), float(rate), float(step)

    def placed_only(self, clocks: ClockRelation) -> Array:
        """Fit only base and tool: the nominal arm in its best place.

        Returns the errors of the terms, shape (s,).
        """
        keep = self.arm.placing
        estimate = np.zeros(len(self.arm.terms))
        for _ in range(_PLACING_ROUNDS):
            samples = self.at(clocks, estimate)
            columns = self._of_arm(samples)[:, :, keep]
            normal, right = _normal(columns, samples.error, weights(samples.error), self.arm.prior[keep])
            estimate[keep] += solved(normal, right - self.arm.prior[keep] ** 2 * estimate[keep])
        return estimate

    def _of_arm(self, samples: Samples) -> Array:
        """Differentiate the predicted points by the arm's terms, shape (n, 3, s)."""
        return self.arm.columns(samples.arm) * samples.known[:, None, None]

    def _columns(self, samples: Samples, clocks: ClockRelation) -> Array:
        """Differentiate the predicted points by terms and clocks, shape (n, 3, s + 3)."""
        drives = np.column_stack(
            [np.ones(len(self._time)), self._time - clocks.middle, self._time >= clocks.step_at]
        )
        of_arm = self._of_arm(samples)
        return np.concatenate([of_arm, samples.velocity[:, :, None] * drives[:, None, :]], axis=2)


def _normal(columns: Array, error: Array, weight: Array, prior: Array) -> tuple[Array, Array]:
    """Compute the normal equations of columns (n, 3, s) with their priors.

    Returns the matrix (s, s) and the right side (s,), for weights (n,).
    """
    heavy = np.sqrt(weight)[:, None]
    flat = (columns * heavy[:, :, None]).reshape(-1, columns.shape[2])
    return flat.T @ flat + np.diag(prior**2), flat.T @ (error * heavy).ravel()


def weights(error: Array) -> Array:
    """Compute bisquare weights by the length of the errors (n, 3), shape (n,)."""
    size = np.linalg.norm(error, axis=1)
    scale = float(np.median(size)) / 1.5382  # of one axis: the median length of three normal errors is 1.5382
    return np.clip(1.0 - (size / (6.0 * max(scale, 1e-6))) ** 2, 0.0, None) ** 2


def solved(normal: Array, right: Array) -> Array:
    """normal^-1 right for a symmetric matrix (s, s); what nothing determines stays zero."""
    scale = 1.0 / np.sqrt(np.maximum(np.diag(normal), 1e-300))
    inverse = np.linalg.pinv(normal * np.outer(scale, scale), 1e-13, hermitian=True)
    return (scale * (inverse @ (right.T * scale).T).T).T


def moves(velocity: Array) -> list[NDArray[np.int64]]:
    """Find the samples of every move with the rest behind it.

    `velocity` (n, 3) is that of the tool, mm/s; the result is a list of indices.
    """
    still = np.linalg.norm(velocity, axis=1) < SLOW_MM_S
    begun = np.flatnonzero(still[:-1] & ~still[1:]) + 1
    return [part for part in np.split(np.arange(len(still)), begun) if len(part)]


def blocks(count: int) -> list[NDArray[np.int64]]:
    """Split n samples into equal stretches of indices."""
    return [part for part in np.array_split(np.arange(count), _BLOCKS) if len(part)]
