"""Effects of the instrument: drift of its frame, wrong scale, displaced base target."""

from __future__ import annotations

import numpy as np

from calib.effects.kind import OTHER_STATION, OTHER_WARMTH, EffectKind, EffectModule
from calib.effects.survey import Survey
from calib.model.effect import Effect, effect
from calib.model.regressors import Beam, Time, ToAnchor
from calib.scan.families import Candidate

_FEWEST = 6  # distances to a base target, two for each of its coordinates
_AIR_PPM = 10.0  # effect of 10 K of air or 35 hPa that were not entered


def base_target_shift(name: str) -> Effect:
    """Build a shift of a base target; parameters x, y, z, mm, world."""
    return effect(
        f"base_target_shift:{name}",
        "frames and tool",
        "mounting",
        f"Base target {name} is elsewhere than declared.",
        {axis: ("mm", 0.5, [(f"anchor.{axis}", ToAnchor(name))]) for axis in "xyz"},
    )


def _offer_base_target(survey: Survey) -> list[Candidate]:
    """Offer a shift for each base target to which enough distances were measured.

    If the base is free and only few balls are measured, a displaced ball and a displaced base look alike. The rank of
    the Jacobian decides.
    """
    conditions = survey.conditions
    count = np.bincount(conditions.anchor[conditions.anchor >= 0], minlength=len(conditions.anchor_names))
    return [
        Candidate(base_target_shift(name))
        for name, distances in zip(conditions.anchor_names, count, strict=True)
        if distances >= _FEWEST
    ]


def drift_translation(start_s: float = 0.0) -> Effect:
    """Build a shift of the instrument's frame from a time on; parameters x, y, z, mm/h."""
    acts = {axis: ("mm/h", 0.5, [(f"frame.{axis}", Time(start_s))], (-20.0, 20.0)) for axis in "xyz"}
    return effect(
        "drift_translation", "instrument", "instrument", "The instrument slides away with time.", acts
    )


def drift_rotation(start_s: float = 0.0) -> Effect:
    """Build a turn of the instrument's frame about the station from a time on.

    The parameters are rx, ry, rz, deg/h.
    """
    acts = {
        axis: ("deg/h", 0.02, [(f"frame.{axis}", Time(start_s))], (-2.0, 2.0)) for axis in ("rx", "ry", "rz")
    }
    return effect(
        "drift_rotation",
        "instrument",
        "instrument",
        "The instrument turns about its station with time.",
        acts,
    )


def _offer_drift(survey: Survey) -> list[Candidate]:
    if not (survey.recorded("time") and survey.varies(survey.conditions.time)):
        return []
    return [Candidate(drift_translation()), Candidate(drift_rotation())]


def _drifts_since(survey: Survey) -> list[Effect]:
    """Return both drifts from the first check pose on, when the frame was set up.

    The list is empty if times are not recorded.
    """
    start_s = float(np.min(survey.conditions.time))
    return [drift_translation(start_s), drift_rotation(start_s)] if _offer_drift(survey) else []


def tracker_scale(station_mm: tuple[float, float, float], usual_ppm: float = 50.0) -> Effect:
    """Build the scale error of an instrument at `station_mm`; parameter scale, ppm.

    It adds s (p - station) to every point. The cause is a wrong refractive index: 1e-6 for each kelvin of the air,
    270e-6 if none was entered. The instrument's frame is shifted in proportion, so a distance from another meter stays
    as it is. The link lengths absorb most of it (0.97). Source: Edlen 1966 (index of air).
    """
    places = [(f"frame.{axis}", Beam(k, station_mm[k])) for k, axis in enumerate("xyz")]
    return effect(
        "tracker_scale",
        "instrument",
        "instrument",
        "The instrument measures every length too long or too short.",
        {"scale": ("ppm", usual_ppm, places, (-500.0, 500.0))},
    )


def _offer_tracker_scale(survey: Survey) -> list[Candidate]:
    if not any(survey.varies(survey.conditions.point[:, axis]) for axis in range(3)):
        return []
    return [Candidate(tracker_scale(survey.station))]


BASE_TARGET = EffectModule(
    ("A displaced base ball or nest: the distances to one base target do not end at its declared position."),
    (
        EffectKind(
            "base_target_shift",
            words="seat of base target {name}",
            check=(
                "Check the seat of base target {name} for dirt and looseness, and measure its place in the world anew."
            ),
            apart=(),
        ),
    ),
    _offer_base_target,
)
DRIFT = EffectModule(
    "Drift of the instrument: its frame shifts, or turns about the station, in proportion to time.",
    (
        EffectKind(
            "drift_translation",
            words="instrument shifting with time",
            check=(
                "Check the stand of the instrument: feet, clamp, floor; let it warm up for two hours and "
                "measure the nests between the poses."
            ),
            apart=(OTHER_WARMTH, OTHER_STATION),
            by_clock=True,
            changed="The instrument slid while it measured, by {size}.",
            remedy="Let the instrument warm up on a firm stand, and measure again.",
        ),
        EffectKind(
            "drift_rotation",
            words="instrument turning with time",
            check=(
                "Check that the instrument's stand does not creep or turn, keep the sun off it, and measure the "
                "nests between the poses."
            ),
            apart=(OTHER_WARMTH, OTHER_STATION),
            by_clock=True,
            changed="The instrument turned while it measured, by {size}.",
            remedy="Let the instrument warm up on a firm stand, and measure again.",
        ),
    ),
    _offer_drift,
    _drifts_since,
)
TRACKER_SCALE = EffectModule(
    "Tracker scale: the instrument's millimetre is too long or too short, s (p - station) added to every point.",
    (
        EffectKind(
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
    ),
    _offer_tracker_scale,
    lambda survey: [tracker_scale(survey.station, _AIR_PPM)] if _offer_tracker_scale(survey) else [],
)
