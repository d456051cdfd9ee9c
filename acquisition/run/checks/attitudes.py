"""Check that the measured orientation of a body agrees with that of the robot.

A bridge may send the scalar of its quaternions last, the inverse rotation, or that of the pose before. Its points are
then good and its orientations wrong. The orientation of a body on the tool is not known in advance, but constant: the
first poses determine it. The nominal robot orients its tool to within about a degree.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from acquisition.cell.cell import Cell
from acquisition.cell.world_frame import WorldFrame
from acquisition.errors import TurnedOtherwise
from calib.arm import forward
from drivers.interfaces import PointReading, PoseReading

WITHIN_DEG = 5.0


class Attitudes:
    """The orientations of the bodies in one execution."""

    def __init__(self, cell: Cell) -> None:
        self._cell = cell
        self._mounted: dict[str, Rotation] = {}  # of each body relative to the flange, from its first pose

    def refuse_another(
        self, reading: PointReading, world: WorldFrame | None, joints_deg: Sequence[float]
    ) -> None:
        """Check the orientation of a pose at the joints of the robot, deg.

        Raises
        ------
        TurnedOtherwise
            The body is turned against the robot.
        """
        if world is None or not isinstance(reading, PoseReading):
            return
        pose = forward(self._cell.robot.model, self._cell.robot.model_angles([joints_deg]))[0]
        body = Rotation.from_quat(world.turned_to_world(reading.rot_wxyz), scalar_first=True)
        mounted = Rotation.from_matrix(pose[:3, :3]).inv() * body
        first = self._mounted.setdefault(reading.target, mounted)
        off_deg = float(np.degrees((first.inv() * mounted).magnitude()))
        if off_deg > WITHIN_DEG:
            raise TurnedOtherwise(
                f"{reading.target} is turned by {off_deg:.0f} deg from the orientation that its first measured pose "
                "predicts",
                device="instrument",
                command=f"measure {reading.target}",
                raw=reading.raw,
            )
