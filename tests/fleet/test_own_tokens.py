"""A token for each cell.

The tests catch a cell that sends under the name of another, a token that is valid after it was withdrawn, and a file
that discloses the tokens.
"""

from __future__ import annotations

import json
import stat
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace

import pytest
from fastapi.testclient import TestClient
from httpx2 import Response

from fleet.outbox.link import ServerLink
from fleet.store import Document, FleetStore, RobotKey
from service import exit_codes
from service.cli import main
from service.plant import FleetServerSettings, Senders, create_plant
from tests.fleet import documents
from tests.fleet.test_plant import CELL, TOKENS, VIEWER, about

Make = Callable[..., dict[str, str]]


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "cells.json"


@pytest.fixture
def store(tmp_path: Path) -> Iterator[FleetStore]:
    with FleetStore.open(f"sqlite:///{tmp_path}/plant.sqlite3") as opened:
        yield opened


@pytest.fixture
def client(store: FleetStore, file: Path) -> TestClient:
    app = create_plant(store, FleetServerSettings(Senders(TOKENS, file)))
    return TestClient(app, base_url="http://127.0.0.1", raise_server_exceptions=False)


@pytest.fixture
def make(file: Path, capsys: pytest.CaptureFixture[str]) -> Make:
    def made(name: str, *more: str) -> dict[str, str]:
        assert main(["fleet", "token", "add", name, "--file", str(file), *more]) == exit_codes.DONE
        return {"Authorization": f"Bearer {capsys.readouterr().out.strip()}"}

    return made


def put(client: TestClient, headers: dict[str, str], document: Document, **other: str) -> Response:
    path = f"/api/v1/documents/{document.hash}"
    return client.put(path, content=document.content, params=about(document, **other), headers=headers)


def test_the_name_of_the_cell_is_that_of_its_token(
    client: TestClient, store: FleetStore, make: Make, file: Path
) -> None:
    seven, eight = make("hall 7"), make("hall 8")
    assert put(client, seven, documents.model({"d1": 1.0}), cell="hall 8").status_code == 201
    assert put(client, eight, documents.model({"d1": 2.0}, day=1), cell="somebody").status_code == 201
    assert [each.cell for each in store.documents()] == ["hall 8", "hall 7"]
    assert client.get("/api/v1/robots", headers=seven).status_code == 403
    assert client.get("/api/v1/robots", headers=VIEWER).status_code == 200


def test_the_token_that_all_share_sends_nothing_beside_own_ones(
    client: TestClient, store: FleetStore, make: Make
) -> None:
    for headers in (CELL, {"Authorization": "Bearer nobody's"}, {}):
        assert put(client, headers, documents.model({"d1": 1.0})).status_code == 401
    make("hall 7")
    assert put(client, CELL, documents.model({"d1": 1.0})).status_code == 401
    assert store.documents() == []


def test_a_token_is_taken_away_without_a_restart(
    client: TestClient, store: FleetStore, make: Make, file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    seven, eight = make("hall 7"), make("hall 8")
    assert put(client, seven, documents.model({"d1": 1.0})).status_code == 201
    assert main(["fleet", "token", "revoke", "hall 7", "--file", str(file)]) == exit_codes.DONE
    assert put(client, seven, documents.model({"d1": 2.0}, day=1)).status_code == 401
    assert put(client, eight, documents.model({"d1": 3.0}, day=2)).status_code == 201
    assert put(client, make("hall 7"), documents.model({"d1": 2.0}, day=1)).status_code == 201
    assert main(["fleet", "token", "list", "--file", str(file)]) == exit_codes.DONE
    assert [line.split("\t")[:2] for line in capsys.readouterr().out.splitlines()] == [
        ["hall 8", "cell"],
        ["hall 7", "cell"],
    ]


NAMED = ("--robot", f"{documents.ROBOT.model}:{documents.ROBOT.serial}")


@pytest.mark.parametrize("other", [RobotKey("120-4712", "irb120"), RobotKey("120-4711", "ur5")])
def test_a_token_that_names_robots_writes_about_no_others(
    client: TestClient, store: FleetStore, make: Make, file: Path, other: RobotKey
) -> None:
    seven, eight = make("hall 7", *NAMED), make("hall 8")
    barred = documents.model({"d1": 2.0}, robot=other, day=3)
    assert put(client, seven, documents.model({"d1": 1.0})).status_code == 201
    answer = put(client, seven, barred)
    assert (answer.status_code, answer.json()["code"]) == (403, 8612)
    assert other.serial in answer.json()["operator_text"]
    assert [each.robot for each in store.documents()] == [documents.ROBOT]
    assert put(client, eight, documents.model({"d1": 3.0}, robot=other, day=1)).status_code == 201
    allow = ["fleet", "token", "allow", "hall 7", "--robot", f"{other.model}:{other.serial}"]
    assert main([*allow, "--file", str(file)]) == exit_codes.DONE
    assert put(client, seven, barred).status_code == 201
    assert put(client, seven, documents.model({"d1": 4.0}, day=2)).status_code == 201


def test_a_robot_that_is_not_named_holds_up_no_other(client: TestClient, make: Make) -> None:
    """Set aside by the outbox, unlike a wrong token, for which everything waits."""
    seven = make("hall 7", *NAMED)
    refused = put(client, seven, documents.model({"d1": 1.0}, robot=RobotKey("a", "ur5")))
    barred = put(client, {"Authorization": "Bearer x"}, documents.model({"d1": 1.0}))
    kinds = [meaning(each) for each in (refused, barred)]
    assert kinds == ["refused", "barred"]


def meaning(response: Response) -> str:
    """Return the meaning of an answer for an outbox's link."""
    answer = SimpleNamespace(status=response.status_code, reason="", getheader=lambda *_: "")
    return ServerLink("http://127.0.0.1:1", "t")._meaning(answer, response.content, "0" * 64).kind  # type: ignore[arg-type]


def test_a_token_without_names_is_told(make: Make, file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    make("hall 7", *NAMED)
    make("office", "--role", "viewer")
    make("hall 8")
    capsys.readouterr()
    assert main(["fleet", "token", "list", "--file", str(file)]) == exit_codes.DONE
    shown = capsys.readouterr()
    assert NAMED[1] in shown.out
    assert "'hall 8' may write about any robot" in shown.err
    assert Senders(TOKENS, file).of_any_robot() == ["hall 8"]


def test_a_file_from_before_tokens_named_robots_is_read(client: TestClient, make: Make, file: Path) -> None:
    seven = make("hall 7")
    table = json.loads(file.read_text("utf-8"))
    for each in table["tokens"]:
        del each["robots"]
    file.write_text(json.dumps(table), "utf-8")
    assert put(client, seven, documents.model({"d1": 1.0})).status_code == 201


def test_a_viewer_of_its_own_reads_and_writes_nothing(client: TestClient, make: Make) -> None:
    office = make("office", "--role", "viewer")
    assert client.get("/api/v1/robots", headers=office).status_code == 200
    assert put(client, office, documents.model({"d1": 1.0})).status_code == 403


def test_the_file_is_private_and_tells_no_token(make: Make, file: Path) -> None:
    token = make("hall 7")["Authorization"].removeprefix("Bearer ")
    assert stat.S_IMODE(file.stat().st_mode) == 0o600
    assert token not in file.read_text("utf-8")


@pytest.mark.parametrize(
    "spoil", ["{", '{"format": "other"}', '{"format": "truepose-fleet-tokens/1"}', "open"]
)
def test_a_file_that_cannot_be_used_lets_nobody_in(
    client: TestClient, make: Make, file: Path, spoil: str, capsys: pytest.CaptureFixture[str]
) -> None:
    seven = make("hall 7")
    assert put(client, seven, documents.model({"d1": 1.0})).status_code == 201
    good = file.read_bytes()
    if spoil == "open":
        file.chmod(0o644)
    else:
        file.write_text(spoil, "utf-8")
    assert put(client, seven, documents.model({"d1": 1.0})).status_code == 401
    assert client.get("/api/v1/robots", headers=VIEWER).status_code == 200
    assert "nobody may send until this is mended" in capsys.readouterr().err
    with pytest.raises(ValueError, match="cells"):
        Senders(TOKENS, file)  # a start is refused
    file.chmod(0o600)
    file.write_bytes(good)
    assert put(client, seven, documents.model({"d1": 1.0})).status_code == 200


@pytest.mark.parametrize(
    ("words", "why"),
    [
        (["add", "hall 7"], "has a token"),
        (["add", " "], "is not a usable name"),
        (["add", "a\nb"], "is not a usable name"),
        (["add", "hall 8", "--robot", "irb120"], "TYPE:SERIAL"),
        (["add", "office", "--role", "viewer", *NAMED], "a viewer reads of all"),
        (["allow", "hall 7"], "is missing"),
        (["allow", "hall 9", *NAMED], "Tokens exist for: hall 7"),
        (["revoke", "hall 9"], "Tokens exist for: hall 7"),
    ],
)
def test_what_cannot_be_meant_is_refused(
    make: Make, file: Path, words: list[str], why: str, capsys: pytest.CaptureFixture[str]
) -> None:
    make("hall 7")
    before = file.read_bytes()
    assert main(["fleet", "token", *words, "--file", str(file)]) == exit_codes.USAGE
    assert why in capsys.readouterr().err
    assert file.read_bytes() == before
