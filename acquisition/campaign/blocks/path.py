"""`kind = "path"`: the robot drives through waypoints while its joints and the instrument's points are recorded.

The path begins in its first waypoint, which is approached and measured as any pose: then the beam holds the target. It
rests `rest_s` in every waypoint, the first and the last too, because a clock is seen where the robot starts and stops.
The robot drives at the speeds of its cell file, or more slowly where the block says so.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from acquisition.campaign.blocks.block import BlockVisit, Site
from acquisition.campaign.blocks.poses import DRAWN, PoseSource, read_source
from acquisition.campaign.blocks.poses import KEYS as SOURCE_KEYS
from calib.text import TomlTable
from drivers.errors import ConfigError

KEYS = (*SOURCE_KEYS, "rest_s", "robot_hz", "instrument_hz", "speed_deg_s")
FEWEST = 3


@dataclass(frozen=True)
class WaypointPath:
    """The block is one path through the waypoints of `source`.

    rest_s: how long the robot rests in each of them; rates_hz: asked of each stream, by role; speed_deg_s: of the
    leading joint between two waypoints, None for that of the cell.
    """

    source: PoseSource
    rest_s: float
    rates_hz: Mapping[str, float]
    speed_deg_s: float | None
    ordered = True
    lengths = False

    def visits_at(self, site: Site) -> list[BlockVisit]:
        if len(site.targets) != 1:
            raise ConfigError(
                f"block {site.number + 1}: a path is followed by one target; "
                f"write targets = ['{site.targets[0]}'] or another one"
            )
        fastest = site.cell.robot.speed_deg_s
        if self.speed_deg_s is not None and self.speed_deg_s > fastest:
            raise ConfigError(
                f"block {site.number + 1}: speed_deg_s = {self.speed_deg_s:g} is faster than the cell allows; write at "
                f"most {fastest:g}, or raise [robot] speed_deg_s of the cell file"
            )
        first, *rest = (pose.joints_deg for pose in self.source.poses(site, None))
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


def read(table: TomlTable, folder: Path | None) -> WaypointPath:
    """The block of a table. Raises ConfigError. `folder`: where pose files are; None: they are not read again."""
    source = read_source(table, folder)
    if source.count < FEWEST and (folder is not None or source.select in DRAWN):
        raise table.refuse("count", f"gives {source.count} waypoints.", f"A path needs {FEWEST} or more.")
    return WaypointPath(
        source,
        rest_s=table.number("rest_s", 2.0, low=0.0, high=3600.0),
        rates_hz={
            "robot": table.number("robot_hz", 125.0, low=10.0, high=500.0),
            "instrument": table.number("instrument_hz", 10.0, low=1.0, high=1000.0),
        },
        speed_deg_s=table.number("speed_deg_s", low=0.1) if "speed_deg_s" in table.values else None,
    )
