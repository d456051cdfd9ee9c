"""The commands: JSON by the contract, predictions, exit codes, what goes to which stream."""

from __future__ import annotations

import json
import math
import socket
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from acquisition import checked_plan, read_campaign, read_cell
from calib.data.read import read_dataset
from service.cli import main
from tests.end_to_end.simulated import EXAMPLE, truepose
from tests.service.campaigns import edit_rows, read_rows, write_data, write_narrow_data

EFFECT_KEYS = {"label", "meaning", "index", "candidates", "parameters", "evidence"}
DIAGNOSIS_KEYS = {
    "format",
    "verdict",
    "effects",
    "faulty_rows",
    "relabelled_rows",
    "p_lack_of_fit",
    "held_out_misfit",
    "noise_scale",
    "error_before_mm",
    "error_after_mm",
    "error_nominal_mm",
    "follow_up",
    "seconds",
}


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_data(tmp_path_factory.mktemp("backlash"))


def test_diagnose_writes_the_document_of_the_contract(data: Path, tmp_path: Path) -> None:
    assert main(["diagnose", str(data), "--json", str(tmp_path / "r.json")]) == 0
    assert [path.name for path in tmp_path.iterdir()] == ["r.json"]  # nothing half written is left
    document = json.loads((tmp_path / "r.json").read_text("utf-8"))
    assert document.keys() >= DIAGNOSIS_KEYS
    assert document["format"] == "truepose-diagnosis/1"
    assert document["verdict"] == "attributed"
    (effect,) = document["effects"]
    assert effect.keys() >= EFFECT_KEYS
    assert effect["label"] == "backlash:j4"
    assert effect["index"] is None
    assert effect["group"] == "transmission"
    assert "preload of the gear of joint 4" in effect["check"]
    assert document["follow_up"] == []
    assert effect["parameters"]["gap"].keys() == {"value", "std", "unit"}
    assert effect["evidence"].keys() == {"delta_bic", "p_value", "explained_variance"}
    assert 0.0 < sum(effect["candidates"].values()) <= 1.0 + 1e-9
    for name in ("error_before_mm", "error_after_mm", "error_nominal_mm"):
        assert document[name].keys() == {"n", "rms", "mean", "p95", "max"}
        assert document[name]["n"] == 40
    assert document["error_after_mm"]["rms"] < document["error_before_mm"]["rms"]
    misfit = document["held_out_misfit"]
    assert misfit.keys() == {"times_expected", "p_value", "beyond"}
    assert 0.7 < misfit["times_expected"] < 1.3
    assert 1e-3 < misfit["p_value"] < 1.0
    assert misfit["beyond"] is False


def test_json_on_standard_output_stands_alone_and_effects_are_carried_over(data: Path) -> None:
    done = truepose("diagnose", str(data), "--carry-to", str(data), "--json", "-")
    assert done.returncode == 0
    document = json.loads(done.stdout)
    assert document["format"] == "truepose-diagnosis/1"
    carried = document["carry_over"]
    assert carried["error_frozen_mm"]["rms"] < carried["error_base_mm"]["rms"]
    assert "searching" in done.stderr
    assert "\x1b" not in done.stderr


def test_the_table_for_people_goes_to_standard_output(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A diagnosis without ambiguity, and accurate enough, proposes no further poses."""
    campaign = tmp_path / "follow_up.toml"
    assert main(["diagnose", str(data), "--follow-up", str(campaign), "--accept-rms", "0.5"]) == 0
    assert not campaign.exists()
    shown = capsys.readouterr()
    assert "nothing is ambiguous, no file was written" in shown.err
    for piece in ("Attributed.", "backlash:j4", "±", "deg", "explains", "rivals", "95 %", "validation rows"):
        assert piece in shown.out
    assert "searching" not in shown.out
    assert "searching" in shown.err


def test_all_results_are_written_though_the_accuracy_is_not_met(data: Path, tmp_path: Path) -> None:
    """The predictions hold every validation row, measured or not."""
    copy = tmp_path / "data.csv"
    copy.write_bytes(data.read_bytes())
    copy.with_suffix(".toml").write_bytes(data.with_suffix(".toml").read_bytes())
    hidden: list[str] = []

    def hide_three(rows: list[dict[str, str]]) -> None:
        for row in [row for row in rows if row["set"] == "validation"][:3]:
            row.update(x_mm="", y_mm="", z_mm="")
            hidden.append(row["reading_id"])

    edit_rows(copy, hide_three)
    result, predictions = tmp_path / "r.json", tmp_path / "p.csv"
    words = ["--json", str(result), "--predictions", str(predictions), "--accept-rms", "0.001"]
    assert main(["diagnose", str(copy), *words]) == 3
    acceptance = json.loads(result.read_text("utf-8"))["acceptance"]
    assert (acceptance["verdict"], acceptance["model"]) == ("rejected", "base model with the effects found")
    rows = read_rows(predictions)
    columns = ["reading_id", "x_mm", "y_mm", "z_mm", "x_base_mm", "y_base_mm", "z_base_mm"]
    assert list(rows[0]) == [*columns, "simulated"]
    assert {row["simulated"] for row in rows} == {"yes"}
    whole = read_dataset(data)
    held = np.flatnonzero(whole.sets == "validation")
    assert [row["reading_id"] for row in rows] == [whole.reading_id[i] for i in held]
    assert {row["reading_id"] for row in rows} >= set(hidden)
    predicted = np.array([[float(row[f"{axis}_mm"]) for axis in "xyz"] for row in rows])
    base = np.array([[float(row[f"{axis}_base_mm"]) for axis in "xyz"] for row in rows])
    after = np.linalg.norm(predicted - whole.points[held], axis=1)
    before = np.linalg.norm(base - whole.points[held], axis=1)
    assert math.sqrt(np.mean(after**2)) < 0.5 * math.sqrt(np.mean(before**2))


def test_at_most_so_many_effects(data: Path, tmp_path: Path) -> None:
    assert main(["diagnose", str(data), "--most", "0", "--json", str(tmp_path / "r.json")]) == 0
    assert json.loads((tmp_path / "r.json").read_text("utf-8"))["effects"] == []


def test_identify_names_values_errors_and_what_was_dropped(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    result = tmp_path / "r.json"
    model = tmp_path / "m.json"
    assert main(["identify", str(data), "--json", str(result), "--model", str(model)]) == 0
    shown = capsys.readouterr().out
    document: dict[str, Any] = json.loads(result.read_text("utf-8"))
    parameters = {p["name"]: p for p in document["parameters"]}
    assert parameters["a3"]["nominal"] == pytest.approx(270.0)
    assert 0.0 < parameters["a3"]["std"] < 0.5
    dropped = [p for p in document["parameters"] if p["dropped"]]
    assert dropped
    assert all(p["value"] is None and p["confounded_with"] for p in dropped)
    assert f"dropped: confounded with {dropped[0]['confounded_with'][0]}" in shown
    assert "[1]" in shown
    assert document["error_identified_mm"]["rms"] < document["error_nominal_mm"]["rms"]
    assert json.loads(model.read_text("utf-8"))["format"] == "truepose-model/1"


def test_what_is_ambiguous_becomes_a_campaign_of_the_cell(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data, cell = write_narrow_data(tmp_path), EXAMPLE / "cell.toml"
    campaign, result, report = (tmp_path / name for name in ("follow_up.toml", "r.json", "report.html"))
    words = [
        "--follow-up",
        str(campaign),
        "--cell",
        str(cell),
        "--json",
        str(result),
        "--report",
        str(report),
    ]
    assert main(["diagnose", str(data), *words]) == 0
    document = json.loads(result.read_text("utf-8"))
    assert document["verdict"] == "ambiguous"
    poses, *procedures = document["follow_up"]
    assert poses["kind"] == "poses"
    assert all(each.keys() == {"kind", "text"} for each in procedures)
    assert len(poses["joints_deg"]) == len(poses["sides"]) == len(poses["targets"]) == 12
    assert {len(row) for row in (*poses["joints_deg"], *poses["sides"])} == {6}
    (effect,) = document["effects"]
    pairs = [(pair["effect"], pair["rival"]) for pair in poses["separates"]]
    assert pairs == [(effect["label"], label) for label in effect["candidates"] if label != effect["label"]]
    assert all(pair["squared_distance"] > poses["settles"] for pair in poses["separates"])
    visits = [v for v in checked_plan(read_cell(cell), read_campaign(campaign)) if v.kind == "pose"]
    assert sorted(list(v.joints_deg) for v in visits) == sorted(poses["joints_deg"])
    shown = capsys.readouterr()
    for piece in ("What 12 follow-up poses would distinguish", *pairs[0]):
        assert piece in shown.out
    assert str(campaign) in shown.err
    page = report.read_text("utf-8")
    assert "What to measure next" in page
    assert page.count(f"<code>{pairs[0][1]}</code>") >= 2


def test_a_follow_up_needs_the_cell_of_the_data(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    cell = tmp_path / "cell.toml"
    text = (EXAMPLE / "cell.toml").read_text("utf-8")
    cell.write_text(text.replace("T1 =", "A1 =").replace("T2 =", "A2 =").replace("T3 =", "A3 ="), "utf-8")
    campaign = tmp_path / "follow_up.toml"
    data = write_narrow_data(tmp_path)
    assert main(["diagnose", str(data), "--follow-up", str(campaign), "--cell", str(cell)]) == 2
    assert "has the targets A1, A2, A3, the data have T1, T2, T3" in capsys.readouterr().err
    assert not campaign.exists()


def test_a_patch_is_told_apart_and_applied_to_nothing_else(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data = write_data(tmp_path, effects=("outside:workspace_field",), n=240)
    plain, patched, report = (tmp_path / name for name in ("plain.json", "patched.json", "report.html"))
    assert main(["diagnose", str(data), "--json", str(plain)]) == 0
    assert "patch" not in json.loads(plain.read_text("utf-8"))
    capsys.readouterr()
    assert main(["diagnose", str(data), "--patch", "--json", str(patched), "--report", str(report)]) == 0
    without, with_it = (json.loads(path.read_text("utf-8")) for path in (plain, patched))
    patch = with_it.pop("patch")
    del without["seconds"], with_it["seconds"]
    assert with_it == without
    assert "not a cause" in patch["meaning"]
    assert patch["error_without_mm"] == without["error_after_mm"]
    assert patch["block_rms_with_mm"] < patch["block_rms_without_mm"]
    assert patch["error_with_mm"]["rms"] < patch["error_without_mm"]["rms"]
    assert patch["worth_it"] == (patch["block_rms_with_mm"] < 0.97 * patch["block_rms_without_mm"])
    assert "with the patch" in capsys.readouterr().out
    page = report.read_text("utf-8")
    assert "With a patch" in page
    assert "no correction uses it" in page


def test_convert_holds_out_what_was_asked_for(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    names = ["timestamp", *(f"q{k}_rad" for k in range(1, 7)), "temp_C", "x_mm", "y_mm", "z_mm"]
    names += [f"r{axis}_deg_XYZintrinsic" for axis in "xyz"]
    lines = [",".join(names)]
    lines += [",".join(["20200101120000", *(str(0.01 * (i + k)) for k in range(13))]) for i in range(50)]
    source = tmp_path / "series.csv"
    source.write_text("\n".join(lines) + "\n", "utf-8")
    out = tmp_path / "data.csv"
    arguments = ["convert", str(source), str(out), "--from", "ipa-ur10"]
    assert main([*arguments, "--holdout", "block", "--share", "0.2", "--json", "-"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert (document["readings"], document["validation"]) == (50, 10)
    rows = read_rows(out)
    assert sum(row["set"] == "validation" for row in rows) == 10
    assert 'kind = "block"' in out.with_suffix(".toml").read_text("utf-8")


def test_the_json_is_there_when_the_report_fails(
    data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: object, **__: object) -> str:
        raise OSError(28, "No space left on device", "report.html")

    monkeypatch.setattr("service.report.diagnosis_report", broken)
    names = ("r.json", "p.csv", "m.json", "report.html")
    outputs = [str(tmp_path / name) for name in names]
    words = zip(("--json", "--predictions", "--model", "--report"), outputs, strict=True)
    assert main(["diagnose", str(data), *(word for pair in words for word in pair)]) == 1
    assert {path.name for path in tmp_path.iterdir()} == set(names[:3])


def test_a_name_of_a_file_gives_the_terminal_no_orders(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["identify", str(tmp_path / "a\x1b[2J\x9b31m.csv")]) == 2
    complaint = capsys.readouterr().err
    assert "a\ufffd[2J\ufffd31m.csv: there is no such file" in complaint


def test_the_version(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"truepose {metadata.version('truepose')}\n"


def test_a_port_that_is_taken_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        assert main(["serve", "--port", str(port), "--record", str(tmp_path / "r")]) == 2
    assert f"key '--port': {port} of 127.0.0.1 cannot be opened" in capsys.readouterr().err
