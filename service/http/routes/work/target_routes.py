"""Targets corrected with an identified model, as `truepose compensate` does for a table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from fastapi import APIRouter

from service.http.routes.json_route import JsonRoute
from service.http.state import Here
from service.http.wire.bodies import CorrectedTargets, TargetsToCorrect
from service.http.wire.headers import JobId
from service.http.wire.problems import Problem
from service.http.wire.tags import Tag
from service.http.work.worker_calls import corrected

router = APIRouter(route_class=JsonRoute, tags=[Tag.CORRECT])


@router.post("/models/{job_id}/targets", operation_id="correctTargets", response_model=CorrectedTargets)
def correct_targets(here: Here, job_id: JobId, body: TargetsToCorrect) -> dict[str, Any]:
    """Correct targets, joint angles or poses, so that the real robot lands where they say.

    422 where one of them cannot be corrected, unless `keep_refused`: then it stays as it was.
    """
    document, refused = here.workers.call(corrected, here.jobs.model_file(job_id), job_id, body.model_dump())
    refuse(refused, unless=body.keep_refused)
    return document


def refuse(refused: Sequence[Mapping[str, Any]], *, unless: bool) -> None:
    """Raise Problem 422 where there are targets that cannot be corrected."""
    if refused and not unless:
        more = f" and {len(refused) - 1} more" if len(refused) > 1 else ""
        raise Problem(
            422,
            f"Target '{refused[0]['target']}'{more} cannot be corrected: {refused[0]['reason']}.",
            "Change the target, or leave such targets as they are with keep_refused.",
            code=8111,
            targets=refused,
        )
