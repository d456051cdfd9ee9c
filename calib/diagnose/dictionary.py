"""Dictionary of carried terms: every slot of the chain times every available condition.

A condition is a function of one recorded quantity (time, air, joint angle, torque, side of approach, last move), or of
two joint angles together. An entry is one condition on one slot. Its columns are the whitened derivative of the
readings by the slot times the values of the condition. Entries of one kind share a price: the more of them there are,
the more an entry must explain.

A function of time is known only at the readings of a fit. Between them it is linear, beyond them constant. It is
therefore built for the current readings, and a fold that leaves readings out knows less of it than the whole fit.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from calib.arm.kinematics import BESIDE, FRAME, TARGET, Chain
from calib.array import Array
from calib.data.conditions import Conditions
from calib.fit.least_squares import jacobian
from calib.fit.readings import FitReadings
from calib.model.carried_regressors import QUANTITIES, Held, HeldPair, OfTime
from calib.model.effect import Effect
from calib.model.model import BoundModel, ModelStructure
from calib.model.regressors import (
    ApproachSide,
    Cosine,
    CreepBetween,
    JointAngle,
    LastMove,
    Regressor,
    Sine,
    StepAt,
    Temperature,
    Time,
    Torque,
    TorqueCubed,
    TorqueSign,
    WarmUpRegressor,
)

LOW_ORDERS = (1, 2, 3, 4)
GEAR_ORDERS = range(5, 331)
_PAIRS = [(u, v * sign) for u, v in ((1, 1), (1, 2), (2, 1), (2, 2), (3, 3)) for sign in (1, -1)]
_WINDOWS = (10.0, 20.0, 40.0)  # full widths, deg
_FEWEST_IN_WINDOW = 6  # poses
_STEPS, _GAPS = 47, 12  # change points: evenly spread, and at the longest pauses
_WARM_UPS = (0.03, 0.1, 0.3)  # time constants as shares of the campaign
_LAGS_S = (600.0, 1500.0, 4000.0)  # time lags of effects that follow the air
_BEATS = np.arange(2.0, 40.0, 0.5)  # cycles per campaign
_STILL = 1e-3  # rad or mm: a joint that moved less offers nothing
_LEAST_AIR = 0.2  # K
_MOST_KNOTS = 80  # for a function of time in a model


@dataclass(frozen=True, eq=False)
class OfClock:
    """Function of time before it is bound to readings: ascending times (u,) to values (u,)."""

    values: Callable[[Array], Array]


@dataclass(frozen=True)
class Entry:
    """Entry of the dictionary: one condition on one slot.

    Attributes
    ----------
    kind : str
        Kind of condition.
    functions : tuple of Regressor or OfClock
        One function for each column.
    at : float or None
        Time of a step.
    effect : Effect or None
        Named effect that the entry stands for. Its columns then replace slot and functions.
    """

    slot: str
    kind: str
    condition: str
    functions: tuple[Regressor | OfClock, ...] = ()
    joints: tuple[int, ...] = ()
    at: float | None = None
    effect: Effect | None = None

    @property
    def width(self) -> int:
        """Number of columns."""
        return len(self.effect.parameters) if self.effect is not None else len(self.functions)


class Part:
    """Some readings of a fit: residual, and columns of the model and of slots."""

    def __init__(self, model: ModelStructure, estimate: Array, readings: FitReadings) -> None:
        self.readings, self.conditions = readings, readings.conditions
        self._design, self._observed = BoundModel(model, readings.conditions), readings.observed
        self._frames = self._design.frames(estimate)
        self.residual = self._observed.residual(self._frames)

    @property
    def size(self) -> int:
        """Number of whitened rows, including rows (zero) that were not measured."""
        return self.residual.size

    @cached_property
    def columns(self) -> Array:
        """Whitened derivative of the readings by the parameters of the model, shape (size, m)."""
        return jacobian(self._design, self._observed, self._frames)

    def of_entries(
        self, entries: Sequence[Entry], known: Array, clock: str, kind: type = np.float64
    ) -> Array:
        """Compute the columns of some entries, shape (columns, size).

        Functions of time are known at the ascending times `known` (u,).
        """
        slots = tuple(dict.fromkeys(e.slot for e in entries if e.effect is None))
        terms = [term for e in entries if e.effect is not None for term in e.effect.terms]
        slots += tuple({term.slot for term in terms} - set(slots))
        speed = dict(zip(slots, self._observed.columns(self._frames, slots), strict=True))
        drives: dict[int | Regressor, Array | float] = {}
        times = getattr(self.conditions, clock)
        count, n = sum(e.width for e in entries), self.residual.shape[1]
        out, at = np.zeros((count, self.size), kind), 0
        for entry in entries:
            if entry.effect is not None:
                block = np.zeros((entry.width, *self.residual.shape))
                place = {p.name: i for i, p in enumerate(entry.effect.parameters)}
                for term in entry.effect.terms:
                    drive = term.weight * term.regressor.evaluate(self.conditions)
                    block[place[term.parameter]] += speed[term.slot] * drive
                out[at : at + entry.width] = self._observed.by_visit(block).reshape(entry.width, -1)
                at += entry.width
                continue
            for function in entry.functions:
                key = id(function)
                if key not in drives:
                    drives[key] = (
                        np.interp(times, known, function.values(known))
                        if isinstance(function, OfClock)
                        else function.evaluate(self.conditions)
                    )
                value = np.broadcast_to(drives[key], (n,))
                out[at] = self._observed.by_visit(speed[entry.slot] * value).ravel()
                at += 1
        return out


@dataclass(frozen=True)
class Dictionary:
    """Entries that some readings offer.

    Attributes
    ----------
    clock : str
        "time", or "order" for readings without times.
    """

    entries: tuple[Entry, ...]
    clock: str

    @cached_property
    def price(self) -> Array:
        """Logarithm of how many entries have the same kind, shape (entries,)."""
        kinds = np.array([e.kind for e in self.entries])
        many = {kind: float(np.log(np.sum(kinds == kind))) for kind in set(kinds.tolist())}
        return np.array([many[kind] for kind in kinds])

    @cached_property
    def named(self) -> NDArray[np.bool_]:
        """Mask of the entries for named effects, shape (entries,)."""
        return np.array([e.effect is not None for e in self.entries])

    @cached_property
    def width(self) -> NDArray[np.int64]:
        """Number of columns of each entry, shape (entries,)."""
        return np.array([e.width for e in self.entries])

    @classmethod
    def of(
        cls,
        model: ModelStructure,
        readings: FitReadings,
        everywhere: Conditions,
        named: Sequence[Effect] = (),
    ) -> Dictionary:
        """Build all entries that readings offer in addition to a model, and those of named effects.

        The conditions `everywhere` are those of all rows that must be predicted. A condition that some of them do not
        state is not offered.
        """
        conditions = readings.conditions
        timed = bool(np.isfinite(everywhere.time).all() and np.ptp(conditions.time) > 0.0)
        felt = bool(np.isfinite(everywhere.temperature).all())
        clock = "time" if timed else "order"
        times = np.unique(getattr(conditions, clock))
        chain = Chain.of(model.robot)
        beside = {m.slot for m in (*FRAME, *TARGET)} | set(BESIDE)
        slots = [slot for slot in chain.slots if slot not in beside and not slot.startswith("tool.")]
        timely = _of_clock(times)
        shared = [*timely, *(_of_air(conditions, clock) if felt else ()), *_of_joints(model, conditions)]
        entries = [Entry(slot, *shape) for slot in slots for shape in shared]
        entries += [Entry(f"tool.{axis}", *shape) for axis in "xyz" for shape in timely]
        if np.ptp(times) > 0.0:
            start, span = times[0], np.ptp(times)
            for beats in _BEATS:
                of = tuple(_wave(f, 2.0 * np.pi * beats / span, start) for f in (np.cos, np.sin))
                entries += [Entry(m.slot, "time", f"{beats:g} waves in time", of) for m in chain.base]
        entries += _of_gears(model, conditions)
        entries += [Entry("", "named", e.label, effect=e) for e in named]
        return cls(tuple(entries), clock)

    def known(self, conditions: Conditions) -> Array:
        """Return the ascending times (u,) at which a fit to readings knows functions of time."""
        return np.unique(getattr(conditions, self.clock))


Shape = tuple[str, str, tuple[Regressor | OfClock, ...], tuple[int, ...], float | None]


def _wave(f: Callable[[Array], Array], rate: float, start: float) -> OfClock:
    return OfClock(lambda u: f(rate * (u - start)))


def step_at(time: float) -> OfClock:
    """Return a step after a time."""
    return OfClock(lambda u: np.asarray(u > time, dtype=np.float64))


def _of_clock(times: Array) -> list[Shape]:
    """Build steps, a ramp and warm-ups over ascending times (u,)."""
    if len(times) < 4:
        return []
    start, span, gap = times[0], max(float(np.ptp(times)), 1e-9), np.diff(times)
    spread = np.searchsorted(times, np.quantile(times, np.linspace(0.06, 0.94, _STEPS)), side="right") - 1
    longest = np.argsort(-gap, kind="stable")[:_GAPS]
    pauses = longest[gap[longest] > 4.0 * np.median(gap)]
    steps = np.unique(np.r_[times[spread], times[pauses]])
    found: list[Shape] = [("time", "a step in time", (step_at(t),), (), float(t)) for t in steps.tolist()]
    found.append(
        ("time", "a drift", (OfClock(lambda u: np.asarray((u - start) / span, dtype=np.float64)),), (), None)
    )
    for share in _WARM_UPS:
        warm = _decay(start, share * span)
        found.append(("time", f"a warm-up in {share:g} of the campaign", (warm,), (), None))
    return found


def _decay(start: float, constant: float) -> OfClock:
    return OfClock(lambda u: np.asarray(np.exp((start - u) / constant), dtype=np.float64))


def _of_air(conditions: Conditions, clock: str) -> list[Shape]:
    air = conditions.temperature
    if np.ptp(air) <= _LEAST_AIR:
        return []
    middle, low, high = float(np.mean(air)), float(np.min(air)), float(np.max(air))
    found: list[Shape] = [("air", "the air", (Held("air", 0, "linear", 1.0, middle, low, high),), (), None)]
    if clock != "time":
        return found
    order = np.argsort(conditions.time, kind="stable")
    time, warmth = conditions.time[order], air[order] - middle
    for lag in _LAGS_S:
        late, last = np.empty(len(time)), warmth[0]
        keep = np.exp(-np.diff(time, prepend=time[0]) / lag)
        for i, (old, new) in enumerate(zip(keep, warmth, strict=True)):  # a recursion over time
            last = new + (last - new) * old
            late[i] = last
        at, first = np.unique(time, return_index=True)
        found.append(("late air", f"the air {lag:.0f} s before", (_table(at, late[first]),), (), None))
    return found


def _table(times: Array, values: Array) -> OfClock:
    return OfClock(lambda u: np.asarray(np.interp(u, times, values), dtype=np.float64))


def moving(conditions: Conditions) -> list[int]:
    """List the joints that moved, from 1."""
    return [k + 1 for k in range(conditions.joints.shape[1]) if np.ptp(conditions.joints[:, k]) > _STILL]


def _range_of(values: Array) -> tuple[float, float]:
    return float(np.min(values)), float(np.max(values))


def _of_joints(model: ModelStructure, conditions: Conditions) -> list[Shape]:
    """Build low waves, torque, side and last move for every joint that moved."""
    found: list[Shape] = []
    slides = model.robot.slides
    for k in moving(conditions):
        angle = conditions.joints[:, k - 1]
        low, high = _range_of(angle)
        rate = np.pi / max(high - low, 1e-9) if k in slides else 1.0

        def held(law: str, order: float, k: int = k, low: float = low, high: float = high) -> Held:
            return Held("angle", k, law, order, 0.0, low, high)

        for order in LOW_ORDERS:
            waves = (held("cosine", order * rate), held("sine", order * rate))
            found.append(("joint", f"{order} x the angle of joint {k}", waves, (k,), None))
        found.append(("joint", f"the angle of joint {k}", (held("linear", rate),), (k,), None))
        torque = conditions.torque[:, k - 1]
        most, ends = float(np.max(np.abs(torque))), _range_of(torque)
        if most > 0.0 and ends[1] > ends[0]:
            for law, size in (("linear", most), ("cubic", most), ("sign", 0.1 * most)):
                of = (Held("torque", k, law, 1.0 / size, 0.0, *ends),)
                found.append(("torque", f"the torque about joint {k}", of, (k,), None))
        side = conditions.side[:, k - 1]
        if np.isfinite(side).all() and np.ptp(side) > 0.0:
            found.append(("side", f"the side of approach of joint {k}", (ApproachSide(k),), (k,), None))
        move = angle - conditions.previous[:, k - 1]
        if np.isfinite(move).all() and np.ptp(move) > 0.0:
            for law, of_law in (("sign", rate / 0.05), ("linear", rate)):
                of = (Held("move", k, law, of_law, 0.0, *_range_of(move)),)
                found.append(("move", f"the last move of joint {k}", of, (k,), None))
    return found


def _of_gears(model: ModelStructure, conditions: Conditions) -> list[Entry]:
    """Build waves of the gear, windows, and waves of two joints together, on the joint itself."""
    entries: list[Entry] = []
    turning = [k for k in moving(conditions) if k not in model.robot.slides]
    slot = dict(enumerate(model.robot.joint_slots, start=1))
    pose = conditions.pose
    for k in turning:
        angle = conditions.joints[:, k - 1]
        low, high = _range_of(angle)
        for order in GEAR_ORDERS:
            waves = tuple(Held("angle", k, law, float(order), 0.0, low, high) for law in ("cosine", "sine"))
            entries.append(Entry(slot[k], "gear", f"{order} waves per turn of joint {k}", waves, (k,)))
        for i in (j for j in turning if j < k):
            ends = (*_range_of(conditions.joints[:, i - 1]), low, high)
            for u, v in _PAIRS:
                waves = tuple(HeldPair(i, k, law, float(u), float(v), *ends) for law in ("cosine", "sine"))
                condition = f"joints {i} and {k} together"
                entries += [Entry(slot[m], "pair", condition, waves, (i, k)) for m in (i, k)]
        for width in np.radians(_WINDOWS):
            for middle in np.arange(low, high, width / 4.0):
                near = np.abs(angle - middle) < 0.4 * width
                if len(np.unique(pose[near])) < _FEWEST_IN_WINDOW:
                    continue
                window = Held("angle", k, "window", 1.0 / width, float(middle), low, high)
                ends = np.degrees((middle - width / 2.0, middle + width / 2.0))
                condition = f"joint {k} from {ends[0]:.0f} to {ends[1]:.0f} deg"
                entries.append(Entry(slot[k], "window", condition, (window,), (k,)))
    return entries


def bound(function: Regressor | OfClock, known: Array, clock: str) -> Regressor:
    """Convert a function of an entry to a regressor.

    A function of time gets the fewest knots that follow it to a thousandth of its range.
    """
    if not isinstance(function, OfClock):
        return function
    values = np.asarray(function.values(known), dtype=np.float64)
    kept = _knots(known, values)
    return OfTime(tuple(known[kept].tolist()), tuple(values[kept].tolist()), clock)


def _knots(times: Array, values: Array) -> NDArray[np.int64]:
    """Select knots between which values are linear to a thousandth of their range."""
    kept = [0, len(times) - 1]
    allowed = 1e-3 * max(float(np.ptp(values)), 1e-12)
    while len(kept) < _MOST_KNOTS:
        off = np.abs(values - np.interp(times, times[kept], values[kept]))
        worst = int(np.argmax(off))
        if off[worst] <= allowed:
            break
        kept = sorted({*kept, worst})
    return np.array(kept)


_HELD: Mapping[type, tuple[str, str]] = {
    Cosine: ("angle", "cosine"),
    Sine: ("angle", "sine"),
    JointAngle: ("angle", "linear"),
    Torque: ("torque", "linear"),
    TorqueCubed: ("torque", "cubic"),
    TorqueSign: ("torque", "sign"),
    LastMove: ("move", "linear"),
    Temperature: ("air", "linear"),
}


def held(regressor: Regressor, conditions: Conditions, clock: str) -> Regressor:
    """Keep a regressor of a named effect constant beyond the border of the measured range."""
    if isinstance(regressor, StepAt | CreepBetween | Time | WarmUpRegressor):
        times, first = np.unique(getattr(conditions, clock), return_index=True)
        return bound(_table(times, np.asarray(regressor.evaluate(conditions))[first]), times, clock)
    if type(regressor) not in _HELD:
        return regressor
    quantity, law = _HELD[type(regressor)]
    joint = getattr(regressor, "joint", 0)
    rate = getattr(regressor, "order", 1.0 / getattr(regressor, "width", 1.0))
    centre = getattr(regressor, "reference_c", 0.0)
    return Held(quantity, joint, law, rate, centre, *_range_of(QUANTITIES[quantity](conditions, joint - 1)))


CONDITIONS: Mapping[str, str] = {
    "constant": "nothing that was recorded",
    "time": "time",
    "air": "temperature",
    "late air": "temperature",
    "joint": "joint {0} angle",
    "gear": "joint {0} angle",
    "window": "joint {0} angle",
    "pair": "joint {0} and joint {1} angles",
    "torque": "torque about joint {0}",
    "side": "side of approach of joint {0}",
    "move": "last move of joint {0}",
}
"""Kind of entry -> the name of its condition, as places of structure have it (`calib.diagnose.structure`)."""
