"""Campaigns: blocks of poses, planned for one cell and checked before anything moves."""

from acquisition.campaign.blocks.block import DECIMALS
from acquisition.campaign.campaign import (
    Campaign,
    CampaignTable,
    campaign_from,
    campaign_of_record,
    read_campaign,
)
from acquisition.campaign.check_poses import ApproachRule, drawn_poses, stance_poses, touch_poses
from acquisition.campaign.observability import setup_of
from acquisition.campaign.placement_views import placement_picture
from acquisition.campaign.placements import BallPlacement, HexapodSurvey, ReachResult, best_first, grid
from acquisition.campaign.plan import Visit, left_out, make_plan
from acquisition.campaign.poses import Pose, draw_poses

__all__ = [
    "DECIMALS",
    "ApproachRule",
    "BallPlacement",
    "Campaign",
    "CampaignTable",
    "HexapodSurvey",
    "Pose",
    "ReachResult",
    "Visit",
    "best_first",
    "campaign_from",
    "campaign_of_record",
    "draw_poses",
    "drawn_poses",
    "grid",
    "left_out",
    "make_plan",
    "placement_picture",
    "read_campaign",
    "setup_of",
    "stance_poses",
    "touch_poses",
]
