"""Tracker scale: the instrument's millimetre is too long or too short, s (p - station) added to every point.

The cause is a wrong refractive index: 1e-6 for each kelvin of the air, 270e-6 if none was entered. The instrument's
frame is shifted in proportion, so a distance from another meter stays as it is. The link lengths absorb most of it
(0.97). Source: Edlen 1966 (index of air).
"""

from __future__ import annotations

from calib.effects.kind import OTHER_STATION, Kind
from calib.effects.survey import Survey
from calib.model.effect import Effect, effect
from calib.model.regressors import Beam
from calib.scan.fixed import Candidate

KINDS = (
    Kind(
        "tracker_scale",
        words="scale of the instrument",
        check=(
            "Check the weather station of the instrument (air temperature, pressure) and the date of its "
            "certificate; measure a reference length."
        ),
        apart=(OTHER_STATION,),
        changed="The instrument's scale differs from the calibration's by {size}.",
        remedy="Check the weather station and the certificate of the instrument, and measure again.",
    ),
)


_AIR_PPM = 10.0  # as much as 10 K of air or 35 hPa that nobody entered


def tracker_scale(station_mm: tuple[float, float, float], usual_ppm: float = 50.0) -> Effect:
    """Scale error of an instrument at `station_mm`; parameter scale, ppm."""
    places = [(f"frame.{axis}", Beam(k, station_mm[k])) for k, axis in enumerate("xyz")]
    return effect(
        "tracker_scale",
        "instrument",
        "instrument",
        "The instrument measures every length too long or too short.",
        {"scale": ("ppm", usual_ppm, places, (-500.0, 500.0))},
    )


def changes(survey: Survey) -> list[Effect]:
    """The effect of a scale that has changed with the air since a calibration."""
    return [tracker_scale(survey.station, _AIR_PPM)] if offer(survey) else []


def offer(survey: Survey) -> list[Candidate]:
    """The candidate, where the target moved; else none."""
    if not any(survey.varies(survey.conditions.point[:, axis]) for axis in range(3)):
        return []
    return [Candidate(tracker_scale(survey.station))]
