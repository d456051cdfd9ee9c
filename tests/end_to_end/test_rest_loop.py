"""The closed loop as one resource, over the sockets of a simulated cell.

It is paused, resumed by another client, completed, and stopped. These would catch: a loop that forgets its knowledge
during a pause, runs that cannot be seen or controlled, and a robot lent to two. They would also catch a motion without
a lease, a loop begun twice for one key, and results without an owner.
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from acquisition.loop import rehearsal
from tests.drivers.waiting import PATIENCE_S, until
from tests.service.test_http_support import Served, problem, served

SCALE = 400.0
EFFECT = "backlash:j4"


@pytest.fixture(scope="module")
def order(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """A cell with an effect hidden in it, and the body that starts a loop there."""
    folder = tmp_path_factory.mktemp("cell")
    rehearsal.write_files(folder, 3, EFFECT, SCALE, calibration=34, validation=8)
    campaign = tomllib.loads((folder / "campaign.toml").read_text("utf-8"))
    return folder / "cell.toml", {"campaign": campaign, "poses": 5, "name": "night", "dry_run": False}


@pytest.fixture
def service(order: tuple[Path, dict[str, Any]], tmp_path: Path) -> Iterator[Served]:
    with served(tmp_path / "record", "--cell", str(order[0]), "--simulate") as running:
        yield running


def get(service: Served, path: str) -> dict[str, Any]:
    answer = service.client.get(path)
    assert answer.status_code == 200, answer.text
    return answer.json()


def test_a_loop_from_the_first_pose_to_the_report(
    service: Served, order: tuple[Path, dict[str, Any]]
) -> None:
    client, body = service.client, order[1]
    dry = client.post("/loops", json={k: v for k, v in body.items() if k != "dry_run"})
    assert (dry.status_code, dry.json()["dry_run"], dry.json()["runs"]) == (202, True, [])
    assert "nothing has moved" in dry.json()["reason"]
    assert problem(client.post("/loops", json=body), 409)["code"] == 8101
    lease = {"Lease-Id": service.lease("anna")["lease_id"]}
    key = {"Idempotency-Key": "loop-of-today"}
    first, again = (client.post("/loops", json=body, headers=lease | key) for _ in range(2))
    assert first.status_code == again.status_code == 202, first.text
    loop = first.json()["id"]
    assert again.json()["id"] == loop
    path = f"/loops/{loop}"
    assert first.headers["location"] == f"/api/v1{path}"
    busy = problem(client.post("/runs", json={"campaign": body["campaign"], "dry_run": False}), 409)
    assert busy["loop_id"] == loop

    until(lambda: (get(service, path)["run"] or {}).get("done", 0) > 3)
    run = get(service, path)["run_id"]
    assert run == f"{loop}-campaign1"
    assert get(service, "/cell")["loop_id"] == loop
    assert client.post(f"{path}/pause").status_code == 202
    paused = service.until(path, "paused")
    assert (paused["reason"], paused["run"]["state"], paused["run_id"]) == (
        "Paused on request.",
        "paused",
        run,
    )
    assert problem(client.post(f"/runs/{run}/resume"), 409)["loop_id"] == loop  # resumed with its loop
    assert client.delete("/cell/lease", headers=lease).status_code == 204
    assert problem(client.post(f"{path}/resume"), 409)["code"] == 8101
    service.lease("bert")
    assert client.post(f"{path}/resume").status_code == 202
    done = service.until(path, "succeeded", "failed", "stopped")
    assert done["state"] == "succeeded", done
    problem(client.post(f"{path}/resume"), 409)
    problem(client.post(f"{path}/pause"), 409)

    assert done["runs"] == [f"{loop}-campaign1", f"{loop}-campaign2"]
    assert [get(service, f"/runs/{each}")["state"] for each in done["runs"]] == ["succeeded"] * 2
    result = done["result"]
    assert EFFECT in [effect["label"] for effect in result["effects"]]
    verified = result["verification"]
    assert verified["error_verified_mm"]["n"] == 15
    assert verified["error_verified_mm"]["rms"] < 0.1 * verified["error_uncorrected_mm"]["rms"]
    assert any("campaign 2" in step for step in done["steps"])
    dataset = get(service, f"/datasets/{done['dataset_id']}")
    assert (dataset["simulated"], dataset["name"]) == (True, "night")
    assert EFFECT in client.get(f"/reports/{loop}").text
    target = {"target_id": "a"} | {f"j{k}_deg": 20.0 for k in range(1, 7)}
    corrected = client.post(f"/models/{loop}/targets", json={"targets": [target]}).json()
    assert 0.0 < corrected["largest_move_mm"] < 20.0
    assert get(service, "/cell")["loop_id"] is None
    assert [each["id"] for each in get(service, "/loops")["loops"]] == [loop, dry.json()["id"]]


def test_a_holder_who_falls_silent_and_a_stop(
    service: Served, order: tuple[Path, dict[str, Any]], tmp_path: Path
) -> None:
    client = service.client
    service.lease("anna")
    path = f"/loops/{client.post('/loops', json=order[1]).json()['id']}"
    service.lease("anna", seconds=2.0)  # the last sign of life; planning must not take longer than a lease
    paused = service.until(path, "paused")
    assert paused["reason"] == "anna was not heard of for 2 s."
    service.lease("bert")
    assert client.post(f"{path}/resume").status_code == 202
    until(lambda: (get(service, path)["run"] or {}).get("state") == "running")
    body = {"holder": "carl", "reason": "bert is wanted elsewhere", "seconds": 300.0}
    carl = {"Lease-Id": client.post("/cell/lease/takeover", json=body).json()["lease_id"]}
    taken = "carl has taken the motion lease over from bert: bert is wanted elsewhere"
    assert service.until(path, "paused")["reason"] == taken
    problem(client.post(f"{path}/resume"), 409)  # with the secret of bert
    assert client.post(f"{path}/resume", headers=carl).status_code == 202
    until(lambda: (get(service, path)["run"] or {}).get("state") == "running")
    stopped = client.post(f"{path}/stop")
    assert (stopped.status_code, stopped.json()["problems"]) == (202, [])
    ended = service.until(path, "stopped", "failed", "succeeded")
    assert (ended["state"], ended["reason"]) == ("stopped", "Stopped on request.")
    problem(client.post(f"{path}/stop"), 409)
    (run,) = ended["runs"]
    assert get(service, f"/runs/{run}")["state"] == "stopped"
    until(lambda: get(service, "/cell")["loop_id"] is None)
    assert (
        client.post(f"/runs/{run}/resume", headers=carl).status_code == 202
    )  # its readings are whole, and it can go on
    service.until(f"/runs/{run}", "running")
    service.process.terminate()
    assert service.process.wait(PATIENCE_S) == 0
