"""The blocks of a campaign: one class per kind, with its keys and its visits."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import Discriminator, Tag

from acquisition.campaign.blocks.adaptive import AdaptiveBlock
from acquisition.campaign.blocks.ballbar_geometry import BallbarGeometryBlock
from acquisition.campaign.blocks.block import Block
from acquisition.campaign.blocks.hexapod import HexapodBlock
from acquisition.campaign.blocks.legs import LegsBlock
from acquisition.campaign.blocks.path import PathBlock
from acquisition.campaign.blocks.poses import PosesBlock
from acquisition.campaign.blocks.repeat import RepeatBlock
from acquisition.campaign.blocks.sphere import SphereBlock
from acquisition.campaign.blocks.sweep import CirclePointBlock, SweepBlock


def _kind_of(table: Any) -> Any:
    return table.get("kind", "poses") if isinstance(table, Mapping) else getattr(table, "kind", "poses")


AnyBlock = Annotated[
    Annotated[PosesBlock, Tag("poses")]
    | Annotated[SweepBlock, Tag("sweep")]
    | Annotated[RepeatBlock, Tag("repeat")]
    | Annotated[CirclePointBlock, Tag("circle_point")]
    | Annotated[HexapodBlock, Tag("hexapod")]
    | Annotated[LegsBlock, Tag("legs")]
    | Annotated[BallbarGeometryBlock, Tag("ballbar_geometry")]
    | Annotated[PathBlock, Tag("path")]
    | Annotated[SphereBlock, Tag("sphere")]
    | Annotated[AdaptiveBlock, Tag("adaptive")],
    Discriminator(_kind_of),
]

__all__ = ["AnyBlock", "Block"]
