"""A watch by HTTP from the calibration to the updated model, with a tool that was bumped.

It works over the wires of a simulated cell. These would catch: a plan whose campaign the service does not drive, a run
that cannot be judged, and an update without an owner. They would also catch a thermal update that takes a bump for
warmth, and readings judged by the model of another robot. A run, a diagnosis or a watch must enter the history by
itself.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from calib.effects.thermal import warm_up
from calib.saved import load_model, save_update
from calib.saved.model_checks import content_hash
from tests.end_to_end.test_watch import BUMP, SEED, cell_of
from tests.service.campaigns import write_data
from tests.service.histories import sign
from tests.service.test_http_support import Served, served

SERIAL = "120-500000"  # of every robot that is simulated


def kept(service: Served, content: bytes) -> str:
    """The hash of a document that the history keeps."""
    answer = service.client.post("/documents", files={"file": ("m.json", content)})
    assert answer.status_code == 201, answer.text
    return answer.json()["added"][0]["document"]


def that_warms_up(content: bytes, file: Path) -> bytes:
    """A model which says, too, that the arm grows while it warms up, and not yet by how much."""
    file.write_bytes(content)
    saved, unsure = load_model(file), (100e-6) ** 2
    model = saved.model.append(warm_up(saved.model.robot, 1500.0))
    covariance = np.pad(saved.covariance, (0, 1))
    covariance[-1, -1] = unsure
    save_update(file, file, model, np.append(saved.estimate, 0.0), covariance, {})
    return file.read_bytes()


def of_another_robot(content: bytes) -> bytes:
    document = json.loads(content)
    for device in document["device"]:
        device["serial"] = "120-9"
    return json.dumps(document | {"content_sha256": content_hash(document)}).encode()


def test_a_bumped_tool_from_the_plan_to_the_updated_model_and_the_history(tmp_path: Path) -> None:
    bump = "[" + ", ".join(map(str, BUMP)) + "]"
    planted = f'effects = ["none"]\nmisplaced_mm = {{ T1 = {bump}, T2 = {bump}, T3 = {bump} }}'
    cell, data = cell_of(tmp_path, "bumped", planted), write_data(tmp_path, seed=SEED, effects=(), n=60)
    header = data.with_suffix(".toml")
    sign(header, SERIAL, "2026-03-02")
    header.write_text("simulated = true\n" + header.read_text("utf-8"), "utf-8")
    options = ("--cell", str(cell), "--simulate", "--permitted", "0.3")
    with served(tmp_path / "record", *options) as service:

        def job(path: str, **body: object) -> dict[str, Any]:
            answer = service.client.post(path, json=body)
            assert answer.status_code == 202, answer.text
            return service.until(f"{path}/{answer.json()['id']}", "succeeded", "failed")

        files = {"csv": data.read_bytes(), "toml": header.read_bytes()}
        calibrated = job("/diagnoses", dataset_id=service.client.post("/datasets", files=files).json()["id"])
        few = {"poses": 5, "candidates": 40, "visits": 1, "readings": 2, "targets": ["T1", "T2"]}
        plan = job("/watch-plans", model_id=calibrated["id"], **few)["result"]
        assert plan["campaign"]["robot"]["serial"] == SERIAL  # another one is refused before the first motion
        run = service.begin(plan["campaign"])
        assert (
            service.until(f"/runs/{run}", "succeeded", "failed", "paused")["done"] == plan["readings"] == 20
        )

        watched = job("/watches", model_id=calibrated["id"], run_id=run)
        told = watched["result"]
        assert (told["verdict"], [each["label"] for each in told["causes"]]) == ("changed", ["tool_shift"])
        size = told["causes"][0]["size"]
        assert size["value"] == pytest.approx(np.linalg.norm(BUMP), abs=size["u"])
        assert service.client.get(f"/models/{watched['id']}").json()["updates"][0]["cause"] == "tool_shift"
        again = job("/watches", model_id=watched["id"], run_id=run, average=False)
        assert again["result"]["verdict"] == "unchanged"  # by the updated model

        struck, warm = (
            that_warms_up(service.client.get(f"/models/{each['id']}").content, tmp_path / "warm.json")
            for each in (calibrated, watched)
        )
        refused = job("/upkeeps", model_document=kept(service, struck), run_id=run, running_s=900.0)["result"]
        assert (refused["thermal"], refused["exit_code"], refused["updated_model"]) == (False, 6, None)
        assert "tool_shift" in refused["instead"]
        upkept = job("/upkeeps", model_document=kept(service, warm), run_id=run, running_s=900.0)
        (grown,) = upkept["result"]["parameters"]
        assert (upkept["result"]["thermal"], grown["name"]) == (True, "warm_up.expansion")
        assert grown["value"] == pytest.approx(0.0, abs=1.5 * grown["u"])  # ppm: simulated arms stay cold
        assert service.client.get(f"/models/{upkept['id']}").json()["updates"][-1]["cause"] == "thermal"
        other = job("/watches", model_document=kept(service, of_another_robot(warm)), run_id=run)
        assert f"the robot {SERIAL}; the baseline is of the robot 120-9" in other["problem"]["detail"]

        robot = service.client.get(f"/robots/{SERIAL}").json()
        entered = {(each["kind"], each["here"]["id"]) for each in robot["history"] if each["here"]}
        assert entered >= {
            ("diagnosis", calibrated["id"]),
            ("model", calibrated["id"]),
            ("campaign", run),
            ("dataset", run),
            ("watch", watched["id"]),
            ("model", watched["id"]),
            ("thermal", upkept["id"]),
        }
        assert service.client.get("/robots").json()["not_kept"] == []
