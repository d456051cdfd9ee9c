"""Bodies of JSON, read as strictly as files: bounded, finite, every key once.

Of two `dry_run` in one body the usual reader takes the last, and a robot may move that was meant to stay still. Every
router with bodies is made with `route_class=JsonRoute`; `tests/service/test_http_bodies.py` looks whether one is not.
"""

from __future__ import annotations

from collections.abc import Callable, Coroutine
from typing import Any

import anyio.to_thread
from fastapi import Request, Response
from fastapi.routing import APIRoute

from calib.errors import DataError
from calib.text import parse_json
from service import refusals
from service.http.state import Service
from service.http.wire.problems import Problem

AT_ONCE = 64 * 1024
"""Bytes that are read within the loop of events: a stop has some ten, and must not wait for a thread.

Larger ones are read in a worker process. What comes back from it is taken over in a tenth of the time, in which no
other thread of the service can do anything.
"""
_WHERE = "body"


class JsonRequest(Request):
    """A request whose JSON is read by `calib.text.json_text`."""

    async def json(self) -> Any:
        """Parse the body.

        Raises
        ------
        Problem
            422, or for a large body also 503.
        """
        body = await self.body()
        try:
            if len(body) <= AT_ONCE:
                return parse_json(body, _WHERE)
            service: Service = self.app.state.service
            return await anyio.to_thread.run_sync(service.workers.call, parse_json, body, _WHERE)
        except DataError as error:
            raise Problem(422, refusals.cause(error), error.do, **refusals.place(error)) from error


class JsonRoute(APIRoute):
    """A route whose requests are `JsonRequest`s."""

    def get_route_handler(self) -> Callable[[Request], Coroutine[Any, Any, Response]]:
        """Return the handler of the framework with our request class."""
        handle = super().get_route_handler()

        async def strictly(request: Request) -> Response:
            return await handle(JsonRequest(request.scope, request.receive))

        return strictly
