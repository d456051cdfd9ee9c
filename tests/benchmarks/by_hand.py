"""Identification written by hand for one robot: an IRB 120 of the library, tracker points.

It has no names, priors or slots. The parameters are modified DH, six numbers of the base, alpha, a, theta, d of
links 2 to 6, the twist of axis 3 and the compliance of joints 2 to 6, in that order. Readings are whitened as in
the program, by the tracker's noise and the repeatability of the joints. The normal equations have a ridge too small
to matter. The code assumes that every reading belongs, that these parameters are determined, and that its start is
near.
"""

from __future__ import annotations

import numpy as np

from calib.array import Array
from calib.data.dataset import Dataset
from calib.fit.least_squares import CONVERGED

_STEPS = 20


def identify_by_hand(dataset: Dataset) -> tuple[Array, Array]:
    """Estimate (32,) and the predicted points (n, 3), mm, of the calibration readings."""
    rows, robot, noise = dataset.fit_rows, dataset.header.robot, dataset.header.noise
    c, measured = dataset.conditions, dataset.points[rows].T
    joints, torque = c.joints[rows].T, c.torque[rows].T
    tool = np.array([dataset.header.targets_of("main")[name] for name in c.target_names])[c.target[rows]].T
    alpha, a, theta, d = (np.array(numbers) for numbers in (robot.alpha, robot.a, robot.theta, robot.d))
    n = measured.shape[1]
    world = np.eye(3)[:, :, None] * np.ones(n)

    def chain(base: Array, centre: Array, p: Array) -> tuple[Array, Array, Array]:
        """Points (3, n) and their derivatives (32, 3, n), and those by the joints (6, 3, n)."""
        x, y, z = (np.repeat(base[:, k : k + 1], n, axis=1) for k in range(3))
        at = np.repeat(centre[:, None], n, axis=1)
        axes, origins, turns = [], [], []

        def note(axis: Array, turning: bool) -> None:
            axes.append(axis)
            origins.append(at)
            turns.append(turning)

        for turning in (False, True):
            for axis in world:
                note(axis, turning)
        joint_axes, joint_origins, twist = [], [], (y, at)
        for k in range(6):
            da, dl, dt, dd = p[6 + 4 * (k - 1) : 10 + 4 * (k - 1)] if k else np.zeros(4)
            if k:
                note(x, True)
            cos, sin = np.cos(alpha[k] + da), np.sin(alpha[k] + da)
            y, z = y * cos + z * sin, z * cos - y * sin
            if k == 2:
                twist = (y, at)
                cos, sin = np.cos(p[26]), np.sin(p[26])
                z, x = z * cos + x * sin, x * cos - z * sin
            if k:
                note(x, False)
            at = at + x * (a[k] + dl)
            if k:
                note(z, True)
                note(z, False)
            joint_axes.append(z)
            joint_origins.append(at)
            turned = joints[k] + theta[k] + dt + (p[26 + k] * torque[k] if k else 0.0)
            cos, sin = np.cos(turned), np.sin(turned)
            x, y = x * cos + y * sin, y * cos - x * sin
            at = at + z * (d[k] + dd)
        axes += [twist[0], *joint_axes]
        origins += [twist[1], *joint_origins]
        point = at + x * tool[0] + y * tool[1] + z * tool[2]
        axis = np.array(axes)
        arm = point - np.array(origins)
        rotary = np.array([*turns, *[True] * 7])
        moved = np.where(rotary[:, None, None], _cross(axis, arm), axis)
        by_joint = moved[27:33]
        return point, np.concatenate([moved[:27], by_joint[1:] * torque[1:, None]]), by_joint

    # Start: the nominal arm laid onto the points (Kabsch)
    zero = np.zeros(32)
    there, _, by_joint = chain(np.eye(3), np.zeros(3), zero)
    mean, goal = there.mean(axis=1), measured.mean(axis=1)
    u, _, vt = np.linalg.svd((measured - goal[:, None]) @ (there - mean[:, None]).T)
    base = u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt
    centre = goal - base @ mean
    # Whitening: the tracker's covariance and the joints' repeatability
    beam = measured - np.array(noise.station_mm)[:, None]
    far = np.sqrt(np.sum(beam**2, axis=0))
    beam /= far
    along = (noise.range_mm + noise.range_ppm * 1e-6 * far) ** 2
    across = (noise.transverse_mm + noise.transverse_ppm * 1e-6 * far) ** 2
    covariance = across * np.eye(3)[:, :, None] + (along - across) * beam[:, None] * beam
    scatter = np.einsum("ij,kjn->kin", base, by_joint) * noise.repeatability
    covariance = covariance + np.einsum("kin,kjn->ijn", scatter, scatter)
    whiten = np.linalg.inv(np.linalg.cholesky(covariance.transpose(2, 0, 1)))
    estimate, ridge = zero, 1e-10 * np.eye(32)
    for _ in range(_STEPS):
        turned = base @ _rotation(estimate[3:6])
        point, columns, _ = chain(turned, centre + estimate[:3], estimate)
        left = np.matmul(whiten, (measured - point).T[:, :, None]).ravel()
        jacobian = np.matmul(whiten, columns.transpose(2, 1, 0)).reshape(3 * n, -1)
        size = np.sqrt(np.sum(jacobian**2, axis=0))
        jacobian /= size
        step = np.linalg.solve(jacobian.T @ jacobian + ridge, jacobian.T @ left)
        # the base turns about its own place from where it is now
        base = _rotation(step[3:6] / size[3:6]) @ base
        estimate = estimate + np.where(np.arange(32) // 3 == 1, 0.0, step / size)
        if np.sqrt(np.sum((jacobian @ step) ** 2)) < CONVERGED:
            break
    return estimate, chain(base, centre + estimate[:3], estimate)[0].T


def _rotation(turn: Array) -> Array:
    """Return the rotation matrix (3, 3) of a small rotation vector (3,)."""
    angle = float(np.sqrt(turn @ turn))
    if angle == 0.0:
        return np.eye(3)
    x, y, z = turn / angle
    k = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * k + (1.0 - np.cos(angle)) * k @ k


def _cross(u: Array, v: Array) -> Array:
    out = np.empty(np.broadcast_shapes(u.shape, v.shape))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        out[:, i] = u[:, j] * v[:, k] - u[:, k] * v[:, j]
    return out
