"""A whole campaign at the operator page, by keyboard, in a real browser without a window.

The browser has no WebGL. These would catch: a step for which one still needs curl or a mouse, and a view that axe
refuses or a telephone cuts off. They would also catch a word that the table lacks, markup in a name that becomes
markup, a second tab that gets an answer wrong, and a service that comes back and moves something.
"""

from __future__ import annotations

import math
import re
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest

from service.http.routes.pages.page import FOLDER, MODULES
from tests.drivers.waiting import until
from tests.end_to_end.simulated import campaign_file, cell_file
from tests.service.browser import Page
from tests.service.operator_page import ARMED, STATE, answerable, enter, in_a_browser, take_control
from tests.service.test_http_support import Served, lasting_port, served
from tests.service.workplace import audit, enter_on, open_view, reachable, tab_to

HOSTILE = "<img src=x onerror=alert(1)>"


@pytest.fixture(scope="module")
def cell(tmp_path_factory: pytest.TempPathFactory) -> Path:
    cell = cell_file(tmp_path_factory.mktemp("workplace"), time_scale=200.0, one_smr=True)
    text = cell.read_text("utf-8")
    cell.write_text(text.replace("keep_out = []", "keep_out = [[[250, 350, 20], [450, 500, 220]]]"), "utf-8")
    return cell


@pytest.fixture(scope="module")
def service(cell: Path) -> Iterator[Served]:
    with served(cell.parent / "record", "--cell", str(cell), "--simulate") as running:
        yield running


def campaign(folder: Path, name: str) -> Path:
    file = campaign_file(folder, calibration=20, validation=4, warm_up_s=0.0, settle_s=0.5, samples=5)
    text = file.read_text("utf-8").replace('targets = ["T1", "T2", "T3"]', 'targets = ["T2"]')
    named = folder / f"{name}.toml"
    named.write_text(text.replace("reference_every = 25", "reference_every = 0"), "utf-8")
    return named


def confirm(page: Page, name: str) -> None:
    until(lambda: name in page.text("#question") and answerable(page))
    enter_on(page, "#confirm")


@in_a_browser
def test_a_whole_campaign_by_keyboard(service: Served, window: Page, tmp_path: Path) -> None:
    with window.another(f"{service.url}/#/cell") as page:
        enter(page)
        assert page.value("document.createElement('canvas').getContext('webgl')") is None
        until(lambda: "no WebGL" in page.text(".no3d") and "N3" in page.text(".no3d"))
        audit(page)

        page.choose("#file", campaign(tmp_path, HOSTILE.replace("/", "")))
        until(lambda: page.text("#title") == "Ready to measure")  # by itself: nothing moves
        assert HOSTILE in page.text("#steps")
        assert page.value("document.querySelectorAll('img').length") == 0
        assert "24 readings" in page.text("#desk .facts")
        assert page.value("document.querySelectorAll('.pose-list li').length") == 24
        audit(page)
        enter_on(page, "#start")
        assert page.value("document.activeElement.id") == "seen"  # nobody has looked into the cell
        page.click("#seen")
        enter_on(page, "#desk .more")
        assert page.text("#measure-only") == "Measure and diagnose only: the robot moves"
        page.press("Enter")
        until(lambda: page.text("#trouble") == "Enter your name first.")
        page.type("anna")
        tab_to(page, "#desk .more")
        page.press("Enter")
        page.press("Enter")
        until(lambda: page.text("#holder") == "You are in control")
        assert page.text("#control .k") == "anna"
        for name in ("N1", "N2"):
            confirm(page, name)
        until(lambda: "N3" in page.text("#question"))
        assert "N3" in page.text(".prompt-picture .strong")
        audit(page)
        leaves_one_out(page)
        confirm(page, "N3")
        confirm(page, "T2")
        run = page.value("location.hash")
        until(lambda: page.value("location.hash").startswith("#/diagnose/"))  # the data set, too, by itself
        until(lambda: page.value(STATE) == "succeeded")
        until(lambda: page.value("document.querySelectorAll('.pose-list li').length") == 4)  # held out
        assert "As found" in page.text(".ladder")
        arrows_are_the_errors(service, page.value("location.hash").rpartition("/")[2])
        audit(page)
        here = page.value("location.hash")
        page.value(f"location.hash = '{run}'")
        until(lambda: page.text("#see-result") == "See the result")
        assert "1 skipped" in page.text("#done")
        assert "mm off" in page.text("#reading")
        until(lambda: page.value("document.querySelector('#run .errors').dataset.points") == "23")
        audit(page)
        page.value(f"location.hash = '{here}'")
        for step in ("correct", "verify"):
            until(lambda step=step: page.value(f"Boolean(document.querySelector('#to-{step}'))"))
            tab_to(page, f"#to-{step}")
            page.press("Enter")
            until(lambda step=step: page.value("location.hash").startswith(f"#/{step}/"))
            audit(page)
        until(lambda: page.value("Boolean(document.querySelector('#open-report'))"))
        tab_to(page, "#open-report")
        page.press("Enter")
        until(
            lambda: page.value("Boolean(document.querySelector('#report')?.shadowRoot?.querySelector('h1'))")
        )
        inside = "document.querySelector('#report').shadowRoot"
        assert page.value(f"getComputedStyle({inside}.querySelector('.simulated')).borderTopWidth") == "2px"
        assert page.value(f"{inside}.querySelectorAll('script, [onload], [onclick]').length") == 0
        for view in ("robots", "report", "data"):
            open_view(page, view)
            until(lambda: page.value("Boolean(document.querySelector('#desk a.do'))"))
            audit(page)
        troubles = [
            each for each in page.told if each["method"] in ("Log.entryAdded", "Runtime.exceptionThrown")
        ]
        assert not troubles, troubles
        service.client.post(
            "/cell/lease/takeover", json={"holder": "test", "reason": "the end", "seconds": 1.0}
        )


def arrows_are_the_errors(service: Served, job: str) -> None:
    """Their lengths have the RMS that the result states, before and after."""
    drawn = service.client.get(f"/results/{job}/arrows").json()
    stated = service.client.get(f"/results/{job}").json()["result"]
    assert (drawn["held_out"], drawn["readings"]) == (True, 4)
    for which, errors in (("nominal_mm", "error_nominal_mm"), ("model_mm", "error_after_mm")):
        lengths = [math.hypot(*each[which]) for each in drawn["arrows"]]
        rms = math.sqrt(sum(length**2 for length in lengths) / len(lengths))
        assert rms == pytest.approx(stated[errors]["rms"], rel=2e-3)


def leaves_one_out(page: Page) -> None:
    """A planned pose, after its price was asked."""
    page.value(
        "(() => { const pose = document.querySelector('#pose'); pose.value = pose.options[3].value;"
        " pose.dispatchEvent(new Event('change')); })()"
    )
    until(lambda: "predicted error" in page.text("#price").lower())
    until(lambda: page.value("document.querySelectorAll('.pose-list [aria-pressed=true]').length") == 1)
    assert page.value("document.querySelector('#retake').disabled")  # nothing is measured there
    tab_to(page, "#pose-reason")
    page.type("its cable is tight")
    enter_on(page, "#skip-pose")
    until(lambda: "1 skipped" in page.text("#done"))


@in_a_browser
def test_two_tabs_a_reload_and_a_service_that_dies(cell: Path, window: Page, tmp_path: Path) -> None:
    record = tmp_path / "record"
    at = ("--cell", str(cell), "--simulate", "--port", str(lasting_port()))
    with (
        served(record, *at) as service,
        window.another(f"{service.url}/") as page,
    ):
        enter(page)
        take_control(page, "bert")
        service.client.headers["Lease-Id"] = page.value(
            "JSON.parse(sessionStorage['truepose-lease']).lease_id"
        )
        file = campaign(tmp_path, "night")
        with file.open("rb") as content:
            kept = service.client.post(
                "/campaigns/file", files={"toml": content}, data={"name": "night"}
            ).json()
        run = service.client.post("/runs", json={"campaign_id": kept["id"], "dry_run": False}).json()["id"]
        until(lambda: "N1" in page.text("#question"))  # who has chosen no view is shown the run
        with page.another(f"{service.url}/") as second:
            enter(second)
            until(lambda: "N1" in second.text("#question"))
            assert second.text("#holder") == "bert is in control"
            second.value("location.hash = '#/robots'")
            until(
                lambda: "Your turn" in second.text("#steps") and "Your turn" in second.value("document.title")
            )
            second.value("history.back()")
            until(lambda: second.value(f"Boolean(document.querySelector('#confirm')) && {ARMED}"))
            second.click("#confirm")
            until(lambda: "N2" in page.text("#question"))
            assert page.text("#trouble") == ""
        page.do("Page.reload")
        until(lambda: page.value("document.readyState === 'complete'") and "N2" in page.text("#question"))
        service.process.send_signal(signal.SIGKILL)
        service.process.wait()
        until(
            lambda: page.text("#alarm") == "The robot was not stopped: no connection. Use the emergency stop."
        )
        assert reachable(page, "#stop")
        with served(record, *at) as again:
            until(lambda: page.value("document.querySelector('#silence').hidden"))
            until(lambda: page.value(STATE) == "paused")
            assert page.value("document.querySelector('#asking').hidden")
            until(lambda: page.text("#holder").startswith("No one"))
            assert again.client.get("/cell").json()["run_id"] is None
            assert again.client.get(f"/runs/{run}").json()["done"] == 0
            assert again.client.get("/cell").json()["last_run_id"] == run
            page.value("location.hash = '#/cell'")
            until(lambda: "Paused" in page.text("#steps"))
            assert "unknown" in page.text("#devices")  # nothing has asked them since


def test_every_word_is_in_the_table_and_every_entry_is_used() -> None:
    table = (FOLDER / "words.js").read_text("utf-8")
    words = re.findall(r'(?m)[ {]"?(\w+(?: \w+)?)"?: "(?:[^"\\]|\\.)*"', table)
    assert len(words) > 200
    assert sorted(set(words)) == sorted(words)
    everything = "".join((FOLDER / name).read_text("utf-8") for name in (*MODULES, "page.html"))
    used = set(re.findall(r'\bt\("(\w+)"', everything)) | set(
        re.findall(r'data-(?:word|label)="(\w+)"', everything)
    )
    assert used - set(words) == set()
    prefixes = tuple(re.findall(r"\bt\(`(\w+_)\$\{", everything))
    quoted = set(re.findall(r'"(\w+)"', everything))
    assert [key for key in words if key not in used | quoted and not key.startswith(prefixes)] == []
