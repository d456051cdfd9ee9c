"""Panels of the residual over the driver of an effect, with the fitted law drawn on it.

The abscissa depends on the driver:

- joint angle for gears, or phase of the gear error if it repeats too often to follow
- side of approach for backlash
- order of the readings for steps
- time for drifts
- temperature for growth
- torque and moment for bending

An effect with several drivers at once is drawn over the displacement that it should cause. Readings that follow
it are on the diagonal.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calib.array import Array
from calib.data import Conditions
from calib.effects import words_of
from calib.model import Axis, Effect, PlotAxis, Regressor
from calib.units import DEG
from service.report.figures.residuals import MDEG, PlotSample, PlotValues

_FOLDED_FROM = 9.0  # cycles per turn above which the angle is folded into one cycle
_FAST = 30  # changes of sign
_BLIND = 3.0  # readings that see the quantity this much worse than usual are not drawn
_CURVE_POINTS = 1500
_PER = {
    "mm/h": ("mm", 1.0),
    "deg/h": ("deg", DEG),
    "1e-6/K": ("1e-6", 1e-6),
    "mm": ("mm", 1.0),
    "deg": ("deg", DEG),
    "ppm": ("ppm", 1e-6),
}
_ANGLES = ("theta", "alpha", "beta")
_UNTOUCHED = 1e-6  # of the largest displacement: such a reading says nothing of the effect
_ALIKE = 0.2  # spread of the displacements, of the largest, below which they are no abscissa

Mask = NDArray[np.bool_]
Curve = tuple[Array, Array, float]  # x, y, side (0 where none is distinguished)


@dataclass(frozen=True)
class PlotPanel:
    """Points (x, y, sd), the law as lines (x, y), and labels.

    All values are in the units of the labels.
    """

    title: str
    x_label: str
    y_label: str
    x: Array
    y: Array
    sd: Array
    held: Mask  # (n,) took no part in the fit
    side: Array | None  # (n,) +1 or -1; None if the picture does not distinguish the sides
    lines: tuple[Curve, ...]
    described: str
    # Abscissa, and the lowest and highest law that its uncertainty allows (k = 2)
    band: tuple[Array, Array, Array] | None = None

    @property
    def clear(self) -> Mask:
        """Mask (n,) of the readings that determine the quantity well enough to be drawn."""
        return self.sd <= _BLIND * np.median(self.sd)

    @property
    def fast(self) -> bool:
        """Whether the law changes its sign too often for means of bins to follow it."""
        heights = self.lines[0][1]
        signs = np.sign(heights[np.isfinite(heights)])
        return bool(np.sum(signs[1:] * signs[:-1] < 0.0) > _FAST)


def of_effect(sample: PlotSample, effect: Effect) -> PlotPanel:
    """Return the panel of one effect."""
    drivers = {term.regressor for term in effect.terms}
    slots = {term.slot for term in effect.terms}
    joints = sample.fitted.model.robot.joint_slots
    if len(slots) == 1 and (slot := next(iter(slots))) in joints:
        return _on_joint(sample, effect, joints.index(slot) + 1)
    if len(drivers) == 1 and (axis := _common_axis(sample, effect)) is not None:
        return _by_driver(sample, effect, axis)
    return _by_displacement(sample, effect)


def _by_displacement(sample: PlotSample, effect: Effect) -> PlotPanel:
    """Build the panel over the displacement that the law causes.

    If the displacement is the same for all readings that the law moves, the panel is in order of time.
    """
    seen = sample.of_share(effect)
    moved = np.linalg.norm(sample.moved(effect), axis=1)
    touched = moved > _UNTOUCHED * np.max(moved)
    if np.ptp(moved[touched]) < _ALIKE * np.max(moved):
        x, x_label, y_label = (
            sample.column("order") + 1.0,
            "reading, in order of time",
            "share of the fitted effect",
        )
    else:
        seen = PlotValues(seen.y * moved, seen.sd * moved, moved)
        x, x_label, y_label = moved, "displacement by the fitted law, mm", "displacement seen, mm"
    panel = _panel(sample, effect.label, x, x_label, seen, 1.0, y_label)
    return replace(
        panel, x=panel.x[touched], y=panel.y[touched], sd=panel.sd[touched], held=panel.held[touched]
    )


def _on_joint(sample: PlotSample, effect: Effect, joint: int) -> PlotPanel:
    if effect.is_curve:
        return _over_a_turn(sample, effect, joint)
    seen = sample.of_joint(joint, [effect])
    angle, shown = sample.angle(joint), sample.shown(joint)
    axis = _common_axis(sample, effect)
    folded = axis is not None and axis.cycles >= _FOLDED_FROM
    side = None
    x, x_label = angle / shown.unit, shown.place
    if axis is None:
        if np.ptp(seen.law) > 0.0:
            x, x_label = seen.law / shown.error_unit, f"fitted law, {shown.error}"
    elif folded:
        x = np.mod(axis.cycles * angle, 2.0 * np.pi) / DEG
        x_label = f"{axis.cycles:g} × θ{shown.name}, folded into one cycle, deg"
    else:
        x, x_label = axis.values, axis.label
        side = _side(sample, axis)
    y_label = f"error of joint {shown.name}, {shown.error}"
    panel = _panel(sample, effect.label, x, x_label, seen, shown.error_unit, y_label, side)
    if axis is not None and axis.cycles > 0.0 and not folded:
        # readings may leave gaps that a line through them would cut short
        return replace(panel, lines=_curves(sample, joint, (effect,), sided=False))
    return panel


def _over_a_turn(sample: PlotSample, effect: Effect, joint: int) -> PlotPanel:
    """Build the panel of a gear over a whole turn about the readings.

    It has the band of its uncertainty (k = 2).
    """
    angle = sample.angle(joint)
    seen = sample.of_joint(joint, [effect])
    shown = sample.shown(joint)
    y_label = f"error of joint {shown.name}, mdeg"
    panel = _panel(sample, effect.label, angle / DEG, shown.place, seen, MDEG, y_label)
    middle = 0.5 * (angle.min() + angle.max())
    grid = middle + np.linspace(-np.pi, np.pi, _CURVE_POINTS)
    conditions = _turned(sample, joint, grid)
    positions = sample.fitted.model.positions(effect)
    waves = np.array([term.regressor.evaluate(conditions) for term in effect.terms])
    law = sample.fitted.estimate[positions] @ waves / MDEG
    covariance = sample.fitted.covariance[np.ix_(positions, positions)]
    room = 2.0 * np.sqrt(np.maximum(np.sum(waves * (covariance @ waves), axis=0), 0.0)) / MDEG
    x = grid / DEG
    described = f"{panel.described} over a whole turn and its uncertainty (k = 2) as a band"
    return replace(panel, lines=((x, law, 0.0),), band=(x, law - room, law + room), described=described)


def _turned(sample: PlotSample, joint: int, grid: Array, side: float = 0.0) -> Conditions:
    """Return the first reading's conditions with one joint at every angle of a grid, rad.

    The joint comes from one side, or none.
    """
    conditions = sample.parts[0].conditions.take(np.zeros(len(grid), dtype=int))
    joints, sides = conditions.joints.copy(), conditions.side.copy()
    joints[:, joint - 1], sides[:, joint - 1] = grid, side
    return replace(conditions, joints=joints, side=sides)


def _by_driver(sample: PlotSample, effect: Effect, axis: Axis) -> PlotPanel:
    seen = sample.of_driver(effect)
    x, name = axis.values, axis.label
    side = _side(sample, axis)
    model, estimate = sample.fitted.model, sample.fitted.estimate
    unit, slot = effect.parameters[0].unit, effect.terms[0].slot
    if len(effect.terms) == 1 and slot.startswith(_ANGLES):
        amount = effect.terms[0].weight * float(estimate[model.index[effect.terms[0].parameter]])
        return _panel(
            sample, effect.label, x, name, seen, MDEG / (amount or 1.0), f"error of {slot}, mdeg", side
        )
    shown, factor = _PER.get(unit, ("", 0.0))
    if not shown:
        largest = max(float(np.max(np.abs(seen.law))), 1e-300)
        return _panel(sample, effect.label, x, name, seen, largest, "share of the fitted effect", side)
    values = [estimate[model.index[p.name]] for p in effect.parameters if p.unit == unit]
    size = float(values[0]) if len(values) == 1 else float(np.linalg.norm(values))
    small = shown == "deg"
    scale = (MDEG if small else factor) / (size if size != 0.0 else 1.0)
    label = f"{effect.label.replace('_', ' ')}, {'mdeg' if small else shown}"
    return _panel(sample, effect.label, x, name, seen, scale, label, side)


def _common_axis(sample: PlotSample, effect: Effect) -> Axis | None:
    """Return the axis over which all drivers of an effect are drawn.

    It is None if there are several quantities, or one without an axis.
    """
    axes = [_axis(sample, term.regressor) for term in effect.terms]
    labels = {None if axis is None else axis.label for axis in axes}
    return axes[0] if len(labels) == 1 else None


def _axis(sample: PlotSample, driver: Regressor) -> Axis | None:
    return sample.axis(driver) if isinstance(driver, PlotAxis) else None


def _side(sample: PlotSample, axis: Axis) -> Array | None:
    """Return the side of approach (n,) of the joint of an axis if a law has two sides."""
    return sample.side(axis.joint) if axis.sided and axis.joint is not None else None


def _panel(
    sample: PlotSample,
    title: str,
    x: Array,
    x_label: str,
    seen: PlotValues,
    scale: float,
    y_label: str,
    side: Array | None = None,
) -> PlotPanel:
    """Build points and law over x; one line per side if sides are distinguished."""
    law, lines = seen.law / scale, []
    for s in (0.0,) if side is None else (1.0, -1.0):
        mine = np.ones(len(x), dtype=bool) if side is None else side == s
        unique, first = np.unique(x[mine], return_index=True)
        heights = law[mine][first]
        if len(unique) > _CURVE_POINTS:
            keep = np.linspace(0, len(unique) - 1, _CURVE_POINTS).astype(int)
            unique, heights = unique[keep], heights[keep]
        lines.append((unique, heights, s))
    return PlotPanel(
        title=title,
        x_label=x_label,
        y_label=y_label,
        x=x,
        y=seen.y / scale,
        sd=np.abs(seen.sd / scale),
        held=sample.held,
        side=side,
        lines=tuple(lines),
        described=f"{title}: {y_label} over {x_label}, one dot a reading, with the fitted law",
    )


def of_joint(sample: PlotSample, joint: int, effects: tuple[Effect, ...]) -> PlotPanel:
    """Build the panel of the error of one joint over its angle.

    All effects found on that joint are removed from the points and drawn as lines.
    """
    shown = sample.shown(joint)
    mine = tuple(e for e in effects if {t.slot for t in e.terms} == {shown.slot})
    seen = sample.of_joint(joint, mine)
    angle = sample.angle(joint)
    sided = _gap(sample, mine) > 0.25 * float(np.max(np.abs(seen.law)))
    names = [words_of(e.label) for e in mine]
    of = "angle" if shown.turns else "position"
    listed = ", ".join(names[:1]) + (f" and {len(names) - 1} more" if len(names) > 1 else "")
    return PlotPanel(
        title=listed or f"joint {shown.name}",
        x_label=shown.place,
        y_label=f"error, {shown.error}",
        x=angle / shown.unit,
        y=seen.y / shown.error_unit,
        sd=seen.sd / shown.error_unit,
        held=sample.held,
        side=sample.side(joint) if sided else None,
        lines=_curves(sample, joint, mine, sided=sided),
        described=f"Joint {shown.name}: residual as joint-{of} error over the joint {of}; found: {listed or 'nothing'}",
    )


def _gap(sample: PlotSample, effects: tuple[Effect, ...]) -> float:
    """Return the share of the laws that the side of approach makes, rad."""
    model, estimate = sample.fitted.model, sample.fitted.estimate
    return sum(
        abs(float(term.weight * estimate[model.index[term.parameter]]))
        for effect in effects
        for term in effect.terms
        if (axis := _axis(sample, term.regressor)) is not None and axis.sided
    )


def _curves(sample: PlotSample, joint: int, effects: tuple[Effect, ...], *, sided: bool) -> tuple[Curve, ...]:
    """Evaluate the sum of the laws driven by the angle (and the side) of a joint.

    The grid of angles is even.
    """
    angle, shown = sample.angle(joint), sample.shown(joint)
    grid = np.linspace(angle.min(), angle.max(), _CURVE_POINTS)
    model, estimate = sample.fitted.model, sample.fitted.estimate
    # between readings far apart the law is a guess: no line there
    gap = 0.01 * float(np.ptp(angle))
    near = np.sort(angle)
    right = np.clip(np.searchsorted(near, grid), 1, len(near) - 1)
    apart = np.minimum(np.abs(grid - near[right - 1]), np.abs(near[right] - grid)) > max(
        gap, 2.0 * shown.unit
    )
    curves = []
    for s in (1.0, -1.0) if sided else (0.0,):
        total, conditions = np.zeros(len(grid)), _turned(sample, joint, grid, s)
        for effect in effects:
            for term in effect.terms:
                amount = term.weight * estimate[model.index[term.parameter]]
                axis = _axis(sample, term.regressor)
                if axis is not None and axis.joint == joint:
                    total += amount * term.regressor.evaluate(conditions)
        curves.append((grid / shown.unit, np.where(apart, np.nan, total / shown.error_unit), s))
    return tuple(curves)
