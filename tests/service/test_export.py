"""`truepose export`. These would catch: a frame or a unit written wrong, an effect claimed that the format cannot hold,
one left out that it can, and an error that is not the file's own. Every file is read back here by other code, put
together as its reader would, and compared with the slow second chain.
"""

from __future__ import annotations

import csv
import json
import math
import re
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib import DataError, SavedModel, StatedConditions, load_robot
from calib.array import Array
from calib.compensate import carried, constant_slots
from calib.effects.thermal.thermal_growth import thermal_growth
from calib.effects.transmission.backlash import backlash
from service.cli import main
from service.exports import FORMATS, Export
from tests.calib.chain import chain, shift, turn
from tests.service.robot_programs import model_of, real_flange

STATED = StatedConditions(temperature_c=22.0)
HASH = "calib_209549117540498681"


def written(name: str, kind: str, *, robot_hash: str | None = HASH) -> tuple[SavedModel, Any, str]:
    saved = model_of(name)
    form = FORMATS[kind]
    found = carried(
        saved.model, saved.estimate, STATED, form.holds(saved.model.robot), coupling=saved.coupling
    )
    export = Export(saved.model.robot, saved.coupling, found, ("about -- it",), robot_hash)
    return saved, found, form.writes(export)


def stands(n: int = 40) -> Array:
    return np.random.default_rng(7).uniform(-1.5, 1.5, (n, 6))


def stiff(saved: SavedModel, joints: Array) -> Array:
    """The flange of the real robot without its compliances, by the slow chain."""
    add = {
        p.name: float(v)
        for p, v in zip(saved.model.parameters, saved.estimate, strict=True)
        if not re.fullmatch(r"c\d", p.name)
    }
    return chain(saved.model.robot, joints, add).real


def frame(xyz: list[float], rpy: list[float]) -> Array:
    out = np.eye(4)
    out[:3, :3] = Rotation.from_euler("xyz", rpy).as_matrix()
    out[:3, 3] = 1000.0 * np.array(xyz)
    return out


@pytest.mark.parametrize("name", ["abb-irb120", "fanuc-lrmate200ic", "ur5", "ur10"])
def test_a_urdf_holds_every_constant_frame(name: str) -> None:
    saved, found, text = written(name, "urdf")
    root = ET.fromstring(text)
    joints = root.findall("joint")
    assert [j.get("type") for j in joints] == ["revolute"] * 6 + ["fixed"]
    origins = []
    for joint in joints:
        origin = joint.find("origin")
        assert origin is not None
        origins.append(frame(*([float(v) for v in str(origin.get(key)).split()] for key in ("xyz", "rpy"))))
    for q in stands():
        reached = np.eye(4)
        for origin, angle in zip(origins, [*q, 0.0], strict=True):
            reached = reached @ origin @ turn("z", angle).real
        np.testing.assert_allclose(reached, stiff(saved, q), atol=1e-6)
    assert set(found.left_out) == {p.name for p in saved.model.parameters if re.fullmatch(r"c\d", p.name)}
    axes = [axis.get("xyz") for axis in root.iter("axis")]
    assert axes == ["0 0 1"] * 6


def test_urdf_limits_hold_what_the_controller_may_do() -> None:
    _, _, text = written("fanuc-lrmate200ic", "urdf")
    robot = load_robot("fanuc-lrmate200ic")
    rng = np.random.default_rng(1)
    model = robot.model_angles(rng.uniform(robot.lower, robot.upper, (2000, 6)), "fanuc-j23")
    limits = [
        (float(str(x.get("lower"))), float(str(x.get("upper")))) for x in ET.fromstring(text).iter("limit")
    ]
    lower, upper = np.array(limits).T
    assert np.all((model >= lower) & (model <= upper))
    assert upper[2] == pytest.approx(math.radians(60.0 + 142.0))
    for limit in ET.fromstring(text).iter("limit"):  # zero would tell planners that the joint cannot move
        assert float(str(limit.get("effort"))) > 0.0
        assert float(str(limit.get("velocity"))) > 0.0
    assert "placeholders" in text


@pytest.mark.parametrize("name", ["ur5", "ur10"])
def test_the_yaml_of_a_ur_keeps_the_hash_and_all_but_what_stands_behind_the_last_joint(name: str) -> None:
    saved, found, text = written(name, "ur-yaml")
    assert re.search(rf"^  hash: {HASH}$", text, re.MULTILINE)
    links = re.findall(r"^  (\w+):\n((?:    \w+: \S+\n){6})", text, re.MULTILINE)
    assert [link for link, _ in links] == [
        "shoulder",
        "upper_arm",
        "forearm",
        "wrist_1",
        "wrist_2",
        "wrist_3",
    ]
    origins = []
    for _, body in links:
        value = {key: float(v) for key, v in re.findall(r"(\w+): (\S+)", body)}
        origins.append(frame([value[k] for k in "xyz"], [value[k] for k in ("roll", "pitch", "yaw")]))
    behind = [f"{kind}6" for kind in ("alpha", "beta", "a")]
    assert set(behind) - {"beta6"} <= set(found.left_out)
    gone = {p.name: -float(v) for p, v in zip(saved.model.parameters, saved.estimate, strict=True)}
    for q in stands():
        reached = np.eye(4)
        for origin, angle in zip(origins, q, strict=True):
            reached = reached @ origin @ turn("z", angle).real
        rest = np.linalg.inv(reached) @ stiff(saved, q)
        # What is missing is a small fixed frame behind the last joint: a_6 and alpha_6.
        lost = shift("x", -gone["a6"]) @ turn("x", -gone["alpha6"])
        np.testing.assert_allclose(rest, lost.real, atol=1e-6)


def test_a_ur_yaml_needs_a_ur_and_its_hash() -> None:
    with pytest.raises(DataError, match="for UR robots"):
        written("abb-irb120", "ur-yaml")
    for wrong in (None, "12345"):
        with pytest.raises(DataError, match="own hash"):
            written("ur5", "ur-yaml", robot_hash=wrong)


@pytest.mark.parametrize("name", ["abb-irb120", "ur10"])
def test_dh_tables_put_together_stand_where_the_stiff_robot_stands(name: str) -> None:
    saved, _, text = written(name, "dh-csv")
    base, *links = csv.DictReader(text.splitlines())
    place = [float(base[f"{axis}_mm"]) for axis in "xyz"]
    turns = [math.radians(float(base[f"r{axis}_deg"])) for axis in "xyz"]
    for q in stands():
        reached = shift("x", place[0]) @ shift("y", place[1]) @ shift("z", place[2])
        if saved.model.robot.base == "thesis":
            reached = reached @ shift("z", float(links[0]["d_mm"]))
        for axis, angle in zip("xyz", turns, strict=True):
            reached = reached @ turn(axis, angle)
        for k, (row, angle) in enumerate(zip(links, q, strict=True)):
            alpha, beta, theta = (
                math.radians(float(row[f"{key}_deg"])) for key in ("alpha", "beta", "theta")
            )
            a, d = float(row["a_mm"]), float(row["d_mm"])
            if saved.model.robot.convention == "mdh":
                d = 0.0 if k == 0 and saved.model.robot.base == "thesis" else d
                reached = reached @ turn("x", alpha) @ turn("y", beta) @ shift("x", a)
                reached = reached @ turn("z", theta + angle) @ shift("z", d)
            else:
                reached = reached @ turn("z", theta + angle) @ shift("z", d) @ shift("x", a)
                reached = reached @ turn("x", alpha) @ turn("y", beta)
        np.testing.assert_allclose(reached.real, stiff(saved, q), atol=1e-4)


def test_the_table_for_people_says_the_same() -> None:
    saved, _, text = written("abb-irb120", "dh-md")
    rows = [line.split("|")[1:-1] for line in text.splitlines() if re.match(r"\| \d \|", line)]
    value = dict(zip((p.name for p in saved.model.parameters), saved.estimate, strict=True))
    assert float(rows[2][3]) == pytest.approx(270.0 + value["a3"], abs=1e-6)
    assert float(rows[2][2]) == pytest.approx(math.degrees(value["beta3"]), abs=1e-6)
    assert float(rows[1][4]) == pytest.approx(-90.0 + math.degrees(value["theta2"]), abs=1e-6)
    assert "Rx(alpha) Ry(beta) Tx(a) Rz(theta + q) Tz(d)" in text
    assert "about -- it" in text


def test_offsets_for_mastering_are_the_controllers() -> None:
    saved, found, text = written("fanuc-lrmate200ic", "mastering")
    rows = list(csv.DictReader(text.splitlines()))
    offsets = np.radians([float(row["offset_deg"]) for row in rows])
    value = dict(zip((p.name for p in saved.model.parameters), saved.estimate, strict=True))
    wanted = np.array([value.get(f"theta{k}", 0.0) for k in range(1, 7)])
    np.testing.assert_allclose(offsets, saved.model.robot.controller_angles(wanted, "fanuc-j23"), atol=1e-7)
    assert "a3" in found.left_out


@pytest.mark.parametrize("kind", ["urdf", "mastering"])
def test_the_loss_is_the_files_own(kind: str) -> None:
    saved, found, _ = written("abb-irb120", kind)
    rng = np.random.default_rng(1)
    robot = saved.model.robot
    joints = rng.uniform(robot.lower, robot.upper, (1000, 6))[:200]
    errors = []
    for q in joints:
        part = chain(robot, q, found.values).real
        errors.append(np.linalg.norm(part[:3, 3] - real_flange(saved, q)[:3, 3]))
    rms = float(np.sqrt(np.mean(np.square(errors))))
    assert found.loss.rms == pytest.approx(rms, rel=0.15)  # 200 of the 1000 stands
    assert found.loss.max >= max(errors) - 1e-9
    assert 0.0 < found.loss.rms < found.nominal.rms


def test_what_is_constant_at_the_stated_conditions_is_carried() -> None:
    saved = model_of("abb-irb120")
    robot = saved.model.robot
    model = saved.model.append(backlash(4), thermal_growth(robot, 20.0))
    estimate = np.append(saved.estimate, [0.002, 20e-6])
    below, above = (
        carried(model, estimate, StatedConditions(side=side, temperature_c=25.0), constant_slots(robot))
        for side in (1.0, -1.0)
    )
    assert below.values["theta4"] - above.values["theta4"] == pytest.approx(0.002)
    plain = carried(saved.model, saved.estimate, STATED, constant_slots(robot))
    assert below.values["a3"] - plain.values["a3"] == pytest.approx(270.0 * 20e-6 * 5.0)
    assert not any("gap" in name or "expansion" in name for name in below.left_out)
    with pytest.raises(DataError, match="not stated"):
        carried(model, estimate, StatedConditions(), constant_slots(robot))


def test_the_command_says_what_is_lost(
    model: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    figures = {}
    for kind in ("urdf", "dh-csv", "dh-md", "mastering"):
        out, result = tmp_path / f"out.{kind}", tmp_path / "r.json"
        assert main(["export", str(model), str(out), "--as", kind, "--json", str(result)]) == 0
        shown = capsys.readouterr().out
        assert "Predicted error:" in shown
        assert "Leaves out" in shown
        document = json.loads(result.read_text("utf-8"))
        assert document["format"] == "truepose-model-export/1"
        assert document["predicted_rms_mm"] == pytest.approx(
            math.hypot(document["loss_mm"]["rms"], document["held_out_rms_mm"])
        )
        assert out.stat().st_size > 100
        figures[kind] = document
    assert "c2" in figures["urdf"]["left_out"]
    assert figures["urdf"]["loss_mm"]["rms"] < figures["mastering"]["loss_mm"]["rms"]
    assert figures["urdf"]["predicted_rms_mm"] > figures["urdf"]["held_out_rms_mm"]


def test_what_cannot_be_exported_leaves_no_file(
    model: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for kind, what in (("stl", "not a known format"), ("ur-yaml", "for UR robots")):
        assert main(["export", str(model), str(tmp_path / "o"), "--as", kind]) == 2
        assert what in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
