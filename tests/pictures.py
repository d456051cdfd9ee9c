"""`python -m tests.pictures`: take the pictures of docs/pictures anew, in about three minutes.

The report's are those of two demos; the operator page's, those of an adaptive calibration in a simulated cell, from the
first click to the proof. Chromium draws both, in a window of a fixed size.
"""

from __future__ import annotations

import base64
import json
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from unittest.mock import patch

from tests.drivers.waiting import PATIENCE_S, until
from tests.end_to_end.simulated import ROOT, cell_file
from tests.service import browser as browsers
from tests.service.browser import Page, browser
from tests.service.operator_page import answerable, enter
from tests.service.test_http_support import served
from tests.service.test_page_in_space import WEBGL

FOLDER = ROOT / "docs" / "pictures"
WIDTH, HEIGHT = 1440, 950
REPORT_WIDTH, MARGIN = 1000, 10
# What is drawn of which demo's report: the elements from the first such to the last.
REPORTS = {
    ("--seed", "4"): {"report": ".front > *"},
    ("--in-memory", "--effect", "backlash:j4"): {
        "errors": "section:has(> .pair) > h2, section:has(> .pair) > .pair",
        "effect": "#section-3, .effect",
        "trust": "#section-8, #section-8 ~ figure",
    },
}
OPERATOR = ("operator-prompt", "operator-measure", "operator-result", "operator-verify")
NAMES = sorted([*OPERATOR, *(name for pictures in REPORTS.values() for name in pictures)])
# Resolves when what has changed is on the screen.
DRAWN = """
    document.fonts.ready
      .then(() => new Promise((drawn) => requestAnimationFrame(() => requestAnimationFrame(drawn))))
      .then(() => 0)
"""
EXTENT = """
    ((chosen) => {
      const at = chosen.map((each) => each.getBoundingClientRect());
      const { left, right } = document.querySelector(".front").getBoundingClientRect();
      const [low, high] = [Math.min(...at.map((it) => it.top)), Math.max(...at.map((it) => it.bottom))];
      return [left, right, low + scrollY, high + scrollY];
    })([...document.querySelectorAll(CHOSEN)])
"""


def window(page: Page, width: int, height: int) -> None:
    size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
    page.do("Emulation.setDeviceMetricsOverride", **size)
    page.do("Emulation.setScrollbarsHidden", hidden=True)
    seen = [("prefers-color-scheme", "light"), ("prefers-reduced-motion", "reduce")]
    page.do("Emulation.setEmulatedMedia", features=[{"name": name, "value": value} for name, value in seen])


def take(page: Page, name: str, clip: dict[str, float] | None = None) -> None:
    """Take the picture of the window or of what `clip` says, x, y, width and height in pixels, once all is drawn."""
    page.value(DRAWN)
    more = {"clip": clip | {"scale": 1}, "captureBeyondViewport": True} if clip else {}
    data = base64.b64decode(page.do("Page.captureScreenshot", **more)["data"])
    (FOLDER / f"{name}.png").write_bytes(data)
    sys.stderr.write(f"{name}.png: {len(data) / 1000:.0f} kB\n")


def take_elements(page: Page, name: str, selector: str) -> None:
    """Take the picture of all such elements, which must exist, with a margin."""
    left, right, low, high = page.value(EXTENT.replace("CHOSEN", json.dumps(selector)))
    take(
        page,
        name,
        {
            "x": left - MARGIN,
            "y": low - MARGIN,
            "width": right - left + 2 * MARGIN,
            "height": high - low + MARGIN,
        },
    )


@contextmanager
def demo(folder: Path, options: tuple[str, ...]) -> Iterator[subprocess.Popen[bytes]]:
    command = [sys.executable, "-m", "service.cli", "demo", *options, "--out", str(folder)]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, cwd=ROOT) as process:
        try:
            yield process
        finally:
            process.terminate()


def reports(folder: Path) -> None:
    """Run the demos, and take the pictures of their reports."""
    for number, (options, pictures) in enumerate(REPORTS.items()):
        out = folder / f"demo-{number}"
        with demo(out, options) as process:
            assert process.wait(PATIENCE_S) == 0, options
        with browser((out / "report.html").as_uri(), folder / f"browser-{number}") as page:
            window(page, REPORT_WIDTH, HEIGHT)
            page.value("document.querySelectorAll('details').forEach((each) => { each.open = true; })")
            for name, selector in pictures.items():
                take_elements(page, name, selector)


def operator_page(folder: Path) -> None:
    """Calibrate a simulated robot at the operator page, and take pictures on the way."""
    cell = cell_file(folder, time_scale=200.0, effects=["backlash:j4"], one_smr=True)
    with (
        served(folder / "record", "--cell", str(cell), "--simulate") as service,
        browser(f"{service.url}/#/prepare", folder / "browser") as page,
    ):
        window(page, WIDTH, HEIGHT)
        enter(page)

        def onward(script: str) -> None:
            """Confirm what the page asks, and let the proof move, until the script's value is true."""

            def there() -> bool:
                if answerable(page):
                    page.value("document.querySelector('#confirm')?.click()")
                page.value("document.querySelector('#loop-resume:enabled')?.click()")
                return page.value(f"Boolean({script})")

            until(there)

        until(lambda: page.value("Boolean(document.querySelector('#make'))"))
        page.value("document.querySelector('#goal').value = '0.05'")
        # The prompts take their time, of which the cell's clock runs 200 times as fast.
        page.value("document.querySelector('#minutes').value = '900'")
        page.click("#make")
        until(lambda: page.value("Boolean(document.querySelector('#start'))"))
        page.click("#seen")
        page.value("document.querySelector('#starter').focus()")
        page.type("anna")
        page.click("#start")
        until(lambda: answerable(page))
        take(page, "operator-prompt")
        onward("Number(document.querySelector('#accuracy [data-points]')?.dataset.points) > 2")
        take(page, "operator-measure")
        onward("location.hash.startsWith('#/verify/') && document.querySelector('#desk .answer-card')")
        take(page, "operator-verify")
        page.value("void (location.hash = location.hash.replace('verify', 'diagnose'))")
        until(lambda: page.value("Number(document.querySelector('#desk [data-arrows]')?.dataset.arrows) > 0"))
        take(page, "operator-result")


def main() -> None:
    webgl = patch.object(browsers, "QUIET", browsers.QUIET.replace(*WEBGL))
    with webgl, TemporaryDirectory() as folder:
        for part in (operator_page, reports):
            (own := Path(folder) / part.__name__).mkdir()
            part(own)


if __name__ == "__main__":
    main()
