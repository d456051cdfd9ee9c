"""A browser at the operator page: how it is entered, and a run to look at."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from tests.drivers.waiting import until
from tests.end_to_end.simulated import campaign_file, cell_file
from tests.service.browser import CHROMIUM, Page, browser
from tests.service.test_http_support import TOKEN, Served, served

in_a_browser = pytest.mark.skipif(CHROMIUM is None, reason="needs chromium")

ARMED = "document.querySelector('#confirm').getAttribute('aria-disabled') === 'false'"


def entered(page: Page) -> bool:
    """Report whether the desk is open.

    The token is entered again if the service was too slow for the page.
    """
    if page.value("document.querySelector('#desk').hidden && document.querySelector('#token').value === ''"):
        page.value("document.querySelector('#token').focus()")
        page.type(TOKEN)
        page.press("Enter")
    return page.value("!document.querySelector('#desk').hidden")


def enter(page: Page) -> None:
    until(lambda: page.value("document.activeElement.id") == "token")
    page.type(TOKEN)
    page.press("Enter")
    until(lambda: page.value("!document.querySelector('#desk').hidden"))


@contextmanager
def at_the_page(folder: Path) -> Iterator[tuple[Served, Page]]:
    """Open the page of a service whose cell has one SMR, and enter it.

    The page is as impatient as it is for a person.
    """
    cell = cell_file(folder, time_scale=40.0, one_smr=True)
    with (
        served(folder / "record", "--cell", str(cell), "--simulate") as service,
        browser(f"{service.url}/", folder / "browser", patient=False) as page,
    ):
        until(lambda: entered(page))
        yield service, page


STATE = "document.querySelector('#title')?.dataset.state ?? ''"


def answerable(page: Page) -> bool:
    """Report whether a question is shown whose answers are armed."""
    return page.value(f"!(document.querySelector('#asking')?.hidden ?? true) && {ARMED}")


def take_control(page: Page, name: str) -> None:
    """Take control of the robot in the strip, which nobody has."""
    until(lambda: page.text("#holder") == "No one is in control")
    page.click("#control")
    page.value("document.querySelector('#name').focus()")
    page.type(name)
    page.press("Enter")
    until(lambda: page.text("#holder") == "You are in control")


def run_of(service: Served, folder: Path) -> str:
    file = campaign_file(folder, calibration=4, validation=1, warm_up_s=0.0, settle_s=0.5, samples=5)
    body: dict[str, Any] = {"campaign": tomllib.loads(file.read_text("utf-8")), "dry_run": False}
    answer = service.client.post("/runs", json=body)
    assert answer.status_code == 202, answer.text
    return answer.json()["id"]


def events(service: Served, run: str) -> list[dict[str, Any]]:
    return [json.loads(line) for line in service.client.get(f"/runs/{run}/events.jsonl").text.splitlines()]
