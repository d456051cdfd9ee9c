"""The settle check: two consecutive read-backs agree within the resolution of the reply.

It is for controllers that report the end of a move before the arm has come to rest.
"""

from __future__ import annotations

from collections.abc import Callable

from drivers.errors import NoisyMeasurement
from drivers.interfaces import JointReading

EVERY_S = 0.5  # campaign time between two read-backs; an arm swings at some hertz
TRIES = 20


def until_still(position: Callable[[], JointReading], wait: Callable[[float], None]) -> JointReading:
    """Wait until the arm is at rest and return its read-back.

    Errors of the arguments are passed on.

    Raises
    ------
    NoisyMeasurement
        The arm does not come to rest.
    """
    before, apart = position(), 0.0
    for _ in range(TRIES):
        wait(EVERY_S)
        now = position()
        apart = max(abs(a - b) for a, b in zip(now.joints_deg, before.joints_deg, strict=True))
        if apart <= max(now.resolution_deg, before.resolution_deg):
            return now
        before = now
    raise NoisyMeasurement(
        f"the arm does not come to rest: a joint still moves by {apart:.4f} deg in {EVERY_S:g} s",
        device="robot",
        command="settle check",
    )
