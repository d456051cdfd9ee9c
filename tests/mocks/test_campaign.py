"""The simulated data set: columns, header, design of the campaign, files, command line."""

from __future__ import annotations

import csv
import itertools
import json
import math
import time
import tomllib
from pathlib import Path

import numpy as np
import pytest

from mocks.campaign import main, make_campaign, write_campaign
from mocks.world import ROBOTS, displacement, noise_rms, rms_per_axis

COLUMNS = [
    "reading_id",
    "set",
    "t_s",
    *(f"j{i}_deg" for i in range(1, 7)),
    *(f"approach{i}" for i in range(1, 7)),
    *(f"prev{i}_deg" for i in range(1, 7)),
    "tool_target",
    "x_mm",
    "y_mm",
    "z_mm",
    "t_air_c",
    "status",
]


def test_rows_follow_the_contract() -> None:
    campaign = make_campaign(seed=4)
    assert len(campaign.rows) == 300
    for order, row in enumerate(campaign.rows):
        assert list(row) == COLUMNS
        assert row["reading_id"] == order
        assert row["tool_target"] in campaign.header["tool_targets"]
        for i in range(1, 7):
            assert row[f"approach{i}"] in (-1, 1)
            expected = row[f"j{i}_deg"] - 5.0 * row[f"approach{i}"]
            assert row[f"prev{i}_deg"] == pytest.approx(expected, abs=1e-9)
            low, high = ROBOTS["abb-irb120"].range_deg[i - 1]
            assert low <= row[f"j{i}_deg"] <= high
        assert row["z_mm"] > 10.0
    sets = [row["set"] for row in campaign.rows]
    assert sets.count("calibration") == 200
    assert sets.count("validation") == 100
    assert 10 < sets[:100].count("validation") < 60  # interleaved, not appended
    assert {row["tool_target"] for row in campaign.rows} == {"T1", "T2", "T3"}
    assert np.all(np.diff([row["t_s"] for row in campaign.rows]) == 20.0)


def test_sides_are_independent_of_pose_and_of_each_other() -> None:
    rows = make_campaign(seed=4, n=400, n_validation=0, effects=[]).rows
    sides = np.array([[row[f"approach{i}"] for i in range(1, 7)] for row in rows], dtype=float)
    joints = np.array([[row[f"j{i}_deg"] for i in range(1, 7)] for row in rows])
    between = np.corrcoef(np.hstack([sides, joints]).T)[:6] - np.eye(6, 12)
    assert np.abs(between).max() < 0.2


def test_one_side_and_direct_approach() -> None:
    one = make_campaign(seed=4, n=20, n_validation=0, effects=[], both_sides=False).rows
    assert all(row[f"approach{i}"] == 1 for row in one for i in range(1, 7))
    direct = make_campaign(seed=4, n=20, n_validation=0, effects=[], approach="direct").rows
    for before, row in itertools.pairwise(direct):
        assert [row[f"prev{i}_deg"] for i in range(1, 7)] == [before[f"j{i}_deg"] for i in range(1, 7)]
        for i in range(1, 7):
            assert (row[f"j{i}_deg"] >= row[f"prev{i}_deg"]) == (row[f"approach{i}"] == 1)


def test_reference_rows_repeat_one_pose() -> None:
    rows = make_campaign(seed=4, n=40, n_validation=10, effects=[], reference_every=10).rows
    reference = [row for row in rows if row["set"] == "reference"]
    assert len(reference) == 6
    assert len({tuple(row[f"j{i}_deg"] for i in range(1, 7)) for row in reference}) == 1
    points = np.array([[row["x_mm"], row["y_mm"], row["z_mm"]] for row in reference])
    assert np.ptp(points, axis=0).max() < 0.3


def test_same_seed_same_campaign() -> None:
    one, two, other = make_campaign(seed=4), make_campaign(seed=4), make_campaign(seed=5)
    assert one.rows == two.rows
    assert one.truth == two.truth
    assert one.header == two.header
    assert one.rows != other.rows


def test_effects_are_as_large_as_asked() -> None:
    campaign = make_campaign(seed=4, effects=["backlash:j4", "drift_rotation"], size=2.0)
    noise = noise_rms(campaign.world, campaign.readings)
    for effect in campaign.world.effects:
        moved = displacement(campaign.world, effect, campaign.readings)
        assert rms_per_axis(moved) == pytest.approx(2.0 * noise, rel=1e-4)
    assert [e["label"] for e in campaign.truth["effects"]] == ["backlash:j4", "drift_rotation"]


def test_one_effect_is_drawn_unless_told_otherwise() -> None:
    names = {make_campaign(seed=s, n=30, n_validation=0).truth["effects"][0]["label"] for s in range(12)}
    assert len(names) > 4
    assert make_campaign(seed=1, n=30, n_validation=0, effects=[]).truth["effects"] == []


def test_departure() -> None:
    campaign = make_campaign(seed=4, n=60, effects=["backlash:j4", "base_shift"], departure="relaxing_step")
    assert [e["shape"] for e in campaign.truth["effects"]] == ["textbook", "relaxing_step"]
    drawn = make_campaign(seed=4, n=60, departure="sqrt_drift")
    assert drawn.truth["effects"][0]["shape"] == "sqrt_drift"
    with pytest.raises(ValueError, match="applies to none"):
        make_campaign(effects=["backlash:j4"], departure="sqrt_drift")
    with pytest.raises(ValueError, match="melting"):
        make_campaign(effects=["backlash:j4"], departure="melting")


def test_spoilt_rows_are_listed() -> None:
    clean = make_campaign(seed=4, n=60, n_validation=20, effects=[])
    spoilt = make_campaign(seed=4, n=60, n_validation=20, effects=[], gross_rows=2, swapped_rows=3)
    faulty, relabelled = spoilt.truth["faulty_rows"], spoilt.truth["relabelled_rows"]
    assert (len(faulty), len(relabelled)) == (2, 3)
    for before, row in zip(clean.rows, spoilt.rows, strict=True):
        moved = math.dist(*([r["x_mm"], r["y_mm"], r["z_mm"]] for r in (before, row)))
        expected = 2.0 if row["reading_id"] in faulty else 0.0
        assert moved == pytest.approx(expected, abs=1e-5)
        swapped = [row["reading_id"], row["tool_target"], before["tool_target"]] in relabelled
        assert swapped == (row["tool_target"] != before["tool_target"])
        if swapped or row["reading_id"] in faulty:
            assert row["set"] == "calibration"


@pytest.mark.parametrize("robot", sorted(ROBOTS))
def test_header_follows_the_contract(robot: str) -> None:
    header = make_campaign(robot, n=10, n_validation=0, effects=[], noise_declared_factor=0.5).header
    assert header["format"] == "truepose-dataset/1"
    assert header["robot"] == robot
    assert header["world"] == "nominal"
    assert header["model"]["fit"] == ["base", "geometry", "parallel_twist", "compliance"]
    assert header["noise"] == {
        "kind": "tracker",
        "station_mm": [2400.0, -900.0, 350.0],
        "range_mm": 0.005,
        "range_ppm": 1.0,
        "transverse_mm": 0.005,
        "transverse_ppm": 3.0,
        "repeatability_deg": 0.0004,
    }
    assert header["tool_targets"]["T2"] == [75.0, 93.675, 215.0]
    assert "loads" not in header


def test_loads_are_declared_where_they_differ() -> None:
    header = make_campaign(n=10, n_validation=0, effects=[], tool_mass_kg=1.5).header
    assert header["loads"][-1] == {"link": 6, "mass_kg": 1.5, "cog_mm": [50.0, 25.0, 100.0]}
    assert len(header["loads"]) == 3


def test_a_wrong_payload_is_not_declared() -> None:
    campaign = make_campaign(n=20, n_validation=0, effects=["payload_mass"])
    assert "loads" not in campaign.header


def test_files_hold_the_campaign(tmp_path: Path) -> None:
    campaign = make_campaign(seed=4, n=20, n_validation=5)
    paths = write_campaign(campaign, tmp_path / "new")
    with Path(paths["csv"]).open(encoding="utf-8", newline="") as file:
        read = list(csv.DictReader(file))
    assert read == [{k: str(v) for k, v in row.items()} for row in campaign.rows]
    assert tomllib.loads(Path(paths["toml"]).read_text(encoding="utf-8")) == campaign.header
    assert json.loads(Path(paths["truth"]).read_text(encoding="utf-8")) == campaign.truth
    assert sorted(p.name for p in (tmp_path / "new").iterdir()) == ["data.csv", "data.toml", "truth.json"]


def test_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    common = ["--seed", "2", "--readings", "20", "--validation", "5", "--out", str(tmp_path)]
    assert main([*common, "--effect", "base_shift", "--departure", "relaxing_step"]) == 0
    out = capsys.readouterr().out
    assert out.count("\n") == 1
    paths = json.loads(out)
    truth = json.loads(Path(paths["truth"]).read_text(encoding="utf-8"))
    assert [(e["label"], e["shape"]) for e in truth["effects"]] == [("base_shift", "relaxing_step")]

    assert main([*common, "--effect", "none"]) == 0
    assert json.loads(Path(paths["truth"]).read_text(encoding="utf-8"))["effects"] == []

    capsys.readouterr()
    assert main([*common, "--effect", "rust:j1"]) == 2
    assert "rust" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("wrong", "word"),
    [({"n": 0}, "n = 0"), ({"approach": "sideways"}, "sideways"), ({"n": 5, "gross_rows": 6}, "gross")],
)
def test_bad_arguments_are_refused(wrong: dict[str, int | str], word: str) -> None:
    with pytest.raises(ValueError, match=word):
        make_campaign(**wrong)  # pyright: ignore[reportArgumentType]


def test_three_hundred_readings_take_well_below_a_second() -> None:
    start = time.process_time()  # the machine may be busy with something else
    make_campaign(seed=8)
    assert time.process_time() - start < 1.0
