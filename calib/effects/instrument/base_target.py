"""A displaced base ball or nest: the distances to one base target do not end at its declared position.

Not offered where the base model fits the positions of the base targets. Where the base is free and only few balls are
measured, a displaced ball and a displaced base look alike; the rank of the Jacobian decides.
"""

from __future__ import annotations

import numpy as np

from calib.effects.kind import Kind
from calib.effects.survey import Survey
from calib.model.effect import Effect, effect
from calib.model.regressors import ToAnchor
from calib.scan.fixed import Candidate

_FEWEST = 6  # distances to a base target, two for each of its coordinates


KINDS = (
    Kind(
        "base_target_shift",
        words="seat of base target {name}",
        check=(
            "Check the seat of base target {name} for dirt and looseness, and measure its place in the "
            "world anew."
        ),
        apart=(),
    ),
)


def base_target_shift(name: str) -> Effect:
    """A base target elsewhere; parameters x, y, z, mm, world."""
    return effect(
        f"base_target_shift:{name}",
        "frames and tool",
        "mounting",
        f"Base target {name} is elsewhere than declared.",
        {axis: ("mm", 0.5, [(f"anchor.{axis}", ToAnchor(name))]) for axis in "xyz"},
    )


def offer(survey: Survey) -> list[Candidate]:
    """The candidates, one for each base target to which enough distances were measured."""
    conditions = survey.conditions
    count = np.bincount(conditions.anchor[conditions.anchor >= 0], minlength=len(conditions.anchor_names))
    return [
        Candidate(base_target_shift(name))
        for name, distances in zip(conditions.anchor_names, count, strict=True)
        if distances >= _FEWEST
    ]
