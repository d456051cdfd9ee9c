"""Campaigns that were only checked: `RECORD/runs/ID/dry_run.json`.

Such a run is over before anything has moved. Planning takes seconds to minutes; the functions that plan are
called in a worker process.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from acquisition import Campaign, Cell, RunStatus, State, checked_plan
from acquisition.campaign import Visit, left_out
from acquisition.loop import calibration_campaign
from calib.errors import DataError
from calib.text import parse_toml, read_json, replace_file
from service.files import as_json
from service.http.runs.damage import unreadable
from service.http.runs.run_document import run_document
from service.http.work.campaigns import campaign_of
from service.results.cell.accuracy import OutlookShown
from service.results.cell.plan import PlanShown, plan_of_campaign, plan_of_record
from service.results.shape import document_of
from service.wording import counted


@dataclass(frozen=True)
class Expected:
    """What a calibration is expected to need: as `OutlookShown`, and in words. None if no accuracy was asked for."""

    outlook: dict[str, Any] | None = None
    words: str = ""


FILE, PLAN = "dry_run.json", "plan.json"


def planned(
    cell: Cell, table: Mapping[str, Any], models: Mapping[str, Path] | None = None
) -> tuple[Campaign, list[Visit]]:
    """Return the campaign in the body of a request, and its plan; `models` as in `campaign_of`.

    Raises
    ------
    ConfigError, UnsafePlan
        The campaign cannot be used, or its plan is unsafe.
    """
    campaign = campaign_of(table, models or {})
    return campaign, checked_plan(cell, campaign)


def calibration_of(cell: Cell, asked: Mapping[str, Any]) -> tuple[dict[str, Any], Expected]:
    """Return the campaign of a calibration as a table, and what it is expected to need.

    `asked` are the arguments of `calibration_campaign`.

    Raises
    ------
    ConfigError
        The accuracy cannot be reached, or the zone or the time is not possible.
    """
    campaign, outlook = calibration_campaign(cell, **asked)
    shown = document_of(OutlookShown.model_validate(outlook))
    return parse_toml(campaign.source, "calibration"), Expected(shown, outlook.in_words())


def readings_of(cell: Cell, table: Mapping[str, Any]) -> tuple[int, int]:
    """Return the numbers of visits and readings in a campaign.

    Raises
    ------
    ConfigError, UnsafePlan
        The campaign cannot be used, or its plan is unsafe.
    """
    _, visits = planned(cell, table)
    return len(visits), readings_in(visits)


def readings_in(visits: Sequence[Visit]) -> int:
    """Return the number of readings of poses in a plan."""
    return sum(len(visit.targets) for visit in visits if visit.counted)


def keep(
    folder: Path,
    cell: Cell,
    table: Mapping[str, Any],
    name: str,
    simulated: bool,
    models: Mapping[str, Path],
) -> None:
    """Check a campaign and write the result into a new folder; `models` as in `campaign_of`.

    Raises
    ------
    ConfigError, UnsafePlan
        The campaign cannot be used, or its plan is unsafe.
    """
    campaign, visits = planned(cell, table, models)
    total = readings_in(visits)
    plan = plan_of_campaign(cell, campaign, visits)
    folder.mkdir()
    replace_file(folder / PLAN, as_json(document_of(plan)))
    done = State.SUCCEEDED
    status = RunStatus(
        id=folder.name,
        name=name or cell.name,
        state=done.value,
        state_code=done.code,
        seconds_left=plan.seconds,
        reason=" ".join(
            (
                f"Checked only: {counted(len(visits), 'visit')}, {counted(total, 'reading')}; nothing has moved.",
                *left_out(campaign, visits),
            )
        ),
        version=1,
        done=0,
        total=total,
        simulated=simulated,
    )
    document = run_document(folder.name, status, dry_run=True)
    replace_file(folder / FILE, as_json(document))


def plan_in(folder: Path) -> PlanShown:
    """The plan of a run or a dry run in its folder. Raises RecordError, StorageError, DataError."""
    if (folder / FILE).is_file():
        return PlanShown.model_validate(read_json(folder / PLAN))
    return plan_of_record(folder)


class DryRuns:
    """The dry runs among the runs of a folder. Each is read once: nothing happens to it any more."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._known: dict[str, dict[str, Any]] = {}

    def forget(self, name: str) -> None:
        """Forget a run whose folder goes."""
        self._known.pop(name, None)

    def document(self, name: str) -> dict[str, Any] | None:
        """Return the document of a dry run; None for another kind of run.

        Raises
        ------
        DamagedRecord
            The document cannot be read.
        """
        if name not in self._known:
            folder = self._folder / name
            try:
                if not (folder / FILE).is_file():
                    return None
                self._known[name] = read_json(folder / FILE)
            except (OSError, DataError) as error:
                raise unreadable(folder, error) from error
        return self._known[name]
