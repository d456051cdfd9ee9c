"""Twenty laws that the library does not contain, for the simulator: label foreign:NAME.

Each is written here from the physics of a cell, not from the library. Only amplitude `a` is scaled; a law that
turns joints counts it in deg, one that moves the point in mm. The argument of `law` lists where a report may locate
the law, by the beginning of the driver's name.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from mocks.world import Effect, World
from mocks.world.arm import Arm, Sight
from mocks.world.draw import torque_range
from mocks.world.effect import Stage, Values
from mocks.world.gravity import moments, torques
from mocks.world.kinematics import frames

JOINTS = (
    "joint",
    "region",
    "direction of the tool",
)  # smooth in the joints: all of these are functions of them
LOADS = ("torque", "moment", "overturning")
ARRIVAL = ("side of approach", "last move", "last change")
TIME = ("time", "temperature")
Law = Callable[[World, np.random.Generator], Effect]
LAWS: dict[str, tuple[Law, tuple[str, ...]]] = {}
WAVES = 16


def law(*places: str) -> Callable[[Law], Law]:
    """Enter a law under its name, with the places where a report may locate it."""

    def enter(function: Law) -> Law:
        LAWS[function.__name__] = (function, places)
        return function

    return enter


def turning(name: str, joint: int, angle: Callable[[Arm], float]) -> Effect:
    """A law that adds a x angle(arm) deg to a joint, 1-based."""

    def act(arm: Arm, p: Values) -> None:
        arm.extra_angle[joint - 1] += math.radians(p["a"]) * angle(arm)

    return Effect(f"foreign:{name}", "arm", act, {"a": 0.01}, {"a": "deg"}, shape="foreign")


def moving(name: str, stage: Stage, by: Callable[[Sight], Any]) -> Effect:
    """A law that moves the point by a x by(sight) (3,), mm."""

    def act(sight: Sight, p: Values) -> None:
        sight.point = sight.point + p["a"] * np.asarray(by(sight))

    return Effect(f"foreign:{name}", stage, act, {"a": 0.05}, {"a": "mm"}, shape="foreign")


def field(rng: np.random.Generator, n: int) -> Callable[[Any], Any]:
    """A smooth random vector field (3,) of n coordinates in units of its correlation length."""
    waves, phases = rng.normal(size=(3, WAVES, n)), rng.uniform(0.0, 2.0 * math.pi, (3, WAVES))
    return lambda at: np.sqrt(2.0 / WAVES) * np.cos(waves @ np.asarray(at) + phases).sum(axis=1)


def largest(world: World, joint: int) -> float:
    """Largest gravity torque of a joint in 200 random poses, N.mm."""
    return max(float(torque_range(world.robot, tuple(world.loads))[joint - 1]), 1.0)


def flange(arm: Arm) -> Any:
    """Return the axes of the flange in the base frame, (3, 3)."""
    return arm.nominal_chain[-1][:3, :3]


@law(*JOINTS)
def hose(world: World, rng: np.random.Generator) -> Effect:
    """A hose wound about the wrist pulls joint 5 by the sum of joints 4 and 6."""
    return turning("hose", 5, lambda arm: math.sin(1.3 * (arm.angles[3] + arm.angles[5])))


@law(*ARRIVAL, *LOADS)
def gap_by_load(world: World, rng: np.random.Generator) -> Effect:
    """Play of joint 2 that opens with the square of its load, as the housing gives way."""
    top = largest(world, 2)
    return turning("gap_by_load", 2, lambda arm: arm.state.sides[1] * (arm.torques[1] / top) ** 2)


@law(*ARRIVAL)
def worn_teeth(world: World, rng: np.random.Generator) -> Effect:
    """Play of joint 1 over a third of its range alone, where the arm always works."""
    centre = float(rng.uniform(-0.5, 0.5))
    return turning(
        "worn_teeth", 1, lambda arm: arm.state.sides[0] * math.exp(-(((arm.angles[0] - centre) / 0.6) ** 2))
    )


@law("direction of the tool", "side of the tool", "tool target and the side", *LOADS)
def tool_flex(world: World, rng: np.random.Generator) -> Effect:
    """The tool's post bends across one of its axes, by the weight across that axis."""
    return _bending("tool_flex", lambda across: across)


@law("direction of the tool", "side of the tool", "tool target and the side", *LOADS)
def tool_flex_squared(world: World, rng: np.random.Generator) -> Effect:
    """The same, with the square of the weight across: it gives way more the more it is bent."""
    return _bending("tool_flex_squared", lambda across: across * abs(across) * 1.5)


def _bending(name: str, by: Callable[[float], float]) -> Effect:
    def act(arm: Arm, p: Values) -> None:
        down = flange(arm).T @ np.array([0.0, 0.0, -1.0])
        for target, place in (("T1", 1.0), ("T2", 0.4), ("T3", 1.7)):
            shift = np.array([p["a"] * place * by(float(down[0])), 0.0, 0.0])
            arm.target_shift[target] = arm.target_shift.get(target, np.zeros(3)) + shift

    return Effect(f"foreign:{name}", "arm", act, {"a": 0.05}, {"a": "mm"}, shape="foreign")


@law(*LOADS, *JOINTS)
def torque_squared(world: World, rng: np.random.Generator) -> Effect:
    """Joint 3 gives way by the square of its torque, on whichever side the load hangs."""
    top = largest(world, 3)
    return turning("torque_squared", 3, lambda arm: (arm.torques[2] / top) ** 2)


@law(*LOADS, *JOINTS)
def torque_by_torque(world: World, rng: np.random.Generator) -> Effect:
    """Bend the upper arm under joint 3's load when joint 5's load turns the wrist out of line.

    The error is the product of the two torques.
    """
    top3, top5 = largest(world, 3), largest(world, 5)
    return turning("torque_by_torque", 4, lambda arm: (arm.torques[2] / top3) * (arm.torques[4] / top5) * 3.0)


@law(*TIME)
def relaxing_step(world: World, rng: np.random.Generator) -> Effect:
    """Displace the instrument's stand by a blow.

    It creeps back within a twelfth of the campaign.
    """
    duration = world.session.duration_s
    begin, along = float(rng.uniform(0.2, 0.7)) * duration, rng.normal(size=3)

    def by(sight: Sight) -> Any:
        late = (sight.state.t_s - begin) / (duration / 12.0)
        return along * (math.exp(-late) if late >= 0.0 else 0.0) * 3.0

    return moving("relaxing_step", "instrument", by)


@law(*TIME)
def correlated_noise(world: World, rng: np.random.Generator) -> Effect:
    """Add noise that each reading keeps by 0.9 of the one before, as from layers of air."""
    n = world.session.readings
    noise = rng.normal(size=(n + 8, 3))
    for i in range(1, len(noise)):
        noise[i] = 0.9 * noise[i - 1] + math.sqrt(1.0 - 0.81) * noise[i]
    return moving("correlated_noise", "instrument", lambda sight: noise[sight.state.reading])


@law(*TIME)
def crane(world: World, rng: np.random.Generator) -> Effect:
    """The floor bends as a crane passes to and fro, seven times in the campaign."""
    along, phase = rng.normal(size=3), float(rng.uniform(0.0, 6.0))
    rate = 2.0 * math.pi * 7.0 / world.session.duration_s
    return moving("crane", "instrument", lambda sight: along * math.sin(rate * sight.state.t_s + phase))


@law(*JOINTS)
def cable_pull(world: World, rng: np.random.Generator) -> Effect:
    """A cable goes taut where joint 4 and joint 2 are both turned far, and pulls joint 3."""
    return turning(
        "cable_pull",
        3,
        lambda arm: max(0.0, 0.6 * arm.angles[3] + arm.angles[1] - 0.3) ** 2,
    )


@law(*ARRIVAL, *LOADS)
def hysteresis(world: World, rng: np.random.Generator) -> Effect:
    """Joint 2's gear keeps a part of how the load changed in the last move: tanh of the change."""
    geometry, kind = world._nominal_geometry, world.robot.convention

    def load(angles: list[float]) -> float:
        chain = frames(kind, geometry, angles)
        return torques(kind, chain, moments(kind, chain, world.loads))[1]

    width = 0.03 * largest(world, 2)
    return turning("hysteresis", 2, lambda arm: math.tanh((load(arm.angles) - load(arm.previous)) / width))


@law(*JOINTS)
def joint_field(world: World, rng: np.random.Generator) -> Effect:
    """A smooth field over joints 1, 3 and 5, with a correlation length of 55 deg."""
    of = field(rng, 3)
    return moving(
        "joint_field", "point", lambda sight: of([sight.state.joints_deg[i] / 55.0 for i in (0, 2, 4)])
    )


@law("region", *JOINTS)
def room_field(world: World, rng: np.random.Generator) -> Effect:
    """Add a smooth field over the workspace with a correlation length of 250 mm.

    Air or floor cause such a field.
    """
    of = field(rng, 3)
    return moving("room_field", "point", lambda sight: of(sight.point / 250.0))


@law("direction of the tool", *JOINTS)
def turned_field(world: World, rng: np.random.Generator) -> Effect:
    """An error of the point that depends on where the tool's axis looks."""
    of = field(rng, 3)

    def act(arm: Arm, p: Values) -> None:
        shift = p["a"] * of(flange(arm)[:, 2] * 1.2)
        for target in ("T1", "T2", "T3"):
            arm.target_shift[target] = arm.target_shift.get(target, np.zeros(3)) + flange(arm).T @ shift

    return Effect("foreign:turned_field", "arm", act, {"a": 0.05}, {"a": "mm"}, shape="foreign")


@law(*JOINTS, *LOADS)
def lever(world: World, rng: np.random.Generator) -> Effect:
    """A parallel rod that is not parallel: joint 2 errs by sin(2 q2 - 3 q3)."""
    return turning("lever", 2, lambda arm: math.sin(2.0 * arm.angles[1] - 3.0 * arm.angles[2]))


@law("overturning", "joint 1", "region", *LOADS)
def weak_floor(world: World, rng: np.random.Generator) -> Effect:
    """Lean the base on a floor that is soft on one side only.

    The floor yields to the square of the moment towards that side.
    """
    side = float(rng.uniform(-math.pi, math.pi))

    def act(arm: Arm, p: Values) -> None:
        over = math.cos(side) * float(arm.overturning[0]) + math.sin(side) * float(arm.overturning[1])
        lean = math.radians(p["a"]) * max(0.0, over / 1e4) ** 2
        turn = np.array([math.cos(side) * lean, math.sin(side) * lean, 0.0])
        arm.lean = turn if arm.lean is None else np.asarray(arm.lean) + turn

    return Effect("foreign:weak_floor", "arm", act, {"a": 0.01}, {"a": "deg"}, shape="foreign")


@law("direction of view", "region", *JOINTS)
def instrument_circle(world: World, rng: np.random.Generator) -> Effect:
    """Add an eccentricity of high order to the instrument's horizontal circle.

    The errors are across the beam, by azimuth.
    """
    phase = float(rng.uniform(0.0, 6.0))

    def by(sight: Sight) -> Any:
        beam = sight.point - sight.station
        azimuth = math.atan2(beam[1], beam[0])
        return np.array([-beam[1], beam[0], 0.0]) / 1e3 * math.sin(12.0 * azimuth + phase)

    return moving("instrument_circle", "instrument", by)


@law("tool target", "side of the tool", "direction of the tool", *LOADS)
def loose_nest(world: World, rng: np.random.Generator) -> Effect:
    """The nest of T2 is loose and falls to whichever side is down."""
    axis = rng.normal(size=3)
    axis /= np.linalg.norm(axis)

    def act(arm: Arm, p: Values) -> None:
        down = flange(arm).T @ np.array([0.0, 0.0, -1.0])
        arm.target_shift["T2"] = p["a"] * axis * math.copysign(1.0, float(axis @ down))

    return Effect("foreign:loose_nest", "arm", act, {"a": 0.05}, {"a": "mm"}, shape="foreign")


@law("each pose")
def every_pose(world: World, rng: np.random.Generator) -> Effect:
    """Give each pose a random error that is the same at every visit.

    This is a rough gear, sampled at few places.
    """

    def by(sight: Sight) -> Any:
        return np.random.default_rng([7, *(int(1e3 * (q + 720.0)) for q in sight.state.joints_deg)]).normal(
            size=3
        )

    return moving("every_pose", "point", by)
