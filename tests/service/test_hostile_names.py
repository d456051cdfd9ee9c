"""Names that are markup, a formula, a template or mathematics elsewhere stay names.

Every field that a person or a device fills gets a separate hostile text at the same time. The fields are robot, maker,
instrument, devices with serial numbers and reasons, operators, targets, series, readings, wires, zones, laboratory,
and the file itself.

These would catch: an element or attribute created from a name, JSON that ends its script element, and XML that does
not parse. They would also catch a picture that fails on a dollar sign, and a cell that a spreadsheet calculates.
"""

from __future__ import annotations

import csv
import io
import json
import tomllib
from html.parser import HTMLParser
from importlib.resources import files
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
import tomli_w

from calib.convert import ConvertedTable
from calib.data import read_dataset
from service.cli import main
from service.report.figures.quantities import Quantity
from service.report.figures.residual_pictures import by_group, over
from tests.service.campaigns import Rows, edit_rows, write_data

TEXTS = (
    '<script>alert("$\\frac{1")</script>]]></svg></style><b onclick=alert(1)>{{ 7*7 }}{% raw %}',
    '=HYPERLINK("evil","$x^$")"><img src=x onerror=\'alert(1)\'>&amp;',
)
KNOWN = (
    *(
        "html",
        "a",
        "nav",
        "line",
        "head",
        "meta",
        "title",
        "style",
        "body",
        "p",
        "div",
        "header",
        "section",
        "span",
        "h1",
        "h2",
        "h3",
    ),
    *(
        "dl",
        "dt",
        "dd",
        "b",
        "strong",
        "small",
        "table",
        "caption",
        "thead",
        "tbody",
        "tr",
        "th",
        "td",
        "figure",
    ),
    *(
        "figcaption",
        "main",
        "article",
        "code",
        "ol",
        "ul",
        "li",
        "details",
        "summary",
        "footer",
        "script",
        "br",
        "i",
    ),
    *("svg", "g", "path", "defs", "use", "text", "clippath", "rect", "image", "tspan"),
)


class Tags(HTMLParser):
    """Collects the elements of a page with their attributes, and its text."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.text = ""
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))

    def handle_data(self, data: str) -> None:
        self.text += data


def write_hostile(folder: Path, text: str) -> Path:
    """A measured data set whose every name is the text with a word behind it."""
    data = write_data(folder, effects=(), n=60)
    header = tomllib.loads(data.with_suffix(".toml").read_text("utf-8"))
    table = tomllib.loads((files("calib") / "arm/robots/abb-irb120.toml").read_text("utf-8"))
    table |= {"name": f"{text}robot", "maker": f"{text}maker"}
    (folder / "robot.toml").write_text(tomli_w.dumps(table), "utf-8")
    renamed = {name: f"{text}{name}" for name in header["tool_targets"]}
    header["tool_targets"] = {renamed[name]: place for name, place in header["tool_targets"].items()}
    header |= {
        "robot": "robot.toml",
        "instrument": f"{text}instrument",
        "unprotected": f"{text}wire",
        "measured": {
            "began": "2026-03-02 09:15 UTC",
            "ended": "2026-03-02 10:15 UTC",
            "operators": [f"{text}op"],
        },
        "device": [
            {
                key: f"{text}{key}{role}"
                for key in ("maker", "model", "serial", "firmware", "reason", "accepted_by", "series")
            }
            | {"role": role}
            for role in ("robot", "instrument")
        ],
    }

    def spoil(rows: Rows) -> None:
        for row in rows:
            row["tool_target"] = renamed[row["tool_target"]]
            row["series"] = f"{text}series"
            row["reading_id"] = f"{text}{row['reading_id']}"
        wrong = next(row for row in rows if row["set"] == "calibration")
        wrong["x_mm"] = str(float(wrong["x_mm"]) + 50.0)

    edit_rows(data, spoil)
    named = folder / f"{text.replace('/', '')}.csv"
    data.rename(named)
    data.with_suffix(".toml").unlink()
    named.with_suffix(".toml").write_text(tomli_w.dumps(header), "utf-8")
    return named


@pytest.mark.parametrize("text", TEXTS)
def test_names_stay_names(text: str, tmp_path: Path) -> None:
    data = write_hostile(tmp_path, text)
    zone = {"name": f"{text}zone", "low_mm": [-3e3] * 3, "high_mm": [3e3] * 3, "accept_rms_mm": 5.0}
    (tmp_path / "zones.toml").write_text(tomli_w.dumps({"zone": [zone]}), "utf-8")
    about = {name: f"{text}{name}" for name in ("laboratory", "city", "customer", "responsible")}
    (tmp_path / "about.toml").write_text(tomli_w.dumps(about), "utf-8")
    written = {
        "--json": "r.json",
        "--report": "r.html",
        "--dcc": "r.xml",
        "--dcc-about": "about.toml",
        "--accept-zones": "zones.toml",
        "--predictions": "p.csv",
    }
    options = [part for option, name in written.items() for part in (option, str(tmp_path / name))]
    assert main(["diagnose", str(data), *options]) == 0
    page = (tmp_path / "r.html").read_text("utf-8")
    found = Tags(page)
    assert {tag for tag, _ in found.tags} <= set(KNOWN)
    assert not {name for _, attributes in found.tags for name in attributes if name.startswith("on")}
    assert all((a.get("href") or "").startswith("#") for tag, a in found.tags if tag == "a")
    assert [a.get("type") for tag, a in found.tags if tag == "script"] == ["application/json"]
    shown = " ".join(found.text.split())
    for word in (
        "robot",
        "maker",
        "instrument",
        "wire",
        "op",
        "T1",
        "zone",
        "serialrobot",
        "reasoninstrument",
    ):
        assert " ".join(f"{text}{word}".split()) in shown
    assert text in json.dumps(
        json.loads((tmp_path / "r.json").read_text("utf-8")), ensure_ascii=False
    ).replace("\\\\", "\\").replace('\\"', '"')
    xml = ElementTree.parse(tmp_path / "r.xml").getroot()
    assert {e.tag.rpartition("}")[0] for e in xml.iter()} == {"{https://ptb.de/dcc", "{https://ptb.de/si"}
    assert " ".join(f"{text}laboratory".split()) in [e.text for e in xml.iter()]
    cells = [cell for row in csv.reader(io.StringIO((tmp_path / "p.csv").read_text("utf-8"))) for cell in row]
    assert any(text in cell for cell in cells)
    assert not [cell for cell in cells if cell.startswith(("=", "@"))]


@pytest.mark.parametrize("text", ["$\\frac{1", "<b>$x^$&"])
def test_a_picture_draws_a_name_as_it_is(text: str) -> None:
    left = np.random.default_rng(1).normal(size=(40, 3))
    group = np.arange(40) % 2
    picture = by_group(group, [f"{text}A", f"{text}B"], left, "left1", "every target")
    quantity = Quantity(left, ("x", "y", "z"), group, (f"{text}A", f"{text}B"))
    for svg in (picture, over(quantity, left, group == 1, "left2", text)):
        found = Tags(svg)
        assert f"{text}A" in found.text
        assert {tag for tag, _ in found.tags} <= set(KNOWN)
        assert not {name for _, attributes in found.tags for name in attributes if name.startswith("on")}


@pytest.mark.parametrize("mark", ["=", "+", "-", "@"])
def test_a_data_set_that_is_written_holds_no_formula_and_is_read_as_it_was(mark: str, tmp_path: Path) -> None:
    data = write_data(tmp_path, effects=(), n=60)
    header = tomllib.loads(data.with_suffix(".toml").read_text("utf-8"))
    named = {name: f"{mark}1+{name}" for name in header["tool_targets"]}
    header["tool_targets"] = {named[name]: place for name, place in header["tool_targets"].items()}
    with data.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    columns = {name: [row[name] for row in rows] for name in rows[0]}
    columns["tool_target"] = [named[name] for name in columns["tool_target"]]
    columns["reading_id"] = [f"{mark}HYPERLINK({i})" for i in range(len(rows))]
    ConvertedTable(columns, tomli_w.dumps(header)).write(tmp_path / "out.csv")
    with (tmp_path / "out.csv").open(encoding="utf-8", newline="") as file:
        cells = [cell for row in csv.reader(file) for cell in row]
    negative = [cell for cell in cells if cell.startswith(("=", "+", "-", "@"))]
    assert negative == [f"{float(cell):.{len(cell.partition('.')[2])}f}" for cell in negative]  # numbers
    assert negative
    read = read_dataset(tmp_path / "out.csv")
    assert list(read.reading_id) == columns["reading_id"]
    assert set(read.conditions.target_names) == set(named.values())
    assert read.conditions.joints == pytest.approx(read_dataset(data).conditions.joints, abs=0.0)
