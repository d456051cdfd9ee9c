"""The uncertainty of a world frame that is set up anew on its nests before every campaign.

A frame that is fitted to nests at a_i, each measured with the covariance N_i, is off by a shift and a turn with

    covariance (sum J_i' N_i^-1 J_i)^-1,    J_i = [I, -[a_i - centre]x]

and so is the one of the calibration. Both together are what a watch may be off by with nothing changed.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from calib.array import Array
from calib.data.noise import Noise
from calib.model.effect import Effect, effect
from calib.model.regressors import Constant


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
    """(6, 6) of shift, mm, and turn about `centre`, rad, of a frame on three nests or more; zero without nests."""
    if len(nests) < 3:
        return np.zeros((6, 6))
    places = np.array(list(nests.values()))
    covariance = noise.of_points(places, np.full(places.shape, np.nan))
    x, y, z = (places - np.array(centre)).T
    zero = np.zeros_like(x)
    turn = np.stack([zero, z, -y, -z, zero, x, y, -x, zero], axis=1).reshape(-1, 3, 3)
    j = np.concatenate([np.tile(np.eye(3), (len(places), 1, 1)), turn], axis=2)
    information = np.einsum("nia,nij,njb->ab", j, np.linalg.inv(covariance), j)
    return np.linalg.inv(information)
