"""Checks of the joints read back, as precisely as the protocol reports them.

A reading of a campaign is stored with the commanded angles, so the controller must have reached them. A move has ended
at its target if every joint is read back within half the resolution of the reply, plus the largest error of a servo at
rest. Otherwise it counts as `NotReached` (docs/decisions/0016).

The largest error of a servo is taken from the data sheets: twice the pose repeatability (ISO 9283) over the reach.

- IRB 120: 0.01 mm over 580 mm, 0.002 deg
- LR Mate 200iC: 0.02 mm over 704 mm, 0.003 deg
- UR5: 0.1 mm over 850 mm, 0.013 deg

An arm that held its joints less well could not have its stated repeatability. Not tried on a controller.
"""

from __future__ import annotations

from collections.abc import Sequence

from drivers.interfaces import JointReading


def apart_deg(one: Sequence[float], other: Sequence[float]) -> float:
    """Return the largest difference of a joint, in the unit of the arguments."""
    return max(abs(a - b) for a, b in zip(one, other, strict=True))


def is_there(reading: JointReading, target_deg: Sequence[float], hold_deg: float) -> bool:
    """Check whether the read-back allows that every joint is within `hold_deg` of its target."""
    return apart_deg(reading.joints_deg, target_deg) <= hold_deg + reading.resolution_deg / 2
