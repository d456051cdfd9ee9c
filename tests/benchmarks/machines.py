"""Machines that are no six turning joints: identified to the floor, and what they lack named.

A SCARA, a palletizer whose rods couple its joints, an arm of seven joints, six joints on a tilted track and a
positioner of two axes, simulated by matrices that share no line with the chain under test (`tests/calib/chain.py`). Of
each every DH number is off, gears yield to gravity, and one thing is wrong that no base model has. The error on
held-out readings after the diagnosis is compared with the noise alone.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calib.arm.kinematics import gravity_torques
from calib.arm.robot import Robot
from calib.array import Array
from calib.data import Dataset, read_dataset
from calib.diagnose import diagnose
from calib.fit.held_out import errors_on
from calib.units import DEG
from tests.calib.chain import chain
from tests.calib.machines import machine

NOISE_MM = 0.03
WITHIN = 1.05
TARGETS = {"T1": (60.0, 10.0, 80.0), "T2": (-50.0, 40.0, 60.0), "T3": (-10.0, -70.0, 110.0)}

Wrong = Callable[[Robot, Array, Array], dict[str, Array]]
"""What is wrong: robot, joints (n, N), sides of approach (n, N) -> slot -> (n,), rad or mm."""


@dataclass(frozen=True)
class Case:
    """A machine, what is wrong with it, and the labels by which that counts as named."""

    machine: str
    title: str
    wrong: Wrong
    named: tuple[str, ...]
    coupling: str = "none"


def _play(link: int, gap: float) -> Wrong:
    return lambda robot, joints, side: {robot.joint_slots[link - 1]: 0.5 * gap * side[:, link - 1]}


def _scale(link: int, ppm: float) -> Wrong:
    return lambda robot, joints, side: {robot.joint_slots[link - 1]: 1e-6 * ppm * joints[:, link - 1]}


def _wave(link: int, order: int, amplitude: float) -> Wrong:
    return lambda robot, joints, side: {f"theta{link}": amplitude * np.cos(order * joints[:, link - 1] + 0.7)}


def _crooked(link: int, size: float) -> Wrong:
    """A rail that sags between its ends and leans aside where two pieces of it meet: no sum of half waves."""

    def wrong(robot: Robot, joints: Array, side: Array) -> dict[str, Array]:
        low, high = robot.lower[link - 1], robot.upper[link - 1]
        along = (joints[:, link - 1] - low) / (high - low)
        return {
            f"bearing{link}.x": size * 4.0 * along * (1.0 - along),
            f"bearing{link}.y": 0.6 * size * np.minimum(along / 0.4, (1.0 - along) / 0.6),
        }

    return wrong


CASES = (
    Case("scara", "play of joint 2, 0.03 deg", _play(2, 0.03 * DEG), ("backlash:j2", "lost_motion:j2")),
    Case("scara", "scale of the quill, 1500 ppm", _scale(3, 1500.0), ("slide_scale:j3",)),
    Case("scara-dh", "play of the quill, 0.2 mm", _play(3, 0.2), ("slide_backlash:j3",)),
    Case(
        "palletizer",
        "play of joint 2, 0.02 deg",
        _play(2, 0.02 * DEG),
        ("backlash:j2", "lost_motion:j2"),
        "rods",
    ),
    Case("seven", "gear of joint 3, twice a turn, 0.02 deg", _wave(3, 2, 0.02 * DEG), ("periodic:j3:n2",)),
    Case("track", "crooked rail, 0.6 mm", _crooked(1, 0.6), ("slide_straightness:e1",)),
    Case("track", "scale of the track, 200 ppm", _scale(1, 200.0), ("slide_scale:e1",)),
    Case("positioner", "play of axis 1, 0.05 deg", _play(1, 0.05 * DEG), ("backlash:e1", "lost_motion:e1")),
)


def simulated(
    case: Case, seed: int, folder: Path, calibration: int, validation: int
) -> tuple[Dataset, Array]:
    """A campaign on a machine with errors of its own, as its files hold it, and which joints it has, (n, N)."""
    rng = np.random.default_rng([seed, sum(case.title.encode())])
    robot = machine(case.machine, folder)
    n = calibration + validation
    shown = rng.uniform(robot.lower, robot.upper, (n, robot.joints)) * 0.95
    if case.coupling == "rods":
        shown[:, 3] = 0.0
    shown = np.round(shown / robot.joint_units, 5) * robot.joint_units
    joints = robot.model_angles(shown, case.coupling)
    before = np.vstack([joints[:1], joints[:-1]])
    side = np.where(joints >= before, 1.0, -1.0)
    off: dict[str, Array | float] = {}
    for k in range(1, robot.joints + 1):
        for kind, size in (("alpha", 0.05 * DEG), ("a", 0.4), ("theta", 0.1 * DEG), ("d", 0.4)):
            off[f"{kind}{k}"] = rng.normal(0.0, size)
    off |= {f"beta{k}": rng.normal(0.0, 0.05 * DEG) for k in robot.parallel_axes}
    off |= {f"base.{axis}": rng.uniform(-1000.0, 1000.0) for axis in "xyz"}
    off |= {f"base.r{axis}": rng.uniform(-0.1, 0.1) for axis in "xyz"}
    torque = gravity_torques(robot, joints)
    extra = case.wrong(robot, joints, side)
    for k in range(2, robot.joints + 1):
        if k not in robot.slides:
            extra[f"theta{k}"] = extra.get(f"theta{k}", 0.0) + rng.uniform(0.2, 1.0) * 1e-9 * torque[:, k - 1]
    names = rng.choice(list(TARGETS), n)
    points = np.array([
        chain(robot, joints[i], {slot: off.get(slot, 0.0) + (extra[slot][i] if slot in extra else 0.0)
                                 for slot in {*off, *extra}}, TARGETS[names[i]])[:3, 3].real
        for i in range(n)
    ])  # fmt: skip
    points += rng.normal(0.0, NOISE_MM, points.shape)
    columns = [*robot.joint_columns, "tool_target", "x_mm", "y_mm", "z_mm", "t_s", "set"]
    rows = [
        [*(f"{q:.5f}" for q in shown[i] / robot.joint_units), names[i], *(f"{x:.5f}" for x in points[i]), f"{20 * i}",
         "calibration" if i < calibration else "validation"]
        for i in range(n)
    ]  # fmt: skip
    path = folder / f"{case.machine}-{seed}.csv"
    path.write_text("\n".join(",".join(row) for row in [columns, *rows]) + "\n", encoding="utf-8")
    targets = "".join(f"{name} = {list(place)}\n" for name, place in TARGETS.items())
    path.with_suffix(".toml").write_text(
        f'format = "truepose-dataset/1"\nrobot = "{case.machine}.toml"\nsimulated = true\n'
        f'joint_coupling = "{case.coupling}"\nbeyond_limits = true\n'
        f'[model]\nlevel = 3\n[noise]\nkind = "isotropic"\nsigma_mm = {NOISE_MM}\n[tool_targets]\n{targets}',
        encoding="utf-8",
    )
    return read_dataset(path), joints


@dataclass(frozen=True)
class Outcome:
    """What a diagnosis found of a case: labels, error over floor before and after, seconds."""

    labels: tuple[str, ...]
    base: float
    final: float
    seconds: float

    def names(self, case: Case) -> bool:
        """Whether what is wrong was named."""
        return any(label in case.named for label in self.labels)


def outcome_of(dataset: Dataset) -> Outcome:
    """The diagnosis of a data set, judged by its held-out readings."""
    result = diagnose(dataset)
    rows = dataset.validation_rows
    floor = NOISE_MM * np.sqrt(3.0)
    base, final = (
        float(np.sqrt(np.mean(errors_on(dataset, rows, each.model, each.estimate) ** 2)) / floor)
        for each in (result.base, result.final)
    )
    return Outcome(tuple(found.effect.label for found in result.effects), base, final, result.seconds)


def run(count: int = 3) -> bool:
    """Every case with `count` seeds; True where all reach the floor and are named."""
    reached = True
    print(
        "machine, what is wrong: error on held-out readings over the floor, base model -> with what was found"
    )
    with tempfile.TemporaryDirectory() as folder:
        for case in CASES:
            for seed in range(count):
                found = outcome_of(simulated(case, seed, Path(folder), 400, 600)[0])
                good = found.final <= WITHIN and found.names(case)
                reached &= good
                print(
                    f"{case.machine:11s} {case.title:40s} {found.base:6.3f} -> {found.final:5.3f} "
                    f"{', '.join(found.labels) or 'nothing'} ({found.seconds:.1f} s){'' if good else '  MISSED'}",
                    flush=True,
                )
    return reached
