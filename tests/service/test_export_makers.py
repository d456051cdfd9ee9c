"""Test frames and joint offsets for five makers as their controllers would use them.

These would catch: a wrong sign, an inverted frame, angles in another order and a file that a controller cannot read.
They would also catch numbers of frames and offsets that do not belong together. Every file is read by a reader written
here, and a robot written here (`tests.calib.chain`) shows where the real tool is. The URDF and the YAML for ROS are
read by the parsers of ROS and YAML.
"""

from __future__ import annotations

import ast
import configparser
import math
import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from urdf_parser_py.urdf import URDF

from calib import CalibratedModel, DataError, identify, load_robot
from calib.arm import Robot
from calib.array import Array
from calib.compensate import poses_with
from calib.effects.geometry import tool_tilt
from calib.fit.least_squares import DroppedParameter
from calib.model import ModelStructure, base_model
from calib.saved import as_saved
from calib.units import to_internal
from service.exports import FORMATS, written
from tests.calib.cells import POSE, Cell
from tests.calib.chain import Matrix, chain, shift, turn
from tests.service.robot_programs import model_of
from tests.service.test_export import HASH, MAKERS, export_of, stiffened

Vector = tuple[float, float, float]
TARGETS: dict[str, Vector] = {"T1": (0.0, 0.0, 125.0), "T2": (75.0, 93.675, 215.0)}
COUPLINGS = {"fanuc": "fanuc-j23", "kuka": "kuka"}
NUMBER = r"-?\d+(?:\.\d+)?(?:e-?\d+)?"
FRAMES = [f"{maker}-frames" for maker in MAKERS]
OFFSETS = [f"{maker}-offsets" for maker in MAKERS]


def rigid(
    kind: str,
    *,
    offsets: bool = False,
    placed: bool = True,
    targets: dict[str, Vector] | None = None,
    tilt_deg: float = 0.2,
) -> CalibratedModel:
    """Return a model that is nominal but for base, tool and, if requested, the joint zeros."""
    maker = kind.partition("-")[0]
    robot, rng = load_robot(MAKERS[maker]), np.random.default_rng(5)
    targets = TARGETS if targets is None else targets
    groups = ("base", "tool", *(("joint_offsets",) if offsets else ()))
    effects = base_model.build(groups, robot, ("main",), (dict.fromkeys(targets, False),))
    placements = {}
    if placed:
        placement = (
            shift("x", 1500.0) @ shift("y", -700.0) @ shift("z", 300.0) @ turn("z", 2.1) @ turn("x", 0.3)
        )
        placements = {"main": placement.real}
    model = ModelStructure(robot, (*effects, tool_tilt()), {"main": targets}, placements)
    sizes = {"mm": 0.5, "deg": 0.15}
    estimate = [to_internal(rng.normal() * sizes[p.unit], p.unit) for p in model.parameters]
    for name in ("rx", "ry"):
        estimate[model.index[f"tool_tilt.{name}"]] = math.radians(tilt_deg)
    return CalibratedModel(
        model=model,
        estimate=np.array(estimate),
        covariance=np.zeros((len(estimate), len(estimate))),
        loads=robot.loads,
        gravity=(0.0, 0.0, -9.81),
        coupling=COUPLINGS.get(maker, "none"),
        data_sha256="",
        holds_for={"approach": ["from below"] * 6, "temperature_c": 22.0},
    )


def exported(saved: CalibratedModel, kind: str) -> tuple[str, tuple[str, ...]]:
    done = written(*saved.for_use(), "m.json", kind, None, HASH)
    assert done.text.isascii()
    return done.text, done.about


# -- readers ----------------------------------------------------------------------------------------------


def at(position: Any, rotation: Array) -> Array:
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = rotation, position
    return out


def of_quaternion(numbers: list[float]) -> Array:
    w, x, y, z = numbers[3:]
    assert w * w + x * x + y * y + z * z == pytest.approx(1.0, abs=1e-7)
    rotation = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return at(numbers[:3], np.array(rotation))


def of_turns(axes: str, numbers: list[float]) -> Array:
    whole: Matrix = np.eye(4, dtype=complex)
    for axis, angle in zip(axes, numbers[3:], strict=True):
        whole = whole @ turn(axis, math.radians(angle))
    return at(numbers[:3], whole.real[:3, :3])


def of_wpr(numbers: list[float]) -> Array:
    x, y, z, w, p, r = numbers
    return of_turns("zyx", [x, y, z, r, p, w])


def of_vector(numbers: list[float]) -> Array:
    angle = float(np.linalg.norm(numbers[3:]))
    k = np.array(numbers[3:]) / (angle or 1.0)
    cross = np.array([[0, -k[2], k[1]], [k[2], 0, -k[0]], [-k[1], k[0], 0]])
    rotation = np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross
    return at(1000.0 * np.array(numbers[:3]), rotation)


@dataclass
class ControllerFrames:
    """Tools and work frames of a controller after the file was read, by the names of the model."""

    tools: dict[str, Array]
    frames: dict[str, Array]


def numbers(text: str) -> list[float]:
    return [float(each) for each in re.findall(rf"(?<![\w.]){NUMBER}", text)]


def rapid(text: str) -> ControllerFrames:
    pose = rf"\[\[({NUMBER}),({NUMBER}),({NUMBER})\],\[({NUMBER}),({NUMBER}),({NUMBER}),({NUMBER})\]\]"
    load = re.escape("[-1,[0,0,0],[1,0,0,0],0,0,0]")
    lines = [line for line in text.splitlines() if not line.startswith("  ! ")]
    assert (lines[0], lines[-1]) == ("MODULE TruePoseFrames", "ENDMODULE")
    known = ControllerFrames({}, {})
    for line in lines[1:-1]:
        tool = re.fullmatch(rf"  PERS tooldata tTP_(\w+):=\[TRUE,{pose},{load}\];", line)
        work = re.fullmatch(
            rf'  PERS wobjdata wTP_(\w+):=\[FALSE,TRUE,"",{pose},\[\[0,0,0\],\[1,0,0,0\]\]\];', line
        )
        found = tool or work
        assert found is not None, line
        into = known.tools if tool else known.frames
        into[found[1]] = of_quaternion([float(v) for v in found.groups()[1:]])
    return known


def fanuc(text: str) -> ControllerFrames:
    program, places = text.partition("/MN\n")[2].split("/POS\n")
    points = {
        number: of_wpr(numbers(body.replace("mm", "").replace("deg", "")))
        for number, body in re.findall(
            r"P\[(\d+)\]\{.*?CONFIG : 'N U T, 0, 0, 0',\n(.*?)\n\};", places, re.DOTALL
        )
    }
    lines = [re.fullmatch(r" *\d+:  (.*?) *;", line) for line in program.splitlines()]
    codes = [line[1] for line in lines if line is not None]
    assert len(codes) == len(program.splitlines()) == int(str(re.search(r"LINE_COUNT\t= (\d+)", text)[1]))  # type: ignore[index]
    remarks = [code for code in codes if code.startswith("!")]
    assert max(map(len, remarks)) <= 32
    done = [code for code in codes if not code.startswith("!")]
    assert done[1] == "PAUSE"
    names = dict(re.findall(r"!(U\w+\[\d+\]) (\w+)", "\n".join(remarks)))
    known, register = ControllerFrames({}, {}), None
    for code in done[2:]:
        if (match := re.fullmatch(r"PR\[100\]=P\[(\d+)\]", code)) is not None:
            register = points[match[1]]
            continue
        which, number = re.fullmatch(r"(UTOOL|UFRAME)\[(\d+)\]=PR\[100\]", code).groups()  # type: ignore[union-attr]
        assert register is not None
        into = known.tools if which == "UTOOL" else known.frames
        into[names[f"{which}[{number}]"]] = register
    return known


def krl(text: str) -> ControllerFrames:
    known = ControllerFrames({}, {})
    for which, into in (("TOOL", known.tools), ("BASE", known.frames)):
        for number, body in re.findall(rf"^{which}_DATA\[(\d+)\]=\{{(.*)\}}$", text, re.MULTILINE):
            cells = dict(cell.split(" ") for cell in body.split(","))
            name = re.search(rf'^{which}_NAME\[{number},\]="TP_(\w+)"$', text, re.MULTILINE)
            assert name is not None
            into[name[1]] = of_turns("zyx", [float(cells[k]) for k in "XYZABC"])
    return known


def urscript(text: str) -> ControllerFrames:
    poses = {
        name: of_vector(numbers(body))
        for name, body in re.findall(r"^tp_(\w+) = p\[(.*)\]$", text, re.MULTILINE)
    }
    tools = {name[5:]: pose for name, pose in poses.items() if name.startswith("tool_")}
    return ControllerFrames(
        tools, {name: pose for name, pose in poses.items() if not name.startswith("tool_")}
    )


def yaskawa(text: str) -> ControllerFrames:
    tools = re.findall(r"^//TOOL \d+\n///NAME TP_(\w+)\n(.*)$", text, re.MULTILINE)
    works = re.findall(r"^//UFRAME \d+\n///NAME TP_(\w+)\n////BUSER (.*)$", text, re.MULTILINE)
    return ControllerFrames(
        {name: of_wpr(numbers(row)) for name, row in tools},
        {name: of_wpr(numbers(row)) for name, row in works},
    )


READERS: dict[str, Callable[[str], ControllerFrames]] = {
    "abb": rapid,
    "fanuc": fanuc,
    "kuka": krl,
    "ur": urscript,
    "yaskawa": yaskawa,
}
OF_LIST: dict[str, Callable[[list[float]], Array]] = {
    "abb": of_quaternion,
    "fanuc": of_wpr,
    "kuka": lambda v: of_turns("zyx", v),
    "ur": of_vector,
    "yaskawa": of_wpr,
}


def listed_frames(maker: str, text: str) -> ControllerFrames:
    """The frames at the end of a file of offsets."""
    known = ControllerFrames({}, {})
    for which, name, cells in re.findall(r"^(tool|frame) (\w+): (.*)$", text, re.MULTILINE):
        into = known.tools if which == "tool" else known.frames
        into[name] = OF_LIST[maker]([float(cell.split(" ")[1]) for cell in cells.split(", ")])
    return known


# -- robot and controller ---------------------------------------------------------------------------------


def real(saved: CalibratedModel, joints: Array, target: str | None) -> Array:
    """Pose of a target, or of the flange, of the real robot in the world of the readings."""
    model = saved.model
    add: dict[str, float] = {}
    for parameter, value in zip(model.parameters, saved.estimate, strict=True):
        slot = parameter.name.replace("tool_tilt.", "tool.").replace("offset", "theta")
        if (which := slot.partition(".")[0]) in TARGETS:
            if which != target:
                continue
            slot = slot.replace(which, "target")
        add[slot] = add.get(slot, 0.0) + float(value)
    place = model.placements.get("main", np.eye(4))
    nominal = (0.0, 0.0, 0.0) if target is None else model.targets["main"][target]
    return place @ chain(model.robot, joints, add, nominal).real


def world_of(robot: Robot) -> Array:
    return at(robot.controller_world_mm, np.eye(3))


def believed(robot: Robot, joints: Array, tool: Array, frame: Array) -> Array:
    """Return the pose of a tool in a work frame according to the controller."""
    return np.linalg.inv(frame) @ np.linalg.inv(world_of(robot)) @ chain(robot, joints, {}).real @ tool


def postures(n: int = 25) -> Array:
    return np.random.default_rng(11).uniform(-1.2, 1.2, (n, 6))


def fine(maker: str) -> float:
    """Three decimals of mm and of deg at a metre or two."""
    return 0.06 if maker in ("fanuc", "yaskawa") else 2e-4


@pytest.mark.parametrize("kind", FRAMES)
def test_a_controller_with_the_frames_knows_where_the_real_tool_is(kind: str) -> None:
    maker = kind.partition("-")[0]
    saved = rigid(kind)
    robot, known = saved.model.robot, READERS[maker](exported(saved, kind)[0])
    assert set(known.tools) == {"flange", *TARGETS}
    assert set(known.frames) == {"base", "world"}
    for q in postures():
        for name in TARGETS:
            told = believed(robot, q, known.tools[name], known.frames["world"])
            np.testing.assert_allclose(told[:3, 3], real(saved, q, name)[:3, 3], atol=fine(maker))
    # With the frames the other way round it would not.
    turned = np.asarray(np.linalg.inv(known.frames["world"]), dtype=np.float64)
    wrong = believed(robot, postures()[0], known.tools["T1"], turned)
    assert np.linalg.norm(wrong[:3, 3] - real(saved, postures()[0], "T1")[:3, 3]) > 100.0


@pytest.mark.parametrize("kind", FRAMES)
def test_targets_in_the_controllers_world_are_reached_with_the_base_frame(kind: str) -> None:
    maker = kind.partition("-")[0]
    saved = rigid(kind, placed=False)
    robot, known = saved.model.robot, READERS[maker](exported(saved, kind)[0])
    back = np.linalg.inv(world_of(robot))
    away = []
    for q in postures():
        goal = (back @ real(saved, q, "T2"))[:3, 3]
        told = believed(robot, q, known.tools["T2"], known.frames["base"])[:3, 3]
        np.testing.assert_allclose(told, goal, atol=fine(maker))
        nominal = back @ chain(robot, q, {}, TARGETS["T2"]).real
        away.append(np.linalg.norm(nominal[:3, 3] - goal))
    assert min(away) > 0.3


@pytest.mark.parametrize("kind", [*FRAMES, *OFFSETS])
def test_a_file_misses_the_real_robot_by_what_it_states(kind: str) -> None:
    maker = kind.partition("-")[0]
    saved = stiffened(model_of(MAKERS[maker], scale=0.3))
    saved = replace(saved, coupling=COUPLINGS.get(maker, "none"))
    robot = saved.model.robot
    export = export_of(saved, kind)
    done = written(*saved.for_use(), "m.json", kind, None, None)
    offsets = np.zeros(6)
    if kind in OFFSETS:
        known, counted = listed_frames(maker, done.text), entered(done.text)
        offset, rest = robot.model_angles(np.stack([counted, np.zeros(6)]), saved.coupling)
        offsets = offset - rest
    else:
        known = READERS[maker](done.text)
    at_world, add = (
        world_of(robot),
        {p.name: float(v) for p, v in zip(saved.model.parameters, saved.estimate, strict=True)},
    )
    missed, nominal = [], []
    for q in export.carried.joints[:300]:
        goal = (np.linalg.inv(at_world) @ chain(robot, q, add).real)[:3, 3]
        told = believed(robot, q + offsets, known.tools["flange"], known.frames["base"])[:3, 3]
        missed.append(np.linalg.norm(told - goal))
        nominal.append(np.linalg.norm((np.linalg.inv(at_world) @ chain(robot, q, {}).real)[:3, 3] - goal))
    rms = float(np.sqrt(np.mean(np.square(missed))))
    assert rms == pytest.approx(done.document["loss_mm"]["rms"], rel=0.12)  # 300 of 1000
    assert rms < 0.9 * float(np.sqrt(np.mean(np.square(nominal))))


# -- joint offsets ----------------------------------------------------------------------------------------


def entered(text: str) -> Array:
    """The offsets of a file, rad."""
    found = re.findall(r"^[\w ]+: offset ([-+]\d+\.\d{4}) deg", text, re.MULTILINE)
    assert len(found) == 6
    return np.radians([float(each) for each in found])


def declared_zero(text: str) -> Array:
    """Return the growth of the shown angles, deg, if every axis is zeroed as the file states."""
    mames = np.array([0.0, -90.0, 90.0, 0.0, 0.0, 0.0])
    grown = []
    for k, (zero, sign, value) in enumerate(
        re.findall(r"go to (?:(\$MAMES) )?([-+]) ?(\d+\.\d{4})", text.partition("STEPS")[0])
    ):
        start = mames[k] if zero else 0.0
        shown = start + float(f"{sign}{value}")
        grown.append(start - shown)  # it showed `shown`, and shows `start` afterwards
    return np.array(grown)


def counted(robot: Robot, saved: CalibratedModel, model: Array) -> Array:
    return robot.controller_angles(model, saved.coupling)


@pytest.mark.parametrize("kind", OFFSETS)
def test_the_zeros_that_a_person_declares_are_those_of_the_real_robot(kind: str) -> None:
    maker = kind.partition("-")[0]
    saved = rigid(kind, offsets=True)
    robot, (text, _) = saved.model.robot, exported(saved, kind)
    known = listed_frames(maker, text)
    offsets = entered(text)
    if maker != "ur":
        np.testing.assert_allclose(np.radians(declared_zero(text)), offsets, atol=1e-9)
    else:
        rad = [float(v) for v in re.findall(r"= ([-+]\d\.\d{7}) rad", text)]
        np.testing.assert_allclose(rad, offsets, atol=1e-7)
    assert offsets[0] == 0.0
    missed: dict[float, list[float]] = {1.0: [], 0.0: [], -1.0: []}
    for q in postures(60):  # model angles that the controller would have counted before
        goal = real(saved, q, "T2")[:3, 3]
        for sign, errors in missed.items():
            after = counted(robot, saved, q) + sign * offsets  # what it shows at this place of the arm now
            there = robot.model_angles(after[None], saved.coupling)[0]
            told = believed(robot, there, known.tools["T2"], known.frames["world"])[:3, 3]
            errors.append(float(np.linalg.norm(told - goal)))
    with_it, without, opposite = (float(np.mean(missed[sign])) for sign in (1.0, 0.0, -1.0))
    assert with_it < 0.05
    assert without > 0.5
    assert opposite == pytest.approx(2.0 * without, rel=0.05)


@pytest.mark.parametrize("kind", OFFSETS)
def test_the_check_says_how_the_tool_moves(kind: str) -> None:
    maker = kind.partition("-")[0]
    saved = rigid(kind, offsets=True, placed=False)
    robot, (text, _) = saved.model.robot, exported(saved, kind)
    line = re.search(r"drive to these shown angles .*: (.*)\.", text)
    assert line is not None
    shown = np.radians([float(part.rpartition(" ")[2]) for part in line[1].split(", ")])
    told = re.search(r"^(?:The arm stands .* )?(T\d) must .* by ([-+.\d, ]+) mm", text, re.MULTILINE)
    assert told is not None
    move = np.array([float(v) for v in told[2].split(", ")])
    assert 0.3 < np.linalg.norm(move) < 30.0
    assert np.abs(np.degrees(shown)).max() < 180.0
    joints = robot.model_angles(np.stack([shown, shown - entered(text)]), saved.coupling)
    before, after = real(saved, joints[0], told[1]), real(saved, joints[1], told[1])
    sign = 1.0 if maker != "ur" else -1.0  # a UR shows another place instead
    np.testing.assert_allclose(move, sign * (after - before)[:3, 3], atol=0.05)
    parts = np.array([[float(v) for v in row.split(", ")] for row in re.findall(r"alone: (.*) mm", text)])
    assert len(parts) == 5
    np.testing.assert_allclose(parts.sum(axis=0), move, atol=0.06)
    assert np.linalg.norm(parts, axis=1).min() > 0.02


# -- a UR's own file --------------------------------------------------------------------------------------

UR5E = {  # Universal Robots, DH parameters for calculations of kinematics and dynamics
    "a": [0.0, -0.425, -0.3922, 0.0, 0.0, 0.0],
    "d": [0.1625, 0.0, 0.0, 0.1333, 0.0997, 0.0996],
    "alpha": [math.pi / 2, 0.0, 0.0, math.pi / 2, -math.pi / 2, 0.0],
}


def by_conf(text: str, joints: Array) -> Array:
    """The flange as the controller calculates it with the file, m."""
    parser = configparser.ConfigParser()
    parser.read_string(text)
    rows = {
        name: ast.literal_eval(parser["mounting"][f"delta_{name}"]) for name in ("theta", "a", "d", "alpha")
    }
    reached = np.eye(4)
    for k in range(6):
        theta = joints[k] + rows["theta"][k]
        reached = reached @ turn("z", theta).real @ shift("z", UR5E["d"][k] + rows["d"][k]).real
        reached = reached @ shift("x", UR5E["a"][k] + rows["a"][k]).real
        reached = reached @ turn("x", UR5E["alpha"][k] + rows["alpha"][k]).real
    return reached


def test_the_rows_of_a_ur_hold_all_of_its_geometry() -> None:
    saved = stiffened(model_of("ur5e"))
    export = export_of(saved, "ur-calibration")
    text = FORMATS["ur-calibration"].writes(export)
    assert export.carried.left_out == ()
    base, behind = (of_vector(numbers(row)) for row in re.findall(r"^# \w+ = p\[(.*)\]$", text, re.MULTILINE))
    add = {p.name: float(v) for p, v in zip(saved.model.parameters, saved.estimate, strict=True)}
    for q in postures():
        flange = by_conf(text, q)
        flange[:3, 3] *= 1000.0
        np.testing.assert_allclose(
            np.linalg.inv(base) @ flange @ behind, chain(saved.model.robot, q, add).real, atol=2e-5
        )
    rows = dict(re.findall(r"^(delta_\w+) = \[(.*)\]$", text, re.MULTILINE))
    assert list(rows) == ["delta_theta", "delta_a", "delta_d", "delta_alpha"]
    assert (
        max(abs(v) for v in numbers(rows["delta_d"])) > 1.0
    )  # the common normal of twisted parallel axes is far away


def test_a_nominal_ur_has_no_deltas() -> None:
    saved = model_of("ur5e", scale=0.0)
    text = FORMATS["ur-calibration"].writes(export_of(saved, "ur-calibration"))
    for row in re.findall(r"^delta_\w+ = \[(.*)\]$", text, re.MULTILINE):
        np.testing.assert_allclose(numbers(row), 0.0, atol=1e-15)


def test_a_twist_too_small_to_have_a_common_normal_does_not_break_the_rows() -> None:
    saved = stiffened(model_of("ur5e"))
    for twist in (1e-7, 1e-9, 1e-12):
        estimate = saved.estimate.copy()
        names = saved.model.index
        twists = [names[name] for name in ("alpha2", "alpha3", "beta2", "beta3", "beta4") if name in names]
        estimate[twists] = 0.0
        estimate[names["beta3"]] = twist
        small = replace(saved, estimate=estimate)
        export = export_of(small, "ur-calibration")
        form = FORMATS["ur-calibration"]
        poses = form.reads(form.writes(export), export)
        np.testing.assert_allclose(poses, export.carried.poses, atol=2e-4)


def test_an_arm_of_no_known_type_gets_no_rows() -> None:
    saved = model_of("ur5e")
    longer = replace(saved.model.robot, d=tuple(1.1 * d for d in saved.model.robot.d))
    other = replace(saved, model=replace(saved.model, robot=longer))
    with pytest.raises(DataError, match="no known type"):
        written(*other.for_use(), "m", "ur-calibration", None, None)


# -- ROS --------------------------------------------------------------------------------------------------


def by_urdf(text: str, joints: Array) -> Array:
    """The flanges (n, 4, 4), m, of a URDF that the parser of ROS has read."""
    urdf = URDF.from_xml_string(text.encode())
    names = urdf.get_chain(urdf.get_root(), "flange", links=False)
    reached = np.tile(np.eye(4), (len(joints), 1, 1))
    moved = 0
    for name in names:
        joint = urdf.joint_map[name]
        roll, pitch, yaw = joint.origin.rpy
        origin = turn("z", yaw) @ turn("y", pitch) @ turn("x", roll)
        reached = reached @ at(joint.origin.xyz, origin.real[:3, :3])
        if joint.type == "revolute":
            assert list(joint.axis) == [0, 0, 1]
            reached = reached @ np.stack([turn("z", q).real for q in joints[:, moved]])
            moved += 1
    assert moved == joints.shape[1]
    return reached


@pytest.mark.parametrize("name", ["abb-irb120", "fanuc-lrmate200ic", "kuka-kr6-r900", "ur5e", "yaskawa-gp7"])
def test_the_parser_of_ros_finds_the_flange_within_a_nanometre(name: str) -> None:
    saved = model_of(name)
    export = export_of(saved, "urdf")
    joints = np.random.default_rng(2).uniform(-3.0, 3.0, (100, 6))
    found = by_urdf(FORMATS["urdf"].writes(export), joints)
    ours = poses_with(saved.model.robot, joints, export.carried.values)
    assert np.abs(found[:, :3, 3] - ours[:, :3, 3] / 1000.0).max() < 1e-9
    assert np.abs(found[:, :3, :3] - ours[:, :3, :3]).max() < 1e-9


def test_the_yaml_of_a_ur_makes_the_chain_of_its_description() -> None:
    """`ur_description` makes a joint about z of every entry; its flange is wrist 3."""
    saved = model_of("ur5e")
    export = export_of(saved, "ur-yaml")
    table = yaml.safe_load(FORMATS["ur-yaml"].writes(export))["kinematics"]
    assert table.pop("hash") == HASH
    links, joints = ["base_link", *table], ""
    for parent, (child, entry) in zip(links, table.items(), strict=False):
        xyz, rpy = (
            " ".join(str(entry[key]) for key in keys) for keys in (("x", "y", "z"), ("roll", "pitch", "yaw"))
        )
        joints += (
            f'<joint name="{child}_joint" type="revolute"><parent link="{parent}"/><child link="{child}"/>'
            f'<origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="0 0 1"/>'
            '<limit lower="-6" upper="6" effort="1" velocity="1"/></joint>'
        )
    joints += (
        f'<joint name="f" type="fixed"><parent link="{links[-1]}"/><child link="flange"/>'
        '<origin xyz="0 0 0" rpy="0 0 0"/></joint>'
    )
    parts = "".join(f'<link name="{link}"/>' for link in (*links, "flange"))
    q = np.random.default_rng(2).uniform(-3.0, 3.0, (100, 6))
    found = by_urdf(f'<robot name="ur">{parts}{joints}</robot>', q)
    held = {slot: v for slot, v in export.carried.values.items() if slot not in ("alpha6", "beta6", "a6")}
    ours = poses_with(saved.model.robot, q, held)
    assert np.abs(found[:, :3, 3] - ours[:, :3, 3] / 1000.0).max() < 1e-9


# -- bad input --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", [*FRAMES, *OFFSETS])
def test_a_model_without_a_tool_gives_the_flange(kind: str) -> None:
    text, about = exported(rigid(kind, targets={}), kind)
    maker = kind.partition("-")[0]
    known = READERS[maker](text) if kind in FRAMES else listed_frames(maker, text)
    assert set(known.tools) == {"flange"}
    assert any("no tool target" in line for line in about)


@pytest.mark.parametrize("kind", FRAMES)
def test_readings_that_do_not_place_the_base_give_no_frame_of_them(kind: str) -> None:
    saved = rigid(kind)
    lengths_only = replace(saved, dropped=(DroppedParameter("base.rz", ()),))
    text, about = exported(lengths_only, kind)
    assert set(READERS[kind.partition("-")[0]](text).frames) == {"base"}
    assert any("do not determine where the base is" in line for line in about)
    assert not any("do not determine where the base is" in line for line in exported(saved, kind)[1])


@pytest.mark.parametrize(("known", "frames"), [(False, {"base"}), (True, {"base", "world"})])
def test_distances_alone_place_the_base_only_by_base_targets_that_are_known(
    known: bool, frames: set[str], tmp_path: Path
) -> None:
    cell = Cell(place=POSE)
    cell.measure("l", 180)
    found = identify(cell.dataset(tmp_path, **({} if known else {"base_targets": "free"})))
    assert found.converged
    text, about = exported(as_saved(found), "abb-frames")
    assert set(rapid(text).frames) == frames
    assert any("do not determine where the base is" in line for line in about) is not known
    if known:
        left = np.linalg.inv(POSE @ rapid(text).frames["world"])
        assert np.abs(left - np.eye(4)).max() < 20.0  # the base stands where the base targets say


@pytest.mark.parametrize("kind", FRAMES)
@pytest.mark.parametrize("pitch", [90.0, -90.0, 90.0 - 1e-7, -90.0 + 1e-5])
def test_angles_that_are_not_unique_still_give_the_pose(kind: str, pitch: float) -> None:
    maker = kind.partition("-")[0]
    saved = rigid(kind)
    lying = (turn("z", 0.7) @ turn("y", math.radians(pitch)) @ turn("x", -0.4)).real[:3, :3]
    model = replace(saved.model, turns={"main": lying})
    known = READERS[maker](exported(replace(saved, model=model), kind)[0])
    flange = known.tools["flange"][:3, :3]
    assert np.abs(known.tools["T1"][:3, :3] - flange @ lying).max() < 3e-5


NAMES = [
    "MoveL",
    "movel",
    'a"]};\nSTOP 1',
    "Kügel ä",
    "9",
    "T" * 60,
    "t" * 60,
    ";",
    "\N{GREEK SMALL LETTER ALPHA}",
]


@pytest.mark.parametrize("kind", [*FRAMES, *OFFSETS])
def test_names_that_a_controller_would_refuse_are_replaced(kind: str) -> None:
    targets = {name: (1.0 * k, 2.0, 3.0) for k, name in enumerate(NAMES)}
    text, about = exported(rigid(kind, targets=targets), kind)
    maker = kind.partition("-")[0]
    if kind not in FRAMES:
        assert len(listed_frames(maker, re.sub(r"(?m)^tool .*?:(?= \w+ -?\d)", "tool x:", text)).tools) >= 1
        assert "\nSTOP" not in text
        return
    if maker == "fanuc":
        lines = text.partition("/MN\n")[2].partition("/POS")[0].splitlines()
        assert all(re.fullmatch(r" *\d+:  [^;]* ;", line) for line in lines)
        assert len(re.findall(r"UTOOL\[\d\]=", text)) == 9  # no controller has a place for ten
        assert any("no place for the tools" in line for line in about)
        return
    known = READERS[maker](text)
    assert len(known.tools) == len(NAMES) + 1
    assert len({name.casefold() for name in known.tools}) == len(NAMES) + 1
    assert all(re.fullmatch(r"\w+", name, re.ASCII) for name in known.tools)
    longest = {"abb": 32 - 4, "kuka": 24 - 3, "ur": 32 - 8, "yaskawa": 16 - 3}[maker]
    assert max(map(len, known.tools)) <= longest


@pytest.mark.parametrize("kind", [*FRAMES, *OFFSETS, "ur-calibration"])
def test_a_file_for_another_maker_is_refused(kind: str) -> None:
    for name in ("mecademic-meca500", "kuka-iiwa7-r800"):
        robot = load_robot(name)
        model = replace(rigid(kind).model, robot=robot)
        saved = replace(rigid(kind), model=model)
        with pytest.raises(DataError, match="This format is for"):
            FORMATS[kind].suits(saved.model.robot)


def test_a_quaternion_of_another_length_is_refused() -> None:
    saved = rigid("abb-frames")
    export = export_of(saved, "abb-frames")
    form = FORMATS["abb-frames"]
    text = re.sub(r"(tTP_flange:=\[TRUE,\[\[.*?\],\[)0\.", r"\g<1>1.", form.writes(export))
    with pytest.raises(ValueError, match="norm"):
        form.reads(text, export)


def test_what_the_file_is_not_is_in_the_file() -> None:
    for kind in (*FRAMES, *OFFSETS, "ur-calibration"):
        saved = rigid(kind, placed=False) if kind != "ur-calibration" else model_of("ur5e")
        text, about = exported(saved, kind)
        assert any("Not tried on a real controller" in line for line in about)
        bare = re.sub(r"\s+", " ", re.sub(r"(?m)^(?:\s*\d+:)?\s*[!;#'] ?| ;$", " ", text))
        assert "Not tried on a real controller" in bare
