"""The lanes in which requests pass, so that a stop overtakes all other requests.

All work on a request before it is handed to a thread, mainly reading and checking its body, is done in the one
event loop. Two hundred requests at once would be two hundred such pieces of work before a later stop.

    at once    orders to the robot and its lease, answers to prompts, health: no waiting
    look       states of runs and loops, also by long polls: one turn of the loop each
    ordinary   everything else: one turn of the loop each, behind each other; too many are refused

A body that is not an upload is read completely before its request takes its turn. A client that sends slowly
therefore delays no other client.
"""

from __future__ import annotations

import asyncio
import re

from starlette.datastructures import Headers
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from service.http.wire import problems
from service.http.wire.paths import PREFIX

AT_ONCE = re.compile(
    rf"{PREFIX}/(health|cell/lease(/\w+)?|runs/[^/]+/(stop|pause|finish)|(loops|verifications)/[^/]+/(stop|pause)"
    r"|runs/[^/]+/prompts/.+)"
)
LOOK = re.compile(rf"{PREFIX}/(cell(/devices)?|(runs|loops|verifications)/[^/]+(/prompts|/events)?)")
UPLOAD = "multipart/form-data"
BODY_BYTES = 1024 * 1024  # a campaign of 5,000 listed poses has some 400 kB
BODY_S = 60.0  # to send it
ORDINARY, UPLOADS = 300, 8  # in hand


class RequestLanes:
    """ASGI middleware."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app
        self._look, self._ordinary = asyncio.Lock(), asyncio.Lock()
        self._in_hand = self._uploads = 0

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self._app(scope, receive, send)
        elif AT_ONCE.fullmatch(scope["path"]):
            await self._with_body(scope, receive, send, None)
        elif scope["method"] == "GET" and LOOK.fullmatch(scope["path"]):
            await self._with_body(scope, receive, send, self._look)
        elif self._in_hand >= ORDINARY:
            await _refuse(
                503, "Too many requests are in hand.", "Ask again in a while.", scope, receive, send
            )
        else:
            self._in_hand += 1
            try:
                await self._one_of_many(scope, receive, send)
            finally:
                self._in_hand -= 1

    async def _one_of_many(self, scope: Scope, receive: Receive, send: Send) -> None:
        if not Headers(scope=scope).get("content-type", "").lower().startswith(UPLOAD):
            await self._with_body(scope, receive, send, self._ordinary)
        elif self._uploads >= UPLOADS:
            await _refuse(
                503, "Too many files are being sent.", "Ask again in a while.", scope, receive, send
            )
        else:
            self._uploads += 1
            try:
                await self._app(scope, receive, send)
            finally:
                self._uploads -= 1

    async def _with_body(
        self, scope: Scope, receive: Receive, send: Send, turns: asyncio.Lock | None
    ) -> None:
        try:
            async with asyncio.timeout(BODY_S):
                body = await _whole(receive)
        except TimeoutError:
            await _refuse(408, "The request did not come to its end.", "Send it again.", scope, receive, send)
            return
        if body is None:
            what = f"A body of this kind has at most {BODY_BYTES / 1024 / 1024:g} MB."
            await _refuse(413, what, "Send less at once.", scope, receive, send)
            return
        if turns is not None:
            async with turns:
                await asyncio.sleep(0)  # more urgent requests that have come meanwhile go first
        await self._app(scope, _again(body, receive), send)


async def _whole(receive: Receive) -> bytes | None:
    """Read the body; None if it is too large, or the client has left."""
    parts: list[bytes] = []
    size = 0
    while True:
        message = await receive()
        if message["type"] != "http.request":
            return None
        size += len(message.get("body", b""))
        if size > BODY_BYTES:
            return None
        parts.append(message.get("body", b""))
        if not message.get("more_body", False):
            return b"".join(parts)


def _again(body: bytes, receive: Receive) -> Receive:
    """Return a channel that gives the body that was read, then later messages.

    A later message is that the client leaves.
    """
    given = False

    async def again() -> Message:
        nonlocal given
        if given:
            return await receive()
        given = True
        return {"type": "http.request", "body": body, "more_body": False}

    return again


async def _refuse(status: int, what: str, do: str, scope: Scope, receive: Receive, send: Send) -> None:
    headers = {"Retry-After": "2"} if status == 503 else {}
    await problems.response(status, what, do, headers=headers)(scope, receive, send)
