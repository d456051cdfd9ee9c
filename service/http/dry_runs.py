"""Campaigns that were only checked: `RECORD/runs/ID/dry_run.json`, a run that is over before anything has moved.

Planning takes seconds to minutes: what plans here is called in a worker process.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from acquisition import Campaign, Cell, State, checked_plan
from acquisition.plan import Visit
from calib.files import replace_file
from calib.json_text import read_json
from service.files import as_json
from service.http.campaigns import campaign_of
from service.wording import counted

FILE = "dry_run.json"


def planned(cell: Cell, table: Mapping[str, Any]) -> tuple[Campaign, list[Visit]]:
    """The campaign in the body of a request, and its plan. Raises ConfigError, UnsafePlan."""
    campaign = campaign_of(table)
    return campaign, checked_plan(cell, campaign)


def readings_of(cell: Cell, table: Mapping[str, Any]) -> tuple[int, int]:
    """How many visits and readings of poses a campaign has. Raises ConfigError, UnsafePlan."""
    _, visits = planned(cell, table)
    return len(visits), sum(len(visit.targets) for visit in visits if visit.kind == "pose")


def keep(folder: Path, cell: Cell, table: Mapping[str, Any], name: str, simulated: bool) -> None:
    """Check a campaign and write what came of it into a new folder. Raises ConfigError, UnsafePlan."""
    visits, total = readings_of(cell, table)
    folder.mkdir()
    done = State.SUCCEEDED
    document = {
        "id": folder.name,
        "name": name or cell.name,
        "state": done.value,
        "state_code": done.code,
        "reason": f"Checked only: {counted(visits, 'visit')}, {counted(total, 'reading')}; nothing has moved.",
        "version": 1,
        "done": 0,
        "total": total,
        "skipped": 0,
        "prompt": None,
        "last_reading": None,
        "seconds_left": None,
        "simulated": simulated,
        "dry_run": True,
        "error": None,
    }
    replace_file(folder / FILE, as_json(document))


def read(folder: Path) -> dict[str, Any] | None:
    """The document of a dry run; None where the folder holds another thing."""
    file = folder / FILE
    return read_json(file) if file.is_file() else None
