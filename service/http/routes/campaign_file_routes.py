"""Campaign files, uploaded as they are: TOML, which a browser cannot read."""

from __future__ import annotations

import hashlib
from typing import Annotated, Any

from fastapi import APIRouter, File, Form, UploadFile
from fastapi.responses import JSONResponse

from calib.text import decoded, parse_toml
from service.http.routes.campaign_routes import CAMPAIGNS
from service.http.routes.json_route import JsonRoute
from service.http.state import Here
from service.http.wire.bodies import CampaignShown
from service.http.wire.headers import IdempotencyKey
from service.http.wire.tags import Tag
from service.http.work.idempotency import reply

router = APIRouter(route_class=JsonRoute, tags=[Tag.PREPARE])
NAME = "campaign.toml"


def _table(content: bytes) -> dict[str, Any]:
    return parse_toml(decoded(content, NAME), NAME)


@router.post("/campaigns/file", operation_id="uploadCampaign", status_code=201, response_model=CampaignShown)
def upload_campaign(
    here: Here,
    toml: Annotated[UploadFile, File(description="campaign.toml")],
    name: Annotated[
        str, Form(max_length=200, description="By which people know it.", examples=["night 1"])
    ] = "",
    idempotency_key: IdempotencyKey = "",
) -> JSONResponse:
    """Keep a campaign file, to be run by its id.

    It is refused with line or key if it cannot be used.
    """
    content = toml.file.read()

    def work() -> JSONResponse:
        table = here.file_readers.call(_table, content)
        kept = here.shelf.put(table, name, here.models_of(table))
        return reply(201, kept, location=f"{CAMPAIGNS}/{kept['id']}")

    asked = (f"{CAMPAIGNS}/file", name, hashlib.sha256(content).hexdigest())
    return here.keys.once(idempotency_key, asked, work)
