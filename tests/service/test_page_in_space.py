"""The pictures of the operator page in a browser that has WebGL, drawn by software.

These would catch: a library that the page's policy keeps from working, a picture that stays empty, and a click on a
pose that the chart and the list do not know of. They would also catch an accuracy that is called reached by the
predicted error alone.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.drivers.waiting import until
from tests.end_to_end.simulated import cell_file
from tests.service import browser as browsers
from tests.service.browser import browser
from tests.service.operator_page import enter, in_a_browser, run_of
from tests.service.test_http_support import Served, served
from tests.service.workplace import audit

WEBGL = ("--disable-gpu --disable-3d-apis", "--use-angle=swiftshader --enable-unsafe-swiftshader")
PAINTED = """
    (() => {
      const it = document.querySelector("#run .scene");
      if (!it?.width || !it.clientWidth) return 0;
      const { width, height } = it;
      const { data } = it.getContext("2d").getImageData(0, 0, width, height), colours = new Set();
      for (let i = 0; i < data.length; i += 4) colours.add(data[i] + 256 * data[i + 1] + 65536 * data[i + 2]);
      return colours.size;
    })()
"""
FOUND = """
    (() => {
      const it = document.querySelector("#run .scene");
      it.scrollIntoView({ block: "center" });
      const at = it.getBoundingClientRect();
      const tip = document.querySelector("#run .picture .tip");
      for (let y = 8; y < at.height; y += 4) for (let x = 8; x < at.width; x += 4) {
        const where = { clientX: at.x + x, clientY: at.y + y, bubbles: true };
        it.dispatchEvent(new PointerEvent("pointermove", where));
        if (tip.hidden || !tip.textContent) continue;
        return [tip.textContent, where.clientX, where.clientY];
      }
      return null;
    })()
"""
ACCURACY = {
    "wanted_mm": 0.1, "poses": 24, "rms_mm": 0.05, "bound_mm": 0.08, "verdict": None, "reached": False, "reason": "",
    "poses_left": 12, "minutes_left": 9.0, "history": [{"poses": 12, "rms_mm": 0.2, "bound_mm": 0.4}],
}  # fmt: skip
# What the service will say of a run that ends when it is accurate enough.
ADAPTIVE = """
    window.fetch = ((ask) => async (path, options) => {
      const answer = await ask(path, options);
      if (!/runs.[0-9a-z-]+$/.test(path)) return answer;
      const run = { ...await answer.json(), state: "running", accuracy: window.accuracy };
      return new Response(JSON.stringify(run), { status: answer.status });
    })(window.fetch.bind(window));
"""


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    folder = tmp_path_factory.mktemp("space")
    cell = cell_file(folder, time_scale=40.0)
    with served(folder / "record", "--cell", str(cell), "--simulate") as running:
        yield running


@in_a_browser
def test_a_pose_is_chosen_in_space_and_everywhere(
    service: Served, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(browsers, "QUIET", browsers.QUIET.replace(*WEBGL))
    service.lease()
    run = run_of(service, tmp_path)
    until(lambda: service.client.get(f"/runs/{run}").json()["done"] > 2)
    service.client.post(f"/runs/{run}/pause")
    service.until(f"/runs/{run}", "paused")
    with browser(f"{service.url}/#/measure/{run}", tmp_path / "browser") as page:
        enter(page)
        until(lambda: page.value(PAINTED) > 20)  # shades, not one ground
        assert page.value("document.querySelector('#run .no3d').hidden")
        words, x, y = page.value(FOUND)  # what stands beside the pose below the pointer
        for kind in ("mousePressed", "mouseReleased"):
            page.do("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", clickCount=1)
        number = words.partition(":")[0]
        assert number
        until(lambda: page.value("document.querySelector('#pose').value") == number)
        until(lambda: page.text("#price") != "")
        assert page.value("document.querySelector('#run .errors canvas') !== null")
        audit(page)
        page.value(f"window.accuracy = {json.dumps(ACCURACY)}")
        page.value(ADAPTIVE)
        until(lambda: "0.080" in page.text("#accuracy"))
        assert "Diagnosis so far: Not yet" in page.text("#accuracy")
        assert "reached" not in page.text("#desk")  # the bound is small enough, and nobody has diagnosed
        page.value("Object.assign(window.accuracy, { reached: true, verdict: 'complete' })")
        until(lambda: "Accuracy reached: 0.080 mm" in page.text("#why"))
        assert "The calibration explains everything" in page.text("#why")
        told = [each for each in page.told if each["method"] in ("Log.entryAdded", "Runtime.exceptionThrown")]
        assert all("getImageData" in json.dumps(each) for each in told), told  # which this test calls
    service.free()
