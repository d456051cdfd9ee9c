"""Bearing tilt: the bearing of a joint tilts under the moment across its axis, c M_x about x and c M_y about y.

One compliance for both directions, since a bearing is round. Bearings are built for what they carry: the usual size
is an angle under the largest moment.
"""

from __future__ import annotations

from calib.effects.kind import OTHER_LOAD, Kind
from calib.effects.survey import Survey
from calib.model.effect import Effect, effect
from calib.model.gravity_regressors import Moment
from calib.scan.fixed import Candidate
from calib.units import to_display

_USUAL = 1e-3  # rad, under the largest moment
_UNIT = "1e-6 rad/(N.m)"


KINDS = (
    Kind(
        "bearing_tilt",
        words="tilting bearing of joint {joint}",
        check=(
            "Check the main bearing of joint {joint} for play across its axis with a dial gauge and a "
            "lever, and its bolts."
        ),
        apart=(OTHER_LOAD,),
    ),
)


def bearing_tilt(joint: int, largest: float) -> Effect:
    """Tilting compliance of the bearing of `joint`, whose moments reach `largest` N.mm; parameter c, 1e-6 rad/(N.m)."""
    size = to_display(_USUAL / largest, _UNIT)
    places = [(f"bearing{joint}.rx", Moment(joint, 0)), (f"bearing{joint}.ry", Moment(joint, 1))]
    return effect(
        f"bearing_tilt:j{joint}",
        "structure",
        "robot",
        f"The bearing of joint {joint} tilts under the weight it carries.",
        {"c": (_UNIT, size, places, (0.0, None))},
    )


def offer(survey: Survey) -> list[Candidate]:
    """The candidates, one for each joint or carriage that moved and across whose axis gravity pulls, in varying
    strength."""
    moment = survey.conditions.moment
    return [
        Candidate(bearing_tilt(k, survey.largest(moment[:, k - 1, :2])))
        for k in (*survey.moving, *survey.sliding)
        if survey.strains(moment[:, k - 1, 0]) or survey.strains(moment[:, k - 1, 1])
    ]
