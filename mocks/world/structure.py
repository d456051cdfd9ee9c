"""Hidden effects of the structure: links, bearings and pedestal that give way under gravity.

M is the gravity moment (N.mm) at the joint, x the axis about which alpha_K turns. Group: structure.
"""

from __future__ import annotations

import numpy as np

from mocks.world.arm import Arm
from mocks.world.draw import Material
from mocks.world.effect import Effect, Values, joint_number
from mocks.world.kinematics import axis_frame

SOFT = {"c": "rad/(N.mm)"}


def parallel_twist(m: Material) -> Effect:
    """Hayati's beta of link K grows, label parallel_twist:jK; beta in deg."""
    i = joint_number(m.arguments[0]) - 1

    def act(arm: Arm, p: Values) -> None:
        arm.geometry.beta[i] += np.radians(p["beta"])

    return Effect(m.label, "arm", act, {"beta": 0.01 * m.sign()}, {"beta": "deg"})


def link_torsion(m: Material) -> Effect:
    """alpha_K grows by c (M . x), label link_torsion:jK.

    In modified DH alpha_K turns about x of frame K-1, in standard DH about x of frame K.
    """
    joint = joint_number(m.arguments[0])
    frame = joint - 1 if m.robot.convention == "mdh" else joint

    def act(arm: Arm, p: Values) -> None:
        x = arm.nominal_chain[frame][:3, 0]
        arm.geometry.alpha[joint - 1] += p["c"] * float(x @ arm.moments[joint - 1])

    return Effect(m.label, "arm", act, {"c": 1e-8}, SOFT)


def bearing_tilt(m: Material) -> Effect:
    """Tilt the bearing of joint K by c times the moment across its axis, label bearing_tilt:jK.

    The rotation vector c (M - (M . z) z) is taken about the origin of the frame that carries the axis.
    """
    joint = joint_number(m.arguments[0])

    def act(arm: Arm, p: Values) -> None:
        frame = axis_frame(arm.robot.convention, arm.nominal_chain, joint)
        moment = frame[:3, :3].T @ arm.moments[joint - 1]
        arm.tilts[joint] = p["c"] * np.array([moment[0], moment[1], 0.0])

    return Effect(m.label, "arm", act, {"c": 1e-8}, SOFT)


def pedestal(m: Material) -> Effect:
    """Lean the base about its foot by c times the arm's overturning moment, about x and y."""

    def act(arm: Arm, p: Values) -> None:
        arm.lean = p["c"] * arm.overturning

    return Effect(m.label, "arm", act, {"c": 1e-9}, SOFT)
