"""Gears softer than usual: the usual size of compliances is that of industrial arms; small arms are softer."""

from __future__ import annotations

from collections.abc import Collection

from calib.fit.identification import Identification
from calib.model.base_model import COMPLIANCE
from calib.units import to_display

_SOFTER = 3.0  # usual sizes from which on the readings contradict the size


def softer_than_usual(found: Identification, told: Collection[str]) -> dict[str, float]:
    """The gears whose compliance contradicts its usual size, as in small arms.

    Returns name -> a size that no longer constrains it, in its unit. told: parameters whose size the header gives.
    """
    soft = {}
    for p, value in zip(found.model.parameters, found.estimate, strict=True):
        shown = to_display(float(value), p.unit)
        if p.size and p.unit == COMPLIANCE and p.name not in told and shown > _SOFTER * p.size:
            soft[p.name] = _SOFTER * shown
    return soft
