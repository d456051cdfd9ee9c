"""The views Robots, Robot and Watch with a keyboard, and without a running service.

These would catch: a robot that only a mouse reaches, a serial number that becomes markup, and a run that is not added
to the history automatically. They would also catch a missing verdict, and a list that looks alive although no service
answers.
"""

from __future__ import annotations

from pathlib import Path

from tests.drivers.waiting import until
from tests.end_to_end.simulated import cell_file
from tests.service.browser import Page, browser
from tests.service.test_history import model_of, watch_of
from tests.service.test_http_support import served
from tests.service.test_operator_page import enter, in_a_browser, run_of
from tests.service.test_operator_page_names import HOSTILE
from tests.service.test_robots_http import document, put
from tests.service.workplace import audit, enter_on, open_view, tab_to

CHANGED = "Re-zero joint 4 by 0.031 deg."


def line(page: Page, robot: str) -> str:
    return page.value(
        f"document.querySelector('.robots a[href=\"#/robot/{robot}\"]')?.closest('li').textContent ?? ''"
    )


@in_a_browser
def test_from_the_list_to_a_robot_and_back(tmp_path: Path) -> None:
    cell = cell_file(tmp_path, time_scale=200.0)
    with (
        served(tmp_path / "record", "--cell", str(cell), "--simulate", "--permitted", "0.3") as service,
        browser(f"{service.url}/", tmp_path / "browser") as page,
    ):
        service.lease()
        run = run_of(service, tmp_path)
        service.until(f"/runs/{run}", "succeeded")
        for day, value in (("2026-01-05", 1.5), ("2026-03-05", 1.51), ("2026-05-05", 1.49)):
            robot = put(service, document(model_of(value), day, HOSTILE))["robot_id"]
        put(service, document(watch_of(0.4, "changed"), "2026-06-05", HOSTILE))
        job = service.client.post("/watch-plans", json={"model_document": "0" * 64})
        assert job.status_code == 404

        enter(page)
        open_view(page, "robots")
        until(lambda: HOSTILE in line(page, robot))
        assert "✖ changed" in line(page, robot)
        assert CHANGED in line(page, robot)
        audit(page)
        (own,) = [each for each in service.client.get("/robots").json()["robots"] if each["id"] != robot]
        assert own["documents"] == {"dataset": 1, "campaign": 1}  # the run, by itself
        assert own["serial"] in line(page, own["id"])

        tab_to(page, f".robots a[href='#/robot/{robot}']")
        page.press("Enter")
        until(lambda: page.value("document.querySelectorAll('.trend').length") > 0)
        assert page.text("#title") == "Robot"
        assert CHANGED in page.text("#desk")
        assert page.value("document.querySelector('#baseline').options.length") == 3
        page.value("document.querySelector('#steady').open = true")
        until(lambda: page.value("document.querySelector('#steady .trend')?.dataset.limits") == "2")
        drawn = page.value("document.querySelector('#steady .trend .chart').getAttribute('aria-label')")
        assert drawn.startswith("d1: 3 values, last 1.490 ± 0.010 mm")
        audit(page)
        before = page.text(".big .overdue, section p.big")
        page.value("document.querySelector('#permitted').focus()")
        page.type("0.05")
        page.press("Enter")
        until(lambda: "Permitted: 0.050 mm" in page.text("#desk"))
        assert before

        enter_on(page, "#plan-watch button")  # by a baseline of three numbers: refused, and said
        until(lambda: page.value("location.hash").startswith("#/watch/"))
        until(lambda: page.text("#job") == "✖ Did not finish")
        until(lambda: page.value("Boolean(document.querySelector('.bad'))"))
        audit(page)
        page.value("history.back()")
        until(lambda: page.value("location.hash") == f"#/robot/{robot}")
        until(lambda: "plan of a watch" in page.text("#desk"))
        assert HOSTILE in page.text("#desk")
        audit(page)
        assert page.value("document.querySelectorAll('img').length") == 0
        told = [each for each in page.told if each["method"] in ("Log.entryAdded", "Runtime.exceptionThrown")]
        assert not told, told

        service.process.kill()
        until(lambda: page.value("!document.querySelector('#silence').hidden"))
        assert page.text("#alarm").startswith("The robot was not stopped")
        assert HOSTILE in page.text("#desk")
