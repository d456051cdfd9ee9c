"""Campaigns that were only checked: `RECORD/runs/ID/dry_run.json`, a run that is over before anything has moved."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from acquisition import Campaign, Cell, State, checked_plan
from calib.files import replace_file
from service.files import as_json
from service.wording import counted

FILE = "dry_run.json"


def readings_of(cell: Cell, campaign: Campaign) -> tuple[int, int]:
    """How many visits and readings of poses a campaign has. Raises ConfigError, UnsafePlan."""
    visits = checked_plan(cell, campaign)
    return len(visits), sum(len(visit.targets) for visit in visits if visit.kind == "pose")


def keep(folder: Path, cell: Cell, campaign: Campaign, name: str, *, simulated: bool) -> None:
    """Check a campaign and write what came of it into a new folder. Raises ConfigError, UnsafePlan."""
    visits, total = readings_of(cell, campaign)
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
    return json.loads(file.read_text(encoding="utf-8")) if file.is_file() else None
