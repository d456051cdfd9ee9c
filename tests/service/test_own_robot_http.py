"""A service whose cell has a custom robot file: its jobs have that file in every process.

These would catch: a job that refuses such a robot, or leaves the cell out where a diagnosis proposes what to measure.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from fastapi.testclient import TestClient

from acquisition import read_cell
from calib.data import read_dataset
from calib.fit import identify
from calib.saved import save_model
from service import job_folder
from service.http.access.roles import ServiceSettings, Tokens
from service.http.app import create_app
from tests.service.campaigns import write_data
from tests.service.own_robots import NAME, own_cell, with_own_robot


def test_jobs_of_a_cell_with_a_robot_file(tmp_path: Path) -> None:
    path = own_cell(tmp_path / "cell", "irb120_faro", "abb-irb120")
    data, cell = with_own_robot(write_data(tmp_path, effects=(), n=30), path), read_cell(path)
    path.with_name("own.toml").unlink()  # nothing but the cell's text goes to a job
    record, tokens = tmp_path / "record", Tokens("operator", "viewer")
    model = record / "identifications" / "of-before"
    model.mkdir(parents=True)
    save_model(model / job_folder.MODEL, identify(read_dataset(data)))
    (model / job_folder.RESULT).write_text("{}")
    app = create_app(ServiceSettings(record=record, tokens=tokens, cell=cell))
    operator = {"Authorization": f"Bearer {tokens.operator}"}
    with TestClient(app, base_url="http://127.0.0.1/api/v1", headers=operator) as client:

        def done(where: str, **asked: object) -> dict[str, Any]:
            job = client.post(where, json=asked).json()
            while job["state"] not in ("succeeded", "failed"):
                job = client.get(f"{where}/{job['id']}", params={"wait": 30, "after": 2}).json()
            assert job["problem"] is None
            return job["result"]

        few = {"poses": 4, "candidates": 20, "visits": 1, "readings": 1, "targets": ["T1"]}
        planned = done("/watch-plans", model_id=model.name, **few)
        assert client.post("/runs", json={"campaign": planned["campaign"]}).json()["total"] == 4
        assert done("/selections", count=30, candidates=60)["robot"] == NAME
        files = {"csv": data.read_bytes(), "toml": data.with_suffix(".toml").read_bytes()}
        dataset = client.post("/datasets", files=files).json()["id"]
        own = client.post("/diagnoses", json={"dataset_id": dataset}).json()["id"]
        job = json.loads((record / "diagnoses" / own / job_folder.JOB).read_text("utf-8"))
        assert job["cell"] == cell.source  # test_job.py follows it from here
