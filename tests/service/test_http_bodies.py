"""Bodies of JSON over HTTP.

These would catch: an internal error for a body that only JSON can express, and a body in which two values of `dry_run`
make one that moves a robot. They would also catch a route that reads its body in another way.
"""

from __future__ import annotations

import gzip
import json
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient

from service.http.access.roles import ServiceSettings, Tokens
from service.http.app import create_app
from service.http.routes.json_route import AT_ONCE
from tests.fuzz.formats import EXAMPLES

TOKEN = "only-for-the-tests-of-bodies"
VIEWER = "only-to-look-at-these-tests"


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[TestClient]:
    app = create_app(ServiceSettings(record=tmp_path_factory.mktemp("record"), tokens=Tokens(TOKEN, VIEWER)))
    with TestClient(app, base_url="http://127.0.0.1", raise_server_exceptions=False) as client:
        client.headers |= {"Authorization": f"Bearer {TOKEN}"}
        yield client


BODIES = {
    "digits": (b'{"campaign": {"seed": ' + b"9" * 400 + b"}}", "400 digits"),
    "nested": (b'{"campaign": {"a": ' + b"[" * 100_000 + b"]" * 100_000 + b"}}", "nested"),
    "twice": (b'{"campaign": {"a": 1}, "dry_run": true, "dry_run": false}', "dry_run"),
    "infinite": (b'{"campaign": {"settle_s": 1e999}}', "settle_s"),
    "nan": (b'{"campaign": {"settle_s": NaN}}', "settle_s"),
    "utf-16": ('{"campaign": {"a": 1}}'.encode("utf-16"), "UTF-16"),
    "latin-1": (b'{"campaign": {"a": "\xff"}}', "UTF-8"),
    "cut": (b'{"campaign": ', "JSON"),
    "large": (b'{"campaign": {"a": "' + b"x" * AT_ONCE + b'", "a": 1}}', "twice"),
}


@pytest.mark.parametrize("path", ["/runs", "/campaigns"])
@pytest.mark.parametrize("case", sorted(BODIES))
def test_a_body_that_cannot_be_used_is_refused_by_key(client: TestClient, case: str, path: str) -> None:
    body, word = BODIES[case]
    answer = client.post(f"/api/v1{path}", content=body, headers={"Content-Type": "application/json"})
    assert answer.status_code == 422, answer.text
    told = answer.json()
    assert answer.headers["content-type"] == "application/problem+json"
    assert word in told["detail"] + told.get("key", "")
    assert told["what_to_do"]


def test_what_is_said_to_be_500_mb_is_refused_before_it_comes(client: TestClient) -> None:
    said = {"Content-Length": str(500 * 1024 * 1024), "Content-Type": "multipart/form-data; boundary=x"}

    def nothing() -> Iterator[bytes]:
        raise AssertionError("the body was asked for")
        yield b""

    for path in ("/api/v1/datasets", "/api/v1/datasets/mapped", "/api/v1/alignments", "/api/v1/campaigns"):
        answer = client.post(path, content=nothing(), headers=said)
        assert answer.status_code == 413, answer.text
        assert answer.headers["content-type"] == "application/problem+json"


@pytest.mark.parametrize("encoding", ["gzip", "deflate", "br", "zstd"])
def test_nothing_that_is_sent_is_expanded(client: TestClient, encoding: str) -> None:
    """A kilobyte that says it is a gigabyte is refused as it is."""
    bomb = gzip.compress(b" " * 1_000_000 + b'{"campaign": {"a": 1}}')
    answer = client.post(
        "/api/v1/campaigns",
        content=bomb,
        headers={"Content-Type": "application/json", "Content-Encoding": encoding},
    )
    assert answer.status_code == 415
    sent = {"csv": ("a.csv.gz", bomb), "toml": ("a.toml", b"")}
    assert client.post("/api/v1/datasets", files=sent).status_code == 422


def test_every_route_reads_its_body_so(client: TestClient) -> None:
    """A repeated key is refused.

    Thousands of errors are not described one by one, because that would hold up the event loop.
    """
    thousands = json.dumps({f"k{number}": 0 for number in range(4000)}).encode()
    asked = 0
    for method, where, _ in taking_json(client):
        for content, word in ((b'{"a": 1, "a": 2}', "twice"), (thousands, "")):
            answer = client.request(
                method, where, content=content, headers={"Content-Type": "application/json"}
            )
            assert answer.status_code == 422, (where, answer.text)
            assert word in answer.json()["detail"], (where, answer.text)
            assert len(answer.content) < 20_000, where
        asked += 1
    assert asked > 8


def test_a_list_is_refused_for_its_first_wrong_value(client: TestClient) -> None:
    """The first wrong value is enough, because descriptions of 100,000 would hold up the loop.

    This holds for every list of every request.
    """
    lists = 0
    for method, where, schema in taking_json(client):
        for key, described in schema.get("properties", {}).items():
            if any(each.get("type") == "array" for each in [described, *described.get("anyOf", [])]):
                answer = client.request(method, where, json={key: [[{"wrong": 0}]] * 60})
                assert answer.status_code == 422, (where, key, answer.text)
                assert sum(f"{key}" in each["where"] for each in answer.json()["errors"]) < 9, (where, key)
                lists += 1
    assert lists > 3


def taking_json(client: TestClient) -> Iterator[tuple[str, str, dict[str, Any]]]:
    """Yield method, path and schema of every route that takes JSON.

    The OpenAPI document lists them, so future routes are included.
    """
    document = client.get("/openapi.json").json()
    for path, item in document["paths"].items():
        for method, operation in item.items():
            kinds = operation.get("requestBody", {}).get("content", {})
            if "application/json" in kinds:
                schema = kinds["application/json"]["schema"]
                name = schema.get("$ref", "").rpartition("/")[2]
                yield (
                    method,
                    re.sub(r"\{\w+\}", "x", path),
                    document["components"]["schemas"].get(name, schema),
                )


def test_a_damaged_file_of_the_record_is_named_and_takes_no_list_down(tmp_path: Path) -> None:
    with TestClient(
        create_app(ServiceSettings(record=tmp_path, tokens=Tokens(TOKEN, VIEWER))),
        base_url="http://127.0.0.1",
    ) as client:
        client.headers |= {"Authorization": f"Bearer {TOKEN}"}
        campaign = tomllib.loads((EXAMPLES / "irb120_faro" / "campaign.toml").read_text("utf-8"))
        ids = [
            client.post("/api/v1/campaigns", json={"campaign": campaign, "name": n}).json()["id"]
            for n in "abc"
        ]
        (tmp_path / "campaigns" / f"{ids[0]}.json").write_bytes(b"\0" * 100)
        (tmp_path / "campaigns" / f"{ids[1]}.json").write_text('{"id": 3}', "utf-8")
        for each in ids[:2]:
            told = client.get(f"/api/v1/campaigns/{each}")
            assert told.status_code == 500
            assert f"{each}.json" in told.json()["detail"]
        assert [each["id"] for each in client.get("/api/v1/campaigns").json()["campaigns"]] == [ids[2]]


def test_a_body_of_another_type_is_told_which_it_came_as(client: TestClient) -> None:
    sent = {"content": b'{"campaign": {}}', "headers": {"Content-Type": "application/x-www-form-urlencoded"}}
    answer = client.post("/api/v1/runs", **sent)
    assert answer.status_code == 422
    told = answer.json()["what_to_do"]
    assert told.startswith(
        "Send JSON, with Content-Type: application/json; it came as application/x-www-form"
    )
