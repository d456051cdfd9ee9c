"""The body of a campaign: what `campaign.toml` holds, as JSON; `acquisition.campaign` describes and reads it."""

from __future__ import annotations

from typing import Annotated, Any

from acquisition import CampaignTable
from service.http.wire.bodies.fields import DescribedAs

__all__ = ["Campaign", "CampaignTable"]

Campaign = Annotated[dict[str, Any], DescribedAs(CampaignTable)]
