"""The questions of a run to a person, the answers, and its events as they happen."""

from __future__ import annotations

import time
from collections.abc import AsyncIterator
from enum import Enum
from typing import Annotated, Any

from fastapi import APIRouter, Depends, Header, Path
from fastapi.responses import JSONResponse
from fastapi.sse import EventSourceResponse, ServerSentEvent

from acquisition import Run
from drivers.interfaces import Answer
from drivers.operator import UnknownPrompt
from service.http.routes.json_route import JsonRoute
from service.http.routes.runs.run_routes import RUNS, who
from service.http.runs.run_document import event_document
from service.http.state import Here
from service.http.wire.bodies import AnswerBody, Prompts, RunResponse
from service.http.wire.headers import IdempotencyKey, LeaseId, PromptId, RunId
from service.http.wire.problems import Problem
from service.http.wire.tags import Tag
from service.http.work.idempotency import reply

router = APIRouter(route_class=JsonRoute, tags=[Tag.MEASURE])
NOTED_S = 2.0  # until the record has an answer; a disk that takes longer is not waited for


class Verb(Enum):
    """The answers, as the last part of a path. `abort` stops the run."""

    CONFIRM = "confirm"
    SKIP = "skip"
    REDO = "redo"
    PAUSE = "pause"
    ABORT = "abort"


@router.get("/runs/{run_id}/prompts", operation_id="listPrompts", tags=[Tag.CORE], response_model=Prompts)
async def list_prompts(here: Here, run_id: RunId) -> dict[str, Any]:
    """List the prompt that is open now, if there is one."""
    prompt = (await here.reading(f"run {run_id}", lambda: here.book.document(run_id)))["prompt"]
    return {"prompts": [] if prompt is None else [prompt]}


@router.post(
    "/runs/{run_id}/prompts/{prompt_id}/{verb}",
    operation_id="answerPrompt",
    tags=[Tag.CORE],
    response_model=RunResponse,
)
async def answer_prompt(
    here: Here,
    run_id: RunId,
    prompt_id: PromptId,
    verb: Annotated[
        Verb, Path(description="The answer, one of those that the prompt lists.", examples=["confirm"])
    ],
    body: AnswerBody,
    idempotency_key: IdempotencyKey = "",
    lease_id: LeaseId = "",
) -> JSONResponse:
    """Answer a prompt; `reason` is kept with the answer.

    409 if it is not, or no longer, being asked. A prompt with an `entry` takes numbers with confirm, in `typed`.
    The asker checks them; numbers that cannot be right are requested again, as another prompt that says why. The
    run continues by leave of the holder of the lease. A client that sends its `Lease-Id` is named as the one who
    answered.
    """

    def work() -> JSONResponse:
        run = here.book.get(run_id)
        try:
            run.answer(
                prompt_id,
                Answer(verb.value),
                by=who(here, lease_id),
                reason=body.reason,
                typed=body.typed,
            )
        except UnknownPrompt as error:
            open_now = (run.status().prompt or {}).get("id", prompt_id)
            more = {} if open_now == prompt_id else {"open_prompt_id": open_now}
            raise Problem(409, f"{error.message}.", error.what_to_do, code=error.code, **more) from error
        _let_note(run, prompt_id)
        return reply(200, here.book.document(run_id))

    path = f"{RUNS}/{run_id}/prompts/{prompt_id}/{verb.value}"
    asked = (path, body)
    return await here.order(run_id, lambda: here.keys.once(idempotency_key, asked, work))


def _let_note(run: Run, prompt_id: str) -> None:
    """Wait until the record has the answer.

    The run is then shown as running, and no client answers the same prompt again.
    """
    end = time.monotonic() + NOTED_S
    while (seen := run.status()).prompt and seen.prompt["id"] == prompt_id and time.monotonic() < end:
        run.wait(seen.version, end - time.monotonic())


async def _run(here: Here, run_id: RunId) -> Run:
    return await here.waiting(lambda: here.book.get(run_id))


LastEventId = Annotated[
    str,
    Header(
        description="The `id` of the last event that is known (left out: from the first).", examples=["412"]
    ),
]


# What FastAPI says of a stream by itself (`itemSchema`) makes client generators refuse the whole document, so
# `openapi.py` describes it.
@router.get("/runs/{run_id}/events", operation_id="streamEvents", response_class=EventSourceResponse)
async def stream_events(
    here: Here, run_id: RunId, run: Annotated[Run, Depends(_run)], last_event_id: LastEventId = ""
) -> AsyncIterator[ServerSentEvent]:
    """Stream every event as it happens, from the first or after Last-Event-ID.

    The stream ends when nothing can happen any more. Server-sent events: `id`, `event` (the kind) and `data`, one
    `EventShown` as JSON. A client that has lost the connection sends `Last-Event-ID` and misses nothing. A browser's
    `EventSource` cannot send the token; `fetch` can. Ignore kinds that you do not know. Members of `data`, by kind:

    | kind | data |
    |---|---|
    | `created` | name, visits, sqlite |
    | `state` | state, code, reason |
    | `command` | verb (pause, stop and so on), by |
    | `prompt` | id, text, expects |
    | `answer` | id, answer, by, reason |
    | `connected`, `link`, `reconnect`, `battery_low`, `device_told` | message or act of a device, by its role |
    | `device_state` | role, state, says |
    | `finish`, `finished_early` | by, reason; measured of total readings |
    | `arrived` | attempt, read_deg |
    | `reading` | attempt, pose, name, set, target, t_air_c (degC) |
    | `reading`, of a point | tracker_mm, world_mm, as_planned_mm (the same at the planned joints) |
    | `reading`, of a length | base_target, length_mm |
    | `attempt_failed` | attempt, error |
    | `attempt_died` | attempt, act, pose, streams of a path by role |
    | `accuracy` | accuracy of an adaptive campaign, and how far each new visit was from its prediction |
    | `batch`, `planned` | numbers of the added visits, and of those drawn at random |
    | `deferred`, `skipped` | pose, reason |
    | `measure_again`, `replanned` | poses and their replacement |
    | `detour` | a move over another posture |
    | `warming_up`, `warm_up`, `warm` | distance of the last readings of the reference pose, mm |
    | `nests_checked`, `nests_judged`, `nest_doubted`, `world_frame`, `zeroed` | nests, frame, zero of the ballbar, mm |
    | `restation`, `instrument_moved` | by, reason |
    | `second_stage`, `second_stage_refused` | stances of the ballbar that are measured again, corrected |
    | `waypoint` | attempt, waypoint, of, samples, lost |
    | `device_needed` | maker, model, serial of the only robot that may be moved |
    | `accept_other`, `other_device_accepted`, `rescued` | by, reason, and the device or record |
    """
    seen = int(last_event_id) if last_event_id.isdecimal() and len(last_event_id) < 16 else 0
    async for events in here.event_batches(run_id, run, seen, 10.0):
        for event in events:
            yield ServerSentEvent(id=str(event.id), event=event.kind, data=event_document(event))
