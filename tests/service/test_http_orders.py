"""The functions of the command line over HTTP.

Programs, exports, validations, selections, examinations and deletions. These would catch: an answer that differs from
the command's, a program whose bytes are not returned, and a deletion that leaves no trail or removes a thing in use.
"""

from __future__ import annotations

import base64
import json
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx2
import pytest
from fastapi.testclient import TestClient

from acquisition import read_cell
from service import job_folder
from service.cli import main
from service.http.access.roles import ServiceSettings, Tokens
from service.http.app import create_app
from service.results.cell.selected import SelectionResult
from service.results.judgement.validation import ValidationResult
from tests.drivers.waiting import PATIENCE_S
from tests.end_to_end.simulated import ROOT, cell_file
from tests.service.campaigns import write_data
from tests.service.test_http_support import Served, problem, served
from tests.service.test_openapi import unnamed

TOKENS = Tokens("only-for-the-tests-of-orders", "only-to-look-at-the-tests-of-orders")
EXAMPLE = ROOT / "examples" / "irb120_faro"
CAMPAIGN = tomllib.loads((EXAMPLE / "campaign.toml").read_text("utf-8"))
MODULE = b"""MODULE Here
  ! Gr\xfc\xdfe from Latin-1
  CONST jointtarget a := [[10,-20,30,0,45,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
  CONST jointtarget b := [[-10,10,20,10,40,20],[9E9,9E9,9E9,9E9,9E9,9E9]];
ENDMODULE
"""


class Here:
    """A service in this process with a data set and a model that was identified on it."""

    def __init__(self, client: TestClient, record: Path, data: Path) -> None:
        self.client, self.record, self.data = client, record, data
        files = {"csv": data.read_bytes(), "toml": data.with_suffix(".toml").read_bytes()}
        self.dataset = client.post("/datasets", files=files).json()["id"]
        self.model = self.done("/identifications", dataset_id=self.dataset)["id"]

    def done(self, path: str, **asked: Any) -> dict[str, Any]:
        """Request a job and wait for its end."""
        answer = self.client.post(path, json=asked)
        assert answer.status_code == 202, answer.text
        where = answer.headers["location"].removeprefix("/api/v1")
        while True:
            document = self.client.get(where, params={"wait": 30, "after": 2}).json()
            if document["state"] in ("succeeded", "failed"):
                return document


@pytest.fixture(scope="module")
def here(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Here]:
    folder = tmp_path_factory.mktemp("orders")
    settings = ServiceSettings(record=folder / "record", tokens=TOKENS, cell=read_cell(EXAMPLE / "cell.toml"))
    with TestClient(create_app(settings), base_url="http://127.0.0.1/api/v1") as client:
        client.headers |= {"Authorization": f"Bearer {TOKENS.operator}"}
        yield Here(client, folder / "record", write_data(folder, n=50))


def test_a_program_is_corrected_as_by_the_command_to_the_byte(here: Here, tmp_path: Path) -> None:
    answer = here.client.post(
        f"/models/{here.model}/programs", files={"program": ("../../etc/WELD.mod", MODULE)}
    )
    assert answer.status_code == 200, answer.text
    told = answer.json()
    assert (told["name"], told["corrected"]) == ("WELD.mod", 2)
    (tmp_path / "in.mod").write_bytes(MODULE)
    model = here.record / "identifications" / here.model / job_folder.MODEL
    assert main(["compensate", str(model), str(tmp_path / "in.mod"), str(tmp_path / "out.mod")]) == 0
    corrected = base64.b64decode(told["program_base64"])
    assert corrected == (tmp_path / "out.mod").read_bytes()
    assert b"Gr\xfc\xdfe" in corrected
    assert corrected != MODULE


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("a.exe", MODULE, "not a program"),
        ("a.mod", b"\0\1", "not a text"),
        ("a.ls", MODULE, "Fanuc"),
        ("", MODULE, ""),
        ("<script>.mod", b"MODULE x", ""),
    ],
)
def test_a_program_that_cannot_be_used_is_refused(here: Here, name: str, content: bytes, words: str) -> None:
    answer = here.client.post(f"/models/{here.model}/programs", files={"program": (name, content)})
    assert words in problem(answer, 422)["detail"]


def test_a_target_out_of_reach_is_refused_unless_it_is_kept(here: Here) -> None:
    far = MODULE.replace(b"[[10,-20,30,0,45,0]", b"[[10,-20,130,0,45,0]")
    path, files = f"/models/{here.model}/programs", {"program": ("a.mod", far)}
    refused = problem(here.client.post(path, files=files), 422)
    assert refused["code"] == 8111
    assert refused["targets"][0]["target"] == "a"
    kept = here.client.post(path, files=files, data={"keep_refused": "true"})
    assert (kept.json()["corrected"], kept.json()["refused"]) == (1, 1)


def test_targets_that_the_model_knows_too_little_are_refused(here: Here) -> None:
    path, files = f"/models/{here.model}/programs", {"program": ("a.mod", MODULE)}
    asked = {"most_uncertainty_mm": 1e-4}
    assert "more than 0.0001 mm" in problem(here.client.post(path, files=files, data=asked), 422)["detail"]
    assert here.client.post(path, files=files, data={"most_uncertainty_mm": 10.0}).json()["corrected"] == 2
    targets = [{"target_id": "A"} | {f"j{k}_deg": 10.0 * k for k in range(1, 7)}]
    table = f"/models/{here.model}/targets"
    refused = problem(here.client.post(table, json={"targets": targets, **asked}), 422)
    assert refused["targets"][0]["target"] == "A"
    assert here.client.post(table, json={"targets": targets}).json()["corrected"] == 1


def test_a_program_that_needs_no_pulses_refuses_words_for_them(here: Here) -> None:
    files = {"program": ("a.mod", MODULE)}
    answer = here.client.post(f"/models/{here.model}/programs", files=files, data={"pulses": "1,x"})
    assert problem(answer, 422)["key"] == "pulses"


@pytest.mark.parametrize("kind", ["urdf", "dh-csv", "dh-md", "mastering", "abb-frames", "abb-offsets"])
def test_a_model_is_exported_as_by_the_command(here: Here, tmp_path: Path, kind: str) -> None:
    told = here.client.get(f"/models/{here.model}/exports/{kind}").json()
    model = here.record / "identifications" / here.model / job_folder.MODEL
    out = tmp_path / "out"
    assert main(["export", str(model), str(out), "--as", kind, "--json", str(tmp_path / "out.json")]) == 0
    by_command = json.loads((tmp_path / "out.json").read_text("utf-8"))
    assert told["text"].replace(here.model, job_folder.MODEL) == out.read_text("utf-8")
    assert told["loss_mm"] == by_command["loss_mm"]
    assert told["as"] == kind


def test_every_export_says_in_one_call_what_it_leaves(here: Here) -> None:
    listed = here.client.get(f"/models/{here.model}/exports").json()
    kinds = {each["kind"]: each for each in listed["exports"]}
    for kind in ("urdf", "mastering"):
        one = here.client.get(f"/models/{here.model}/exports/{kind}").json()
        assert kinds[kind]["loss_mm"] == one["loss_mm"]
        assert kinds[kind]["left_mm"] == one["predicted_rms_mm"]
        assert (kinds[kind]["carries"], kinds[kind]["left_out"]) == (one["carries"], one["left_out"])
    assert kinds["ur-yaml"]["left_mm"] is None
    assert "ABB" in kinds["ur-yaml"]["refused"]
    problem(here.client.get("/models/x/exports"), 404)


def test_an_export_that_does_not_suit_is_refused(here: Here) -> None:
    assert "ABB" in problem(here.client.get(f"/models/{here.model}/exports/ur-yaml"), 422)["detail"]
    problem(here.client.get(f"/models/{here.model}/exports/doc"), 422)
    problem(here.client.get("/models/x/exports/urdf"), 404)


def test_a_model_is_validated_and_held_to_limits(here: Here) -> None:
    done = here.done("/validations", dataset_id=here.dataset, model_id=here.model, accept_rms_mm=0.001)
    result = done["result"]
    assert unnamed(ValidationResult.model_validate(result)) == set()
    nominal, judged = (each["position_mm"]["rms"] for each in result["judgements"])
    assert judged < 0.5 * nominal
    assert result["acceptance"]["verdict"] == "rejected"
    ask = {"dataset_id": here.dataset, "place": True}
    assert "model" in problem(here.client.post("/validations", json=ask), 422)["detail"]


def test_a_validation_compares_two_models_as_the_command_does(here: Here, tmp_path: Path) -> None:
    level = here.done("/identifications", dataset_id=here.dataset, level=1)["id"]
    point = [300.0, 0.0, 400.0]
    result = here.done(
        "/validations", dataset_id=here.dataset, model_id=here.model, compare_id=level, point=point
    )["result"]
    assert [each["model"] for each in result["judgements"]] == ["nominal robot, placed", "model", level]
    assert any(group["by"] == "distance from the point" for group in result["judgements"][1]["groups"])
    kept = here.record / "identifications"
    for own, name in ((here.model, "model"), (level, level)):
        (tmp_path / f"{name}.json").write_bytes((kept / own / job_folder.MODEL).read_bytes())
    models = ["--model", str(tmp_path / "model.json"), "--compare", str(tmp_path / f"{level}.json")]
    named = ["--point", *map(str, point), "--json", str(tmp_path / "v.json")]
    assert main(["validate", str(here.data), *models, *named]) == 0
    by_command = json.loads((tmp_path / "v.json").read_text("utf-8"))
    assert {**by_command, "data": None} == {**result, "data": None}
    asked = {"dataset_id": here.dataset, "model_id": here.model}
    problem(here.client.post("/validations", json={**asked, "compare_id": "gone"}), 404)
    problem(here.client.post("/validations", json={**asked, "point": [1.0, 2.0]}), 422)
    alone = {"dataset_id": here.dataset, "compare_id": level}
    assert "compare_id" in problem(here.client.post("/validations", json=alone), 422)["detail"]


def test_what_a_waiting_job_reads_is_not_deleted(here: Here) -> None:
    files = {"csv": here.data.read_bytes(), "toml": here.data.with_suffix(".toml").read_bytes()}
    other = here.client.post("/datasets", files=files).json()["id"]
    model = here.done("/identifications", dataset_id=here.dataset)["id"]
    asked = {"dataset_id": here.dataset}
    waiting = [
        here.client.post("/diagnoses", json=asked | {"carry_to": other}),
        here.client.post("/validations", json=asked | {"model_id": here.model, "compare_id": model}),
    ]
    gone = {"reason": "tidying up"}
    for path in (f"/results/{model}", f"/datasets/{other}"):
        assert problem(here.client.delete(path, params=gone), 409)["code"] == 8130
    for answer in waiting:
        where = answer.headers["location"].removeprefix("/api/v1")
        while (job := here.client.get(where, params={"wait": 30, "after": 2}).json())["version"] < 3:
            pass
        assert job["state"] == "succeeded", job
    for path in (f"/results/{model}", f"/datasets/{other}"):
        assert here.client.delete(path, params=gone).status_code == 200


def test_rows_that_only_judge_are_taken_and_judge(here: Here) -> None:
    head, *lines = here.data.read_text("utf-8").splitlines(keepends=True)
    at = head.split(",").index("set")
    text = head + "".join(line for line in lines if line.split(",")[at] == "validation")
    sent = here.client.post(
        "/datasets", files={"csv": text.encode(), "toml": here.data.with_suffix(".toml").read_bytes()}
    )
    own, told = sent.json()["id"], sent.json()
    assert (told["fit"], told["validation"]) == (0, 25)
    done = here.done("/validations", dataset_id=own, model_id=here.model)
    assert done["result"]["judgements"][1]["position_mm"]["n"] == 25
    page = here.client.get(done["report"].removeprefix("/api/v1"))
    assert (page.status_code, page.text.startswith("<!doctype html>")) == (200, True)
    refused = here.done("/identifications", dataset_id=own)
    assert (refused["state"], "no calibration rows" in refused["problem"]["detail"]) == ("failed", True)


def test_jobs_take_limits(here: Here) -> None:
    done = here.done("/identifications", dataset_id=here.dataset, accept_max_mm=1000.0)
    assert done["result"]["acceptance"]["verdict"] == "accepted"
    assert "Accepted" in here.client.get(f"/reports/{done['id']}").text


def test_zones_are_judged_one_by_one(here: Here) -> None:
    everywhere = {"low_mm": [-5000, -5000, -5000], "high_mm": [5000, 5000, 5000]}
    zones = [
        {"name": "all <b>of</b> it", **everywhere, "accept_max_mm": 1000.0},
        {"name": "strict", **everywhere, "accept_rms_mm": 1e-3},
        {"name": "door", "low_mm": [9000, 0, 0], "high_mm": [9001, 1, 1], "accept_rms_mm": 1.0},
    ]
    asked: dict[str, Any] = {"dataset_id": here.dataset, "accept_zones": zones}
    verdicts = [("all <b>of</b> it", "accepted"), ("strict", "rejected"), ("door", "not_decided")]
    for path, more in (("/identifications", {}), ("/validations", {"model_id": here.model})):
        kept = here.done(path, **asked, **more)["result"]["acceptance"]
        assert kept["verdict"] == "rejected"
        assert [(c["zone"], c["verdict"]) for c in kept["criteria"]] == verdicts
    assert "model" in problem(here.client.post("/validations", json=asked), 422)["detail"]


@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        ({"high_mm": [1, 0, 1]}, "high_mm"),
        ({"high_mm": [1, 1]}, "high_mm"),
        ({"accept_rms_mm": 0}, "accept_rms_mm"),
        ({"accept_rms": 1.0}, "accept_rms"),
        ({"name": " "}, "name"),
    ],
)
def test_zones_that_mean_nothing_are_refused(here: Here, wrong: dict[str, Any], told: str) -> None:
    zone = {"name": "a", "low_mm": [0, 0, 0], "high_mm": [1, 1, 1], "accept_rms_mm": 1.0}
    for zones in ([zone | wrong], [zone, zone]):
        ask = {"dataset_id": here.dataset, "accept_zones": zones}
        detail = json.dumps(problem(here.client.post("/identifications", json=ask), 422))
        assert (told if zones[0] != zone else "two zones") in detail


def test_poses_are_selected_in_the_cell(here: Here) -> None:
    result = here.done("/selections", count=30, candidates=120)["result"]
    assert unnamed(SelectionResult.model_validate(result)) == set()
    assert len(result["poses_deg"]) == 30
    block = {"kind": "poses", "select": "list", "joints_deg": result["poses_deg"]}
    sent = {"campaign": {"format": "truepose-campaign/1", "block": [block]}}
    checked = here.client.post("/runs", json=sent).json()
    assert checked["total"] == 90  # three targets a pose
    failed = here.done("/selections", targets=["T9"])
    assert "T9" in failed["problem"]["detail"]


def deleted(answer: httpx2.Response) -> dict[str, Any]:
    assert answer.status_code == 200, answer.text
    return answer.json()


def test_what_is_deleted_is_gone_and_said(here: Here) -> None:
    files = {"csv": here.data.read_bytes(), "toml": here.data.with_suffix(".toml").read_bytes()}
    dataset = here.client.post("/datasets", files=files, data={"name": "tuesday"}).json()
    result = here.done("/identifications", dataset_id=dataset["id"])["id"]
    run = here.client.post("/runs", json={"campaign": CAMPAIGN}).json()["id"]
    campaign = here.client.post("/campaigns", json={"campaign": CAMPAIGN}).json()["id"]
    because = {"reason": "a trial = with the <wrong> tool"}
    for path, again in (
        (f"/results/{result}", f"/models/{result}"),
        (f"/datasets/{dataset['id']}", f"/datasets/{dataset['id']}"),
        (f"/runs/{run}", f"/runs/{run}"),
        (f"/campaigns/{campaign}", f"/campaigns/{campaign}"),
    ):
        problem(here.client.delete(path), 422)  # for no reason
        problem(here.client.delete(path, params={"reason": " "}), 422)
        line = deleted(here.client.delete(path, params=because))
        assert line["id"] in path
        assert line["reason"] == because["reason"]
        problem(here.client.get(again), 404)
        problem(here.client.delete(path, params=because), 404)
    trail = here.client.get("/deletions").json()["deletions"]
    assert [each["kind"] for each in trail[-4:]] == ["identification", "dataset", "run", "campaign"]
    assert trail[-3] | {"name": "tuesday", "sha256": dataset["sha256"]} == trail[-3]
    assert not [p for p in here.record.rglob("*") if result in p.name or dataset["id"] in p.name]


def test_nobody_deletes_with_a_trick_or_as_a_viewer(here: Here) -> None:
    because = {"reason": "x"}
    for name in ("..", "%2e%2e", "..%2f..%2frecord", ".", "a%00b", "x" * 300):
        for kind in ("runs", "datasets", "campaigns", "results"):
            assert here.client.delete(f"/{kind}/{name}", params=because).status_code in (404, 405)
    viewer = {"Authorization": f"Bearer {TOKENS.viewer}"}
    answer = here.client.delete(f"/datasets/{here.dataset}", params=because, headers=viewer)
    assert problem(answer, 403)["code"] == 8113
    assert here.client.get(f"/datasets/{here.dataset}").status_code == 200


def test_without_a_cell_there_is_nothing_to_examine(tmp_path: Path) -> None:
    app = create_app(ServiceSettings(record=tmp_path, tokens=TOKENS))
    with TestClient(app, base_url="http://127.0.0.1/api/v1") as client:
        client.headers |= {"Authorization": f"Bearer {TOKENS.operator}"}
        for path in ("/cell/examination", "/selections"):
            assert problem(client.post(path, json={}), 404)["code"] == 8108


@pytest.fixture
def service(tmp_path: Path) -> Iterator[Served]:
    with served(
        tmp_path / "record", "--cell", str(cell_file(tmp_path, time_scale=40.0)), "--simulate"
    ) as running:
        yield running


def test_a_running_run_is_neither_deleted_nor_disturbed(service: Served, tmp_path: Path) -> None:
    told = service.client.post("/cell/examination").json()
    assert told["simulated"] is True
    assert {each["device"] for each in told["findings"]} == {"robot", "instrument", "computer"}
    service.lease()
    run = service.client.post("/runs", json={"campaign": CAMPAIGN, "dry_run": False}).json()["id"]
    because = {"reason": "in the way"}
    assert problem(service.client.delete(f"/runs/{run}", params=because), 409)["code"] == 8105
    assert problem(service.client.post("/cell/examination"), 409)["run_id"] == run
    service.client.post(f"/runs/{run}/stop")
    service.until(f"/runs/{run}", "stopped", seconds=PATIENCE_S)
    line = deleted(service.client.delete(f"/runs/{run}", params=because))
    assert line["by"] == "anna"
    events = (tmp_path / "record" / line["kept"]).read_text("utf-8").splitlines()
    assert json.loads(events[0])["kind"] == "created"
    assert run not in {each["id"] for each in service.client.get("/runs").json()["runs"]}
    again = service.client.post("/runs", json={"campaign": CAMPAIGN, "dry_run": False})  # the robot is free
    assert again.status_code == 202
