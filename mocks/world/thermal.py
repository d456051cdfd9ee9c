"""Hidden effects of temperature. T is the air temperature of the reading, T- its mean. Group: thermal."""

from __future__ import annotations

import math

from mocks.world.arm import Arm
from mocks.world.draw import Material
from mocks.world.effect import Effect, Values, joint_number


def stretch(arm: Arm, strain: float) -> None:
    """Multiply all a and d of the arm by 1 + `strain`."""
    arm.geometry.a = [value * (1.0 + strain) for value in arm.geometry.a]
    arm.geometry.d = [value * (1.0 + strain) for value in arm.geometry.d]


def thermal_joint(m: Material) -> Effect:
    """Joint angle that follows the air, k (T - mean T); label thermal_joint:jK, k in deg/K."""
    i = joint_number(m.arguments[0]) - 1

    def act(arm: Arm, p: Values) -> None:
        arm.extra_angle[i] += math.radians(p["k"]) * (arm.state.t_air_c - arm.t_mean_c)

    return Effect(m.label, "arm", act, {"k": 0.01 * m.sign()}, {"k": "deg/K"})


def thermal_growth(m: Material) -> Effect:
    """Multiply all a, d by 1 + alpha (T - T-); alpha in 1/K."""

    def act(arm: Arm, p: Values) -> None:
        stretch(arm, p["alpha"] * (arm.state.t_air_c - arm.t_mean_c))

    return Effect(m.label, "arm", act, {"alpha": 2e-5}, {"alpha": "1/K"})


def lagged_growth(m: Material) -> Effect:
    """Departure: the arm follows the air with a first-order lag of some tenth of the campaign."""

    def act(arm: Arm, p: Values) -> None:
        body_c = arm.air_c.lagged(arm.state.t_s, p["lag"])
        stretch(arm, p["alpha"] * (body_c - arm.t_mean_c))

    lag_s = m.session.duration_s * float(m.rng.uniform(0.05, 0.10))
    units = {"alpha": "1/K", "lag": "s"}
    return Effect(m.label, "arm", act, {"alpha": 2e-5}, units, {"lag": lag_s}, "lagged_growth")


def warm_up(m: Material) -> Effect:
    """Multiply all a, d by 1 + alpha (1 - exp(-t/T_c)); alpha without unit, T_c in s."""

    def act(arm: Arm, p: Values) -> None:
        stretch(arm, p["alpha"] * (1.0 - math.exp(-arm.state.t_s / p["T_c"])))

    t_c = m.session.duration_s * float(m.rng.uniform(0.15, 0.35))
    return Effect(m.label, "arm", act, {"alpha": 1e-4 * m.sign()}, {"alpha": "1", "T_c": "s"}, {"T_c": t_c})
