"""Campaigns that were sent: checked, and kept as `RECORD/campaigns/ID.json`."""

from __future__ import annotations

import time
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

from acquisition import Campaign, campaign_from
from calib.text import replace_file
from drivers.errors import ConfigError
from service.files import as_json
from service.http.wire.bodies import CampaignShown
from service.http.wire.problems import Problem, not_found
from service.http.work.deletions import DeletionLog, hash_of, take_away
from service.http.work.stored_documents import read_kept
from service.ids import new_id, safe_id
from service.json_values import utc_text

MOST_POSES = 5_000  # a plan is made before the answer; a night has some hundreds


def campaign_of(table: Mapping[str, Any], models: Mapping[str, Path] = MappingProxyType({})) -> Campaign:
    """Read a campaign from the body of a request.

    `models` are the files of the models that its blocks may name.

    Raises
    ------
    ConfigError
        The campaign cannot be used.
    """
    refuse_null(table, "campaign")
    count = 0
    for block in table.get("block", ()) if isinstance(table.get("block"), list) else ():
        if not isinstance(block, Mapping):
            continue
        if block.get("select") == "file":
            raise ConfigError(
                "campaign, key 'block': select = 'file' reads files of the server", what_to_do="Send a list."
            )
        if isinstance(model := block.get("model"), str) and model not in models:
            raise ConfigError(
                f"campaign, key 'block': model = {model!r} cannot be used here",
                what_to_do="In a run, give the id of a job or loop of this service that has found a model.",
            )
        count += block["count"] if isinstance(block.get("count"), int) else 0
    if count > MOST_POSES:
        raise ConfigError(
            f"campaign, key 'block': has {count} poses, at most {MOST_POSES} are taken",
            what_to_do="Split the campaign.",
        )
    campaign = campaign_from(table, "campaign")
    for each in campaign.blocks:
        if each.model is not None:
            each.drive_through(models[each.model])
    return campaign


def refuse_null(value: object, where: str) -> None:
    """Refuse null and incomplete characters in JSON, which files and records cannot hold.

    Raises
    ------
    ConfigError
        The value is refused.
    """
    if value is None:
        raise ConfigError(f"key '{where}' is null", what_to_do="Leave the key out.")
    if isinstance(value, str):
        try:
            value.encode("utf-8")
        except UnicodeEncodeError as error:
            raise ConfigError(
                f"key '{where}' is not valid text", what_to_do="Send UTF-8 text without surrogate characters."
            ) from error
    elif isinstance(value, Mapping):
        for key, each in value.items():
            refuse_null(key, where)
            refuse_null(each, f"{where}.{key}")
    elif isinstance(value, list):
        for i, each in enumerate(value):
            refuse_null(each, f"{where}[{i}]")


class CampaignStore:
    """The campaigns of one record directory."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        folder.mkdir(parents=True, exist_ok=True)

    def put(self, table: Mapping[str, Any], name: str, models: Mapping[str, Path]) -> dict[str, Any]:
        """Keep a campaign; `models` as in `campaign_of`.

        Raises
        ------
        ConfigError
            The campaign cannot be used.
        """
        campaign_of(table, models)
        own = new_id()
        document = {"id": own, "name": name, "created_utc": utc_text(time.time()), "campaign": dict(table)}
        replace_file(self._folder / f"{own}.json", as_json(document))
        return document

    def get(self, name: str) -> dict[str, Any]:
        """Return the campaign of that id.

        Raises
        ------
        Problem
            404: there is no such campaign.
        """
        file = self._folder / f"{name}.json"
        if not safe_id(name) or not file.is_file():
            raise not_found("campaign", name)
        return read_kept(file, CampaignShown)

    def delete(self, name: str, trail: DeletionLog, by: str, reason: str) -> dict[str, Any]:
        """Delete a campaign and return the line of the trail.

        Raises
        ------
        Problem
            404: there is no such campaign.
        StorageError
            The trail cannot be written, or the file cannot be deleted.
        """
        file = self._folder / f"{name}.json"
        if not safe_id(name) or not file.is_file():
            raise not_found("campaign", name)
        try:
            document = self.get(name)
        except Problem:  # damaged
            document = {"id": name}
        line = trail.note("campaign", document, by, reason, sha256=hash_of(file))
        take_away(file)
        return line

    def ids(self) -> list[str]:
        """Return the ids of all campaigns, newest first."""
        return sorted((file.stem for file in self._folder.glob("*.json")), reverse=True)
