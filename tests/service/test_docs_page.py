"""The page of the description, in a real browser without a window.

These would catch: a page that requests anything from another server, and one that its own policy forbids to work. They
would also catch a request that is tried on the page and sent without the token.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.drivers.waiting import until
from tests.service.browser import CHROMIUM, Page, browser
from tests.service.test_http_support import TOKEN, Served, problem, served


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    with served(tmp_path_factory.mktemp("docs")) as running:
        yield running


def test_it_needs_no_token_and_may_do_little(service: Served) -> None:
    for path in ("/docs", "/docs/docs.js", "/docs/swagger-ui-bundle.js", "/docs/swagger-ui.css"):
        answer = service.anybody.get(path)
        assert answer.status_code == 200
        policy = answer.headers["content-security-policy"]
        assert "default-src 'none'; script-src 'self'; " in policy
        assert "unsafe" not in policy
        assert answer.headers["x-content-type-options"] == "nosniff"
        assert TOKEN not in answer.text
    for path in ("/docs/LICENSE", "/docs/..%2f..%2fcli.py", "/docs/%2e%2e/%2e%2e/cli.py", "/docs/docs.js/x"):
        problem(service.anybody.get(path), 404)
    assert service.anybody.get("/docs", headers={"Host": "evil.example"}).status_code == 403


@pytest.mark.skipif(CHROMIUM is None, reason="needs chromium")
def test_a_request_is_tried_with_the_token(service: Served, tmp_path: Path) -> None:
    with browser(f"{service.url}/docs", tmp_path / "browser") as page:
        page.do("Network.enable")
        shown(page, ".opblock")
        assert page.value("document.querySelectorAll('.opblock').length") > 35
        click(page, "button.authorize")
        shown(page, ".auth-container input")
        page.value("document.querySelector('.auth-container input').focus()")
        page.type(TOKEN)
        click(page, ".auth-btn-wrapper .authorize")
        click(page, ".btn-done")
        click(page, "[id$='-listCampaigns'] .opblock-summary-control")
        click(page, "[id$='-listCampaigns'] .try-out__btn")
        click(page, "[id$='-listCampaigns'] .execute")
        answer = "[id$='-listCampaigns'] .live-responses-table .highlight-code"
        shown(page, answer)
        assert json.loads(page.value(f'document.querySelector("{answer} code").textContent')) == {
            "campaigns": []
        }
        asked = [
            each["params"]["request"]["url"]
            for each in page.told
            if each["method"] == "Network.requestWillBeSent"
        ]
        assert asked
        assert {url.split("/")[2] for url in asked if not url.startswith("data:")} == {
            service.url.split("/")[2]
        }
        # what the policy forbids, or a script cannot do, is told in the log
        assert [
            each for each in page.told if each["method"] in ("Log.entryAdded", "Runtime.exceptionThrown")
        ] == []


def shown(page: Page, selector: str) -> None:
    until(lambda: page.value(f"document.querySelector({json.dumps(selector)}) !== null"))


def click(page: Page, selector: str) -> None:
    shown(page, selector)
    page.click(selector)
