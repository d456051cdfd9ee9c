"""The library of effects: one file a kind. A new kind is one file with a function, named in `LIBRARY`."""

from calib.effects import backlash, drift, encoder_scale, periodic, shift, thermal_growth
from calib.effects.effect import Candidate, Effect, Harmonics, Offer, Parameter, Steps, Term, effect
from calib.effects.survey import Survey

LIBRARY = (
    periodic.offer,
    backlash.offer,
    encoder_scale.offer,
    drift.offer,
    shift.offer,
    thermal_growth.offer,
)


def offers(survey: Survey) -> list[Offer]:
    """Everything the library can propose for these readings."""
    return [proposal for offer in LIBRARY for proposal in offer(survey)]


__all__ = [
    "LIBRARY",
    "Candidate",
    "Effect",
    "Harmonics",
    "Offer",
    "Parameter",
    "Steps",
    "Survey",
    "Term",
    "effect",
    "offers",
]
