"""Gear curve: the joint's error is a function of its angle that no few waves make up; a smooth curve of its own.

    error(theta) = sum_i b_i B((theta - theta_i) / spacing),    B the cardinal cubic B-spline

Worn or badly fitted teeth, a bearing's defect, a cable's pull: local errors, where the waves of `periodic` extend over
the whole turn and promise what they have not seen. Bumps hold only where readings were; elsewhere their prior brings
the curve back to zero. Sources: single-joint sweeps, Nubiola 2.4.1 (tangential error); de Boor 1978 for B.
"""

from __future__ import annotations

import math

import numpy as np

from calib.effects.effect import Effect, effect
from calib.effects.survey import Survey
from calib.regressors import Bump
from calib.units import DEG

LEAST_SPACING, MOST_SPACING = 2.0 * DEG, 5.0 * DEG
_READINGS = 40  # for every bump, on average: fewer do not make a curve


def gear_curve(joint: int, low: float, high: float, spacing: float) -> Effect:
    """Curve of `joint` over low..high, rad, with a bump every `spacing`; parameters named after their place, deg."""
    count = max(4, round((high - low) / spacing) + 1)
    centres = np.linspace(low - spacing, high + spacing, count + 2)
    step = float(centres[1] - centres[0])
    # Without a full stop, behind which the short name of a parameter would begin.
    places = {
        f"at_{centre / DEG:.1f}".replace(".", "_"): Bump(joint, float(centre), step) for centre in centres
    }
    return effect(
        f"gear_curve:j{joint}",
        "transmission",
        "robot",
        f"The error of joint {joint} follows its angle by a curve of its own, place by place.",
        {name: ("deg", 0.02, [(f"theta{joint}", bump)]) for name, bump in places.items()},
        {"spacing_deg": step / DEG},
    )


def curve_for(survey: Survey, joint: int) -> Effect | None:
    """The curve that the readings can carry, or None: they are too few for the range, or the joint hardly moved."""
    angles = survey.conditions.joints[:, joint - 1]
    low, high = float(angles.min()), float(angles.max())
    spacing = max(LEAST_SPACING, (high - low) * _READINGS / len(angles))
    if spacing > MOST_SPACING or high - low < 4.0 * spacing:
        return None
    return gear_curve(joint, low, high, math.ceil(spacing / DEG * 10.0) / 10.0 * DEG)
