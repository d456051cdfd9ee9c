"""A start for the base pose when the world frame is free: align the nominal robot with the readings.

Weighted Kabsch alignment of nominal points with measured ones; where the tool targets are unknown too, it
alternates with the linear solution for them. Weights (Huber) keep gross errors out. Source: Kabsch 1976.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from calib.kinematics import Array

_ROUNDS = 40


def align(nominal: Array, measured: Array, weights: Array) -> tuple[Array, Array]:
    """Rotation (3, 3) and translation (3,) with measured = rotation @ nominal + translation, least squares."""
    w = weights / np.sum(weights)
    centre, goal = w @ nominal, w @ measured
    u, _, vt = np.linalg.svd((measured - goal).T @ ((nominal - centre) * w[:, None]))
    rotation = u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))]) @ vt
    return rotation, goal - rotation @ centre


def base_and_tool(
    flange: Array, targets: Array, which: NDArray[np.int64], measured: Array, *, tool_unknown: bool
) -> tuple[Array, Array]:
    """Base pose (4, 4) and tool targets (T, 3), mm, of one series.

    flange: (n, 4, 4) nominal poses; targets: (T, 3) nominal; which: (n,) index of the target of every reading;
    measured: (n, 3).
    """
    turn, place = flange[:, :3, :3], flange[:, :3, 3]
    targets, weights = targets.copy(), np.ones(len(measured))
    rotation, translation = np.eye(3), np.zeros(3)
    for _ in range(_ROUNDS):
        nominal = place + np.einsum("nij,nj->ni", turn, targets[which])
        rotation, translation = align(nominal, measured, weights)
        back = (measured - translation) @ rotation
        miss = np.linalg.norm(back - nominal, axis=1)
        weights = np.minimum(1.0, np.maximum(2.0 * np.median(miss), 1e-9) / np.maximum(miss, 1e-9))
        if tool_unknown:
            at_flange = np.einsum("nji,nj->ni", turn, back - place)
            for t in range(len(targets)):
                w = weights * (which == t)
                if w.sum() > 0.0:
                    targets[t] = (w @ at_flange) / w.sum()
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, translation
    return pose, targets
