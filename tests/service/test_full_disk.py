"""A service whose disk is full, and jobs that end in a refusal.

These would catch: an internal error when a person has to free disk space, and a place among the waiting jobs that is
never free again. They would also catch a refusal of one job that ends all others.
"""

from __future__ import annotations

import errno
import json
from contextlib import closing
from pathlib import Path

import pytest
from fastapi import FastAPI
from fastapi.testclient import TestClient

from acquisition.errors import StorageError
from service.http.wire import problems
from service.http.work import jobs
from service.http.work.jobs import Jobs
from service.job import do
from service.job_folder import JOB, PROBLEM
from tests.drivers.waiting import PATIENCE_S
from tests.service.test_http_support import problem


def full(path: Path, _: object) -> None:
    raise OSError(errno.ENOSPC, "No space left on device", str(path))


def test_the_service_says_that_there_is_no_room() -> None:
    app = FastAPI()
    problems.install(app)
    app.get("/")(lambda: full(Path("/srv/record/about.json"), ""))
    with TestClient(app) as client:
        told = problem(client.get("/"), 507)
    assert told["detail"] == "about.json: No space left on device."
    assert "Make room" in told["what_to_do"]


def test_a_job_that_cannot_be_kept_waits_nowhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with closing(Jobs(tmp_path)) as queue:
        monkeypatch.setattr(jobs, "replace_file", full)
        with pytest.raises(OSError, match="No space"):
            queue.add("regression", {"dataset_id": "d", "data": str(tmp_path / "data.csv"), "order": {}})
        assert queue.counts() == {"waiting": 0, "working": 0}
        assert not list((tmp_path / "regressions").iterdir())


class FullWorkers:
    """Workers whose disk is full."""

    def call(self, *_: object) -> None:
        raise StorageError("problem.json: No space left on device")

    def close(self) -> None:
        """Nothing is open."""


def test_a_job_that_cannot_keep_its_outcome_ends_no_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(jobs, "Workers", lambda *_, **__: FullWorkers())
    with closing(Jobs(tmp_path)) as queue:
        for _ in range(2):
            own = queue.add(
                "regression", {"dataset_id": "d", "data": str(tmp_path / "data.csv"), "order": {}}
            )["id"]
            while queue.wait("regression", own, 2, PATIENCE_S) < 3:
                pass
            assert "cut off" in queue.document("regression", own)["problem"]["detail"]


def test_a_refusal_of_the_cell_is_the_outcome_of_its_job(tmp_path: Path) -> None:
    """No error of the data: poses that the cell does not allow, say."""
    asked = {"kind": "selection", "cell": 'format = "other/1"', "order": {"groups": [], "targets": None}}
    (tmp_path / JOB).write_text(json.dumps(asked), "utf-8")
    do(tmp_path)
    told = json.loads((tmp_path / PROBLEM).read_text("utf-8"))
    assert "other/1" in told["text"]
    assert told["do"] == "Correct the cell or campaign file and start again."
