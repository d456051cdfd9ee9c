"""Cross-validation of effects within a data set: each is judged on blocks of readings that the fit has not seen.

The readings are cut into blocks (stretches of time; where the poses follow a path these are regions too). With H the
hat matrix of the linearised fit, what a fit without block B leaves there is

    e_B = (I - H_BB)^-1 r_B,        H = Q Q',

so no fit is repeated. An effect that is taken out of the model takes its own direction q out of H and gives its share
c back to the residual: H - q q', r + q c. Its gain in a block is by how much |e_B|^2 falls when the model has it.
A random hold-out is optimistic, since every held-out reading has neighbours in the fit. Source: Christensen, Pearson &
Johnson 1992 (case deletion by blocks); Roberts et al. 2017 (why blocks).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.array import Array
from calib.model.effect import Effect
from calib.scan.scores import Space

BLOCKS = 8
_FEWEST = 8  # readings a block
_DEALS = 4  # stretches that are dealt to each block
_KNOWN = 1e-9  # what no other block knows of a parameter without a prior, so that it may be solved for


@dataclass(frozen=True)
class Blocks:
    """Rows of every block: index (n,) of the block of each reading."""

    of_reading: NDArray[np.int64]
    count: int

    @classmethod
    def of(cls, space: Space, count: int = BLOCKS) -> Blocks:
        """Stretches of equal length in the order in which the readings were taken."""
        order = space.fitted.readings.conditions.order
        n = len(order)
        count = max(2, min(count, n // _FEWEST))
        rank = np.argsort(np.argsort(order))
        return cls(rank * count // n, count)

    @classmethod
    def dealt(cls, space: Space) -> Blocks:
        """Short stretches of whole poses, in the order in which they were first visited, dealt out to the blocks: no
        block has a pose of another, nor all that shows a step."""
        conditions = space.fitted.readings.conditions
        pose = conditions.pose
        first = np.full(int(pose.max()) + 1, np.inf)
        np.minimum.at(first, pose, conditions.order)
        rank = np.argsort(np.argsort(first, kind="stable"), kind="stable")
        return cls((rank * (_DEALS * BLOCKS) // len(first) % BLOCKS)[pose], BLOCKS)


def carried_gains(space: Space, effects: tuple[Effect, ...], blocks: Blocks) -> Array:
    """(effects, blocks): by how much the squared error on each left-out block falls because the model has the effect.

    In whitened units for noise as declared; negative where the effect does harm to readings it was not fitted to.
    """
    shape = space.residual.shape
    data, whole = space.residual.ravel(), space.basis_of_readings
    own = [space.own_coordinates(effect) for effect in effects]
    gains = np.zeros((len(effects), blocks.count))
    for b in range(blocks.count):
        rows = np.broadcast_to(blocks.of_reading == b, shape).ravel()
        q, r = whole[rows], data[rows]
        gram = q.T @ q
        with_all = _left_out(gram, q.T @ r, float(r @ r))
        for i, (t, c) in enumerate(own):
            # without the effect: basis coordinates lose span(t); the residual gains q t c
            back = q @ (t @ c)
            without = r + back
            keep = np.eye(len(gram)) - t @ t.T
            gains[i, b] = (
                _left_out(keep @ gram @ keep, keep @ (q.T @ without), float(without @ without)) - with_all
            )
    return gains


def _left_out(gram: Array, shared: Array, square: float) -> float:
    """|e_B|^2 from Q_B'Q_B, Q_B'r_B and r_B'r_B: e = r + Q (I - G)^-1 Q'r, without forming e."""
    x = np.linalg.solve((1.0 + _KNOWN) * np.eye(len(gram)) - gram, shared)
    return square + 2.0 * float(shared @ x) + float(x @ gram @ x)
