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
from tests.service.operator_page import ARMED, enter, in_a_browser
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
    until(lambda: name in page.text("#question") and page.value(ARMED))
    enter_on(page, "#confirm")


@in_a_browser
def test_a_whole_campaign_by_keyboard(service: Served, window: Page, tmp_path: Path) -> None:
    with window.another(f"{service.url}/#/cell") as page:
        enter(page)
        assert page.value("document.createElement('canvas').getContext('webgl')") is None
        until(lambda: page.text("caption") == "Devices")
        until(lambda: page.value("document.querySelectorAll('.scene line').length") > 10)  # without WebGL
        audit(page)

        open_view(page, "campaigns")
        audit(page)
        page.choose("#file", campaign(tmp_path, HOSTILE.replace("/", "")))
        until(lambda: page.text("#desk h2") == HOSTILE)
        assert page.value("document.querySelectorAll('img').length") == 0
        enter_on(page, "#dry")
        until(lambda: page.text("#verdict").startswith("✔ 24 readings"))
        assert page.value("document.querySelectorAll('.scene .mark').length") == 24
        assert page.value("document.querySelectorAll('.scene .box').length") == 6
        audit(page)
        assert page.value("document.querySelector('#start').disabled")  # nobody holds the lease
        at = page.value("location.hash")

        open_view(page, "cell")
        tab_to(page, "#name")
        page.type("anna")
        page.press("Enter")
        until(lambda: page.text("#holder") == "You hold it as anna.")
        page.value("history.back()")
        until(lambda: page.value("location.hash") == at)
        enter_on(page, "#start")
        for name in ("N1", "N2"):
            confirm(page, name)
        until(lambda: "N3" in page.text("#question"))
        assert "N3" in page.value("document.querySelector('.prompt-picture .strong').textContent")
        audit(page)
        leaves_one_out(page)
        confirm(page, "N3")
        confirm(page, "T2")
        until(lambda: page.text("#state") == "✔ succeeded")
        assert "1 skipped" in page.text("#done")
        assert "mm off" in page.text("#reading")
        until(lambda: page.value("document.querySelectorAll('#errors circle, #errors rect').length") > 20)

        enter_on(page, "#export")
        until(lambda: page.value("document.querySelectorAll('#files li > button').length") == 2)
        audit(page)
        enter_on(page, "#files button")  # Identify
        until(lambda: page.text("#job") == "✔ succeeded")
        until(lambda: page.value("document.querySelectorAll('.scene .error').length") == 4)
        assert "Nominal robot as found" in page.text("table")
        arrows_are_the_errors(service, page.value("location.hash").rpartition("/")[2])
        audit(page)
        tab_to(page, "a[href^='#/report/']")
        page.press("Enter")
        until(
            lambda: page.value("Boolean(document.querySelector('#report')?.shadowRoot?.querySelector('h1'))")
        )
        inside = "document.querySelector('#report').shadowRoot"
        assert page.value(f"getComputedStyle({inside}.querySelector('.simulated')).borderTopWidth") == "2px"
        assert page.value(f"{inside}.querySelectorAll('script, [onload], [onclick]').length") == 0
        for view in ("robots", "report", "result"):
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
    for which, errors in (("nominal_mm", "error_nominal_mm"), ("model_mm", "error_identified_mm")):
        lengths = [math.hypot(*each[which]) for each in drawn["arrows"]]
        rms = math.sqrt(sum(length**2 for length in lengths) / len(lengths))
        assert rms == pytest.approx(stated[errors]["rms"], rel=2e-3)


def leaves_one_out(page: Page) -> None:
    """A planned pose, after its price was asked."""
    enter_on(page, "#worth")
    until(lambda: "mm" in page.text("#price"))
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
        until(lambda: page.text("#holder").startswith("Nobody"))
        tab_to(page, "#name")
        page.type("bert")
        page.press("Enter")
        until(lambda: page.text("#holder") == "You hold it as bert.")
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
            assert second.text("#holder") == "bert holds it."
            second.value("location.hash = '#/robots'")
            until(lambda: "asks you" in second.text("#busy"))  # wherever one is
            second.value("history.back()")
            until(lambda: second.value(f"Boolean(document.querySelector('#confirm')) && {ARMED}"))
            second.click("#confirm")
            until(lambda: "N2" in page.text("#question"))
            assert page.text("#trouble") == ""
        page.do("Page.reload")
        until(lambda: page.value("document.readyState === 'complete'") and "N2" in page.text("#question"))
        service.process.send_signal(signal.SIGKILL)
        service.process.wait()
        until(lambda: page.text("#alarm") == "NOT stopped: no connection. Use the emergency stop")
        assert reachable(page, "#stop")
        with served(record, *at) as again:
            until(lambda: page.value("document.querySelector('#silence').hidden"))
            until(lambda: page.text("#state") == "‖ paused")
            assert page.value("document.querySelector('#asking').hidden")
            until(lambda: page.text("#holder").startswith("Nobody"))
            assert again.client.get("/cell").json()["run_id"] is None
            assert again.client.get(f"/runs/{run}").json()["done"] == 0
            assert again.client.get("/cell").json()["last_run_id"] == run
            page.value("location.hash = '#/cell'")
            until(lambda: re.search("‖ .*: paused", page.text("#desk")))  # not that no run uses the robot


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
