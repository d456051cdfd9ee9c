"""The campaign: which blocks of poses are measured, planned for one cell and checked before anything moves."""

from acquisition.campaign.blocks.block import DECIMALS
from acquisition.campaign.campaign import Campaign, campaign_from, read_campaign
from acquisition.campaign.observability import setup_of
from acquisition.campaign.placement_views import placement_picture
from acquisition.campaign.placements import Hexapod, Placement, Reached, best_first, grid
from acquisition.campaign.plan import Visit
from acquisition.campaign.poses import Pose, draw_poses

__all__ = [
    "DECIMALS",
    "Campaign",
    "Hexapod",
    "Placement",
    "Pose",
    "Reached",
    "Visit",
    "best_first",
    "campaign_from",
    "draw_poses",
    "grid",
    "placement_picture",
    "read_campaign",
    "setup_of",
]
