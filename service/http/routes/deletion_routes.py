"""Deletions: of runs, data sets, campaigns and results, each for a reason that stays."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, Query
from fastapi.responses import Response

from service.http.routes.json_route import JsonRoute
from service.http.routes.runs.run_routes import who
from service.http.state import Here
from service.http.wire.bodies import DeletionList, DeletionShown
from service.http.wire.headers import CampaignId, DatasetId, JobId, LeaseId, RunId
from service.http.wire.tags import Tag
from service.http.work.paging import LINKED, Paged

router = APIRouter(route_class=JsonRoute, tags=[Tag.DATA])
Reason = Annotated[
    str,
    Query(
        min_length=1,
        max_length=500,
        pattern=r"\S",
        description="Why; it is kept for good.",
        examples=["a trial with the wrong tool"],
    ),
]


@router.delete("/runs/{run_id}", operation_id="deleteRun", response_model=DeletionShown)
def delete_run(here: Here, run_id: RunId, reason: Reason, lease_id: LeaseId = "") -> dict[str, Any]:
    """Delete a run and its readings.

    409 while it, or the loop that it belongs to, uses the robot. Its events stay.
    """
    in_hand = (*here.loops.runs_in_hand(), *here.verifications.runs_in_hand())
    return here.book.delete(run_id, here.deletions, who(here, lease_id), reason, in_hand)


@router.delete("/datasets/{dataset_id}", operation_id="deleteDataset", response_model=DeletionShown)
def delete_dataset(
    here: Here, dataset_id: DatasetId, reason: Reason, lease_id: LeaseId = ""
) -> dict[str, Any]:
    """Delete a data set. 409 while a job works on it. Results that it led to stay."""
    here.jobs.refuse_working_on(dataset_id)
    return here.datasets.delete(dataset_id, here.deletions, who(here, lease_id), reason)


@router.delete("/campaigns/{campaign_id}", operation_id="deleteCampaign", response_model=DeletionShown)
def delete_campaign(
    here: Here, campaign_id: CampaignId, reason: Reason, lease_id: LeaseId = ""
) -> dict[str, Any]:
    """Delete a campaign that was kept; runs that were begun with it have it in their record."""
    return here.shelf.delete(campaign_id, here.deletions, who(here, lease_id), reason)


@router.delete("/results/{job_id}", operation_id="deleteResult", response_model=DeletionShown)
def delete_result(here: Here, job_id: JobId, reason: Reason, lease_id: LeaseId = "") -> dict[str, Any]:
    """Delete a job with its result, model and report. 409 while it waits or works."""
    return here.jobs.delete(job_id, here.deletions, who(here, lease_id), reason)


@router.get("/deletions", operation_id="listDeletions", responses=LINKED, response_model=DeletionList)
async def list_deletions(here: Here, page: Paged) -> Response:
    """Everything that was ever deleted from this record, by whom and why."""
    lines = await here.listing("lines of deletions", here.deletions.lines)
    return await here.listed("deletions", page, lambda: lines, lines.__getitem__, newest_first=False)
