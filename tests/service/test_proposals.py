"""Maps proposed over HTTP for uploaded files, as `truepose convert` proposes them at a terminal.

These would catch: a second opinion on a file, a data set that differs from the one of the terminal, an answer that is
ignored, a robot that is looked for among the files of the server, and a hostile file that ends in an error of the
service or holds it.
"""

from __future__ import annotations

import json
import threading
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient

from service.cli import main
from service.http.access.roles import ServiceSettings, Tokens
from service.http.app import create_app
from service.http.state import Service
from service.http.wire.bodies import MapProposalShown
from service.http.work import proposals
from service.results.files.conversion import ProposalResult
from tests.calib.exports import CASES, ROBOT, Case, N
from tests.calib.test_hostile_files import BOMBS, workbook
from tests.service.test_http_support import problem
from tests.service.test_openapi import unnamed

TOKENS = Tokens("proposes-in-these-tests", "looks-on-in-these-tests")
SHARED = Path(__file__).resolve().parents[3] / "shared" / "data"


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[TestClient]:
    app = create_app(ServiceSettings(record=tmp_path_factory.mktemp("record"), tokens=TOKENS))
    with TestClient(app, base_url="http://127.0.0.1/api/v1", raise_server_exceptions=False) as client:
        client.headers |= {"Authorization": f"Bearer {TOKENS.operator}"}
        yield client


def sent(files: Sequence[Path]) -> list[tuple[str, tuple[str, bytes]]]:
    return [("files", (file.name, file.read_bytes())) for file in files]


def propose(client: TestClient, files: Sequence[Path], *answers: str, robot: str = ROBOT) -> Any:
    return client.post("/proposals", files=sent(files), data={"robot": robot, "answer": list(answers)})


def as_at_the_terminal(
    client: TestClient, files: Sequence[Path], answers: Sequence[str], robot: str, folder: Path
) -> None:
    """Compare proposal, map and data set of the service with those that `convert` writes."""
    names = [str(file) for file in files]
    kept, document, out = folder / "kept.toml", folder / "proposal.json", folder / "out.csv"
    given = [part for answer in answers for part in ("--answer", answer)]
    main(["convert", *names, "--robot", robot, *given, "--propose", str(kept), "--json", str(document)])
    answer = propose(client, files, *answers, robot=robot)
    if not document.is_file():
        assert answer.status_code == 422, answer.text
        return
    assert answer.status_code == 200, answer.text
    shown = answer.json()
    wanted = json.loads(document.read_text("utf-8")) | {"map": None}
    assert {key: shown[key] for key in ProposalResult.model_fields} == wanted
    assert shown["map_text"] == kept.read_text("utf-8")
    assert unnamed(MapProposalShown.model_validate(shown)) == set()
    assert [name for table in shown["tables"] for name in table["names"]] == [
        column["column"] for column in shown["columns"]
    ]
    if shown["complete"]:
        code = main(["convert", *names, "--map", str(kept), "--out", str(out)])
        made = client.post(
            "/datasets/mapped", files=[*sent(files), ("map", ("m.toml", shown["map_text"].encode()))]
        )
        assert made.status_code == (201 if code == 0 else 422), made.text
        for name in ("data.csv", "data.toml") if code == 0 else ():
            content = client.get(f"/datasets/{made.json()['id']}/{name}").content
            assert content == out.with_suffix(Path(name).suffix).read_bytes()


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_a_proposal_is_that_of_the_terminal(client: TestClient, case: Case, tmp_path: Path) -> None:
    """Once with the questions open, once with the answers of the user."""
    files = case.write(tmp_path)
    for answers in dict.fromkeys(((), tuple(f"{key}={value}" for key, value in case.answers.items()))):
        folder = tmp_path / str(len(answers))
        folder.mkdir()
        as_at_the_terminal(client, files, answers, ROBOT, folder)


@pytest.mark.skipif(not SHARED.is_dir(), reason="needs the data of others, which are not kept here")
@pytest.mark.parametrize("name", ["fanuc_r2000_leica", "panda_camera", "ur10_leica"])
def test_files_of_others_are_read_as_at_the_terminal(client: TestClient, name: str, tmp_path: Path) -> None:
    files = [*(SHARED / name).rglob("*.csv"), *(SHARED / name).rglob("*.txt")]
    for i, file in enumerate(sorted(files)[:4]):
        if file.stat().st_size < 2_000_000:
            (tmp_path / str(i)).mkdir()
            as_at_the_terminal(client, [file], (), "ur10", tmp_path / str(i))


def test_questions_are_asked_until_nothing_is_open(client: TestClient, tmp_path: Path) -> None:
    files = next(case for case in CASES if case.name == "by_order").write(tmp_path)
    before = client.get("/datasets").json()
    first = propose(client, files, robot="").json()
    assert {each["key"] for each in first["questions"]} == {"robot", "match"}
    assert ROBOT in first["robots"]
    assert (first["tables"][1]["prefix"], first["tables"][1]["readings"]) == ("2.", N)
    assert first["tables"][1]["rows"][0][0] in files[1].read_text("utf-8")
    second = propose(client, files).json()
    assert [each["key"] for each in second["questions"]] == ["match"]
    assert propose(client, files, "match=order").json()["complete"]
    assert client.get("/datasets").json() == before  # nothing is kept


def test_what_a_column_is_said_to_be_goes_into_the_map(client: TestClient, tmp_path: Path) -> None:
    (file,) = next(case for case in CASES if case.name == "excel_german").write(tmp_path)
    said = ("column.Pos. X [mm]=y", "column.Pos. Y [mm]=x", "column.Nr.=leave")
    as_at_the_terminal(client, [file], said, ROBOT, tmp_path)
    shown = propose(client, [file], *said).json()
    assert 'x = "Pos. Y [mm][mm]"' in shown["map_text"]
    found = {each["column"]: each for each in shown["columns"]}
    assert (found["Nr."]["read_as"], found["Nr."]["why"]) == ("", "as answered")
    sent_map = ("map", ("m.toml", shown["map_text"].encode()))
    refused = problem(client.post("/datasets/mapped", files=[*sent([file]), sent_map]), 422)
    assert "as they are mapped" in refused["detail"]  # the mirror: this robot cannot have been there


@pytest.mark.parametrize(
    ("robot", "answers", "told"),
    [
        ("../../robot.toml", (), "is '../../robot.toml'"),
        ("", ("robot=/etc/passwd",), "is '/etc/passwd'"),
        (ROBOT, ("rotations=x",), "answers 'rotations', which nothing asks"),
        (ROBOT, ("rotation",), "'rotation' is not an answer"),
        (ROBOT, ("sigma_mm=much",), "'much' is not a number above 0"),
        (ROBOT, ("sigma_mm=nan",), "'nan' is not a number above 0"),
        (ROBOT, ("column.Pos. X [mm]=width",), "is not one of the answers"),
        (ROBOT, ("column.Pos. X [mm]=z", "column.Nr.=z"), "two columns are stated as z"),
        (ROBOT, ("column.Nothing=x",), "which nothing asks"),
        (ROBOT, ("unit.points=furlong",), "is not one of the answers"),
    ],
)
def test_an_answer_that_cannot_be_meant_is_refused(
    client: TestClient, robot: str, answers: tuple[str, ...], told: str, tmp_path: Path
) -> None:
    files = next(case for case in CASES if case.name == "excel_german").write(tmp_path)
    refused = problem(propose(client, files, *answers, robot=robot), 422)
    assert told in refused["detail"]
    assert refused["what_to_do"]
    assert str(tmp_path.parent) not in json.dumps(refused)


COLUMNS = ",".join(f"c{k}" for k in range(1_000_000))
HOSTILE: dict[str, tuple[str, bytes, str]] = {
    "a million columns": ("a.csv", f"{COLUMNS}\n{COLUMNS}".encode(), "characters"),
    "two thousand columns": ("a.csv", b",".join([b"1"] * 2000) + b"\n", "columns"),
    "not text": ("a.csv", bytes(range(256)) * 4000, "is not a text file"),
    "zero bytes": ("a.csv", b"J1,J2,X\n1,2,\x003\n" * 50, "is not a text file"),
    "nothing": ("a.csv", b"", "holds no table"),
    "words": ("a.txt", "grüß Gott\n".encode("latin-1") * 1000, "holds no table"),
    "an open quote": ("a.csv", b'"' + b"a" * 3_000_000, "characters"),
    "no workbook": ("a.xlsx", b"PK\x03\x04" + b"\0" * 1000, "is not a workbook"),
    "a bad name": ("../../\x01" + "𠀀" * 300 + "/..\\" + "x" * 300 + ".csv", b"x", "holds no table"),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_a_hostile_file_is_refused_by_name(client: TestClient, name: str) -> None:
    file, content, told = HOSTILE[name]
    refused = problem(client.post("/proposals", files={"files": (file, content)}), 422)
    assert told in refused["detail"]
    assert "/" not in refused["detail"]  # no folder of the server


@pytest.mark.parametrize(
    "name", ["a cell at the far end", "entities within entities", "a file of this computer"]
)
def test_a_bomb_is_refused(client: TestClient, name: str, tmp_path: Path) -> None:
    old, new, told = BOMBS[name]
    refused = problem(propose(client, [workbook(tmp_path, old=old, new=new)]), 422)
    assert told in refused["detail"]


def test_a_letter_of_four_bytes_makes_no_name_too_long_for_a_disk(client: TestClient, tmp_path: Path) -> None:
    (file,) = next(case for case in CASES if case.name == "tabs_units").write(tmp_path)
    named = {"files": ("𠀀" * 200 + ".csv", file.read_bytes())}
    assert client.post("/proposals", files=named).json()["tables"][0]["file"].endswith("𠀀.csv")


def test_an_answer_larger_than_the_service_can_send_at_ease_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (file,) = next(case for case in CASES if case.name == "tabs_units").write(tmp_path)
    monkeypatch.setattr(proposals, "_MOST_BYTES", 1000)
    with pytest.raises(ValueError, match="so long that the proposal"):
        proposals.proposed([(file.name, file.read_bytes())], ROBOT, [])


def test_three_files_or_none_and_a_viewer_are_refused(client: TestClient, tmp_path: Path) -> None:
    (file,) = next(case for case in CASES if case.name == "tabs_units").write(tmp_path)
    problem(propose(client, [file] * 3), 422)
    problem(client.post("/proposals", data={"robot": ROBOT}), 422)
    viewer = {"Authorization": f"Bearer {TOKENS.viewer}"}
    problem(client.post("/proposals", files=sent([file]), headers=viewer), 403)


def test_two_at_once_are_both_answered_and_other_requests_meanwhile(
    client: TestClient, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Both are held until the service has answered another request."""
    app: Any = client.app
    service: Service = app.state.service
    both, released, call = threading.Barrier(3, timeout=60.0), threading.Event(), service.file_readers.call

    def held(*given: Any) -> Any:
        both.wait()
        assert released.wait(60.0)
        return call(*given)

    monkeypatch.setattr(service.file_readers, "call", held)
    names = ("tabs_units", "kuka")
    with ThreadPoolExecutor(2) as threads:
        files = []
        for name in names:
            (tmp_path / name).mkdir()
            files.append(next(case for case in CASES if case.name == name).write(tmp_path / name))
        asked = [threads.submit(propose, client, each) for each in files]
        both.wait()
        assert client.get("/datasets").status_code == 200
        released.set()
        answers = [each.result().json() for each in asked]
    assert [each["tables"][0]["file"] for each in answers] == [each[0].name for each in files]
    assert all(each["complete"] for each in answers)
