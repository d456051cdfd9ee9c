"""`kind = "repeat"`: the same few poses visited again and again, each time over the same approach point.

ISO 9283:1998 asks for 30 visits of five poses: accuracy and repeatability of each, and of the distances between them,
for which the poses take turns. With `sides = "both"` the sides are drawn for each pose and stay; poses that two
blocks list with opposite offsets give the multi-directional variation.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from acquisition.campaign.blocks import poses
from acquisition.campaign.blocks.block import BlockVisit, Site
from calib.text import TomlTable

VISITS, POSES = 30, 5  # of ISO 9283
KEYS = (*poses.KEYS, "visits", "order")


@dataclass(frozen=True)
class Repeat:
    """`interleaved`: the poses take turns; else all visits of one pose before the next."""

    source: poses.PoseSource
    visits: int
    interleaved: bool
    ordered = True
    lengths = False

    def visits_at(self, site: Site) -> list[BlockVisit]:
        found = list(enumerate(self.source.poses(site, None), start=1))
        turns = range(1, self.visits + 1)
        order = (
            [(i, pose, k) for k in turns for i, pose in found]
            if self.interleaved
            else [(i, pose, k) for i, pose in found for k in turns]
        )
        return [site.visit(f"visit {k} to pose {i}", pose.joints_deg, pose.sides) for i, pose, k in order]


def read(table: TomlTable, folder: Path | None) -> Repeat:
    """The block of a table of the campaign. Raises ConfigError.

    folder: where pose files are; None: they are not read again.
    """
    return Repeat(
        source=poses.read_source(table, folder, POSES),
        visits=table.whole("visits", VISITS, low=2, high=10_000),
        interleaved=table.text("order", "interleaved", ("interleaved", "row")) == "interleaved",
    )
