"""The OpenAPI document: FastAPI's own, with the problems that every route has and the tokens that open it."""

from __future__ import annotations

from typing import Any

from fastapi import FastAPI
from fastapi.openapi.utils import get_openapi

from service.http.access.roles import Role, viewer_may
from service.http.wire.bodies import EventShown, ProblemShown
from service.http.wire.problems import MEDIA_TYPE

_TOKENS = {
    Role.OPERATOR: "The operator's token: everything. Where the robot moves the motion lease is needed too.",
    Role.VIEWER: "The viewer's token: everything that is read, and pausing and stopping. Else 403.",
}
_OPERATOR, _VIEWER = ({role.value: []} for role in _TOKENS)


def _describe_stream(document: dict[str, Any]) -> None:
    """The stream of events as text: of its lines, which are server-sent events, `data` is an `EventShown`."""
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


def _document(app: FastAPI) -> dict[str, Any]:
    document = get_openapi(
        title=app.title, version=app.version, description=app.description, routes=app.routes
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
            "description": "What went wrong, and what to do.",
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
