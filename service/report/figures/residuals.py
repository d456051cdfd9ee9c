"""The residuals of one effect, reading by reading, with all other effects in the model.

With the effect's parameters set to zero and all others kept, r is the whitened residual of a reading. w is the
whitened displacement for one unit of the effect's drive. Then y = w.r / w.w is the best estimate of that drive
from this reading alone, with standard error noise_scale / |w|. Drawn over the driver of the effect, y must
follow the fitted law. For effects on one joint y is a joint angle.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from calib.arm import Frames, Robot
from calib.array import Array
from calib.data import Dataset
from calib.fit import FitReadings, IdentificationFit, readings_of
from calib.model import Axis, BoundModel, Effect, PlotAxis
from calib.units import DEG

MDEG = DEG * 1e-3

Amounts = Callable[[FitReadings], Mapping[str, Array | float]]
Law = Callable[[FitReadings, BoundModel], Array]


class PlotValues(NamedTuple):
    """The values of one quantity in n readings, in internal units.

    They are the estimate y, its standard error sd, and the fitted law.
    """

    y: Array
    sd: Array
    law: Array


@dataclass(frozen=True)
class JointAxis:
    """The way a joint is shown.

    It has a name, a slot, one unit of its place and of its error, and the texts of the axes.
    """

    name: str
    slot: str
    unit: float
    place: str
    error_unit: float
    error: str
    turns: bool

    @classmethod
    def of(cls, robot: Robot, joint: int) -> JointAxis:
        """Return the joint of a link, from 1."""
        axis, slot = robot.axes[joint - 1], robot.joint_slots[joint - 1]
        name = axis.removeprefix("j")
        if robot.kinds[joint - 1] == "slides":
            return cls(name, slot, 1.0, f"{axis}, mm", 1e-3, "µm", False)
        return cls(name, slot, DEG, f"θ{name}, deg", MDEG, "mdeg", True)


@dataclass(frozen=True)
class PlotSample:
    """The readings a figure shows: those of the fit, and those held out."""

    fitted: IdentificationFit
    parts: tuple[FitReadings, ...]

    @classmethod
    def of(cls, dataset: Dataset, fitted: IdentificationFit) -> PlotSample:
        """Fit readings that belong, then measured validation readings where there are any."""
        held = dataset.validation_rows
        if not held.any():
            return cls(fitted, (fitted.readings,))
        return cls(fitted, (fitted.readings, readings_of(dataset, held, fitted.model, fitted.estimate)))

    @property
    def held(self) -> NDArray[np.bool_]:
        """Mask (n,) of the readings that took no part in the fit."""
        return np.concatenate([np.full(len(p.rows), i > 0) for i, p in enumerate(self.parts)])

    @cached_property
    def designs(self) -> tuple[BoundModel, ...]:
        """The model bound to the conditions of each part: many figures ask for it."""
        return tuple(BoundModel(self.fitted.model, part.conditions) for part in self.parts)

    def shown(self, joint: int) -> JointAxis:
        """Return the way a joint is shown."""
        return JointAxis.of(self.fitted.model.robot, joint)

    def angle(self, joint: int) -> Array:
        """Return the model angles (n,) of a joint, rad, or its places along its axis, mm."""
        return np.concatenate([p.conditions.joints[:, joint - 1] for p in self.parts])

    def side(self, joint: int) -> Array:
        """Return the side of approach (n,) of a joint."""
        return np.concatenate([p.conditions.side[:, joint - 1] for p in self.parts])

    def column(self, name: str) -> Array:
        """Return a condition (n,) that is one number per reading."""
        return np.concatenate([getattr(p.conditions, name) for p in self.parts])

    def axis(self, regressor: PlotAxis) -> Axis:
        """Return the axis over which a regressor is drawn, for the readings of all parts."""
        axes = [regressor.drawn_over(part.conditions) for part in self.parts]
        return replace(axes[0], values=np.concatenate([axis.values for axis in axes]))

    def of_joint(self, joint: int, effects: Sequence[Effect]) -> PlotValues:
        """Return the error of a joint, rad or mm, without some effects on that joint."""
        slot = self.shown(joint).slot
        return self._seen(effects, lambda _: {slot: 1.0}, lambda _, design: self._law(design, effects))

    def of_driver(self, effect: Effect) -> PlotValues:
        """Return the regressor that all terms of an effect share, as each reading sees it."""
        amounts: dict[str, float] = {}
        for term in effect.terms:
            amounts[term.slot] = amounts.get(term.slot, 0.0) + term.weight * self._estimate(term.parameter)
        driver = effect.terms[0].regressor

        def law(part: FitReadings, _: BoundModel) -> Array:
            return np.broadcast_to(driver.evaluate(part.conditions), (len(part.rows),))

        return self._seen([effect], lambda _: amounts, law)

    def of_share(self, effect: Effect) -> PlotValues:
        """Estimate the share of the fitted effect that each reading shows: 1 is all of it.

        This is for laws with several drivers.
        """

        def amounts(part: FitReadings) -> dict[str, Array | float]:
            slots: dict[str, Array | float] = {}
            for term in effect.terms:
                amount = term.weight * self._estimate(term.parameter)
                drive = amount * term.regressor.evaluate(part.conditions)
                slots[term.slot] = slots.get(term.slot, 0.0) + drive
            return slots

        return self._seen([effect], amounts, lambda part, _: np.ones(len(part.rows)))

    def moved(self, effect: Effect) -> Array:
        """Return the displacement (n, 3) of the tool point by the effect, mm.

        If the effect moves the base target, it is the displacement against it.
        """
        return np.concatenate([self._moved(effect, design) for design in self.designs])

    def displacement(self, effect: Effect) -> float:
        """Return the RMS displacement of the tool point, or the base target, by the effect, mm.

        It is taken over at most 400 readings.
        """
        moved = self._moved(effect, self._few)
        return float(np.sqrt(np.mean(np.sum(moved**2, axis=1))))

    @cached_property
    def _few(self) -> BoundModel:
        """The model bound to at most 400 readings of the fit."""
        conditions = self.parts[0].conditions
        return BoundModel(
            self.fitted.model,
            conditions.take(np.unique(np.linspace(0, len(conditions) - 1, 400).astype(int))),
        )

    def _moved(self, effect: Effect, design: BoundModel) -> Array:
        without = self.fitted.estimate.copy()
        without[self.fitted.model.positions(effect)] = 0.0
        if any(term.slot.startswith("anchor") for term in effect.terms):
            here, there = (design.frames(estimate, ()).anchor for estimate in (self.fitted.estimate, without))
            return np.broadcast_to(there - here, (3, len(design.conditions))).T
        return design.predict(self.fitted.estimate) - design.predict(without)

    def left(self, dataset: Dataset) -> Array:
        """Return the residuals (n, 3), measured less predicted point, mm.

        They are NaN without a measured point.
        """
        return dataset.points[np.concatenate([part.rows for part in self.parts])] - self._predicted

    @cached_property
    def _frames(self) -> tuple[Frames, ...]:
        """The chain at the estimate for each part: every joint is looked at from it."""
        return tuple(design.frames(self.fitted.estimate) for design in self.designs)

    @cached_property
    def _predicted(self) -> Array:
        return np.concatenate([design.predict(self.fitted.estimate) for design in self.designs])

    def _estimate(self, parameter: str) -> float:
        return float(self.fitted.estimate[self.fitted.model.index[parameter]])

    def _seen(self, effects: Sequence[Effect], amounts: Amounts, law: Law) -> PlotValues:
        model = self.fitted.model
        without = self.fitted.estimate.copy()
        for effect in effects:
            without[model.positions(effect)] = 0.0
        frames_of = [design.frames(without) for design in self.designs] if effects else self._frames
        seen = []
        for part, design, frames in zip(self.parts, self.designs, frames_of, strict=True):
            alone = part.observed.alone
            residual = alone.residual(frames)
            moved = np.zeros_like(residual)
            for slot, amount in amounts(part).items():
                moved += alone.column(frames, slot) * amount
            square = np.maximum(np.sum(moved**2, axis=0), 1e-300)
            spread = max(self.fitted.noise_scale, 1.0) / np.sqrt(square)
            seen.append((np.sum(moved * residual, axis=0) / square, spread, law(part, design)))
        return PlotValues(*(np.concatenate(column) for column in zip(*seen, strict=True)))

    def _law(self, design: BoundModel, effects: Sequence[Effect]) -> Array:
        """Sum over the effects of weight x parameter x regressor, (n,)."""
        mine = {position for effect in effects for position in self.fitted.model.positions(effect)}
        total = np.zeros(len(design.conditions))
        for position, _, drive in design.terms:
            if position in mine:
                total += float(self.fitted.estimate[position]) * drive
        return total


def binned(x: Array, y: Array, sd: Array, edges: Array) -> tuple[Array, Array, Array]:
    """Return weighted means of y in bins of x.

    Returns centres, means and expanded uncertainties (k = 2) of the bins with at least 4 readings.
    """
    place = np.clip(np.digitize(x, edges) - 1, 0, len(edges) - 2)
    weight = 1.0 / sd**2
    size = len(edges) - 1
    total = np.bincount(place, weight, size)
    enough = np.bincount(place, minlength=size) >= 4
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.bincount(place, weight * y, size) / total
        centre = np.bincount(place, weight * x, size) / total
        spread = 2.0 / np.sqrt(total)
    return centre[enough], mean[enough], spread[enough]
