"""The plan of a watch: which poses to visit from which sides, and what they will show."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib.array import Array
from calib.data.header import Header
from calib.errors import DataError
from calib.saved import SavedModel
from calib.watch.choose import choose
from calib.watch.judge import RATE
from calib.watch.planned import planned
from calib.watch.seen import Seen, scatter_beyond
from calib.watch.sizes import Smallest, smallest

FEWEST = 4


@dataclass(frozen=True)
class Plan:
    """The chosen of some candidates, by index; what is seen of each cause; labels of causes that are never seen."""

    chosen: tuple[int, ...]
    seen: tuple[Smallest, ...]
    unseen: tuple[str, ...]


def plan(
    saved: SavedModel,
    header: Header,
    joints: Array,
    sides: Array,
    reach: Array,
    targets: Sequence[str],
    count: int,
    rate: float = RATE,
) -> Plan:
    """Choose `count` of V candidate visits: joints and sides (V, N), rad, reach (V,), rad; `targets` are read at each.

    header: what the readings would be taken with. Raises DataError for fewer poses than can tell anything, or more than
    there are candidates.
    """
    if not FEWEST <= count <= len(joints):
        raise DataError(f"is {count}.", do=f"Give {FEWEST} to {len(joints)} poses.", key="--poses")
    candidates = planned(saved, header, joints, sides, reach, targets)
    lack = scatter_beyond(saved, candidates)
    scatter = float(np.hypot(header.noise.repeatability, lack))
    # what the model lacks is drawn anew with each pose, as the repeatability is with each visit
    rougher = replace(header, noise=replace(header.noise, repeatability=scatter))
    seen = Seen.of(saved, replace(candidates, header=rougher), lack=0.0)
    visit = np.tile(seen.readings.conditions.visit, 3)
    chosen = choose(seen, visit, count)
    few = planned(saved, header, joints[chosen], sides[chosen], reach[chosen], targets)
    found, unseen = smallest(Seen.of(saved, few, lack=lack), rate)
    return Plan(tuple(chosen), found, unseen)
