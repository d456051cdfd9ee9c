"""Targets of one tool keep their distances, whatever the robot does and wherever the instrument stands.

The nominal robot says to millimetres where a target is. Two targets that are measured while it rests say to hundredths
how far they are apart: an SMR of another size, one that was knocked out of its seat, a tracker that is set to another
reflector between the two.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from acquisition.record.planned import Planned
from calib.array import Array

CHANGED_MM = 1.0  # no tool bends so far, and SMRs of two sizes differ by 3 mm or more


class Companions:
    """The distances seen in one execution."""

    def __init__(self) -> None:
        self._visit: int | None = None
        self._seen: dict[str, Sequence[float] | Array] = {}  # in this visit
        self._apart: dict[frozenset[str], float] = {}
        self._told: set[frozenset[str]] = set()

    def changed(self, planned: Planned, target: str, at: Sequence[float] | Array) -> str | None:
        """A sentence, once for each pair, where two targets are not as far apart as when both were measured first.

        at: (3,) where the target is now, mm, in a frame that is the same for the whole visit.
        """
        if planned.visit.number != self._visit:
            self._visit, self._seen = planned.visit.number, {}
        others = {name: mm for name, mm in self._seen.items() if name != target}
        self._seen[target] = at
        for name, mm in others.items():
            pair, now = frozenset((name, target)), math.dist(mm, at)
            before = self._apart.setdefault(pair, now)
            if abs(now - before) > CHANGED_MM and pair not in self._told:
                self._told.add(pair)
                return (
                    f"{name} and {target} were {before:.2f} mm apart and are {now:.2f} mm now: one of the two "
                    "has moved, or holds another SMR, or the instrument is set to another reflector. Look at them; "
                    "redo measures the last one again, confirm goes on."
                )
        return None
