"""The application of a plant's server: cells put documents in, viewers read.

A document that arrives twice is kept once. A document that contradicts another is kept as well, and this is reported.

Gate, problems and tokens are those of a cell's service. The token of a cell puts documents in and reads
nothing, because it is on a cell PC. The viewer's token reads everything and writes nothing.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime
from importlib.metadata import version

from fastapi import FastAPI, Request
from starlette.responses import Response

from fleet.errors import StoreError, StoreFull
from fleet.outbox import LARGEST
from fleet.store import FleetStore, utc_now
from service import refusals
from service.http.access.account import RequestCounters, RequestMetrics
from service.http.access.gate import AccessGate, Rules
from service.http.access.roles import Role
from service.http.routes.pages.openapi import serve_openapi
from service.http.wire import problems
from service.http.wire.paths import PREFIX, path_of
from service.http.wire.problems import Problem
from service.plant import routes
from service.plant.own_tokens import Senders

AGAIN_S, ROOM_S = 15, 120  # when to ask again: a store that is away, a full store
_PUT = re.compile(rf"{PREFIX}/documents/[^/]+")
_OPEN = (path_of("health"), "/openapi.json")


@dataclass(frozen=True)
class FleetServerSettings:
    """The settings of the server.

    `names` are its names for cells, in addition to its address. `upload_bytes` is the size of the largest document.
    `now` is the clock by which dates of documents are checked.
    """

    tokens: Senders
    host: str = "127.0.0.1"
    names: tuple[str, ...] = ()
    upload_bytes: int = LARGEST
    now: Callable[[], datetime] = utc_now


def create_plant(store: FleetStore, settings: FleetServerSettings) -> FastAPI:
    """Create the server of a store. The caller closes the store."""
    app = FastAPI(
        title="TruePose fleet",
        version=version("truepose"),
        description="Documents that the cells of a plant have of their robots. Moves nothing.",
        openapi_url=None,  # docs, too, would load from elsewhere: `serve_openapi`
    )
    app.state.store = store
    app.state.senders = settings.tokens
    app.state.uploads = Counter()
    app.state.now = settings.now
    app.include_router(routes.router, prefix=PREFIX)
    serve_openapi(app)
    problems.install(app)
    app.add_exception_handler(StoreError, _of_store)
    app.add_middleware(
        AccessGate,
        settings=settings,
        rules=Rules(_OPEN.__contains__, _refusal, "truepose fleet serve", settings.names),
    )
    app.add_middleware(RequestMetrics, account=RequestCounters())
    return app


def _refusal(role: Role, method: str, path: str) -> Problem | None:
    if role is Role.VIEWER and method not in ("GET", "HEAD"):
        return Problem(
            403, "The token of a viewer only permits reading.", "Send the token of a cell.", code=8113
        )
    if role is Role.OPERATOR and not (method == "PUT" and _PUT.fullmatch(path)):
        return Problem(
            403,
            "The token of a cell only permits adding documents.",
            "Send the viewer's token.",
            code=8113,
        )
    return None


async def _of_store(request: Request, error: Exception) -> Response:
    """Answer for a store that is away, full or refuses.

    Nothing was kept, and the document is not the cause. The cell asks again.
    """
    assert isinstance(error, StoreError)
    status, seconds = (507, ROOM_S) if isinstance(error, StoreFull) else (503, AGAIN_S)
    # The address of the store is for those who keep it: the log of the database has it.
    return problems.response(
        status, f"The store {error.what}", refusals.remedy(error), headers={"Retry-After": str(seconds)}
    )
