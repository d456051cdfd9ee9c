"""Test the chain and the torques.

These would catch: a wrong sign, order or convention of any elementary motion, the thesis's d_1 on the wrong side of
the base rotations, and a unit of the compliances. They would also catch a torque about the wrong axis or of the
wrong sign, a twist that is not the derivative of its slot, and rows of a batch that influence each other.
"""

from __future__ import annotations

import json
import math
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from calib import Robot, forward, load_robot
from calib.arm import BasePoses, Chain, gravity_torques, nominal_values, propagate
from calib.array import Array
from calib.data import Conditions
from calib.model import BoundModel, ModelStructure, base_model
from tests.calib.campaigns import conditions_of
from tests.calib.chain import chain

VECTORS = Path(__file__).parent.parent / "vectors"
THESIS = json.loads((VECTORS / "fk_thesis.json").read_text(encoding="utf-8"))
UR5 = json.loads((VECTORS / "fk_ur5.json").read_text(encoding="utf-8"))
NAMES = {"IRB120": "abb-irb120", "LRMATE200iC": "fanuc-lrmate200ic"}
ROBOTS = (
    "abb-irb120",
    "fanuc-lrmate200ic",
    "ur10",
    "ur5",
)  # with loads; the other tables differ in numbers alone

# The thesis's names of its 31 parameters, as the parameters of our model are called.
BASE = dict(zip(("xb", "yb", "zb", "ab", "bb", "gb"), ("x", "y", "z", "rx", "ry", "rz"), strict=True))
KINDS = {"dal": "alpha", "da": "a", "dth": "theta", "dd": "d"}


def our_name(thesis: str) -> str:
    """'dth4' -> 'theta4', 'xb' -> 'base.x', 'c2' -> 'c2'."""
    if thesis in BASE:
        return f"base.{BASE[thesis]}"
    kind, link = thesis[:-1], thesis[-1]
    return thesis if kind == "c" else f"{KINDS[kind]}{link}"


def random_joints(robot: Robot, n: int, seed: int) -> Array:
    rng = np.random.default_rng(seed)
    return rng.uniform(np.maximum(robot.lower, -np.pi), np.minimum(robot.upper, np.pi), (n, robot.joints))


def single_series(conditions: Conditions, targets: int) -> dict[str, Any]:
    n = len(conditions)
    return {
        "series": np.zeros(n, dtype=np.int64),
        "target": np.arange(n) % targets,
        "series_names": ("main",),
        "target_names": tuple(f"T{i + 1}" for i in range(targets)),
    }


@pytest.mark.parametrize("case", sorted({v["case"] for v in THESIS["vectors"]}))
def test_thesis_vectors(case: str) -> None:
    vectors = [v for v in THESIS["vectors"] if v["case"] == case]
    assert len(vectors) == 20
    tolerance = THESIS["tol"]
    for v in vectors:
        robot = load_robot(NAMES[v["robot"]])
        assert robot.base == "thesis"
        joints = np.radians([v["q_deg"]] * 4)
        torque = gravity_torques(robot, joints)
        np.testing.assert_allclose(torque[0], v["tau_Nmm"], rtol=0.0, atol=tolerance["tau_Nmm"])
        points = [[0.0, 0.0, 0.0], *v["tool_points_flange_mm"]]
        targets = {f"T{i + 1}": tuple(p) for i, p in enumerate(points)}
        drawn = conditions_of(robot, joints)
        conditions = Conditions(**{**vars(drawn), **single_series(drawn, 4)})
        effects = base_model.build(
            ("base", "geometry", "compliance"), robot, ("main",), (dict.fromkeys(targets, False),)
        )
        model = ModelStructure(robot, effects, {"main": targets})  # pyright: ignore[reportArgumentType]
        assert len(model.parameters) == 31
        estimate = np.zeros(31)
        given = v.get("p31", [0.0] * 31)
        for name, value in zip(THESIS["param_names"], given, strict=True):
            estimate[model.index[our_name(name)]] = value
        design = BoundModel(model, conditions)
        predicted, rotation = design.predict(estimate), design.frames(estimate).rotation
        expected = np.array(v["T_world_flange"])
        np.testing.assert_allclose(predicted[0], expected[:3, 3], rtol=0.0, atol=tolerance["pos_mm"])
        np.testing.assert_allclose(rotation[0], expected[:3, :3], rtol=0.0, atol=tolerance["rot"])
        np.testing.assert_allclose(
            predicted[1:], v["tool_points_world_mm"], rtol=0.0, atol=tolerance["pos_mm"]
        )
        if "p31" not in v:
            pose = forward(robot, joints[:1])[0]
            np.testing.assert_allclose(pose[:3, 3], expected[:3, 3], rtol=0.0, atol=tolerance["pos_mm"])


def test_the_vectors_hold_calibrated_robots() -> None:
    calibrated = [v for v in THESIS["vectors"] if "p31" in v]
    assert len(calibrated) >= 40
    assert all(np.abs(v["p31"]).max() > 0.0 for v in calibrated)
    assert all(any(v["p31"][26:]) for v in calibrated), "without compliances their unit is not tested"


def test_ur5_vectors() -> None:
    robot = load_robot("ur5")
    assert robot.d[5] == 82.3
    assert len(UR5["vectors"]) == 20
    poses = forward(robot, np.radians([v["q_deg"] for v in UR5["vectors"]]))
    for pose, v in zip(poses, UR5["vectors"], strict=True):
        expected = np.array(v["T"])
        point = pose[:3, 3] + 169.5 * pose[:3, 2]  # the vectors end at the reflector, in metres
        np.testing.assert_allclose(pose[:3, :3], expected[:3, :3], rtol=0.0, atol=UR5["tol"])
        np.testing.assert_allclose(point / 1000.0, expected[:3, 3], rtol=0.0, atol=UR5["tol"])


@pytest.mark.parametrize("name", ROBOTS)
def test_torque_is_the_slope_of_the_potential_energy(name: str) -> None:
    robot = load_robot(name)
    gravity = (0.4, -1.3, -9.6)  # a tilted robot: every joint is loaded, joint 1 too
    joints = random_joints(robot, 8, 3)

    def energy(q: Array) -> float:
        total = 0.0
        for load in robot.loads:
            short = [*q[: load.link], *[0.0] * (robot.joints - load.link)]
            frame = np.eye(4)
            for k in range(load.link):
                frame = frame @ link_frame(robot, k, short[k])
            total -= load.mass_kg * float(np.dot(gravity, (frame @ [*load.cog_mm, 1.0])[:3]))
        return total

    torque = gravity_torques(robot, joints, gravity=gravity)
    assert np.abs(torque).min(axis=0).max() > 1.0
    for q, tau in zip(joints, torque, strict=True):
        for k in range(robot.joints):
            step = np.zeros(robot.joints)
            step[k] = 1e-5
            slope = -(energy(q + step) - energy(q - step)) / 2e-5
            assert tau[k] == pytest.approx(slope, abs=1e-5 * np.abs(torque).max())


def link_frame(robot: Robot, k: int, angle: float) -> Array:
    ca, sa = math.cos(robot.alpha[k]), math.sin(robot.alpha[k])
    ct, st_ = math.cos(robot.theta[k] + angle), math.sin(robot.theta[k] + angle)
    about_x = np.array([[1, 0, 0, robot.a[k]], [0, ca, -sa, 0], [0, sa, ca, 0], [0, 0, 0, 1.0]])
    about_z = np.array([[ct, -st_, 0, 0], [st_, ct, 0, 0], [0, 0, 1, robot.d[k]], [0, 0, 0, 1.0]])
    return about_x @ about_z if robot.convention == "mdh" else about_z @ about_x


@pytest.mark.parametrize("name", ROBOTS)
@given(seed=st.integers(0, 2**31), n=st.integers(2, 12))
@settings(max_examples=10)
def test_a_batch_is_its_rows_one_by_one(name: str, seed: int, n: int) -> None:
    robot = load_robot(name)
    joints = random_joints(robot, n, seed)
    together, torque = forward(robot, joints), gravity_torques(robot, joints)
    assert together.shape == (n, 4, 4)
    for i in range(n):
        np.testing.assert_allclose(forward(robot, joints[i : i + 1])[0], together[i], rtol=0.0, atol=1e-10)
        np.testing.assert_allclose(
            gravity_torques(robot, joints[i : i + 1])[0], torque[i], rtol=1e-12, atol=1e-8
        )


@pytest.mark.parametrize("name", ROBOTS)
@given(seed=st.integers(0, 2**31))
@settings(max_examples=8)
def test_the_chain_agrees_with_matrices(name: str, seed: int) -> None:
    robot = load_robot(name)
    rng = np.random.default_rng(seed)
    joints = random_joints(robot, 3, seed)
    slots = Chain.of(robot).slots
    station = rng.uniform(-1000.0, 1000.0, 3)
    add = {slot: float(rng.uniform(-0.3, 0.3) * (1.0 if m.turns else 10.0)) for slot, m in slots.items()}
    nominal = nominal_values(robot, joints)
    frames = propagate(
        Chain.of(robot), {s: nominal.get(s, 0.0) + v for s, v in add.items()}, BasePoses(), station
    )
    for i, q in enumerate(joints):
        expected = chain(robot, q, add, station=station).real
        np.testing.assert_allclose(frames.p[:, i], expected[:3, 3], rtol=0.0, atol=1e-9)
        np.testing.assert_allclose(frames.rotation[i], expected[:3, :3], rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("name", ROBOTS)
def test_every_twist_is_the_derivative_of_its_slot(name: str) -> None:
    robot = load_robot(name)
    joints = random_joints(robot, 4, 11)
    rng = np.random.default_rng(5)
    slots = Chain.of(robot).slots
    assert len(slots) == 6 + 6 + 7 * robot.joints + 6 + 6
    station = np.array([2400.0, -900.0, 350.0])
    add = {slot: float(rng.uniform(-0.2, 0.2) * (1.0 if m.turns else 10.0)) for slot, m in slots.items()}
    nominal = nominal_values(robot, joints)
    frames = propagate(
        Chain.of(robot), {s: nominal.get(s, 0.0) + v for s, v in add.items()}, BasePoses(), station
    )
    h = 1e-30
    for slot in slots:
        linear, angular = (np.broadcast_to(v, (3, 4)) for v in frames.twist(slot))
        for i, q in enumerate(joints):
            there = chain(robot, q, {**add, slot: add[slot] + 1j * h}, station=station)
            velocity = there[:3, 3].imag / h
            spin = (there[:3, :3].imag / h) @ there[:3, :3].real.T
            np.testing.assert_allclose(linear[:, i], velocity, rtol=0.0, atol=1e-8, err_msg=slot)
            turning = [spin[2, 1], spin[0, 2], spin[1, 0]]
            np.testing.assert_allclose(angular[:, i], turning, rtol=0.0, atol=1e-11, err_msg=slot)


def test_d1_of_the_thesis_stands_before_the_base_rotations() -> None:
    robot = load_robot("abb-irb120")
    lean = {**nominal_values(robot, np.zeros((1, 6))), "base.rx": 0.1}
    frames = propagate(Chain.of(robot), lean, BasePoses())
    foot = frames.link_frames[0][3][:, 0]
    np.testing.assert_allclose(foot, [0.0, 0.0, 290.0], atol=1e-12)


def test_batches_are_much_faster_than_loops() -> None:
    robot = load_robot("abb-irb120")
    joints = random_joints(robot, 10_000, 1)

    def cost(rows: Array) -> float:
        begin = time.process_time()
        forward(robot, rows)
        return time.process_time() - begin

    forward(robot, joints)
    together = min(cost(joints) for _ in range(3))
    some = joints[:200]
    begin = time.process_time()
    for i in range(len(some)):
        forward(robot, some[i : i + 1])
    loop = (time.process_time() - begin) * len(joints) / len(some)
    assert loop > 30.0 * together
