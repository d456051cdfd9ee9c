"""Files of other programs on the operator's page: chosen, asked about, read, diagnosed.

These would catch: a file that needs the command line, a question that cannot be answered with the keyboard, a name in
a file that becomes markup, an answer that is refused and stays, and readings that are kept before anybody said so.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.calib.exports import CASES, ROBOT, N
from tests.calib.exports.case import BODY, HEAD, grid, named, save
from tests.drivers.waiting import until
from tests.end_to_end.simulated import cell_file
from tests.service.browser import Page
from tests.service.campaigns import write_data
from tests.service.operator_page import enter, in_a_browser
from tests.service.test_http_support import Served, served
from tests.service.workplace import audit, enter_on, tab_to

HOSTILE = "<img src=x onerror=alert(1)>"
IDLE = "document.querySelector('#reading-file')?.textContent === ''"


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    folder = tmp_path_factory.mktemp("foreign")
    cell = cell_file(folder, time_scale=200.0, one_smr=True)
    with served(folder / "record", "--cell", str(cell), "--simulate") as running:
        yield running


@pytest.fixture
def page(service: Served, window: Page) -> Iterator[Page]:
    with window.another(f"{service.url}/#/data") as page:
        enter(page)
        until(lambda: page.value("Boolean(document.querySelector('#readings'))"))
        yield page


def named_field(name: str) -> str:
    return f"[data-name={json.dumps(name)}]"


def say(page: Page, name: str, value: str) -> None:
    """Choose or type an answer, and wait for the proposal that follows."""
    field = json.dumps(named_field(name))
    until(lambda: page.value(f"Boolean(document.querySelector({field}))"))
    page.value(
        f"(() => {{ const it = document.querySelector({field}); it.value = {json.dumps(value)};"
        " it.dispatchEvent(new Event('change')); })()"
    )
    until(lambda: page.value(IDLE))


def proposed(page: Page, *files: Path) -> None:
    page.choose("#readings", *files)
    until(lambda: page.text("#title") == "Is this file read correctly?")
    until(lambda: page.value(IDLE))


def datasets(service: Served) -> list[dict[str, Any]]:
    return service.client.get("/datasets").json()["datasets"]


def diagnosed(page: Page, service: Served) -> dict[str, Any]:
    """Wait until the page shows the diagnosis of the newest data set; the data set."""
    until(lambda: page.value("location.hash").startswith("#/diagnose/"))
    job = page.value("location.hash").rpartition("/")[2]
    newest = datasets(service)[0]
    assert service.client.get(f"/diagnoses/{job}").json()["dataset_id"] == newest["id"]
    return newest


@in_a_browser
def test_two_files_by_keyboard(service: Served, page: Page, tmp_path: Path) -> None:
    before = len(datasets(service))
    proposed(page, *next(case for case in CASES if case.name == "by_order").write(tmp_path))
    assert page.value("document.activeElement.id") == "title"
    assert page.text("#which-robot option:nth-child(2)") == f"{ROBOT} (of this cell)"
    assert page.value("document.querySelector('#use-readings').disabled")
    audit(page)
    tab_to(page, "#which-robot")
    say(page, "robot", ROBOT)
    assert page.value("document.activeElement.id") == "which-robot"  # still, though it was made anew
    tab_to(page, named_field("match=name"))
    page.value("document.querySelector('[data-name=\"match=order\"]').click()")
    until(lambda: page.value("!document.querySelector('#use-readings').disabled"))
    assert page.value("document.querySelector('[data-name=\"match=order\"]').checked")  # and may be changed
    audit(page)
    assert len(datasets(service)) == before  # nothing is kept yet
    enter_on(page, "#use-readings")
    made = diagnosed(page, service)
    assert (made["name"], made["readings"], made["robot"]) == ("joints", N, ROBOT)
    assert page.text("#trouble") == ""
    page.value("location.hash = '#/data'")
    until(lambda: "joints" in page.text("#datasets"))
    assert page.value("document.querySelector('#readings').checkVisibility()")  # no proposal is left over


@in_a_browser
def test_a_data_set_and_a_kept_map_go_straight_in(service: Served, page: Page, tmp_path: Path) -> None:
    data = write_data(tmp_path, n=40)
    page.choose("#readings", data, data.with_suffix(".toml"))
    assert diagnosed(page, service)["name"] == data.stem
    page.value("location.hash = '#/data'")
    until(lambda: page.value("Boolean(document.querySelector('#readings'))"))
    (file,) = next(case for case in CASES if case.name == "tabs_units").write(tmp_path)
    asked = {"files": (file.name, file.read_bytes())}
    proposal = service.client.post("/proposals", files=asked, data={"robot": ROBOT}).json()
    kept = save(tmp_path / "kept.map.toml", [proposal["map_text"]])
    page.choose("#readings", kept, file)
    until(lambda: len(datasets(service)) > 0 and datasets(service)[0]["name"] == file.stem)
    assert diagnosed(page, service)["readings"] == N


@in_a_browser
def test_a_column_is_said_to_be_another_and_a_refusal_is_undone(page: Page, tmp_path: Path) -> None:
    names = [*HEAD[:6], HOSTILE, "Y [mm]", "Z [mm]"]
    proposed(page, save(tmp_path / "<b>x.csv", named(names, grid(BODY))))
    say(page, "robot", ROBOT)
    assert "measured coordinates" in page.text(".note-box.ask")
    assert page.value("document.querySelector('#use-readings').disabled")
    audit(page)
    say(page, f"column.{HOSTILE}", "x")
    assert "a column for y" in page.text(".note-box.ask")
    for name, axis in (("Y [mm]", "y"), ("Z [mm]", "z")):
        say(page, f"column.{name}", axis)
    assert page.value("!document.querySelector('#use-readings').disabled")
    say(page, "column.Z [mm]", "y")  # as the other one
    assert "column.Z [mm]" in page.text("#trouble")
    assert page.value(f"document.querySelector('{named_field('column.Z [mm]')}').value") == "z"
    assert page.value("!document.querySelector('#use-readings').disabled")
    assert page.value("document.querySelectorAll('img').length") == 0
    page.click("#cancel-readings")
    assert page.value("document.querySelector('#readings').checkVisibility()")
    assert page.value("document.activeElement.id") == "readings"
    assert page.text("#title") == "Data and results"


@in_a_browser
def test_a_bad_cell_is_named_and_the_proposal_stays(service: Served, page: Page, tmp_path: Path) -> None:
    before = datasets(service)
    rows = grid(BODY)
    rows[6][2] = "12.5x"
    proposed(page, save(tmp_path / "a.csv", named(HEAD, rows)))
    say(page, "robot", ROBOT)
    page.click("#use-readings")
    until(lambda: page.text("#trouble") != "")
    assert "a.csv, line 8" in page.text("#trouble")
    assert "J3 [deg]" in page.text("#trouble")
    assert page.text("#title") == "Is this file read correctly?"
    assert datasets(service) == before
    page.click("#cancel-readings")
    for wrong, told in (
        (save(tmp_path / "words.txt", ["no table"] * 9), "holds no table"),
        (save(tmp_path / "only.toml", ["a = 1"]), "Choose a data set"),
    ):
        page.choose("#readings", wrong)
        until(lambda told=told: told in page.text("#trouble"))
        assert page.text("#title") == "Data and results"


@in_a_browser
def test_a_file_too_large_is_refused_and_the_connection_stays(page: Page, tmp_path: Path) -> None:
    large = tmp_path / "large.csv"
    with large.open("wb") as file:
        file.truncate(40 * 1024 * 1024)
    page.choose("#readings", large)
    until(lambda: "larger than 32 MB" in page.text("#trouble"))
    assert page.value("document.querySelector('#silence').hidden")


@in_a_browser
def test_a_viewer_is_offered_none(service: Served, page: Page) -> None:
    page.click("#out")
    until(lambda: page.value("document.activeElement.id") == "token")
    page.type(service.hello["viewer_token"])
    page.press("Enter")
    until(lambda: page.value("!document.querySelector('#viewer').hidden"))
    until(lambda: page.value("Boolean(document.querySelector('#datasets'))"))
    assert not page.value("document.querySelector('#readings')?.closest('.card').checkVisibility()")
