"""Corrected programs driven by a simulated robot whose errors the program does not know.

The remaining error is the one that the model's uncertainty predicts, and a fraction of the error without correction.
The robot's world shares no line with the code under test; this would catch any correction that is only consistent with
itself.
"""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest

from calib import CalibratedModel, StatedConditions, forward, load_model, load_robot
from calib.arm import BRANCHES
from calib.arm.inverse_kinematics import nominal_inverse
from calib.array import Array
from calib.fit.identification import predict_with_covariance
from calib.model import conditions_at
from calib.validation.judge import branches
from mocks.campaign import Campaign, make_campaign, write_campaign
from mocks.world import ArmState
from service.cli import main
from service.programs.frames import quaternion
from tests.calib.singular import least_singular_value
from tests.service.robot_programs import EXT, write

TARGETS = 40


@pytest.fixture(scope="module")
def diagnosed(tmp_path_factory: pytest.TempPathFactory) -> tuple[Campaign, Path]:
    """Simulate a campaign with hidden backlash and diagnose it; return it with its model file."""
    folder = tmp_path_factory.mktemp("driven")
    campaign = make_campaign(seed=11, n=150, n_validation=60, effects=["backlash:j4"], size=6.0)
    data = write_campaign(campaign, folder)["csv"]
    model = folder / "m.json"
    assert main(["diagnose", str(data), "--model", str(model)]) == 0
    return campaign, model


def driven(campaign: Campaign, joints_deg: Array) -> Array:
    """Return the true points of T2, shape (n, 3), if every joint arrives from below."""
    points = []
    for q in joints_deg:
        state = ArmState(tuple(q), tuple(q - 5.0), (1,) * 6)
        points.append(campaign.world.true_point(state, "T2"))
    return np.array(points)


def wanted(campaign: Campaign, joints_deg: Array) -> Array:
    """Return the points of T2 that the programmer meant, shape (n, 3).

    They are those of the nominal robot.
    """
    return np.array(
        [campaign.world.nominal_point(ArmState(tuple(q), tuple(q), (1,) * 6), "T2") for q in joints_deg]
    )


def goals(campaign: Campaign) -> Array:
    """Joint angles in the campaign's range, deg, well away from singular poses."""
    joints = np.array([state.joints_deg for state, _ in campaign.readings])
    return joints[least_singular_value(load_robot("abb-irb120"), np.radians(joints), np.zeros(3)) > 0.01][
        :TARGETS
    ]


def predicted_rms(saved: CalibratedModel, joints_deg: Array) -> float:
    """Calculate the error that the model's uncertainty leaves, mm RMS."""
    stated = StatedConditions(temperature_c=22.0, time_s=0.0, loads=saved.loads, gravity=saved.gravity)
    at = conditions_at(saved.model, np.radians(joints_deg), stated, "T2")
    _, covariance = predict_with_covariance(saved.model, saved.estimate, saved.covariance, at)
    return math.sqrt(float(np.mean(np.trace(covariance, axis1=1, axis2=2))))


def errors(campaign: Campaign, sent: Array, meant: Array) -> tuple[float, float]:
    """RMS error, mm, of the robot without and with the correction."""
    goal = wanted(campaign, meant)
    before, after = (np.linalg.norm(driven(campaign, q) - goal, axis=1) for q in (meant, sent))
    return math.sqrt(np.mean(before**2)), math.sqrt(np.mean(after**2))


def corrected(model: Path, folder: Path, text: str) -> str:
    program, out = write(folder, "goals.mod", text), folder / "out.mod"
    assert main(["compensate", str(model), str(program), str(out), "--conditions", "side=below"]) == 0
    return out.read_text("utf-8")


def test_joint_targets(diagnosed: tuple[Campaign, Path], tmp_path: Path) -> None:
    campaign, model = diagnosed
    meant = goals(campaign)
    rows = ",\n".join(f"[[{','.join(f'{v:.6f}' for v in q)}],{EXT}]" for q in meant)
    text = corrected(
        model,
        tmp_path,
        f"MODULE M\nCONST jointtarget q{{{len(meant)}}}:=[{rows}];\nPROC main()\n"
        "FOR i FROM 1 TO 40 DO MoveAbsJ q{i},v100,fine,tool0; ENDFOR\nENDPROC\nENDMODULE\n",
    )
    sent = np.array(
        [[float(v) for v in row.split(",")] for row in re.findall(r"\[\[?([-\d.,]+)\],\[9E9", text)]
    )
    assert sent.shape == meant.shape
    before, after = errors(campaign, sent, meant)
    predicted = predicted_rms(load_model(model), meant)
    assert before > 1.0
    assert after < 0.05 * before
    assert 0.3 * predicted < after < 2.0 * predicted


def test_pose_targets(diagnosed: tuple[Campaign, Path], tmp_path: Path) -> None:
    """The controller's own inverse kinematics is asked from the nominal robot near the goal."""
    campaign, model = diagnosed
    saved = load_model(model)
    robot = saved.model.robot
    meant = goals(campaign)
    poses = forward(robot, np.radians(meant))
    tool = np.array(campaign.world.targets["T2"])
    names = branches(robot, np.radians(meant)) or []
    rows = []
    for q, pose, name in zip(meant, poses, names, strict=True):
        at = pose[:3, 3] + pose[:3, :3] @ tool
        w, x, y, z = quaternion(pose, [1.0, 0.0, 0.0, 0.0])
        quarters = [math.floor(q[k] / 90.0) for k in (0, 3, 5)]
        rows.append(
            f"[[{at[0]:.6f},{at[1]:.6f},{at[2]:.6f}],[{w:.9f},{x:.9f},{y:.9f},{z:.9f}],"
            f"[{quarters[0]},{quarters[1]},{quarters[2]},{BRANCHES.index(name)}],{EXT}]"
        )
    tooldata = f"[TRUE,[[{tool[0]},{tool[1]},{tool[2]}],[1,0,0,0]],[1,[0,0,1],[1,0,0,0],0,0,0]]"
    text = corrected(
        model,
        tmp_path,
        f"MODULE M\nPERS tooldata t2:={tooldata};\nCONST robtarget p{{{len(rows)}}}:=[{','.join(rows)}];\n"
        "PROC main()\nFOR i FROM 1 TO 40 DO MoveL p{i},v100,fine,t2; ENDFOR\nENDPROC\nENDMODULE\n",
    )
    found = re.findall(r"\[\[?([-\d.]+),([-\d.]+),([-\d.]+)\],\[([-\d.,]+)\],\[[-\d,]+\],\[9E9", text)
    assert len(found) == len(meant)
    sent = poses.copy()
    for pose, (x, y, z, rotation) in zip(sent, found, strict=True):
        w, i, j, k = (float(v) for v in rotation.split(","))
        pose[:3, :3] = [
            [1 - 2 * (j * j + k * k), 2 * (i * j - k * w), 2 * (i * k + j * w)],
            [2 * (i * j + k * w), 1 - 2 * (i * i + k * k), 2 * (j * k - i * w)],
            [2 * (i * k - j * w), 2 * (j * k + i * w), 1 - 2 * (i * i + j * j)],
        ]
        pose[:3, 3] = np.array([float(x), float(y), float(z)]) - pose[:3, :3] @ tool
    joints = np.degrees(nominal_inverse(robot, sent, np.radians(meant), np.zeros(3)))
    before, after = errors(campaign, joints, meant)
    predicted = predicted_rms(saved, meant)
    assert after < 0.05 * before
    assert 0.3 * predicted < after < 2.0 * predicted
