"""Campaigns: kept, listed, given back."""

from __future__ import annotations

from typing import Any

from fastapi import APIRouter
from fastapi.responses import JSONResponse, Response

from service.http.routes.json_route import JsonRoute
from service.http.state import Here
from service.http.wire.bodies import (
    Campaigns,
    CampaignShown,
    NewCampaign,
)
from service.http.wire.headers import CampaignId, IdempotencyKey
from service.http.wire.paths import path_of
from service.http.wire.tags import Tag
from service.http.work.idempotency import reply
from service.http.work.paging import LINKED, Paged

router = APIRouter(route_class=JsonRoute, tags=[Tag.PREPARE])
CAMPAIGNS = path_of("campaigns")


@router.post("/campaigns", operation_id="createCampaign", status_code=201, response_model=CampaignShown)
def create_campaign(here: Here, body: NewCampaign, idempotency_key: IdempotencyKey = "") -> JSONResponse:
    """Keep a campaign, to be run by its id."""

    def work() -> JSONResponse:
        kept = here.shelf.put(body.campaign, body.name, here.models_of(body.campaign))
        return reply(201, kept, location=f"{CAMPAIGNS}/{kept['id']}")

    return here.keys.once(idempotency_key, (CAMPAIGNS, body), work)


@router.get("/campaigns", operation_id="listCampaigns", responses=LINKED, response_model=Campaigns)
async def list_campaigns(here: Here, page: Paged) -> Response:
    """List every campaign, newest first."""
    return await here.listed("campaigns", page, here.shelf.ids, here.shelf.get)


@router.get("/campaigns/{campaign_id}", operation_id="getCampaign", response_model=CampaignShown)
def get_campaign(here: Here, campaign_id: CampaignId) -> dict[str, Any]:
    """Return a campaign that was kept."""
    return here.shelf.get(campaign_id)
