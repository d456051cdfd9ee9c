"""The reason of a run with the devices that its last stop did not reach."""

from __future__ import annotations

from collections.abc import Sequence

from acquisition.run.rig.rig import PRESS
from drivers.errors import AcquisitionError


def with_unheard(reason: str, unheard: Sequence[AcquisitionError]) -> str:
    """Add the devices that the last stop did not reach to the reason.

    The advice to press the emergency stop comes first. Nothing is repeated.
    """
    remedies = dict.fromkeys(each.what_to_do for each in unheard)
    now = [PRESS] if PRESS in remedies else []
    told = dict.fromkeys(each.what_happened for each in unheard if each.message not in reason)
    others = [each for each in remedies if each != PRESS and each not in reason]
    return " ".join([*now, reason.replace(f" {PRESS}", ""), *told, *others])
