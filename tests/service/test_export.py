"""`truepose export`, read back by independent code.

These would catch: a frame or a unit written wrong, an effect claimed that the format cannot hold, and one omitted that
it can. They would also catch a stated error that is not that of the file. Other code reads every file, assembles it
as its reader would, and compares it with the slow second chain.
"""

from __future__ import annotations

import csv
import json
import math
import re
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib import CalibratedModel, DataError, StatedConditions, identify, load_robot
from calib.array import Array
from calib.compensate import Calibrated, RepresentableModel, carried, constant_slots, poses_with
from calib.data import read_dataset
from calib.effects.thermal import thermal_growth
from calib.effects.transmission import backlash
from calib.fit import ErrorStatistics
from calib.robot_file.serial_chain import chain_of
from calib.robot_file.urdf import read_urdf
from calib.saved import load_model, save_model
from service import exports
from service.cli import main
from service.exports import FORMATS, ExportRequest, listed
from tests.calib.chain import chain, shift, turn
from tests.service.campaigns import write_data
from tests.service.robot_programs import model_of, real_flange

STATED = StatedConditions(temperature_c=22.0)
HASH = "calib_209549117540498681"


def written(name: str, kind: str, *, robot_hash: str | None = HASH) -> tuple[CalibratedModel, Any, str]:
    """The export of the stiff robot, which a table of frames holds exactly."""
    saved = stiffened(model_of(name))
    export = export_of(saved, kind, robot_hash)
    return saved, export.carried, FORMATS[kind].writes(export)


def stiffened(saved: CalibratedModel) -> CalibratedModel:
    bends = np.array([bool(re.fullmatch(r"c\d", p.name)) for p in saved.model.parameters])
    return replace(saved, estimate=np.where(bends, 0.0, saved.estimate))


def export_of(saved: CalibratedModel, kind: str, robot_hash: str | None = HASH) -> ExportRequest:
    robot = saved.model.robot
    slots = FORMATS[kind].holds(robot)
    found = carried(saved.model, saved.estimate, STATED, slots, coupling=saved.coupling)
    return ExportRequest(robot, saved.coupling, found, ("about -- it",), robot_hash)


def stands(n: int = 40) -> Array:
    return np.random.default_rng(7).uniform(-1.5, 1.5, (n, 6))


def stiff(saved: CalibratedModel, joints: Array) -> Array:
    """The flange of the real robot, by the slow chain."""
    add = {p.name: float(v) for p, v in zip(saved.model.parameters, saved.estimate, strict=True)}
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
    assert found.left_out == ()
    bends = {p.name for p in saved.model.parameters if re.fullmatch(r"c\d", p.name)}
    assert set(export_of(model_of(name), "urdf").carried.left_out) == bends
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
    for q in stands():
        reached = np.eye(4)
        for origin, angle in zip(origins, q, strict=True):
            reached = reached @ origin @ turn("z", angle).real
        np.testing.assert_allclose(reached, chain(saved.model.robot, q, found.values).real, atol=1e-6)


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
    wanted = np.array([found.values[f"theta{k}"] for k in range(1, 7)])
    np.testing.assert_allclose(offsets, saved.model.robot.controller_angles(wanted, "fanuc-j23"), atol=1e-7)
    assert "a3" in found.left_out


MAKERS = {
    "abb": "abb-irb120",
    "fanuc": "fanuc-lrmate200ic",
    "kuka": "kuka-kr6-r900",
    "yaskawa": "yaskawa-gp7",
    "ur": "ur5",
}


def robots_for(kind: str, *others: str) -> list[str]:
    """The robot of the maker for whom the format is, otherwise others."""
    maker = kind.partition("-")[0]
    return [MAKERS[maker]] if maker in MAKERS else list(others)


@pytest.mark.parametrize(
    ("name", "kind"),
    [(name, kind) for kind in FORMATS for name in robots_for(kind, "ur5", "fanuc-lrmate200ic")],
)
def test_the_loss_is_that_of_the_numbers_in_the_file(name: str, kind: str) -> None:
    saved = model_of(name)
    export = export_of(saved, kind)
    found, form = export.carried, FORMATS[kind]
    text = form.writes(export)
    loss = found.off(form.reads(text, export))
    errors = []
    for q in found.joints[:200]:
        part = chain(saved.model.robot, q, found.values).real
        errors.append(np.linalg.norm(part[:3, 3] - real_flange(saved, q)[:3, 3]))
    assert loss.rms == pytest.approx(float(np.sqrt(np.mean(np.square(errors)))), rel=0.15)  # 200 of 1000
    assert loss.max >= max(errors) - (
        2e-3 if kind.startswith(("fanuc", "yaskawa")) else 1e-4
    )  # three decimals
    # A file with another number in it is off by another amount, whatever the model is.
    other = re.sub(r"(?<![\w.])(\d+)\.(\d)(?=\d{2})", lambda m: f"{m[1]}.{(int(m[2]) + 5) % 10}", text)
    assert other != text
    try:
        changed = found.off(form.reads(other, export)).rms
    except ValueError:  # a quaternion of another length is refused
        changed = math.inf
    assert changed > 2.0 * loss.rms


@pytest.mark.parametrize("kind", FORMATS)
def test_what_a_format_cannot_hold_is_taken_over_by_what_it_holds(kind: str) -> None:
    # A robot that bends by more than its geometry is wrong
    saved = model_of(robots_for(kind, "abb-irb120")[0], scale=0.2)
    bends = np.array([bool(re.fullmatch(r"c\d", p.name)) for p in saved.model.parameters])
    saved = replace(saved, estimate=np.where(bends, 5.0 * saved.estimate, saved.estimate))
    export = export_of(saved, kind)
    cut = replace(export, carried=export_of(stiffened(saved), kind).carried)
    form, off = FORMATS[kind], export.carried.off
    fitted, dropped = (off(form.reads(form.writes(each), each)).rms for each in (export, cut))
    assert fitted < (1.0 if kind == "mastering" or kind.endswith(("-frames", "-offsets")) else 0.85) * dropped
    # The best that the slots can do: no single change of one of them makes it better.
    robot, found = saved.model.robot, export.carried
    best = spread(found, poses_with(robot, found.joints, found.values))
    for slot, value in found.values.items():
        for by in (-2e-4, 2e-4):
            changed = poses_with(robot, found.joints, found.values | {slot: value + by})
            assert spread(found, changed) > best - 1e-5


def spread(found: RepresentableModel, poses: Array) -> float:
    """Places, and turns at a lever of 100 mm, mm RMS."""
    turned = Rotation.from_matrix(poses[:, :3, :3]).inv() * Rotation.from_matrix(found.poses[:, :3, :3])
    places = poses[:, :3, 3] - found.poses[:, :3, 3]
    return float(np.sqrt(np.mean(np.sum(places**2, axis=1) + (100.0 * turned.magnitude()) ** 2)))


def test_what_is_constant_at_the_stated_conditions_is_carried() -> None:
    saved = stiffened(model_of("abb-irb120"))
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


def test_every_format_says_what_it_leaves_before_one_is_chosen(
    model: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    result = tmp_path / "all.json"
    assert main(["export", str(model), "--list", "--json", str(result)]) == 0
    shown = capsys.readouterr().out
    listed = json.loads(result.read_text("utf-8"))
    assert [each["kind"] for each in listed["exports"]] == list(FORMATS)
    for each in listed["exports"]:
        out, one = tmp_path / f"file.{each['kind']}", tmp_path / "one.json"
        done = main(
            ["export", str(model), str(out), "--as", each["kind"], "--hash", HASH, "--json", str(one)]
        )
        assert (done == 0) == (each["refused"] is None) == out.exists()
        if done == 0:
            document = json.loads(one.read_text("utf-8"))
            assert each["left_mm"] == pytest.approx(document["predicted_rms_mm"], rel=1e-12)
            assert each["loss_mm"]["rms"] == pytest.approx(document["loss_mm"]["rms"], rel=1e-12)
            assert each["left_out"] == document["left_out"]
            assert f"{each['left_mm']:.3f}" in shown
        else:
            assert each["left_mm"] is each["loss_mm"] is None
            assert "by ABB" in each["refused"]
            assert each["kind"] in shown


def test_a_ur_is_listed_without_its_hash_and_an_unjudged_model_leaves_nobody_knows_what() -> None:
    saved = model_of("ur10")
    choices = {each.kind: each for each in listed(*saved.for_use(), "m", "temperature=22").exports}
    assert choices["ur-yaml"].refused is None
    assert choices["ur-yaml"].loss_mm is not None
    assert saved.held_out_rms_mm is None
    assert [each.left_mm for each in choices.values()] == [None] * len(FORMATS)
    assert {name for name, each in choices.items() if each.refused is None} >= {"ur-frames", "ur-calibration"}


@pytest.mark.parametrize("rest", [[], ["OUT"], ["OUT", "--as", "urdf", "--list"], ["--as", "urdf", "--list"]])
def test_a_file_is_asked_for_or_a_list(
    model: Path, tmp_path: Path, rest: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["export", str(model), *rest]) == 2
    assert list(tmp_path.iterdir()) == []


def test_the_postures_of_readings_are_where_the_file_is_close(
    model: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    saved, data = load_model(model), write_data(tmp_path)
    readings = read_dataset(data)
    there = readings.conditions.joints[readings.usable]
    whole = Calibrated(saved.model, saved.estimate, STATED).poses(there)
    off = {}
    for name, more in (("anywhere", []), ("there", ["--data", str(data)])):
        out, result = tmp_path / f"{name}.urdf", tmp_path / "r.json"
        argv = ["export", str(model), str(out), "--as", "urdf", "--conditions", "temperature=22"]
        assert main([*argv, *more, "--json", str(result)]) == 0
        reached = chain_of(read_urdf(out)).forward(there)
        off[name] = float(np.sqrt(np.mean(np.sum((reached - whole)[:, :3, 3] ** 2, axis=1))))
        if more:
            assert json.loads(result.read_text("utf-8"))["loss_mm"]["rms"] == pytest.approx(
                off[name], rel=0.05
            )
    assert off["there"] < 0.95 * off["anywhere"]
    shown = " ".join(capsys.readouterr().out.split())
    assert "postures of" in shown
    limits = saved.model.robot
    anywhere = np.random.default_rng(3).uniform(limits.lower, limits.upper, (1000, 6))
    wide = Calibrated(saved.model, saved.estimate, STATED).poses(anywhere)
    miss = (chain_of(read_urdf(out)).forward(anywhere) - wide)[:, :3, 3]
    said = re.search(r"Elsewhere, .*: (\d+\.\d+) mm RMS", shown)
    assert said is not None
    assert float(said[1]) == pytest.approx(float(np.sqrt(np.mean(np.sum(miss**2, axis=1)))), rel=0.1)


def test_few_postures_are_refused(model: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    data = write_data(tmp_path)
    argv = ["export", str(model), str(tmp_path / "o.urdf"), "--as", "urdf", "--data", str(data)]
    lines = data.read_text("utf-8").splitlines()
    data.write_text("\n".join(lines[:9]) + "\n", "utf-8")
    assert main(argv) == 2
    assert "postures outside its validation set" in capsys.readouterr().err
    assert not (tmp_path / "o.urdf").exists()


def test_what_cannot_be_exported_leaves_no_file(
    model: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for kind, what in (("stl", "not a known format"), ("ur-yaml", "for UR robots")):
        assert main(["export", str(model), str(tmp_path / "o"), "--as", kind]) == 2
        assert what in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_a_model_that_no_reading_judged_takes_the_error_of_the_robot_with_the_loss_of_the_file() -> None:
    unjudged = model_of("ur10")
    saved = replace(unjudged, verified_rms_mm=0.05)
    found = listed(*saved.for_use(), "m", "temperature=22")
    assert (found.held_out_rms_mm, found.verified_rms_mm) == (None, 0.05)
    for each in found.written:
        assert each.loss_mm is not None
        assert each.left_mm == pytest.approx(math.hypot(0.05, float(each.loss_mm.rms or 0.0)))
    one = exports.written(*saved.for_use(), "m", "dh-csv", "temperature=22", None)
    assert any("0.050 mm of the robot at new poses" in line for line in one.about)
    assert not any("held-out" in line for line in one.about)
    judged = replace(saved, held_out_rms_mm=0.2)  # readings that took no part come first
    assert all(
        float(each.left_mm or 0.0) >= 0.2 for each in listed(*judged.for_use(), "m", "temperature=22").written
    )


def test_a_loop_keeps_the_error_of_the_robot_with_its_model(tmp_path: Path) -> None:
    found = identify(read_dataset(write_data(tmp_path, effects=(), n=40)))
    assert found.converged
    save_model(tmp_path / "m.json", found, verified=ErrorStatistics(12, 0.06, 0.05, 0.09, 0.1))
    saved = load_model(tmp_path / "m.json")
    assert (saved.held_out_rms_mm, saved.verified_rms_mm) == (None, 0.06)
    save_model(tmp_path / "plain.json", found)
    assert load_model(tmp_path / "plain.json").verified_rms_mm is None
