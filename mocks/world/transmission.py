"""Hidden effects of gears, encoders and bearings: additions to the model's joint angles.

theta is the commanded joint angle, tau the gravity torque about the joint's axis. The group is transmission;
settling is of group procedure (the pause before the reading was too short). Values that physics forbids are not
drawn. Gaps, compliances and lags are never negative.
"""

from __future__ import annotations

import math

from mocks.world.arm import Arm
from mocks.world.draw import Material
from mocks.world.effect import Effect, Values, joint_number

DEG = math.pi / 180.0


def periodic(m: Material) -> Effect:
    """Add A cos(H theta) + B sin(H theta), label periodic:jK:nH; A, B in deg."""
    i = joint_number(m.arguments[0]) - 1
    if not m.arguments[1].startswith("n"):
        raise ValueError(f"{m.label!r} lacks its order, as in periodic:j2:n3")
    order = float(m.arguments[1][1:])

    def act(arm: Arm, p: Values) -> None:
        phase = p["order"] * arm.angles[i]
        arm.extra_angle[i] += DEG * (p["A"] * math.cos(phase) + p["B"] * math.sin(phase))

    a, b = m.direction(2)
    units = {"A": "deg", "B": "deg", "order": "cycles/turn"}
    return Effect(m.label, "arm", act, {"A": 0.01 * a, "B": 0.01 * b}, units, {"order": order})


def encoder_scale(m: Material) -> Effect:
    """Scale of an encoder, k theta; label encoder_scale:jK, k in rad/rad."""
    i = joint_number(m.arguments[0]) - 1

    def act(arm: Arm, p: Values) -> None:
        arm.extra_angle[i] += p["k"] * arm.angles[i]

    return Effect(m.label, "arm", act, {"k": 1e-4 * m.sign()}, {"k": "1"})


def joint_offset(m: Material) -> Effect:
    """Add a constant angle, label joint_offset:jK; deg."""
    i = joint_number(m.arguments[0]) - 1

    def act(arm: Arm, p: Values) -> None:
        arm.extra_angle[i] += DEG * p["offset"]

    return Effect(m.label, "arm", act, {"offset": 0.01 * m.sign()}, {"offset": "deg"})


def joint_step(m: Material) -> Effect:
    """Step the zero of a joint at one reading, label joint_step:jK; step in deg."""
    i = joint_number(m.arguments[0]) - 1

    def act(arm: Arm, p: Values) -> None:
        if arm.state.reading >= p["at_reading"]:
            arm.extra_angle[i] += DEG * p["step"]

    units = {"step": "deg", "at_reading": "reading (0-based)"}
    return Effect(
        m.label, "arm", act, {"step": 0.02 * m.sign()}, units, {"at_reading": float(m.step_reading())}
    )


def joint_compliance(m: Material) -> Effect:
    """Add c tau beyond the compliance that the true robot already has, c in rad/(N.mm).

    The label is joint_compliance:jK.
    """
    i = joint_number(m.arguments[0]) - 1

    def act(arm: Arm, p: Values) -> None:
        arm.extra_angle[i] += p["c"] * arm.torques[i]

    return Effect(m.label, "arm", act, {"c": 1e-8}, {"c": "rad/(N.mm)"})


def backlash(m: Material) -> Effect:
    """gap/2 x side of approach, label backlash:jK; gap in deg."""
    i = joint_number(m.arguments[0]) - 1

    def act(arm: Arm, p: Values) -> None:
        arm.extra_angle[i] += DEG * p["gap"] / 2.0 * arm.state.sides[i]

    return Effect(m.label, "arm", act, {"gap": 0.01}, {"gap": "deg"})


def backlash_load(m: Material) -> Effect:
    """c/2 x |tau| x side of approach, label backlash_load:jK; c in rad/(N.mm)."""
    i = joint_number(m.arguments[0]) - 1
    if m.torque_range(i + 1) < 1.0:
        raise ValueError(f"{m.label}: gravity never loads joint {i + 1}")

    def act(arm: Arm, p: Values) -> None:
        arm.extra_angle[i] += p["c"] / 2.0 * abs(arm.torques[i]) * arm.state.sides[i]

    return Effect(m.label, "arm", act, {"c": 1e-8}, {"c": "rad/(N.mm)"})


def lost_motion(m: Material) -> Effect:
    """Stop the joint short by width/2 on its side of approach, width in deg.

    The added angle is -width/2 x side of approach. The label is lost_motion:jK.
    """
    i = joint_number(m.arguments[0]) - 1

    def act(arm: Arm, p: Values) -> None:
        arm.extra_angle[i] -= DEG * p["width"] / 2.0 * arm.state.sides[i]

    return Effect(m.label, "arm", act, {"width": 0.01}, {"width": "deg"})


def gravity_closed_backlash(m: Material) -> Effect:
    """Departure: the load presses the teeth together, gap/2 x side x exp(-|tau| / tau_0).

    tau_0 is half the joint's largest gravity torque; N.mm.
    """
    i = joint_number(m.arguments[0]) - 1

    def act(arm: Arm, p: Values) -> None:
        open_share = math.exp(-abs(arm.torques[i]) / p["tau_0"])
        arm.extra_angle[i] += DEG * p["gap"] / 2.0 * arm.state.sides[i] * open_share

    constants = {"tau_0": max(0.5 * m.torque_range(i + 1), 1.0)}  # an unloaded joint keeps its gap
    units = {"gap": "deg", "tau_0": "N.mm"}
    name = "gravity_closed_backlash"
    return Effect(m.label, "arm", act, {"gap": 0.01}, units, constants, name)


def dead_zone(m: Material, share: float = 0.05, shape: str = "textbook") -> Effect:
    """gap/2 x sign(tau), smoothed as tanh(tau / width), label dead_zone:jK; gap in deg.

    `share` is width over the joint's largest gravity torque: 5 % in the textbook law.
    """
    i = joint_number(m.arguments[0]) - 1
    width = share * m.torque_range(i + 1)
    if width < 1e-6:  # rounding errors are no load
        raise ValueError(f"{m.label}: gravity never loads joint {i + 1}")

    def act(arm: Arm, p: Values) -> None:
        arm.extra_angle[i] += DEG * p["gap"] / 2.0 * math.tanh(arm.torques[i] / p["width"])

    units = {"gap": "deg", "width": "N.mm"}
    return Effect(m.label, "arm", act, {"gap": 0.01}, units, {"width": width}, shape)


def smoothed_dead_zone(m: Material) -> Effect:
    """Departure: a dead zone whose edges are smoothed over 25 % of the torque's range."""
    return dead_zone(m, share=0.25, shape="smoothed_dead_zone")


def cubic_stiffness(m: Material) -> Effect:
    """Cubic compliance, c tau^3; label cubic_stiffness:jK, c in rad/(N.mm)^3."""
    i = joint_number(m.arguments[0]) - 1

    def act(arm: Arm, p: Values) -> None:
        arm.extra_angle[i] += p["c"] * arm.torques[i] ** 3

    size = 1e-4 / max(m.torque_range(i + 1), 1.0) ** 3
    return Effect(m.label, "arm", act, {"c": size * m.sign()}, {"c": "rad/(N.mm)^3"})


def settling(m: Material) -> Effect:
    """Add -k (theta - previous theta), as the joint has not arrived yet, k in rad/rad.

    The label is settling:jK.
    """
    i = joint_number(m.arguments[0]) - 1

    def act(arm: Arm, p: Values) -> None:
        arm.extra_angle[i] -= p["k"] * (arm.angles[i] - arm.previous[i])

    return Effect(m.label, "arm", act, {"k": 1e-4}, {"k": "1"})


def coupling(m: Material) -> Effect:
    """Joint B turns by k theta_A, label coupling:jA-jB; k in rad/rad."""
    first, _, second = m.arguments[0].partition("-")
    a, b = joint_number(first) - 1, joint_number(second) - 1

    def act(arm: Arm, p: Values) -> None:
        arm.extra_angle[b] += p["k"] * arm.angles[a]

    return Effect(m.label, "arm", act, {"k": 1e-4 * m.sign()}, {"k": "1"})


def non_integer_gear(m: Material) -> Effect:
    """Add a departure in which the gear's order is a quarter off an integer.

    The label says so (n3 becomes n3.25).
    """
    joint, order = m.arguments
    shifted = f"n{float(order[1:]) + 0.25:g}"
    effect = periodic(
        Material(f"periodic:{joint}:{shifted}", (joint, shifted), m.robot, m.loads, m.session, m.rng)
    )
    return Effect(
        effect.label,
        "arm",
        effect.act,
        effect.amplitudes,
        effect.units,
        effect.constants,
        "non_integer_gear",
    )
