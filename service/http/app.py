"""The application: what answers under which path. Nothing moves because it starts."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from importlib.metadata import version

import anyio.to_thread
from fastapi import FastAPI

from service.http.access.account import RequestCounters, RequestMetrics
from service.http.access.gate import AccessGate
from service.http.access.lanes import RequestLanes
from service.http.access.roles import ServiceSettings
from service.http.live.feed import LiveFeed
from service.http.routes import (
    campaign_file_routes,
    campaign_routes,
    cell_routes,
    dataset_routes,
    deletion_routes,
    history_routes,
)
from service.http.routes.pages import docs_page, metrics_routes, page
from service.http.routes.pages.openapi import describe
from service.http.routes.runs import (
    loop_routes,
    plan_routes,
    prompt_routes,
    run_routes,
    verification_routes,
)
from service.http.routes.work import (
    alignment_routes,
    examination_routes,
    job_routes,
    program_routes,
    result_routes,
    target_routes,
)
from service.http.state import Service
from service.http.wire import problems
from service.http.wire.paths import PREFIX


def create_app(settings: ServiceSettings) -> FastAPI:
    """The service of one record directory."""

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        app.state.service = service = Service(settings)
        feed = (
            asyncio.create_task(LiveFeed(service, settings.publishers).follow())
            if settings.publishers
            else None
        )
        try:
            yield
        finally:
            if feed is not None:
                feed.cancel()
            await anyio.to_thread.run_sync(service.close)

    app = FastAPI(
        title="TruePose",
        version=version("truepose"),
        description="Measure a robot, name what its model lacks. Not a safety function: the emergency stop is "
        "hardware.",
        openapi_url=None,  # `describe` serves it; the usual page of it loads from elsewhere: `docs_page`
        lifespan=lifespan,
    )
    for routes in (
        cell_routes,
        run_routes,
        prompt_routes,
        loop_routes,
        verification_routes,
        campaign_file_routes,
        campaign_routes,
        dataset_routes,
        plan_routes,
        alignment_routes,
        job_routes,
        result_routes,
        target_routes,
        program_routes,
        examination_routes,
        deletion_routes,
        history_routes,
    ):
        app.include_router(routes.router, prefix=PREFIX)
    app.include_router(page.router)
    app.include_router(docs_page.router)
    app.include_router(metrics_routes.router)
    problems.install(app)
    app.add_middleware(RequestLanes)
    app.add_middleware(AccessGate, settings=settings)  # before the lanes: who may not ask takes nobody's turn
    app.state.account = RequestCounters()
    app.add_middleware(RequestMetrics, account=app.state.account)  # outside all: what is refused counts too
    describe(app)
    return app
