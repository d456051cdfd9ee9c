"""The operator page: what it may do, and a person at it, in a real browser without a window.

These would catch: a page that loads or sends anything elsewhere, a script its own policy forbids, a token that outlives
the window, a prompt that a stray Enter answers, a reason that is lost, and a stop that needs the mouse or the lease.
"""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx2
import pytest

from service.http.page import page_text, policy_of
from tests.drivers.waiting import until
from tests.end_to_end.simulated import campaign_file, cell_file
from tests.service.browser import CHROMIUM, Page, browser
from tests.service.test_http_support import TOKEN, Served, problem, served

in_a_browser = pytest.mark.skipif(CHROMIUM is None, reason="needs chromium")


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    folder = tmp_path_factory.mktemp("page")
    cell = cell_file(folder, time_scale=40.0)
    cell.write_text(cell.read_text("utf-8").replace("one_smr = false", "one_smr = true"), "utf-8")
    with served(folder / "record", "--cell", str(cell), "--simulate") as running:
        yield running


def test_it_needs_no_token_and_says_what_it_may_do(service: Served) -> None:
    answer = httpx2.get(f"{service.url}/")
    assert answer.status_code == 200
    assert answer.headers["content-type"].startswith("text/html")
    policy = answer.headers["content-security-policy"]
    assert policy.startswith("default-src 'none'; script-src 'sha256-")
    assert "unsafe" not in policy
    assert TOKEN not in answer.text
    assert httpx2.get(f"{service.url}/", headers={"Host": "evil.example"}).status_code == 403
    assert httpx2.post(f"{service.url}/").status_code == 405


def test_it_loads_nothing_and_writes_no_markup_from_data() -> None:
    page = page_text()
    addresses = set(re.findall(r"https?://[^\s\"'<]+", page))
    assert addresses == {"http://www.w3.org/2000/svg"}  # a name, which nobody fetches
    for way in ("innerHTML", "outerHTML", "insertAdjacentHTML", "document.write", "eval(", "localStorage"):
        assert way not in page
    assert not re.search(r"\s(src|on[a-z]+)=", page)
    assert policy_of(page) != policy_of(page.replace("use strict", "use Strict"))


def enter(page: Page) -> None:
    until(lambda: page.value("document.activeElement.id") == "token", 20.0)
    page.type(TOKEN)
    page.press("Enter")
    until(lambda: page.value("!document.querySelector('#desk').hidden"), 20.0)


def run_of(service: Served, folder: Path) -> str:
    file = campaign_file(folder, calibration=4, validation=1, warm_up_s=0.0, settle_s=0.5, samples=5)
    body: dict[str, Any] = {"campaign": tomllib.loads(file.read_text("utf-8")), "dry_run": False}
    answer = service.client.post("/runs", json=body)
    assert answer.status_code == 202, answer.text
    return answer.json()["id"]


@in_a_browser
def test_a_person_at_the_page(service: Served, tmp_path: Path) -> None:
    lease = {"Lease-Id": service.lease()["lease_id"]}
    run = run_of(service, tmp_path)
    with browser(f"{service.url}/", tmp_path / "browser") as page:
        enter(page)
        for name in ("N1", "N2", "N3"):
            until(lambda name=name: name in page.text("#question"), 20.0)
            page.press("Enter")  # by mistake: the focus is on the question, not on a button
            assert page.text("#question") == f"Seat the SMR in {name} and press confirm."
            assert page.value("document.activeElement.id") == "asking"
            page.press("Tab")
            assert page.value("document.activeElement.id") == "confirm"
            page.press("Enter")
        until(lambda: "T1" in page.text("#question"), 20.0)
        page.value("document.querySelector('#reason').focus()")
        page.type("the nest is bent")
        page.value("document.querySelector('[data-answer=skip]').click()")
        until(lambda: "1 skipped" in page.text("#done"), 20.0)
        answers = [e["data"] for e in events(service, run) if e["kind"] == "answer"]
        assert [each["answer"] for each in answers][:4] == ["confirm", "confirm", "confirm", "skip"]
        assert answers[3]["reason"] == "the nest is bent"
        answered = "skip by http (anna holds the lease): the nest is bent"
        until(lambda: answered in page.text("#events"), 20.0)

        page.value("document.querySelector('#pause').click()")
        until(lambda: page.text("#state") == "paused", 20.0)
        assert page.value("document.querySelector('#resume').disabled")  # somebody else has the lease
        assert page.value("document.querySelector('#take').disabled")
        page.value("document.querySelector('#name').focus()")
        page.type("bert")
        page.value("document.querySelector('#over').click()")
        until(lambda: page.text("#trouble") == "Say why you take it over.", 20.0)
        assert page.value("document.activeElement.id") == "because"
        page.type("anna has gone home")
        page.value("document.querySelector('#over').click()")
        until(lambda: page.text("#holder") == "You hold it as bert.", 20.0)
        told = problem(service.client.post("/cell/lease", json={"holder": "anna"}, headers=lease), 409)
        assert "bert, who has taken it over from anna (anna has gone home)" in told["detail"]
        goes_on_when_loaded_again(service, page)
        until(lambda: not page.value("document.querySelector('#resume').disabled"), 20.0)
        page.value("document.querySelector('#resume').click()")
        until(lambda: page.text("#state") == "waiting for operator", 20.0)
        page.press("Escape")
        until(lambda: page.text("#state") == "stopped", 20.0)
        assert page.text("#trouble") == ""
        assert page.value("Object.keys(sessionStorage).sort().join()") == "truepose-lease,truepose-token"
        assert page.value("localStorage.length") == 0
        violations = [
            each for each in page.told if each["method"] in ("Log.entryAdded", "Runtime.exceptionThrown")
        ]
        assert not violations, violations
        body = {"holder": "carl", "reason": "end of the test"}
        carl = service.client.post("/cell/lease/takeover", json=body).json()
        until(lambda: "held by carl, who has taken it over" in page.text("#trouble"), 20.0)  # bert is told
        assert page.text("#holder") == "carl holds it."
        assert page.value("sessionStorage.length") == 1
        service.client.delete("/cell/lease", headers={"Lease-Id": carl["lease_id"]})


def goes_on_when_loaded_again(service: Served, page: Page) -> None:
    """The page keeps the secret of its lease, and goes on prolonging it."""
    page.value("window.isOld = true")
    page.do("Page.reload")
    until(lambda: page.value("!window.isOld && document.readyState === 'complete'"), 20.0)
    until(lambda: page.text("#holder") == "You hold it as bert.", 20.0)

    def expires() -> str:
        held = service.client.get("/cell").json()["lease"]
        assert held["holder"] == "bert"
        return held["expires_utc"]

    before = expires()
    until(lambda: expires() > before, 20.0)
    assert page.text("#trouble") == ""


def events(service: Served, run: str) -> list[dict[str, Any]]:
    return [json.loads(line) for line in service.client.get(f"/runs/{run}/events.jsonl").text.splitlines()]


@in_a_browser
def test_a_wrong_token_opens_nothing_and_that_of_a_viewer_no_more_than_it_may(
    service: Served, tmp_path: Path
) -> None:
    with browser(f"{service.url}/", tmp_path / "browser") as page:
        until(lambda: page.value("document.activeElement.id") == "token", 20.0)
        page.type("wrong" * 5)
        page.press("Enter")
        until(lambda: page.text("#trouble") == "The token is not that of this service.", 20.0)
        assert page.value("document.querySelector('#desk').hidden")
        assert page.value("sessionStorage.length") == 0
        page.value("document.querySelector('#token').focus()")
        page.type(service.hello["viewer_token"])
        page.press("Enter")
        until(lambda: page.value("!document.querySelector('#viewer').hidden"), 20.0)
        until(lambda: page.text("#holder").startswith("Nobody holds it"), 20.0)
        for control in ("take", "name", "give"):
            assert page.value(f"document.querySelector('#{control}').disabled")
        assert not page.value("document.querySelector('#stop').disabled")
