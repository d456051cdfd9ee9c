"""Test spoiled requests of the OpenAPI document: an answer or a problem, never a fault.

The service has the cell of an example and no devices: no request can move anything, and no test waits for a
connection. The suite runs a short part by the seed, `make fuzz` 100,000 requests.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from random import Random
from typing import Any

import pytest
from fastapi.testclient import TestClient
from hypothesis import given, note
from hypothesis import strategies as st

from acquisition import read_cell
from calib import identify, read_dataset, save_model
from calib.text import replace_file
from mocks.campaign import make_campaign
from service.files import as_json
from service.http.access.roles import ServiceSettings, Tokens
from service.http.app import create_app
from service.http.wire.problems import MEDIA_TYPE
from service.job_folder import JOB, MODEL, RESULT
from tests.calib.campaigns import write_files
from tests.fuzz.formats import EXAMPLES
from tests.fuzz.requests import draw

TOKEN = "only-for-the-tests-of-requests"
VIEWER = "only-to-look-at-these-tests"
DONE = "20260101-000000-0001"


class Service:
    """Service in this process, with a finished job that has a good model."""

    def __init__(self, client: TestClient, files: dict[str, bytes]) -> None:
        self.client, self.files = client, files
        self.document: dict[str, Any] = client.get("/openapi.json").json()


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    folder = tmp_path_factory.mktemp("requests")
    campaign = make_campaign(seed=3, n=40, n_validation=6, effects=[])
    data = write_files(folder, campaign.rows, campaign.header)
    done = folder / "record" / "identifications" / DONE
    done.mkdir(parents=True)
    save_model(done / MODEL, identify(read_dataset(data)))
    job = {"id": DONE, "kind": "identification", "dataset_id": "x", "created_utc": "2026-01-01T00:00:00Z"}
    replace_file(done / JOB, as_json({**job, "data": str(data), "simulated": True, "cell": None}))
    replace_file(done / RESULT, as_json({"format": "truepose-identification/1"}))
    # an address where nobody listens: what would connect is refused at once
    text = (EXAMPLES / "irb120_faro" / "cell.toml").read_text("utf-8")
    (folder / "cell.toml").write_text(re.sub(r'url = "[^"]*"', 'url = "tcp://127.0.0.1:1"', text), "utf-8")
    settings_ = ServiceSettings(
        record=folder / "record", tokens=Tokens(TOKEN, VIEWER), cell=read_cell(folder / "cell.toml")
    )
    with TestClient(create_app(settings_), base_url="http://127.0.0.1") as client:
        client.headers |= {"Authorization": f"Bearer {TOKEN}"}
        files = {"csv": data.read_bytes(), "toml": data.with_suffix(".toml").read_bytes()}
        yield Service(client, files)


@given(seed=st.integers(0, 2**64 - 1))
def test_any_request(service: Service, seed: int) -> None:
    asked = draw(service.document, (DONE,), service.files, Random(seed))
    note(repr(asked)[:4000])
    answer = service.client.request(
        asked.method,
        asked.path,
        params=tuple(asked.params),
        headers=list(asked.headers.items()),
        content=asked.content,
        files=asked.files or None,
    )
    assert answer.status_code < 500, answer.text[:1000]
    if answer.status_code >= 400:
        assert answer.headers["content-type"] == MEDIA_TYPE, answer.text[:1000]
        assert answer.json()["what_to_do"]
