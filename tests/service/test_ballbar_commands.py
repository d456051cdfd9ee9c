"""A ballbar's data set on the command line.

These would catch: a sphere test that is missing from table, JSON or report, and two models that cannot be compared on
distances alone. They would also catch legs that cannot be turned into points.
"""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from acquisition import campaign_from, checked_plan
from service.cli import main
from tests.benchmarks.nests import example, header_of, legs_of, sides_of, truth_of
from tests.calib.campaigns import write_files
from tests.calib.test_validation_ballbar import SPHERE


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with legs.csv and its models m.json, and one.json without compliances."""
    out = tmp_path_factory.mktemp("ballbar")
    cell, visits = example()
    truth = truth_of(cell, 2)
    sphere = checked_plan(cell, campaign_from({"format": "truepose-campaign/1", "block": [SPHERE]}, "test"))
    legs = [row | {"other_target": ""} for row in legs_of(truth, cell, [*visits[::3], *sphere, visits[0]])]
    rows = [*sides_of(truth, cell, legs[0]), *legs]
    u_mm = {"base_targets_u_mm": 0.3, "tool_targets_u_mm": 0.05}
    data = write_files(out, rows, header_of(cell, cell.nests, cell.tool.targets, **u_mm), "legs")
    assert main(["identify", str(data), "--model", str(out / "m.json"), "--report", str(out / "r.html")]) == 0
    assert main(["identify", str(data), "--level", "2", "--model", str(out / "one.json")]) == 0
    return out


def test_preliminary_and_final_side_by_side(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    asked = ["--model", str(folder / "one.json"), "--compare", str(folder / "m.json")]
    assert main(["validate", str(folder / "legs.csv"), *asked, "--json", str(tmp_path / "v.json")]) == 0
    document = json.loads((tmp_path / "v.json").read_text("utf-8"))
    assert document["placed"] is False  # the base balls are the frame of all of them
    nominal, one, final = document["judgements"]
    assert nominal["model"] == "nominal robot, placed"
    assert final["length_mm"]["rms"] < one["length_mm"]["rms"] < nominal["length_mm"]["rms"]
    (sphere,) = final["spheres"]
    assert (sphere["tool_target"], sphere["base_target"], sphere["n"]) == ("T1", "B1", 20)
    assert sphere["max_mm"] < one["spheres"][0]["max_mm"]
    assert any(group["by"] == "distance from the point" for group in final["groups"])
    assert document["length_repeatability"]["poses"] > 0
    shown = capsys.readouterr().out
    assert "Sphere test: radial error, measured less predicted, mm" in shown
    assert "measured more than once" in shown


def test_the_report_has_a_section_of_the_ballbar(folder: Path) -> None:
    page = (folder / "r.html").read_text("utf-8")
    section = page[page.index("What the ballbar says</h2>") :]
    assert len(re.findall(r"T1 about B1, \d{3} mm", section[:3000])) == 2  # nominal and identified
    assert 'aria-label="Error of the distances over the distance from the fixture"' in section
    assert len(re.findall(r'aria-label="Histograms of the error of the distances', section)) == 1


def test_legs_as_points(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    points = tmp_path / "points.csv"
    assert main(["convert", str(folder / "legs.csv"), str(points), "--from", "hexapod-legs"]) == 0
    assert main(["identify", str(points), "--model", str(tmp_path / "p.json")]) == 0
    asked = ["--model", str(folder / "m.json"), "--compare", str(tmp_path / "p.json")]
    assert main(["validate", str(points), *asked, "--json", str(tmp_path / "v.json")]) == 0
    comparison = json.loads((tmp_path / "v.json").read_text("utf-8"))["comparison"]
    assert comparison["models"] == ["m", "p"]
    assert {"a3", "theta3", "c3"} <= {parameter["name"] for parameter in comparison["parameters"]}
    assert "E_n" in capsys.readouterr().out


def test_the_report_sets_the_preliminary_model_beside_nominal_and_final(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "r.html"
    legs = str(folder / "legs.csv")
    assert main(["identify", legs, "--report", str(out), "--preliminary", str(folder / "one.json")]) == 0
    text = out.read_text("utf-8")
    section = text[text.index("What the ballbar says</h2>") : text.index("Residual against joint angle</h2>")]
    means = {}
    for name in ("nominal robot", "preliminary (stage 1)", "identified"):
        row, sphere = re.findall(rf'<th scope="row">{re.escape(name)}</th>(.*?)</tr>', section)
        means[name] = float(re.findall(r'class="n">([\d.]+)', row)[1])
        assert "T1 about B1" in sphere
    assert means["nominal robot"] > means["preliminary (stage 1)"] > means["identified"]
    assert "n within 200 mm" in section
    assert main(["identify", legs, "--preliminary", str(folder / "one.json")]) == 2
    assert "'--preliminary': is used only in a report" in capsys.readouterr().err
