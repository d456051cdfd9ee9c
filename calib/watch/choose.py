"""The check poses: the few of many candidates whose readings say most about what may have changed.

The unknowns are the baseline's error e ~ P, the frame f, and the parameters x of the lasting causes with a tenth of
their usual size as prior. The information of poses adds up, M = M_0 + sum X_i' X_i over the rows of each pose, and

    log det M - log det M_ef

with M_ef the block of e and f alone, is what the readings say about x when e and f are as little known as they are
(Bayesian D_s-optimality, Chaloner and Verdinelli 1995). Poses are taken one by one, then exchanged until none is
better.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from calib.array import Array
from calib.units import to_internal
from calib.watch.seen import Seen

_NOTICED = 0.1  # of the usual size
_PASSING = ("drift_translation", "drift_rotation", "arm_growth")  # looked for, but no pose is chosen for them
_ROUNDS = 6
_RIDGE = 1e-6


def choose(seen: Seen, visit: NDArray[np.int64], count: int) -> list[int]:
    """The visits to take, of those that `seen` has rows of, each with as many as any other; visit (q,): to which each
    row belongs. Ascending."""
    wanted = [i for i, e in enumerate(seen.causes) if e.label not in _PASSING]
    sizes = [_NOTICED * to_internal(p.size or 1.0, p.unit) for i in wanted for p in seen.causes[i].parameters]
    causes = np.column_stack([seen.columns[i] for i in wanted]) * np.array(sizes)
    shared = _shared(seen)
    rows = np.column_stack([shared, causes])
    visits = int(visit.max()) + 1
    in_order = np.argsort(visit, kind="stable")
    x = rows[in_order].reshape(visits, -1, rows.shape[1])
    known = shared.shape[1]
    prior = np.eye(rows.shape[1]) + _RIDGE * np.eye(rows.shape[1])
    chosen: list[int] = []
    information = prior.copy()
    for _ in range(min(count, visits)):
        best = int(np.argmax(_gain(x, information, known, chosen)))
        chosen.append(best)
        information += x[best].T @ x[best]
    for _ in range(_ROUNDS):
        before = list(chosen)
        for place in range(len(chosen)):
            chosen.pop(place)
            information = prior + np.einsum("vka,vkb->ab", x[chosen], x[chosen])
            chosen.insert(place, int(np.argmax(_gain(x, information, known, chosen))))
        if chosen == before:
            break
    return sorted(chosen)


def _shared(seen: Seen) -> Array:
    """(q, s) columns of unit variance of what the poses share: the baseline's error and the frame."""
    values, vectors = np.linalg.eigh(seen.covariance)
    held = values > 1e-12 * values.max()
    of_baseline = seen.of_parameters @ (vectors[:, held] * np.sqrt(values[held]))
    return np.column_stack([of_baseline, np.sqrt(2.0) * seen.passing])


def _gain(x: Array, information: Array, known: int, taken: list[int]) -> Array:
    """(V,) by how much each visit of x (V, k, s) would add; those that are taken add nothing."""
    gain = _log_det(x, information) - _log_det(x[:, :, :known], information[:known, :known])
    gain[taken] = -np.inf
    return gain


def _log_det(x: Array, information: Array) -> Array:
    """(V,) log det(I + X M^-1 X')."""
    root = np.linalg.solve(np.linalg.cholesky(information), x.reshape(-1, x.shape[2]).T)
    root = root.T.reshape(x.shape)
    return np.linalg.slogdet(np.eye(x.shape[1]) + root @ root.transpose(0, 2, 1))[1]
