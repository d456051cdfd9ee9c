"""Watches by other readings, at the command line: touched balls, legs, the arm's warmth."""

from __future__ import annotations

import csv
import json
import tomllib
from pathlib import Path

import numpy as np
import pytest

from acquisition import read_campaign, read_cell
from acquisition.campaign import make_plan
from acquisition.cell import targets_at
from calib import DataError, identify, load_model, read_dataset, save_model
from calib.saved import as_saved
from drivers import ConfigError
from service.cli import main
from service.results.watch_plan import PlannedWatch, WatchPlanRequest
from tests.acquisition.fakes import BALLBAR, a_campaign, a_cell
from tests.benchmarks.coverage import KINDS, simulate
from tests.calib.updates import save_warming
from tests.service.campaigns import edit_rows, write_data

CELL = Path(__file__).parents[2] / "examples" / "irb120_faro" / "cell.toml"
NESTS = "N1 = [0.0, 0.0, 0.0], N2 = [600.0, 0.0, 0.0], N3 = [0.0, 600.0, 0.0]"
REACHED = "N1 = [350.0, 150.0, 200.0], N2 = [350.0, -150.0, 200.0], N3 = [250.0, 250.0, 250.0]"


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("base")
    fitted = identify(read_dataset(write_data(folder, effects=(), n=90)))
    save_model(folder / "m.json", fitted)
    return folder / "m.json"


def test_balls_to_be_touched_are_a_data_set_to_fill_in(model: Path, tmp_path: Path) -> None:
    cell, out = tmp_path / "cell.toml", tmp_path / "touched.csv"
    text = CELL.read_text("utf-8")
    assert NESTS in text
    cell.write_text(text.replace(NESTS, REACHED), "utf-8")
    asked = ["watch", "plan", str(model), str(cell), "--poses", "6", "--from", "30", "--touch", "N1,N2,N3"]
    assert main([*asked, "--targets", "T2", "--out", str(out)]) == 0
    rows = list(csv.DictReader(out.read_text("utf-8").splitlines()))
    assert {row["ball"] for row in rows} <= {"N1", "N2", "N3"}
    assert tomllib.loads(out.with_suffix(".toml").read_text("utf-8"))["noise"]["kind"] == "isotropic"
    assert main(["watch", "judge", str(model), str(out)]) == 2  # nothing was touched yet
    # the nominal robot holds the target in the ball of each row
    there = read_cell(cell)
    joints = np.array([[float(row[f"j{k}_deg"]) for k in range(1, 7)] for row in rows])
    at = targets_at(there, joints)[:, list(there.tool.targets).index("T2")]
    balls = [[float(row[f"{axis}_mm"]) for axis in "xyz"] for row in rows]
    np.testing.assert_allclose(at, balls, atol=0.01)
    for wrong in (["--targets", "T1,T2"], ["--targets", "T2", "--touch", "N1,N9,N3"]):
        assert main([*asked, *wrong, "--out", str(out)]) == 2
    assert main([*asked, "--targets", "T2", "--out", str(tmp_path / "touched.toml")]) == 2


def test_several_visits_alternate_and_the_nests_are_looked_at(model: Path, tmp_path: Path) -> None:
    out = tmp_path / "w.toml"
    asked = ["watch", "plan", str(model), str(CELL), "--out", str(out), "--poses", "4", "--from", "30"]
    assert main([*asked, "--targets", "T2", "--visits", "2", "--readings", "1"]) == 0
    visits = [visit for visit in make_plan(read_cell(CELL), read_campaign(out)) if visit.kind == "pose"]
    assert len(visits) == 8
    for first, second in zip(visits[:4], visits[4:], strict=True):
        assert first.joints_deg == second.joints_deg
        assert [a + b for a, b in zip(first.sides, second.sides, strict=True)] == [0] * 6
    check = tomllib.loads(out.read_text("utf-8"))["nest_check"]
    assert check["every"] == 4
    assert 0.03 < check["limit_mm"] < 0.3


def test_legs_are_measured_as_the_block_has_them() -> None:
    cell = a_cell(**BALLBAR)
    visits = make_plan(cell, a_campaign(block=[{"kind": "hexapod", "count": 2}]))
    legs = [list(zip(visit.targets, visit.base_targets, strict=True)) for visit in visits]
    block = {
        "kind": "legs",
        "joints_deg": [list(visit.joints_deg) for visit in visits],
        "legs": [[list(leg) for leg in some] for some in legs],
        "approach_sides": [[1, -1, 1, 1, 1, -1]] * 2,
    }
    again = make_plan(cell, a_campaign(block=[block]))
    assert [(v.joints_deg, v.targets, v.base_targets) for v in again] == [
        (v.joints_deg, v.targets, v.base_targets) for v in visits
    ]
    assert again[0].sides == (1, -1, 1, 1, 1, -1)
    for key, value in (
        ("legs", [[["T1"]]]),
        ("legs", block["legs"][:1]),
        ("approach_sides", [[1, 0, 1, 1, 1, 1]]),
    ):
        with pytest.raises(ConfigError, match=r"legs|approach_sides|joints_deg"):
            make_plan(cell, a_campaign(block=[block | {key: value}]))
    with pytest.raises(ConfigError, match="B9"):
        make_plan(cell, a_campaign(block=[block | {"legs": [[["T1", "B9"]]] * 2}]))


def test_the_warmth_of_the_day_is_updated_and_the_clock_is_asked_for(
    model: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    csv_file = write_data(tmp_path, effects=(), n=12)
    edit_rows(csv_file, lambda rows: rows.__delitem__(slice(12, None)))
    assert main(["watch", "upkeep", str(model), str(csv_file)]) == 2
    assert "no thermal effect" in capsys.readouterr().err
    folder = tmp_path / "warm"
    folder.mkdir()
    fitted = identify(read_dataset(write_data(folder, effects=(), n=90)))
    warming, out, document = tmp_path / "warm.json", tmp_path / "now.json", tmp_path / "u.json"
    save_warming(warming, fitted, 1e-5, 1e-6)
    asked = ["watch", "thermal", str(warming), str(csv_file), "--update", str(out), "--json", str(document)]
    assert main(asked) == 2
    assert "--since-cold-start-s" in capsys.readouterr().err
    assert main([*asked, "--running-s", "3000"]) == 0
    told = json.loads(document.read_text("utf-8"))
    assert told["thermal"]
    (changed,) = told["parameters"]
    now = load_model(out)
    assert now.estimate[-1] * 1e6 == pytest.approx(changed["value"], rel=1e-6)
    assert now.updates[-1]["by"] == "truepose watch thermal"

    def struck(rows: list[dict[str, str]]) -> None:
        for row in rows:
            row["x_mm"] = str(float(row["x_mm"]) + 0.05 * float(row["j4_deg"]))

    edit_rows(csv_file, struck)
    out.unlink()
    assert main([*asked, "--running-s", "3000"]) == 6
    assert not out.exists()


def test_a_ballbar_takes_stances_that_the_model_brings_within_its_stroke() -> None:
    """A baseline by another arm's distances has other balls.

    It is refused by name, before a long search.
    """
    cell = a_cell(**BALLBAR)
    other = as_saved(identify(simulate(KINDS[3], 1).data))
    question = WatchPlanRequest(6, 100, ("T1",), 5.0, False, 0.01, 1)
    with pytest.raises(DataError, match="first three"):
        PlannedWatch.of(cell, Path("cell.toml"), other, Path("m.json"), question)
