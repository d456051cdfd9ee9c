"""Check that the distances between the targets of a tool stay constant.

The nominal robot predicts a target to millimetres. Two targets measured while it rests give their distance to
hundredths. A changed distance shows an SMR of another size, a displaced SMR, or a tracker that was set to another
reflector in between.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from acquisition.record.readings import readings_of
from acquisition.record.store import PlannedReading, RecordStore
from calib.array import Array

CHANGED_MM = 1.0  # no tool bends so far, and SMRs of two sizes differ by 3 mm or more


class TargetDistanceCheck:
    """The target distances of a record, from its first reading on, also across pauses."""

    def __init__(self, store: RecordStore) -> None:
        self._visit: int | None = None
        self._seen: dict[str, Sequence[float] | Array] = {}  # in this visit
        self._apart: dict[frozenset[str], float] = {}
        for reading in readings_of(store):
            if reading.counts and (at := reading.world or reading.point) is not None:
                self._off(reading.visit, reading.target, at)

    def changed(self, planned: PlannedReading, target: str, at: Sequence[float] | Array) -> str | None:
        """Return a warning if targets are not as far apart as in their first measurement.

        It is returned each time. `at` (3,) is the current position of the target, mm, in a frame that is fixed during
        the visit.
        """
        off = self._off(planned.visit.number, target, at)
        if not off:
            return None
        return (
            f"{'; '.join(off)}: one of them has moved, or holds another SMR, or the instrument is set to another "
            "reflector, or the robot moved. Look at them; redo measures the last one again, confirm goes on, "
            "pause ends here for now."
        )

    def _off(self, visit: int, target: str, at: Sequence[float] | Array) -> list[str]:
        if visit != self._visit:
            self._visit, self._seen = visit, {}
        others = {name: mm for name, mm in self._seen.items() if name != target}
        self._seen[target] = at
        off = []
        for name, mm in others.items():
            now = math.dist(mm, at)
            before = self._apart.setdefault(frozenset((name, target)), now)
            if abs(now - before) > CHANGED_MM:
                off.append(f"{name} and {target} were {before:.2f} mm apart and are {now:.2f} mm now")
        return off
