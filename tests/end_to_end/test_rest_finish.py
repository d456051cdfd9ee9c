"""A run that is finished early by REST, over the sockets of a simulated cell.

These would catch: an end that needs more than a stop does, that a viewer may order, that a prompt or a second client
hinders, or that a kill of the service undoes; and readings that cannot be used afterwards.
"""

from __future__ import annotations

import signal
import tomllib
from pathlib import Path

import httpx2

from tests.drivers.waiting import PATIENCE_S, until
from tests.end_to_end.simulated import campaign_file, cell_file
from tests.service.test_http_support import Served, problem, served


def confirm(service: Served, run: str, target: str) -> None:
    def answered() -> bool:
        prompt = service.client.get(f"/runs/{run}").json()["prompt"]
        if prompt is None or target not in prompt["text"]:
            return False
        return service.client.post(f"/runs/{run}/prompts/{prompt['id']}/confirm").status_code == 200

    until(answered)


def test_it_ends_with_the_readings_that_it_has(tmp_path: Path) -> None:
    cell = cell_file(tmp_path, time_scale=60.0, one_smr=True)
    file = campaign_file(
        tmp_path, calibration=24, validation=2, warm_up_s=0.0, settle_s=0.5, samples=5, reference_every=0
    )
    order = {"campaign": tomllib.loads(file.read_text("utf-8")), "dry_run": False}
    record, at = tmp_path / "record", ("--cell", str(cell), "--simulate")
    with served(record, *at) as service:
        service.lease()
        run = service.client.post("/runs", json=order).json()["id"]
        path = f"/runs/{run}"
        assert problem(service.client.post(f"{path}/finish"), 409)["code"] == 3104
        for target in ("N1", "N2", "N3", "T1"):
            confirm(service, run, target)
        until(lambda: service.client.get(path).json()["done"] > 2)
        viewer = {"Authorization": f"Bearer {service.hello['viewer_token']}"}
        assert problem(service.client.post(f"{path}/finish", headers=viewer), 403)["code"] == 8113
        others = httpx2.Client(base_url=f"{service.url}/api/v1", timeout=PATIENCE_S)
        others.headers["Authorization"] = service.client.headers["Authorization"]  # without a lease
        with others:
            both = [
                client.post(f"{path}/finish", json={"reason": "enough"})
                for client in (service.client, others)
            ]
        assert [each.status_code for each in both] == [202, 202]
        ended = service.until(path, "succeeded")
        early = ended["finished_early"]
        assert (early["by"], early["reason"]) == ("anna", "enough")
        assert early["measured"] == ended["done"] < early["total"] == ended["total"]
        assert f"{early['measured']} of {early['total']}" in ended["reason"]
        assert problem(service.client.post(f"{path}/resume"), 409)["code"] == 3104
        data = service.client.post(f"{path}/dataset")
        assert (data.status_code, data.json()["readings"]) == (201, early["measured"])

        second = service.client.post("/runs", json=order).json()["id"]
        for target in ("N1", "N2", "N3", "T1"):
            confirm(service, second, target)
        until(
            lambda: "T2" in ((service.client.get(f"/runs/{second}").json()["prompt"] or {}).get("text") or "")
        )
        answer = service.client.post(f"/runs/{second}/finish")  # in a prompt
        assert answer.status_code == 202, answer.text
        assert service.until(f"/runs/{second}", "succeeded")["prompt"] is None
        service.process.send_signal(signal.SIGKILL)
        service.process.wait()
    with served(record, *at) as again:
        for each in (run, second):
            assert again.client.get(f"/runs/{each}").json()["state"] == "succeeded"
            assert again.client.post(f"/runs/{each}/finish").status_code == 202  # it is already
        assert again.client.get(path).json()["finished_early"] == early
        assert again.client.get("/cell").json()["run_id"] is None
