"""Blocks of `kind = "repeat"`: a few poses visited repeatedly over the same approach points.

ISO 9283:1998 requires 30 visits of five poses: accuracy and repeatability of each, and of the distances between them,
for which the poses alternate. With `sides = "both"` the sides are drawn once for each pose. Poses that two blocks list
with opposite offsets give the multi-directional variation.
"""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from acquisition.campaign.blocks.block import BlockVisit, Site
from acquisition.campaign.blocks.poses import Chosen
from acquisition.file_table import told


class RepeatBlock(Chosen):
    """A block that visits the same few poses repeatedly, for repeatability (ISO 9283)."""

    usual_count: ClassVar[int | None] = 5  # as the visits, of ISO 9283

    kind: Annotated[Literal["repeat"], told("The kind of block.", "repeat")]
    set: Annotated[Literal["repeat", "validation"], told("What the readings are for.", "repeat")] = "repeat"
    visits: Annotated[int, told("Number of visits to each pose.", 30, ge=2, le=10_000)] = 30
    order: Annotated[
        Literal["interleaved", "row"], told("Poses take turns, or all visits of one come first.", "row")
    ] = "interleaved"

    def visits_at(self, site: Site) -> list[BlockVisit]:
        found = list(enumerate(self.poses(site, None), start=1))
        turns = range(1, self.visits + 1)
        order = (
            [(i, pose, k) for k in turns for i, pose in found]
            if self.order == "interleaved"
            else [(i, pose, k) for i, pose in found for k in turns]
        )
        return [site.visit(f"visit {k} to pose {i}", pose.joints_deg, pose.sides) for i, pose, k in order]
