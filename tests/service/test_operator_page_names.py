"""The operator page with markup in every name that a person may give, and gloved fingers.

These would catch: a name that becomes markup in any view, and a program that only a shell can correct. They would also
catch a deletion by a single touch or without its reason, and a second touch that answers the next prompt.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import pytest

from service.http.routes.pages.page import FOLDER
from tests.drivers.waiting import until
from tests.end_to_end.simulated import campaign_file, cell_file
from tests.service.browser import Page
from tests.service.campaigns import write_data
from tests.service.operator_page import ARMED, STATE, enter, in_a_browser, run_of, take_control
from tests.service.robot_programs import RAPID
from tests.service.test_http_support import Served, served
from tests.service.workplace import audit, open_view

HOSTILE = """<img src=x onerror="window.ran=1">'&{name}$&"""


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    folder = tmp_path_factory.mktemp("names")
    cell = cell_file(folder, time_scale=200.0, one_smr=True)
    text = cell.read_text("utf-8").replace('name = "irb120-faro"', f"name = '''{HOSTILE}'''")
    cell.write_text(text, "utf-8")
    with served(folder / "record", "--cell", str(cell), "--simulate") as running:
        yield running


@pytest.fixture(autouse=True)
def nobody_holds_the_lease(service: Served) -> Iterator[None]:
    """Free the lease after each test, even a failed one, because the tests share the service."""
    yield
    service.free()


def click(page: Page, selector: str) -> None:
    until(lambda: page.value(f'document.querySelector("{selector}")?.disabled === false || false'))
    page.click(selector)


def put(page: Page, selector: str, text: str) -> None:
    page.value(f'document.querySelector("{selector}").focus()')
    page.type(text)


def nothing_ran(page: Page) -> None:
    where = page.value("location.hash")
    assert page.value("window.ran === undefined && document.querySelectorAll('img').length === 0"), where
    assert page.text("#cell") == HOSTILE
    told = [each for each in page.told if each["method"] in ("Log.entryAdded", "Runtime.exceptionThrown")]
    assert not told, (where, told)


def result_of(service: Served, folder: Path) -> tuple[str, str]:
    """Return the ids of a data set with a hostile name and of an identification with limits."""
    data = write_data(folder, n=40)
    files = {"csv": data.read_bytes(), "toml": data.with_suffix(".toml").read_bytes()}
    dataset = service.client.post("/datasets", files=files, data={"name": HOSTILE}).json()["id"]
    body = {"dataset_id": dataset, "accept_rms_mm": 5.0}
    job = service.client.post("/identifications", json=body).json()["id"]
    assert service.until(f"/identifications/{job}", "succeeded", "failed")["state"] == "succeeded"
    return dataset, job


@in_a_browser
def test_no_name_is_markup_in_any_view_and_what_curl_can_do_a_person_can(
    service: Served, window: Page, tmp_path: Path
) -> None:
    dataset, job = result_of(service, tmp_path)
    file = campaign_file(tmp_path, calibration=4, validation=1)
    with file.open("rb") as content:
        service.client.post("/campaigns/file", files={"toml": content}, data={"name": HOSTILE})
    with window.another(f"{service.url}/#/cell") as page:
        enter(page)
        take_control(page, HOSTILE)
        assert page.text("#control .k") == HOSTILE
        until(lambda: HOSTILE in page.text("#plans"))
        page.value("document.querySelector('#plans').closest('details').open = true")
        page.click("#plans a")
        until(lambda: page.text("#title") == "Ready to measure")
        audit(page)
        nothing_ran(page)

        page.value(f"location.hash = '#/result/{job}'")
        until(lambda: page.text("#acceptance").startswith("Accepted"))
        audit(page)
        page.click("#to-correct")
        until(lambda: page.value("Boolean(document.querySelector('#program'))"))
        program = tmp_path / f"{HOSTILE}.mod"
        program.write_text(RAPID, "utf-8")
        saved = tmp_path / "saved"
        page.do("Page.setDownloadBehavior", behavior="allow", downloadPath=str(saved))
        page.choose("#program", program)
        until(lambda: "corrected" in page.text("#corrected"))
        if "cannot be corrected" in page.text("#corrected"):  # some are out of the arm's reach on purpose
            assert page.value("document.querySelectorAll('#corrected tbody tr').length") > 0
            click(page, "#keep-refused")
        click(page, "#download-program")
        until(lambda: any(each.suffix == ".mod" for each in saved.glob("*")))
        (done,) = saved.glob("*.mod")
        until(lambda: done.read_text("utf-8").startswith("%%%") and done.read_text("utf-8") != RAPID)
        page.click("#way-urdf")
        click(page, "#export-model")
        until(lambda: bool([*saved.glob("*.urdf")]))
        audit(page)
        nothing_ran(page)

        for view in ("report", "robots", "data"):
            open_view(page, view)
            until(lambda: page.text("#title") != "")
            nothing_ran(page)
        until(lambda: page.value("Boolean(document.querySelector('#datasets .more'))"))

        page.click("#datasets .more")
        page.click("#datasets .menu .bad")
        until(lambda: page.text("#ask h2") == f"Delete “{HOSTILE}”?")
        assert page.value("document.activeElement.id") == "ask-keep"
        audit(page)
        page.click("#ask-go")
        until(lambda: page.text("#trouble") == "Enter a reason.")
        assert len(service.client.get("/datasets").json()["datasets"]) == 1
        page.type(HOSTILE)  # the field has the focus
        page.click("#ask-go")
        until(lambda: not service.client.get("/datasets").json()["datasets"])
        line = service.client.get("/deletions").json()["deletions"][-1]
        assert (line["id"], line["by"], line["reason"]) == (dataset, HOSTILE, HOSTILE)
        page.click("#trail summary")
        until(lambda: HOSTILE in page.text("#trail td:last-child"))
        nothing_ran(page)
        page.click("#control")
        click(page, "#give")


def twice(page: Page, selector: str) -> None:
    """Pressed twice in quick succession, in the middle of it, through the browser's own input."""
    page.value(f"document.querySelector('{selector}').scrollIntoView({{ block: 'center' }})")
    x, y = page.value(
        f"(() => {{ const b = document.querySelector('{selector}').getBoundingClientRect();"
        " return [b.x + b.width / 2, b.y + b.height / 2]; })()"
    )
    for count in (1, 2):
        for kind in ("mousePressed", "mouseReleased"):
            page.do("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", clickCount=count)


@in_a_browser
def test_a_button_pressed_twice_answers_once_and_nothing_needs_hover(
    service: Served, window: Page, tmp_path: Path
) -> None:
    assert ":hover" not in (FOLDER / "page.css").read_text("utf-8")  # a finger cannot
    service.lease(holder=HOSTILE)
    with window.another(f"{service.url}/") as page:
        page.do("Emulation.setTouchEmulationEnabled", enabled=True, maxTouchPoints=5)
        page.width(390)
        enter(page)
        assert page.value("matchMedia('(pointer: coarse)').matches")
        run = run_of(service, tmp_path)
        until(lambda: "N1" in page.text("#question") and page.value(ARMED))
        assert page.value("document.querySelector('#confirm').getBoundingClientRect().height") >= 60.0
        twice(page, "#confirm")
        until(lambda: "N2" in page.text("#question") and page.value(ARMED))
        nothing_ran(page)
        twice(page, "#stop")
        until(lambda: page.value(STATE) == "stopped")
        assert page.text("#trouble") == ""
        events = service.client.get(f"/runs/{run}/events.jsonl").text.splitlines()
        answers = [json.loads(line)["data"] for line in events if json.loads(line)["kind"] == "answer"]
        assert [each["answer"] for each in answers] == ["confirm", "void"]  # the second question is void
