"""The places where the residuals are tested for structure: quantities that may drive it, and directions of action.

Each driver is a set of smooth functions of the conditions, the slow ones weighted most; it names no cause.
An error acts at the tool point along the world's axes or the tool's, along the line of sight, on all lengths of the
arm, tilts the base (or the instrument beside it), or turns one joint.
"""

from __future__ import annotations

from functools import partial
from itertools import combinations

import numpy as np

from calib.arm.kinematics import Frames, gravity_at_flange, gravity_torques
from calib.arm.robot import Robot
from calib.array import Array
from calib.data.conditions import Conditions
from calib.scan.space import Space

TOGETHER = "joint angles together"
TIME = "time"
QUICK = "time, from one reading to the next"
SIGHT = "the line of sight"
OVERTURNING = "overturning moment"
LENGTHS = "the lengths of the arm"
DISTANCE = "distance from the instrument"
BASE = "the tilt of the base"  # about the vertical it turns as joint 1 does
SEEN = "is seen by the instrument"  # side of the tool
_WAVES = 5
_PAIRED = 3  # orders of a turn of each of two joints, and half waves of one that turns little
_WIDE = 1.5 * np.pi  # rad: a joint that turned further has the orders of its turn, too
_FIELDS = 96
_PLACES = 25.0  # steps to which the spread of the predicted places is rounded
_WIDTH = 1.2  # rad: correlation length of a field over several joints
_STILL = 1e-6
_OWN = {SIGHT: DISTANCE, BASE: OVERTURNING}  # what drives a direction by itself
_SLOW, _SLOW_TO = 5.0, 12  # half waves over a campaign: as of a drift, of warmth
_QUICK_FROM, _QUICK, _QUICK_TO = 6, 20.0, 80
_FAR = 16  # half waves over the range of distances: as of a meter that errs with its modulation


def drivers(space: Space) -> dict[str, Array]:
    """Name of each driver -> (n, m) functions of it, mean square falling from 1 with their order."""
    conditions, robot = space.fitted.readings.conditions, space.fitted.model.robot
    joints = range(conditions.joints.shape[1])
    names = [axis.removeprefix("j") for axis in robot.axes]
    moving = [k for k in joints if np.ptp(conditions.joints[:, k]) > _STILL]
    wide = [k for k in moving if robot.kinds[k] == "turns" and np.ptp(conditions.joints[:, k]) > _WIDE]
    waves = {k: _waves(conditions.joints[:, k], _WAVES, k in wide) for k in moving}
    paired = {k: waves[k][:, : 2 * _to_order(conditions.joints[:, k], k in wide)] for k in moving}
    found = {f"joint {names[k]} angle": waves[k] for k in moving}
    for j, k in combinations(moving, 2):
        found[f"joint {names[j]} and joint {names[k]} angles"] = _products(paired[j], paired[k])
    if len(moving) > 2:
        angles = _as_angles(conditions.joints, robot)
        turned = [_circle(angles[:, k]) if k in wide else angles[:, [k]] for k in moving]
        found[TOGETHER] = _field(np.hstack(turned))
    before = gravity_torques(
        robot, conditions.previous, space.fitted.header.loads, space.fitted.header.gravity
    )
    for k in joints:
        load = _powers(conditions.torque[:, k], 5)
        found |= _named(f"torque about joint {names[k]}", load)
        found |= _named(f"moment across joint {names[k]}", _quadratic(conditions.moment[:, k]))
        if k in waves:
            side = conditions.side[:, k, None]
            beside = np.column_stack([waves[k][:, :8], load[:, :3]])
            found |= _named(f"side of approach of joint {names[k]}", np.column_stack([side, side * beside]))
            moved = _powers(conditions.joints[:, k] - conditions.previous[:, k], 4)
            found |= _named(f"last move of joint {names[k]}", moved)
            earlier = conditions.earlier[:, k]
            earlier = np.column_stack([np.sign(earlier), _powers(earlier, 3)])
            found |= _named(f"last move but one of joint {names[k]}", earlier)
            unloaded = _powers(conditions.torque[:, k] - before[:, k], 4)
            found |= _named(f"last change of torque about joint {names[k]}", unloaded)
    found |= _named(OVERTURNING, _quadratic(conditions.overturning))
    found |= _drives(robot, conditions, space.fitted.header.coupling)
    return found | _outside_the_arm(space, conditions)


def _drives(robot: Robot, conditions: Conditions, coupling: str) -> dict[str, Array]:
    """The side from which a drive came whose joint another drive turns as well: by rods, or as it is counted only.

    Where rods carry the forearm its gear turns as the controller counts, and so does what its gear has of play.
    """
    if coupling == "none":
        return {}
    mixed = np.count_nonzero(np.array(robot.joint_matrices[coupling].matrix), axis=1) > 1
    now, before = (robot.controller_angles(q, coupling) for q in (conditions.joints, conditions.previous))
    found: dict[str, Array] = {}
    for k in np.flatnonzero(mixed & (np.ptp(now, axis=0) > _STILL)):
        side = np.sign(now[:, k] - before[:, k])[:, None]
        beside = np.column_stack([_circle(now[:, k]), _powers(conditions.torque[:, k], 3)])
        name = f"side of approach of joint {robot.axes[k].removeprefix('j')} as its controller counts it"
        found |= _named(name, np.column_stack([side, side * beside]))
    return found


def _as_angles(joints: Array, robot: Robot) -> Array:
    """(n, N) joints with the whole travel of a slide as half a turn: a field over several is as smooth along each."""
    travel = np.array(robot.upper) - np.array(robot.lower)
    return joints * np.where([kind == "slides" for kind in robot.kinds], np.pi / travel, 1.0)


def _outside_the_arm(space: Space, conditions: Conditions) -> dict[str, Array]:
    frames, n = space.frames, len(conditions)
    found: dict[str, Array] = {}
    if np.all(np.isfinite(conditions.time)) and np.ptp(conditions.time) > 0.0:
        found[TIME] = _lasting(conditions.order, 1, _SLOW_TO, _SLOW)
        found[QUICK] = _lasting(conditions.order, _QUICK_FROM, _QUICK_TO, _QUICK)
        found |= _named("time since the last move", _powers(np.log1p(pauses(conditions)), 3))
    if np.all(np.isfinite(conditions.temperature)):
        found |= _named("temperature", _powers(conditions.temperature, 3))
    # Predicted places: a measured one contains the residual, and would explain it by itself.
    # Rounded, since where few places are measured again and again the predicted one is the place less the residual.
    point = np.broadcast_to(frames.p, (3, n)).T
    step = max(float(np.sqrt(np.mean(np.var(point, axis=0)))), 1e-9) / _PLACES
    point = np.round(point / step) * step
    found |= _named("region of the workspace", np.column_stack([_quadratic(point), _region(point)]))
    found |= _named("direction of the tool", _quadratic(np.broadcast_to(frames.z, (3, n)).T))
    view = point - np.array(space.fitted.model.station)
    distance = np.linalg.norm(view, axis=1, keepdims=True)
    found |= _named("direction of view", _quadratic(view / np.maximum(distance, 1e-9)))
    found |= _named(DISTANCE, _over_range(distance[:, 0], _SLOW, _FAR))
    target = np.eye(len(conditions.target_names))[conditions.target]
    found |= _named("tool target", target)
    down = gravity_at_flange(space.fitted.model.robot, conditions.joints, space.fitted.header.gravity)
    seen = np.broadcast_to(sight_at_tool(frames, space.fitted.model.station), (n, 3))
    for side, at_tool in (("is down", down), (SEEN, seen)):
        found |= _named(f"side of the tool that {side}", _quadratic(at_tool))
        if np.ptp(conditions.target) > 0:
            by_target = _products(target, _quadratic(at_tool))
            found |= _named(f"tool target and the side that {side}", by_target)
    return found


def sight_at_tool(frames: Frames, station: tuple[float, float, float]) -> Array:
    """(n, 3) the line of sight from the instrument's place to the target, along the axes of the tool."""
    view = frames.p - np.array(station)[:, None]
    along_axes = np.array([np.sum(axis * view, axis=0) for axis in (frames.x, frames.y, frames.z)])
    return (along_axes / np.maximum(np.linalg.norm(view, axis=0), 1e-9)).T


def directions(space: Space) -> dict[str, Array]:
    """Name of each direction -> (a, k, n) change of the readings for a unit along each of its a axes, whitened reading
    by reading: what drives it may differ within a visit."""
    conditions, frames = space.fitted.readings.conditions, space.frames
    n, observed = len(conditions), space.fitted.readings.observed
    world = np.broadcast_to(np.eye(3)[:, :, None], (3, 3, n))
    tool = np.stack([np.broadcast_to(axis, (3, n)) for axis in (frames.x, frames.y, frames.z)])
    found = {
        name: observed.displaced(frames, axes)
        for name, axes in (("the tool point", world), ("the tool point, along the tool's axes", tool))
    }
    view = np.broadcast_to(frames.p, (3, n)) - np.array(space.fitted.model.station)[:, None]
    found[SIGHT] = observed.displaced(frames, (view / np.maximum(np.linalg.norm(view, axis=0), 1e-9))[None])
    found[LENGTHS] = _growth(space)[None]
    found[BASE] = np.stack([observed.column(frames, slot) for slot in ("base.rx", "base.ry")])
    robot = space.fitted.model.robot
    for axis, slot in zip(robot.axes, robot.joint_slots, strict=True):
        found[f"joint {axis.removeprefix('j')}"] = observed.column(frames, slot)[None]
    return found


def _growth(space: Space) -> Array:
    """(k, n) change of the readings when every link grows in proportion, by 1 mm where it is longest; whitened as
    `directions`."""
    robot = space.fitted.model.robot
    lengths = {f"{kind}{k + 1}": float(getattr(robot, kind)[k]) for kind in "ad" for k in range(robot.joints)}
    longest = max(max(abs(length) for length in lengths.values()), 1e-9)
    column = partial(space.fitted.readings.observed.column, space.frames)
    grown = [length / longest * column(slot) for slot, length in lengths.items() if length != 0.0]
    return np.sum(grown, axis=0) if grown else np.zeros(space.residual.shape)


def likely(driver: str, direction: str) -> bool:
    """Whether an error of this direction is what one would look for first: it moves the tool point whatever drives it,
    a joint where that joint's own angle, load or arrival drives it, all but the tool point by time and warmth, the
    sight by its length, and the base by the moment that overturns it."""
    if driver in (TIME, QUICK, "temperature", _OWN.get(direction)):
        return True
    return direction.startswith("the tool point") or direction in driver


def along(axis: Array, rows: Array) -> Array:
    """(n, B) what rows (size, B), whitened, have along one axis (k, n), reading by reading."""
    k, n = axis.shape
    return np.einsum("kn,knb->nb", axis, rows.reshape(k, n, -1))


def _named(name: str, functions: Array) -> dict[str, Array]:
    """The driver, less functions that are the same for all readings; none where no function is left."""
    varies = np.std(functions, axis=0) > 1e-9
    return {name: functions[:, varies]} if varies.any() else {}


def _waves(angle: Array, orders: int, wide: bool) -> Array:
    """cos and sin over the measured range, 1 to `orders` half waves, (n, 2 orders). wide: the first half wave, and 1 to
    `orders` whole waves a turn, (n, 2 orders + 2): what geometry, gears and gravity do comes back after a turn."""
    phase = (angle - angle.min()) / np.ptp(angle) * np.pi
    numbers = range(1, orders + 1)
    if not wide:
        return np.column_stack([f(k * phase) / k for k in numbers for f in (np.cos, np.sin)])
    slow = [np.cos(phase), np.sin(phase)]
    return np.column_stack([*slow, *(f(k * angle) / k for k in numbers for f in (np.cos, np.sin))])


def _to_order(angle: Array, wide: bool) -> int:
    """The number of leading waves whose orders are at most _PAIRED per turn."""
    if wide:
        return _PAIRED + 1
    return int(np.clip(np.ceil(_PAIRED * np.ptp(angle) / np.pi), _PAIRED, _WAVES))


def _circle(angle: Array) -> Array:
    """(n, 2) cos and sin, so that angles a turn apart are the same."""
    return np.column_stack([np.cos(angle), np.sin(angle)])


def _over_range(values: Array, corner: float, last: int) -> Array:
    """(n, last) half waves over the range of values (n,), weights falling from a corner on."""
    waves = np.arange(1, last + 1)
    phase = (values - values.min()) / max(float(np.ptp(values)), 1e-9) * np.pi
    return np.cos(np.outer(phase, waves)) * np.sqrt(2.0 / (1.0 + (waves / corner) ** 2))


def _lasting(order: Array, first: int, last: int, corner: float) -> Array:
    """Half waves over the campaign, by rank in time: the shape of an error that lasts from reading to reading."""
    rank = np.argsort(np.argsort(order, kind="stable"), kind="stable")
    waves = np.arange(first, max(min(len(order) // 4, last), first) + 1)
    phase = (rank + 0.5) / len(order) * np.pi
    return np.cos(np.outer(phase, waves)) * np.sqrt(2.0 / (1.0 + (waves / corner) ** 2))


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
    """Smooth fields over the workspace (n, m), as wide as the spread of the points and narrower."""
    spread = np.maximum(np.sqrt(np.mean(np.var(point, axis=0))), 1e-9)
    place = (point - point.mean(axis=0)) / spread
    return np.column_stack([0.4 * _field(place, width) for width in (1.0, 0.6)])


def pauses(conditions: Conditions) -> Array:
    """(n,) s since the reading before, 0 where none was."""
    in_time = np.argsort(conditions.order)
    time = conditions.time[in_time]
    pause = np.empty(len(time))
    pause[in_time] = np.maximum(np.diff(time, prepend=time[0]), 0.0)
    return pause
