"""Messages for people when the service cannot do what they request.

Too many jobs, or a device that did not stop.
"""

from __future__ import annotations

import asyncio
import json
from contextlib import closing
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from drivers.errors import LinkLost
from service.http.routes.runs.run_routes import stop_run
from service.http.state import Service
from service.http.wire.problems import Problem
from service.http.work.jobs import Jobs


def test_whoever_stops_is_told_what_could_not_be_stopped() -> None:
    lost = LinkLost("the cable is out", device="robot", command="stop")

    async def order(name: str, work: Any, *, stops: bool) -> Any:
        assert stops
        return work()

    book = SimpleNamespace(stop=lambda run, by: [lost], document=lambda run, at_once: {"id": run})
    here = cast(Service, SimpleNamespace(book=book, order=order, lease=SimpleNamespace(current=None)))
    told = json.loads(bytes(asyncio.run(stop_run(here, "r1")).body))
    assert told["problems"] == [lost.as_dict()]


def test_the_queue_of_jobs_has_an_end(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("service.http.work.jobs.MOST_WAITING", 0)
    with closing(Jobs(tmp_path)) as jobs, pytest.raises(Problem, match="Too many jobs"):
        jobs.add("identification", {"dataset_id": "d1", "data": str(tmp_path / "data.csv")})
