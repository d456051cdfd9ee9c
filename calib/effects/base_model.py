"""What a level-1, 2 or 3 model frees: base pose, link geometry, Hayati's twist, gear compliance, tool targets.

Groups as the data set's `[model] fit` names them. Expected sizes are wide: they only steady what the data say
nothing about. Source: Nubiola, Annex I (31 parameters); Hayati 1983 (beta).
"""

from __future__ import annotations

from collections.abc import Sequence

from calib.effects.effect import Effect, effect
from calib.regressors import Constant, InSeries, JointAngle, OnTarget, Regressor, Torque
from calib.robot import Robot

GROUPS = ("base", "geometry", "parallel_twist", "compliance", "tool", "joint_offsets", "encoder_scale")
DEFAULT_GROUPS = ("base", "geometry", "parallel_twist", "compliance")

_GEOMETRY = {"alpha": ("deg", 0.2), "a": ("mm", 1.0), "theta": ("deg", 1.0), "d": ("mm", 1.0)}


def base(series: str, several: bool) -> Effect:
    """Pose of the base in the world: x, y, z, then turns about x, y, z. One per series."""
    in_series: Regressor = InSeries(series) if several else Constant()
    suffix = f"[{series}]" if several else ""
    acts = {
        f"base{suffix}.{axis}": ("mm" if len(axis) == 1 else "deg", None, [(f"base.{axis}", in_series)])
        for axis in ("x", "y", "z", "rx", "ry", "rz")
    }
    return effect(f"base{suffix}", "base model", "mounting", "The base stands elsewhere.", acts)


def tool(series: str, targets: Sequence[str], several: bool) -> Effect:
    """Position of every tool target of a series in the flange frame."""
    suffix = f"[{series}]" if several else ""
    acts = {
        f"{target}{suffix}.{axis}": ("mm", None, [(f"target.{axis}", OnTarget(series, target))])
        for target in targets
        for axis in "xyz"
    }
    return effect(
        f"tool{suffix}", "base model", "mounting", "The tool targets sit elsewhere on the flange.", acts
    )


def geometry(robot: Robot) -> Effect:
    """DH numbers of the links that the base pose cannot absorb."""
    acts = {
        f"{kind}{link}": (*_GEOMETRY[kind], [(f"{kind}{link}", Constant())])
        for kind, link in robot.geometric_links
    }
    return effect("geometry", "base model", "robot", "Links are longer, offset or twisted.", acts)


def parallel_twist(robot: Robot) -> Effect:
    """Hayati's beta where two axes are meant to be parallel."""
    acts = {f"beta{k}": ("deg", 0.2, [(f"beta{k}", Constant())]) for k in robot.parallel_axes}
    return effect("parallel_twist", "base model", "robot", "Axes meant to be parallel are twisted.", acts)


def compliance(robot: Robot) -> Effect:
    """Gear compliance of every joint that gravity loads: joints 2..N turn by c x torque."""
    acts = {f"c{k}": ("1e-6 rad/(N.mm)", 1.0, [(f"theta{k}", Torque(k))]) for k in range(2, robot.joints + 1)}
    return effect("compliance", "base model", "robot", "Gears yield to gravity.", acts)


def joint_offsets(robot: Robot) -> Effect:
    """Constant offset of joints 2..N (part of `geometry` already: use it alone for a level-1 model)."""
    acts = {f"offset{k}": ("deg", 3.0, [(f"theta{k}", Constant())]) for k in range(2, robot.joints + 1)}
    return effect("joint_offsets", "base model", "robot", "Joint zeros are off.", acts)


def encoder_scale(robot: Robot) -> Effect:
    """Scale of every joint's encoder."""
    acts = {f"scale{k}": ("ppm", 1000.0, [(f"theta{k}", JointAngle(k))]) for k in range(1, robot.joints + 1)}
    return effect("encoder_scale", "base model", "robot", "Joints turn more or less than they count.", acts)


def build(
    groups: Sequence[str], robot: Robot, series: Sequence[str], targets: Sequence[Sequence[str]]
) -> tuple[Effect, ...]:
    """The effects of a base model. series: names; targets: names of the targets measured in each series.

    Raises KeyError for an unknown group.
    """
    of_robot = {
        "geometry": geometry,
        "parallel_twist": parallel_twist,
        "compliance": compliance,
        "joint_offsets": joint_offsets,
        "encoder_scale": encoder_scale,
    }
    several = len(series) > 1
    effects: list[Effect] = []
    for group in groups:
        if group == "base":
            effects += [base(name, several) for name in series]
        elif group == "tool":
            effects += [tool(name, names, several) for name, names in zip(series, targets, strict=True)]
        else:
            effects.append(of_robot[group](robot))
    return tuple(e for e in effects if e.parameters)
