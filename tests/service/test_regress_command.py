"""`truepose regress`: its table, document, report and model.

The use and the refusals of that model in `compensate` are tested too.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from calib.saved.model_file import load_model
from mocks.campaign import make_campaign, write_campaign
from service.cli import main
from tests.calib.campaigns import write_files
from tests.calib.ur5_path import rows_of
from tests.service.test_http_support import problem, served

MODELS = [
    "nominal robot, placed",
    "MLS-SVR on positions",
    "level 2",
    "MLS-SVR on residuals of level 2",
    "level 3",
    "MLS-SVR on residuals of level 3",
]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with data.csv and its comparison: o.json, m.json and r.html.

    The 30 waypoints are of gears with one error wave per turn.
    """
    folder = tmp_path_factory.mktemp("regress")
    rows, header = rows_of(2, count=30, samples=90, waves=8e-4)
    data = write_files(folder, rows, header)
    outputs = [f"--{kind}={folder / name}" for kind, name in (("json", "o.json"), ("model", "m.json"))]
    asked = ["--compare", "--level", "2", "--features", "turns", *outputs, "--report", str(folder / "r.html")]
    assert main(["regress", str(data), *asked]) == 0
    return folder


@pytest.fixture(scope="module")
def document(folder: Path) -> dict[str, Any]:
    return json.loads((folder / "o.json").read_text("utf-8"))


def test_the_document_holds_the_table(document: dict[str, Any]) -> None:
    assert document["format"] == "truepose-regression/1"
    assert (document["samples"], document["waypoints"]) == (90, 30)
    assert [row["name"] for row in document["table_um"]] == MODELS
    for row in document["table_um"]:
        for errors in (row["in_sample"], row["by_waypoint"]):
            axes = [errors["mae"][axis] for axis in "xyz"]
            assert errors["mae"]["mean"] == pytest.approx(np.mean(axes))
            squares = [errors["rmse"][axis] ** 2 for axis in "xyz"]
            assert errors["rmse"]["mean"] == pytest.approx(np.sqrt(np.mean(squares)))
    asked = document["asked"]
    assert (asked["name"], asked["columns"]) == (MODELS[3], 72)
    assert asked["independent_columns"] < 72


def test_the_findings_are_worked_out(document: dict[str, Any]) -> None:
    """The regression on residuals gains if gears err.

    The regression on positions is millimetres away for a turned wrist.
    """
    table = {row["name"]: row["by_waypoint"]["mae"]["mean"] for row in document["table_um"]}
    assert table[MODELS[3]] < table["level 2"] < table[MODELS[1]]
    turned = {each["name"]: each for each in document["turned_wrist"]}
    assert turned[MODELS[1]]["mean_mm"] > 5.0
    assert turned[MODELS[3]]["mean_mm"] < 0.5
    said = " ".join(document["findings"])
    assert f"{turned[MODELS[1]]['mean_mm']:.3f} mm" in said
    assert f"{table[MODELS[3]]:.1f} um on waypoints left out" in said
    assert "less than level 2 alone" in said


def test_the_report_has_the_panel(folder: Path, document: dict[str, Any]) -> None:
    text = (folder / "r.html").read_text("utf-8")
    assert "Regression beside identification" in text
    for name in MODELS:
        assert name in text
    mean = document["table_um"][1]["by_waypoint"]["rmse"]["mean"]
    assert (f">{mean:.1f}<" if mean < 1000.0 else f">{mean:,.0f}<") in text
    assert 'id="truepose-result"' in text
    assert 'aria-label="Errors of every predictor, by waypoint"' in text


def compensate(folder: Path, tmp_path: Path, joints: list[list[float]], *options: str) -> tuple[int, Path]:
    program, out = tmp_path / "in.csv", tmp_path / "out.csv"
    head = "target_id," + ",".join(f"j{k}_deg" for k in range(1, 7))
    lines = [f"p{i}," + ",".join(repr(a) for a in row) for i, row in enumerate(joints)]
    program.write_text("\n".join((head, *lines)) + "\n", "utf-8")
    return main(["compensate", str(folder / "m.json"), str(program), str(out), *options]), out


def test_targets_inside_are_corrected_with_it_and_outside_refused_by_name(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    saved = load_model(folder / "m.json")
    assert saved.regression is not None
    inside = np.degrees(saved.regression.joints[::30]).tolist()
    code, out = compensate(folder, tmp_path, inside)
    assert code == 0
    first = out.read_text("utf-8")
    turned = [[*row[:4], row[4] + 5.0, row[5]] for row in inside[:1]]
    code, out = compensate(folder, tmp_path, [*inside, *turned])
    assert code == 2
    assert (
        "target 'p3' cannot be corrected: outside the joint angles that the regression"
        in capsys.readouterr().err
    )
    code, out = compensate(folder, tmp_path, [*inside, *turned], "--keep-refused")
    assert code == 3
    assert out.read_text("utf-8").startswith(first)


def test_the_correction_contains_the_regression(folder: Path, tmp_path: Path) -> None:
    """The same model corrects differently without its regression table."""
    saved = load_model(folder / "m.json")
    assert saved.regression is not None
    inside = np.degrees(saved.regression.joints[::30]).tolist()
    _, out = compensate(folder, tmp_path, inside)
    with_it = out.read_text("utf-8")
    bare = json.loads((folder / "m.json").read_text("utf-8"))
    del bare["regression"], bare["content_sha256"]
    (tmp_path / "m.json").write_text(json.dumps(bare), "utf-8")
    _, out = compensate(tmp_path, tmp_path, inside)
    assert out.read_text("utf-8") != with_it


def test_other_commands_say_that_they_leave_it_out(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["export", str(folder / "m.json"), str(tmp_path / "t.csv"), "--as", "dh-csv"]) == 0
    assert "the regression in the model is left out" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (["--method", "svm"], "--method"),
        (["--kernel", "poly"], "--kernel"),
        (["--on", "angles"], "--on"),
        (["--features", "cubes"], "--features"),
    ],
)
def test_unknown_words_are_refused(
    options: list[str], says: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["regress", str(folder / "data.csv"), *options]) == 2
    assert says in capsys.readouterr().err


def test_an_arm_of_another_structure(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Its own products are refused by name; a set that fits any arm is the default."""
    data = write_campaign(make_campaign(seed=3, n=60, n_validation=4), tmp_path)["csv"]
    assert main(["regress", str(data), "--features", "closed-form"]) == 2
    assert "abb-irb120 does not have" in capsys.readouterr().err
    assert main(["regress", str(data), "--level", "3", "--json", str(tmp_path / "o.json")]) == 0
    document = json.loads((tmp_path / "o.json").read_text("utf-8"))
    assert document["asked"]["features"] == "turns"
    assert [row["name"] for row in document["table_um"]] == [MODELS[0], "level 3", MODELS[5]]


def test_over_http(folder: Path, tmp_path: Path) -> None:
    """A worker of the service makes the same comparison.

    A wrong request is refused before it waits for a worker.
    """
    with served(tmp_path / "record") as service:
        files = {f"{kind}": (folder / f"data.{kind}").read_bytes() for kind in ("csv", "toml")}
        kept = service.client.post("/datasets", files=files).json()
        asked = {"dataset_id": kept["id"], "level": 2, "features": "turns"}
        first, again = (
            service.client.post("/regressions", json=asked, headers={"Idempotency-Key": "regression-1"})
            for _ in range(2)
        )
        assert first.status_code == 202, first.text
        assert first.json()["id"] == again.json()["id"]
        done = service.until(f"/regressions/{first.json()['id']}", "succeeded", "failed")
        assert done["result"]["format"] == "truepose-regression/1"
        assert done["result"]["asked"]["name"] == MODELS[3]
        assert service.client.get(done["report"].removeprefix("/api/v1")).status_code == 200
        assert "regression" in service.client.get(f"/models/{done['id']}").json()
        wrong = service.client.post("/regressions", json={**asked, "features": "sums"})
        problem(wrong, 422)
        problem(service.client.post("/regressions", json={**asked, "dataset_id": "nobody"}), 404)
