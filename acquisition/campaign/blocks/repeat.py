"""Blocks of `kind = "repeat"`: a few poses visited repeatedly over the same approach points.

ISO 9283:1998 requires 30 visits of five poses: accuracy and repeatability of each, and of the distances between them,
for which the poses alternate. With `sides = "both"` the sides are drawn once for each pose. Poses that two blocks list
with opposite offsets give the multi-directional variation. With `legs`, a ballbar measures distances instead of points
(Nubiola, thesis, 3.5).
"""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal, Self

from pydantic import model_validator

from acquisition.campaign.blocks.block import BlockVisit, Site
from acquisition.campaign.blocks.legs import Leg, refuse_unknown_legs
from acquisition.campaign.blocks.poses import Chosen
from acquisition.file_table import List, refused, told


class RepeatBlock(Chosen):
    """A block that visits the same few poses repeatedly, for repeatability (ISO 9283)."""

    usual_count: ClassVar[int | None] = 5  # as the visits, of ISO 9283

    kind: Annotated[Literal["repeat"], told("The kind of block.", "repeat")]
    set: Annotated[Literal["repeat", "validation"], told("What the readings are for.", "repeat")] = "repeat"
    visits: Annotated[int, told("Number of visits to each pose.", 30, ge=2, le=10_000)] = 30
    order: Annotated[
        Literal["interleaved", "row"], told("Poses take turns, or all visits of one come first.", "row")
    ] = "interleaved"

    legs: Annotated[
        List[List[Leg]] | None,
        told(
            "With a ballbar: of every pose in `joints_deg` its legs, target and ball on the base.",
            [[["T1", "B1"]]],
            do="Give [['T1', 'B1'], ...] for every pose: target and ball on the base.",
        ),
    ] = None

    @model_validator(mode="after")
    def _legs_of_given_poses(self) -> Self:
        if self.legs is not None and (self.select != "list" or len(self.legs) != self.number):
            raise refused(
                "legs", "is not one row of legs a pose.", "Use select = 'list', with a row for every pose."
            )
        return self

    @property
    def lengths(self) -> bool:
        return self.legs is not None

    def visits_at(self, site: Site) -> list[BlockVisit]:
        found = list(enumerate(self.poses(site, None), start=1))
        turns = range(1, self.visits + 1)
        order = (
            [(i, pose, k) for k in turns for i, pose in found]
            if self.order == "interleaved"
            else [(i, pose, k) for i, pose in found for k in turns]
        )
        legs = self.legs or ((),) * len(found)
        refuse_unknown_legs(site, legs)
        return [
            site.visit(f"visit {k} to pose {i}", pose.joints_deg, pose.sides, legs[i - 1])
            for i, pose, k in order
        ]
