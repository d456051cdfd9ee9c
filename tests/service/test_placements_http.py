"""The search of placements over HTTP.

These would catch: a search that is done twice for one key, an order that is refused only after a wait, and a refusal
of the worker that is not readable.
"""

from __future__ import annotations

import json
from pathlib import Path
from xml.etree import ElementTree

from tests.service.own_robots import own_cell
from tests.service.test_http_support import problem, served

SVG = "{http://www.w3.org/2000/svg}"


def test_the_search_over_http(tmp_path: Path) -> None:
    cell = own_cell(tmp_path / "cell", "lrmate_ballbar", "fanuc-lrmate200ic")  # a job has its robot, too
    with served(tmp_path / "record", "--cell", str(cell), "--simulate") as service:
        asked = {"x": [-50, 50, 50], "turn": [0, 60, 60], "show": 2}
        first, again = (
            service.client.post("/placements", json=asked, headers={"Idempotency-Key": "place-1"})
            for _ in range(2)
        )
        assert first.status_code == 202, first.text
        assert first.json()["id"] == again.json()["id"]
        where = f"/placements/{first.json()['id']}"
        done = service.until(where, "succeeded", "failed")
        assert done["result"]["placements"] == 6
        assert done["progress"] == {"done": 6, "total": 6}
        assert done["result"]["best"][0]["poses"] >= done["result"]["best"][1]["poses"]
        drawn = service.client.get(f"{where}/picture.svg")
        assert drawn.headers["content-type"] == "image/svg+xml"
        assert "sandbox" in drawn.headers["content-security-policy"]
        assert ElementTree.fromstring(drawn.text).tag == f"{SVG}svg"
        for wrong in (
            {"x": [0, 1e5, 1]},
            {"x": [0, 1, 0]},
            {"together": 2},
            {"base": ["B1"]},
            {"zone": [0, 0, 0]},
        ):
            problem(service.client.post("/placements", json=wrong), 422)
        nowhere = service.client.post("/placements", json={"zone": [9000, 0, 0, 50]}).json()
        failed = service.until(f"/placements/{nowhere['id']}", "succeeded", "failed")
        assert "Name a zone that the arm reaches" in json.dumps(failed["problem"])
        other = service.client.post("/placements", json={"base": ["B1", "B2", "B9"]}).json()
        failed = service.until(f"/placements/{other['id']}", "succeeded", "failed")
        assert "Name three or four of B1, B2, B3" in json.dumps(failed["problem"])
