"""The readings of a fit: conditions, whitened observations and their place in the data set."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from calib.array import Array
from calib.data.conditions import Conditions
from calib.data.dataset import Dataset
from calib.data.noise import whitener
from calib.fit.least_squares import Linearisation, jacobian
from calib.model.model import BoundModel, ModelStructure
from calib.model.observations import Observations, VisitCovariance


@dataclass(frozen=True)
class FitReadings:
    """n readings; rows (n,) index into the data set."""

    conditions: Conditions
    observed: Observations
    rows: NDArray[np.int64]

    def take(self, keep: NDArray[np.bool_]) -> FitReadings:
        """Select readings by a mask (n,)."""
        return self if keep.all() else self.taken(np.flatnonzero(keep))

    def taken(self, index: NDArray[np.int64]) -> FitReadings:
        """Select readings by index."""
        return FitReadings(self.conditions.take(index), self.observed.take(index), self.rows[index])


_AT_ONCE = 1200  # readings whose columns are in memory at a time


def linearised(
    model: ModelStructure, readings: FitReadings, estimate: Array
) -> Iterator[tuple[NDArray[np.int64], Array, Array]]:
    """Yield residual and derivative of the prediction at an estimate (m,), in parts.

    Each part consists of some whole visits. It has the indices of its readings (c,), the whitened
    residual (k, c) and the whitened columns (k c, m).
    """
    for part in _whole_visits(readings.conditions.visit):
        few = readings.taken(part)
        design = BoundModel(model, few.conditions)
        frames = design.frames(estimate, design.slots)
        yield part, few.observed.residual(frames), jacobian(design, few.observed, frames)


def _whole_visits(visit: NDArray[np.int64]) -> Iterator[NDArray[np.int64]]:
    """Yield the indices 0 to n - 1 in parts of about equal length, every visit within one."""
    parts = max(-(-len(visit) // _AT_ONCE), 1)
    _, first, place = np.unique(visit, return_index=True, return_inverse=True)
    part = (first * parts // len(visit))[place.reshape(-1)]
    return (np.flatnonzero(part == p) for p in range(parts))


def readings_of(
    dataset: Dataset, rows: NDArray[np.bool_], model: ModelStructure, estimate: Array
) -> FitReadings:
    """Whiten some rows of a data set, as `begun` does."""
    return begun(dataset, rows, model, estimate)[0]


def begun(
    dataset: Dataset, rows: NDArray[np.bool_], model: ModelStructure, estimate: Array
) -> tuple[FitReadings, Linearisation | None]:
    """Whiten some rows of a data set (a mask); return their linearisation too, if computed.

    The linearisation at the estimate (m,) is available if whitening needed it. It then serves as the
    chain of a first step and is not computed again.

    The instrument's covariance is taken at the measured point. The repeatability of the joints enters
    through the joint Jacobian of `model` at `estimate`. It correlates point, orientation and distance of
    a reading, and the readings of a visit.
    """
    conditions = dataset.conditions.take(rows)
    measured, blocks = [], []
    noise = dataset.header.noise
    pointed, turned, spanned = dataset.pointed[rows], dataset.turned[rows], dataset.spanned[rows]
    points = rotations = lengths = None
    n = len(conditions)
    if pointed.any():
        points = np.where(pointed[:, None], dataset.points[rows], 0.0).T
        measured += [pointed] * 3
        blocks.append(noise.of_points(points.T, dataset.u_point[rows]))
    if turned.any():
        upright = np.where(turned[:, None], dataset.orientation[rows], (1.0, 0.0, 0.0, 0.0))
        rotations = Rotation.from_quat(upright, scalar_first=True).as_matrix().transpose(1, 2, 0)
        measured += [turned] * 3
        variance = _given(dataset.u_rotation[rows], noise.rotation) ** 2
        blocks.append(variance[:, None, None] * np.eye(3))
    if spanned.any():
        lengths = np.where(spanned, dataset.lengths[rows], 0.0)
        measured.append(spanned)
        blocks.append(_given(dataset.u_length[rows], noise.length_mm)[:, None, None] ** 2)
    covariance = _block_diagonal(blocks, n)
    mask = np.column_stack(measured)
    k = mask.shape[1]
    raw = Observations(
        points, rotations, lengths, np.eye(k)[:, :, None] * np.ones(n), mask.sum(axis=1).astype(np.int64)
    )
    shared, design, frames = None, None, None
    scatter = noise.of_each_joint(model.robot.kinds)
    if scatter.any():
        joints = model.robot.joint_slots
        design = BoundModel(model, conditions)
        frames = design.frames(estimate, (*design.slots, *joints))
        # The robot scatters about where it is, not about what was measured: the rotation vector there is zero.
        there = raw if rotations is None else replace(raw, rotations=frames.rotation.transpose(1, 2, 0))
        by_joint, several = there.columns(frames, joints), _several(conditions.visit)
        covariance += noise.of_joints(by_joint, model.robot.kinds) * ~several[:, None, None]
        if several.any():
            shared = scatter[:, None, None] * by_joint * several
    observed = Observations(points, rotations, lengths, whitener(covariance, mask), raw.freedom)
    if shared is not None:
        observed = replace(observed, shared=VisitCovariance(conditions.visit, observed.by_reading(shared)))
    at = None if design is None else Linearisation(design, observed, estimate, frames)
    return FitReadings(conditions, observed, np.flatnonzero(rows)), at


def _several(visit: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Mark the readings that share their visit with others, shape (n,)."""
    return np.bincount(visit)[visit] > 1


def _given(of_row: Array, declared: float) -> Array:
    return np.where(np.isfinite(of_row), of_row, declared)


def _block_diagonal(blocks: Iterable[Array], n: int) -> Array:
    blocks = list(blocks)
    size = sum(block.shape[1] for block in blocks)
    covariance = np.zeros((n, size, size))
    at = 0
    for block in blocks:
        covariance[:, at : at + block.shape[1], at : at + block.shape[1]] = block
        at += block.shape[1]
    return covariance
