"""The public Python API: its surface, and the loop from readings to corrected targets."""

from __future__ import annotations

import copy
import json
import math
import pickle
import re
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pandas
import pytest

import truepose
from service.cli import main
from tests.service.campaigns import write_data

SURFACE = {
    "Corrected": {"joints_deg", "wanted_deg", "found", "good", "radius_95_mm", "targets", "usable"},
    "Data": {"dataset", "readings", "simulated"},
    "Diagnosis": {
        "base",
        "carry_over",
        "document",
        "effects",
        "errors",
        "findings",
        "model",
        "next_measurements",
        "outcome",
        "plot_residuals",
        "power",
        "report",
        "sentence",
        "verdict",
    },
    "Model": {
        "converged",
        "data",
        "error_mm",
        "findings",
        "fitted",
        "parameters",
        "plot_residuals",
        "predict",
        "residuals",
        "save",
        "saved",
        "stated",
    },
    "Selection": {"choice", "curve", "joints_deg", "of_type", "poses", "reached_with", "u_by_count"},
    "Sweeps": {"joints", "readings", "result"},
    "Validation": {"errors", "judgements", "result"},
}
FUNCTIONS = {"compensate", "diagnose", "identify", "load", "read", "select", "simulate", "sweeps", "validate"}
POSES_DEG = [[10.0, 20.0, -30.0, 40.0, 50.0, 60.0], [-20.0, 35.0, 10.0, -60.0, 40.0, -15.0]]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("api")


@pytest.fixture(scope="module")
def csv(folder: Path) -> Path:
    return write_data(folder)


@pytest.fixture(scope="module")
def found(csv: Path) -> truepose.Diagnosis:
    return truepose.diagnose(csv)


def test_the_surface_is_what_it_was() -> None:
    """A name that goes, or comes, is a decision: others build on these."""
    assert set(truepose.__all__) == set(SURFACE) | FUNCTIONS | {"DataError"}
    for name, members in SURFACE.items():
        own = getattr(truepose, name)
        fields = set(getattr(own, "__dataclass_fields__", {}))
        assert {m for m in {*vars(own), *fields} if not m.startswith("_")} == members, name
    with pytest.raises(AttributeError, match="has no 'calibrate'; there are"):
        _ = truepose.calibrate  # type: ignore[attr-defined]


def test_the_import_loads_no_numbers() -> None:
    asked = (
        "import sys, truepose; print(sorted({'numpy', 'scipy', 'pandas', 'matplotlib'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", asked], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"


def test_every_public_name_says_what_it_is() -> None:
    for name in (*SURFACE, *FUNCTIONS):
        own = getattr(truepose, name)
        assert own.__doc__, name
        for member in SURFACE.get(name, ()):
            held = vars(own).get(member)
            assert held is None or held.__doc__, f"{name}.{member}"


def test_a_diagnosis_is_that_of_the_command(csv: Path, found: truepose.Diagnosis, folder: Path) -> None:
    assert main(["diagnose", str(csv), "--json", str(folder / "d.json")]) == 0
    document = json.loads((folder / "d.json").read_text("utf-8"))
    assert found.verdict == document["verdict"] == "attributed"
    assert list(dict.fromkeys(found.effects.index)) == [e["label"] for e in document["effects"]]
    assert found.errors.loc["with effects", "rms"] == pytest.approx(
        document["error_after_mm"]["rms"], abs=1e-5
    )
    assert found.errors["rms"].is_monotonic_decreasing
    assert len(found.power) == len(document["power"])
    assert "play of joint 4" in repr(found)
    assert "backlash:j4" in found._repr_html_()


def test_tables_of_a_model(csv: Path, found: truepose.Diagnosis) -> None:
    model = found.model
    data = truepose.read(csv)
    assert len(model.parameters) == len(model.saved.model.parameters)
    assert set(model.parameters["unit"]) >= {"mm", "deg"}
    errors = model.residuals
    held = errors[errors["set"] == "validation"]["error_mm"]
    assert float(np.sqrt(np.mean(held**2))) == pytest.approx(model.error_mm["rms"])
    apart = np.linalg.norm(errors[["dx_mm", "dy_mm", "dz_mm"]].to_numpy(), axis=1)
    assert apart == pytest.approx(errors["error_mm"].to_numpy())
    assert list(errors.index) == list(data.readings.index)
    assert truepose.identify(data, level=1).error_mm["rms"] > truepose.identify(data).error_mm["rms"]


def test_a_model_goes_to_its_file_and_back(found: truepose.Diagnosis, csv: Path, folder: Path) -> None:
    loaded = truepose.load(found.model.save(folder / "m.json"))
    target = next(iter(next(iter(loaded.saved.model.targets.values()))))
    at = {"joints_deg": POSES_DEG, "target": target}
    assert loaded.predict(**at) == pytest.approx(found.model.predict(**at), abs=1e-6)
    judged = truepose.validate(loaded, csv)
    assert judged.errors.loc["model", "rms"] == pytest.approx(found.model.error_mm["rms"], abs=1e-6)
    with pytest.raises(truepose.DataError, match="knows no readings"):
        _ = loaded.residuals


def test_rows_that_only_judge_judge_a_model(found: truepose.Diagnosis, csv: Path) -> None:
    data = truepose.read(csv)
    frame = pandas.read_csv(csv, dtype={"reading_id": str}).set_index("reading_id")
    held = truepose.read(frame.query("set == 'validation'"), csv.with_suffix(".toml"))
    judged = truepose.validate(found.model, held)
    assert len(held) == judged.judgements[1].error.n
    assert (
        judged.errors.loc["model", "rms"] == truepose.validate(found.model, data).errors.loc["model", "rms"]
    )
    with pytest.raises(truepose.DataError, match="no calibration rows"):
        truepose.identify(held)


def test_corrected_targets_land(found: truepose.Diagnosis) -> None:
    """The calibrated robot at the corrected targets is where the nominal one was to be."""
    done = truepose.compensate(found.model, joints_deg=POSES_DEG)
    assert done.good.all()
    assert np.all(done.found.landed < 1e-5)
    assert 0.0 < np.max(np.abs(done.joints_deg - done.wanted_deg)) < 2.0
    back = truepose.compensate(found.model, joints_deg=done.joints_deg, inverse=True)
    assert back.joints_deg == pytest.approx(np.array(POSES_DEG), abs=1e-6)
    assert list(done.targets["status"]) == ["corrected", "corrected"]


def test_limits_are_in_degrees(found: truepose.Diagnosis) -> None:
    assert truepose.compensate(found.model, joints_deg=POSES_DEG, limits_deg=[[-180.0, 180.0]] * 6).good.all()
    assert not truepose.compensate(found.model, joints_deg=POSES_DEG, limits_deg=[[-5.0, 5.0]] * 6).good.any()


def test_targets_that_the_model_knows_too_little_are_refused(found: truepose.Diagnosis) -> None:
    every = truepose.compensate(found.model, joints_deg=POSES_DEG)
    first, second = every.radius_95_mm
    between = 0.5 * (first + second)
    some = truepose.compensate(found.model, joints_deg=POSES_DEG, most_uncertainty=between)
    assert some.good.tolist() == [first <= between, second <= between]
    assert set(some.targets["status"]) == {"corrected", "uncertain"}
    assert np.isnan(some.joints_deg[~some.good]).all()
    assert np.array_equal(some.joints_deg[some.good], every.joints_deg[some.good])
    with pytest.raises(truepose.DataError, match="most_uncertainty"):
        truepose.compensate(found.model, joints_deg=POSES_DEG, most_uncertainty=-1.0)


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"point": (1.0, 2.0)}, "three finite numbers"),
        ({"point": (math.nan, 0.0, 0.0)}, "three finite numbers"),
        ({"point": ("x", 0.0, 0.0)}, "three finite numbers"),
        ({"accept_rms": -1.0}, "accept-rms"),
        ({"accept_zones": "none.toml"}, "none.toml"),
        ({"compare": "model.json"}, "compare"),
    ],
)
def test_a_validation_refuses_wrong_options(
    found: truepose.Diagnosis, csv: Path, wrong: dict[str, Any], said: str
) -> None:
    with pytest.raises(truepose.DataError, match=said):
        truepose.validate(found.model, csv, **wrong)


@pytest.mark.parametrize("wrong", [{"seed": -1}, {"wanted_u": -0.1}, {"wanted_u": math.nan}])
def test_a_selection_refuses_wrong_options(wrong: dict[str, Any]) -> None:
    cell = Path(__file__).parents[2] / "examples" / "irb120_faro" / "cell.toml"
    with pytest.raises(truepose.DataError, match=next(iter(wrong))):
        truepose.select(cell, candidates=60, **wrong)


def test_a_data_frame_is_a_data_set(csv: Path) -> None:
    data = truepose.read(csv)
    header = tomllib.loads(csv.with_suffix(".toml").read_text("utf-8"))
    again = truepose.read(data.readings, header)
    assert np.array_equal(again.dataset.points, data.dataset.points, equal_nan=True)
    assert again.dataset.reading_id == data.dataset.reading_id
    with pytest.raises(truepose.DataError, match="DataFrame, line 1: column 'j3_deg' is missing"):
        truepose.read(data.readings.drop(columns="j3_deg"), header)
    twice = data.readings.copy()
    twice.index = twice.index[[0, 0, *range(2, len(twice))]]
    with pytest.raises(truepose.DataError, match="is given twice"):
        truepose.read(twice, header)
    with pytest.raises(truepose.DataError, match="needs a header"):
        truepose.read(data.readings)


def test_results_are_pickled_and_copied(found: truepose.Diagnosis) -> None:
    again = pickle.loads(pickle.dumps(found))
    assert again.sentence == found.sentence
    assert copy.deepcopy(found.model).parameters.equals(found.model.parameters)


def test_predictions_are_where_the_readings_are(csv: Path) -> None:
    """The prediction at the joints of a reading is its point, if there are no approach effects."""
    data = truepose.read(csv)
    model = truepose.identify(data, level=2)
    readings = data.readings[data.readings["tool_target"] == "T1"]
    predicted = model.predict(joints_deg=readings, target="T1", temperature_c=20.0)
    measured = np.asarray(readings[["x_mm", "y_mm", "z_mm"]])
    apart = np.linalg.norm(predicted - measured, axis=1)
    assert apart == pytest.approx(model.residuals.loc[readings.index, "error_mm"].to_numpy(), abs=1e-9)


def test_progress_is_told(csv: Path) -> None:
    steps: list[str] = []
    truepose.identify(csv, progress=steps.append)
    assert steps


def test_reports_and_pictures(found: truepose.Diagnosis, folder: Path) -> None:
    assert "backlash" in found.report(folder / "r.html").read_text("utf-8")
    found.model.plot_residuals().savefig(folder / "a.png")
    assert found.model.plot_residuals()._repr_png_().startswith(b"\x89PNG")  # type: ignore[attr-defined]
    found.plot_residuals().savefig(folder / "b.png")
    assert (folder / "b.png").stat().st_size > 5000


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"joints_deg": [[1.0, 2.0]]}, r"joints_deg.*shape \(1, 2\)"),
        ({"joints_deg": [[np.nan] * 6]}, "not finite"),
        ({"joints_deg": [[np.nan, 1.0, 1.0, 1.0, 1.0, 1.0]]}, "not finite"),
        ({"joints_deg": [["ten"] * 6]}, "not an array of numbers"),
        ({"joints_deg": [[1.0] * 6, [1.0] * 5]}, "not an array of numbers"),
        ({"joints_deg": POSES_DEG, "temperature_c": 295.0}, r"temperature_c.*is 295\."),
        ({"joints_deg": POSES_DEG, "temperature_c": float("nan")}, "temperature_c.*is nan"),
        ({"joints_deg": POSES_DEG, "temperature_c": "warm"}, "temperature_c.*is str, not a number"),
        ({"joints_deg": POSES_DEG, "time_s": np.zeros(2)}, "time_s.*is ndarray, not a number"),
        ({"joints_deg": POSES_DEG, "time_s": float("inf")}, "time_s.*is inf"),
        ({"joints_deg": POSES_DEG, "side": 2}, "side.*is 2"),
        ({"joints_deg": POSES_DEG, "target": "T99"}, "T99"),
        ({"joints_deg": POSES_DEG, "series": "other"}, "'other' is not a series"),
        ({"joints_deg": POSES_DEG, "limits_deg": [[0, 1]]}, r"limits_deg.*shape \(1, 2\)"),
    ],
)
def test_arguments_that_cannot_be_meant(found: truepose.Diagnosis, given: dict, says: str) -> None:
    with pytest.raises(truepose.DataError, match=says):
        truepose.compensate(found.model, **given)


def test_what_is_neither_a_model_nor_a_data_set(csv: Path) -> None:
    for act in (
        lambda: truepose.validate("m.json", csv),  # type: ignore[arg-type]
        lambda: truepose.compensate("m.json", joints_deg=POSES_DEG),  # type: ignore[arg-type]
    ):
        with pytest.raises(truepose.DataError, match="is str, not a model"):
            act()
    with pytest.raises(truepose.DataError, match="is list"):
        truepose.read([1, 2])  # type: ignore[arg-type]


def test_results_of_another_version_are_refused(found: truepose.Diagnosis, folder: Path) -> None:
    document = json.loads(found.model.save(folder / "now.json").read_text("utf-8"))
    later = folder / "later.json"
    later.write_text(json.dumps({**document, "format": "truepose-model/99"}), "utf-8")
    with pytest.raises(truepose.DataError, match="is not a model file"):
        truepose.load(later)


def test_degrees_that_look_like_radians_are_pointed_out(found: truepose.Diagnosis) -> None:
    with pytest.warns(UserWarning, match="radians"):
        found.model.predict(joints_deg=np.deg2rad(np.tile(POSES_DEG, (3, 1))), target="T1")


def test_poses_are_selected_for_a_cell() -> None:
    cell = Path(__file__).parents[2] / "examples" / "irb120_faro" / "cell.toml"
    chosen = truepose.select(cell, count=20, candidates=200)
    assert chosen.poses.shape == (20, 6)
    assert chosen.u_by_count["largest_mm"].is_monotonic_decreasing
    assert "20 poses" in repr(chosen)


def test_the_blocks_of_the_documentation_run(
    csv: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    root = Path(__file__).parents[2]
    text = (root / "docs" / "python.md").read_text("utf-8")
    for ending in (".csv", ".toml"):
        (tmp_path / f"data{ending}").write_bytes(csv.with_suffix(ending).read_bytes())
    (tmp_path / "cell.toml").write_bytes((root / "examples" / "irb120_faro" / "cell.toml").read_bytes())
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    for block in re.findall(r"```python\n(.*?)```", text, re.DOTALL):
        exec(compile(block, "docs/python.md", "exec"), names)
    assert "backlash:j4" in capsys.readouterr().out
    assert (tmp_path / "report.html").is_file()
