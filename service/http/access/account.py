"""Account of requests: counts by route and status, and a log line for each if a log is kept.

Neither has query, headers or body, which may hold reasons, names and secrets.
"""

from __future__ import annotations

import logging
import time

from prometheus_client import CollectorRegistry, Counter
from starlette.types import ASGIApp, Message, Receive, Scope, Send

LOG = logging.getLogger("service.http.requests")
NO_ROUTE = (
    "none"  # refused at the gate, or there is no such path: requests of unknown clients make no new label
)


class RequestCounters:
    """The counts of one application."""

    def __init__(self) -> None:
        self.registry = CollectorRegistry()
        self.requests = Counter(
            "truepose_requests",
            "Requests that were answered.",
            ("method", "route", "status"),
            registry=self.registry,
        )


class RequestMetrics:
    """ASGI middleware, outside all others."""

    def __init__(self, app: ASGIApp, account: RequestCounters) -> None:
        self._app, self._account = app, account

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        begun, status = time.monotonic(), 500  # of a fault that nothing answers

        async def seen(message: Message) -> None:
            nonlocal status
            if message["type"] == "http.response.start":
                status = message["status"]
            await send(message)

        try:
            await self._app(scope, receive, seen)
        finally:
            route = getattr(scope.get("route"), "path", NO_ROUTE)
            known = scope["method"] if route != NO_ROUTE else NO_ROUTE
            self._account.requests.labels(known, route, str(status)).inc()
            LOG.info(
                "request",
                extra={
                    "told": {
                        "method": scope["method"],
                        "path": scope["path"],
                        "status": status,
                        "ms": round(1e3 * (time.monotonic() - begun), 1),
                    }
                },
            )
