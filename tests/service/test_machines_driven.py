"""A SCARA and an arm on a track, from readings to corrected targets.

They drive on simulated machines that share no line with the program. These would catch: a model whose base or tool is
displaced by slides, and mm of a table read as deg. They would also catch a flange that lands at the place of the tool,
an unreported tilt that the arm cannot make, and a track that a table cannot hold.

All machines, with more readings, are `python -m tests.benchmarks machines`.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import truepose
from calib.errors import DataError
from service.cli import main
from tests.benchmarks.machines import CASES, FLOOR_MM, Simulated, base_of, driven, simulated
from tests.calib.chain import chain
from tests.calib.true_machine import TARGETS

CASE = {case.title.partition(",")[0]: case for case in CASES}
ROWS = [(10.0, 40.0, -50.0, 20.0), (-60.0, 70.0, -150.0, 0.0), (45.0, -80.0, -100.5, 90.0)]
HEAD = "target_id,j1_deg,j2_deg,j3_mm,j4_deg"
TABLE = "\n".join([HEAD, *(f"p{i}," + ",".join(map(str, row)) for i, row in enumerate(ROWS))]) + "\n"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("driven")


@pytest.fixture(scope="module")
def scara(folder: Path) -> tuple[Simulated, truepose.Model]:
    made = simulated(CASE["scale of the quill"], 0, folder, 150, 60)
    return made, truepose.diagnose(made.dataset.path).model


@pytest.fixture(scope="module")
def saved(scara: tuple[Simulated, truepose.Model], folder: Path) -> Path:
    return scara[1].save(folder / "scara.json")


def test_a_scara_lands_within_the_floor(scara: tuple[Simulated, truepose.Model]) -> None:
    done = driven(CASE["scale of the quill"], *scara, seed=1, count=60)
    assert done.good >= 51  # others: near a straight elbow
    assert done.plain > 0.5
    assert done.corrected < 1.2 * FLOOR_MM
    assert 0.02 < done.left_deg < 0.5


def test_an_arm_on_a_track_lands_within_the_floor(folder: Path) -> None:
    case = CASE["scale of the track"]
    made = simulated(case, 0, folder, 250, 60)
    done = driven(case, made, truepose.diagnose(made.dataset.path).model, seed=1, count=60)
    assert done.good >= 51
    assert done.plain > 2.0
    assert done.corrected < 1.2 * FLOOR_MM
    assert done.left_deg < 1e-6


def test_the_command_lets_a_tool_land(
    saved: Path, scara: tuple[Simulated, truepose.Model], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The true machine has no noise here, so the remaining error is the scatter of the fit."""
    made, model = scara
    robot, names = made.truth.robot, ["T1"] * len(ROWS)
    taught = np.array(ROWS) * robot.joint_units
    wanted = base_of(model) @ np.array([chain(robot, q, {}, TARGETS["T1"]).real for q in taught])
    (tmp_path / "t.csv").write_text(TABLE, encoding="utf-8")
    off = {}
    for tool in ((), ("--tool", "60,10,80,0,0,0")):
        told = [*tool, "--json", str(tmp_path / "r.json")]
        assert main(["compensate", str(saved), str(tmp_path / "t.csv"), str(tmp_path / "o.csv"), *told]) == 0
        lines = (tmp_path / "o.csv").read_text("utf-8").splitlines()
        assert lines[0] == HEAD
        sent = np.array([[float(cell) for cell in line.split(",")[1:]] for line in lines[1:]])
        reached = made.truth.poses(sent * robot.joint_units, np.ones(sent.shape), names)
        off[bool(tool)] = np.linalg.norm((reached - wanted)[:, :3, 3], axis=1)
        shown = capsys.readouterr()
        assert "slides mm" in shown.out
        assert ("the flange lands" in shown.err) is not bool(tool)
        targets = json.loads((tmp_path / "r.json").read_text("utf-8"))["targets"]
        slid = [abs(row[2] - was[2]) for row, was in zip(sent, ROWS, strict=True)]
        assert [each["largest_slide_change_mm"] for each in targets] == pytest.approx(slid, abs=1e-6)
        assert all("deg of tilt that this arm cannot turn" in each["notes"][0] for each in targets)
    assert np.max(off[True]) < 0.05
    assert np.max(off[False]) > 2.0 * np.max(off[True])


def test_a_pose_of_a_scara_names_its_side(saved: Path, tmp_path: Path) -> None:
    head, pose = "target_id,x_mm,y_mm,z_mm,rot_w,rot_x,rot_y,rot_z,config", "300,300,200,1,0,0,0"
    (tmp_path / "t.csv").write_text(f"{head}\na,{pose},right\nb,{pose},front/up/noflip\n", encoding="utf-8")
    out = tmp_path / "o.csv"
    told = ["--keep-refused", "--json", str(tmp_path / "r.json")]
    assert main(["compensate", str(saved), str(tmp_path / "t.csv"), str(out), *told]) == 3
    done, refused = json.loads((tmp_path / "r.json").read_text("utf-8"))["targets"]
    assert 0.1 < done["moved_mm"] < 3.0
    assert "only right, left" in refused["reason"]


@pytest.mark.parametrize(
    ("change", "what"),
    [
        (("j3_mm", "j3_deg"), "column 'j3_deg': this joint slides. Give j3_mm"),
        (("j2_deg", "j2_mm"), "column 'j2_mm': this joint turns. Give j2_deg"),
        (("j3_mm", "j3"), "Name it j3_mm"),
        (("j4_deg", "j5_deg"), "the robot has 4 joints"),
        (("-50.0", "-5e7"), "farther than"),
        (("j4_deg\n", "j4_deg,e1_mm\n"), "external axis"),
    ],
)
def test_tables_of_another_kind_are_refused(
    change: tuple[str, str], what: str, saved: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = TABLE.replace(*change)
    if "e1_mm" in change[1]:
        text = "\n".join([HEAD + ",e1_mm", *(f"{line},5" for line in TABLE.splitlines()[1:])]) + "\n"
    (tmp_path / "t.csv").write_text(text, encoding="utf-8")
    assert main(["compensate", str(saved), str(tmp_path / "t.csv"), str(tmp_path / "o.csv")]) == 2
    assert what in " ".join(capsys.readouterr().err.split())
    assert not (tmp_path / "o.csv").exists()


def test_sides_under_which_a_coupled_joint_stands_are_refused_with_others(folder: Path) -> None:
    made = simulated(next(each for each in CASES if each.coupling == "rods"), 0, folder, 120, 20)
    model = truepose.identify(made.dataset.path)
    with pytest.raises(DataError, match="does not move") as caught:
        truepose.compensate(model, joints_deg=[[10, 20, 30, 0, 40]])
    assert "(1, 1, -1, 1, 1)" in caught.value.do
    done = truepose.compensate(model, joints_deg=[[10, 20, 30, 0, 40]], side=(1, 1, -1, 1, 1))
    assert done.good.all()
    assert done.joints_deg[0, 3] == pytest.approx(0.0, abs=1e-9)
