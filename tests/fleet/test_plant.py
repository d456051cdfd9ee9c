"""The server of a fleet.

These would catch: a document that is kept under another hash or twice, and a contradiction that is overwritten or not
reported. They would also catch a store that is away and sets a cell's documents aside, and a token with too many
permissions.
"""

from __future__ import annotations

import asyncio
import hashlib
from collections.abc import Awaitable, Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient
from httpx2 import Response

from fleet.errors import StoreError, StoreFull, StoreGone
from fleet.outbox import LARGEST
from fleet.store import Document, FleetStore, RobotKey
from service.http.access.roles import Tokens
from service.plant import FleetServerSettings, Senders, create_plant
from tests.fleet import documents
from tests.fleet.postgres import Cluster

TOKENS = Tokens("only-for-the-cells-of-the-tests", "only-for-the-viewers-of-the-tests")
CELL = {"Authorization": f"Bearer {TOKENS.operator}"}
VIEWER = {"Authorization": f"Bearer {TOKENS.viewer}"}


@pytest.fixture
def lite(tmp_path: Path) -> Iterator[FleetStore]:
    with FleetStore.open(f"sqlite:///{tmp_path}/plant.sqlite3") as opened:
        yield opened


@pytest.fixture
def client(lite: FleetStore) -> Iterator[TestClient]:
    with serving(lite) as client:
        yield client


def serving(store: FleetStore, **settings: Any) -> TestClient:
    app = create_plant(store, FleetServerSettings(Senders(TOKENS), **settings))
    return TestClient(app, base_url="http://127.0.0.1", raise_server_exceptions=False)


def about(document: Document, **other: str) -> dict[str, str]:
    return {
        "kind": document.kind,
        "serial": document.robot.serial,
        "model": document.robot.model,
        "cell": document.cell,
        "identity": document.identity,
        "measured_at": document.measured_at.isoformat(),
    } | other


def put(client: TestClient, document: Document, **other: str) -> Response:
    path = f"/api/v1/documents/{other.pop('hash', document.hash)}"
    return client.put(path, content=document.content, params=about(document, **other), headers=CELL)


async def uploaded(app: Any, document: Document, receive: Callable[[], Awaitable[Any]]) -> list[Any]:
    """The messages that answer an upload whose body comes by `receive`."""
    told: list[Any] = []

    async def send(message: Any) -> None:
        told.append(message)

    query = "&".join(f"{key}={value}" for key, value in about(document).items()).replace("+", "%2B")
    scope = {
        "type": "http",
        "method": "PUT",
        "path": f"/api/v1/documents/{document.hash}",
        "raw_path": b"",
        "query_string": query.encode(),
        "headers": [(b"host", b"127.0.0.1"), (b"authorization", CELL["Authorization"].encode())],
        "http_version": "1.1",
        "scheme": "http",
    }
    await app(scope, receive, send)
    return told


def test_a_document_is_acknowledged_kept_and_read_back(client: TestClient) -> None:
    sent = documents.model({"d1": 0.25})
    answer = put(client, sent)
    assert (answer.status_code, answer.json()) == (201, {"hash": sent.hash, "state": "new"})
    again = put(client, sent)
    assert (again.status_code, again.json()) == (200, {"hash": sent.hash, "state": "known"})
    assert client.get(f"/api/v1/documents/{sent.hash}", headers=VIEWER).content == sent.content
    (listed,) = client.get("/api/v1/documents", headers=VIEWER).json()["documents"]
    assert (listed["hash"], listed["serial"], listed["kind"], listed["size"], listed["conflict"]) == (
        sent.hash,
        sent.robot.serial,
        "model",
        len(sent.content),
        False,
    )
    (robot,) = client.get("/api/v1/robots", headers=VIEWER).json()["robots"]
    assert (robot["serial"], robot["cells"], robot["documents"]) == ("120-4711", ["cell-1"], {"model": 1})


def test_another_content_than_its_hash_says_is_refused_and_not_kept(
    client: TestClient, lite: FleetStore
) -> None:
    sent = documents.model({"d1": 0.25})
    answer = put(client, sent, hash=hashlib.sha256(b"another").hexdigest())
    assert answer.status_code == 400
    assert sent.hash in answer.json()["operator_text"]
    assert lite.robots() == []


def test_two_uploads_that_disagree_are_both_kept_and_both_told_each_time(
    client: TestClient, lite: FleetStore
) -> None:
    """Repeated uploads are reported again, because the first answer may have been lost."""
    one = documents.model({"d1": 0.25}, identity="record 7")
    other = documents.model({"d1": 0.75}, identity="record 7")
    assert put(client, one).status_code == 201
    for sent, hashes in ((other, [one.hash]), (other, [one.hash]), (one, [other.hash])):
        answer = put(client, sent)
        told = answer.json()
        assert answer.status_code == 409
        assert (told["hash"], told["other_hashes"], told["kept"]) == (sent.hash, hashes, True)
        assert one.hash in told["operator_text"]
        assert other.hash in told["operator_text"]
    assert lite.content(one.hash) == one.content
    assert lite.content(other.hash) == other.content
    assert [entry.conflict for entry in lite.documents()] == [True, True]


@pytest.mark.parametrize(
    ("other", "word"),
    [
        ({"kind": "recipe"}, "kind"),
        ({"serial": ""}, "serial"),
        ({"serial": "x" * 300}, "serial"),
        ({"identity": "a\0b"}, "identity"),
        ({"measured_at": "yesterday"}, "measured_at"),
        ({"measured_at": "2026-03-02T09:15:00"}, "time zone"),
        ({"hash": "../../etc/passwd"}, ""),
        ({"hash": "ABC"}, "hash"),
    ],
)
def test_what_cannot_be_meant_is_refused_by_key(client: TestClient, other: dict[str, str], word: str) -> None:
    answer = put(client, documents.model({"d1": 0.25}), **other)
    assert answer.status_code in (403, 404, 422)
    assert answer.headers["content-type"] == "application/problem+json"
    assert word in answer.json()["operator_text"]
    assert answer.json()["what_to_do"]


@pytest.mark.parametrize(
    ("days", "status"), [(-3000.0, 201), (0.0, 201), (0.99, 201), (1.01, 422), (365.0 * 6973, 422)]
)
def test_a_document_is_dated_by_the_server_s_clock(lite: FleetStore, days: float, status: int) -> None:
    """Late documents are accepted; a document of the future would be a robot's newest for ever."""
    with serving(lite, now=lambda: documents.BEGAN) as client:
        answer = put(client, documents.model({"d1": 0.25}, day=days))
    assert answer.status_code == status
    assert len(lite.documents()) == (status == 201)
    assert status == 201 or "measured_at" in answer.json()["operator_text"]


HALF_A_LETTER = documents.model({"d1": 1.0}).content.replace(b'"d1"', rb'"d1\ud800"')


@pytest.mark.parametrize(
    "content",
    [b"{", b"[]", b'{"format": "truepose-model/9"}', b"\xff\xfe", b"", b"[" * 100_000, HALF_A_LETTER],
    ids=["brace", "list", "newer", "no text", "empty", "nested", "half a letter"],
)
def test_what_is_no_document_is_refused(client: TestClient, lite: FleetStore, content: bytes) -> None:
    path = f"/api/v1/documents/{hashlib.sha256(content).hexdigest()}"
    answer = client.put(path, content=content, params=about(documents.model({"d1": 1.0})), headers=CELL)
    assert answer.status_code == 422
    assert answer.json()["what_to_do"]
    assert lite.documents() == []


def test_500_mb_are_refused_before_they_come(client: TestClient) -> None:
    path = f"/api/v1/documents/{'0' * 64}"
    said = {"Content-Length": str(500 * 1024 * 1024)}
    answer = client.put(path, params=about(documents.model({"d1": 1.0})), headers={**CELL, **said})
    assert answer.status_code == 413


def test_a_body_without_a_length_is_counted_as_it_comes(lite: FleetStore) -> None:
    pieces = 0

    def endless() -> Iterator[bytes]:
        nonlocal pieces
        for _ in range(500):
            pieces += 1
            yield b"x" * 1024

    with serving(lite, upload_bytes=20_000) as client:
        answer = client.put(
            f"/api/v1/documents/{'0' * 64}",
            content=endless(),
            params=about(documents.model({"d1": 1.0})),
            headers=CELL,
        )
    assert answer.status_code == 413
    assert lite.documents() == []


@pytest.mark.parametrize(
    ("method", "path", "headers", "status"),
    [
        ("GET", "/robots", VIEWER, 200),
        ("GET", "/robots", CELL, 403),
        ("GET", "/documents", CELL, 403),
        ("GET", f"/documents/{'0' * 64}", CELL, 403),
        ("PUT", f"/documents/{'0' * 64}", VIEWER, 403),
        ("DELETE", f"/documents/{'0' * 64}", CELL, 403),
        ("DELETE", f"/documents/{'0' * 64}", VIEWER, 403),
        ("GET", "/robots", {}, 401),
        ("PUT", f"/documents/{'0' * 64}", {}, 401),
        ("PUT", f"/documents/{'0' * 64}", {"Authorization": "Bearer wrong"}, 401),
        ("GET", "/health", {}, 200),
        ("GET", f"/documents/{'0' * 64}", VIEWER, 404),
        ("GET", "/robots/unknown/trend", VIEWER, 404),
        ("GET", "/robots", {**VIEWER, "Host": "evil.example"}, 403),
        ("GET", "/robots", {**VIEWER, "Origin": "http://evil.example"}, 403),
        ("GET", "/robots", {**VIEWER, "Host": "fleet"}, 200),
    ],
)
def test_who_may_what(lite: FleetStore, method: str, path: str, headers: dict[str, str], status: int) -> None:
    with serving(lite, names=("fleet",)) as client:
        answer = client.request(method, f"/api/v1{path}", headers=headers)
    assert answer.status_code == status
    assert status == 200 or answer.json()["what_to_do"]


@pytest.mark.parametrize(
    ("error", "status", "word"),
    [
        (
            StoreGone("does not answer.", do="Look at it.", file="postgresql://u:***@db/plant"),
            503,
            "does not answer",
        ),
        (StoreFull("has no room left.", do="Make room.", file="postgresql://u@db/plant"), 507, "no room"),
        (StoreError("refuses it.", do="Ask as a user with the right to.", file="db"), 503, "refuses it"),
    ],
)
def test_a_store_that_cannot_keep_it_is_not_the_documents_fault(
    client: TestClient,
    lite: FleetStore,
    monkeypatch: pytest.MonkeyPatch,
    error: StoreError,
    status: int,
    word: str,
) -> None:
    def refuse(*_: object) -> None:
        raise error

    monkeypatch.setattr(lite, "add", refuse)
    monkeypatch.setattr(lite, "robots", refuse)
    for answer in (put(client, documents.model({"d1": 1.0})), client.get("/api/v1/robots", headers=VIEWER)):
        assert answer.status_code == status
        assert int(answer.headers["Retry-After"]) > 0
        assert word in answer.json()["operator_text"]
        assert "db" not in answer.text  # where the store is, is nobody's matter


def test_a_database_that_goes_and_comes_back(postgres: Cluster, template: str) -> None:
    one, other = documents.model({"d1": 1.0}), documents.model({"d1": 2.0}, day=1)
    with FleetStore.open(postgres.database(template)) as store, serving(store) as client:
        assert put(client, one).status_code == 201
        postgres.stop()
        try:
            gone = put(client, other)
        finally:
            postgres.start()
        assert gone.status_code == 503
        assert gone.headers["Retry-After"]
        assert put(client, other).status_code == 201
        put(client, one)  # the cluster of the tests does not sync: it may have forgotten this one
        assert {entry.hash for entry in store.documents()} == {one.hash, other.hash}


def test_a_client_that_goes_in_mid_upload_leaves_nothing(lite: FleetStore) -> None:
    sent = documents.model({"d1": 0.25})
    app = create_plant(lite, FleetServerSettings(Senders(TOKENS)))
    messages = [
        {"type": "http.request", "body": sent.content[:20], "more_body": True},
        {"type": "http.disconnect"},
    ]

    async def receive() -> Any:
        return messages.pop(0)

    told = asyncio.run(uploaded(app, sent, receive))
    assert messages == []
    assert told[0]["status"] == 400
    assert lite.documents() == []


def test_a_trend_and_a_serial_number_with_a_slash(client: TestClient) -> None:
    robot = RobotKey("A/7 b", "irb120")
    for day in range(3):
        put(client, documents.model({"d1": 0.1 * day, "d2": 1.0}, robot=robot, day=day))
    trend = client.get("/api/v1/robots/A%2F7%20b/trend", params={"parameter": "d1"}, headers=VIEWER).json()
    assert [round(point["value"], 3) for point in trend["points"]] == [0.0, 0.1, 0.2]
    assert {(point["u"], point["unit"]) for point in trend["points"]} == {(0.01, "mm")}
    put(client, documents.model({"d1": 1.0}, robot=RobotKey("A/7 b", "irb1200")))
    several = client.get("/api/v1/robots/A%2F7%20b/trend", headers=VIEWER)
    assert several.status_code == 422
    one = client.get("/api/v1/robots/A%2F7%20b/trend", params={"model": "irb1200"}, headers=VIEWER).json()
    assert len(one["points"]) == 1


def test_lists_are_asked_by_robot_kind_and_time(client: TestClient) -> None:
    for day in range(4):
        put(client, documents.watch(day=day, size=0.01 * (day + 1)))
    put(client, documents.model({"d1": 1.0}, robot=RobotKey("other", "ur5")))

    def count(**asked: str) -> int:
        return len(client.get("/api/v1/documents", params=asked, headers=VIEWER).json()["documents"])

    assert [count(), count(kind="watch"), count(serial="other"), count(limit="2")] == [5, 4, 1, 2]
    assert count(since="2026-03-04T00:00:00Z") == 2
    assert client.get("/api/v1/documents", params={"since": "2026-03-04"}, headers=VIEWER).status_code == 422
    assert client.get("/api/v1/documents", params={"limit": "0"}, headers=VIEWER).status_code == 422


def test_a_document_of_the_largest_size_is_taken(client: TestClient) -> None:
    head, tail = b'{"format": "truepose-run/1", "padding": "', b'"}'
    content = head + b"x" * (LARGEST - len(head) - len(tail)) + tail
    sent = Document("campaign", documents.ROBOT, "cell-1", "large", documents.BEGAN, content)
    assert put(client, sent).status_code == 201
