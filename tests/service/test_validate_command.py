"""`truepose validate`: its tables, its JSON and its refusals."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from calib.saved.model_file import SIMULATED
from mocks.campaign import make_campaign, write_campaign
from service.cli import main
from tests.service.campaigns import Rows, edit_rows, edit_text

FIGURES = {"n", "mean", "std", "mean_3std", "rms", "p95", "max"}


@pytest.fixture(scope="module")
def cell(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a data set, its identified model m.json and its diagnosed model d.json."""
    folder = tmp_path_factory.mktemp("cell")
    campaign = make_campaign(
        seed=4, n=80, n_validation=40, effects=["backlash:j4"], size=6.0, reference_every=20
    )
    data = write_campaign(campaign, folder)["csv"]
    assert main(["identify", data, "--model", str(folder / "m.json")]) == 0
    assert main(["diagnose", data, "--model", str(folder / "d.json")]) == 0
    return folder


def validate(cell: Path, out: Path, *options: str, code: int = 0) -> dict[str, Any]:
    assert main(["validate", str(cell / "data.csv"), *options, "--json", str(out)]) == code
    return json.loads(out.read_text("utf-8")) if code == 0 else {}


def copied(cell: Path, folder: Path) -> Path:
    """The data set elsewhere, to be spoilt."""
    for name in ("data.csv", "data.toml"):
        (folder / name).write_bytes((cell / name).read_bytes())
    return folder


def by_name(document: dict[str, Any]) -> dict[str, Any]:
    return {judged["model"]: judged for judged in document["judgements"]}


def test_a_model_is_judged_beside_the_nominal_robot(
    cell: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    document = validate(
        cell, tmp_path / "v.json", "--model", str(cell / "m.json"), "--point", "300", "0", "500"
    )
    assert document["format"] == "truepose-validation/1"
    assert (document["judged_on"], document["placed"], document["comparison"]) == ("validation", False, None)
    judged = by_name(document)
    assert set(judged) == {"nominal robot, placed", "m"}
    assert judged["m"]["position_mm"].keys() == FIGURES
    assert judged["m"]["position_mm"]["n"] == 40
    assert judged["m"]["pairs_mm"]["main"]["n"] == 780
    assert judged["m"]["orientation_mrad"] is None
    nominal = judged["nominal robot, placed"]
    assert judged["m"]["position_mm"]["rms"] < nominal["position_mm"]["rms"]
    groups = {group["by"]: group["position_mm"] for group in judged["m"]["groups"]}
    assert set(groups["target"]) == {"T1", "T2", "T3"}
    assert sum(found["n"] for found in groups["distance from the point"].values()) == 40
    assert document["warnings"] == [SIMULATED]
    shown = capsys.readouterr().out
    for piece in (
        "mean + 3 s",
        "all pairs",
        "branch",
        "approach of j6",
        "ISO 9283",
        "rows that the data set names",
        "nominal: mean",
    ):
        assert piece in shown


def test_the_errors_are_those_that_identify_tells(cell: Path, tmp_path: Path) -> None:
    document = validate(cell, tmp_path / "v.json", "--model", str(cell / "m.json"))
    assert main(["identify", str(cell / "data.csv"), "--json", str(tmp_path / "i.json")]) == 0
    identified = json.loads((tmp_path / "i.json").read_text("utf-8"))
    judged = by_name(document)
    for name, key in (("m", "error_identified_mm"), ("nominal robot, placed", "error_nominal_mm")):
        for figure in ("n", "rms", "mean", "p95", "max"):
            assert judged[name]["position_mm"][figure] == pytest.approx(identified[key][figure], abs=1e-9)


def test_repeats_by_iso_9283(cell: Path, tmp_path: Path) -> None:
    (pose,) = validate(cell, tmp_path / "v.json", "--model", str(cell / "m.json"))["iso9283"]["poses"]
    assert pose["visits"] == 7
    assert 0.0 < pose["RP_l_mm"] < 0.5
    assert pose["AP_xyz_mrad"] is None
    assert isinstance(pose["first_reading"], int)


def test_a_model_of_another_frame_is_named_and_placed(
    cell: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    moved = copied(cell, tmp_path)

    def move(rows: Rows) -> None:
        for row in rows:
            row["x_mm"], row["y_mm"] = str(-float(row["y_mm"])), str(float(row["x_mm"]) + 100.0)

    edit_rows(moved / "data.csv", move)
    edit_text(moved / "data.toml", 'world = "nominal"', 'world = "free"')
    lost = validate(moved, tmp_path / "lost.json", "--model", str(cell / "m.json"))
    assert by_name(lost)["m"]["position_mm"]["rms"] > 50.0
    assert any("--place" in text for text in lost["warnings"])
    placed = validate(moved, tmp_path / "placed.json", "--model", str(cell / "m.json"), "--place")
    assert placed["placed"]
    own = validate(cell, tmp_path / "own.json", "--model", str(cell / "m.json"))
    rms = [by_name(document)["m"]["position_mm"]["rms"] for document in (placed, own)]
    assert rms[0] == pytest.approx(rms[1], rel=0.05)


def test_all_rows_flatter_and_that_is_said(cell: Path, tmp_path: Path) -> None:
    document = validate(cell, tmp_path / "v.json", "--model", str(cell / "m.json"), "--all")
    assert document["judged_on"] == "all"
    assert by_name(document)["m"]["position_mm"]["n"] == 127
    assert any("flatters" in text for text in document["warnings"])


def test_hold_outs_side_by_side(cell: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    document = validate(cell, tmp_path / "v.json")
    kinds = {each["kind"]: each for each in document["hold_outs"]}
    assert set(kinds) == {"random", "region", "time"}
    for each in kinds.values():
        assert each["error_mm"].keys() == FIGURES
        assert (each["error_mm"]["n"], each["folds"], each["left_out"]) == (87, 5, 0)
    assert "flatters" in capsys.readouterr().out


def test_two_calibrations_are_compared(
    cell: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    document = validate(
        cell, tmp_path / "v.json", "--model", str(cell / "m.json"), "--compare", str(cell / "d.json")
    )
    comparison = document["comparison"]
    assert (comparison["models"], document["placed"]) == (["m", "d"], True)
    parameters = {p["name"]: p for p in comparison["parameters"]}
    a3 = parameters["a3"]
    expected = abs(a3["second"] - a3["first"]) / (2.0 * np.hypot(a3["u_first"], a3["u_second"]))
    assert a3["e_n"] == pytest.approx(expected)
    assert parameters["backlash:j4.gap"]["first"] is None
    assert comparison["prediction_difference_mm"]["n"] == 40
    judged = by_name(document)
    assert judged["d"]["position_mm"]["rms"] < judged["m"]["position_mm"]["rms"]
    assert any("same readings" in text for text in document["warnings"])
    assert "E_n" in capsys.readouterr().out


def refused(capsys: pytest.CaptureFixture[str], *words: str) -> str:
    capsys.readouterr()
    assert main(["validate", *words]) == 2
    shown = capsys.readouterr()
    assert "Traceback" not in shown.err
    assert shown.out == ""
    return shown.err


def test_what_it_refuses(cell: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    data, model = str(cell / "data.csv"), str(cell / "m.json")
    assert "data.toml, line 1: is not valid JSON" in refused(capsys, data, "--model", str(cell / "data.toml"))
    assert "there is no such file" in refused(capsys, data, "--model", str(tmp_path / "none.json"))
    assert "--model: is missing" in refused(capsys, data, "--place")
    assert "finite" in refused(capsys, data, "--model", model, "--point", "nan", "0", "0")
    assert "would be written over" in refused(capsys, data, "--model", model, "--json", model)


def test_a_model_of_another_robot(cell: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    other = tmp_path / "other.json"
    document = json.loads((cell / "m.json").read_text("utf-8"))
    document["robot"] = document["robot_table"]["name"] = "irb-of-my-own"
    del document["content_sha256"]  # as an older version wrote it
    other.write_text(json.dumps(document), "utf-8")
    data, model = str(cell / "data.csv"), str(cell / "m.json")
    assert "is a model of the robot 'irb-of-my-own'" in refused(capsys, data, "--model", str(other))
    assert "not 'abb-irb120'" in refused(capsys, data, "--model", model, "--compare", str(other))
    document = json.loads((cell / "m.json").read_text("utf-8"))
    document["robot_table"]["a"][2] += 1.0
    del document["content_sha256"], document["robot_sha256"]
    other.write_text(json.dumps(document), "utf-8")
    shown = refused(capsys, data, "--model", model, "--compare", str(other))
    assert "robot_table.a': its robot is not 'abb-irb120'" in shown


def test_no_validation_rows(cell: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = copied(cell, tmp_path)
    edit_rows(folder / "data.csv", lambda rows: [row.update(set="calibration") for row in rows])
    words = (str(folder / "data.csv"), "--model", str(cell / "m.json"))
    assert "no measured points or distances to judge by" in refused(capsys, *words)
    assert main(["validate", *words, "--all"]) == 0


def test_targets_elsewhere_and_an_accuracy_that_is_known_of_one_side_are_said(
    cell: Path, tmp_path: Path
) -> None:
    model = ("--model", str(cell / "m.json"))
    folder = copied(cell, tmp_path)
    edit_text(folder / "data.toml", "T1 = [\n    0.0", "T1 = [\n    1.5")
    edit_text(folder / "data.toml", 'world = "nominal"', 'world = "nominal"\nabsolute_accuracy = "off"')
    warnings = validate(folder, tmp_path / "v.json", *model)["warnings"]
    assert any("T1 lies 1.5 mm from where the model holds it" in text for text in warnings)
    assert any("unknown for the model and off for these readings" in text for text in warnings)
    warnings = validate(cell, tmp_path / "own.json", *model)["warnings"]
    assert not any("lies" in text or "accuracy" in text for text in warnings)


def only_to_judge(cell: Path, folder: Path) -> Path:
    """The data set without its calibration rows, elsewhere."""
    data = copied(cell, folder) / "data.csv"

    def held(rows: Rows) -> None:
        rows[:] = [row for row in rows if row["set"] == "validation"]

    edit_rows(data, held)
    return data


def test_validation_rows_alone_judge_a_model(
    cell: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    own = by_name(validate(cell, tmp_path / "own.json", "--model", str(cell / "m.json")))
    data = only_to_judge(cell, tmp_path)
    report, picture = tmp_path / "r.html", tmp_path / "p.svg"
    asked = ("--model", str(cell / "m.json"), "--report", str(report), "--picture", str(picture))
    document = validate(tmp_path, tmp_path / "v.json", *asked)
    judged = by_name(document)
    assert judged["m"]["position_mm"] == pytest.approx(own["m"]["position_mm"], abs=1e-9)
    nominal = judged["nominal robot, placed"]["position_mm"]
    assert (
        judged["m"]["position_mm"]["rms"]
        < nominal["rms"]
        < own["nominal robot, placed"]["position_mm"]["rms"]
    )
    assert any("placed by the rows that are judged" in text for text in document["warnings"])
    html, svg = report.read_text("utf-8"), picture.read_text("utf-8")
    assert json.loads(html.rpartition('id="truepose-result">')[2].partition("</script>")[0]) == document
    assert json.loads((cell / "m.json").read_text("utf-8"))["content_sha256"] in html
    assert f"{judged['m']['position_mm']['rms']:.3f}" in html
    assert "Residual against joint angle" not in html  # that of a fit
    assert svg.startswith("<svg")
    assert svg in html
    placed = by_name(validate(tmp_path, tmp_path / "placed.json", *asked[:2], "--place"))
    assert placed["m"]["position_mm"]["rms"] < own["m"]["position_mm"]["rms"]
    both = validate(tmp_path, tmp_path / "two.json", *asked, "--compare", str(cell / "d.json"))
    assert report.read_text("utf-8").count("d</th>")
    assert both["comparison"]["models"] == ["m", "d"]
    capsys.readouterr()
    for command in ("identify", "diagnose"):
        assert main([command, str(data)]) == 2
        shown = capsys.readouterr().err
        assert "data.csv, key 'set': has no calibration rows" in shown
        assert "validate" in shown
    assert "--model" in refused(capsys, str(data))


@pytest.mark.parametrize("options", [["--all", "--model", "m.json"], []])
def test_a_report_shows_what_a_model_was_not_fitted_to(
    options: list[str], cell: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options = [str(cell / each) if each == "m.json" else each for each in options]
    drawn = {"--report": tmp_path / "r.html", "--picture": tmp_path / "p.svg"}
    for option, out in drawn.items():
        assert option in refused(capsys, str(cell / "data.csv"), *options, option, str(out))
        assert not out.exists()


def test_rows_alone_that_mean_something_else_are_still_refused(
    cell: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data = only_to_judge(cell, tmp_path)
    edit_rows(data, lambda rows: [row.update(x_mm=f"{-float(row['x_mm'])}") for row in rows])
    assert "mirrored" in refused(capsys, str(data), "--model", str(cell / "m.json"))


def test_no_pose_is_repeated(cell: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = copied(cell, tmp_path)

    def once(rows: Rows) -> None:
        rows[:] = [row for row in rows if row["set"] != "reference"]

    edit_rows(folder / "data.csv", once)
    document = validate(folder, tmp_path / "v.json", "--model", str(cell / "m.json"))
    assert document["iso9283"]["poses"] == []
    assert "ISO 9283" not in capsys.readouterr().out
