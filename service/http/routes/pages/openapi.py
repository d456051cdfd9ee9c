"""The OpenAPI document of FastAPI, with the problems of every route and the tokens."""

from __future__ import annotations

import json
import threading
from collections.abc import AsyncIterator
from typing import Any

import anyio.to_thread
from fastapi import FastAPI, Request
from fastapi.openapi.utils import get_openapi
from fastapi.responses import StreamingResponse

from service.http.access.roles import Role, viewer_may
from service.http.wire.bodies import EventShown, ProblemShown
from service.http.wire.problems import MEDIA_TYPE
from service.http.wire.tags import TAGS

_PIECE = 32768  # bytes that are sent at once
_TOKENS = {
    Role.OPERATOR: "The operator's token: everything. Where the robot moves the motion lease is needed too.",
    Role.VIEWER: "The viewer's token: everything that is read, and pausing and stopping. Else 403.",
}
_RULES = """

1. **Token.** Every request but `GET /api/v1/health` has `Authorization: Bearer TOKEN`. The viewer's token reads,
   pauses and stops.
2. **Lease.** What moves the robot has `Lease-Id`, the `lease_id` of `POST /api/v1/cell/lease`. Send that request again
   with `Lease-Id` three times within its `seconds`; a client that falls silent pauses its run. 409 there: the lease is
   lost; take it anew without `Lease-Id`, and resume what was paused.
3. **Once.** `Idempotency-Key`, a new one for a new request, on everything that is to happen once. Where no answer came,
   send the same request with the same key: it is done once, and the first answer comes, with `Idempotent-Replay: true`.
4. **Long poll.** `?wait=20&after=VERSION` answers as soon as the `version` is beyond, or after 20 s. A run goes on
   while its `state` is `ready`, `running` or `waiting_for_operator`, a job while it is `ready` or `running`. One such
   request at a time; orders go over another connection.
5. **Stop.** `POST /api/v1/runs/{run_id}/stop` needs no lease and is never behind anything. It is a request to the
   controller: where it is not answered, or its answer has `problems`, press the emergency stop.
"""
_STATUSES = (
    "What went wrong, and what to do. 401, 403: the token is missing, or a viewer's. 404: there is no such thing. 409: "
    "not now, another holds the lease (`holder`), the robot is busy (`run_id`), the prompt is answered. 413: too "
    "large. 422: what was sent cannot be used (`key` or `line`). 503: too much at once, or the service ends "
    "(`Retry-After`). 507: the disk is full."
)
_OPERATOR, _VIEWER = ({role.value: []} for role in _TOKENS)


def _describe_stream(document: dict[str, Any]) -> None:
    """Describe the stream of events as text.

    Its lines are server-sent events, whose `data` is an `EventShown`.
    """
    for item in document["paths"].values():
        answer = item.get("get", {}).get("responses", {}).get("200", {})
        if "text/event-stream" in answer.get("content", {}):
            answer["description"] = "Server-sent events; `data` of each is one `EventShown` as JSON."
            example = (
                'id: 412\nevent: reading\ndata: {"id": 412, "kind": "reading", "data": {"target": "T1"}}\n\n'
            )
            answer["content"] = {"text/event-stream": {"schema": {"type": "string", "examples": [example]}}}


def describe(app: FastAPI) -> None:
    """Complete `/openapi.json`: what FastAPI does not find out by itself."""

    def openapi() -> dict[str, Any]:
        if app.openapi_schema is None:
            app.openapi_schema = _document(app)
        return app.openapi_schema

    app.openapi = openapi
    serve_openapi(app)


def serve_openapi(app: FastAPI) -> None:
    """Serve `/openapi.json` for an application that serves none.

    The document takes seconds to make, and any client may request it. Therefore it is made once and in a thread: in the
    event loop a stop would wait for it.
    """
    made: list[bytes] = []
    making = threading.Lock()

    def text() -> bytes:
        with making:
            if not made:
                made.append(json.dumps(app.openapi()).encode())
            return made[0]

    async def pieces(content: bytes) -> AsyncIterator[bytes]:  # each waits until the one before it was read
        for start in range(0, len(content), _PIECE):
            yield content[start : start + _PIECE]

    async def answer(_: Request) -> StreamingResponse:
        content = made[0] if made else await anyio.to_thread.run_sync(text)
        size = {"Content-Length": str(len(content))}
        return StreamingResponse(pieces(content), media_type="application/json", headers=size)

    app.add_route("/openapi.json", answer, include_in_schema=False)


def _document(app: FastAPI) -> dict[str, Any]:
    document = get_openapi(
        title=app.title,
        version=app.version,
        description=app.description + _RULES,
        routes=app.routes,
        tags=[{"name": tag.value, "description": text} for tag, text in TAGS.items()],
    )
    parts = document.setdefault("components", {})
    schemas = parts.setdefault("schemas", {})
    for name in ("HTTPValidationError", "ValidationError"):
        schemas.pop(name, None)
    schemas["ProblemShown"] = ProblemShown.model_json_schema()
    schemas["EventShown"] = EventShown.model_json_schema()
    _describe_stream(document)
    parts["responses"] = {
        "Problem": {
            "description": _STATUSES,
            "content": {MEDIA_TYPE: {"schema": {"$ref": "#/components/schemas/ProblemShown"}}},
        }
    }
    parts["securitySchemes"] = {
        role.value: {"type": "http", "scheme": "bearer", "description": text}
        for role, text in _TOKENS.items()
    }
    document["security"] = [_OPERATOR]
    for path, item in document["paths"].items():
        for method, operation in item.items():
            operation["responses"].pop("422", None)  # FastAPI's own form, which is never sent
            operation["responses"]["default"] = {"$ref": "#/components/responses/Problem"}
            if path.endswith("/health"):
                operation["security"] = []
            elif viewer_may(method.upper(), path):
                operation["security"] = [_OPERATOR, _VIEWER]
    return document
