"""Robot with the errors of a real arm, and its true landing from the laws of the effects.

The laws are written out by hand: the landing uses no part of `calib.compensate` and no regressor.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from calib import Robot, StatedConditions, load_robot
from calib.arm import gravity_torques
from calib.array import Array
from calib.data import DEFAULT_GROUPS
from calib.effects.geometry import base_shift, tool_shift
from calib.effects.instrument import drift_rotation, drift_translation
from calib.effects.thermal import thermal_growth
from calib.effects.transmission import backlash, periodic
from calib.model import ModelStructure, base_model
from calib.units import to_internal
from tests.calib.chain import chain

ROBOT = load_robot("abb-irb120")
TARGETS = {"T1": (0.0, 0.0, 125.0), "T2": (75.0, 93.675, 215.0), "T3": (150.0, 0.0, 125.0)}
RANGES = np.radians([[-90, 90], [0, 110], [-80, 70], [-150, 150], [-90, 90], [-180, 180]])
WIDE = RANGES + np.radians([-20.0, 20.0])
STATED = StatedConditions(side=1.0, temperature_c=23.5, time_s=4000.0)
# Displayed sizes of a real arm's errors, by kind of base-model parameter: those of the thesis's Table 2.6.
SIZES = {"alpha": 0.04, "beta": 0.03, "theta": 0.12, "a": 0.25, "d": 0.25, "c": 0.4}
EFFECTS = {
    "backlash:j4.gap": 0.03,
    "periodic:j3:n2.cos": 0.02,
    "periodic:j3:n2.sin": -0.03,
    "thermal_growth.expansion": 40.0,
    "tool_shift.x": 0.3,
    "tool_shift.rz": 0.1,
    "base_shift.y": -0.4,
    "base_shift.rx": 0.05,
    "drift_translation.x": 3.0,
    "drift_rotation.rz": 0.5,
}


def only_geometry(robot: Robot, seed: int) -> tuple[ModelStructure, Array]:
    """Draw the base model of a robot with usual parameters.

    The parameters are tenths of a millimetre and hundredths of a degree.
    """
    rng = np.random.default_rng(seed)
    effects = base_model.build(DEFAULT_GROUPS, robot, ("main",), ({"T1": False},))
    model = ModelStructure(robot, effects, {"main": {"T1": (0.0, 0.0, 100.0)}})
    sizes = {"mm": 0.25, "deg": 0.04}
    estimate = [to_internal(rng.normal() * sizes.get(p.unit, 0.1), p.unit) for p in model.parameters]
    return model, np.array(estimate)


def real_robot(seed: int, robot: Robot = ROBOT) -> tuple[ModelStructure, Array]:
    """A model with the errors of a real arm and every kind of effect; drawn from the seed."""
    rng = np.random.default_rng(seed)
    effects = (
        *base_model.build(DEFAULT_GROUPS, robot, ("main",), (dict.fromkeys(TARGETS, False),)),
        backlash(4),
        periodic(3, 2.0),
        thermal_growth(robot, 22.0),
        tool_shift(50.0),
        base_shift(80.0),
        drift_translation(),
        drift_rotation(),
    )
    model = ModelStructure(robot, effects, {"main": TARGETS}, station=(2400.0, -900.0, 350.0))
    estimate = np.zeros(len(model.parameters))
    for i, parameter in enumerate(model.parameters):
        size = EFFECTS.get(parameter.name)
        if size is None:
            kind = parameter.name.rstrip("0123456789")
            size = SIZES.get(kind, 0.3 if parameter.unit == "mm" else 0.02)
            size *= rng.choice((-1.0, 1.0)) * rng.uniform(0.6, 1.4)
        estimate[i] = to_internal(size, parameter.unit)
    return model, estimate


def random_targets(n: int, seed: int) -> Array:
    """Targets in the thesis's ranges."""
    return np.random.default_rng(seed).uniform(RANGES[:, 0], RANGES[:, 1], (n, 6))


def landing(model: ModelStructure, estimate: Array, joints: Array, target: Any = (0.0, 0.0, 0.0)) -> Array:
    """Compute the true landing poses by the slow second chain, (n, 4, 4).

    The conditions are those of `STATED`.
    """
    value = dict(zip((p.name for p in model.parameters), estimate, strict=True))
    torques = gravity_torques(model.robot, joints)
    return np.array(
        [
            chain(model.robot, q, slots_of(value, q, tau), target=target).real
            for q, tau in zip(joints, torques, strict=True)
        ]
    )


def slots_of(value: Mapping[str, float], q: Array, tau: Array) -> dict[str, float]:
    add: dict[str, float] = {}

    def put(slot: str, amount: float) -> None:
        add[slot] = add.get(slot, 0.0) + amount

    for name, x in value.items():
        kind = name.rstrip("0123456789")
        if kind in ("alpha", "beta", "theta", "a", "d") or name.startswith("base."):
            put(name, x)
        elif kind == "c":
            put(f"theta{name[1:]}", x * tau[int(name[1:]) - 1])
        elif name.startswith(("tool_shift.", "base_shift.")):
            put(name.replace("_shift", ""), x)
    put("theta4", 0.5 * value.get("backlash:j4.gap", 0.0))
    cos, sin = (value.get(f"periodic:j3:n2.{part}", 0.0) for part in ("cos", "sin"))
    put("theta3", cos * np.cos(2.0 * q[2]) + sin * np.sin(2.0 * q[2]))
    strain = value.get("thermal_growth.expansion", 0.0) * (23.5 - 22.0)
    for k in range(6):
        put(f"a{k + 1}", strain * ROBOT.a[k])
        put(f"d{k + 1}", strain * ROBOT.d[k])
    return add


def wanted_poses(joints: Array) -> Array:
    return np.array([chain(ROBOT, q, {}).real for q in joints])
