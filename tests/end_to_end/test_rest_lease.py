"""Motion of a service's robot only with the secret of the lease, and takeovers during a run.

These would catch: a run that continues for a holder who has lost the lease, and one that any client can resume. They
would also catch a takeover that is not in the events, a stop that a viewer is refused, and a record that others on the
computer can read.
"""

from __future__ import annotations

import json
import os
import stat
import tomllib
from collections.abc import Iterator
from pathlib import Path

import httpx2
import pytest

from tests.changing_files import looked_at
from tests.drivers.waiting import PATIENCE_S, until
from tests.end_to_end.simulated import campaign_file, cell_file
from tests.service.test_http_support import Served, problem, served


def open_to_others(folder: Path) -> list[str]:
    """List the entries of a folder, itself included, that other users can read or enter."""
    return [
        f"{stat.filemode(mode)} {path.relative_to(folder)}"
        for path, mode in looked_at(folder, lambda path: path.stat().st_mode).items()
        if stat.S_IMODE(mode) != (0o700 if stat.S_ISDIR(mode) else 0o600)
    ]


@pytest.fixture
def common_umask() -> Iterator[None]:
    """The one that most computers have, under which files are readable by everybody."""
    before = os.umask(0o022)
    yield
    os.umask(before)


def reason_of(service: Served, run: str) -> str:
    return service.until(f"/runs/{run}", "paused")["reason"]


@pytest.mark.usefixtures("common_umask")
def test_a_run_obeys_who_has_the_secret_and_a_viewer_stops_it(tmp_path: Path) -> None:
    cell = cell_file(tmp_path, time_scale=60.0)
    file = campaign_file(tmp_path, calibration=30, validation=2, warm_up_s=0.0, samples=1, reference_every=0)
    order = {"campaign": tomllib.loads(file.read_text("utf-8")), "dry_run": False}
    record = tmp_path / "record"
    with served(record, "--cell", str(cell), "--simulate") as service:
        client = service.client  # sends no secret by itself
        anna = {
            "Lease-Id": client.post("/cell/lease", json={"holder": "anna", "seconds": 300}).json()["lease_id"]
        }
        assert problem(client.post("/runs", json=order), 409)["code"] == 8102
        run = client.post("/runs", json=order, headers=anna).json()["id"]
        path = f"/runs/{run}"
        until(lambda: client.get(path).json()["done"] >= 1)
        assert (record / path[1:] / "record.sqlite3-wal").is_file()
        if os.name == "posix":
            assert open_to_others(record) == []

        body = {"holder": "bert", "reason": "anna has gone home", "seconds": 300}
        bert = {"Lease-Id": client.post("/cell/lease/takeover", json=body).json()["lease_id"]}
        why = "bert has taken the motion lease over from anna: anna has gone home"
        assert reason_of(service, run) == why
        events = [json.loads(line) for line in client.get(f"{path}/events.jsonl").text.splitlines()]
        (pause,) = [
            each["data"] for each in events if each["kind"] == "command" and each["data"]["verb"] == "pause"
        ]
        assert pause["by"] == "bert"
        for headers in ({}, anna, {"Lease-Id": "bert"}):
            assert problem(client.post(f"{path}/resume", headers=headers), 409)["code"] == 8102
        assert client.get(path).json()["state"] == "paused"
        assert client.post(f"{path}/resume", headers=bert).status_code == 202
        service.until(path, "running")

        token = service.hello["viewer_token"]
        with httpx2.Client(
            base_url=client.base_url, headers={"Authorization": f"Bearer {token}"}, timeout=PATIENCE_S
        ) as viewer:
            assert problem(viewer.post(f"{path}/restation"), 403)["code"] == 8113
            assert viewer.post(f"{path}/pause").status_code == 202
            service.until(path, "paused")
            assert problem(viewer.post(f"{path}/resume", headers=bert), 403)["code"] == 8113
            client.post(f"{path}/resume", headers=bert)
            service.until(path, "running")
            assert viewer.post(f"{path}/stop").status_code == 202
            service.until(path, "stopped")
