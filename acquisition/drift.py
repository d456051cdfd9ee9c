"""Drift seen live: how far the reference pose is now from where it was first, and the most it has ever been.

In the world frame; with one SMR each target is compared with its own first reading. What was measured while warming
up, or put aside, does not count. Lengths mm.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from acquisition.store import Store

_ROWS = """
SELECT pose.target, attempt.ended_t_s, attempt.world_x_mm, attempt.world_y_mm, attempt.world_z_mm
FROM pose JOIN attempt ON attempt.pose = pose.id
WHERE pose.set_name = 'reference' AND pose.status = 'measured' AND pose.replaced_by IS NULL
  AND attempt.kind = 'measure' AND attempt.status = 'good' ORDER BY attempt.id
"""


@dataclass(frozen=True)
class Drift:
    """Of `readings` reference readings; `now_mm` (x, y, z) of the last, `off_mm` its length, `most_mm` of all."""

    readings: int
    now_mm: tuple[float, float, float]
    off_mm: float
    most_mm: float
    t_s: float

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return asdict(self)


def drift_of(store: Store) -> Drift | None:
    """None before a second reading of the reference pose."""
    first: dict[str, np.ndarray] = {}
    drifts: list[tuple[float, np.ndarray]] = []
    rows = store.database.query(_ROWS)
    for target, t_s, *world in rows:
        point = np.array(world)
        if target in first:
            drifts.append((t_s, point - first[target]))
        else:
            first[target] = point
    if not drifts:
        return None
    lengths = [float(np.linalg.norm(moved)) for _, moved in drifts]
    t_s, (x, y, z) = drifts[-1]
    return Drift(len(rows), (float(x), float(y), float(z)), lengths[-1], max(lengths), t_s)
