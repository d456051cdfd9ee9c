"""Expected points: the position of the target for each reading, by the nominal robot in its fitted place.

An error of scale is in proportion to them, never to the measured point, which a validation row must not lend to its
own prediction. A nominal robot errs by some millimetres; of that, a scale of 10e-6 makes less than 0.0001 mm.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from calib.arm.kinematics import forward
from calib.arm.start import base_and_tool
from calib.array import Array
from calib.data.header import Header

_FEWEST = 3  # points that say where a robot is


def expected_points(
    header: Header, joints: Array, series: NDArray[np.str_], target: NDArray[np.str_], measured: Array
) -> Array:
    """(n, 3) mm in the world, at model angles `joints` (n, N), rad.

    series, target: (n,) names; measured: (n, 3) mm, NaN in rows that may not enter a fit. Where the world is free
    every series is brought to its measured points; one without them stays in the base frame.
    """
    flange = forward(header.robot, joints)
    points = np.empty_like(measured)
    for name in np.unique(series):
        of = series == name
        known = header.targets_of(str(name))
        which = np.array([list(known).index(t) for t in target[of]])
        tools = np.array(list(known.values()))
        poses = flange[of]
        here = poses[:, :3, 3] + np.einsum("nij,nj->ni", poses[:, :3, :3], tools[which])
        seen = np.isfinite(measured[of, 0])
        if header.world == "free" and seen.sum() >= _FEWEST:
            pose, _ = base_and_tool(poses[seen], tools, which[seen], measured[of][seen], tool_unknown=False)
            here = here @ pose[:3, :3].T + pose[:3, 3]
        points[of] = here
    return points
