"""Fixtures that several test modules of the service share."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from acquisition.examination import meeting
from service.cli import main
from tests.service.benches import Bench, bench
from tests.service.browser import Page, browser
from tests.service.campaigns import write_data
from tests.service.test_http_support import Served


@pytest.fixture
def faro(tmp_path: Path) -> Iterator[Bench]:
    """The simulated cell of an IRB 120 and a FARO tracker."""
    with bench("irb120_faro", tmp_path) as made:
        yield made


@pytest.fixture
def impatience(monkeypatch: pytest.MonkeyPatch) -> None:
    """The two looks at a clock lie closer together than for people, who have half a second."""
    monkeypatch.setattr(meeting, "APART_S", 0.05)


@pytest.fixture(scope="module")
def window(service: Served, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    """Open the page of the module's `service` in a browser.

    Every tab has a separate token.
    """
    with browser(f"{service.url}/", tmp_path_factory.mktemp("browser") / "profile") as page:
        yield page


@pytest.fixture(scope="session")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A diagnosed IRB 120 with backlash in joint 4."""
    folder = tmp_path_factory.mktemp("model")
    path = folder / "m.json"
    assert main(["diagnose", str(write_data(folder)), "--model", str(path)]) == 0
    return path
