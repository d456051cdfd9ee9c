"""The gate that every request passes: host, origin, token, rights of its role, size.

A page in the operator's browser can send requests to 127.0.0.1, and by DNS rebinding under its own name. So the
Host header must name an address of this service, not a name that another party controls, and an Origin must be
our own. The role is left in the request's state for handlers that show it.
"""

from __future__ import annotations

import ipaddress
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol
from urllib.parse import urlsplit

from starlette.datastructures import Headers
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from service.http.access.roles import Role, viewer_may
from service.http.wire import problems
from service.http.wire.paths import path_of
from service.http.wire.problems import Problem

OPEN = ("/", path_of("health"), "/openapi.json", "/docs")  # reveal nothing about the cell
MODULES = ("/page/", "/docs/")  # nor do the modules of the pages
_TOO_LARGE = "The request is larger than {} MB."
_SPLIT = "Send less at once; a data set can be split into series."


@dataclass(frozen=True)
class Rules:
    """Rights in a service.

    Attributes
    ----------
    is_open : callable
        Returns whether a path needs no token.
    refusal : callable
        Returns the problem if a role may not make a request, or None.
    tokens_by : str
        Command that prints the tokens.
    names : tuple of str
        Names of the service in addition to its address.
    """

    is_open: Callable[[str], bool]
    refusal: Callable[[Role, str, str], Problem | None]
    tokens_by: str
    names: tuple[str, ...] = ()


def _is_open(path: str) -> bool:
    return path in OPEN or path.startswith(MODULES)


def _of_a_cell(role: Role, method: str, path: str) -> Problem | None:
    if role is Role.OPERATOR or viewer_may(method, path):
        return None
    return Problem(
        403,
        "The token of a viewer permits only reading, pausing and stopping.",
        "Send the operator's token: the first line of the token file, whose place 'truepose serve' printed.",
        code=8113,
    )


CELL = Rules(_is_open, _of_a_cell, "truepose serve")


class TokenRoles(Protocol):
    """Tokens with their roles."""

    def role_of(self, token: str) -> Role | None: ...


class GuardedService(Protocol):
    """Requirements of the gate on a service: its address, its tokens, the largest body."""

    @property
    def host(self) -> str: ...
    @property
    def tokens(self) -> TokenRoles: ...
    @property
    def upload_bytes(self) -> int: ...


class AccessGate:
    """ASGI middleware."""

    def __init__(self, app: ASGIApp, settings: GuardedService, rules: Rules = CELL) -> None:
        self._app, self._rules = app, rules
        self._host = settings.host.strip("[]").lower()
        self._names = {self._host, "localhost", *(name.lower() for name in rules.names)}
        self._tokens = settings.tokens
        self._most = settings.upload_bytes

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        headers = Headers(scope=scope)
        role = self._tokens.role_of(token) if (token := bearer(headers.get("authorization", ""))) else None
        refusal = self._refusal(headers, scope["method"], scope["path"], role)
        if refusal is not None:
            answer = problems.response(
                refusal.status_code,
                refusal.detail,
                refusal.do,
                refusal.code,
                headers=dict(refusal.headers or {}),
            )
            await answer(scope, receive, send)
            return
        scope.setdefault("state", {})["role"] = role
        await self._app(scope, self._counted(receive), send)

    def _refusal(self, headers: Headers, method: str, path: str, role: Role | None) -> Problem | None:
        host = headers.get("host", "")
        if not self._ours(host):
            return Problem(
                403, f"Requests for the host {host!r} are not answered.", "Use the address itself."
            )
        origin = headers.get("origin")
        if origin is not None and urlsplit(origin).netloc.lower() != host.lower():
            return Problem(403, f"Requests by the page {origin!r} are not answered.", "Use our own page.")
        if role is None and not self._rules.is_open(path):
            return Problem(
                401,
                "The token is missing or wrong.",
                f"Send 'Authorization: Bearer TOKEN' with a token that '{self._rules.tokens_by}' printed.",
                headers={"WWW-Authenticate": "Bearer"},
            )
        barred = None if role is None else self._rules.refusal(role, method, path)
        if barred is not None:
            return barred
        length = headers.get("content-length", "0")
        if length.isdecimal() and int(length) > self._most:
            return self._too_large()
        packed = headers.get("content-encoding", "identity")
        if packed.lower() != "identity":
            return Problem(
                415, f"The body is packed ({packed[:40]}); it is not unpacked here.", "Send it as it is."
            )
        return None

    def _ours(self, host: str) -> bool:
        try:
            name = (urlsplit(f"//{host}").hostname or "").lower()
        except ValueError:
            return False
        if name in self._names:
            return True
        try:
            address = ipaddress.ip_address(name)
        except ValueError:
            return False  # a name that another party may let point at us
        return address.is_loopback or self._host in ("0.0.0.0", "::")

    def _too_large(self) -> Problem:
        return Problem(413, _TOO_LARGE.format(f"{self._most / 1024 / 1024:g}"), _SPLIT)

    def _counted(self, receive: Receive) -> Receive:
        """Count a body without a declared length as it comes."""
        seen = 0

        async def counted() -> Message:
            nonlocal seen
            message = await receive()
            seen += len(message.get("body", b""))
            if seen > self._most:
                raise self._too_large()
            return message

        return counted


def bearer(header: str) -> str:
    """Return the token of an Authorization header, or "" if it has none."""
    kind, _, token = header.partition(" ")
    return token.strip() if kind.lower() == "bearer" else ""
