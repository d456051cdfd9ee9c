"""The gate that every request passes: host, origin, token, size.

A page in the operator's browser can send requests to 127.0.0.1, and by DNS rebinding under a name of its own. So
the Host header must name an address of ours, not a name somebody else controls, and an Origin must be our own.
The token is compared in constant time.
"""

from __future__ import annotations

import hmac
import ipaddress
from urllib.parse import urlsplit

from starlette.datastructures import Headers
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from service.http import problems
from service.http.problems import Problem
from service.http.settings import Settings

OPEN = ("/", "/api/v1/health", "/openapi.json")  # tell nothing about the cell
_TOO_LARGE = "The request is larger than {} MB."
_SPLIT = "Send less at once; a data set can be split into series."


class Gate:
    """ASGI middleware."""

    def __init__(self, app: ASGIApp, settings: Settings) -> None:
        self._app = app
        self._host = settings.host.strip("[]").lower()
        self._token = settings.token.encode()
        self._most = settings.upload_bytes

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        refusal = self._refusal(Headers(scope=scope), scope["path"])
        if refusal is not None:
            answer = problems.response(
                refusal.status_code,
                refusal.detail,
                refusal.do,
                headers=dict(refusal.headers or {}),
            )
            await answer(scope, receive, send)
            return
        await self._app(scope, self._counted(receive), send)

    def _refusal(self, headers: Headers, path: str) -> Problem | None:
        host = headers.get("host", "")
        if not self._ours(host):
            return Problem(
                403, f"Requests for the host {host!r} are not answered.", "Use the address itself."
            )
        origin = headers.get("origin")
        if origin is not None and urlsplit(origin).netloc.lower() != host.lower():
            return Problem(403, f"Requests by the page {origin!r} are not answered.", "Use our own page.")
        if path not in OPEN and not self._authorised(headers.get("authorization", "")):
            return Problem(
                401,
                "The token is missing or wrong.",
                "Send 'Authorization: Bearer TOKEN' with the token that 'truepose serve' printed.",
                headers={"WWW-Authenticate": "Bearer"},
            )
        length = headers.get("content-length", "0")
        if length.isdecimal() and int(length) > self._most:
            return self._too_large()
        return None

    def _ours(self, host: str) -> bool:
        try:
            name = (urlsplit(f"//{host}").hostname or "").lower()
        except ValueError:
            return False
        if name in (self._host, "localhost"):
            return True
        try:
            address = ipaddress.ip_address(name)
        except ValueError:
            return False  # a name that somebody else may let point at us
        return address.is_loopback or self._host in ("0.0.0.0", "::")

    def _authorised(self, header: str) -> bool:
        kind, _, token = header.partition(" ")
        return kind.lower() == "bearer" and hmac.compare_digest(token.strip().encode(), self._token)

    def _too_large(self) -> Problem:
        return Problem(413, _TOO_LARGE.format(f"{self._most / 1024 / 1024:g}"), _SPLIT)

    def _counted(self, receive: Receive) -> Receive:
        """A body without a declared length is counted as it comes."""
        seen = 0

        async def counted() -> Message:
            nonlocal seen
            message = await receive()
            seen += len(message.get("body", b""))
            if seen > self._most:
                raise self._too_large()
            return message

        return counted
