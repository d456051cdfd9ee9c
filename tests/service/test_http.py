"""The service without devices: who may ask, what is refused and how, what is kept."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

import httpx2
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from service.http.access.lanes import BODY_BYTES
from service.http.access.roles import UPLOAD_BYTES
from tests.service.test_http_support import ROOT, TOKEN, Served, problem, served

CELL = ROOT / "examples" / "irb120_faro" / "cell.toml"
BLOCK: dict[str, Any] = {"set": "calibration", "count": 2, "select": "random"}
CAMPAIGN: dict[str, Any] = {"format": "truepose-campaign/1", "block": [BLOCK]}


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    with served(tmp_path_factory.mktemp("record"), "--cell", str(CELL)) as running:
        yield running


# -- who may ask ----------------------------------------------------------------------------------------------


def test_health_needs_no_token_and_everything_else_does(service: Served) -> None:
    bare = service.anybody
    assert bare.get("/api/v1/health").json()["status"] == "ok"
    paths = bare.get("/openapi.json").json()["paths"]
    assert len(paths) > 15
    for path, item in paths.items():
        for method in item:
            if not path.endswith("/health"):
                answer = bare.request(method.upper(), path.replace("{", "").replace("}", ""))
                assert problem(answer, 401)["code"] == 8001
                assert answer.headers["www-authenticate"] == "Bearer"
    problem(bare.get("/api/v1/nowhere"), 401)


@pytest.mark.parametrize(
    "header", ["Bearer wrong", f"Basic {TOKEN}", f"Bearer {TOKEN[:-1]}", f"Bearer {TOKEN}x", TOKEN, "Bearer"]
)
def test_a_wrong_token_is_refused(service: Served, header: str) -> None:
    problem(service.anybody.get("/api/v1/cell", headers={"Authorization": header}), 401)


@pytest.mark.parametrize(
    "headers",
    [
        {"Host": "evil.example"},
        {"Host": "evil.example:80"},
        {"Host": "10.0.0.7"},
        {"Origin": "http://evil.example"},
        {"Origin": "null"},
        {"Origin": "http://127.0.0.1:1"},
    ],
)
def test_a_page_from_elsewhere_cannot_ask(service: Served, headers: dict[str, str]) -> None:
    """Even with the token: DNS rebinding shows in the Host header, another page in the Origin."""
    problem(service.client.get("/cell", headers=headers), 403)
    problem(service.client.post("/cell/lease", headers=headers, json={"holder": "eve"}), 403)


def test_our_own_page_can_ask(service: Served) -> None:
    assert service.client.get("/cell", headers={"Origin": service.url}).status_code == 200


# -- what is refused, and how -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "where"),
    [
        ('{"campaign": {"block": [{"select": "list", "joints_deg": [[NaN, 0, 0, 0, 0, 0]]}]}}', "joints_deg"),
        ('{"dry_run": NaN, "campaign": {"format": "x"}}', "dry_run"),
        ('{"dry_run": 0, "campaign": {"format": "x"}}', "dry_run"),
        ('{"dry_run": "false", "campaign": {"format": "x"}}', "dry_run"),
        ('{"dry_run": null, "campaign": {"format": "x"}}', "dry_run"),
        ('{"dry_run": false}', "campaign"),
        ('{"campaign": {"format": "x"}, "campaign_id": "y"}', "campaign"),
        ('{"campaign": {"format": "x"}, "speed": 1}', "speed"),
        ('{"campaign": {"format": null}}', "campaign.format"),
        ('{"campaign": {"format": "\\ud800"}}', "campaign.format"),
        ("{", "body"),
        ("[]", "body"),
        ("", "body"),
    ],
)
def test_a_wrong_body_is_a_problem_that_names_the_place(service: Served, text: str, where: str) -> None:
    answer = service.client.post("/runs", content=text, headers={"Content-Type": "application/json"})
    assert where in problem(answer, 422)["detail"]


@pytest.mark.parametrize("value", ["NaN", "Infinity", "1e999"])
def test_a_joint_that_is_no_number_is_refused(service: Served, value: str) -> None:
    block = {"set": "calibration", "select": "list", "joints_deg": [[0, 0, 0, 0, 31.5, 0]]}
    text = json.dumps({"campaign": CAMPAIGN | {"block": [block]}}).replace("31.5", value)
    answer = service.client.post("/runs", content=text, headers={"Content-Type": "application/json"})
    assert "joints_deg" in problem(answer, 422)["detail"]


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"block": [BLOCK | {"select": "file", "file": "/etc/passwd"}]}, "file"),
        ({"block": [BLOCK | {"count": 900_000}]}, "900000"),
        ({"block": [BLOCK | {"targets": ["T9"]}]}, "T9"),
        ({"warm_up": 3}, "warm_up"),
    ],
)
def test_a_campaign_that_cannot_be_is_refused(service: Served, change: dict[str, Any], word: str) -> None:
    assert word in problem(service.client.post("/runs", json={"campaign": CAMPAIGN | change}), 422)["detail"]


def test_an_unsafe_pose_is_refused_with_its_name(service: Served) -> None:
    block = {"set": "calibration", "select": "list", "joints_deg": [[0, 170, 0, 0, 30, 0]]}
    told = problem(service.client.post("/runs", json={"campaign": CAMPAIGN | {"block": [block]}}), 422)
    assert told["code"] == 3102
    assert "joint 2" in told["detail"]


@pytest.mark.parametrize(
    "path",
    [
        "/runs/20260101-000000-00000000",
        "/runs/..%2f..%2fetc",
        "/runs/%00",
        "/runs/nothing/prompts",
        "/runs/nothing/events",
        "/campaigns/nothing",
        "/datasets/nothing",
        "/datasets/nothing/data.csv",
        "/diagnoses/nothing",
        "/identifications/nothing",
        "/reports/..",
        "/reports/nothing",
        "/models/nothing",
        "/loops/nothing",
        "/loops/..",
        "/runs/nothing/events.jsonl",
        "/nothing",
    ],
)
def test_what_is_not_there_is_404(service: Served, path: str) -> None:
    problem(service.client.get(path), 404)


def test_orders_to_runs_that_are_not_there_are_404(service: Served) -> None:
    service.lease()
    for verb in ("pause", "resume", "stop", "dataset", "restation", "prompts/p/confirm"):
        problem(service.client.post(f"/runs/nothing/{verb}"), 404)
    for verb in ("pause", "resume", "stop"):
        problem(service.client.post(f"/loops/nothing/{verb}"), 404)
    problem(service.client.post("/diagnoses", json={"dataset_id": "nothing"}), 404)
    problem(service.client.request("PATCH", "/runs"), 405)
    service.client.delete("/cell/lease")


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner, max_size=3),
    max_leaves=8,
)
KEYS = ("campaign", "campaign_id", "dry_run", "name", "holder", "seconds", "dataset_id", "format", "block")


@settings(max_examples=80)
@given(
    path=st.sampled_from(
        ["/runs", "/loops", "/campaigns", "/cell/lease", "/diagnoses", "/identifications", "/datasets"]
    ),
    body=JSON | st.dictionaries(st.sampled_from(KEYS), JSON, max_size=4),
)
def test_every_refusal_is_a_problem(service: Served, path: str, body: object) -> None:
    text = json.dumps(body).encode("utf-8", "surrogatepass")
    answer = service.client.post(path, content=text, headers={"Content-Type": "application/json"})
    if answer.status_code >= 400:
        assert answer.status_code < 500
        problem(answer, answer.status_code)
    elif path == "/cell/lease":
        service.client.delete("/cell/lease", headers={"Lease-Id": answer.json()["lease_id"]})


# -- dry runs, campaigns, keys ----------------------------------------------------------------------------------


def test_a_dry_run_is_the_default_and_moves_nothing(service: Served) -> None:
    answer = service.client.post("/runs", json={"campaign": CAMPAIGN})
    assert answer.status_code == 202
    assert answer.headers["retry-after"] == "1"
    run = service.client.get(service.url + answer.headers["location"]).json()
    assert (run["dry_run"], run["state"], run["state_code"], run["done"], run["total"]) == (
        True,
        "succeeded",
        5,
        0,
        6,
    )
    assert service.client.get("/cell").json()["run_id"] is None
    service.lease()
    for verb in ("pause", "resume", "stop", "dataset", "restation"):
        problem(service.client.post(f"/runs/{run['id']}/{verb}"), 409)
    service.client.delete("/cell/lease")


def test_a_key_makes_one_resource(service: Served) -> None:
    order = {"campaign": CAMPAIGN, "name": "twice"}
    key = {"Idempotency-Key": "campaign-1"}
    first, second = (service.client.post("/campaigns", json=order, headers=key) for _ in range(2))
    assert first.status_code == second.status_code == 201
    assert first.json() == second.json()
    assert first.headers["location"] == second.headers["location"]
    problem(service.client.post("/campaigns", json=order | {"name": "x"}, headers=key), 422)
    kept = service.client.get("/campaigns").json()["campaigns"]
    assert [each["name"] for each in kept].count("twice") == 1
    run = service.client.post("/runs", json={"campaign_id": first.json()["id"]})
    assert run.json()["total"] == 6


def test_a_refused_request_frees_its_key(service: Served) -> None:
    key = {"Idempotency-Key": "campaign-2"}
    problem(service.client.post("/campaigns", json={"campaign": {"format": "x"}}, headers=key), 422)
    assert service.client.post("/campaigns", json={"campaign": CAMPAIGN}, headers=key).status_code == 201


@pytest.mark.parametrize(
    ("path", "kind", "most", "words"),
    [
        ("/runs", "application/json", BODY_BYTES, "1 MB"),
        ("/datasets", "multipart/form-data; boundary=here", UPLOAD_BYTES, "32 MB"),
    ],
)
def test_too_much_is_413(service: Served, path: str, kind: str, most: int, words: str) -> None:
    def post(content: Any) -> httpx2.Response:
        return service.client.post(path, content=content, headers={"Content-Type": kind})

    begin = b'--here\r\nContent-Disposition: form-data; name="csv"; filename="a.csv"\r\n\r\n'
    assert words in problem(post(begin + b"x" * most), 413)["detail"]
    piece = b"x" * (most // 4)

    def pieces() -> Iterator[bytes]:  # sent without a length
        yield begin
        for _ in range(5):
            yield piece

    assert words in problem(post(pieces()), 413)["detail"]


# -- the description --------------------------------------------------------------------------------------------


def test_openapi_suits_client_generators(service: Served) -> None:
    document = service.anybody.get("/openapi.json").json()
    operations = [op for item in document["paths"].values() for op in item.values()]
    names = [op["operationId"] for op in operations]
    assert len(set(names)) == len(names)
    assert all("_" not in name for name in names)
    text = json.dumps(document)
    assert "itemSchema" not in text  # what FastAPI says of a stream, which generators refuse
    assert "HTTPValidationError" not in text
    for name in (
        "NewRun",
        "NewLoop",
        "NewCampaign",
        "LeaseRequest",
        "ToDiagnose",
        "ToIdentify",
        "ReasonBody",
        "DatasetExportRequest",
        "TargetsToCorrect",
    ):
        assert "anyOf" not in json.dumps(document["components"]["schemas"][name])
    assert document["components"]["schemas"]["NewRun"]["properties"]["dry_run"]["default"] is True
    assert all("default" in op["responses"] for op in operations)


def test_no_page_loads_anything_from_elsewhere(service: Served) -> None:
    problem(service.anybody.get("/redoc", headers=service.client.headers), 404)
