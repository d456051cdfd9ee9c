"""The history of robots and watches over HTTP.

These would catch: an unknown robot, parameter or document that is not answered with a problem, two contents for one
thing of which one is lost, and a verdict on another robot. They would also catch an unreachable store that loses
results or stops the rest of the service, and a result that no schema describes.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx2
import pytest
from fastapi.testclient import TestClient

from calib import identify, read_dataset, save_model, watch
from fleet.store import dataset_texts
from service.http.access.roles import ServiceSettings, Tokens
from service.http.app import create_app
from service.http.wire.bodies.watches import RATE, WatchPlanResult
from service.results.robot_answers import RobotResponse, Robots, Trends
from service.results.watch_answers import WatchResult
from tests.drivers.nobody import nobody_listens
from tests.service.campaigns import edit_rows, edit_text, write_data
from tests.service.histories import sign
from tests.service.own_robots import NAME, own_cell, with_own_robot
from tests.service.test_history import SERIAL, model_of, watch_of
from tests.service.test_http_support import Served, problem, served
from tests.service.test_openapi import unnamed
from tests.service.test_watch import CELL, moved

MUSEUM = Path(__file__).parents[1] / "museum" / "version1" / "model.json"
OTHER = "120-9999"


def document(table: dict[str, Any], day: str, serial: str = SERIAL, robot: str = "abb-irb120") -> bytes:
    """A document as a command writes it, as short as it may be."""
    device = [{"role": "robot", "model": "IRB 120", "serial": serial}]
    about = {"robot": robot, "device": device, "measured": {"began": f"{day} 09:15 UTC", "ended": ""}}
    return json.dumps(table | about).encode()


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write thirty readings of a robot, with the model of its calibration in the same folder."""
    folder = tmp_path_factory.mktemp("watched")
    whole = write_data(folder, effects=(), n=90)
    sign(whole.with_suffix(".toml"), SERIAL, "2026-03-02")
    save_model(folder / "model.json", identify(read_dataset(whole)))
    edit_rows(whole, lambda rows: rows.__delitem__(slice(30, None)))
    sign(whole.with_suffix(".toml"), SERIAL, "2026-04-01")
    return whole


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    record = tmp_path_factory.mktemp("robots") / "record"
    with served(record, "--cell", str(CELL), "--permitted", "0.3") as running:
        yield running


def put(service: Served, content: bytes, serial: str = "") -> dict[str, Any]:
    answer = service.client.post("/documents", files={"file": ("d.json", content)}, data={"serial": serial})
    assert answer.status_code == 201, answer.text
    return answer.json()


def upload(service: Served, csv: Path) -> str:
    files = {"csv": csv.read_bytes(), "toml": csv.with_suffix(".toml").read_bytes()}
    return service.client.post("/datasets", files=files).json()["id"]


def test_what_is_sent_is_listed_and_what_contradicts_is_told(service: Served) -> None:
    first = put(service, document(model_of(1.5), "2026-01-05"))
    robot = first["robot_id"]
    assert put(service, document(model_of(1.5), "2026-01-05"))["added"][0]["state"] == "known"
    said = put(service, document(watch_of(0.4, "changed"), "2026-02-05"))["added"][0]
    other = put(service, document(watch_of(0.1), "2026-02-05"))["added"][
        0
    ]  # the verdict on the same readings
    assert (said["state"], other["state"], other["contradicts"]) == ("new", "conflict", [said["document"]])
    listed = service.client.get("/robots", params={"method": "drift"}).json()
    assert unnamed(Robots.model_validate(listed)) == set()
    (line,) = [each for each in listed["robots"] if each["id"] == robot]
    assert (line["serial"], listed["permitted_mm"]) == (SERIAL, 0.3)
    assert (line["due"]["date"], line["baseline"]["document"]) != (None, None)
    one = service.client.get(f"/robots/{SERIAL}").json()
    assert unnamed(RobotResponse.model_validate(one)) == set()
    assert (one["id"], [each["contradicts_another"] for each in one["history"]]) == (
        robot,
        [True, True, False],
    )
    assert service.client.get(f"/robots/{robot}", params={"limit": 1}).json()["left_out"] == 2
    trends = service.client.get(f"/robots/{robot}/trends").json()
    assert unnamed(Trends.model_validate(trends)) == set()
    assert {each["parameter"] for each in trends["trends"]} == {"d1", "error_rms"}
    assert json.loads(service.client.get(f"/documents/{first['added'][0]['document']}").content)["robot"]


def test_a_data_set_is_sent_as_its_two_files(service: Served, data: Path, tmp_path: Path) -> None:
    """The header holds the custom robot file; a path there would open a file of the service."""
    csv = tmp_path / "data.csv"
    for suffix in (".csv", ".toml"):
        shutil.copy(data.with_suffix(suffix), csv.with_suffix(suffix))
    edit_text(csv.with_suffix(".toml"), SERIAL, "own-1")
    with_own_robot(csv, own_cell(tmp_path / "cell", "irb120_faro", "abb-irb120"))
    table, header = csv.read_bytes(), csv.with_suffix(".toml").read_text("utf-8")

    def sent(toml: str) -> httpx2.Response:
        return service.client.post("/documents", files={"file": ("d.csv", table), "toml": toml.encode()})

    (added,) = sent(header).json()["added"]
    assert (added["kind"], added["model"], added["state"]) == ("dataset", NAME, "new")
    assert sent(header).json()["added"][0]["state"] == "known"
    content = service.client.get(f"/documents/{added['document']}").content
    assert dataset_texts(content) == (table.decode(), header)
    wrong = header.replace(f'robot = "{NAME}"', 'robot = "../own.toml"')
    assert "[robot_file]" in problem(sent(wrong), 422)["what_to_do"]
    assert "data.toml" in problem(sent(wrong.replace("../own.toml", "other")), 422)["detail"]
    assert "toml" in problem(service.client.post("/documents", files={"file": table}), 422)["what_to_do"]


def test_what_is_not_there_is_a_problem(service: Served) -> None:
    put(service, document(model_of(1.5), "2026-01-05"))
    problem(service.client.get("/robots/nobody"), 404)
    problem(service.client.get("/robots/nobody/trends"), 404)
    problem(service.client.get(f"/documents/{'0' * 64}"), 404)
    assert "d1" in problem(service.client.get(f"/robots/{SERIAL}/trends?parameter=x"), 422)["what_to_do"]
    for query in ("permitted_mm=-1", "method=guess", "shortest_days=nan", "first_days=1&shortest_days=90"):
        problem(service.client.get(f"/robots?{query}"), 422)
    for content in (
        b"{}",
        b"no JSON",
        b'{"format": "truepose-model/1"}',
        document({"format": "truepose-x/1"}, ""),
    ):
        problem(service.client.post("/documents", files={"file": ("d.json", content)}), 422)
    both = {"model_id": "a", "model_document": "0" * 64, "dataset_id": "x"}
    for wrong in ({}, both, {"model_document": "../x", "dataset_id": "x"}, {"model_id": "a"}):
        problem(service.client.post("/watches", json=wrong), 422)
    problem(service.client.post("/watches", json={"model_id": "a", "dataset_id": "x"}), 404)
    viewer = {"Authorization": f"Bearer {service.hello['viewer_token']}"}
    assert service.client.get("/robots", headers=viewer).status_code == 200
    for path in ("/documents", "/watches", "/watch-plans", "/upkeeps"):
        problem(service.client.post(path, json={}, headers=viewer), 403)


def test_a_serial_number_of_two_types_is_asked_for_by_id(service: Served) -> None:
    put(service, document(model_of(1.0), "2026-01-05", OTHER))
    lr = put(service, document(model_of(1.0), "2026-01-06", OTHER, "fanuc-lrmate200ic"))
    assert "the id" in problem(service.client.get(f"/robots/{OTHER}"), 422)["what_to_do"]
    assert service.client.get(f"/robots/{lr['robot_id']}").json()["model"] == "fanuc-lrmate200ic"


def test_a_watch_is_planned_judged_and_in_the_history(service: Served, data: Path, tmp_path: Path) -> None:
    assert RATE == watch.RATE
    baseline = put(service, data.with_name("model.json").read_bytes())["added"][0]["document"]
    asked = {"model_document": baseline, "poses": 4, "candidates": 40, "targets": ["T2"], "visits": None}
    plan = service.client.post("/watch-plans", json=asked).json()
    csv = tmp_path / "data.csv"
    for suffix in (".csv", ".toml"):
        shutil.copy(data.with_suffix(suffix), csv.with_suffix(suffix))
    edit_rows(csv, moved)
    asked = {"model_document": baseline, "dataset_id": upload(service, csv)}
    job = service.client.post("/watches", json=asked).json()
    done = service.until(f"/watch-plans/{plan['id']}", "succeeded", "failed")
    assert unnamed(WatchPlanResult.model_validate(done["result"])) == set()
    drive = service.client.post("/runs", json={"campaign": done["result"]["campaign"], "dry_run": True})
    assert (drive.status_code, drive.json()["total"]) == (202, done["result"]["readings"]), drive.text
    assert done["result"]["readings"] == 4 * done["result"]["rounds"] * done["result"]["repeats"] > 4

    done = service.until(f"/watches/{job['id']}", "succeeded", "failed")
    assert unnamed(WatchResult.model_validate(done["result"])) == set()
    assert (done["result"]["verdict"], done["result"]["causes"][0]["label"]) == ("changed", "base_shift")
    assert done["baseline"] == {"id": baseline, "sha256": baseline}
    again = service.client.post(
        "/watches", json={**asked, "model_document": "", "model_id": job["id"]}
    ).json()
    done = service.until(f"/watches/{again['id']}", "succeeded", "failed")  # by the model that it has updated
    assert done["result"]["verdict"] == "unchanged"

    lines = service.client.get(f"/robots/{SERIAL}").json()
    entered = [(each["kind"], each["here"]["id"]) for each in lines["history"] if each["here"]]
    assert sorted(entered) == sorted([("model", job["id"]), ("watch", job["id"]), ("watch", again["id"])])
    assert lines["baseline"]["document"] == baseline  # not what the watch has updated
    assert [each["id"] for each in service.client.get("/watches").json()["watches"]] == [
        again["id"],
        job["id"],
    ]


def test_another_robot_and_an_older_baseline(service: Served, data: Path, tmp_path: Path) -> None:
    baseline = put(service, data.with_name("model.json").read_bytes())["added"][0]["document"]
    old = put(service, MUSEUM.read_bytes(), serial="120-1")["added"][0]["document"]
    readings = upload(service, data)
    csv = tmp_path / "data.csv"
    for suffix in (".csv", ".toml"):
        shutil.copy(data.with_suffix(suffix), csv.with_suffix(suffix))
    edit_text(csv.with_suffix(".toml"), SERIAL, OTHER)
    jobs = [
        service.client.post("/watches", json={"model_document": model, "dataset_id": each}).json()["id"]
        for model, each in ((baseline, upload(service, csv)), (old, readings))
    ]
    other, older = [service.until(f"/watches/{job}", "succeeded", "failed") for job in jobs]
    assert other["state"] == "failed"
    assert OTHER in other["problem"]["operator_text"]
    # one of an older version: judged, or refused with what to do; never a fault of the program
    assert older["state"] == "succeeded" or older["problem"]["status"] == 422, older
    upkeep = {"model_document": baseline, "dataset_id": readings}
    job = service.client.post("/upkeeps", json=upkeep).json()["id"]
    assert "no thermal effect" in service.until(f"/upkeeps/{job}", "failed")["problem"]["operator_text"]


def results(record: Path, own: str, table: dict[str, Any], serial: str) -> None:
    """The result of a watch, as the service keeps it."""
    folder = record / "watches" / own
    folder.mkdir(parents=True)
    (folder / "result.json").write_bytes(document(table, "2026-05-06", serial))


TOKENS = Tokens("operator", "viewer")


def client_of(record: Path, **more: Any) -> TestClient:
    operator = {"Authorization": f"Bearer {TOKENS.operator}"}
    app = create_app(ServiceSettings(record, TOKENS, **more))
    return TestClient(app, base_url="http://127.0.0.1/api/v1", headers=operator)


def test_a_store_that_is_away_takes_nothing_with_it(tmp_path: Path) -> None:
    results(tmp_path, "20260506-091500-a", watch_of(0.4), SERIAL)
    results(tmp_path, "20260506-091500-b", watch_of(0.4), "")
    store = f"sqlite:///{tmp_path}/away/history.sqlite3"
    with client_of(tmp_path, store=store) as client:
        assert "folder" in problem(client.get("/robots"), 500)["detail"]
        assert client.get("/health").status_code == client.get("/runs").status_code == 200
        (tmp_path / "away").mkdir()  # it is back: what was found meanwhile is there
        listed = client.get("/robots").json()
        assert [each["serial"] for each in listed["robots"]] == [SERIAL]
        assert [each["path"] for each in listed["not_kept"]] == ["watches/20260506-091500-b/result.json"]
        assert "serial number" in listed["not_kept"][0]["because"]
    with client_of(tmp_path, store=store) as client:  # another start: each once
        (line,) = client.get(f"/robots/{SERIAL}").json()["history"]
        assert (line["here"]["id"], line["contradicts_another"]) == ("20260506-091500-a", False)
    assert len((tmp_path / "history-kept.jsonl").read_text("utf-8").splitlines()) == 2


def test_a_server_that_nobody_reaches_and_a_file_that_is_none(tmp_path: Path) -> None:
    with nobody_listens() as port:
        secret = f"postgresql://cell:se%63ret@127.0.0.1:{port}/plant"
        with client_of(tmp_path, store=secret) as client:
            assert "secret" not in str(problem(client.get("/robots"), 503))
    (tmp_path / "other.sqlite3").write_bytes(b"no database of this or any program" * 100)
    with client_of(tmp_path, store=f"sqlite:///{tmp_path}/other.sqlite3") as client:
        assert "is not a database" in problem(client.get("/robots"), 500)["detail"]
