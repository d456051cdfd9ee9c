"""Selection of check poses: the candidates that best show what may have changed.

The unknowns are the baseline's error e ~ P, the frame f, and the parameters x of the lasting causes with a tenth of
their usual size as prior. The information of poses adds up, M = M_0 + sum X_i' X_i over the rows of each pose. The
readings inform about x, with e and f as uncertain as they are, by

    log det M - log det M_ef

with M_ef the block of e and f alone (Bayesian D_s-optimality, Chaloner and Verdinelli 1995). Poses are taken one by
one, then exchanged until no exchange improves the selection.

This optimises the average over causes, and causes in a wrist are the worst. Therefore the poses are exchanged again for

    sum over causes of (needed / has)^2

Here *has* is the non-centrality of a cause of the size that must be detected (`calib.watch.planning.sizes`), and
*needed* is the non-centrality at which it is detected. The cause that is missed by most counts most.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from calib.array import Array
from calib.units import to_internal
from calib.watch.baseline import root_of
from calib.watch.planning.sizes import needed, of_one_unit, wanted_of
from calib.watch.whitened_readings import WhitenedReadings

_NOTICED = 0.1  # share of the usual size
_PASSING = ("drift_translation", "drift_rotation", "arm_growth")  # tested, but no pose is chosen for them
_ROUNDS = 6
_RIDGE = 1e-6
_SHOWN = 1e-2  # non-centrality in all candidates together
_P_LIMIT = 1e-3  # approximate limit of an alarm: the number of tests hardly matters to the choice


def choose(seen: WhitenedReadings, visit: NDArray[np.int64], count: int) -> list[int]:
    """Choose visits among those that `seen` has rows for.

    Each visit must have as many rows as any other.

    Parameters
    ----------
    visit : array of int, shape (q,)
        Visit that each row belongs to, or the pair of visits that are taken together.

    Returns
    -------
    list of int
        Chosen visits, ascending.
    """
    in_order = np.argsort(visit, kind="stable")
    visits = int(visit.max()) + 1

    def by_visit(columns: Array) -> Array:
        return columns[in_order].reshape(visits, -1, columns.shape[1])

    wanted = [i for i, e in enumerate(seen.causes) if e.label not in _PASSING]
    sizes = [_NOTICED * to_internal(p.size or 1.0, p.unit) for i in wanted for p in seen.causes[i].parameters]
    causes = np.column_stack([seen.columns[i] for i in wanted]) * np.array(sizes)
    shared = _shared(seen)
    x, known = by_visit(np.column_stack([shared, causes])), shared.shape[1]
    prior = np.eye(x.shape[2]) + _RIDGE * np.eye(x.shape[2])
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
    stated = _stated(seen)
    if not stated:
        return sorted(chosen)
    widths = tuple(each.shape[1] for each in stated)
    return _Short(by_visit(shared), by_visit(np.column_stack(stated)), widths).exchanged(chosen)


def _stated(seen: WhitenedReadings) -> list[Array]:
    """Return the columns (q, w each) of the causes with a stated size, at that size.

    Causes that no reading shows are left out.
    """
    out = []
    for cause, columns in zip(seen.causes, seen.columns, strict=True):
        if (size := wanted_of(cause)) is not None:
            one = size * of_one_unit(cause, columns)
            if np.linalg.eigvalsh(one.T @ one)[0] > _SHOWN:
                out.append(one)
    return out


@dataclass(frozen=True)
class _Short:
    """Shortfall of the causes that must be detected.

    Attributes
    ----------
    shared : array of shape (V, k, s)
        Columns of unit variance of the errors that the poses share.
    stated : array of shape (V, k, w)
        Columns of the causes at the sizes that must be detected.
    widths : tuple of int
        Number of columns of each cause, w in total.
    """

    shared: Array
    stated: Array
    widths: tuple[int, ...]

    @cached_property
    def _needed(self) -> Array:
        return np.array([needed(width, _P_LIMIT) for width in self.widths])

    def exchanged(self, chosen: list[int]) -> list[int]:
        """Exchange each chosen visit for the one with the least shortfall; return them ascending."""
        chosen = list(chosen)
        for _ in range(_ROUNDS):
            before = list(chosen)
            for place in range(len(chosen)):
                gone = chosen.pop(place)
                short = self._with_each_beside(chosen)
                short[chosen] = np.inf
                best = int(np.argmin(short))
                chosen.insert(place, best if short[best] < (1.0 - _RIDGE) * short[gone] else gone)
            if chosen == before:
                break
        return sorted(chosen)

    def _with_each_beside(self, taken: list[int]) -> Array:
        """Compute the shortfall (V,) of the causes with each visit added to those already taken.

        Let A be the columns for the causes and B those for the shared errors. A further visit adds
        R' (I + B K B')^-1 R to the information, with R = A - B K (sum B' A) and K = (I + sum B' B)^-1.
        """
        b, a = (each[taken].reshape(-1, each.shape[2]) for each in (self.shared, self.stated))
        k = np.linalg.inv(np.eye(b.shape[1]) + b.T @ b)
        already = a.T @ a - a.T @ b @ k @ b.T @ a
        rest = self.stated - self.shared @ (k @ b.T @ a)
        inner = np.eye(rest.shape[1]) + self.shared @ k @ self.shared.transpose(0, 2, 1)
        weighed = np.linalg.solve(inner, rest)
        out, start = np.zeros(len(rest)), 0
        for width, enough in zip(self.widths, self._needed, strict=True):
            own = slice(start, start + width)
            has = already[own, own] + rest[:, :, own].transpose(0, 2, 1) @ weighed[:, :, own]
            out += (enough / np.maximum(np.linalg.eigvalsh(has)[:, 0], 1e-9)) ** 2
            start += width
        return out


def _shared(seen: WhitenedReadings) -> Array:
    """Return columns (q, s) of unit variance of the errors that the poses share.

    These are the errors of the baseline and of the frame.
    """
    root = root_of(seen.covariance)
    of_baseline = seen.of_parameters @ root[:, np.any(root != 0.0, axis=0)]
    return np.column_stack([of_baseline, np.sqrt(2.0) * seen.passing])


def _gain(x: Array, information: Array, known: int, taken: list[int]) -> Array:
    """Compute the gain (V,) of each visit of x (V, k, s); visits that are taken add nothing."""
    gain = _log_det(x, information) - _log_det(x[:, :, :known], information[:known, :known])
    gain[taken] = -np.inf
    return gain


def _log_det(x: Array, information: Array) -> Array:
    """Compute log det(I + X M^-1 X') of each visit, shape (V,)."""
    root = np.linalg.solve(np.linalg.cholesky(information), x.reshape(-1, x.shape[2]).T)
    root = root.T.reshape(x.shape)
    return np.linalg.slogdet(np.eye(x.shape[1]) + root @ root.transpose(0, 2, 1))[1]
