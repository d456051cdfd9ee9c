"""`/metrics` for Prometheus: requests, the current run, jobs, and whether the lease is held.

A token is needed; a viewer's is sufficient (`authorization: credentials_file` of a scrape configuration).
Source: Prometheus exposition format 0.0.4.
"""

from __future__ import annotations

from collections.abc import Iterator
from importlib.metadata import version

from fastapi import APIRouter, Request, Response
from prometheus_client import CONTENT_TYPE_LATEST, CollectorRegistry, generate_latest
from prometheus_client.metrics_core import GaugeMetricFamily, Metric
from prometheus_client.registry import Collector

from acquisition import State
from service.http.state import Here, Service

router = APIRouter()


@router.get("/metrics", include_in_schema=False)
async def metrics(here: Here, request: Request) -> Response:
    """Return the measures as text."""

    def read() -> bytes:
        registry = CollectorRegistry()
        registry.register(Measures(here))
        return generate_latest(registry) + generate_latest(request.app.state.account.registry)

    text = await here.listing("metrics", read)
    return Response(text, headers={"Content-Type": CONTENT_TYPE_LATEST})


class Measures(Collector):
    """The current measures of a service, read at each request."""

    def __init__(self, here: Service) -> None:
        self._here = here

    def collect(self) -> Iterator[Metric]:
        """Return gauges; those of a run only while one uses the robot."""
        here = self._here
        about = GaugeMetricFamily("truepose_info", "The program; always 1.", labels=("version", "simulated"))
        about.add_metric((version("truepose"), str(here.settings.simulated is not None).lower()), 1)
        yield about
        held = here.lease.current is not None
        yield GaugeMetricFamily(
            "truepose_lease_held", "Whether somebody holds the motion lease.", float(held)
        )
        jobs = GaugeMetricFamily("truepose_jobs", "Jobs that wait or are worked on.", labels=("state",))
        for state, number in here.jobs.counts().items():
            jobs.add_metric((state,), number)
        yield jobs
        run_id = here.book.busy_with
        yield GaugeMetricFamily(
            "truepose_robot_used", "Whether a run uses the robot.", float(run_id is not None)
        )
        if run_id is not None:
            yield from self._of_run(run_id)

    def _of_run(self, run_id: str) -> Iterator[Metric]:
        run = self._here.book.document(run_id, at_once=True)
        states = GaugeMetricFamily(
            "truepose_run_state", "1 for the state of the run in hand.", labels=("state",)
        )
        for state in State:
            states.add_metric((state.value,), float(run["state"] == state.value))
        yield states
        readings = GaugeMetricFamily(
            "truepose_run_readings", "Readings of the run in hand.", labels=("what",)
        )
        for what in ("done", "total", "skipped"):
            readings.add_metric((what,), run[what])
        yield readings
        if run["seconds_left"] is not None:
            yield GaugeMetricFamily("truepose_run_seconds_left", "Until its end, s.", run["seconds_left"])
        if run["drift"] is not None:
            drift = run["drift"]["off_mm"]
            yield GaugeMetricFamily("truepose_run_drift_millimetres", "Of its reference pose, mm.", drift)
