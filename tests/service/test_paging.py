"""Test lists page by page: `limit`, `cursor`, and the `Link` to the next page.

These would catch: an item that is missed or comes twice because others were added or deleted between two pages. They
would also catch a list that differs from its pages together, and a made-up cursor that is a fault of the program.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from typing import Any

import pytest
from fastapi.testclient import TestClient
from hypothesis import given, settings
from hypothesis import strategies as st
from starlette.datastructures import URL

from acquisition.errors import RecordError
from service.http.access.roles import ServiceSettings, Tokens
from service.http.app import create_app
from service.http.wire.problems import Problem, not_found
from service.http.work.paging import ListPage
from tests.service.campaigns import write_data
from tests.service.test_history import model_of
from tests.service.test_robots_http import document

FOREVER = "a trial; it is not needed"
CAMPAIGN = {
    "format": "truepose-campaign/1",
    "block": [{"set": "calibration", "select": "random", "count": 3}],
}


@given(
    keys=st.sets(st.text("abcdef-0", min_size=1, max_size=5), min_size=1, max_size=30),
    changes=st.lists(
        st.tuples(st.sets(st.text("abcdef-0", min_size=1, max_size=5)), st.sets(st.integers(0, 29)))
    ),
    limit=st.integers(1, 7),
    newest_first=st.booleans(),
)
@settings(deadline=None)
def test_what_exists_all_the_time_is_on_one_page(
    keys: set[str], changes: list[tuple[set[str], set[int]]], limit: int, newest_first: bool
) -> None:
    now, always, pages = set(keys), set(keys), list[str]()
    steps, after = iter(changes), ""
    while True:
        page = ListPage(limit, after, URL("/list?limit=1"), linked=True)
        items, after = page.take(
            sorted(now, reverse=newest_first), lambda key: {"id": key}, newest_first=newest_first
        )
        assert len(items) <= limit
        pages += [each["id"] for each in items]
        assert len(set(pages)) == len(pages)  # also ends a list that does not go on
        if not after:
            break
        added, gone = next(steps, (set(), set()))
        names = sorted(now)
        deleted = {names[i] for i in gone if i < len(names)}
        now = (now - deleted) | added
        always -= deleted
    assert always <= set(pages)
    assert pages == sorted(pages, reverse=newest_first)


def test_items_that_are_damaged_or_gone_are_left_out_and_leave_a_page_full() -> None:
    def read(key: str) -> dict[str, Any]:
        if key == "e":
            raise not_found("run", key)
        if key == "d":
            raise RecordError("a folder without a record")
        if key == "c":
            raise Problem(500, "damaged", "Restore it.", code=8501)
        return {"id": key}

    page = ListPage(2, "", URL("/list"), linked=True)
    assert page.take("fedcba", read) == ([{"id": "f"}, {"id": "b"}], "b")
    with pytest.raises(Problem, match="ends"):
        page.take("a", lambda key: (_ for _ in ()).throw(Problem(503, "the service ends", "Later.")))


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[TestClient]:
    """A service with some of everything that needs no robot."""
    record = tmp_path_factory.mktemp("record")
    data = write_data(tmp_path_factory.mktemp("data"), n=20)
    for folder in ("watches", "watch-plans", "upkeeps"):
        for n in range(3):
            own = record / folder / f"2026112{n}-170459-3f9a1c07b2e"
            own.mkdir(parents=True)
            kind = {"watches": "watch", "watch-plans": "watch_plan", "upkeeps": "upkeep"}[folder]
            job = {"id": own.name, "kind": kind, "created_utc": "2026-11-21T17:04:59.120Z", "dataset_id": ""}
            (own / "job.json").write_text(json.dumps(job), "utf-8")
    app = create_app(ServiceSettings(record, Tokens("o", "v")))
    own = {"Authorization": "Bearer o"}
    with TestClient(app, base_url="http://127.0.0.1/api/v1", headers=own) as client:
        for n in range(5):
            files = {"csv": data.read_bytes(), "toml": data.with_suffix(".toml").read_bytes()}
            assert client.post("/datasets", files=files, data={"name": f"{n}"}).status_code == 201
            assert client.post("/campaigns", json={"campaign": CAMPAIGN}).status_code == 201
        for each in client.get("/datasets").json()["datasets"][:4]:
            asked = client.delete(f"/datasets/{each['id']}", params={"reason": FOREVER})
            assert asked.status_code == 200, asked.text
        yield client


LISTS = {
    "/datasets": 1, "/campaigns": 5, "/deletions": 4, "/watches": 3, "/watch-plans": 3, "/upkeeps": 3, "/runs": 0,
    "/loops": 0, "/verifications": 0, "/robots": 0,
}  # fmt: skip


@pytest.mark.parametrize("path", LISTS)
def test_the_pages_of_a_list_are_the_whole(client: TestClient, path: str) -> None:
    whole = client.get(path)
    member = path[1:].replace("-", "_")
    assert len(whole.json()[member]) == LISTS[path]
    assert "link" not in whole.headers
    found, query = list[Any](), f"{path}?limit=2"
    while query:
        page = client.get(query)
        assert page.status_code == 200, page.text
        assert len(page.json()[member]) <= 2
        found += page.json()[member]
        link = re.fullmatch(r'<(/api/v1/\S+)>; rel="next"', page.headers.get("link", "<>"))
        query = "" if link is None else link[1].removeprefix("/api/v1")
    assert found == whole.json()[member]
    assert client.get(f"{path}?limit=500").json()[member] == found


def test_jobs_of_a_data_set_are_paged(client: TestClient) -> None:
    (kept,) = client.get("/datasets").json()["datasets"]
    for _ in range(3):
        assert client.post("/identifications", json={"dataset_id": kept["id"]}).status_code == 202
    path = f"/datasets/{kept['id']}/jobs"
    whole = [each["id"] for each in client.get(path).json()["jobs"]]
    first = client.get(path, params={"limit": 2})
    rest = client.get(re.findall("<(.*)>", first.headers["link"])[0].removeprefix("/api/v1"))
    assert len(whole) == 3
    assert [each["id"] for each in (*first.json()["jobs"], *rest.json()["jobs"])] == whole
    assert client.get("/datasets/none/jobs").status_code == 404


def test_other_parameters_stay_in_the_link_and_robots_are_paged_by_id(client: TestClient) -> None:
    for serial in ("120-1", "120-2", "120-3"):
        sent = {"file": ("d.json", document(model_of(0.1), "2026-03-02", serial))}
        assert client.post("/documents", files=sent).status_code == 201
    first = client.get("/robots", params={"limit": 2, "permitted_mm": 0.3})
    assert "permitted_mm=0.3" in first.headers["link"]
    assert first.json()["left_out"] == 1
    rest = client.get(re.findall("<(.*)>", first.headers["link"])[0].removeprefix("/api/v1"))
    found = [each["id"] for each in (*first.json()["robots"], *rest.json()["robots"])]
    assert found == sorted({each["id"] for each in client.get("/robots").json()["robots"]})
    assert "link" not in rest.headers


@pytest.mark.parametrize(
    "cursor", ["x", "%%%", "L2FwaS92MS9ydW5zCmE", "L2FwaS92MS9jYW1wYWlnbnMK", "\N{SNOWMAN}", "_w"]
)
def test_a_cursor_of_something_else_is_refused_with_what_to_do(client: TestClient, cursor: str) -> None:
    refused = client.get("/campaigns", params={"cursor": cursor})
    assert refused.status_code == 422
    assert refused.json()["key"] == "cursor"
    assert "Link" in refused.json()["what_to_do"]


@pytest.mark.parametrize("limit", [-1, 501, "a"])
def test_a_limit_that_cannot_be_is_refused(client: TestClient, limit: object) -> None:
    assert client.get("/campaigns", params={"limit": str(limit)}).status_code == 422
