"""Gears that are softer than usual: the size that holds compliances is of industrial arms; small ones yield more."""

from __future__ import annotations

from collections.abc import Collection

from calib.fit.identification import Identification
from calib.model.base_model import COMPLIANCE
from calib.units import to_display

_SOFTER = 3.0  # usual sizes from which on the readings contradict the size


def softer_than_usual(found: Identification, told: Collection[str]) -> dict[str, float]:
    """Gears so much softer than the size that holds them that the readings contradict it, as small arms have them.

    By name, with a size that holds them no more, in their unit; told: parameters whose size the header gives.
    """
    soft = {}
    for p, value in zip(found.model.parameters, found.estimate, strict=True):
        shown = to_display(float(value), p.unit)
        if p.size and p.unit == COMPLIANCE and p.name not in told and shown > _SOFTER * p.size:
            soft[p.name] = _SOFTER * shown
    return soft
