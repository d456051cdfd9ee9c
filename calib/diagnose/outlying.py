"""The test whether the rejected readings lie together: then they are no gross errors, but an effect on few readings.

A weak floor that yields only under the largest moments disturbs a fortieth of the readings. They are rejected like
gross errors, and the others fit to within the noise. But gross errors do not depend on the pose. So for every driver
with functions F the mean of F over the readings left out is compared with that over as many poses drawn at random,

    T = |mean of F over those left out - mean of F|^2,

and the smallest p of all drivers with what that is by chance, as for the structure of residuals.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from calib.array import Array
from calib.diagnose.null import Chance
from calib.diagnose.places import drivers
from calib.diagnose.structure import ALARM, Structure, log_p_of
from calib.scan.space import Space

ACTS_ON = "the readings left out"
_FEWEST = 4  # poses left out
_DRAWS = 399
_MOST = 4


def together(space: Space, out: NDArray[np.bool_]) -> list[Structure]:
    """Drivers along which the readings of a mask `out` (n,) lie together, most certain first."""
    pose = space.fitted.readings.conditions.pose
    count = np.bincount(pose)
    spoilt = np.bincount(pose, out) > 0.0
    if spoilt.sum() < _FEWEST or spoilt.all():
        return []
    rng = np.random.default_rng(2)
    drawn = np.zeros((len(count), 1 + _DRAWS))
    drawn[:, 0] = spoilt
    for b in range(1, 1 + _DRAWS):
        drawn[rng.permutation(len(count))[: int(spoilt.sum())], b] = 1.0
    driven = drivers(space)
    values = []
    for functions in driven.values():
        of_pose = np.array([np.bincount(pose, column) for column in functions.T]) / count
        values.append(np.sum(((of_pose - of_pose.mean(axis=1, keepdims=True)) @ drawn) ** 2, axis=0))
    log_p = log_p_of(np.array(values))
    chance = Chance.of(log_p[:, 1:])
    found = sorted((chance.p_value(float(log_p[i, 0])), name) for i, name in enumerate(driven))
    return [
        Structure(name, p_value, _share(driven[name], out), ACTS_ON)
        for p_value, name in found[:_MOST]
        if p_value < ALARM
    ]


def _share(functions: Array, out: NDArray[np.bool_]) -> float:
    """Share of the choice of left-out readings that the functions (n, m) explain, their number allowed for."""
    values = out - np.mean(out)
    columns = functions - functions.mean(axis=0)
    u, s, _ = np.linalg.svd(columns, full_matrices=False)
    u = u[:, s > 1e-3 * max(float(s[0]), 1e-300)]
    rows = max(len(out), u.shape[1] + 2)
    unexplained = 1.0 - float(np.sum((u.T @ values) ** 2) / (values @ values))
    return float(np.clip(1.0 - unexplained * (rows - 1) / (rows - 1 - u.shape[1]), 0.0, 1.0))
