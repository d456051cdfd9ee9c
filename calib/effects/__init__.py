"""The library of effects: one file a kind. A new kind is one file with a function, named in `LIBRARY`."""

from calib.effects import (
    backlash,
    bearing_tilt,
    coupling,
    cubic_stiffness,
    dead_zone,
    drift,
    encoder_scale,
    joint_compliance,
    joint_offset,
    joint_step,
    link_torsion,
    lost_motion,
    parallel_twist,
    payload,
    pedestal,
    periodic,
    settling,
    shift,
    thermal_growth,
    thermal_joint,
    tool,
    tracker_scale,
    warm_up,
)
from calib.effects.effect import Candidate, Effect, Harmonics, Offer, Parameter, Shapes, Steps, Term, effect
from calib.effects.survey import Survey

LIBRARY = (
    periodic.offer,
    backlash.offer,
    lost_motion.offer,
    settling.offer,
    encoder_scale.offer,
    coupling.offer,
    joint_offset.offer,
    joint_compliance.offer,
    dead_zone.offer,
    cubic_stiffness.offer,
    parallel_twist.offer,
    link_torsion.offer,
    bearing_tilt.offer,
    pedestal.offer,
    payload.offer,
    tool.offer,
    shift.offer,
    joint_step.offer,
    drift.offer,
    tracker_scale.offer,
    thermal_growth.offer,
    thermal_joint.offer,
    warm_up.offer,
)


def offers(survey: Survey) -> list[Offer]:
    """Everything the library can propose for these readings, less what their base model has already."""
    proposals = [proposal for offer in LIBRARY for proposal in offer(survey)]
    return [p for p in proposals if not (isinstance(p, Candidate) and survey.frees(p.effect))]


__all__ = [
    "LIBRARY",
    "Candidate",
    "Effect",
    "Harmonics",
    "Offer",
    "Parameter",
    "Shapes",
    "Steps",
    "Survey",
    "Term",
    "effect",
    "offers",
]
