"""The distance off the last axis that a target needs for the wrist to show what should be seen."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calib.watch.planning.rounds import Rounds, Ways, wanted
from calib.watch.planning.visits import Visits

_STEPS = 6
_NEAR = 0.02
_FARTHEST_MM = 1000.0


def lever_needed(ways: Ways, visits: Visits, rounds: Rounds, label: str, lever_mm: float) -> float | None:
    """The distance, mm, from its axis at which the one target of some visits would have to be for them to show a cause
    of the last joint from the size that it should be seen at; lever_mm: how far it is.

    The noise of the arm grows with the lever, so the size falls more slowly than the lever rises. None for several
    targets, where the last axis is not that of the flange, or where no lever that a tool has is long enough.
    """
    series, targets = next(iter(ways.saved.model.targets.items()))
    names = {target for each in visits.read for target, _ in each}
    (name, *others) = sorted(names)
    x, y, z = targets[name]
    if others or not np.isclose(np.hypot(x, y), lever_mm, rtol=0.01):
        return None
    factor, short = 1.0, np.inf
    for _ in range(_STEPS):
        if factor * lever_mm > _FARTHEST_MM:
            return None
        moved = {**targets, name: (factor * x, factor * y, z)}
        model = replace(ways.saved.model, targets={**ways.saved.model.targets, series: moved})
        there = replace(ways, saved=replace(ways.saved, model=model))
        short = there.sizes(visits, rounds)[label] / wanted(label)
        if 1.0 - _NEAR < short <= 1.0:
            break
        factor *= (1.0 + 0.5 * _NEAR) * short if short > 1.0 else np.sqrt(short)
    return factor * lever_mm if short <= 1.0 else None
