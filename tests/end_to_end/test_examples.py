"""The examples: every plan can be driven, and campaigns run on their simulated cells.

The campaigns with devices that have a simulator are run.
"""

from __future__ import annotations

import csv
import tomllib
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomli_w

from acquisition import Campaign, Cell, Run, campaign_from, checked_plan, export, read_campaign, read_cell
from acquisition.campaign.plan import Forecast
from acquisition.cell import cell_from
from acquisition.record import RecordStore
from acquisition.record.readings import drift_of
from calib import Dataset, identify, read_dataset
from calib.diagnose import diagnose
from calib.fit import errors_on, offsets_of
from calib.fit.circle_points import find_sweeps, starts
from calib.text import read_toml
from calib.validation import sphere_tests
from calib.validation.iso9283 import pose_repeatability, repeated_poses
from drivers import RehearsalOperator
from mocks.cell import make_world
from mocks.cell_file import read_cell as read_mock_cell
from mocks.world import World
from service.simulated_cell import simulated_cell
from tests.benchmarks.nests import judged_mm
from tests.end_to_end.simulated import ROOT, stepped_cell

EXAMPLES = ROOT / "examples"
SCALE = 500.0


def files_of(example: str, campaign: str = "campaign") -> tuple[Cell, Campaign]:
    return read_cell(EXAMPLES / example / "cell.toml"), read_campaign(EXAMPLES / example / f"{campaign}.toml")


@pytest.mark.parametrize(
    ("example", "campaign", "poses"),
    [
        (
            "irb120_faro",
            "campaign",
            {("calibration", 3): 60, ("validation", 3): 40, ("reference", 1): 12},
        ),
        (
            "irb120_faro",
            "thesis",
            {("calibration", 3): 38, ("validation", 3): 1000, ("reference", 1): 62},
        ),
        (
            "irb120_ctrack",
            "campaign",
            {("calibration", 3): 36, ("validation", 3): 10, ("reference", 1): 6},
        ),
        (
            "ur5_leica",
            "campaign",
            {("calibration", 1): 38, ("repeat", 1): 20, ("validation", 1): 20, ("reference", 1): 4},
        ),
        ("ur5e_polyscopex", "campaign", {("calibration", 1): 24, ("validation", 1): 10, ("reference", 1): 2}),
        (
            "gp7_faro",
            "campaign",
            {("calibration", 3): 30, ("validation", 3): 10},
        ),
        (
            "gofa_omnicore",
            "campaign",
            {("calibration", 3): 30, ("validation", 3): 10, ("reference", 1): 6},
        ),
        (
            "lrmate_ballbar",
            "campaign",
            {("calibration", 6): 61, ("validation", 6): 8, ("validation", 1): 40},
        ),
    ],
)
def test_the_plan_is_that_of_the_source(
    example: str, campaign: str, poses: dict[tuple[str, int], int]
) -> None:
    cell, the_campaign = files_of(example, campaign)
    visits = checked_plan(cell, the_campaign)
    standing = [visit for visit in visits if visit.kind == "pose"]
    assert Counter((visit.set, len(visit.targets)) for visit in standing) == poses
    assert 0.3 < Forecast.of(cell, the_campaign, visits).total_s / 3600.0 < 8.0


def faster(
    example: str, campaign: str, simulation: Mapping[str, Any] | None = None, **changes: Any
) -> tuple[Cell, Campaign]:
    """Read the two files with a faster simulation clock and with replaced keys."""
    file = EXAMPLES / example / "cell.toml"
    table = read_toml(file)[1]
    table["simulation"] |= {"time_scale": SCALE, "effects": ["none"], **(simulation or {})}
    wanted = read_toml(EXAMPLES / example / f"{campaign}.toml")[1] | changes
    return cell_from(table, str(file), beside=file.parent), campaign_from(wanted, campaign)


def run_simulated(folder: Path, cell: Cell, campaign: Campaign) -> Run:
    """The finished run. The states of a UR come as a stream, so its cell needs a clock that runs by itself."""
    run = Run.create(folder / "record", cell, campaign, simulated=True)
    if cell.robot.driver == "ur":
        with simulated_cell(cell) as simulated:
            outcome = run.execute(simulated.open(cell, RehearsalOperator()))
    else:
        with stepped_cell(cell, RehearsalOperator()) as equipment:
            outcome = run.execute(equipment.devices, equipment.clock)
    assert (outcome.state.value, outcome.error) == ("succeeded", None)
    return run


@pytest.mark.parametrize(
    ("example", "hidden"),
    [
        ("irb120_ctrack", 0.15),
        ("lrmate_rmi", 0.0),
        ("ur5_leica", 0.0),
        ("ur5e_polyscopex", 0.0),
    ],  # the arm may come between cameras and base
)
def test_it_runs_on_its_simulated_cell(example: str, hidden: float, tmp_path: Path) -> None:
    cell, campaign = faster(example, "campaign", warm_up_s=0.0)
    with run_simulated(tmp_path, cell, campaign) as run:
        status = run.status()
        met = next(e.data for e in run.events() if e.kind == "connected" and e.data["role"] == "robot")
        dataset = read_dataset(export(tmp_path / "record", tmp_path / "data.csv"))
    assert ("calibration" in met) == (cell.robot.driver == "ur")
    if "calibration" in met:  # what its controller calculates with is kept
        held = met["calibration"]
        assert (held["name"], len(held["checksum"])) == (met["alias"], 6)
        assert set(map(len, held["deltas"].values())) == {6}
    planned = sum(len(visit.targets) for visit in checked_plan(cell, campaign) if visit.kind == "pose")
    assert status.total == planned
    assert status.skipped <= hidden * planned
    assert int(dataset.usable.sum()) == planned - status.skipped
    turned = np.isfinite(dataset.orientation[dataset.usable]).all()
    assert turned == (example == "irb120_ctrack")  # cameras see bodies, trackers points
    assert 0.7 < identify(dataset).noise_scale < 1.25  # the cameras' noise is declared with some reserve


def test_a_yaskawa_is_driven_by_pulses_and_identified(tmp_path: Path) -> None:
    """The data set has the joints that were read back, to half a pulse of the coarsest joint."""
    blocks = read_toml(EXAMPLES / "gp7_faro" / "campaign.toml")[1]["block"]
    few = [block | {"count": block["count"] // 2, "select": "random"} for block in blocks]
    cell, campaign = faster("gp7_faro", "campaign", warm_up_s=0.0, block=few)
    with run_simulated(tmp_path, cell, campaign) as run:
        assert (run.status().skipped, run.status().total) == (0, 20 * 3)
    data = export(tmp_path / "record", tmp_path / "data.csv")
    with data.open(encoding="utf-8") as lines:
        rows = list(csv.DictReader(lines))
    per_deg = cell.robot.options["pulses_per_deg"]
    for row in rows:
        for k, per in enumerate(per_deg, start=1):
            commanded, read = float(row[f"j{k}_deg"]), float(row[f"j{k}_read_deg"])
            assert read == pytest.approx(commanded, abs=0.51 / per + 5e-5)
    dataset = read_dataset(data)
    fit = identify(dataset)
    assert 0.7 < fit.noise_scale < 1.3
    errors = errors_on(dataset, dataset.validation_rows, fit.model, fit.estimate)
    assert np.sqrt(np.mean(errors**2)) < 0.1


@pytest.mark.whole
def test_the_ballbar_comes_back_for_what_was_out_of_its_stroke(tmp_path: Path) -> None:
    """Nubiola 4.4 over the wires of a Fanuc and a ballbar.

    There are two stages, every distance is measured, and other distances judge. The cups are 0.3 mm from their places
    in the cell file. If they count as exact, they spoil the robot; if uncertain, they are found.
    """
    blocks = read_toml(EXAMPLES / "lrmate_ballbar" / "campaign.toml")[1]["block"]
    fewer = {46: 18, 15: 6, 8: 6, 40: 12}  # poses of each block
    few = [block | ({"count": fewer[block["count"]]} if "count" in block else {}) for block in blocks]
    off = {"B1": [0.3, 0.0, 0.0], "B2": [0.0, -0.25, 0.17], "B3": [-0.2, 0.2, 0.1]}
    cell, campaign = faster("lrmate_ballbar", "campaign", simulation={"misplaced_mm": off}, block=few)
    with run_simulated(tmp_path, cell, campaign) as run:
        assert (run.status().skipped, run.status().total) == (0, 30 * 6 + 12 + 2 * 6 + 3)
        (taught,) = [event.data for event in run.events(limit=10_000) if event.kind == "taught"]
        (stage,) = [event.data for event in run.events(limit=10_000) if event.kind == "second_stage"]
    assert (taught["poses"], taught["refused"]) == (30 + 12, 0)
    assert 0.3 < taught["off_mm"] < 5.0  # where the robot, which errs, has them
    assert stage["refused"] == 0
    assert stage["poses"] > 5
    data = export(tmp_path / "record", tmp_path / "data.csv")
    dataset = read_dataset(data)
    off_mm = np.abs(dataset.lengths[dataset.usable] - cell.instrument.nominal_mm)
    assert off_mm.max() < 1.0 + 0.02  # the stroke, of a bar some micrometres longer than its case says
    found = diagnose(dataset)
    assert (found.verdict, found.effects) == ("complete", ())
    assert [span.name for span in dataset.spans] == 2 * [
        *("T1 to T2", "T1 to T3", "T2 to T3", "B1 to B2", "B1 to B3", "B2 to B3")
    ]
    places = {name: np.array(place) + off[name] for name, place in cell.nests.items()}
    for span in dataset.spans[3:6]:  # as the bar has them, and not as the cell file
        assert span.length_mm == pytest.approx(
            np.linalg.norm(places[span.one] - places[span.other]), abs=0.02
        )
    (sphere,) = sphere_tests(dataset, dataset.validation_rows, found.final.model, found.final.estimate)
    assert len(sphere.errors_mm) == 12
    assert sphere.largest_mm < 0.1
    errors = errors_on(dataset, dataset.validation_rows, found.final.model, found.final.estimate)
    assert np.sqrt(np.mean(errors**2)) < 0.05  # a third of a millimetre and more before
    assert not any(offset.judged.doubted for offset in offsets_of(found.final))
    # what the same readings gave as long as cups and tool counted as exactly where the cell file has them
    table = tomllib.loads(data.with_suffix(".toml").read_text("utf-8"))
    table["base_targets"] = {name: list(place) for name, place in cell.nests.items()}
    del table["base_targets_u_mm"], table["tool_targets_u_mm"]
    data.with_suffix(".toml").write_text(tomli_w.dumps(table), "utf-8")
    exact = identify(read_dataset(data))
    assert exact.noise_scale > 3.0 * found.final.noise_scale
    arm, visits = simulated_arm(cell, tmp_path), checked_plan(cell, campaign)
    poses = [visit for visit in visits if visit.kind == "pose"]
    before_mm, after_mm = (judged_mm(fit, arm, cell, poses) for fit in (exact, found.final))
    assert after_mm < 0.6 * before_mm
    assert after_mm < 0.3


def simulated_arm(cell: Cell, folder: Path) -> World:
    """The world that the simulators of a cell draw."""
    file = folder / "cell.toml"
    file.write_text(cell.source, "utf-8")
    return make_world(read_mock_cell(file))


@pytest.fixture(scope="module")
def kinds(tmp_path_factory: pytest.TempPathFactory) -> tuple[Cell, Dataset, Path]:
    """Measure a small campaign with a block of every kind, over the simulated cell's sockets."""
    folder = tmp_path_factory.mktemp("kinds")
    cell, campaign = faster("irb120_faro", "kinds")
    with run_simulated(folder, cell, campaign) as run:
        assert run.status().skipped == 0
        return cell, read_dataset(export(folder / "record", folder / "data.csv")), folder / "record"


def test_sweeps_are_found_and_start_the_fit(kinds: tuple[Cell, Dataset, Path]) -> None:
    cell, dataset, _ = kinds
    found = Counter(
        (sweep.joint, dataset.conditions.target_names[sweep.target]) for sweep in find_sweeps(dataset)
    )
    assert found == {(joint, name): 1 for joint in (1, 2, 5, 6) for name in ("T2", "T3")} | {(4, "T2"): 1}
    start = starts(dataset)[0]
    assert start.base is not None
    assert np.linalg.norm(start.base[:3, 3]) < 20.0  # the simulated base is off by millimetres
    for number, place in start.targets.items():
        name = dataset.conditions.target_names[number]
        assert place == pytest.approx(np.array(cell.tool.targets[name]), abs=15.0)


def test_a_sweep_was_read_from_both_sides(kinds: tuple[Cell, Dataset, Path]) -> None:
    _, dataset, _ = kinds
    (sweep,) = (sweep for sweep in find_sweeps(dataset) if sweep.joint == 4)
    at = dataset.conditions
    angles = np.round(np.degrees(at.joints[sweep.rows, 3])).astype(int)
    assert Counter(zip(angles.tolist(), at.side[sweep.rows, 3].tolist(), strict=True)) == {
        (angle, side): 1 for angle in range(-60, 61, 10) for side in (1.0, -1.0)
    }
    assert np.degrees(at.joints - at.previous)[sweep.rows, 3] == pytest.approx(
        5.0 * at.side[sweep.rows, 3], abs=1e-6
    )


def test_repeats_have_the_repeatability_of_the_cell(kinds: tuple[Cell, Dataset, Path]) -> None:
    _, dataset, _ = kinds
    rows = np.flatnonzero(dataset.sets == "repeat")
    at = dataset.conditions.take(rows)
    poses = repeated_poses(at.joints, at.series, at.target)
    assert [len(visits) for visits in poses] == [6] * 5
    figures = np.array([pose_repeatability(dataset.points[rows[visits]]) for visits in poses])
    # Some 0.02 mm of noise per axis at 2.5 m: RP = 1.6 s + 3 x 0.7 s of three axes.
    assert np.all((figures > 0.01) & (figures < 0.25))


def test_the_sphere_is_one_within_the_errors_of_the_robot(kinds: tuple[Cell, Dataset, Path]) -> None:
    _, dataset, _ = kinds
    rows = dataset.sets == "validation"
    points = dataset.points[rows]
    assert len(points) == 20
    # |p|^2 = 2 c . p + (R^2 - |c|^2), linear in c and the rest
    system = np.column_stack([2.0 * points, np.ones(len(points))])
    centre = np.linalg.lstsq(system, np.sum(points**2, axis=1), rcond=None)[0][:3]
    radius = np.linalg.norm(points - centre, axis=1)
    assert radius.mean() == pytest.approx(300.0, abs=3.0)
    assert radius.std() < 1.0
    at = dataset.conditions.take(rows)
    inside = np.abs(at.joints - at.previous)[1:].max(axis=1)
    assert np.degrees(inside).max() > 6.0  # straight from the point before, not over an approach point


def test_gates_and_drift_were_told(kinds: tuple[Cell, Dataset, Path]) -> None:
    _, dataset, record = kinds
    store = RecordStore.open(record, writer=False)
    events, drift = [event.kind for event in store.events()], drift_of(store)
    store.close()
    assert events.count("warm") == 1
    assert events.count("nests_checked") == 2  # the last after the last reading
    assert drift is not None
    assert drift.readings == int(np.sum((dataset.sets == "reference") & dataset.usable))
    assert 0.0 < drift.off_mm <= drift.most_mm < 0.3


def test_tracker_and_cameras_measure_the_same_arm() -> None:
    """So that a user can compare both calibrations of it."""
    tracker, cameras = (
        make_world(read_mock_cell(EXAMPLES / f"irb120_{name}" / "cell.toml")) for name in ("faro", "ctrack")
    )
    for field in ("alpha", "a", "theta", "d", "beta", "base_mm", "base_rad"):
        assert getattr(tracker.geometry, field) == getattr(cameras.geometry, field)
    assert tracker.compliance == cameras.compliance
    assert tracker.targets == cameras.targets
    (one,), (other,) = (world.truth for world in (tracker, cameras))
    assert one["label"] == other["label"]
    for name, parameter in one["parameters"].items():
        assert other["parameters"][name]["value"] == pytest.approx(parameter["value"], rel=1e-5)
