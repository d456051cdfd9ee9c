"""The operator page when the service does not answer.

These would catch: a page that shows the past as the present, a Confirm that looks alive without a service, and a lease
that is still "yours". They would also catch a notice that hides Stop, and a page that has to be loaded again when the
service is back. A view that was opened meanwhile must not be empty.
"""

from __future__ import annotations

import signal
from pathlib import Path

from tests.drivers.waiting import until
from tests.service.browser import Page
from tests.service.operator_page import at_the_page, in_a_browser, run_of, take_control

ALARM = "The robot was not stopped: no connection. Use the emergency stop."


def shown(page: Page, selector: str) -> bool:
    return page.value(f"document.querySelector('{selector}').checkVisibility()")


def on_top(page: Page, selector: str) -> bool:
    """Report whether a click in the middle of an element would reach it."""
    return page.value(
        f"(() => {{ const it = document.querySelector('{selector}'), box = it.getBoundingClientRect();"
        " return it.contains(document.elementFromPoint(box.x + box.width / 2, box.y + box.height / 2)); })()"
    )


@in_a_browser
def test_it_says_at_once_that_nothing_is_stopped_and_recovers_by_itself(tmp_path: Path) -> None:
    with at_the_page(tmp_path) as (service, page):
        take_control(page, "bert")
        service.client.headers["Lease-Id"] = page.value(
            "JSON.parse(sessionStorage.getItem('truepose-lease')).lease_id"
        )
        run_of(service, tmp_path)
        until(lambda: page.value("Boolean(document.querySelector('#question'))"))
        until(lambda: "N1" in page.text("#question"))
        page.value("document.querySelector('#desk .more').focus()")
        until(lambda: not shown(page, "#silence"))

        assert (
            page.value("document.documentElement.dataset.page")
            == service.client.get("/health").json()["page"]
        )
        assert not shown(page, "#old")
        service.process.send_signal(signal.SIGSTOP)  # it is there, and does not answer
        try:
            until(lambda: page.text("#alarm") == ALARM)
            assert shown(page, "#alarm")
            page.value("scrollTo(0, document.body.scrollHeight)")
            assert on_top(page, "#stop")
            assert page.value(
                "document.querySelector('#silence').offsetWidth === document.documentElement.clientWidth"
            )
            assert page.value("document.querySelector('#desk').inert")
            assert page.value("document.querySelector('#confirm').disabled")
            assert page.text("#holder") == "Not known: no connection"
            assert "Everything below is from" in page.text("#since")
            assert page.value("document.title").startswith("No connection")
            page.value("document.documentElement.dataset.page = 'of an older version'")
        finally:
            service.process.send_signal(signal.SIGCONT)
        until(lambda: not shown(page, "#silence"))
        until(lambda: not page.value("document.querySelector('#desk').inert"))
        assert page.value("document.activeElement.matches('#desk .more')")  # the focus is where it was
        until(lambda: shown(page, "#old"))  # when the service was exchanged meanwhile
        assert on_top(page, "#stop")
        # On a machine that took long about it the lease has lapsed meanwhile, and nothing is asked any more.
        until(
            lambda: (
                page.value(
                    "document.querySelector('#asking').hidden || !document.querySelector('#confirm').disabled"
                )
                and "Not known" not in page.text("#holder")
            )
        )

        service.process.kill()
        until(lambda: shown(page, "#alarm"))
        page.press("Escape")
        until(lambda: "No answer to what you pressed" in page.text("#trouble"))
        assert page.text("#alarm") == ALARM
        assert on_top(page, "#stop")

        # Another view shows what was heard last, in grey, and is no sign of life.
        assert page.value(
            "document.querySelector('#desk').inert && document.querySelector('#confirm').disabled"
        )
        page.value("void (location.hash = '#/prepare')")
        until(lambda: page.text("#title").startswith("What should"))
        page.value("void (location.hash = '#/data')")
        until(lambda: page.text(".unheard") == "No connection yet.")
        assert shown(page, "#alarm")
