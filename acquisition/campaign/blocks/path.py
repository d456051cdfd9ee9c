"""Blocks of `kind = "path"`: joints and measured points are recorded while the robot moves.

The path begins in its first waypoint, which is approached and measured as any pose: then the beam holds the target.
The robot rests `rest_s` in every waypoint, including the first and the last, because the clocks are synchronised by
its starts and stops. It drives at the speeds of its cell file, or more slowly if the block states that.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Literal, Self

from pydantic import ValidationInfo, model_validator

from acquisition.campaign.blocks.block import BlockVisit, Set, Site
from acquisition.campaign.blocks.poses import Chosen
from acquisition.file_table import refused, told
from drivers.errors import ConfigError

FEWEST = 3


class PathBlock(Chosen):
    """A block in which joints and points are recorded while the robot drives."""

    kind: Annotated[Literal["path"], told("The kind of block.", "path")]
    set: Set = "calibration"
    rest_s: Annotated[float, told("Rest in each waypoint, s.", 2.0, ge=0.0, le=3600.0)] = 2.0
    robot_hz: Annotated[float, told("Samples of the joints, Hz.", 125.0, ge=10.0, le=500.0)] = 125.0
    instrument_hz: Annotated[float, told("Points of the instrument, Hz.", 10.0, ge=1.0, le=1000.0)] = 10.0
    speed_deg_s: Annotated[
        float | None, told("Largest speed of a joint, deg/s; left out: the cell's.", 20.0, ge=0.1)
    ] = None

    @model_validator(mode="after")
    def _is_a_path(self, info: ValidationInfo) -> Self:
        known = self.select != "file" or (info.context or {}).get("folder") is not None
        if known and (self.number or 0) < FEWEST:
            raise refused("count", f"gives {self.number} waypoints.", f"A path needs {FEWEST} or more.")
        return self

    @property
    def rates_hz(self) -> Mapping[str, float]:
        """Requested rate of each stream, Hz, by role."""
        return {"robot": self.robot_hz, "instrument": self.instrument_hz}

    def visits_at(self, site: Site) -> list[BlockVisit]:
        if len(site.targets) != 1:
            raise ConfigError(
                f"block {site.number + 1}: a path is followed by one target",
                what_to_do=f"Write targets = ['{site.targets[0]}'] or another one.",
            )
        fastest = site.cell.robot.speed_deg_s
        if self.speed_deg_s is not None and self.speed_deg_s > fastest:
            raise ConfigError(
                f"block {site.number + 1}: speed_deg_s = {self.speed_deg_s:g} is faster than the cell allows",
                what_to_do=f"Write at most {fastest:g}, or raise [robot] speed_deg_s of the cell file.",
            )
        first, *rest = (pose.joints_deg for pose in self.poses(site, None))
        sides = site.sides()
        return [
            BlockVisit(
                f"path of {len(rest) + 1} waypoints",
                first,
                sides,
                site.approach.point(first, sides),
                waypoints=tuple(rest),
            )
        ]
