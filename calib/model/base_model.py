"""The base model of level 1, 2 or 3: base pose, link geometry, Hayati's twist, gear compliance, tool targets.

Groups as the data set's `[model] fit` names them. Expected sizes are wide: they only constrain what the data do
not determine. Source: Nubiola, Annex I (31 parameters); Hayati 1983 (beta).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache

from calib.arm.robot import Robot
from calib.model.effect import Effect, effect
from calib.model.regressors import Constant, InSeries, JointAngle, OnTarget, Regressor, ToAnchor, Torque

COMPLIANCE = "1e-6 rad/(N.mm)"
"""Unit of the compliance of a gear."""

OF_ESTIMATED_LOADS = 3.0
"""Usual size of a compliance if the loads are estimates, in its unit: it takes up the error of their scale."""

_KEPT = 64  # groups, the same for every fit of a robot; a service that lives for months forgets the others
_GEOMETRY = {"alpha": ("deg", 0.2), "a": ("mm", 1.0), "theta": ("deg", 1.0), "d": ("mm", 1.0)}


@lru_cache(_KEPT)
def base(series: str, several: bool) -> Effect:
    """Pose of the base in the world: x, y, z, then turns about x, y, z. One per series."""
    in_series: Regressor = InSeries(series) if several else Constant()
    suffix = f"[{series}]" if several else ""
    acts = {
        f"base{suffix}.{axis}": ("mm" if len(axis) == 1 else "deg", None, [(f"base.{axis}", in_series)])
        for axis in ("x", "y", "z", "rx", "ry", "rz")
    }
    return effect(f"base{suffix}", "base model", "mounting", "The base is elsewhere.", acts)


def tool(
    series: Sequence[str], targets: Mapping[str, bool], several: bool, u_mm: Mapping[str, float] | None = None
) -> Effect:
    """Position of every tool target in the flange frame; with its orientation where `targets` says so.

    series: of the readings that measured this tool; several: whether other series have a tool of their own; u_mm:
    standard uncertainty of the positions that are known to one, mm per axis.
    """
    suffix, sizes = f"[{series[0]}]" if several else "", u_mm or {}
    acts = {
        f"{target}{suffix}.{axis}": (
            "deg" if axis[0] == "r" else "mm",
            None if axis[0] == "r" else sizes.get(target),
            [(f"target.{axis}", OnTarget(each, target)) for each in series],
        )
        for target, turned in targets.items()
        for axis in (("x", "y", "z", "rx", "ry", "rz") if turned else "xyz")
    }
    return effect(
        f"tool{suffix}", "base model", "mounting", "The tool targets sit elsewhere on the flange.", acts
    )


def geometry(robot: Robot) -> Effect:
    """The DH parameters of the links that the pose of the base cannot absorb."""
    return _geometry(robot.geometric_links)


@lru_cache(_KEPT)
def _geometry(links: tuple[tuple[str, int], ...]) -> Effect:
    acts = {f"{kind}{link}": (*_GEOMETRY[kind], [(f"{kind}{link}", Constant())]) for kind, link in links}
    return effect("geometry", "base model", "robot", "Links are longer, offset or twisted.", acts)


def parallel_twist(robot: Robot) -> Effect:
    """Hayati's beta where two axes are parallel by design."""
    acts = {f"beta{k}": ("deg", 0.2, [(f"beta{k}", Constant())]) for k in robot.parallel_axes}
    return effect("parallel_twist", "base model", "robot", "Axes meant to be parallel are twisted.", acts)


def compliance(robot: Robot) -> Effect:
    """Gear compliance of every joint that turns and that gravity loads: joints 2..N turn by c x torque."""
    return _compliance(tuple(k for k in range(2, robot.joints + 1) if k not in robot.slides))


@lru_cache(_KEPT)
def _compliance(turning: tuple[int, ...]) -> Effect:
    acts = {f"c{k}": (COMPLIANCE, 1.0, [(f"theta{k}", Torque(k))]) for k in turning}
    return effect("compliance", "base model", "robot", "Gears yield to gravity.", acts)


def joint_offsets(robot: Robot) -> Effect:
    """Constant offset of joints 2..N (part of `geometry` already: use it alone for a level-1 model)."""
    acts = {
        f"offset{k}": (unit, 3.0, [(slot, Constant())])
        for k, (unit, slot) in enumerate(zip(robot.units, robot.joint_slots, strict=True), start=1)
        if k > 1
    }
    return effect("joint_offsets", "base model", "robot", "Joint zeros are off.", acts)


def encoder_scale(robot: Robot) -> Effect:
    """Scale of every joint's encoder."""
    acts = {
        f"scale{k}": ("ppm", 1000.0, [(slot, JointAngle(k))])
        for k, slot in enumerate(robot.joint_slots, start=1)
    }
    return effect("encoder_scale", "base model", "robot", "Joints move more or less than they count.", acts)


def base_targets(names: Mapping[str, float | None]) -> Effect:
    """Positions of base targets in the world; names: base target -> standard uncertainty in mm, None where unknown."""
    acts = {
        f"{name}.{axis}": ("mm", size, [(f"anchor.{axis}", ToAnchor(name))])
        for name, size in names.items()
        for axis in "xyz"
    }
    return effect("base_targets", "base model", "mounting", "The base targets are elsewhere.", acts)


def length_zero(series: str, several: bool) -> Effect:
    """The reading of a series' length meter at zero distance: the zero of a draw-wire, the length of a bar."""
    name = f"length_zero[{series}]" if several else "length_zero"
    acts = {name: ("mm", None, [("length.zero", InSeries(series) if several else Constant())])}
    return effect(name, "base model", "instrument", "Lengths count from an unknown zero.", acts)


def build(
    groups: Sequence[str],
    robot: Robot,
    series: Sequence[str],
    targets: Sequence[Mapping[str, bool]],
    anchors: Mapping[str, float | None] | None = None,
    tool_u_mm: Mapping[str, float] | None = None,
    *,
    one_tool: bool = False,
) -> tuple[Effect, ...]:
    """The effects of a base model.

    series: names; targets: name of every target measured in each series, and whether with its orientation;
    anchors: base targets that are not known exactly, with their standard uncertainty in mm (None: unknown);
    tool_u_mm: the same of tool targets, which are parameters then without the group "tool"; one_tool: whether all
    series measured the same tool.
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
    tools = [((name,), names) for name, names in zip(series, targets, strict=True)]
    if one_tool and several:
        seen = {target: any(of.get(target, False) for of in targets) for names in targets for target in names}
        tools = [(tuple(series), seen)]
    effects: list[Effect] = []
    for group in groups:
        if group == "base":
            effects += [base(name, several) for name in series]
        elif group == "tool":
            effects += [tool(of, names, len(tools) > 1, tool_u_mm) for of, names in tools]
        elif group == "length_zero":
            effects += [length_zero(name, several) for name in series]
        else:
            effects.append(of_robot[group](robot))
    if tool_u_mm and "tool" not in groups:
        for of, names in tools:
            known = dict.fromkeys((target for target in names if target in tool_u_mm), False)
            effects.append(tool(of, known, len(tools) > 1, tool_u_mm))
    if anchors:
        effects.append(base_targets(anchors))
    return tuple(e for e in effects if e.parameters)


def kinds_of(effects: Sequence[Effect]) -> set[str]:
    """The names that `priors` may have beside single parameters: kinds ('alpha') and groups ('compliance')."""
    return {_kind(p.name) for e in effects for p in e.parameters} | {e.label for e in effects}


def adapted(
    effects: Sequence[Effect], hold: Sequence[str], priors: Mapping[str, float]
) -> tuple[Effect, ...]:
    """The effects without the parameters of `hold`, and with other sizes for those that `priors` names.

    priors: standard deviation, in the parameter's unit, by parameter name ('c5'), kind ('alpha') or group
    ('compliance'). Raises KeyError for a name that no parameter answers to.
    """
    names = {p.name for e in effects for p in e.parameters}
    kinds = kinds_of(effects)
    for name in (*hold, *priors):
        if name not in names and (name in hold or name not in kinds):
            raise KeyError(name)
    out = []
    for e in effects:
        kept = tuple(
            replace(
                p, size=next((priors[k] for k in (p.name, _kind(p.name), e.label) if k in priors), p.size)
            )
            for p in e.parameters
            if p.name not in hold
        )
        left = {p.name for p in kept}
        out.append(replace(e, parameters=kept, terms=tuple(t for t in e.terms if t.parameter in left)))
    return tuple(e for e in out if e.parameters)


def named_in(effects: Sequence[Effect], names: Iterable[str]) -> frozenset[str]:
    """The parameters that some names of parameters, kinds ('alpha') or groups ('compliance') speak of."""
    said = set(names)
    return frozenset(p.name for e in effects for p in e.parameters if said & {p.name, _kind(p.name), e.label})


def _kind(name: str) -> str:
    return name.rstrip("0123456789")
