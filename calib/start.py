"""Starts for what the world hides: base pose, tool frame and base targets, from the nominal robot and the readings.

Weighted Kabsch alignment of nominal points with measured ones; where the tool targets are unknown too, it
alternates with the linear solution for them. Weights (Huber) keep gross errors out. Distances give their base
target by multilateration. Sources: Kabsch 1976; Norrdine 2012 (linear multilateration).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from calib.kinematics import Array

_ROUNDS = 40
_SETTLED = 1e-3  # mm: a round that changes the mean distance by less is the last; the fit does the rest


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
    before = np.inf
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
        moved, before = abs(before - float(miss.mean())), float(miss.mean())
        if moved < _SETTLED:
            break
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, translation
    return pose, targets


def tools_of(flange: Array, base: Array, targets: Array, which: NDArray[np.int64], measured: Array) -> Array:
    """Tool targets (T, 3), mm, of one series whose base stands at `base` (4, 4): the median of what its readings say.

    As `base_and_tool` has them; a target without readings stays as it is in `targets`.
    """
    back = (measured - base[:3, 3]) @ base[:3, :3]
    at_flange = np.einsum("nji,nj->ni", flange[:, :3, :3], back - flange[:, :3, 3])
    out = targets.copy()
    for t in np.unique(which):
        out[t] = np.median(at_flange[which == t], axis=0)
    return out


def tool_turn(flange: Array, base: Array, orientation: Array) -> Array:
    """(3, 3) constant orientation of the tool frame on the flange: the mean of what the readings say.

    flange: (n, 4, 4) nominal poses; base: (4, 4); orientation: (n, 4) measured in the world, scalar first.
    """
    measured = Rotation.from_quat(orientation, scalar_first=True)
    at_flange = Rotation.from_matrix(base[:3, :3] @ flange[:, :3, :3]).inv() * measured
    return at_flange.mean().as_matrix()


def base_target(points: Array, lengths: Array, *, zero_unknown: bool) -> Array | None:
    """(3,) place from which `points` (n, 3) are `lengths` (n,) away, mm; None where they do not determine it.

    |p|^2 - l^2 = 2 p.b + 2 l z + (z^2 - |b|^2): linear in b, the zero z of the lengths, and a constant.
    """
    columns = [2.0 * points, 2.0 * lengths[:, None]] if zero_unknown else [2.0 * points]
    system = np.column_stack([*columns, np.ones(len(points))])
    if len(points) < system.shape[1]:
        return None
    right = np.sum(points**2, axis=1) - lengths**2
    scale = np.linalg.norm(system, axis=0)
    found, _, rank, _ = np.linalg.lstsq(system / scale, right, rcond=1e-6)
    return (found / scale)[:3] if rank == system.shape[1] else None
