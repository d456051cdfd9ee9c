"""Where structure may live: what may drive it, and along which directions it may act.

Each driver is some smooth functions of the conditions, weighted so that the slow ones count most; they claim no cause.
An error acts at the tool point along the world's axes or the tool's, or turns one joint.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np

from calib.conditions import Conditions
from calib.diagnose.space import Space
from calib.kinematics import Array

TOGETHER = "joint angles together"
_WAVES = 5
_FIELDS = 96
_WIDTH = 1.2  # rad: correlation length of a field over several joints
_STILL = 1e-6


def drivers(space: Space) -> dict[str, Array]:
    """Name of each driver -> (n, m) functions of it, mean square falling from 1 with their order."""
    conditions = space.fitted.readings.conditions
    joints = range(conditions.joints.shape[1])
    moving = [k for k in joints if np.ptp(conditions.joints[:, k]) > _STILL]
    waves = {k: _waves(conditions.joints[:, k], _WAVES) for k in moving}
    found = {f"joint {k + 1} angle": waves[k] for k in moving}
    for j, k in combinations(moving, 2):
        found[f"joint {j + 1} and joint {k + 1} angles"] = _products(waves[j][:, :6], waves[k][:, :6])
    if len(moving) > 2:
        found[TOGETHER] = _field(conditions.joints[:, moving])
    for k in joints:
        load = _powers(conditions.torque[:, k], 5)
        found |= _named(f"torque about joint {k + 1}", load)
        found |= _named(f"moment across joint {k + 1}", _quadratic(conditions.moment[:, k]))
        if k in waves:
            side = conditions.side[:, k, None]
            beside = np.column_stack([waves[k][:, :4], load[:, :2]])
            found |= _named(f"side of approach of joint {k + 1}", np.column_stack([side, side * beside]))
            moved = _powers(conditions.joints[:, k] - conditions.previous[:, k], 4)
            found |= _named(f"last move of joint {k + 1}", moved)
    found |= _named("overturning moment", _quadratic(conditions.overturning))
    return found | _outside_the_arm(space, conditions)


def _outside_the_arm(space: Space, conditions: Conditions) -> dict[str, Array]:
    frames, n = space.frames, len(conditions)
    found: dict[str, Array] = {}
    if np.all(np.isfinite(conditions.time)) and np.ptp(conditions.time) > 0.0:
        found["time"] = np.column_stack([_powers(conditions.order, 5), _waves(conditions.order, 8)])
        found |= _named("time since the last move", _powers(np.log1p(_pauses(conditions)), 3))
    if np.all(np.isfinite(conditions.temperature)):
        found |= _named("temperature", _powers(conditions.temperature, 3))
    # Predicted places: a measured one contains the residual, and would explain it by itself.
    point = np.broadcast_to(frames.p, (3, n)).T
    found |= _named("region of the workspace", np.column_stack([_quadratic(point), _region(point)]))
    found |= _named("direction of the tool", _quadratic(np.broadcast_to(frames.z, (3, n)).T))
    view = point - np.array(space.fitted.model.station)
    distance = np.linalg.norm(view, axis=1, keepdims=True)
    found |= _named("direction of view", _quadratic(view / np.maximum(distance, 1e-9)))
    found |= _named("tool target", np.eye(len(conditions.target_names))[conditions.target])
    return found


def directions(space: Space) -> dict[str, Array]:
    """Name of each direction -> (a, k, n) whitened change of the readings for a unit along each of its a axes."""
    conditions, frames = space.fitted.readings.conditions, space.frames
    n, observed = len(conditions), space.fitted.readings.observed
    world = np.broadcast_to(np.eye(3)[:, :, None], (3, 3, n))
    tool = np.stack([np.broadcast_to(axis, (3, n)) for axis in (frames.x, frames.y, frames.z)])
    found = {
        name: observed.displaced(frames, axes)
        for name, axes in (("the tool point", world), ("the tool point, along the tool's axes", tool))
    }
    for k in range(conditions.joints.shape[1]):
        found[f"joint {k + 1}"] = space.slot(f"theta{k + 1}")[None]
    return found


def along(axis: Array, rows: Array) -> Array:
    """(n, B) what rows (size, B), whitened, have along one axis (k, n), reading by reading."""
    k, n = axis.shape
    return np.einsum("kn,knb->nb", axis, rows.reshape(k, n, -1))


def _named(name: str, functions: Array) -> dict[str, Array]:
    """The driver, less functions that are the same for all readings; none where no function is left."""
    varies = np.std(functions, axis=0) > 1e-9
    return {name: functions[:, varies]} if varies.any() else {}


def _waves(angle: Array, orders: int) -> Array:
    """cos and sin over the measured range, 1 to `orders` half waves, (n, 2 orders)."""
    phase = (angle - angle.min()) / np.ptp(angle) * np.pi
    return np.column_stack([f(k * phase) / k for k in range(1, orders + 1) for f in (np.cos, np.sin)])


def _products(one: Array, other: Array) -> Array:
    return np.einsum("ni,nj->nij", one, other).reshape(len(one), -1)


def _powers(values: Array, degree: int) -> Array:
    """Legendre polynomials over the range of the values, (n, degree), weights falling; zeros for a constant."""
    if not np.all(np.isfinite(values)):
        return np.zeros((len(values), degree))
    low, high = np.quantile(values, (0.02, 0.98))
    if high - low <= _STILL * (1.0 + np.max(np.abs(values))):
        return np.zeros((len(values), degree))
    x = np.clip(2.0 * (values - low) / (high - low) - 1.0, -1.2, 1.2)
    return np.polynomial.legendre.legvander(x, degree)[:, 1:] * np.sqrt(2.0 / np.arange(1, degree + 1))


def _quadratic(vectors: Array) -> Array:
    """Linear and quadratic functions of (n, 3) vectors, (n, 9)."""
    x = (vectors - vectors.mean(axis=0)) / np.maximum(vectors.std(axis=0), 1e-9)
    pairs = [(i, j) for i in range(3) for j in range(i, 3)]
    return np.column_stack([x, *(0.5 * x[:, i] * x[:, j] for i, j in pairs)])


def _field(coordinates: Array, width: float = _WIDTH) -> Array:
    """(n, m) random Fourier features of a Gaussian kernel over (n, d). Source: Rahimi and Recht 2007."""
    rng = np.random.default_rng(0)
    waves = rng.normal(size=(coordinates.shape[1], _FIELDS)) / width
    return np.cos(coordinates @ waves + rng.uniform(0.0, 2.0 * np.pi, _FIELDS)) * np.sqrt(2.0)


def _region(point: Array) -> Array:
    spread = np.maximum(np.sqrt(np.mean(np.var(point, axis=0))), 1e-9)
    return 0.3 * _field((point - point.mean(axis=0)) / spread, 1.0)


def _pauses(conditions: Conditions) -> Array:
    """(n,) s since the reading before, 0 where none was."""
    in_time = np.argsort(conditions.order)
    time = conditions.time[in_time]
    pause = np.empty(len(time))
    pause[in_time] = np.maximum(np.diff(time, prepend=time[0]), 0.0)
    return pause
