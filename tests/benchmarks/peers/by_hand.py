"""Gauss-Newton written by hand for this arm alone: arrays, analytic columns, lstsq.

Nothing is robust or weighted, and no parameter is tested: the 27 parameters that these readings determine are taken
as known.
"""

from __future__ import annotations

import numpy as np

from tests.benchmarks.peers.arm import SIGMA_MM, Arm, Array, Readings

Motion = tuple[str, bool, int]  # name, whether it turns, axis

BASE: list[Motion] = [(f"{'r' * turns}{'xyz'[k]}", turns, k) for turns in (False, True) for k in range(3)]
LINKS: list[Motion] = [
    (f"{kind}{k}", turns, axis)
    for k in range(1, 7)
    for kind, turns, axis in (
        ("alpha", True, 0),
        ("beta", True, 1),
        ("a", False, 0),
        ("theta", True, 2),
        ("d", False, 2),
    )
]
TARGET: list[Motion] = [(f"target{k}", False, k) for k in range(3)]
MOTIONS = [*BASE, *LINKS, *TARGET]
FREE = [
    *(name for name, _, _ in BASE),
    *(f"{kind}{k}" for k in range(2, 7) for kind in ("alpha", "a", "theta", "d")),
    "beta3",
    *(name for name, _, _ in TARGET),
]
for confounded in ("d3", "theta6", "d6"):  # with d2; with the target's x and y; with its z
    FREE.remove(confounded)


def values_of(arm: Arm) -> dict[str, float]:
    """Every number of an arm by the name of its motion."""
    values = {
        f"{kind}{k + 1}": float(getattr(arm, kind)[k])
        for k in range(6)
        for kind in ("alpha", "beta", "a", "d")
    }
    values |= {f"theta{k + 1}": float(arm.theta[k]) for k in range(6)}
    values |= dict(zip([name for name, _, _ in BASE], [*arm.base_mm, *arm.base_rad], strict=True))
    return values | {f"target{k}": float(arm.target_mm[k]) for k in range(3)}


def walk(values: dict[str, float], joints: Array) -> tuple[Array, Array]:
    """Points (3, n) and Jacobian (3n, 27) at the numbers of an arm."""
    n = len(joints)
    columns = [np.broadcast_to(np.eye(3)[:, k : k + 1], (3, n)) for k in range(3)]
    p = np.zeros((3, n))
    axes, origins = np.empty((len(FREE), 3, n)), np.zeros((len(FREE), 3, n))
    turning = np.array([turns for name, turns, _ in MOTIONS if name in FREE])
    place = 0
    for name, turns, axis in MOTIONS:
        if name in FREE:
            axes[place], origins[place] = columns[axis], p
            place += 1
        value = values[name]
        if name.startswith("theta"):
            value = value + joints[:, int(name[-1]) - 1]
        elif value == 0.0:
            continue
        if not turns:
            p = p + columns[axis] * value
            continue
        c, s = np.cos(value), np.sin(value)
        i, j = (axis + 1) % 3, (axis + 2) % 3
        columns[i], columns[j] = columns[i] * c + columns[j] * s, columns[j] * c - columns[i] * s
    arm, axis = (p - origins)[turning], axes[turning]
    moved = axes
    moved[turning] = np.stack(
        [
            axis[:, 1] * arm[:, 2] - axis[:, 2] * arm[:, 1],
            axis[:, 2] * arm[:, 0] - axis[:, 0] * arm[:, 2],
            axis[:, 0] * arm[:, 1] - axis[:, 1] * arm[:, 0],
        ],
        axis=1,
    )
    return p, moved.reshape(len(FREE), -1).T


def identify(readings: Readings) -> dict[str, float]:
    """Identify the arm from its nominal numbers, until a step moves no point by a nanometre."""
    values = values_of(Arm())
    free = [name for name, _, _ in MOTIONS if name in FREE]
    for _ in range(20):
        p, columns = walk(values, readings.joints)
        size = np.linalg.norm(columns, axis=0)
        step, *_ = np.linalg.lstsq(columns / size, (readings.measured.T - p).ravel(), rcond=None)
        for name, amount in zip(free, step / size, strict=True):
            values[name] += amount
        if np.sqrt(np.mean((columns @ (step / size)) ** 2)) < 1e-6:
            break
    return values


def predict(values: dict[str, float], joints: Array) -> Array:
    """Predict the points, (n, 3)."""
    return walk(values, joints)[0].T


def bound(arm: Arm, readings: Readings) -> float:
    """Return the Cramer-Rao bound of the RMS error at the fresh poses, mm.

    An estimate without bias that uses all information of the readings reaches it.
    """
    values = values_of(arm)
    _, columns = walk(values, readings.joints)
    _, fresh = walk(values, readings.fresh_joints)
    size = np.linalg.norm(columns, axis=0)
    triangle = np.asarray(np.linalg.qr(columns / size, mode="r"))
    spread = np.linalg.solve(triangle.T, (fresh / size).T)
    return float(SIGMA_MM * np.sqrt(np.sum(spread**2) / len(readings.fresh_joints)))
