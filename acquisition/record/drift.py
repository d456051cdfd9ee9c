"""Drift seen live: how far the reference pose is now from where it was first, and the most it has ever been.

In the world frame; with one SMR each target is compared with its own first reading. What was measured while warming
up, or put aside, does not count. Lengths mm.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from acquisition.cell.workspace import targets_at
from acquisition.record.readings import readings_of
from acquisition.record.store import Store


@dataclass(frozen=True)
class Drift:
    """The drift in `readings` reference readings: `now_mm` (x, y, z) of the last, its length `off_mm`, the largest."""

    readings: int
    now_mm: tuple[float, float, float]
    off_mm: float
    most_mm: float
    t_s: float

    def as_dict(self) -> dict[str, Any]:
        """The values for JSON."""
        return asdict(self)


def drift_of(store: Store) -> Drift | None:
    """The drift so far; None before a second reading of the reference pose."""
    first: dict[str, np.ndarray] = {}
    drifts: list[tuple[float, np.ndarray]] = []
    rows = [row for row in readings_of(store, "reference") if row.counts]
    for row in rows:
        point = np.array(row.world)
        if (
            store.driven_by_hand
        ):  # never twice in the same place: what the nominal robot does from one to the other
            at = targets_at(store.cell, np.array([row.joints]))[0]
            point = point - at[list(store.cell.tool.targets).index(row.target)]
        if row.target in first:
            drifts.append((row.t_s, point - first[row.target]))
        else:
            first[row.target] = point
    if not drifts:
        return None
    lengths = [float(np.linalg.norm(moved)) for _, moved in drifts]
    t_s, (x, y, z) = drifts[-1]
    return Drift(len(rows), (float(x), float(y), float(z)), lengths[-1], max(lengths), t_s)
