"""Backlash that grows with the load: the housing yields and the teeth part, c/2 x |torque| x side of approach.

It is the increase of the play (`backlash`) with the gravity torque on the joint, and never negative. If every reading
was approached from one side, it cannot be seen. Source: Slamani, Nubiola and Bonev 2012
(backlash of an IRB 1600 that changes with the load).
"""

from __future__ import annotations

from calib.effects.kind import OTHER_SIDE, Kind
from calib.effects.survey import Survey
from calib.model.effect import Effect, effect
from calib.model.regressors import LoadedSide
from calib.scan.fixed import Candidate
from calib.units import DEG, to_display

_USUAL = 0.1 * DEG  # rad, under the largest torque
_UNIT = "1e-6 rad/(N.mm)"


KINDS = (
    Kind(
        "backlash_load",
        words="play of joint {joint} that grows with its load",
        check=(
            "Load the arm at joint {joint} with a known mass, push it by hand both ways with the brakes on "
            "and read a dial gauge: where the play grows with the mass, look at the gear's housing, its "
            "bolts and its bearings."
        ),
        apart=(OTHER_SIDE,),
    ),
)


def backlash_load(joint: int, largest: float) -> Effect:
    """Play of `joint` by its load, whose torques reach `largest` N.mm; parameter c, 1e-6 rad/(N.mm)."""
    size = to_display(_USUAL / largest, _UNIT)
    return effect(
        f"backlash_load:j{joint}",
        "transmission",
        "robot",
        f"The play of joint {joint} grows with its load: it stops short on the side from which it arrives.",
        {"c": (_UNIT, size, [(f"theta{joint}", LoadedSide(joint), 0.5)], (0.0, None))},
    )


def offer(survey: Survey) -> list[Candidate]:
    """The candidates, one for each joint that was approached from both sides, under loads of many sizes."""
    side, torque = survey.conditions.side, survey.conditions.torque
    return [
        Candidate(backlash_load(k, survey.largest(torque[:, k - 1])))
        for k in survey.moving
        if survey.varies(side[:, k - 1]) and survey.strains(abs(torque[:, k - 1]))
    ]
