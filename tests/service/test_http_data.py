"""Data sets over HTTP: uploaded, refused with their line, identified, diagnosed, reported."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import truepose
from calib.data.read import read_dataset
from calib.foreign import propose, text_of
from tests.calib.exports import CASES, ROBOT, N
from tests.service.campaigns import edit_rows, write_data
from tests.service.test_http_support import Served, problem, served


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    with served(tmp_path_factory.mktemp("record")) as running:
        yield running


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_data(tmp_path_factory.mktemp("data"), n=60)


def files(data: Path) -> dict[str, Any]:
    return {"csv": data.read_bytes(), "toml": data.with_suffix(".toml").read_bytes()}


def test_upload_diagnose_report(service: Served, data: Path, tmp_path: Path) -> None:
    answer = service.client.post("/datasets", files=files(data), data={"name": "mine"})
    assert answer.status_code == 201, answer.text
    dataset = answer.json()
    assert (dataset["name"], dataset["fit"], dataset["validation"]) == ("mine", 60, 30)
    for name in ("data.csv", "data.toml"):
        file = service.client.get(f"/datasets/{dataset['id']}/{name}")
        (tmp_path / name).write_bytes(file.content)
    assert read_dataset(tmp_path / "data.csv").sha256 == dataset["sha256"]
    key = {"Idempotency-Key": dataset["id"]}
    order = {"dataset_id": dataset["id"]}
    first, second = (service.client.post("/diagnoses", json=order, headers=key) for _ in range(2))
    assert first.status_code == 202
    assert first.json()["id"] == second.json()["id"]
    early = service.client.get(f"/reports/{first.json()['id']}")
    if early.status_code != 200:  # the job may have been quicker than this test
        problem(early, 404)
    identification = service.client.post("/identifications", json=order).json()
    done = service.until(f"/diagnoses/{first.json()['id']}", "succeeded", "failed")
    assert done["result"]["format"] == "truepose-diagnosis/1"
    assert done["result"]["effects"][0]["label"] == "backlash:j4"
    report = service.client.get(f"/reports/{first.json()['id']}")
    assert report.headers["content-type"].startswith("text/html")
    assert "default-src 'none'" in report.headers["content-security-policy"]
    assert "backlash:j4" in report.text
    assert service.client.get(f"/models/{first.json()['id']}").json()["format"] == "truepose-model/1"
    done = service.until(f"/identifications/{identification['id']}", "succeeded", "failed")
    assert done["result"]["format"] == "truepose-identification/1"


def test_a_diagnosis_takes_the_options_of_the_command(service: Served, data: Path) -> None:
    ids = [service.client.post("/datasets", files=files(data)).json()["id"] for _ in range(2)]
    order = {"dataset_id": ids[0], "most": 0, "carry_to": ids[1], "patch": True}
    job = service.client.post("/diagnoses", json=order).json()["id"]
    result = service.until(f"/diagnoses/{job}", "succeeded", "failed")["result"]
    assert result["effects"] == []  # backlash of joint 4 is there, but none may be added
    assert result["carry_over"]["data"] == "data.csv"
    assert "patch" in result
    problem(service.client.post("/diagnoses", json={"dataset_id": ids[0], "carry_to": "nothing"}), 404)
    job = service.client.post("/diagnoses", json={"dataset_id": ids[0], "prior": {"format": "mine"}}).json()[
        "id"
    ]
    refused = service.until(f"/diagnoses/{job}", "succeeded", "failed")["problem"]
    assert "is not the prior of a type" in refused["detail"]
    job = service.client.post("/identifications", json={"dataset_id": ids[0], "level": 1}).json()["id"]
    found = service.until(f"/identifications/{job}", "succeeded", "failed")["result"]
    assert not any(each["name"].startswith("alpha") for each in found["parameters"])


def test_a_data_set_that_cannot_be_used_is_refused_with_its_line(
    service: Served, data: Path, tmp_path: Path
) -> None:
    bad = tmp_path / "bad.csv"
    bad.write_bytes(data.read_bytes())
    edit_rows(bad, lambda rows: rows[3].update(z_mm="nan"))
    before = service.client.get("/datasets").json()
    answer = service.client.post(
        "/datasets", files={"csv": bad.read_bytes(), "toml": data.with_suffix(".toml").read_bytes()}
    )
    told = problem(answer, 422)
    assert told["line"] == 5
    assert told["detail"].startswith("data.csv, line 5: column 'z_mm'")
    assert service.client.get("/datasets").json() == before


@pytest.mark.parametrize(
    ("part", "content", "word"),
    [
        ("toml", b'robot = "../../robot.toml"', "robot"),
        ("toml", b"\xff\xfe", "UTF-8"),
        ("toml", b"a = " + b"[" * 5000, "nested"),
        ("csv", b"\xff\xfe", "UTF-8"),
        ("csv", b"", "empty"),
        ("csv", b'"' + b"x" * 200_000 + b'"\n', "data.csv"),
    ],
)
def test_files_that_are_none_are_refused(
    service: Served, data: Path, part: str, content: bytes, word: str
) -> None:
    told = problem(service.client.post("/datasets", files=files(data) | {part: content}), 422)
    assert word in told["detail"]
    assert "/" not in told["detail"].replace("../../robot.toml", "")


def test_half_an_upload_is_refused(service: Served, data: Path) -> None:
    problem(service.client.post("/datasets", files={"csv": data.read_bytes()}), 422)


def test_a_diagnosis_that_cannot_be_is_a_failed_one(service: Served, data: Path, tmp_path: Path) -> None:
    few = tmp_path / "few.csv"
    few.write_bytes(data.read_bytes())
    edit_rows(few, lambda rows: rows.__setitem__(slice(None), rows[:8]))
    dataset = service.client.post(
        "/datasets", files={"csv": few.read_bytes(), "toml": data.with_suffix(".toml").read_bytes()}
    ).json()
    job = service.client.post("/diagnoses", json={"dataset_id": dataset["id"]}).json()
    done = service.until(f"/diagnoses/{job['id']}", "succeeded", "failed")
    assert done["state"] == "failed"
    assert "calibration readings" in done["problem"]["operator_text"]
    assert done["problem"]["key"] == "set"


def mapped(folder: Path, robot: str = ROBOT) -> tuple[Path, bytes]:
    """A file of another program, and its map."""
    (file,) = next(case for case in CASES if case.name == "excel_german").write(folder)
    proposal = propose([file], {"robot": ROBOT, "sigma_mm": "0.1"}, None)
    return file, text_of(proposal.made, ()).replace(ROBOT, robot).encode()


def test_a_file_of_another_program_is_uploaded_with_its_map(service: Served, tmp_path: Path) -> None:
    file, map_text = mapped(tmp_path)
    sent = {"files": ("../../<b>x.csv", file.read_bytes()), "map": map_text}
    key = {"Idempotency-Key": "mapped"}
    answer = service.client.post("/datasets/mapped", files=sent, headers=key)
    assert answer.status_code == 201, answer.text
    made = answer.json()
    assert (made["robot"], made["readings"], made["name"]) == (ROBOT, N, "_b_x")
    assert made["fit_of_robot"]["miss_mm"] == pytest.approx(0.42, abs=0.06)
    assert any("Windows-1252" in each for each in made["said"])
    again = service.client.post("/datasets/mapped", files=sent, headers=key).json()
    assert again["id"] == made["id"]
    (tmp_path / "map.toml").write_bytes(map_text)
    for name in ("data.csv", "data.toml"):
        (tmp_path / name).write_bytes(service.client.get(f"/datasets/{made['id']}/{name}").content)
    here, there = truepose.read(file, map=tmp_path / "map.toml"), truepose.read(tmp_path / "data.csv")
    assert here.readings.equals(there.readings)


@pytest.mark.parametrize(
    ("robot", "count", "told"),
    [
        ("ur10", 1, "as they are mapped"),
        ("../../robot.toml", 1, "names a file, which was not sent with it"),
        (ROBOT, 2, "is for 1 files, and 2 are given"),
        (ROBOT, 3, "files"),
        ("", 1, "differs from the file for which the map map.toml was made"),
    ],
)
def test_what_converting_refuses_is_refused(
    service: Served, tmp_path: Path, robot: str, count: int, told: str
) -> None:
    file, map_text = mapped(tmp_path, robot or ROBOT)
    if not robot:  # a file that the map is not for
        file.write_text("a;b;c\n" + "1;2;3\n" * 9, "utf-8")
    before = service.client.get("/datasets").json()
    sent = [("files", ("x.csv", file.read_bytes()))] * count + [("map", ("m", map_text))]
    said = problem(service.client.post("/datasets/mapped", files=sent), 422)["detail"]
    assert told in said
    assert "/" not in said  # no folder of the server
    assert service.client.get("/datasets").json() == before
