"""The lack of a baseline: additional scatter of the joints, as its file says (`calib.saved.left_open`); of a file that
does not, by the errors that it left on readings it had not seen:

    held-out error^2 = noise + repeatability + what its parameters are uncertain by + lack

each as the mean square of a reading, of its point where points were measured, else of its distance. What a model lacks
is mostly angles; a slide is taken to lack as many mm as others deg.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calib.array import Array
from calib.data.dataset import Dataset
from calib.fit.least_squares import jacobian
from calib.fit.readings import readings_of
from calib.model.model import Design
from calib.saved import SavedModel
from calib.watch.baseline import Baseline, in_series


def scatter_beyond(saved: SavedModel, dataset: Dataset) -> Array:
    """(N,) the angles, rad, by which the joints scatter more than declared, as the file of the model says.

    Of a file that does not say it, the one angle by which all would have to for the errors that the calibration found
    on readings it had not seen; without such readings, for those of its fit. Nothing where these are as declared.
    """
    if saved.left_open is not None and saved.left_open.scatter is not None:
        return saved.left_open.scatter
    dataset = in_series(saved, dataset)
    baseline = Baseline.of(replace(saved, left_open=None))
    model, estimate, covariance = baseline.model, baseline.estimate, baseline.covariance
    of_points = bool((dataset.fit_rows & dataset.pointed).any())
    rows = dataset.fit_rows & (dataset.pointed if of_points else dataset.spanned)
    if not rows.any():
        return np.zeros(saved.model.robot.joints)
    readings = readings_of(dataset, rows, model, estimate)
    joints, noise = model.robot.joint_slots, dataset.header.noise
    design = Design(model, readings.conditions)
    frames = design.frames(estimate, {*design.slots, *joints})
    size = readings.observed.whiten.shape[0]
    n = len(readings.conditions)
    plain = replace(readings.observed, whiten=np.eye(size)[:, :, None] * np.ones(n), shared=None)
    judged = slice(0, 3) if of_points else slice(size - 1, None)
    by_joint = np.mean(np.sum(plain.columns(frames, joints)[:, judged] ** 2, axis=1), axis=1)
    columns = jacobian(design, plain, frames).reshape(size, n, -1)[judged]
    uncertain = float(np.einsum("knm,knm->", columns @ covariance, columns)) / n
    if of_points:
        covariances = noise.of_points(dataset.points[rows], dataset.u_point[rows])
        instrument = float(np.mean(np.trace(covariances, axis1=1, axis2=2)))
    else:
        given = dataset.u_length[rows]
        instrument = float(np.mean(np.where(np.isfinite(given), given, noise.length_mm) ** 2))
    known = instrument + float(noise.of_each_joint(model.robot.kinds) ** 2 @ by_joint)
    held_out = saved.held_out_rms_mm
    beyond = (saved.noise_scale**2 - 1.0) * known if held_out is None else held_out**2 - known - uncertain
    steps = model.robot.steps
    return np.full(len(steps), np.sqrt(max(beyond, 0.0) / float(steps**2 @ by_joint)))
