"""The uncertainty of a world frame that is set up anew on its nests before every campaign.

A frame by 3-2-1 (`calib.arm.world_frame`) on nests that are measured with the covariances N_i each is off by a shift
and a turn with

    covariance sum J_i N_i J_i',    J_i: what an error of nest i does to them,

and so is the one of the calibration. Both together are what a watch may be off by with nothing changed. A frame that
is fitted to its nests would be less so: about z by 2.7 times in the variance on the corners of a square.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.spatial.transform import Rotation

from calib.arm.world_frame import by_three_two_one, frame_of
from calib.array import Array
from calib.data.noise import Noise
from calib.errors import DataError
from calib.model.effect import Effect, effect
from calib.model.regressors import Constant

_STEP_MM = 1e-3  # by which a nest is moved to see what its errors do


def frame_effect() -> Effect:
    """The instrument's frame shifted, mm, and turned about the model's station, deg."""
    acts = {
        axis: ("mm" if len(axis) == 1 else "deg", None, [(f"frame.{axis}", Constant())])
        for axis in ("x", "y", "z", "rx", "ry", "rz")
    }
    return effect("frame", "instrument", "instrument", "The frame is set up anew.", acts)


def frame_covariance(
    nests: Mapping[str, tuple[float, float, float]], noise: Noise, centre: tuple[float, float, float]
) -> Array:
    """(6, 6) of shift, mm, and turn about `centre`, rad, of a frame on the first three of some nests; zero without
    three. Raises DataError where these lie in a line."""
    if len(nests) < 3:
        return np.zeros((6, 6))
    try:
        frame_of(np.array(list(nests.values())[:3]))
    except ValueError as error:
        raise DataError(
            f"are nests in a line ({', '.join(list(nests)[:3])}), which span no frame.",
            do="Name first three nests that do not lie in a line.",
            key="nests",
        ) from error
    places, about = np.array(list(nests.values())[:3]), np.array(centre)
    covariance = noise.of_points(places, np.full(places.shape, np.nan))
    off = np.zeros((6, 3, 3))
    for nest, axis in np.ndindex(3, 3):
        measured = places.copy()
        measured[nest, axis] += _STEP_MM
        frame = by_three_two_one(measured, places)
        turn = Rotation.from_matrix(frame.rotation).as_rotvec()
        off[:, nest, axis] = np.concatenate([frame.to_world(about) - about, turn]) / _STEP_MM
    return np.einsum("ani,nij,bnj->ab", off, covariance, off)
