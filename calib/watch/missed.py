"""The error of the corrected robot at the check poses, with its U, to be compared with the permitted error.

    rms^2 = sum e_i^2 / n,    u(rms)^2 = sum g_i' N_i g_i + (J' g)' F (J' g),    g_i = e_i d_i / (n rms)

d_i: direction of the error e_i; N_i: what the instrument scatters by; F: covariance of its frame, J: what that moves.
The robot's own repeatability and what the model lacks are errors, and in no U.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.data.dataset import Dataset
from calib.model.model import Design, RobotModel
from calib.watch.frame import frame_covariance, frame_effect
from calib.watch.seen import Seen


@dataclass(frozen=True)
class Missed:
    """RMS and largest of n errors, mm: of positions, or of distances where no point was measured; u: expanded
    uncertainty U (k = 2) of the RMS."""

    n: int
    rms: float
    max: float
    u: float


def missed(seen: Seen, dataset: Dataset) -> Missed:
    """The errors of the readings of a watch against its baseline."""
    rows = seen.readings.rows
    design = Design(seen.model, seen.readings.conditions)
    frames = design.frames(seen.plain, {*design.slots})
    pointed = dataset.pointed[rows]
    off = dataset.points[rows].T - frames.p  # (3, n), NaN where a distance was measured
    lengths = dataset.lengths[rows] - np.linalg.norm(frames.p - frames.anchor, axis=0) - frames.length_zero
    errors = np.where(pointed, np.linalg.norm(off, axis=0), np.abs(lengths))
    n, rms = len(errors), float(np.sqrt(np.mean(errors**2)))
    if rms == 0.0:
        return Missed(n, 0.0, 0.0, 0.0)
    noise = dataset.header.noise
    g = np.where(pointed, off, 0.0) / (n * rms)
    of_points = noise.of_points(dataset.points[rows][pointed], dataset.u_point[rows][pointed])
    variance = float(np.einsum("in,nij,jn->", g[:, pointed], of_points, g[:, pointed]))
    others = RobotModel(seen.model.robot, (frame_effect(),), seen.model.targets, anchors=seen.model.anchors)
    by_frame = Design(others, seen.readings.conditions)
    moved = by_frame.point_columns(design.frames(seen.plain, {*design.slots, *by_frame.slots}))
    turn = moved.T @ g.reshape(-1)
    variance += float(turn @ frame_covariance(dataset.header.nests, noise, seen.model.station) @ turn)
    given = dataset.u_length[rows]
    of_lengths = np.where(np.isfinite(given), given, noise.length_mm)
    variance += float(np.sum((errors * of_lengths / (n * rms))[~pointed] ** 2))
    return Missed(n, rms, float(errors.max()), 2.0 * float(np.sqrt(variance)))
