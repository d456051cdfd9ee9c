"""A cell PC drives a campaign by REST alone over the simulated cell.

The command line measures the same.
"""

from __future__ import annotations

import csv
import io
import json
import os
import pty
import tomllib
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import httpx2

from calib.data.read import read_dataset
from tests.drivers.waiting import PATIENCE_S, until
from tests.end_to_end.simulated import campaign_file, cell_file, truepose
from tests.processes import descendants_of
from tests.service.test_http_support import Served, problem, served

NESTS_AND_TARGETS = ["N1", "N2", "N3", "T1", "T2", "T3"]
READINGS = 90  # 28 poses of three targets, and the reference pose twice for each target


def one_smr(folder: Path) -> tuple[Path, Path]:
    """A cell whose only SMR a person moves, and a small campaign."""
    cell = cell_file(folder, time_scale=1000.0, effects=("backlash:j4",), one_smr=True)
    campaign = campaign_file(folder, calibration=22, validation=6, warm_up_s=60.0, samples=20)
    return cell, campaign


def answer_prompts(service: Served, run: str) -> list[str]:
    """Poll, show and confirm the prompts like a cell PC, until the run has ended.

    The result lists the prompts.
    """
    asked: list[str] = []
    version = 0
    while True:
        shown = service.client.get(f"/runs/{run}", params={"wait": 10, "after": version}).json()
        version = shown["version"]
        if shown["state"] in ("succeeded", "failed", "paused", "stopped"):
            assert shown["state"] == "succeeded", shown
            return asked
        prompt = shown["prompt"]
        if shown["state"] == "waiting_for_operator" and prompt is not None:
            listed = service.client.get(f"/runs/{run}/prompts").json()["prompts"]
            assert listed == [prompt]
            path = f"/runs/{run}/prompts/{prompt['id']}"
            if "redo" not in prompt["expects"]:
                problem(service.client.post(f"{path}/redo"), 409)
            problem(service.client.post(f"/runs/{run}/prompts/other/confirm"), 409)
            key = {"Idempotency-Key": prompt["id"]}
            assert service.client.post(f"{path}/confirm", headers=key).status_code == 200
            problem(service.client.post(f"{path}/confirm"), 409)
            assert service.client.post(f"{path}/confirm", headers=key).status_code == 200  # the answer again
            asked.append(prompt["text"])


def events_of(service: Served, run: str, after: str = "") -> list[tuple[int, str, Any]]:
    """Server-sent events, until the stream ends."""
    headers = {"Last-Event-ID": after} if after else {}
    out: list[tuple[int, str, Any]] = []
    with service.client.stream("GET", f"/runs/{run}/events", headers=headers) as stream:
        assert stream.headers["content-type"].startswith("text/event-stream")
        fields: dict[str, str] = {}
        for line in stream.iter_lines():
            if line:
                name, _, value = line.partition(": ")
                fields[name] = value
            elif "id" in fields:
                out.append((int(fields["id"]), fields["event"], json.loads(fields["data"])))
                fields = {}
    return out


def test_a_campaign_by_rest_and_the_same_by_command_line(tmp_path: Path) -> None:
    cell, campaign = one_smr(tmp_path)
    order = {"campaign": tomllib.loads(campaign.read_text("utf-8")), "name": "by REST"}
    with served(tmp_path / "record", "--cell", str(cell), "--simulate") as service:
        client = service.client
        assert client.get("/health").json()["simulated"] is True
        dry = client.post("/runs", json=order)
        assert (dry.status_code, dry.json()["total"]) == (202, READINGS)
        service.lease()
        key = {"Idempotency-Key": "campaign-of-today"}
        first = client.post("/runs", json=order | {"dry_run": False}, headers=key)
        again = client.post("/runs", json=order | {"dry_run": False}, headers=key)
        assert first.status_code == again.status_code == 202, first.text
        run = first.json()["id"]
        assert again.json()["id"] == run
        assert first.headers["location"] == f"/api/v1/runs/{run}"
        problem(client.post("/runs", json=order | {"dry_run": False, "name": "x"}, headers=key), 422)
        busy = problem(client.post("/runs", json=order | {"dry_run": False}), 409)
        assert busy["run_id"] == run
        assert client.get("/cell").json()["run_id"] == run
        asked = answer_prompts(service, run)
        assert asked == [f"Seat the SMR in {name} and press confirm." for name in NESTS_AND_TARGETS]
        shown = client.get(f"/runs/{run}").json()
        assert (shown["state_code"], shown["done"], shown["simulated"]) == (5, READINGS, True)
        assert client.get("/cell").json()["run_id"] is None

        events = events_of(service, run)
        assert [number for number, _, _ in events] == list(range(1, shown["version"] + 1))
        assert events_of(service, run, after=str(shown["version"] - 3)) == events[-3:]
        assert sum(kind == "reading" for _, kind, _ in events) == READINGS + 3
        assert events[0][2]["utc"].endswith("Z")

        dataset = client.post(f"/runs/{run}/dataset").json()
        assert (dataset["run_id"], dataset["readings"], dataset["simulated"]) == (run, READINGS, True)
        by_rest = client.get(f"/datasets/{dataset['id']}/data.csv").text
        job = client.post("/diagnoses", json={"dataset_id": dataset["id"]})
        assert job.status_code == 202
        done = service.until(f"/diagnoses/{job.json()['id']}", "succeeded", "failed")
        assert done["state"] == "succeeded", done
        labels = [effect["label"] for effect in done["result"]["effects"]]
        assert any("backlash:j4" in label for label in labels), labels
        report = client.get(f"/reports/{job.json()['id']}").text
        assert "SIMULATED" in report
        assert "http://" not in report.replace("http://www.w3.org", "")

    by_hand = by_command_line(tmp_path, cell, campaign)
    rest, hand = (list(csv.DictReader(io.StringIO(text))) for text in (by_rest, by_hand))
    same = ["set", "tool_target", *(f"j{k}_deg" for k in range(1, 7)), *(f"prev{k}_deg" for k in range(1, 7))]
    assert rest[0].keys() == hand[0].keys()
    assert [[row[name] for name in same] for row in rest] == [[row[name] for name in same] for row in hand]
    assert all(row["status"] == "ok" for row in rest + hand)


def by_command_line(folder: Path, cell: Path, campaign: Path) -> str:
    """Run the same campaign at a terminal with typed answers, and return its data set."""
    master, slave = pty.openpty()
    os.write(master, b"confirm\n" * len(NESTS_AND_TARGETS))
    record = folder / "by_hand"
    done = truepose(
        "campaign", "run", str(cell), str(campaign), "--record", str(record), "--simulate", "--json", "-",
        stdin=slave,
    )  # fmt: skip
    os.close(master)
    os.close(slave)
    assert done.returncode == 0, done.stderr
    document = json.loads(done.stdout)
    assert (document["state"], document["done"], document["error"]) == ("succeeded", READINGS, None)
    assert "Seat the SMR in T3 and press confirm." in done.stderr
    out = folder / "by_hand.csv"
    assert truepose("campaign", "export", str(record), str(out)).returncode == 0
    assert len(read_dataset(out)) == READINGS
    return out.read_text("utf-8")


def test_the_service_ends_paused_and_takes_its_simulators_along(tmp_path: Path) -> None:
    cell = cell_file(tmp_path, time_scale=100.0)
    campaign = tomllib.loads(campaign_file(tmp_path, warm_up_s=0.0).read_text("utf-8"))
    with served(tmp_path / "record", "--cell", str(cell), "--simulate") as service:
        run = service.begin(campaign)
        until(lambda: service.client.get(f"/runs/{run}").json()["done"] > 0)
        simulators = descendants_of(service.process.pid)
        assert simulators
        service.process.terminate()
        assert service.process.wait(PATIENCE_S) == 0
        until(lambda: not any(Path(f"/proc/{pid}").exists() for pid in simulators))
    status = truepose("campaign", "status", str(tmp_path / "record" / "runs" / run), "--json", "-")
    assert json.loads(status.stdout)["state"] == "paused"


def test_clients_that_wait_do_not_hold_a_stop_up_and_a_kill_takes_the_simulators_along(
    tmp_path: Path,
) -> None:
    """Fifty long polls are open, more than there are threads; a stop does not wait for them."""
    cell = cell_file(tmp_path, time_scale=1.0)
    campaign = tomllib.loads(campaign_file(tmp_path, warm_up_s=600.0).read_text("utf-8"))
    with served(tmp_path / "record", "--cell", str(cell), "--simulate") as service:
        run = service.begin(campaign)
        limits = httpx2.Limits(max_connections=60)
        with (
            ThreadPoolExecutor(50) as pool,
            httpx2.Client(headers=service.client.headers, timeout=PATIENCE_S, limits=limits) as client,
        ):
            url = f"{service.url}/api/v1/runs/{run}"
            version = client.get(url).json()["version"]
            waits = [
                pool.submit(client.get, url, params={"wait": 30, "after": version + 1}) for _ in range(50)
            ]
            assert service.client.post(f"/runs/{run}/stop").status_code == 202
            assert service.until(f"/runs/{run}", "stopped")["state_code"] == 7
            # Had it waited for their 30 s to be over, they would have come back with nothing new.
            assert all(wait.result().json()["version"] > version + 1 for wait in waits)
        simulators = descendants_of(service.process.pid)
        assert simulators
        service.process.kill()
        until(lambda: not any(Path(f"/proc/{pid}").exists() for pid in simulators))
