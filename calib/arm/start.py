"""Start values for base pose, tool frame and base targets, from nominal robot and readings.

Nominal points are aligned with measured ones (weighted Kabsch). If the tool targets are unknown too, the
alignment alternates with the linear solution for them, and Gauss-Newton ends it. Weights (Huber) reduce
the effect of gross errors. Distances give their base target by multilateration. Sources: Kabsch 1976,
Norrdine 2012 (linear multilateration).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from calib.array import Array

_ROUNDS_NEAR = 15  # of alignment and averaging in turn, which come near from anywhere and then crawl
_NEAR = 1e-3  # mm: a round that changes the mean distance by less is the last; the fit does the rest
# Share of what the nominal robot misses anyway: a round that changes less than it is the last as well
_ENOUGH = 0.01
_ROUNDS = 60
_HALVINGS = 8
_SETTLED = 1e-9  # mm, rad
# mm: how far from its nominal place a tool target usually is. It decides only where the tool hardly turns, so that the
# readings cannot tell a shift of the tool from one of the base: there, without it, both run away for kilometres.
_USUAL_MM = 500.0


def align(nominal: Array, measured: Array, weights: Array) -> tuple[Array, Array]:
    """Fit measured = rotation @ nominal + translation by weighted least squares.

    Returns the rotation (3, 3) and the translation (3,).
    """
    w = weights / np.sum(weights)
    centre, goal = w @ nominal, w @ measured
    u, _, vt = np.linalg.svd((measured - goal).T @ ((nominal - centre) * w[:, None]))
    rotation = u @ vt
    (a, b, c), (d, e, f), (g, h, i) = rotation.tolist()
    if (
        a * (e * i - f * h) + b * (f * g - d * i) + c * (d * h - e * g) < 0.0
    ):  # a mirror: its third axis turned over
        u[:, 2] *= -1.0
        rotation = u @ vt
    return rotation, goal - rotation @ centre


def base_and_tool(
    flange: Array, targets: Array, which: NDArray[np.int64], measured: Array, *, tool_unknown: bool
) -> tuple[Array, Array]:
    """Fit the base pose and the tool targets of one series, with Huber weights.

    With p_i the flange, F_i its axes and t the target,

        minimise  sum_i w_i | m_i - (R (p_i + F_i t) + T) |^2   over R, T and, if the tool is unknown, t.

    Alternate alignment and averaging come near, then Gauss-Newton converges. A target without readings
    keeps its value.

    Parameters
    ----------
    flange : array of shape (n, 4, 4)
        Nominal poses, mm.
    targets : array of shape (T, 3)
        Nominal tool targets, mm.
    which : array of int, shape (n,)
        Index of the target of every reading.
    measured : array of shape (n, 3)
        Measured points, mm.
    tool_unknown : bool
        Whether to fit the targets too.

    Returns
    -------
    base : array of shape (4, 4)
        Base pose, mm.
    targets : array of shape (T, 3)
        Tool targets, mm.
    """
    turn, place = flange[:, :3, :3], flange[:, :3, 3]
    nominal_targets, targets, weights = targets, targets.copy(), np.ones(len(measured))
    rotation, translation = np.eye(3), np.zeros(3)
    before, of_target = np.inf, [(t, which == t) for t in np.unique(which).tolist()]
    for _ in range(_ROUNDS_NEAR):
        nominal = place + np.einsum("nij,nj->ni", turn, targets[which])
        rotation, translation = align(nominal, measured, weights)
        back = (measured - translation) @ rotation
        miss = _lengths(back - nominal)
        weights = _huber(miss)
        if tool_unknown:
            at_flange = np.einsum("nji,nj->ni", turn, back - place)
            for t, rows in of_target:
                w = weights[rows]
                targets[t] = (w @ at_flange[rows]) / w.sum()
        mean = float(miss.mean())
        moved, before = abs(before - mean), mean
        if moved < max(_NEAR, _ENOUGH * before):
            break
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, translation
    if not tool_unknown:
        return pose, targets
    return settled(
        flange,
        targets,
        which,
        measured,
        pose,
        tool_unknown=True,
        enough=max(_NEAR, _ENOUGH * before),
        nominal=nominal_targets,
    )


def settled(
    flange: Array,
    targets: Array,
    which: NDArray[np.int64],
    measured: Array,
    base: Array,
    *,
    tool_unknown: bool,
    enough: float = _SETTLED,
    nominal: Array | None = None,
) -> tuple[Array, Array]:
    """Solve the problem of `base_and_tool` by Gauss-Newton from a start.

    Returns the base pose (4, 4) and the tool targets (T, 3), mm. A step that raises the robust cost is
    halved; one below `enough` (mm, rad) is the last. Values that the readings do not determine stay as
    they were. If the tool hardly turns, its targets are drawn towards their nominal places, `nominal`.
    """
    rotation, shift, targets = base[:3, :3].copy(), base[:3, 3].copy(), targets.copy()
    turn, place = flange[:, :3, :3], flange[:, :3, 3]
    unknown = np.unique(which) if tool_unknown else np.array([], dtype=np.int64)
    usual = targets.copy() if nominal is None else nominal

    def left_by(rotation: Array, shift: Array, targets: Array) -> tuple[Array, Array]:
        arm = (place + np.einsum("nij,nj->ni", turn, targets[which])) @ rotation.T
        return arm, measured - arm - shift

    arm, left = left_by(rotation, shift, targets)
    miss = _lengths(left)
    for _ in range(_ROUNDS):
        weight = np.sqrt(_huber(miss))
        columns = np.zeros((len(arm), 3, 6 + 3 * len(unknown)))
        for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):  # axis i turns the arm: e_i x arm
            columns[:, j, i], columns[:, k, i] = -arm[:, k], arm[:, j]
        columns[:, :, 3:6] = np.eye(3)
        for k, target in enumerate(unknown):
            of = which == target
            columns[of, :, 6 + 3 * k : 9 + 3 * k] = rotation @ turn[of]
        columns *= weight[:, None, None]
        held = np.zeros((3 * len(unknown), columns.shape[2]))
        tie = float(np.median(miss)) / _USUAL_MM
        held[:, 6:] = tie * np.eye(3 * len(unknown))
        pull = tie * (usual - targets)[unknown].ravel()
        step = _step(
            np.vstack([columns.reshape(-1, columns.shape[2]), held]),
            np.concatenate([(left * weight[:, None]).ravel(), pull]),
        )
        cost = float(np.sum((miss * weight) ** 2) + pull @ pull)
        for halving in range(_HALVINGS):
            part = step / 2.0**halving
            further = Rotation.from_rotvec(part[:3]).as_matrix() @ rotation
            moved = targets.copy()
            moved[unknown] += part[6:].reshape(-1, 3)
            arm, left = left_by(further, shift + part[3:6], moved)
            miss = _lengths(left)
            pulled = tie * (usual - moved)[unknown]
            if float(np.sum((miss * weight) ** 2) + np.sum(pulled**2)) <= cost + _SETTLED * len(miss):
                rotation, shift, targets, step = further, shift + part[3:6], moved, part
                break
        else:
            break
        if np.abs(step).max() < enough:
            break
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, shift
    return pose, targets


def _lengths(vectors: Array) -> Array:
    """Return the lengths of vectors (n, 3), shape (n,)."""
    return np.sqrt(np.einsum("ni,ni->n", vectors, vectors))


def _huber(miss: Array) -> Array:
    """Weigh distances (n,); those above twice the median count in inverse proportion."""
    middle = len(miss) // 2
    return np.minimum(
        1.0, np.maximum(2.0 * np.partition(miss, middle)[middle], 1e-9) / np.maximum(miss, 1e-9)
    )


def _step(columns: Array, right: Array) -> Array:
    size = np.linalg.norm(columns, axis=0)
    size[size == 0.0] = 1.0
    step, *_ = np.linalg.lstsq(columns / size, right, rcond=1e-10)
    return step / size


def tools_of(flange: Array, base: Array, targets: Array, which: NDArray[np.int64], measured: Array) -> Array:
    """Compute the tool targets of one series from a known base pose, as medians.

    The arrays are those of `base_and_tool`; `base` is (4, 4) and the result (T, 3), mm. A target without
    readings stays as it is in `targets`.
    """
    back = (measured - base[:3, 3]) @ base[:3, :3]
    at_flange = np.einsum("nji,nj->ni", flange[:, :3, :3], back - flange[:, :3, 3])
    out = targets.copy()
    for t in np.unique(which):
        out[t] = np.median(at_flange[which == t], axis=0)
    return out


def tool_turn(flange: Array, base: Array, orientation: Array) -> Array:
    """Compute the constant orientation of the tool frame on the flange, shape (3, 3).

    It is the mean over the readings. `flange` (n, 4, 4) are nominal poses, `base` is (4, 4).
    `orientation` (n, 4) was measured in the world, scalar first.
    """
    measured = Rotation.from_quat(orientation, scalar_first=True)
    at_flange = Rotation.from_matrix(base[:3, :3] @ flange[:, :3, :3]).inv() * measured
    return at_flange.mean().as_matrix()


def base_target(points: Array, lengths: Array, *, zero_unknown: bool) -> Array | None:
    """Find the place that is `lengths` (n,) away from `points` (n, 3), mm, shape (3,).

    |p|^2 - l^2 = 2 p.b + 2 l z + (z^2 - |b|^2) is linear in b, the zero z of the lengths, and a
    constant. Returns None if the points do not determine the place.
    """
    columns = [2.0 * points, 2.0 * lengths[:, None]] if zero_unknown else [2.0 * points]
    system = np.column_stack([*columns, np.ones(len(points))])
    if len(points) < system.shape[1]:
        return None
    right = np.sum(points**2, axis=1) - lengths**2
    scale = np.linalg.norm(system, axis=0)
    found, _, rank, _ = np.linalg.lstsq(system / scale, right, rcond=1e-6)
    return (found / scale)[:3] if rank == system.shape[1] else None
