"""The library of effects: one file for each kind, which holds all that is known of it and is named in `LIBRARY`.

The files are sorted by what they act on: `geometry`, `transmission`, `elasticity`, `thermal`, `slides`, `instrument`.
"""

import re
from collections.abc import Sequence
from typing import Protocol

from calib.effects.by_axis import by_axis, family_by_axis
from calib.effects.elasticity import (
    bearing_tilt,
    cubic_stiffness,
    joint_compliance,
    link_torsion,
    payload,
    pedestal,
)
from calib.effects.geometry import (
    joint_offset,
    joint_step,
    parallel_twist,
    shift,
    tool,
)
from calib.effects.installed import installed
from calib.effects.instrument import (
    base_target,
    drift,
    tracker_scale,
)
from calib.effects.kind import Kind
from calib.effects.slides import (
    slide_backlash,
    slide_compliance,
    slide_growth,
    slide_guide,
    slide_scale,
)
from calib.effects.survey import Survey, compliance_of
from calib.effects.thermal import (
    arm_growth,
    thermal_growth,
    thermal_joint,
    warm_up,
)
from calib.effects.transmission import (
    backlash,
    backlash_load,
    coupling,
    dead_zone,
    encoder_scale,
    gear_orders,
    lost_motion,
    periodic,
    settling,
)
from calib.model.effect import Effect
from calib.scan.fixed import Candidate
from calib.scan.scores import Family


class Entry(Protocol):
    """The interface of a file of the library: its kinds, and its candidates for some readings."""

    @property
    def KINDS(self) -> tuple[Kind, ...]:
        """The kinds of the file."""
        ...

    def offer(self, survey: Survey) -> Sequence[Family]:
        """The candidates of the file."""
        ...


LIBRARY: tuple[Entry, ...] = (
    periodic,
    backlash,
    backlash_load,
    lost_motion,
    settling,
    encoder_scale,
    coupling,
    joint_offset,
    joint_compliance,
    dead_zone,
    cubic_stiffness,
    parallel_twist,
    link_torsion,
    bearing_tilt,
    pedestal,
    payload,
    tool,
    base_target,
    shift,
    joint_step,
    drift,
    tracker_scale,
    thermal_growth,
    thermal_joint,
    warm_up,
    slide_scale,
    slide_backlash,
    slide_guide,
    slide_growth,
    slide_compliance,
)


OF_GEARS = frozenset(
    {"periodic", "backlash", "lost_motion", "settling", "encoder_scale", "coupling", "slide_backlash"}
)
"""Kinds that blame a gear or its play and need no torque; those of stiffness are not offered without one."""

_JOINT = re.compile(r"\bj(\d+)")

SETS_IN = (shift, joint_step, backlash, slide_backlash, payload, tracker_scale, drift, arm_growth)
"""Files of effects that can set in between two campaigns."""


def entries() -> tuple[Entry, ...]:
    """The library, and what other packages bring. Raises DataError where one of them cannot be used."""
    return (*LIBRARY, *installed())


def offers(survey: Survey) -> list[Family]:
    """All candidates of the library for these readings, without those that the base model contains, and without those
    that blame the gear of a joint whose gravity is not modelled: its sag looks like them."""
    proposals = [proposal for entry in entries() for proposal in entry.offer(survey)]
    new = [p for p in proposals if not (isinstance(p, Candidate) and survey.frees(p.effect))]
    return [family_by_axis(p, survey.robot) for p in new if not _looks_like_sag(p.label, survey)]


def _looks_like_sag(label: str, survey: Survey) -> bool:
    kind, _, rest = label.partition(":")
    joints = {int(number) for number in _JOINT.findall(rest)}
    return kind in OF_GEARS and not joints.isdisjoint(survey.weightless)


def changes(survey: Survey) -> list[Effect]:
    """The effects that may have begun since a calibration and that these readings could show."""
    return [by_axis(found, survey.robot) for entry in SETS_IN for found in entry.changes(survey)]


def unclaimed(survey: Survey) -> list[Effect]:
    """The effects that may be there unclaimed and that later readings would meet otherwise: those that can set in, what
    follows the air, and waves so long that few poses see one stretch of them, as a lost zero."""
    growth = [candidate.effect for candidate in thermal_growth.offer(survey)]
    waves = [by_axis(wave, survey.robot) for wave in periodic.long_waves(survey)]
    return [*changes(survey), *growth, *waves]


def kind_of(label: str) -> Kind:
    """The kind of effect that a label names. Raises KeyError for a label of no kind in the library."""
    name = label.partition(":")[0]
    kinds = {kind.name: kind for entry in (*entries(), gear_orders, arm_growth) for kind in entry.KINDS}
    return kinds[name]


def check_of(label: str) -> str:
    """Advice to a technician on what to check for the effect of this label. Raises KeyError as `kind_of` does."""
    return kind_of(label).check_of(label)


def words_of(label: str) -> str:
    """The name of the effect of this label in reports. Raises KeyError as `kind_of` does."""
    return kind_of(label).words_of(label)


__all__ = [
    "LIBRARY",
    "Kind",
    "Survey",
    "changes",
    "check_of",
    "compliance_of",
    "entries",
    "kind_of",
    "offers",
    "unclaimed",
    "words_of",
]
