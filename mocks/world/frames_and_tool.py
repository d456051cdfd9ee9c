"""Hidden effects of base, tool and payload: their places and weights.

The group is frames_and_tool. The two steps are of group procedure (a person bumped something). Tool numbers are
in the flange frame, base numbers in the world.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from mocks.world.arm import Arm
from mocks.world.draw import Material
from mocks.world.effect import Effect, Values
from mocks.world.transforms import Matrix, shift, turn

XYZ = ("dx", "dy", "dz")
TURNS = ("rx", "ry", "rz")


def payload_mass(m: Material) -> Effect:
    """Make the last load heavier than declared by `mass` kg.

    It shows through the compliances of the joints.
    """

    def act(arm: Arm, p: Values) -> None:
        last = arm.loads[-1]
        arm.loads[-1] = replace(last, mass_kg=last.mass_kg + p["mass"])

    return Effect(m.label, "loads", act, {"mass": 0.1 * m.sign()}, {"mass": "kg"})


def payload_cog(m: Material) -> Effect:
    """Shift the centre of the last load by dx, dy, dz mm in its frame."""

    def act(arm: Arm, p: Values) -> None:
        last = arm.loads[-1]
        x, y, z = last.cog_mm
        arm.loads[-1] = replace(last, cog_mm=(x + p["dx"], y + p["dy"], z + p["dz"]))

    amplitudes = {name: 10.0 * v for name, v in zip(XYZ, m.direction(3), strict=True)}
    return Effect(m.label, "loads", act, amplitudes, dict.fromkeys(XYZ, "mm"))


def move_tool(arm: Arm, motion: Matrix) -> None:
    """Apply `motion` (4, 4, flange frame) to all targets, after their earlier motions."""
    arm.tool = motion if arm.tool is None else motion @ arm.tool


def tool_offset(m: Material) -> Effect:
    """Shift all targets across axis 6 by dx, dy mm."""

    def act(arm: Arm, p: Values) -> None:
        move_tool(arm, shift(p["dx"], p["dy"], 0.0))

    dx, dy = m.direction(2)
    return Effect(m.label, "arm", act, {"dx": 0.1 * dx, "dy": 0.1 * dy}, {"dx": "mm", "dy": "mm"})


def tool_tilt(m: Material) -> Effect:
    """Turn all targets about a line across axis 6 through the flange, by rx, ry deg."""

    def act(arm: Arm, p: Values) -> None:
        move_tool(arm, turn((math.radians(p["rx"]), math.radians(p["ry"]), 0.0)))

    x, y = m.direction(2)
    return Effect(m.label, "arm", act, {"rx": 0.05 * x, "ry": 0.05 * y}, {"rx": "deg", "ry": "deg"})


def target_offset(m: Material) -> Effect:
    """Shift one target in the flange frame by dx, dy, dz mm, label target_offset:TX."""
    target = m.arguments[0]

    def act(arm: Arm, p: Values) -> None:
        arm.target_shift[target] = np.array([p["dx"], p["dy"], p["dz"]])

    amplitudes = {name: 0.1 * v for name, v in zip(XYZ, m.direction(3), strict=True)}
    return Effect(m.label, "arm", act, amplitudes, dict.fromkeys(XYZ, "mm"))


def move_base(arm: Arm, motion: Matrix) -> None:
    """Apply `motion` (4, 4, world frame) to the robot, after its earlier motions."""
    arm.shove = motion if arm.shove is None else motion @ arm.shove


def step(m: Material, departure: str) -> Effect:
    """Shift the tool (flange frame) or the base (world) at one reading, by label.

    dx, dy, dz are in mm. The textbook law is a translation that stays. A "relaxing_step" fades as exp(-(t -
    t_step)/relax). A "turning_step" also turns by rx, ry, rz deg about the flange's or the base's origin.
    """
    move = move_tool if m.label == "tool_shift" else move_base
    amplitudes = {name: 0.1 * v for name, v in zip(XYZ, m.direction(3), strict=True)}
    units = {**dict.fromkeys(XYZ, "mm"), "at_reading": "reading (0-based)"}
    constants: dict[str, float] = {"at_reading": m.step_reading()}
    if departure == "relaxing_step":
        constants["relax"] = m.session.duration_s * float(m.rng.uniform(0.10, 0.25))
        units["relax"] = "s"
    if departure == "turning_step":
        arm_mm = 150.0 if m.label == "tool_shift" else 500.0  # a lever at which turn and shift weigh the same
        size = math.degrees(0.1 / arm_mm) / 2.0
        amplitudes |= {name: size * v for name, v in zip(TURNS, m.direction(3), strict=True)}
        units |= dict.fromkeys(TURNS, "deg")
    seconds = m.session.seconds

    def act(arm: Arm, p: Values) -> None:
        if arm.state.reading < p["at_reading"]:
            return
        since_s = max(0.0, arm.state.t_s - p["at_reading"] * seconds)
        left = math.exp(-since_s / p["relax"]) if "relax" in p else 1.0
        motion = shift(left * p["dx"], left * p["dy"], left * p["dz"])
        if "rx" in p:
            motion = motion @ turn([math.radians(p[name]) for name in TURNS])
        move(arm, motion)

    return Effect(m.label, "arm", act, amplitudes, units, constants, departure)


def textbook_step(m: Material) -> Effect:
    """Step the tool or the base by a translation that stays."""
    return step(m, "textbook")


def relaxing_step(m: Material) -> Effect:
    """Departure: the step creeps back exponentially."""
    return step(m, "relaxing_step")


def turning_step(m: Material) -> Effect:
    """Departure: the step turns as well as shifts."""
    return step(m, "turning_step")
