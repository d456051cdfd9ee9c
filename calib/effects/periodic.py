"""Periodic error of a joint: A cos(H theta) + B sin(H theta), H cycles a turn.

Gears repeat their error once a turn of each wheel, so H is low (eccentric wheels), the reduction ratio or twice
it (strain-wave reducers: 50 to 320 a turn). Source: contracts, table of labels; measured on robots with trackers.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from calib.effects.effect import Effect, Harmonics, effect
from calib.effects.survey import Survey
from calib.regressors import Cosine, Sine

LOWEST, HIGHEST = 0.5, 330.0
SPACING = (
    0.25  # divides 1, so that every whole order is on the grid; a quarter of what one full turn resolves
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


def offer(survey: Survey) -> list[Harmonics]:
    """One scan a joint that moved, over all orders: what a narrow range confuses goes into one class."""
    orders = np.arange(LOWEST, HIGHEST + SPACING / 2, SPACING)
    scans = []
    for joint in survey.joint_numbers:
        if survey.turns(joint) > 0.0:
            slots = ((f"theta{joint}", 1.0),)
            scans.append(Harmonics(f"periodic:j{joint}", joint, slots, orders, partial(periodic, joint)))
    return scans
