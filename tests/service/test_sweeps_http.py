"""`POST /sweeps`: the sweeps of a data set, analysed by a worker of the service.

This would catch: a job that loses the level, a result other than that of the command, a job without its picture, and a
data set without sweeps that is not refused by name.
"""

from __future__ import annotations

import json
from pathlib import Path

from service.cli import main
from service.results.models.swept import SweepsResult
from tests.calib.campaigns import write_files
from tests.calib.cells import Cell
from tests.calib.test_sweeps import cell
from tests.service.test_http_support import Served, problem, served
from tests.service.test_openapi import unnamed


def kept(service: Served, data: Path) -> str:
    """Upload a data set and return its id."""
    files = {kind: data.with_suffix(f".{kind}").read_bytes() for kind in ("csv", "toml")}
    return service.client.post("/datasets", files=files).json()["id"]


def test_the_result_is_that_of_the_command(tmp_path: Path) -> None:
    made, plain = cell(), Cell()
    plain.measure("p", 40, validation=0)
    folders = [tmp_path / name for name in ("sweeps", "plain")]
    for folder in folders:
        folder.mkdir()
    data = write_files(folders[0], made.rows, made.header())
    assert main(["sweeps", str(data), "--level", "1", "--json", str(tmp_path / "s.json")]) == 0
    with served(tmp_path / "record") as service:
        asked = {"dataset_id": kept(service, data), "level": 1}
        answer = service.client.post("/sweeps", json=asked)
        assert answer.status_code == 202, answer.text
        done = service.until(f"/sweeps/{answer.json()['id']}", "succeeded", "failed")
        expected = json.loads((tmp_path / "s.json").read_text("utf-8"))
        assert unnamed(SweepsResult.model_validate(done["result"])) == set()
        assert done["result"]["sweeps"] == expected["sweeps"]
        picture = service.client.get(f"/sweeps/{done['id']}/picture.svg")
        assert picture.headers["content-type"].startswith("image/svg+xml")
        assert picture.text.count("tangential error, deg") == 3
        problem(service.client.post("/sweeps", json={**asked, "level": 4}), 422)
        problem(service.client.post("/sweeps", json={"dataset_id": "nobody"}), 404)
        none = kept(service, write_files(folders[1], plain.rows, plain.header()))
        failed = service.client.post("/sweeps", json={"dataset_id": none}).json()
        said = service.until(f"/sweeps/{failed['id']}", "succeeded", "failed")["problem"]["detail"]
        assert "holds no sweep" in said
