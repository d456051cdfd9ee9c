"""The scatter of each joint that a model does not explain, estimated from its residuals.

A law that a model does not hold, a wave of a gear say, moves the joints of a pose alike in every reading there: of ten
poses with three targets each it is drawn ten times, not in ninety rows, and most of it is taken on by the parameters.
Small gears are off by more than large ones, and a wrist that is off by ten times as much moves the tool no farther, so
every joint has a scatter of its own. With r the whitened residual, Z the columns of all that was estimated or is left
open, P the covariance of their priors and W_k the columns of joint k in every pose,

    r ~ N(0, H^-1 + sum s_k^2 W_k W_k'),    H = (I + Z P Z')^-1,

and for one joint, with the others in H and W'H W = U a U',

    2 log L(s) = sum s^2 (u'W'H r)^2 / (1 + s^2 a) - log(1 + s^2 a).

Taken is the mean of s^2 by L and by how much gears are off as a rule, joint by joint, with the others at theirs, until
they agree to what matters. Source: Patterson and Thompson 1971 (restricted likelihood).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from calib.array import Array
from calib.fit.readings import Readings, linearised
from calib.model.effect import effect
from calib.model.model import RobotModel
from calib.model.regressors import Constant
from calib.units import DEG

_USUAL = 0.02 * DEG  # scatter of joints whose gears are as usual: half-normal
_TRIED = np.linspace(0.0, 4.0 * _USUAL, 401)
_POSES = 60  # 200 change a joint by some 15 %, and cost ten times as much
_SWEEPS = 3  # over all joints; twenty change one by 8 % at most


class Scattering:
    """The joints of every pose off by themselves, beside the m parameters of a model at its estimate."""

    def __init__(self, model: RobotModel, estimate: Array, every: Sequence[Readings]) -> None:
        """estimate (m,) or its beginning; the rest is 0. every: sets of readings that have no pose in common."""
        robot = model.robot
        acts = {
            f"j{k}": ("", None, [(slot, Constant())]) for k, slot in enumerate(robot.joint_slots, start=1)
        }
        self._model = model.append(effect("scatter", "transmission", "robot", "The joints scatter.", acts))
        self._estimate = np.zeros(len(self._model.parameters))
        self._estimate[: len(estimate)] = estimate
        poses = [readings.conditions.pose for readings in every]
        first = np.cumsum([0, *(int(pose.max()) + 1 for pose in poses)])
        self._sets = [(readings, pose + at) for readings, pose, at in zip(every, poses, first, strict=False)]
        known = np.unique(np.concatenate([pose for _, pose in self._sets]))
        self._poses = known[np.unique(np.linspace(0, len(known) - 1, _POSES).astype(np.int64))]

    def shown(self) -> list[tuple[Array, Array]]:
        """The normal equations of every set, (m + w, m + w) and (m + w,); w: number of joints times number of poses.

        A slide scatters as many mm as other joints deg.
        """
        return [self._shown(readings, pose) for readings, pose in self._sets]

    def _shown(self, readings: Readings, pose: NDArray[np.int64]) -> tuple[Array, Array]:
        steps, grams, alongs = self._model.robot.steps, [], []
        for part, residual, columns in linearised(self._model, readings, self._estimate):
            mine = np.tile(pose[part], len(residual))[:, None] == self._poses
            joints = columns[:, -len(steps) :] * steps
            apart = (mine[:, :, None] * joints[:, None, :]).reshape(len(columns), -1)
            every = np.column_stack([columns[:, : -len(steps)], apart])
            grams.append(every.T @ every)
            alongs.append(every.T @ residual.ravel())
        return np.sum(grams, axis=0), np.sum(alongs, axis=0)


def likely_scatter(shown: Array, along: Array, joints: int) -> Array:
    """(N,) the scatter of every joint, rad, by W'H W (w, w) and W'H r (w,), pose by pose."""
    joint = np.arange(len(along)) % joints
    scatter = np.full(joints, _likely(shown, along))
    for _ in range(_SWEEPS):
        for k in range(joints):
            mine, others = joint == k, joint != k
            root = scatter[joint[others]]
            both = shown[np.ix_(mine, others)] * root
            rest = np.eye(len(root)) + root[:, None] * shown[np.ix_(others, others)] * root
            taken = np.linalg.solve(rest, np.column_stack([both.T, root * along[others]]))
            scatter[k] = _likely(
                shown[np.ix_(mine, mine)] - both @ taken[:, :-1], along[mine] - both @ taken[:, -1]
            )
    return scatter


def _likely(shown: Array, along: Array) -> float:
    values, vectors = np.linalg.eigh(shown)
    values, square = np.maximum(values, 0.0)[:, None], ((vectors.T @ along) ** 2)[:, None]
    share = _TRIED**2 / (1.0 + _TRIED**2 * values)
    twice = np.sum(square * share - np.log1p(_TRIED**2 * values), axis=0) - (_TRIED / _USUAL) ** 2
    weight = np.exp(0.5 * (twice - twice.max()))
    return float(np.sqrt(weight @ _TRIED**2 / weight.sum()))
