"""Status of a service for observers: for people at its start, for Prometheus, in a log.

These would catch: a start that only programs can read, metrics without the token, and a label that a foreign client
chooses. They would also catch a secret or a reason in a log, and a second line if a path holds a line end.
"""

from __future__ import annotations

import json
import logging
import os
import re
import subprocess
import sys
from pathlib import Path

import httpx2
import pytest
from fastapi.testclient import TestClient
from prometheus_client.parser import text_string_to_metric_families

from calib.errors import DataError
from service.http.access.roles import ServiceSettings, Tokens
from service.http.app import create_app
from service.json_log import json_log
from tests.drivers.waiting import PATIENCE_S
from tests.end_to_end.simulated import ROOT, cell_file
from tests.service.test_http_orders import CAMPAIGN
from tests.service.test_http_support import TOKEN, problem, served

TOKENS = Tokens("only-for-those-who-operate", "only-for-those-who-watch")


def test_people_are_told_where_to_open_the_page(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "service.cli", "serve", "--record", str(tmp_path / "record")]
    env = os.environ | {"TRUEPOSE_TOKEN": TOKEN, "PYTHONPATH": str(ROOT)}
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=env) as process:
        assert process.stdout is not None
        lines = [process.stdout.readline() for _ in range(7)]
        (page,) = re.findall(r"page +(http://127\.0\.0\.1:\d+/)\n", "".join(lines))
        assert httpx2.get(page, timeout=PATIENCE_S).headers["content-type"].startswith("text/html")
        assert TOKEN in lines[2]
        assert lines[-1].startswith("Ctrl-C pauses")
        process.terminate()
        assert process.stdout.read() == ""


def measured(text: str) -> dict[str, float]:
    """Return the samples of a text by name and labels."""
    return {
        f"{sample.name}{sorted(sample.labels.items())}": sample.value
        for family in text_string_to_metric_families(text)
        for sample in family.samples
    }


def test_measures_are_for_those_with_a_token_and_have_no_label_of_a_stranger(tmp_path: Path) -> None:
    with TestClient(create_app(ServiceSettings(tmp_path, TOKENS)), base_url="http://127.0.0.1") as client:
        assert problem(client.get("/metrics"), 401)["code"] == 8001
        watch = {"Authorization": f"Bearer {TOKENS.viewer}"}
        for path in ("/api/v1/runs/evil-name", "/api/v1/no/such/path", "/api/v1/datasets?reason=secret"):
            client.get(path, headers=watch)
        client.request("EVIL", "/nowhere", headers=watch)
        answer = client.get("/metrics", headers=watch)
        assert answer.headers["content-type"].startswith("text/plain; version=")
        assert not re.search("evil|secret|EVIL|nowhere", answer.text)
        found = measured(answer.text)
        route = "[('method', 'GET'), ('route', '/runs/{run_id}'), ('status', '404')]"
        assert found[f"truepose_requests_total{route}"] == 1.0
        assert (
            found["truepose_requests_total[('method', 'none'), ('route', 'none'), ('status', '401')]"] == 1.0
        )
        assert found["truepose_lease_held[]"] == found["truepose_robot_used[]"] == 0.0
        assert found["truepose_jobs[('state', 'waiting')]"] == 0.0


def test_a_run_is_measured_while_it_runs_and_the_log_has_every_request(tmp_path: Path) -> None:
    log = tmp_path / "log.jsonl"
    options = ("--cell", str(cell_file(tmp_path, time_scale=40.0)), "--simulate", "--log", str(log))
    with served(tmp_path / "record", *options) as service:
        service.lease()
        run = service.client.post("/runs", json={"campaign": CAMPAIGN, "dry_run": False}).json()["id"]
        service.until(f"/runs/{run}", "running")
        found = measured(
            httpx2.get(f"{service.url}/metrics", headers=service.client.headers, timeout=PATIENCE_S).text
        )
        assert found["truepose_lease_held[]"] == found["truepose_robot_used[]"] == 1.0
        assert found["truepose_run_state[('state', 'running')]"] == 1.0
        assert found["truepose_run_readings[('what', 'total')]"] == 312.0
        service.client.post(f"/runs/{run}/stop")
    text = log.read_text("utf-8")
    lines = [json.loads(line) for line in text.splitlines()]
    asked = {(line["method"], line["path"], line["status"]) for line in lines if line["message"] == "request"}
    assert ("POST", f"/api/v1/runs/{run}/stop", 202) in asked
    assert ("POST", "/api/v1/cell/lease", 200) in asked
    assert all(line["utc"].endswith("Z") for line in lines)
    assert TOKEN not in text
    assert service.client.headers["Lease-Id"] not in text
    assert "anna" not in text
    assert log.stat().st_mode & 0o077 == 0


def test_a_line_is_a_line_whatever_it_says(tmp_path: Path) -> None:
    file = tmp_path / "log"
    with json_log(str(file)):
        logging.getLogger("service.x").warning(
            "two\nlines", extra={"told": {"path": "/a\n\u2028b", "ms": float("nan")}}
        )
        logging.getLogger("elsewhere").warning("not ours")
    (line,) = file.read_text("utf-8").splitlines()
    told = json.loads(line)
    assert (told["message"], told["path"], told["ms"]) == ("two\nlines", "/a\n\u2028b", None)
    with json_log(str(file)):
        logging.getLogger("service.x").warning("behind it")
    assert len(file.read_text("utf-8").splitlines()) == 2
    with pytest.raises(DataError, match="cannot be written"), json_log(str(tmp_path)):
        pass


@pytest.mark.parametrize(
    "held", [b"j1,j2,x\n1,2,3\n", b"[robot]\n", b'{"format": "truepose-model/2"}', b"\0\1"]
)
def test_a_log_is_not_written_behind_a_file_of_the_user(held: bytes, tmp_path: Path) -> None:
    file = tmp_path / "cell.toml"
    file.write_bytes(held)
    with pytest.raises(DataError, match="is not a log"), json_log(str(file)):
        pass
    assert file.read_bytes() == held
