"""Hidden effects of joints that slide: mm added to the travel q of the model. Group: transmission."""

from __future__ import annotations

from mocks.world.arm import Arm
from mocks.world.draw import Material
from mocks.world.effect import Effect, Values, joint_number


def slide_backlash(m: Material) -> Effect:
    """gap/2 x side of approach, label slide_backlash:jK; gap in mm."""
    i = _slide(m)

    def act(arm: Arm, p: Values) -> None:
        arm.extra_angle[i] += p["gap"] / 2.0 * arm.state.sides[i]

    return Effect(m.label, "arm", act, {"gap": 0.05}, {"gap": "mm"})


def slide_scale(m: Material) -> Effect:
    """Scale of a slide, k q; label slide_scale:jK, k in mm/mm."""
    i = _slide(m)

    def act(arm: Arm, p: Values) -> None:
        arm.extra_angle[i] += p["k"] * arm.angles[i]

    return Effect(m.label, "arm", act, {"k": 1e-4 * m.sign()}, {"k": "1"})


def _slide(m: Material) -> int:
    i = joint_number(m.arguments[0]) - 1
    if not m.robot.sliding[i]:
        raise ValueError(f"{m.label}: that joint turns")
    return i
