"""Tests of the residuals of a fit for structure, and search for the quantity that drives it.

*Places.* Structure is searched along quantities that may drive it (`drivers`), each a set of smooth functions of the
conditions with the slow ones weighted most. It is also searched in directions in which an error may act (`directions`).
An error may act at the tool point along the axes of the world or the tool, along the line of sight, on all lengths of
the arm, as a tilt of the base, or on one joint. With the functions F of a driver and the residual s along a direction,
the score is

    T = |F's|^2 / |r|^2,

which is r'Kr for the kernel K of driver and direction, without forming it. Source: Lin 1997. Each place is tested with
slow functions weighted most and with all weighted equally, because an interaction of orders 2 and 3 is hidden by the
slow functions of its two joints. The most plausible places (`likely`) share half of the chance of an alarm, all others
the other half. Source: Genovese, Roeder and Wasserman 2006.

*Chance.* Readings of one pose share its repeatability and its unmodelled error, and real residuals have tails. T is
therefore compared with that of the same residuals with random signs for whole poses, without the part that the fit
absorbs:

    r* = (I - QQ') (w o (I - B)^-1/2 r),      w = +1 or -1 for each pose,

B the blocks of QQ' that belong to one pose. If few poses determine a fit, it hides most of their errors, and would hide
them a second time. The test uses the largest value over all places by chance. Beyond the draws its logarithm is
extrapolated linearly. Sources: Davidson and Flachaire 2008 (wild bootstrap), Cameron et al. 2008 (clusters), Bell and
McCaffrey 2002 (B), Westfall and Young 1993 (smallest of many p-values), Pickands 1975 (tail).

*Readings left out.* A weak floor that yields only under the largest moments disturbs a fortieth of the readings, which
are rejected like gross errors. But gross errors do not depend on the pose. The mean of F over the readings left out is
therefore compared with that over as many poses drawn at random (`together`).

*Noise.* The residuals are compared with the declared noise and with that of repeated visits. Readings of one visit
share the rest position of the robot: unless the repeatability is declared, degrees of freedom count as if every visit
had one reading. Sources: the lack-of-fit F test, Draper and Smith ch. 2. Satterthwaite 1946.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc, fdtrc, log_ndtr

from calib.arm.kinematics import Frames, gravity_at_flange, gravity_torques
from calib.arm.robot import Robot
from calib.array import Array
from calib.data.conditions import Conditions
from calib.scan.scores import Space

DRAWS, _FEWEST_DRAWS = 199, 59
_MOST_DRAWN = 4_000_000  # limit for the drawn residuals, 32 MB
_TERMS = 40  # terms of the series of (1 - b)^-1/2: to 1 % if the fit hides 90 % of an error
_CLIP = 3.0
_TAIL = 0.2  # share of the draws from which the tail is taken


def draws(space: Space, *, clipped: bool = False, most: int = DRAWS) -> Array:
    """Draw residuals (size, 1 + B) with random signs; the first column has the actual signs.

    B is up to `most`, and fewer for many readings. If `clipped`, much larger readings count as three times the median,
    so that a few of them neither create structure nor hide it.
    """
    pose = space.fitted.readings.conditions.pose
    count = int(np.clip(_MOST_DRAWN // space.size, _FEWEST_DRAWS, most))
    signs = np.ones((pose.max() + 1, 1 + count))
    signs[:, 1:] = np.random.default_rng(0).choice((-1.0, 1.0), signs[:, 1:].shape)
    errors, residual = _freed(space, pose), space.residual
    if clipped:
        length = np.linalg.norm(errors, axis=0)
        kept = np.minimum(1.0, _CLIP * np.median(length) / np.maximum(length, 1e-300))
        errors, residual = errors * kept, residual * kept
    drawn = errors[:, :, None] * signs[pose]
    drawn[:, :, 0] = residual  # the fit hides its part of the draws as it did of the data, once
    drawn = drawn.reshape(space.size, 1 + count)
    basis = space.basis_of_readings
    return drawn - basis @ (basis.T @ drawn)


def _freed(space: Space, pose: NDArray[np.int64]) -> Array:
    """Compute (I - B)^-1/2 r, (k, n), by its series: residuals as large as the errors."""
    k, n = space.residual.shape
    basis = space.basis_of_readings.reshape(k, n, -1)
    order = np.argsort(pose, kind="stable")
    first = np.searchsorted(pose[order], np.arange(pose.max() + 1))
    term = space.residual
    total = term.copy()
    for j in range(1, _TERMS):
        shared = np.einsum("kna,kn->na", basis, term)
        of_pose = np.add.reduceat(shared[order], first, axis=0)
        term = (2.0 * j - 1.0) / (2.0 * j) * np.einsum("kna,na->kn", basis, of_pose[pose])
        total += term
    return total


@dataclass(frozen=True)
class NullDistribution:
    """Largest -log p of every draw over all places of a test, with p as from the test itself."""

    largest: Array  # (B,) ascending

    @classmethod
    def of(cls, log_p: Array) -> NullDistribution:
        """Build the distribution from log p (places, B) of the draws.

        Every place counts in full, so p may exceed 1.
        """
        return cls(np.sort(-np.min(log_p, axis=0)))

    def p_value(self, log_p: float) -> float:
        """Return the chance that the largest of all places is as large as this log p of one place."""
        count = len(self.largest)
        start = int((1.0 - _TAIL) * count)
        threshold = float(self.largest[start])
        if -log_p <= threshold:
            return (1.0 + float(np.sum(self.largest >= -log_p))) / (1.0 + count)
        mean = max(float(np.mean(self.largest[start:] - threshold)), 1e-3)
        return _TAIL * float(np.exp((threshold + log_p) / mean))


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
    """Map each driver to functions (n, m), mean square falling from 1 with their order."""
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
    """Return the side of approach of a drive whose joint another drive also turns.

    The joints are coupled by rods, or only in the counts of the controller. If rods carry the forearm, its gear turns
    as the controller counts, and so does its backlash.
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
    """Scale joints (n, N) so that the whole travel of a sliding joint is half a turn.

    A field over several joints is then equally smooth along each.
    """
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
    """Return the line of sight (n, 3) from the instrument to the target, along the tool axes."""
    view = frames.p - np.array(station)[:, None]
    along_axes = np.array([np.sum(axis * view, axis=0) for axis in (frames.x, frames.y, frames.z)])
    return (along_axes / np.maximum(np.linalg.norm(view, axis=0), 1e-9)).T


def directions(space: Space) -> dict[str, Array]:
    """Map each direction to the change (a, k, n) of the readings per unit along its a axes.

    The change is whitened reading by reading, because its drivers may differ within a visit.
    """
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
    """Compute the change (k, n) of the readings if every link grows in proportion.

    The longest link grows by 1 mm. The change is whitened as in `directions`.
    """
    robot = space.fitted.model.robot
    lengths = {f"{kind}{k + 1}": float(getattr(robot, kind)[k]) for kind in "ad" for k in range(robot.joints)}
    longest = max(max(abs(length) for length in lengths.values()), 1e-9)
    column = partial(space.fitted.readings.observed.column, space.frames)
    grown = [length / longest * column(slot) for slot, length in lengths.items() if length != 0.0]
    return np.sum(grown, axis=0) if grown else np.zeros(space.residual.shape)


def likely(driver: str, direction: str) -> bool:
    """Check if an error of this direction by this driver is plausible a priori.

    The tool point may move with any driver. A joint may move with its own angle, load or arrival. All but the tool
    point may change with time and temperature, the line of sight with its length, and the base with its overturning
    moment.
    """
    if driver in (TIME, QUICK, "temperature", _OWN.get(direction)):
        return True
    return direction.startswith("the tool point") or direction in driver


def along(axis: Array, rows: Array) -> Array:
    """Project whitened rows (size, B) on one axis (k, n), reading by reading; shape (n, B)."""
    k, n = axis.shape
    return np.einsum("kn,knb->nb", axis, rows.reshape(k, n, -1))


def _named(name: str, functions: Array) -> dict[str, Array]:
    """Return the driver without constant functions; empty if none is left."""
    varies = np.std(functions, axis=0) > 1e-9
    return {name: functions[:, varies]} if varies.any() else {}


def _waves(angle: Array, orders: int, wide: bool) -> Array:
    """Return cos and sin of 1 to `orders` half waves over the measured range, (n, 2 orders).

    If `wide`, return the first half wave and 1 to `orders` whole waves per turn, (n, 2 orders + 2): the effects of
    geometry, gears and gravity repeat after a turn.
    """
    phase = (angle - angle.min()) / np.ptp(angle) * np.pi
    numbers = range(1, orders + 1)
    if not wide:
        return np.column_stack([f(k * phase) / k for k in numbers for f in (np.cos, np.sin)])
    slow = [np.cos(phase), np.sin(phase)]
    return np.column_stack([*slow, *(f(k * angle) / k for k in numbers for f in (np.cos, np.sin))])


def _to_order(angle: Array, wide: bool) -> int:
    """Return the number of leading waves whose orders are at most _PAIRED per turn."""
    if wide:
        return _PAIRED + 1
    return int(np.clip(np.ceil(_PAIRED * np.ptp(angle) / np.pi), _PAIRED, _WAVES))


def _circle(angle: Array) -> Array:
    """Return cos and sin, (n, 2), so that angles a turn apart are the same."""
    return np.column_stack([np.cos(angle), np.sin(angle)])


def _over_range(values: Array, corner: float, last: int) -> Array:
    """Return half waves (n, last) over the range of values (n,), weights falling from a corner."""
    waves = np.arange(1, last + 1)
    phase = (values - values.min()) / max(float(np.ptp(values)), 1e-9) * np.pi
    return np.cos(np.outer(phase, waves)) * np.sqrt(2.0 / (1.0 + (waves / corner) ** 2))


def _lasting(order: Array, first: int, last: int, corner: float) -> Array:
    """Return half waves over the campaign by rank in time, for lasting errors."""
    rank = np.argsort(np.argsort(order, kind="stable"), kind="stable")
    waves = np.arange(first, max(min(len(order) // 4, last), first) + 1)
    phase = (rank + 0.5) / len(order) * np.pi
    return np.cos(np.outer(phase, waves)) * np.sqrt(2.0 / (1.0 + (waves / corner) ** 2))


def _products(one: Array, other: Array) -> Array:
    return np.einsum("ni,nj->nij", one, other).reshape(len(one), -1)


def _powers(values: Array, degree: int) -> Array:
    """Return weighted Legendre polynomials (n, degree) over the range; 0 for a constant."""
    if not np.all(np.isfinite(values)):
        return np.zeros((len(values), degree))
    low, high = np.quantile(values, (0.02, 0.98))
    if high - low <= _STILL * (1.0 + np.max(np.abs(values))):
        return np.zeros((len(values), degree))
    x = np.clip(2.0 * (values - low) / (high - low) - 1.0, -1.2, 1.2)
    return np.polynomial.legendre.legvander(x, degree)[:, 1:] * np.sqrt(2.0 / np.arange(1, degree + 1))


def _quadratic(vectors: Array) -> Array:
    """Return linear and quadratic functions (n, 9) of vectors (n, 3)."""
    x = (vectors - vectors.mean(axis=0)) / np.maximum(vectors.std(axis=0), 1e-9)
    pairs = [(i, j) for i in range(3) for j in range(i, 3)]
    return np.column_stack([x, *(0.5 * x[:, i] * x[:, j] for i, j in pairs)])


def _field(coordinates: Array, width: float = _WIDTH) -> Array:
    """Return random Fourier features (n, m) of a Gaussian kernel over (n, d).

    Source: Rahimi and Recht 2007.
    """
    rng = np.random.default_rng(0)
    waves = rng.normal(size=(coordinates.shape[1], _FIELDS)) / width
    return np.cos(coordinates @ waves + rng.uniform(0.0, 2.0 * np.pi, _FIELDS)) * np.sqrt(2.0)


def _region(point: Array) -> Array:
    """Return smooth fields over the workspace (n, m), as wide as the points spread and narrower."""
    spread = np.maximum(np.sqrt(np.mean(np.var(point, axis=0))), 1e-9)
    place = (point - point.mean(axis=0)) / spread
    return np.column_stack([0.4 * _field(place, width) for width in (1.0, 0.6)])


def pauses(conditions: Conditions) -> Array:
    """Compute the time since the previous reading, s, shape (n,); 0 for the first."""
    in_time = np.argsort(conditions.order)
    time = conditions.time[in_time]
    pause = np.empty(len(time))
    pause[in_time] = np.maximum(np.diff(time, prepend=time[0]), 0.0)
    return pause


ALARM = 0.001  # chance that a data set without structure raises an alarm, over all places
# Rate of alarms if declared noise does not explain the residual, which alone is rarer than an alarm
SUSPECT = 0.01
_MOST_READINGS = 3000  # readings that are tested, from poses drawn at random
_MOST_PLACES, _MOST_DIRECTIONS = 8, 3
_SKEWNESS = 0.1, 8.0  # of a sum of squares: nearly normal, to carried by one
# Draws that determine how rare the largest of all places is; fewer for many readings.
_MOST_DRAWS, _MOST_NUMBERS = 999, 600_000
_ABSORBED = 0.05  # share of a place's signal that the model must not absorb
_FAINT = 1e-4  # mean square of a function that is hardly one
_SAME = 1e-6  # of a function whose mean square is about 1
_LEAST_SHARE = 0.0005  # least share of the residual that a place must explain
_CHANCE_OF_SHARE = 3.0  # standard deviations by which the share of a set of functions varies by chance
_FEWEST_ACTING = 10.0  # fewest readings over which the functions of a driver act


@dataclass(frozen=True)
class ResidualStructure:
    """Remaining structure: driver, what it acts on, p-value, and share of the variance."""

    where: str
    p_value: float
    explained_variance: float
    acts_on: str = "the tool point"


def left_over(space: Space, alarm: float = ALARM) -> list[ResidualStructure]:
    """Find the drivers of remaining structure with p-values below `alarm`.

    The driver that explains most comes first.
    """
    if space.freedom <= 0 or space.rss <= 0.0:
        return []
    some = _some(space)
    rows = draws(space, clipped=True, most=max(min(_MOST_DRAWS, _MOST_NUMBERS // space.size), DRAWS))
    length = np.linalg.norm(rows, axis=0)
    if not np.all(length > 0.0):  # most readings fit exactly, so that clipping leaves nothing
        return []
    rows /= length
    functions = {name: f[some] for name, f in drivers(space).items() if _spread(f[some]) > _FEWEST_ACTING}
    squared = np.array([np.sum(f**2, axis=1) for f in functions.values()])
    pulled, alike = space.pulled(rows), _alike(space, functions, some)
    # Single precision does not affect the chance, and this step takes most of the time of a diagnosis without findings
    stacked = np.ascontiguousarray(np.hstack(list(functions.values())).T, dtype=np.float32)
    first = np.cumsum([0, *(f.shape[1] for f in functions.values())])[:-1]
    even = (1.0 / np.maximum(np.mean(stacked**2, axis=1), _FAINT))[:, None]
    names: list[tuple[str, str]] = []
    each = np.zeros((0, rows.shape[1]))
    acting = directions(space)
    for direction, axes in acting.items():
        squares = sum((stacked @ along(axis, pulled)[some].astype(np.float32)) ** 2 for axis in axes)
        scores = np.add.reduceat(squares, first, axis=0)
        evenly = np.add.reduceat(squares * even, first, axis=0)
        of_visits = np.sum(space.fitted.readings.observed.by_visit(axes)[:, :, some] ** 2, axis=(0, 1))
        of_readings = np.sum(axes[:, :, some] ** 2, axis=(0, 1))
        raw = np.where(alike, squared @ of_visits, squared @ of_readings) / space.freedom
        seen = np.mean(scores[:, 1:], axis=1) > _ABSORBED * raw
        each = np.vstack([each, log_p_of(scores[seen].astype(float), evenly[seen].astype(float))])
        names += [(driver, direction) for driver, kept in zip(functions, seen, strict=True) if kept]
    first_of = np.array([likely(*name) for name in names])
    each += np.log(np.where(first_of, np.sum(first_of), np.sum(~first_of)) + 1e-9)[:, None]
    chance = NullDistribution.of(each[:, 1:])
    found: dict[str, list[ResidualStructure]] = {}
    for i in np.argsort(each[:, 0]).tolist():
        driver, acts_on = names[i]
        p_value = chance.p_value(float(each[i, 0]))
        if p_value >= alarm or (driver not in found and len(found) == _MOST_PLACES):
            break
        if len(found.setdefault(driver, [])) < _MOST_DIRECTIONS:
            share = _share(space, functions[driver], acting[acts_on], some)
            found[driver].append(ResidualStructure(driver, p_value, share, acts_on))
    # Beyond all doubt p-values rank no more: what a place explains does. What any function of the joints would show
    # names no place where a narrower one does.
    places = [max(of_driver, key=lambda s: s.explained_variance) for of_driver in found.values()]
    places = [place for place in places if place.explained_variance >= _LEAST_SHARE]
    places.sort(key=lambda s: (s.where == TOGETHER, -s.explained_variance))
    if places:
        best = places[0]
        rows = space.rows * len(some) / space.residual.shape[1]
        chance = _CHANCE_OF_SHARE * np.sqrt(2.0 * functions[best.where].shape[1]) / rows
        alike = [s for s in places if best.explained_variance - s.explained_variance < chance]
        simplest = min(alike, key=lambda s: _variables(s.where))
        if _variables(simplest.where) < _variables(best.where):
            places.insert(0, places.pop(places.index(simplest)))
    return places


def _variables(driver: str) -> int:
    """Return the number of quantities that a driver needs."""
    return 3 if driver == TOGETHER else 1 + driver.count(" and ")


def _some(space: Space) -> NDArray[np.int64]:
    """Select the readings to test: all, or those of poses drawn at random."""
    pose = space.fitted.readings.conditions.pose
    if len(pose) <= _MOST_READINGS:
        return np.arange(len(pose))
    rank = np.random.default_rng(1).permutation(int(pose.max()) + 1)[pose]
    return np.sort(np.argsort(rank, kind="stable")[:_MOST_READINGS])


def _alike(space: Space, functions: Mapping[str, Array], some: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Mark the drivers whose functions are the same in all readings of a visit.

    The functions (s, m) are those over the readings `some` (s,).
    """
    _, first, visit = np.unique(
        space.fitted.readings.conditions.visit[some], return_index=True, return_inverse=True
    )
    one = first[visit.reshape(-1)]
    return np.array([bool(np.all(np.abs(f - f[one]) < _SAME)) for f in functions.values()])


def _spread(functions: Array) -> float:
    """Count the readings over which functions (n, m) act; one or two are not enough."""
    weight = np.sum((functions - functions.mean(axis=0)) ** 2, axis=1)
    return float(np.sum(weight) ** 2 / max(np.sum(weight**2), 1e-300))


def log_p_of(*statistics: Array) -> Array:
    """Compute the log of the chance that draws exceed each value (tests, 1 + B), the data first.

    For several statistics of the same tests, the smallest counts.
    """
    return log_ndtr(np.min([_deviate(values) for values in statistics], axis=0))


def _deviate(values: Array) -> Array:
    """Convert values (tests, 1 + B) to normal deviates, high values negative.

    A gamma law is fitted to mean, variance and skewness of the draws (of the other draws for a draw itself). Mean and
    variance alone overstate the significance if few readings determine a place. Sources: Pearson's type III. Wilson and
    Hilferty 1931, which does not underflow.
    """
    size = np.maximum(np.mean(values[:, 1:], axis=1, keepdims=True), 1e-300)
    values = values / size
    count = np.full(values.shape[1], values.shape[1] - 2.0)
    count[0] += 1.0
    powers = []
    for k in (1, 2, 3):
        power = values**k
        total = np.sum(power[:, 1:], axis=1, keepdims=True)
        power[:, 1:] = total - power[:, 1:]
        power[:, :1] = total
        powers.append(power / count)
    mean, square, cube = powers
    # of the draws about a mean of 1; where one draw holds all that a place has, the others have neither
    variance = np.maximum(square - mean**2, np.maximum(1e-6 * mean**2, 1e-12))
    spread = np.sqrt(variance)
    skewness = np.clip((cube - 3.0 * mean * square + 2.0 * mean**3) / (variance * spread), *_SKEWNESS)
    shape = 4.0 / skewness**2
    gamma = np.maximum(1.0 + (values - mean) / (spread * np.sqrt(shape)), 1e-9)
    return -(np.cbrt(gamma) - 1.0 + 1.0 / (9.0 * shape)) * 3.0 * np.sqrt(shape)


def _share(space: Space, functions: Array, axes: Array, some: NDArray[np.int64]) -> float:
    """Compute the share of remaining variance that functions explain along some axes.

    It is adjusted for the number of functions. If there are more than a third of the rows, the first ones count, since
    as many as rows would explain everything.
    """
    n = len(functions)
    measured = space.rows * n // space.residual.shape[1]
    functions = functions[:, : max(measured // (3 * len(axes)), 1)]
    columns = np.einsum("akn,nf->afkn", axes[:, :, some], functions)
    columns = space.fitted.readings.observed.take(some).by_visit(columns)
    columns = columns.reshape(-1, space.residual.shape[0] * n).T
    left = space.residual[:, some].ravel()
    u, s, _ = np.linalg.svd(columns, full_matrices=False)
    u = u[:, s > 1e-3 * max(float(s[0]), 1e-300)]
    rows = max(measured, u.shape[1] + 1)
    gain, total = float(np.sum((u.T @ left) ** 2)), float(left @ left)
    return float(np.clip(1.0 - (1.0 - gain / total) * rows / max(rows - u.shape[1], 1), 0.0, 1.0))


ACTS_ON = "the readings left out"
_FEWEST_LEFT_OUT = 4  # poses left out
_DRAWS = 399
_MOST_TOGETHER = 4


def together(space: Space, out: NDArray[np.bool_]) -> list[ResidualStructure]:
    """Find drivers along which the readings of a mask `out` (n,) cluster, most certain first."""
    pose = space.fitted.readings.conditions.pose
    count = np.bincount(pose)
    spoilt = np.bincount(pose, out) > 0.0
    if spoilt.sum() < _FEWEST_LEFT_OUT or spoilt.all():
        return []
    rng = np.random.default_rng(2)
    drawn = np.zeros((len(count), 1 + _DRAWS))
    drawn[:, 0] = spoilt
    for b in range(1, 1 + _DRAWS):
        drawn[rng.permutation(len(count))[: int(spoilt.sum())], b] = 1.0
    driven = drivers(space)
    values = []
    for functions in driven.values():
        of_pose = np.array([np.bincount(pose, column) for column in functions.T]) / count
        values.append(np.sum(((of_pose - of_pose.mean(axis=1, keepdims=True)) @ drawn) ** 2, axis=0))
    log_p = log_p_of(np.array(values))
    chance = NullDistribution.of(log_p[:, 1:])
    found = sorted((chance.p_value(float(log_p[i, 0])), name) for i, name in enumerate(driven))
    return [
        ResidualStructure(name, p_value, _share_of_choice(driven[name], out), ACTS_ON)
        for p_value, name in found[:_MOST_TOGETHER]
        if p_value < ALARM
    ]


def _share_of_choice(functions: Array, out: NDArray[np.bool_]) -> float:
    """Compute the share of the choice of left-out readings that functions (n, m) explain.

    It is adjusted for the number of functions.
    """
    values = out - np.mean(out)
    columns = functions - functions.mean(axis=0)
    u, s, _ = np.linalg.svd(columns, full_matrices=False)
    u = u[:, s > 1e-3 * max(float(s[0]), 1e-300)]
    rows = max(len(out), u.shape[1] + 2)
    unexplained = 1.0 - float(np.sum((u.T @ values) ** 2) / (values @ values))
    return float(np.clip(1.0 - unexplained * (rows - 1) / (rows - 1 - u.shape[1]), 0.0, 1.0))


NOISY = 0.001  # chance that noise of the declared size fails the chi-square
EACH_POSE = "each pose by itself, the same at every visit"
_FEWEST_REPEATS = 30  # fewest rows that determine the noise from repeats


def p_lack_of_fit(space: Space) -> float:
    """Compute the p-value of the residuals for the declared noise."""
    freedom = max(space.rows - float(np.sum(space.basis_of_readings**2)), 1.0)
    apart = _apart(space, len(space.fitted.readings.rows))
    return float(chdtrc(freedom * apart, float(np.sum(space.residual**2)) * apart))


def p_beyond_repeats(space: Space) -> float | None:
    """Compute the p-value of the residuals for the noise of repeated readings; None for too few.

    Repeats are visits to one pose with one target, approached from the same sides. Their differences are noise, which
    includes the robot's repeatability.
    """
    conditions = space.fitted.readings.conditions
    found = _between(space, np.column_stack([_place(conditions), conditions.side.astype(np.int64)]))
    return None if found is None else found[0]


def each_pose(space: Space) -> list[ResidualStructure]:
    """Find an error that is specific to each pose and target, and the same at every visit."""
    found = _between(space, _place(space.fitted.readings.conditions))
    if found is None or found[0] >= ALARM:
        return []
    return [ResidualStructure(EACH_POSE, *found)]


def _place(conditions: Conditions) -> NDArray[np.int64]:
    """Return pose, tool target, base target and series of each reading, (n, 4)."""
    return np.column_stack([conditions.pose, conditions.target, conditions.anchor, conditions.series])


def _between(space: Space, alike: NDArray[np.int64]) -> tuple[float, float] | None:
    """Test if groups of equal rows of `alike` (n, c) differ more than visits within the groups.

    Returns the chance and the share of the residual that the groups explain beyond it. Returns None if there are too
    few repeated visits, or no more groups than parameters of the model.
    """
    readings = space.fitted.readings
    groups = np.unique(alike, axis=0, return_inverse=True)[1].reshape(-1)
    _, first, one = np.unique(
        np.column_stack([groups, readings.conditions.visit]),
        axis=0,
        return_index=True,
        return_inverse=True,
    )
    visits = _means(space.residual, one.reshape(-1))
    group, rows = groups[first], readings.observed.freedom[first]
    middle = _means(visits, group)
    of_groups = int(rows[np.unique(group, return_index=True)[1]].sum())
    pure, left = int(rows.sum()) - of_groups, of_groups - space.basis.shape[1]
    if pure < _FEWEST_REPEATS or left <= 0:
        return None
    within = float(np.sum((visits - middle[:, group]) ** 2))
    between = float(np.sum(middle**2 * np.bincount(group)))
    noise = max(within / pure, 1e-300)
    apart = _apart(space, len(first))
    p_value = float(fdtrc(max(left * apart, 1.0), max(pure * apart, 1.0), between / left / noise))
    return p_value, max(between - left * noise, 0.0) / (between + within)


def _apart(space: Space, readings: int) -> float:
    """Return the share of `readings` that are independent.

    All are if the error that a visit shares is declared, since it is whitened already. Otherwise one per visit is.
    """
    if space.fitted.readings.observed.shared is not None:
        return 1.0
    return len(np.unique(space.fitted.readings.conditions.visit)) / readings


def _means(values: Array, group: NDArray[np.int64]) -> Array:
    """Compute the mean (k, groups) of the columns of values (k, n) that belong to each group."""
    return np.array([np.bincount(group, row) for row in values]) / np.bincount(group)
