"""Observations as whitened rows: residuals, and their derivative for a unit of a slot.

A reading has up to seven rows. They are the tool point (3), the orientation of the tool frame as a
rotation vector (3), and the distance from the tool target to a base target (1). Each reading has a
whitener, lower triangular over all its rows, which divides by the noise. Readings of one visit share the
position where the robot came to rest, and are then whitened together. Whitening happens only here. A row
that a reading did not measure is zero in residual and column, and does not count in `freedom`.

    point        measured - p
    orientation  log(R_measured R') in the world, R the predicted orientation; its derivative for an angular
                 velocity w is J_r(e)^-1 w, the inverse right Jacobian of SO(3) at the residual e
    distance     measured - (|p - anchor| + zero); its derivative is u.v, u the unit vector from anchor to p

The readings of a visit share the deviation of the robot's rest position. With A the derivative of the
readings of a visit by the joints, times the repeatability and whitened by the instrument's noise, their
covariance is I + A A'. Its inverse root

    (I + A A')^-1/2 = I - (A V) diag h (A V)',    A'A = V diag l V',    h = (1 - (1 + l)^-1/2) / l,

makes rows of variance 1 of them, and of all such matrices changes each row least (Kessy et al. 2018,
ZCA). Only matrices of joints by joints are factored, for any number of readings, and those of all visits
at once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from calib.arm.kinematics import ANCHOR, FRAME, LENGTH_ZERO, Frames, cross
from calib.array import Array


@dataclass(frozen=True)
class VisitCovariance:
    """Errors that the readings of a visit share, for n readings of k rows.

    Attributes
    ----------
    visit : array of int, shape (n,)
        Visit of each reading.
    scatter : array of shape (N, k, n)
        The matrix A, one slice per joint; 0 if the reading shares nothing.
    """

    visit: NDArray[np.int64]
    scatter: Array

    def take(self, keep: NDArray[np.bool_] | NDArray[np.int64]) -> VisitCovariance:
        """Select readings by mask or index."""
        return VisitCovariance(self.visit[keep], np.ascontiguousarray(self.scatter[:, :, keep]))

    @cached_property
    def alone(self) -> Array:
        """Whiteners of each reading without the others of its visit, shape (k, k, n).

        They are lower triangular.
        """
        own = np.einsum("aki,ali->ikl", self.scatter, self.scatter) + np.eye(self.scatter.shape[1])
        return np.ascontiguousarray(np.linalg.inv(np.linalg.cholesky(own)).transpose(1, 2, 0))

    @cached_property
    def _of_visits(self) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64], Array]:
        """The readings that share errors, and the factor A V sqrt(h) of their visits.

        It is a tuple of four arrays. The first are the readings that share (s,), visit after visit, and
        the index (v,) at which each visit begins. Then follow the index of each reading's visit (s,) and
        A V sqrt(h) (N, k, s).
        """
        some = np.flatnonzero(np.any(self.scatter != 0.0, axis=(0, 1)))
        some = some[np.argsort(self.visit[some], kind="stable")]
        _, first, place = np.unique(self.visit[some], return_index=True, return_inverse=True)
        a = self.scatter[:, :, some]
        gram = np.add.reduceat(np.einsum("aki,bki->iab", a, a), first, axis=0)
        square, axes = np.linalg.eigh(gram)
        grown = np.sqrt(1.0 + np.maximum(square, 0.0))
        h = 1.0 / (grown * (grown + 1.0))
        return some, first, place, np.einsum("aki,iab->bki", a, (axes * np.sqrt(h)[:, None])[place])

    def whitened(self, rows: Array) -> Array:
        """Whiten rows (..., k, n) visit by visit that were whitened reading by reading."""
        some, first, place, directions = self._of_visits
        if not len(some):
            return rows
        out = rows.copy()
        own = rows[..., some]
        left = own.copy()
        for direction in directions:
            of_visit = np.add.reduceat(np.sum(direction * own, axis=-2), first, axis=-1)
            left -= direction * of_visit[..., None, place]
        out[..., some] = left
        return out


_OF_FRAME = {motion.slot for motion in FRAME}


@dataclass(frozen=True)
class Observations:
    """n whitened readings.

    Quantities that no reading has are None. If only some have one, the others hold anything finite.

    Attributes
    ----------
    points : array of shape (3, n) or None
        Measured points, mm.
    rotations : array of shape (3, 3, n) or None
        Measured orientations.
    lengths : array of shape (n,) or None
        Measured distances, mm.
    whiten : array of shape (k, k, n)
        Whitener of each reading, without the errors in `shared`.
    freedom : array of int, shape (n,)
        Number of measured rows.
    shared : VisitCovariance or None
        Errors that the readings of a visit share; None if there are none.
    """

    points: Array | None
    rotations: Array | None
    lengths: Array | None
    whiten: Array
    freedom: NDArray[np.int64]
    shared: VisitCovariance | None = None

    @property
    def size(self) -> int:
        """Number of rows with those that were not measured: k n."""
        return self.whiten.shape[0] * self.whiten.shape[2]

    @property
    def count(self) -> int:
        """Number of rows that were measured."""
        return int(self.freedom.sum())

    def take(self, keep: NDArray[np.bool_] | NDArray[np.int64]) -> Observations:
        """Select readings by mask or index."""
        return replace(
            self,
            points=None if self.points is None else self.points[:, keep],
            rotations=None if self.rotations is None else self.rotations[:, :, keep],
            lengths=None if self.lengths is None else self.lengths[keep],
            whiten=np.ascontiguousarray(self.whiten[:, :, keep]),
            freedom=self.freedom[keep],
            shared=None if self.shared is None else self.shared.take(keep),
        )

    @cached_property
    def alone(self) -> Observations:
        """The same readings, each whitened by itself.

        They serve to find readings that do not belong, since an error of one reading does not then show
        in the others of its visit.
        """
        if self.shared is None:
            return self
        whiten = np.einsum("ijn,jkn->ikn", self.shared.alone, self.whiten)
        return replace(self, whiten=whiten, shared=None)

    def by_visit(self, rows: Array) -> Array:
        """Whiten rows (..., k, n) by visit that were whitened by reading.

        Such rows are, for example, `columns` times their regressors.
        """
        return rows if self.shared is None else self.shared.whitened(rows)

    def residual(self, frames: Frames) -> Array:
        """Compute the whitened residual, measured minus predicted, shape (k, n)."""
        parts = []
        if self.points is not None:
            parts.append(self.points - frames.p)
        if self.rotations is not None:
            parts.append(_turned(self.rotations, frames))
        if self.lengths is not None:
            distance = np.linalg.norm(frames.p - frames.anchor, axis=0)
            parts.append((self.lengths - distance - frames.length_zero)[None])
        return self.by_visit(self.by_reading(np.concatenate(parts)))

    def columns(self, frames: Frames, slots: Sequence[str]) -> Array:
        """Differentiate the prediction for a unit of every slot, shape (S, k, n).

        The rows are whitened reading by reading, because the regressors of a slot may differ within a visit.
        """
        velocity = frames.velocities(slots)
        angular = velocity if self.rotations is None else frames.turnings(slots)
        of_length = None
        if self.lengths is not None:
            of_length = np.einsum("an,san->sn", _direction(frames), velocity)
            for i, slot in enumerate(slots):
                if slot in ANCHOR and frames.world is not None:
                    of_length[i] = -np.sum(_direction(frames) * frames.world[ANCHOR.index(slot)], axis=0)
                elif slot == LENGTH_ZERO:
                    of_length[i] = 1.0
                elif slot in _OF_FRAME:
                    of_length[i] = 0.0  # the instrument's frame carries the base targets too
        return self._pushed(frames, velocity, angular, of_length)

    def column(self, frames: Frames, slot: str) -> Array:
        """Compute `columns` for one slot, shape (k, n)."""
        return self.columns(frames, (slot,))[0]

    def displaced(self, frames: Frames, velocity: Array) -> Array:
        """Compute the change of the readings when the tool point moves, shape (S, k, n).

        `velocity` (S, 3, n) is in mm. The result is whitened as that of `columns`.
        """
        of_length = None if self.lengths is None else np.einsum("an,san->sn", _direction(frames), velocity)
        return self._pushed(frames, velocity, np.zeros_like(velocity), of_length)

    def _pushed(self, frames: Frames, velocity: Array, angular: Array, of_length: Array | None) -> Array:
        parts = []
        if self.points is not None:
            parts.append(velocity)
        if self.rotations is not None:
            parts.append(_inverse_right_jacobian(_turned(self.rotations, frames), angular))
        if of_length is not None:
            parts.append(of_length[:, None])
        return self.by_reading(parts[0] if len(parts) == 1 else np.concatenate(parts, axis=1))

    def by_reading(self, v: Array) -> Array:
        """Whiten rows (..., k, n) reading by reading.

        The lower-triangular products are written out, since einsum spends most of its time on the small axes.
        """
        out = self.whiten.diagonal().T * v
        for i, j in self._mixed:
            out[..., i, :] += self.whiten[i, j] * v[..., j, :]
        return out

    @cached_property
    def _mixed(self) -> list[tuple[int, int]]:
        """Rows and columns below the diagonal that some reading has in its whitening."""
        k = len(self.whiten)
        return [(i, j) for i in range(k) for j in range(i) if self.whiten[i, j].any()]


def _direction(frames: Frames) -> Array:
    """Return the unit vectors from the anchors to the tool points, shape (3, n)."""
    towards = frames.p - frames.anchor
    return towards / np.maximum(np.linalg.norm(towards, axis=0), 1e-12)


def _turned(rotations: Array, frames: Frames) -> Array:
    """Return the rotation vectors from predicted to measured orientations, (3, n), world, rad.

    `rotations` is (3, 3, n).
    """
    difference = np.einsum("acn,nbc->nab", rotations, frames.rotation)
    return Rotation.from_matrix(difference).as_rotvec().T


def _inverse_right_jacobian(e: Array, w: Array) -> Array:
    """Compute J_r(e)^-1 w, shape (S, 3, n), for rotation vectors e (3, n).

    Source: Sola et al. 2018, eq. 144.
    """
    angle = np.linalg.norm(e, axis=0)
    safe = np.maximum(angle, 1e-4)
    factor = np.where(
        angle > 1e-4, 1.0 / safe**2 - (1.0 + np.cos(safe)) / (2.0 * safe * np.sin(safe)), 1.0 / 12.0
    )
    e = np.broadcast_to(e, w.shape)
    once = cross(e, w)
    return w + 0.5 * once + factor * cross(e, once)
