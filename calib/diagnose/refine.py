"""Refinement of what was scanned: orders and time constants off the places of the scan, change points to the reading.

The derivative of A cos(H theta) + B sin(H theta) by H is theta (B cos - A sin). One Gauss-Newton step for all
orders at once, projected on what the model leaves, moves them; an order whose nearest whole number lies within
what the readings can tell becomes whole. Time constants take such a step too, in their logarithm.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from calib.diagnose.evidence import WHOLE_ORDER
from calib.diagnose.scan import Scores
from calib.diagnose.space import Space
from calib.effects import Survey, offers, periodic, shift, warm_up
from calib.effects.effect import Effect, Steps
from calib.kinematics import Array

_LONGEST_STEP = 0.3  # cycles a turn
_LONGEST_RATIO = 0.25  # by how much, in its logarithm, a time constant may move at once
_RESOLUTION = 0.6  # cycles over the measured range within which two orders of a joint are one effect


def refine_orders(space: Space, chosen: tuple[Effect, ...]) -> tuple[Effect, ...]:
    """The chosen effects with better harmonic orders; all else unchanged."""
    places = [i for i, effect in enumerate(chosen) if "order" in effect.shape]
    if not places:
        return chosen
    columns = np.column_stack([_derivative(space, chosen[i]) for i in places])
    columns = columns - space.basis_of_readings @ (space.basis_of_readings.T @ columns)
    size = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    step, *_ = np.linalg.lstsq(columns / size, space.residual.ravel(), rcond=1e-6)
    step = step / size
    noise = space.rss / max(space.freedom, 1)
    refined = list(chosen)
    for i, change, norm in zip(places, step, size, strict=True):
        order = chosen[i].shape["order"] + float(np.clip(change, -_LONGEST_STEP, _LONGEST_STEP))
        whole = max(1, round(order))
        lost = (order - whole) ** 2 * norm**2 / noise
        order = float(whole) if lost < WHOLE_ORDER else round(order, 2)
        if order >= periodic.LOWEST:
            refined[i] = periodic.periodic(joint_of(chosen[i]), order)
    # Orders that met are one effect, or a pair of large amplitudes that cancel: the first, the stronger, keeps it.
    return tuple(
        effect
        for i, effect in enumerate(refined)
        if not any(one_order(space, effect, earlier) for earlier in refined[:i])
    )


def one_order(space: Space, one: Effect, other: Effect) -> bool:
    """Whether two harmonics of one joint differ by less than the measured range resolves."""
    if "order" not in one.shape or "order" not in other.shape or joint_of(one) != joint_of(other):
        return False
    turns = np.ptp(space.fitted.readings.conditions.joints[:, joint_of(one) - 1]) / (2.0 * np.pi)
    return bool(abs(one.shape["order"] - other.shape["order"]) * turns < _RESOLUTION)


def joint_of(effect: Effect) -> int:
    """Joint of a harmonic effect."""
    return int(effect.terms[0].slot.removeprefix("theta"))


def _derivative(space: Space, effect: Effect) -> Array:
    order, joint = effect.shape["order"], joint_of(effect)
    theta = space.fitted.readings.conditions.joints[:, joint - 1]
    a, b = space.fitted.estimate[space.fitted.model.positions(effect)]
    drive = theta * (b * np.cos(order * theta) - a * np.sin(order * theta))
    return (space.slot(f"theta{joint}") * drive).ravel()


def refine_steps(space: Space, chosen: tuple[Effect, ...]) -> tuple[Effect, ...]:
    """The chosen effects with every change point moved to the reading that explains most, near where it was."""
    refined = []
    for effect in chosen:
        if "rank" not in effect.shape:
            refined.append(effect)
            continue
        survey = Survey(space.fitted.model.robot, space.fitted.readings.conditions)
        ranks = shift.change_points(survey)
        family = next(o for o in offers(survey) if isinstance(o, Steps) and o.label == effect.label)
        here = int(np.searchsorted(ranks, effect.shape["rank"]))
        reach = max(3, 2 * len(ranks) // shift.COARSE)
        near = ranks[max(0, here - reach) : here + reach + 1]
        scores = Scores([replace(family, ranks=near)], space)
        scores.move(*space.own_direction(effect), enters=False)
        refined.append(scores.best_of(0).effect)
    return tuple(refined)


def refine_times(space: Space, chosen: tuple[Effect, ...]) -> tuple[Effect, ...]:
    """The chosen effects with better time constants, in whole seconds; all else unchanged."""
    return tuple(
        _with_better_time(space, effect) if warm_up.TIME_CONSTANT in effect.shape else effect
        for effect in chosen
    )


def _with_better_time(space: Space, effect: Effect) -> Effect:
    """One Gauss-Newton step of the logarithm; its derivative by differences, since the columns are cheap."""
    robot, time = space.fitted.model.robot, effect.shape[warm_up.TIME_CONSTANT]
    nudge = 1e-3
    longer, shorter = (
        space.effect_columns(warm_up.warm_up(robot, time * math.exp(h))) for h in (nudge, -nudge)
    )
    values = space.fitted.estimate[space.fitted.model.positions(effect)]
    derivative = (longer - shorter) @ values / (2.0 * nudge)
    derivative = derivative - space.basis_of_readings @ (space.basis_of_readings.T @ derivative)
    size = max(float(derivative @ derivative), 1e-300)
    step = float(np.clip(derivative @ space.residual.ravel() / size, -_LONGEST_RATIO, _LONGEST_RATIO))
    better = float(np.clip(time * math.exp(step), warm_up.SHORTEST, warm_up.LONGEST))
    return warm_up.warm_up(robot, float(round(better)))
