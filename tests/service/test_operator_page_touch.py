"""The operator page under a finger, and over a slow line.

These would catch: a page that swallows a tap (a handler of touches, an overlay, a `touch-action` that waits), and a
link a finger cannot follow. They would also catch a question that a tap answers before it can have been read, a page
that takes a slow service for a dead one, and a late stop shown as one that was received.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tests.drivers.waiting import until
from tests.service.browser import Page
from tests.service.operator_page import ARMED, STATE, at_the_page, in_a_browser, run_of
from tests.service.test_http_support import Served
from tests.service.test_operator_page_silence import shown

LATENCY_MS, BYTES_PER_S = 400, 50_000
LATE_MS = 1500  # beyond the second in which a stop is answered


@contextmanager
def asked(folder: Path) -> Iterator[tuple[Served, Page, str]]:
    """A service with a run that asks for the first nest, and a page at it that holds the lease."""
    with at_the_page(folder) as (service, page):
        service.lease()
        run = run_of(service, folder)
        until(lambda: "N1" in page.text("#question"))
        yield service, page, run


def tap(page: Page, selector: str) -> None:
    """Put a finger in the middle of an element, down and up.

    The rest is left to browser and page. `Input.synthesizeTapGesture` gives no click in a browser without a window, not
    even on a page of one button.
    """
    x, y = page.value(
        f"(() => {{ const it = document.querySelector({json.dumps(selector)});"
        " it.scrollIntoView({ block: 'center' }); const box = it.getBoundingClientRect();"
        " return [box.x + box.width / 2, box.y + box.height / 2]; })()"
    )
    page.do("Input.dispatchTouchEvent", type="touchStart", touchPoints=[{"x": x, "y": y}])
    page.do("Input.dispatchTouchEvent", type="touchEnd", touchPoints=[])


def hit(page: Page, identifier: str) -> bool:
    """Tap; whether it was this that was hit. A view that is still being drawn moves away below a finger."""
    tap(page, f"#{identifier}")
    return page.value("fingers.at(-1)?.[1]") == identifier


@in_a_browser
def test_a_finger_confirms_follows_a_link_and_stops(tmp_path: Path) -> None:
    with asked(tmp_path) as (service, page, run):
        page.do("Emulation.setTouchEmulationEnabled", enabled=True, maxTouchPoints=5)
        size = {"width": 390, "height": 844, "deviceScaleFactor": 1, "mobile": True}
        page.do("Emulation.setDeviceMetricsOverride", **size)
        assert page.value("navigator.maxTouchPoints") == 5
        page.value(
            "window.fingers = []; addEventListener('click',"
            " (e) => fingers.push([e.pointerType, e.target.closest('[id]').id]), true)"
        )
        until(lambda: page.value(ARMED) and hit(page, "confirm"))
        until(lambda: "N2" in page.text("#question"))
        assert page.value("fingers.filter(([, id]) => id === 'confirm')") == [["touch", "confirm"]]
        if not page.value(ARMED):  # on a machine that is not too busy for it: the second tap is none
            tap(page, "#confirm")
        for view in ("robots", "data"):  # until it was hit: a view that is still being drawn moves away
            until(
                lambda view=view: (
                    page.value("location.hash").startswith(f"#/{view}")
                    or tap(page, f"nav a[href='#/{view}']")
                )
            )
        until(lambda: hit(page, "stop"))
        service.until(f"/runs/{run}", "stopped")
        page.value(f"location.hash = '#/measure/{run}'")
        until(lambda: page.value(STATE) == "stopped")
        assert page.value("fingers.every(([kind]) => kind === 'touch')")


def slow(page: Page, latency_ms: float) -> None:
    """The line between page and service from now on."""
    page.do("Network.enable")
    rates = {"downloadThroughput": BYTES_PER_S, "uploadThroughput": BYTES_PER_S}
    page.do("Network.emulateNetworkConditions", offline=False, latency=latency_ms, **rates)


@in_a_browser
def test_over_a_slow_line_it_is_slow_and_not_silent(tmp_path: Path) -> None:
    with asked(tmp_path) as (service, page, run):
        slow(page, LATENCY_MS)
        page.value(
            "window.bands = []; new MutationObserver(() => bands.push(document.querySelector('#alarm').textContent))"
            ".observe(document.querySelector('#alarm'), { childList: true })"
        )
        took = (
            "(async () => { const at = performance.now(); await fetch('page/app.js');"
            " return performance.now() - at; })()"
        )
        assert page.value(took) > LATENCY_MS  # or this test would say nothing
        until(lambda: page.value(ARMED))
        page.click("#confirm")
        until(lambda: page.text("#question").startswith("Put the SMR in N2"))
        for view in ("robots", "data", "prepare", f"measure/{run}"):
            here = f"nav a[href='#/{view}']"
            page.value(f"document.querySelector({json.dumps(here)}).click()")
            until(
                lambda here=here: page.value(
                    f"document.querySelector({json.dumps(here)}).matches('[aria-current]')"
                )
            )
        until(lambda: "N2" in page.text("#question"))
        slow(page, LATE_MS)
        page.press("Escape")
        service.until(f"/runs/{run}", "stopped")
        until(lambda: page.value(STATE) == "stopped")
        until(lambda: not shown(page, "#silence"))  # what was late has come
        assert any("no answer yet" in each for each in page.value("bands"))
        assert not page.value("document.querySelector('#desk').inert")
