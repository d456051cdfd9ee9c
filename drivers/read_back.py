"""Checks of the joints read back: they are held against the request, as exactly as the wire shows them.

A reading of the campaign is filed under the angles that were commanded. So these must be the ones that the controller
carried out: a joint that is read back further from its target than half a step of the reply, plus what a servo may be
off when it holds, was not sent there, and the move counts as `NotReached` (docs/decisions/0016).

What a servo may be off is taken from the data sheets: twice the pose repeatability (ISO 9283) over the reach. IRB 120:
0.01 mm over 580 mm, 0.002 deg. LR Mate 200iC: 0.02 mm over 704 mm, 0.003 deg. UR5: 0.1 mm over 850 mm, 0.013 deg. An
arm that held its joints worse could not repeat as its maker says. Not tried on a controller.
"""

from __future__ import annotations

from collections.abc import Sequence

from drivers.interfaces import JointReading


def apart_deg(one: Sequence[float], other: Sequence[float]) -> float:
    """The largest difference of a joint, in the unit of the two."""
    return max(abs(a - b) for a, b in zip(one, other, strict=True))


def is_there(reading: JointReading, target_deg: Sequence[float], hold_deg: float) -> bool:
    """Whether the reply can be that of a robot that holds every joint within `hold_deg` of its target."""
    return apart_deg(reading.joints_deg, target_deg) <= hold_deg + reading.resolution_deg / 2
