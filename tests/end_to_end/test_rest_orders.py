"""Orders by REST during a run.

Reasons with answers, a new station of the instrument, runs merged, the event log.
"""

from __future__ import annotations

import csv
import io
import json
import tomllib
from pathlib import Path
from typing import Any

from tests.drivers.waiting import until
from tests.end_to_end.simulated import campaign_file, cell_file
from tests.service.test_http_support import Served, problem, served

SET_UP = "Set up the instrument where it is to be, then confirm: the nests are measured there."


def order(folder: Path, name: str = "") -> dict[str, Any]:
    file = campaign_file(
        folder, calibration=6, validation=2, warm_up_s=0.0, settle_s=0.0, samples=1, reference_every=0
    )
    return {"campaign": tomllib.loads(file.read_text("utf-8")), "dry_run": False, "name": name}


def start(service: Served, body: dict[str, Any]) -> str:
    answer = service.client.post("/runs", json=body)
    assert answer.status_code == 202, answer.text
    return answer.json()["id"]


def asked(service: Served, run: str, text: str, before: str = "") -> str:
    """The path of the prompt that asks this, after the one `before`."""

    found: list[str] = []

    def there() -> bool:
        prompt = service.client.get(f"/runs/{run}").json()["prompt"]
        if prompt is not None and prompt["text"] == text and not before.endswith(prompt["id"]):
            found.append(prompt["id"])
        return bool(found)

    until(there)
    return f"/runs/{run}/prompts/{found[0]}"


def events(service: Served, run: str) -> list[dict[str, Any]]:
    answer = service.client.get(f"/runs/{run}/events.jsonl")
    assert answer.headers["content-type"].startswith("application/x-ndjson")
    return [json.loads(line) for line in answer.text.splitlines()]


def test_answers_and_stations_keep_their_reasons(tmp_path: Path) -> None:
    cell = cell_file(tmp_path, time_scale=500.0, one_smr=True)
    with served(tmp_path / "record", "--cell", str(cell), "--simulate") as service:
        client = service.client
        service.lease()
        run = start(service, order(tmp_path))
        for name in ("N1", "N2", "N3"):
            assert client.post(f"{asked(service, run, f'Seat the SMR in {name} and press confirm.')}/confirm")
        path = asked(service, run, "Seat the SMR in T1 and press confirm.")
        problem(client.post(f"{path}/skip", json={"reason": 3}), 422)
        problem(client.post(f"{path}/skip", json={"reason": "x" * 501}), 422)
        key = {"Idempotency-Key": "skip-1"}
        body = {"reason": "the nest is bent"}
        first, again = (client.post(f"{path}/skip", json=body, headers=key) for _ in range(2))
        assert first.status_code == again.status_code == 200, first.text
        problem(client.post(f"{path}/skip", json={"reason": "other"}, headers=key), 422)

        path = asked(service, run, "Seat the SMR in T1 and press confirm.", before=path)
        moved = {"reason": "a forklift needs the place"}
        headers = {"Idempotency-Key": "move-1", "Content-Type": "application/json"}
        for _ in range(2):
            answer = client.post(f"/runs/{run}/restation", content=json.dumps(moved), headers=headers)
            assert answer.status_code == 202, answer.text
        client.post(f"{path}/confirm", headers={"Content-Type": "application/json"})  # a body may be left out
        client.post(f"{asked(service, run, SET_UP)}/confirm")
        asked(service, run, "Seat the SMR in N1 and press confirm.")
        seen = events(service, run)
        (skipped,) = [each["data"] for each in seen if each["kind"] == "skipped"]
        assert skipped["reason"] == "the nest is bent"
        (answered,) = [each["data"] for each in seen if each["data"].get("answer") == "skip"]
        assert (answered["by"], answered["reason"]) == ("anna", "the nest is bent")
        (station,) = [each["data"] for each in seen if each["kind"] == "restation"]
        assert station["reason"] == "a forklift needs the place"
        assert "anna" in station["by"]
        assert [each["id"] for each in seen] == list(range(1, len(seen) + 1))
        client.post(f"/runs/{run}/stop")


def test_two_runs_become_one_data_set(tmp_path: Path) -> None:
    cell = cell_file(tmp_path, time_scale=500.0)
    with served(tmp_path / "record", "--cell", str(cell), "--simulate") as service:
        client = service.client
        service.lease()
        runs = []
        for name in ("first", "follow-up"):
            runs.append(start(service, order(tmp_path, name)))
            service.until(f"/runs/{runs[-1]}", "succeeded")
        dry = client.post("/runs", json=order(tmp_path) | {"dry_run": True}).json()["id"]
        key = {"Idempotency-Key": "both"}
        path, body = f"/runs/{runs[0]}/dataset", {"with": [runs[1]], "name": "both"}
        both, again = (client.post(path, json=body, headers=key) for _ in range(2))
        assert (both.status_code, again.json()["id"]) == (201, both.json()["id"]), both.text
        shown = both.json()
        assert (shown["readings"], shown["fit"], shown["validation"]) == (48, 36, 12)
        assert (shown["name"], shown["run_id"], shown["simulated"]) == ("both", runs[0], True)
        table = client.get(f"/datasets/{shown['id']}/data.csv").text
        rows = list(csv.DictReader(io.StringIO(table)))
        assert [row["reading_id"].startswith("2-") for row in rows] == [False] * 24 + [True] * 24
        assert float(rows[24]["t_s"]) > float(rows[23]["t_s"])
        alone = client.post(path)
        assert (alone.status_code, alone.json()["readings"]) == (201, 24)
        problem(client.post(path, json={"with": ["nothing"]}), 404)
        assert problem(client.post(path, json={"with": [dry]}), 409)["code"] == 8103
        problem(client.post(path, json={"later": [runs[1]]}), 422)
        assert problem(client.post(f"/runs/{runs[0]}/restation"), 409)["code"] == 3104
