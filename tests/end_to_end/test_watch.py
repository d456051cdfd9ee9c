"""Watches as a person makes them: planned, driven, judged, with touched points.

They are driven over the wires of the simulators; thermal updates are tested too. These would catch: readings of cameras
that a watch cannot judge, an unchanged robot that alarms, and a bumped tool that is not identified. They would also
catch an update that does not change corrected targets, and a thermal update in the wrong direction.
"""

from __future__ import annotations

import csv
import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from calib import identify, load_model, read_dataset, save_model
from calib.model import BoundModel, conditions_at
from mocks.campaign import DEFAULT_FIT, Campaign, write_campaign
from mocks.world import ArmState, World
from mocks.world.dataset import header_of, row_of
from mocks.world.poses import approach_point, random_pose
from service.cli import main
from tests.calib.updates import save_warming
from tests.end_to_end.simulated import ROOT
from tests.service.campaigns import edit_text, read_rows, write_data

EXAMPLES = ROOT / "examples"
SEED = 1  # of the arm, here and in the cell of the cameras
BUMP = (0.3, 0.2, 0.0)


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A baseline of the arm that the cell of the cameras simulates."""
    folder = tmp_path_factory.mktemp("base")
    save_model(folder / "m.json", identify(read_dataset(write_data(folder, seed=SEED, effects=(), n=120))))
    return folder / "m.json"


def cell_of(folder: Path, name: str, simulated: str, example: str = "irb120_ctrack") -> Path:
    """The cell of an example with other lines in its simulation."""
    file = folder / f"{name}.toml"
    file.write_text((EXAMPLES / example / "cell.toml").read_text("utf-8"), "utf-8")
    edit_text(file, "effects = []", simulated)
    edit_text(file, "time_scale = 200.0", "time_scale = 1000.0")
    return file


def test_cameras_watch_a_robot_and_name_a_bumped_tool(model: Path, tmp_path: Path) -> None:
    none = 'effects = ["none"]'
    bump = "[" + ", ".join(map(str, BUMP)) + "]"
    same = cell_of(tmp_path, "same", none)
    bumped = cell_of(
        tmp_path, "bumped", f"{none}\nmisplaced_mm = {{ T1 = {bump}, T2 = {bump}, T3 = {bump} }}"
    )
    campaign, updated = tmp_path / "w.toml", tmp_path / "updated.json"
    asked = ["--poses", "5", "--from", "40", "--visits", "1", "--readings", "2", "--targets", "T1,T2"]
    assert main(["watch", "plan", str(model), str(same), "--out", str(campaign), *asked]) == 0

    def run(cell: Path, against: Path, code: int, *more: str) -> Mapping[str, Any]:
        record = tmp_path / f"{cell.stem}_{against.stem}"
        command = ["watch", "run", str(against), str(cell), str(campaign), "--record", str(record)]
        assert main([*command, "--simulate", "--json", str(tmp_path / "v.json"), *more]) == code
        data = read_dataset(record / "watch.csv")
        assert len(data) == 20
        assert data.header.readings == data.reading_id  # a row that is deleted is missed
        assert data.turned.all()  # cameras see how the tool is turned, too
        assert len(np.unique(data.conditions.visit)) == 5  # four readings at every rest
        return json.loads((tmp_path / "v.json").read_text("utf-8"))

    assert run(same, model, 0)["verdict"] == "unchanged"
    told = run(bumped, model, 3, "--update", str(updated))
    (cause,) = told["causes"]
    assert cause["label"] == "tool_shift"
    assert cause["size"]["value"] == pytest.approx(np.linalg.norm(BUMP), abs=cause["size"]["u"])
    assert told["updated_model"] == str(updated)
    # with the updated model the bumped robot is as it should be, and corrected targets are others
    targets, before, after = (tmp_path / f"{name}.csv" for name in ("targets", "before", "after"))
    targets.write_text("target_id,j1_deg,j2_deg,j3_deg,j4_deg,j5_deg,j6_deg\n1,10,20,-10,30,40,50\n", "utf-8")
    assert main(["compensate", str(model), str(targets), str(before)]) == 0
    assert main(["compensate", str(updated), str(targets), str(after)]) == 0
    assert before.read_text("utf-8") != after.read_text("utf-8")


def held_at(world: World, joints_deg: np.ndarray, sides: tuple[int, ...], ball: np.ndarray) -> np.ndarray:
    """Calculate joints near a start at which the true arm holds T2 in a ball.

    A person would jog there; here, differences do it.
    """
    joints = joints_deg.copy()

    def off(angles: np.ndarray) -> np.ndarray:
        at = tuple(float(q) for q in angles)
        return np.array(world.true_point(ArmState(at, approach_point(at, sides), sides), "T2")) - ball

    for _ in range(4):
        miss = off(joints)
        columns = np.array([(off(joints + 0.01 * axis) - miss) / 0.01 for axis in np.eye(6)]).T
        joints = joints - np.linalg.pinv(columns) @ miss
    return joints


def test_touched_balls_are_filled_in_and_judged(model: Path, tmp_path: Path) -> None:
    cell, out, verdict = tmp_path / "cell.toml", tmp_path / "touched.csv", tmp_path / "v.json"
    cell.write_text((EXAMPLES / "irb120_faro" / "cell.toml").read_text("utf-8"), "utf-8")
    edit_text(
        cell,
        "N1 = [0.0, 0.0, 0.0], N2 = [600.0, 0.0, 0.0], N3 = [0.0, 600.0, 0.0]",
        "N1 = [350.0, 150.0, 200.0], N2 = [350.0, -150.0, 200.0], N3 = [250.0, 250.0, 250.0]",
    )
    asked = ["--poses", "8", "--from", "40", "--touch", "N1,N2,N3", "--targets", "T2"]
    assert main(["watch", "plan", str(model), str(cell), "--out", str(out), *asked]) == 0
    planned, rng = read_rows(out), np.random.default_rng(1)

    def touched(world: World) -> int:
        rows = []
        for row in planned:
            joints = np.array([float(row[f"j{k}_deg"]) for k in range(1, 7)])
            sides = tuple(int(row[f"approach{k}"]) for k in range(1, 7))
            ball = np.array([float(row[f"{axis}_mm"]) for axis in "xyz"])
            shown = held_at(world, joints, sides, ball + 0.02 * rng.normal(size=3))
            rows.append(row | {"status": "ok"} | {f"j{k}_deg": str(q) for k, q in enumerate(shown, start=1)})
        with out.open("w", encoding="utf-8", newline="") as file:
            writer = csv.DictWriter(file, list(rows[0]))
            writer.writeheader()
            writer.writerows(rows)
        return main(["watch", "judge", str(model), str(out), "--json", str(verdict)])

    assert touched(World(seed=SEED)) == 0
    lost = World(seed=SEED)
    lost.effects = [lost.draw_effect("joint_offset:j3").with_values(offset=0.05)]
    assert touched(lost) == 3
    (cause,) = json.loads(verdict.read_text("utf-8"))["causes"]
    assert cause["label"] == "joint_step:j3"
    assert cause["size"]["value"] == pytest.approx(0.05, abs=cause["size"]["u"])
    assert load_model(model).updates == ()


def test_upkeep_in_a_loop_follows_an_arm_that_warms_up(model: Path, tmp_path: Path) -> None:
    """Four readings of one target are taken every quarter of an hour.

    Between them, the true arm must be where the kept model predicts.
    """
    cold, now = tmp_path / "cold.json", tmp_path / "now.json"
    fitted = identify(read_dataset(write_data(tmp_path, seed=SEED, effects=(), n=120)))
    save_warming(cold, fitted, 100e-6)
    world = World(seed=SEED)
    world.effects = [world.draw_effect("warm_up").with_values(alpha=400e-6, T_c=1500.0)]
    rng = np.random.default_rng(2)
    poses = [random_pose(world.robot, world.targets, rng) for _ in range(24)]

    def error_mm(file: Path, at_s: float) -> float:
        saved = load_model(file)
        conditions = conditions_at(
            saved.model, np.radians(poses), replace(saved.usual, time_s=at_s), target="T2"
        )
        predicted = BoundModel(saved.model, conditions).predict(saved.estimate)
        true = [
            world.true_point(ArmState(q, approach_point(q, (1,) * 6), (1,) * 6, at_s), "T2") for q in poses
        ]
        return float(np.sqrt(np.mean(np.sum((predicted - np.array(true)) ** 2, axis=1))))

    before = cold
    for number, began_s in enumerate((900.0, 1800.0, 2700.0)):
        states = [
            ArmState(q, approach_point(q, (1,) * 6), (1,) * 6, began_s + 20.0 * i, 22.0, 1000 * number + i)
            for i, q in enumerate(poses[:4])
        ]
        rows = [
            row_of(world, i, "calibration", (state, "T2")) | {"t_s": state.t_s - began_s}
            for i, state in enumerate(states)
        ]
        nest = tmp_path / f"nest{number}"
        nest.mkdir()
        data = write_campaign(Campaign(rows, header_of(world, 1.0, DEFAULT_FIT), {}, world, []), nest)["csv"]
        after = now.with_stem(f"now{number}")
        asked = ["watch", "upkeep", str(before), str(data), "--running-s", str(began_s)]
        assert main([*asked, "--update", str(after)]) == 0
        assert error_mm(after, began_s + 450.0) < 0.5 * error_mm(cold, began_s + 450.0)
        before = after
    assert len(load_model(before).updates) == 1 + 3
