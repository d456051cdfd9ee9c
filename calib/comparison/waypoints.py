"""The waypoint of each sample: samples between which the robot hardly moved share a waypoint."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from calib.data.dataset import Dataset
from calib.units import DEG

SAME = 0.2 * DEG
"""Samples whose joints all lie within this of each other, or of a sample between them, are of one waypoint."""


def waypoints_of(dataset: Dataset) -> NDArray[np.int64]:
    """(n,) number of the waypoint of every reading; of a campaign that stops, that of its pose."""
    joints = dataset.conditions.joints
    pairs = KDTree(joints).query_pairs(SAME, p=np.inf, output_type="ndarray")
    linked = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(joints),) * 2)
    return connected_components(linked, directed=False)[1].astype(np.int64)
