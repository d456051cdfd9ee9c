"""Mixed readings in one series: some from another station, or of another target of the tool.

The nominal robot is placed where it agrees with most readings. The other readings are of a second kind if they agree
with each other: with another place of the base, or with another point on the flange.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.arm.start import align
from calib.array import Array
from calib.data.hypotheses import BETTER, Meaning, extent_of

_TRIES = 400  # triples of readings that may place the robot: of 60 % that belong together, one in five does
_NEAR = 0.02  # share of the extent by which a nominal robot may miss a reading
_MOST = 0.95  # share of the readings that one kind may have before there are two
_LEAST = 0.4  # share that must agree for the rest to be called another kind
_STATION, _TARGET = 6, 3  # readings that may show another station, another target
_ROUNDS = 3


@dataclass(frozen=True)
class Mixture:
    """The smaller group of mixed readings.

    rows: (m,) index of them; miss: median distance, mm, by which the robot misses them where it fits the others;
    offset: (3,) mm in the flange frame, by which their target is off, None where they are of another station.
    """

    rows: NDArray[np.int64]
    miss: float
    offset: Array | None


def mixture(meaning: Meaning, tools: Array) -> Mixture | None:
    """The readings that are of another station or of another target than most; None where all are of one kind, and
    where what is left over agrees on nothing.

    tools: (T, 3) nominal targets, mm.
    """
    assert meaning.points is not None
    measured, turn = meaning.points, meaning.flange[:, :3, :3]
    nominal = meaning.flange[:, :3, 3] + np.einsum("nij,nj->ni", turn, tools[meaning.which])
    near = _NEAR * extent_of(nominal)
    plain = _missed(nominal, measured, np.ones(len(nominal), dtype=np.bool_))
    if np.mean(plain < near) >= _MOST:
        return None
    these, miss = _agreeing(nominal, measured, near)
    rest = np.flatnonzero(~these)
    if not _LEAST <= these.mean() < _MOST or len(rest) < _TARGET:
        return None
    left = float(np.median(miss[these]))
    rotation, shift = align(nominal[these], measured[these], np.ones(int(these.sum())))
    off = np.einsum("nji,nj->ni", turn[rest], (measured[rest] - shift) @ rotation - nominal[rest])
    offset = np.median(off, axis=0)
    # Where it is another target of the header's, the fit gives the reading its right name
    named = np.linalg.norm(tools[meaning.which[rest]] + offset - tools[:, None], axis=2).min() < near
    apart = np.linalg.norm(off - offset, axis=1)
    if not named and _alike(apart, miss[rest], near, left):
        return Mixture(rest, float(np.median(miss[rest])), offset)
    if len(rest) < _STATION:
        return None
    _, apart = _agreeing(nominal[rest], measured[rest], near)
    return (
        Mixture(rest, float(np.median(miss[rest])), None) if _alike(apart, miss[rest], near, left) else None
    )


def _alike(apart: Array, together: Array, near: float, left: float) -> bool:
    """Whether readings that are missed by `together` (n,), mm, are of one kind by missing them by `apart` (n,); left:
    median miss of the other kind."""
    clearly = np.median(together) > BETTER * max(left, float(np.median(apart)))
    return bool(clearly and np.mean(apart < near) >= _MOST)


def _agreeing(nominal: Array, measured: Array, near: float) -> tuple[NDArray[np.bool_], Array]:
    """(n,) whether a point is of the most that one place of the robot brings near, and (n,) the misses there, mm."""
    rng = np.random.default_rng(0)
    triples = rng.random((_TRIES, len(nominal))).argpartition(2, axis=1)[:, :3]
    best = max(
        (_missed(nominal, measured, chosen) for chosen in triples),
        key=lambda miss: int(np.sum(miss < near)),
    )
    for _ in range(_ROUNDS):
        best = _missed(nominal, measured, best < near)
    return best < near, best


def _missed(nominal: Array, measured: Array, chosen: NDArray[np.bool_] | NDArray[np.int64]) -> Array:
    """(n,) distances, mm, of all points from where they are with the robot placed by the chosen ones."""
    rotation, shift = align(nominal[chosen], measured[chosen], np.ones(len(nominal[chosen])))
    return np.linalg.norm(measured - nominal @ rotation.T - shift, axis=1)
