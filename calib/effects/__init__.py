"""Library of effects: everything that is known of each kind of effect.

The modules group the effects by place of action: `transmission`, `elasticity`, `geometry`, `thermal`, `slides` and
`instrument`. Other packages add effects by entry points of the group `truepose.effects`, each a module with KINDS and
offer.
"""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from calib.arm.robot import Robot
from calib.effects import elasticity, geometry, instrument, slides, thermal, transmission
from calib.effects.kind import EffectKind, EffectModule, Offers, Row
from calib.effects.survey import Survey, compliance_of
from calib.errors import DataError
from calib.model.effect import Effect
from calib.scan.families import Candidate, Harmonics, Shapes, Steps
from calib.scan.scores import Family

LIBRARY: tuple[EffectModule | Row, ...] = (
    transmission.PERIODIC,
    transmission.backlash,
    transmission.backlash_load,
    transmission.lost_motion,
    transmission.settling,
    transmission.encoder_scale,
    transmission.COUPLING,
    geometry.joint_offset,
    elasticity.joint_compliance,
    transmission.dead_zone,
    elasticity.cubic_stiffness,
    geometry.parallel_twist,
    elasticity.LINK_TORSION,
    elasticity.BEARING_TILT,
    elasticity.PEDESTAL,
    elasticity.PAYLOAD,
    geometry.TOOL,
    instrument.BASE_TARGET,
    geometry.SHIFT,
    geometry.JOINT_STEP,
    instrument.DRIFT,
    instrument.TRACKER_SCALE,
    thermal.THERMAL_GROWTH,
    thermal.thermal_joint,
    thermal.WARM_UP,
    thermal.ARM_GROWTH,
    transmission.GEAR_ORDERS,
    slides.slide_scale,
    slides.slide_backlash,
    slides.SLIDE_GUIDE,
    slides.slide_growth,
    slides.slide_compliance,
)


OF_GEARS = frozenset(
    {"periodic", "backlash", "lost_motion", "settling", "encoder_scale", "coupling", "slide_backlash"}
)
"""Kinds that blame a gear or its play and need no torque; those of stiffness are not offered without one."""

_JOINT = re.compile(r"\bj(\d+)")
_IN_LABEL = re.compile(r"(?<=[:-])j(\d+)")
_IN_WORDS = re.compile(r"\b([Jj]oint|[Ll]ink|and) (\d+)")


def entries() -> tuple[Offers, ...]:
    """Return the entries of the library and those of other packages.

    Raises
    ------
    DataError
        An entry of another package cannot be used.
    """
    return (*LIBRARY, *_installed())


@cache
def _installed() -> tuple[Any, ...]:
    points = entry_points(group="truepose.effects")
    return tuple(_loaded(point) for point in sorted(points, key=lambda each: each.name))


def _loaded(point: EntryPoint) -> Any:
    package = point.dist.name if point.dist is not None else point.value
    place = f"effect '{point.name}' of the package {package}"
    try:
        entry = point.load()
    except (ImportError, AttributeError) as error:
        raise DataError(
            f"cannot be loaded: {error}.", do="Repair or remove the package.", file=place
        ) from error
    missing = [name for name in ("KINDS", "offer") if not hasattr(entry, name)]
    if missing:
        raise DataError(f"has no {missing[0]}.", do="See docs/extend/add-an-effect.md.", file=place)
    return entry


def offers(survey: Survey) -> list[Family]:
    """List all candidates of the library for these readings.

    Candidates that the base model contains are left out. If the gravity load of a joint is not modelled, effects of its
    gear are left out too, because its sag looks like them.
    """
    proposals = [proposal for entry in entries() for proposal in entry.offer(survey)]
    new = [p for p in proposals if not (isinstance(p, Candidate) and survey.frees(p.effect))]
    return [_family_by_axis(p, survey.robot) for p in new if not _looks_like_sag(p.label, survey)]


def _looks_like_sag(label: str, survey: Survey) -> bool:
    kind, _, rest = label.partition(":")
    joints = {int(number) for number in _JOINT.findall(rest)}
    return kind in OF_GEARS and not joints.isdisjoint(survey.weightless)


def changes(survey: Survey) -> list[Effect]:
    """List the effects that may have begun since a calibration and that readings could show."""
    begun = [entry.changes(survey) for entry in LIBRARY if entry.changes is not None]
    return [by_axis(found, survey.robot) for several in begun for found in several]


def unclaimed(survey: Survey) -> list[Effect]:
    """List the effects that may be present undetected, and that later readings would show.

    These are effects that can set in, effects of the air temperature, and long waves. Few poses see one stretch of such
    a wave, which then looks like a lost zero.
    """
    offered = thermal.THERMAL_GROWTH.offer(survey)
    growth = [candidate.effect for candidate in offered if isinstance(candidate, Candidate)]
    waves = [by_axis(wave, survey.robot) for wave in transmission.long_waves(survey)]
    return [*changes(survey), *growth, *waves]


def by_axis(effect: Effect, robot: Robot) -> Effect:
    """Replace the link number in label, parameters and meaning by the name of the axis.

    The library counts joints as links, 1 to N. On a track, link 2 of the chain is joint 1 of the arm.
    """
    if _counts_alike(robot):
        return effect
    label, before = _label_by_axis(effect.label, robot), f"{effect.label}."

    def renamed(name: str) -> str:
        return f"{label}.{name.removeprefix(before)}" if name.startswith(before) else name

    return replace(
        effect,
        label=label,
        meaning=_IN_WORDS.sub(
            lambda found: f"{found[1]} {robot.axes[int(found[2]) - 1].removeprefix('j')}", effect.meaning
        ),
        parameters=tuple(replace(p, name=renamed(p.name)) for p in effect.parameters),
        terms=tuple(replace(t, parameter=renamed(t.parameter)) for t in effect.terms),
    )


def _counts_alike(robot: Robot) -> bool:
    return robot.axes == tuple(f"j{k}" for k in range(1, robot.joints + 1))


def _label_by_axis(label: str, robot: Robot) -> str:
    return _IN_LABEL.sub(lambda found: robot.axes[int(found[1]) - 1], label)


def _family_by_axis(family: Family, robot: Robot) -> Family:
    if _counts_alike(robot):
        return family
    if isinstance(family, Candidate):
        return Candidate(by_axis(family.effect, robot))
    if isinstance(family, Harmonics | Steps | Shapes):
        make = family.at
        return replace(
            family,
            label=_label_by_axis(family.label, robot),
            at=lambda shape: by_axis(make(shape), robot),
        )
    return family


def kind_of(label: str) -> EffectKind:
    """Return the kind of effect that a label names.

    Raises
    ------
    KeyError
        The library has no such kind.
    """
    kinds = {kind.name: kind for entry in entries() for kind in entry.KINDS}
    return kinds[label.partition(":")[0]]


def check_of(label: str) -> str:
    """Return advice to a technician on what to check for the effect of this label.

    Raises
    ------
    KeyError
        The library has no such kind.
    """
    return kind_of(label).check_of(label)


def words_of(label: str) -> str:
    """Return the name of the effect of this label in reports.

    Raises
    ------
    KeyError
        The library has no such kind.
    """
    return kind_of(label).words_of(label)


__all__ = [
    "LIBRARY",
    "EffectKind",
    "EffectModule",
    "Row",
    "Survey",
    "by_axis",
    "changes",
    "check_of",
    "compliance_of",
    "entries",
    "kind_of",
    "offers",
    "unclaimed",
    "words_of",
]
