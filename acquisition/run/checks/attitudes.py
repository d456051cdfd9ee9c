"""The check that a pose is turned as the robot is: a body keeps its place on the tool, and so its turn.

A bridge that sends the scalar of its quaternions last, the turn the other way round, or that of the pose before, gives
points that are good and turns that are not. Where a body sits on the tool nobody has said; it is what the first poses
agree on. The nominal robot turns its tool to within a degree or so.
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
    """The turns of the bodies of one execution."""

    def __init__(self, cell: Cell) -> None:
        self._cell = cell
        self._mounted: dict[str, Rotation] = {}  # of each body, beside the flange, by the pose measured first

    def refuse_another(
        self, reading: PointReading, world: WorldFrame | None, joints_deg: Sequence[float]
    ) -> None:
        """Check the turn of a pose where the robot stands, deg. Raises TurnedOtherwise."""
        if world is None or not isinstance(reading, PoseReading):
            return
        pose = forward(self._cell.robot.model, self._cell.robot.model_angles([joints_deg]))[0]
        body = Rotation.from_quat(world.turned_to_world(reading.rot_wxyz), scalar_first=True)
        mounted = Rotation.from_matrix(pose[:3, :3]).inv() * body
        first = self._mounted.setdefault(reading.target, mounted)
        off_deg = float(np.degrees((first.inv() * mounted).magnitude()))
        if off_deg > WITHIN_DEG:
            raise TurnedOtherwise(
                f"{reading.target} is turned by {off_deg:.0f} deg from where the first pose of it says it should be",
                device="instrument",
                command=f"measure {reading.target}",
                raw=reading.raw,
            )
