"""Blocks that are driven through a saved model, and spheres that the arm reaches in part.

These would catch: legs that stay out of the stroke although a model of the robot exists, joints that are corrected
twice, a corrected pose that is not checked, a model of another robot, and poses that are left out without a word.
"""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from acquisition import Campaign, Cell, Run, campaign_from, checked_plan, export
from acquisition.campaign import Visit, left_out, make_plan
from acquisition.errors import UnsafePlan
from calib import identify, load_robot, read_dataset
from calib.arm import forward
from calib.saved import save_model
from drivers.errors import ConfigError
from service.http.work.campaigns import campaign_of
from tests.acquisition.bars import OFF_DEG, Bar
from tests.acquisition.fakes import (
    BALLBAR,
    CAMPAIGN,
    JumpingClock,
    SeatingOperator,
    a_cell,
    changed,
    devices_of,
)
from tests.acquisition.test_path_plan import BESIDE, MIDDLE, ur
from tests.calib.campaigns import write_files
from tests.service.test_http_support import served

CELL = a_cell(**BALLBAR)
HEXAPOD = {"kind": "hexapod", "set": "validation", "count": 4, "stages": 2}
STROKE_MM = 1.0


def identified(cell: Cell, folder: Path) -> Path:
    """The model of a robot whose joints are off by OFF_DEG, as a tracker would give it."""
    rng = np.random.default_rng(1)
    robot, target = cell.robot, np.array([40.0, 20.0, 100.0])
    joints = rng.uniform(-60.0, 60.0, (60, 6))
    there = forward(robot.model, robot.model_angles(joints + OFF_DEG))
    points = there[:, :3, 3] + there[:, :3, :3] @ target
    rows = [
        {"reading_id": i, "set": "calibration", "tool_target": "S1"}
        | {f"j{k}_deg": float(q) for k, q in enumerate(row, start=1)}
        | dict(zip(("x_mm", "y_mm", "z_mm"), map(float, point), strict=True))
        for i, (row, point) in enumerate(zip(joints, points, strict=True))
    ]
    header = {
        "format": "truepose-dataset/1",
        "robot": robot.model.name,
        "world": "nominal",
        "noise": {"kind": "isotropic", "sigma_mm": 0.001},
        "tool_targets": {"S1": target.tolist()},
    }
    save_model(folder / "m.json", identify(read_dataset(write_files(folder, rows, header))))
    return folder / "m.json"


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return identified(CELL, tmp_path_factory.mktemp("model"))


def campaign(beside: Path, *blocks: dict[str, Any], **more: Any) -> Campaign:
    return campaign_from(changed(CAMPAIGN, block=list(blocks), **more), "campaign.toml", beside=beside)


def legs_mm(visits: list[Visit], off_deg: tuple[float, ...]) -> np.ndarray:
    """The lengths of all legs of a robot whose joints are off."""
    robot, out = CELL.robot, []
    for visit in visits:
        flange = forward(robot.model, robot.model_angles([np.add(visit.joints_deg, off_deg)]))[0]
        for target, base in visit.readings:
            ball = flange[:3, :3] @ np.array(CELL.tool.targets[target]) + flange[:3, 3]
            out.append(float(np.linalg.norm(ball - np.array(CELL.nests[base or ""]))))
    return np.array(out)


def test_legs_stay_within_the_stroke(model: Path) -> None:
    nominal = checked_plan(CELL, campaign(model.parent, HEXAPOD))
    driven = checked_plan(CELL, campaign(model.parent, HEXAPOD | {"model": model.name}))
    assert np.abs(legs_mm(nominal, OFF_DEG) - 300.0).max() > 1.5 * STROKE_MM
    assert np.abs(legs_mm(driven, OFF_DEG) - 300.0).max() < 0.05
    assert [visit.readings for visit in driven] == [visit.readings for visit in nominal]
    for before, after in zip(nominal, driven, strict=True):
        assert after.name == f"{before.name}, through m.json"
        shift = np.subtract(after.joints_deg, before.joints_deg)
        assert 0.0 < np.abs(shift).max() < 1.0
        assert np.subtract(after.approach_deg, before.approach_deg) == pytest.approx(shift, abs=2e-4)


def test_the_data_set_keeps_the_commanded_joints(model: Path, tmp_path: Path) -> None:
    """No leg is out of stroke, none is corrected again."""
    the_campaign = campaign(model.parent, HEXAPOD | {"model": model.name})
    bar = Bar(tmp_path / "r", off_deg=OFF_DEG, block=[HEXAPOD])
    bar.run.close()
    visits = checked_plan(CELL, the_campaign)
    with Run.create(tmp_path / "own", CELL, the_campaign, simulated=True) as run:
        devices = devices_of(bar.bench, SeatingOperator(bar.bench, ()))
        assert run.execute(devices, JumpingClock(), bar.events.append).state.value == "succeeded"
        assert run.status().skipped == 0
    assert bar.events_of("second_stage") == bar.events_of("deferred") == []
    dataset = read_dataset(export(tmp_path / "own", tmp_path / "out.csv"))
    assert np.abs(dataset.lengths - 300.0).max() < 0.05
    commanded = {visit.joints_deg for visit in visits}
    joints = CELL.robot.counted(dataset.conditions.joints)
    assert {tuple(row) for row in np.round(joints, 4).tolist()} == commanded


def stops(cell: Cell, beside: Path, block: dict[str, Any]) -> list[Visit]:
    plan = checked_plan(cell, campaign(beside, block))
    return [stop for visit in plan if visit.kind == "pose" for stop in visit.stops]


def test_points_paths_and_spheres_are_driven_through_it_too(model: Path, tmp_path: Path) -> None:
    drawn = {"select": "random", "count": 4, "targets": ["T1"]}
    path = {"kind": "path", "select": "list", "targets": ["T1"], "joints_deg": [MIDDLE, BESIDE, MIDDLE]}
    own = identified(ur(), tmp_path)
    for cell, file, block in ((a_cell(), model, drawn), (ur(), own, path), (CELL, model, SPHERE)):
        nominal, driven = (stops(cell, file.parent, each) for each in (block, block | {"model": "m.json"}))
        robot = cell.robot
        wanted = forward(robot.model, robot.model_angles([stop.joints_deg for stop in nominal]))
        real = np.add([stop.joints_deg for stop in driven], OFF_DEG)
        assert forward(robot.model, robot.model_angles(real)) == pytest.approx(wanted, abs=0.02)
    sphere = stops(CELL, model.parent, SPHERE | {"model": "m.json"})
    assert [v.approach_deg for v in sphere[1:]] == [v.joints_deg for v in sphere[:-1]]


def test_the_reference_pose_stays(model: Path) -> None:
    cell = a_cell()
    plans = [
        make_plan(cell, campaign(model.parent, {"count": 4, **more}, reference_every=3))
        for more in ({}, {"model": "m.json"})
    ]
    references = [{v.joints_deg for v in plan if v.set == "reference"} for plan in plans]
    assert references[0] == references[1]
    assert len(references[0]) == 1


def test_corrected_poses_are_checked_before_the_first_motion(model: Path) -> None:
    """The table is just below the nominal stances."""
    plan = checked_plan(CELL, campaign(model.parent, HEXAPOD | {"model": "m.json"}))
    low = [list(pair) for pair in CELL.robot.limits_deg]
    low[2][0] = min(v.joints_deg[2] for v in plan) - 4.9  # of the approach points one is beyond it
    tight = a_cell(**(BALLBAR | {"robot__limits_deg": low}))
    poses = [list(v.joints_deg) for v in make_plan(CELL, campaign(model.parent, HEXAPOD))]
    legs = {
        "kind": "legs",
        "joints_deg": poses,
        "legs": [[["T1", "B1"]]] * len(poses),
        "approach": {"offset_deg": -5.0, "sides": "one"},
        "model": "m.json",
    }
    with pytest.raises(UnsafePlan, match=r"through m\.json"):
        checked_plan(tight, campaign(model.parent, legs))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"robot": "abb-irb1600-x"}, r"block 1, key 'model'.*other.json, key 'content_sha256'"),
        (None, r"block 1, key 'model': .*other.json: there is no such file"),
    ],
)
def test_a_model_that_cannot_be_used(
    change: dict[str, Any] | None, words: str, model: Path, tmp_path: Path
) -> None:
    if change is not None:
        document = json.loads(model.read_text("utf-8")) | change
        (tmp_path / "other.json").write_text(json.dumps(document), "utf-8")
    with pytest.raises(ConfigError, match=words):
        make_plan(CELL, campaign(tmp_path, HEXAPOD | {"model": "other.json"}))


def test_a_model_of_another_robot(model: Path) -> None:
    other = a_cell(robot__model="abb-irb1600-10-1.45", robot__limits_deg=None)
    assert load_robot("abb-irb1600-10-1.45").name != CELL.robot.model.name
    with pytest.raises(
        ConfigError, match=r"block 1, key 'model': .*m.json, key 'robot': is a model of the robot"
    ):
        make_plan(other, campaign(model.parent, {"count": 2, "model": "m.json"}))


def test_touched_cups_do_not_go_with_it(model: Path) -> None:
    touching = {"kind": "ballbar_geometry", "touch_with": "T1"}
    with pytest.raises(ConfigError, match="block 2, key 'model': does not go with touch_with of block 1"):
        make_plan(CELL, campaign(model.parent, touching, HEXAPOD | {"model": "m.json"}))


def test_a_file_of_the_server_is_not_read_over_http(model: Path) -> None:
    with pytest.raises(ConfigError, match="cannot be used here"):
        campaign_of(changed(CAMPAIGN, block=[{"count": 2, "model": str(model)}]), {"a-job": model})


def test_a_model_of_the_service_drives_a_block_by_its_id(model: Path, tmp_path: Path) -> None:
    cell, found = tmp_path / "cell.toml", tmp_path / "record" / "identifications" / "a-job"
    cell.write_text(CELL.source, "utf-8")
    found.mkdir(parents=True)
    shutil.copy(model, found)
    (found / "m.json").rename(found / "model.json")
    (found / "result.json").write_text("{}", "utf-8")
    driven = changed(CAMPAIGN, block=[HEXAPOD | {"model": "a-job"}])
    nominal = changed(CAMPAIGN, block=[HEXAPOD])
    with served(tmp_path / "record", "--cell", str(cell)) as service:
        client = service.client
        kept = client.post("/campaigns", json={"campaign": driven}).json()["id"]
        plans = [
            client.get(f"/runs/{client.post('/runs', json=asked).json()['id']}/plan").json()["visits"]
            for asked in ({"campaign": nominal}, {"campaign": driven}, {"campaign_id": kept})
        ]
        unknown = changed(CAMPAIGN, block=[HEXAPOD | {"model": "another"}])
        for path, asked in (("/runs", unknown), ("/campaigns", unknown), ("/loops", driven)):
            refused = client.post(path, json={"campaign": asked})
            assert refused.status_code == 422, refused.text
    by_file = checked_plan(CELL, campaign(model.parent, HEXAPOD | {"model": model.name}))
    assert plans[1] == plans[2]
    assert [tuple(visit["joints_deg"]) for visit in plans[1]] == [visit.joints_deg for visit in by_file]
    assert plans[1] != plans[0]


SPHERE: dict[str, Any] = {
    "kind": "sphere",
    "centre_deg": list(make_plan(CELL, campaign(Path(), HEXAPOD))[0].joints_deg),
    "targets": ["T1"],
    "base": "B1",
    "above_deg": 20.0,
    "count": 8,
}


def test_points_of_a_sphere_that_are_not_reached_are_left_out_and_named() -> None:
    limits = [list(pair) for pair in CELL.robot.limits_deg]
    whole = make_plan(CELL, campaign(Path(), SPHERE | {"count": 30}))
    first = sorted(v.joints_deg[0] for v in whole)
    limits[0] = [first[12], first[18]]
    tight = a_cell(**(BALLBAR | {"robot__limits_deg": limits}))
    the_campaign = campaign(Path(), SPHERE | {"count": 200, "above_deg": -80.0})
    visits = checked_plan(tight, the_campaign)
    assert 2 <= len(visits) < 200
    (sentence,) = left_out(the_campaign, visits)
    assert f"does not reach {200 - len(visits)} of 200 poses" in sentence
    numbers = [int(v.name.removeprefix("point ").split()[0]) for v in visits]
    assert numbers == sorted(set(numbers))
    assert left_out(the_campaign, checked_plan(CELL, campaign(Path(), SPHERE))[:0])


def test_one_ball_is_enough_for_a_sphere() -> None:
    one = a_cell(**(BALLBAR | {"world__nests": {"B1": BALLBAR["world__nests"]["B1"]}}))
    assert len(checked_plan(one, campaign(Path(), SPHERE))) == 8
    with pytest.raises(ConfigError, match=r"world.nests'"):
        a_cell(world__nests={"N1": [400.0, -300.0, 30.0]})
