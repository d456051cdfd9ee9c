"""Periodic error of a joint: A cos(H theta) + B sin(H theta), H cycles a turn.

Gears repeat their error once a turn of each wheel, so H is low (eccentric wheels), the reduction ratio or twice
it (strain-wave reducers: 50 to 320 a turn).
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from calib.effects.kind import Kind
from calib.effects.survey import Survey
from calib.effects.transmission import gear_orders
from calib.model.effect import Effect, effect
from calib.model.regressors import Cosine, Sine
from calib.scan.harmonics import Harmonics

LOWEST, HIGHEST = 0.5, 330.0
# The spacing divides 1, so that every whole order is on the grid; a quarter of what one full turn resolves
SPACING = 0.25
_USUAL_DEG = 0.02  # of what nobody claims; one that is searched for may have any size


KINDS = (
    Kind(
        "periodic",
        words="gear of joint {joint}, {times} a turn",
        check=(
            "Look at the drive of joint {joint}: in a gear, an eccentric wheel or bearing at a low order, worn teeth "
            "or wave generator at the order of its ratio; without a gear, an encoder out of centre. A growing "
            "amplitude is wear."
        ),
        apart=(),
    ),
)


def order_name(order: float) -> str:
    """'n17' for a whole order, else 'n100.25'."""
    return f"n{round(order)}" if abs(order - round(order)) < 1e-9 else f"n{order:.2f}"


def periodic(joint: int, order: float) -> Effect:
    """Periodic error of `joint` with `order` cycles a turn; parameters cos and sin, deg."""
    slot = f"theta{joint}"
    return effect(
        f"periodic:j{joint}:{order_name(order)}",
        "transmission",
        "robot",
        f"The gear of joint {joint} runs ahead and behind {order:g} times a turn.",
        {
            "cos": ("deg", 0.1, [(slot, Cosine(joint, order))], (-1.0, 1.0)),
            "sin": ("deg", 0.1, [(slot, Sine(joint, order))], (-1.0, 1.0)),
        },
        {"order": order},
    )


def long_waves(survey: Survey) -> list[Effect]:
    """The waves of one cycle and of two of the joints that turned, of usual sizes: wheels or encoders out of centre."""
    joints = [joint for joint in survey.moving if joint not in survey.curves]
    waves = [periodic(joint, order) for joint in joints for order in (1.0, 2.0)]
    return [
        replace(wave, parameters=tuple(replace(p, size=_USUAL_DEG) for p in wave.parameters))
        for wave in waves
    ]


def offer(survey: Survey) -> list[Harmonics]:
    """The candidates, a scan over all orders for each joint that moved; orders that a narrow range confuses share a
    class.

    Beside a curve that has the lower whole orders already: the orders above them, and those between them only where the
    joint turned more than once, since its error comes back after a turn.
    """
    everywhere = np.arange(LOWEST, HIGHEST + SPACING / 2, SPACING)
    beyond = np.arange(gear_orders.HIGHEST + 1.0, HIGHEST + 0.5)
    scans = []
    for joint in survey.joint_numbers:
        if survey.turns(joint) > 0.0 and joint not in survey.robot.slides:
            slots = ((f"theta{joint}", 1.0),)
            orders = beyond if joint in survey.curves and survey.turns(joint) <= 1.0 else everywhere
            at = partial(periodic, joint)
            scans.append(Harmonics(f"periodic:j{joint}", joint, slots, orders, at, LOWEST))
    return scans
