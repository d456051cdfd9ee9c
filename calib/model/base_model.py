"""Base model of level 1, 2 or 3: base pose, links, Hayati's twist, compliance, targets.

The groups are those that the data set's `[model] fit` names. Usual sizes are wide: they constrain only
the parameters that the data do not determine. Sources: Nubiola, Annex I (31 parameters), Hayati 1983
(beta).
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
    """Build the effect of the positions of tool targets in the flange frame.

    Parameters
    ----------
    series : sequence of str
        Series of the readings that measured this tool.
    targets : mapping of str to bool
        Targets, and whether with their orientation.
    several : bool
        Whether other series have a separate tool.
    u_mm : mapping of str to float, optional
        Standard uncertainty per axis of the positions that are known with one.
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
    """Build the effect of the DH parameters that the pose of the base cannot absorb."""
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
    """Build the effect of gear compliance: joints 2..N turn by c x torque.

    Only joints that turn have it. Joint 1 is left out, as gravity does not load it.
    """
    return _compliance(tuple(k for k in range(2, robot.joints + 1) if k not in robot.slides))


@lru_cache(_KEPT)
def _compliance(turning: tuple[int, ...]) -> Effect:
    acts = {f"c{k}": (COMPLIANCE, 1.0, [(f"theta{k}", Torque(k))]) for k in turning}
    return effect("compliance", "base model", "robot", "Gears yield to gravity.", acts)


def joint_offsets(robot: Robot) -> Effect:
    """Build the effect of constant offsets of joints 2..N.

    They are already part of `geometry`; use this effect alone for a level-1 model.
    """
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
    """Build the effect of the positions of base targets in the world.

    `names` gives the standard uncertainty of each base target in mm, None if its position is unknown.
    """
    acts = {
        f"{name}.{axis}": ("mm", size, [(f"anchor.{axis}", ToAnchor(name))])
        for name, size in names.items()
        for axis in "xyz"
    }
    return effect("base_targets", "base model", "mounting", "The base targets are elsewhere.", acts)


def length_zero(series: str, several: bool) -> Effect:
    """Build the effect of a length meter's reading at zero distance.

    It is the zero of a draw-wire or the length of a bar, for one series.
    """
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
    """Build the effects of a base model.

    Parameters
    ----------
    groups : sequence of str
        Parameter groups.
    robot : Robot
        Nominal robot.
    series : sequence of str
        Names of the series.
    targets : sequence of mapping
        For each series, its measured targets, and whether with their orientation.
    anchors : mapping of str to float or None, optional
        Base targets that are not known exactly, with their standard uncertainty in mm (None: unknown).
    tool_u_mm : mapping of str to float, optional
        Standard uncertainty of tool targets, mm. These are parameters even without the group "tool".
    one_tool : bool, optional
        Whether all series measured the same tool.

    Raises
    ------
    KeyError
        A group is unknown.
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
    """Return the names that `priors` may have in addition to single parameters.

    They are kinds ('alpha') and groups ('compliance').
    """
    return {_kind(p.name) for e in effects for p in e.parameters} | {e.label for e in effects}


def adapted(
    effects: Sequence[Effect], hold: Sequence[str], priors: Mapping[str, float]
) -> tuple[Effect, ...]:
    """Remove the parameters of `hold` from effects, and change the sizes that `priors` names.

    Parameters
    ----------
    effects : sequence of Effect
        Effects to adapt.
    hold : sequence of str
        Names of parameters.
    priors : mapping of str to float
        Standard deviation, in the parameter's unit, by parameter name ('c5'), kind ('alpha') or group
        ('compliance').

    Raises
    ------
    KeyError
        No parameter has such a name.
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
    """Find the parameters to which names of parameters, kinds or groups refer."""
    said = set(names)
    return frozenset(p.name for e in effects for p in e.parameters if said & {p.name, _kind(p.name), e.label})


def _kind(name: str) -> str:
    return name.rstrip("0123456789")
