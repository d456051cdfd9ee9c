"""Benchmark of machines other than six turning joints: identify, diagnose, correct.

The machines are a SCARA, a palletizer whose rods couple its joints, an arm of seven joints, six joints on a tilted
track and a positioner of two axes. `tests/calib/true_machine.py` simulates them. `truepose.diagnose` identifies
each from a campaign with one error that no base model contains. `truepose.compensate` corrects new targets with
that model, and the simulated machine drives them. The floor is the noise of one reading alone.
"""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

import truepose
from calib import Dataset, Robot, read_dataset
from calib.arm.kinematics import LEVER_MM, joint_scale
from calib.array import Array
from calib.units import DEG
from tests.calib.chain import chain, six
from tests.calib.machines import machine
from tests.calib.true_machine import TARGETS, TrueMachine, Wrong

NOISE_MM = 0.03
FLOOR_MM = NOISE_MM * np.sqrt(3.0)
WITHIN, DRIVEN_WITHIN = 1.05, 1.2
TARGETS_DRIVEN = 100
ENOUGH = 0.85
"""Of random targets: some ten of a hundred lie within 3 deg of a straight wrist or 9 of a straight elbow, and are
refused."""


@dataclass(frozen=True)
class Case:
    """Machine, its error, and the labels that count as naming the error.

    `sides` states from which side each joint of the controller comes to driven targets; from below if it is empty.
    """

    machine: str
    title: str
    wrong: Wrong
    named: tuple[str, ...]
    coupling: str = "none"
    sides: tuple[int, ...] = ()


def _play(link: int, gap: float) -> Wrong:
    return lambda robot, joints, side: {robot.joint_slots[link - 1]: 0.5 * gap * side[:, link - 1]}


def _scale(link: int, ppm: float) -> Wrong:
    return lambda robot, joints, side: {robot.joint_slots[link - 1]: 1e-6 * ppm * joints[:, link - 1]}


def _wave(link: int, order: int, amplitude: float) -> Wrong:
    return lambda robot, joints, side: {f"theta{link}": amplitude * np.cos(order * joints[:, link - 1] + 0.7)}


def _crooked(link: int, size: float) -> Wrong:
    """Return a rail error that is no sum of half waves.

    The rail sags between its ends and leans to the side at the joint of its two pieces.
    """

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
        sides=(1, 1, -1, 1, 1),
    ),
    Case("seven", "gear of joint 3, twice a turn, 0.02 deg", _wave(3, 2, 0.02 * DEG), ("periodic:j3:n2",)),
    Case("track", "crooked rail, 0.6 mm", _crooked(1, 0.6), ("slide_straightness:e1",)),
    Case("track", "scale of the track, 200 ppm", _scale(1, 200.0), ("slide_scale:e1",)),
    Case("positioner", "play of axis 1, 0.05 deg", _play(1, 0.05 * DEG), ("backlash:e1", "lost_motion:e1")),
)


@dataclass(frozen=True)
class Simulated:
    """A campaign as its files hold it, and the machine that it was measured on."""

    dataset: Dataset
    truth: TrueMachine


def simulated(case: Case, seed: int, folder: Path, calibration: int, validation: int) -> Simulated:
    """Simulate a campaign on a machine with random geometric errors."""
    rng = np.random.default_rng([seed, sum(case.title.encode())])
    robot = machine(case.machine, folder)
    n = calibration + validation
    shown = rng.uniform(robot.lower, robot.upper, (n, robot.joints)) * 0.95
    if case.coupling == "rods":
        shown[:, 3] = 0.0
    shown = np.round(shown / robot.joint_units, 5)
    joints = robot.model_angles(shown * robot.joint_units, case.coupling)
    before = np.vstack([joints[:1], joints[:-1]])
    side = np.where(joints >= before, 1.0, -1.0)
    truth = TrueMachine.drawn(robot, case.wrong, rng)
    names = rng.choice(list(TARGETS), n)
    points = truth.poses(joints, side, names.tolist())[:, :3, 3]
    points += rng.normal(0.0, NOISE_MM, points.shape)
    columns = [*robot.joint_columns, "tool_target", "x_mm", "y_mm", "z_mm", "t_s", "set"]
    rows = [
        [*(f"{q:.5f}" for q in shown[i]), names[i], *(f"{x:.5f}" for x in points[i]), f"{20 * i}",
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
    return Simulated(read_dataset(path), truth)


@dataclass(frozen=True)
class Driven:
    """Results for new targets of T1, driven as they are and corrected.

    `plain` and `corrected` are RMS misses, mm. `good` of `asked` targets were corrected. `left_deg` is the largest
    rotation that was left because the arm cannot make it.
    """

    plain: float
    corrected: float
    good: int
    asked: int
    left_deg: float


def driven(case: Case, made: Simulated, model: truepose.Model, seed: int, count: int) -> Driven:
    """Drive `count` new targets on the true machine, plain and corrected.

    `truepose.compensate` corrects them, and the true machine is read with noise. The goal is the pose of T1 of the
    nominal robot in the identified base. A positioner cannot reach an arbitrary point; its goal is the best pose of
    the true machine, found by a search.
    """
    rng = np.random.default_rng([seed, 1 + sum(case.title.encode())])
    truth = made.truth
    robot, coupling = truth.robot, case.coupling
    low, high = np.array(robot.lower), np.array(robot.upper)
    room = 0.025 * (high - low)  # for corrections: a target at its limit is refused
    shown = rng.uniform(low + room, high - room, (count, robot.joints)) / robot.joint_units
    if coupling == "rods":
        shown[:, 3] = 0.0
    sides = np.array(case.sides if case.sides else (1,) * robot.joints)
    done = truepose.compensate(model, joints_deg=shown, target="T1", side=tuple(sides.tolist()))
    good = done.good
    taught, sent = (
        robot.model_angles(np.round(each[good], 5) * robot.joint_units, coupling)
        for each in (shown, done.joints_deg)
    )
    arrives = robot.model_angles(np.array([sides, 0 * sides], dtype=float), coupling)
    side, names = np.tile(np.sign(arrives[0] - arrives[1]), (len(sent), 1)), ["T1"] * len(sent)
    wanted = base_of(model) @ np.array([chain(robot, q, {}, TARGETS["T1"]).real for q in taught])
    if case.machine == "positioner":
        wanted = best_of(truth, sent, side, wanted)
    noise = rng.normal(0.0, NOISE_MM, (len(sent), 3))

    def rms(joints: Array) -> float:
        apart = (truth.poses(joints, side, names) - wanted)[:, :3, 3] + noise
        return float(np.sqrt(np.mean(np.sum(apart**2, axis=1))))

    left = float(np.degrees(np.max(done.found.left.askew[good])))
    return Driven(rms(taught), rms(sent), len(sent), count, left)


def base_of(model: truepose.Model) -> Array:
    """Return the identified base in the frame of the readings, (4, 4), mm."""
    saved = model.saved
    found = {name: float(saved.estimate[i]) for name, i in saved.model.index.items()}
    (place,) = saved.model.placements.values()
    return place @ six(found, "base").real


def best_of(truth: TrueMachine, joints: Array, side: Array, wanted: Array) -> Array:
    """Find the poses of T1, (n, 4, 4), nearest to the goals that the true machine can take.

    1 rad counts as `LEVER_MM`.
    """
    unit = joint_scale(truth.robot)

    def pose(i: int, moved: Array) -> Array:
        return truth.poses(joints[i : i + 1] + moved * unit, side[i : i + 1], ["T1"])[0]

    def off(moved: Array, i: int) -> Array:
        there = pose(i, moved)
        turn = Rotation.from_matrix(there[:3, :3] @ wanted[i, :3, :3].T).as_rotvec()
        return np.concatenate([there[:3, 3] - wanted[i, :3, 3], LEVER_MM * turn])

    found = [least_squares(off, np.zeros(truth.robot.joints), args=(i,)).x for i in range(len(joints))]
    return np.array([pose(i, moved) for i, moved in enumerate(found)])


@dataclass(frozen=True)
class Outcome:
    """Result of the diagnosis of a case.

    `nominal` is the RMS error of the nominal robot in its place, mm. `base` and `final` are the errors of the base
    model and of the final model on held-out readings, relative to the floor. `driven` holds the results with the
    final model.
    """

    labels: tuple[str, ...]
    nominal: float
    base: float
    final: float
    driven: Driven
    seconds: float

    def names(self, case: Case) -> bool:
        """Return whether the error of the case was named."""
        return any(label in case.named for label in self.labels)

    def reaches(self, case: Case) -> bool:
        """Return whether every criterion is met."""
        enough = self.driven.good >= ENOUGH * self.driven.asked
        return (
            enough
            and self.names(case)
            and self.final <= WITHIN
            and self.driven.corrected <= DRIVEN_WITHIN * FLOOR_MM
        )


def outcome_of(case: Case, made: Simulated, seed: int, count: int) -> Outcome:
    """Diagnose a campaign and judge it by held-out readings and by driving `count` targets."""
    found = truepose.diagnose(made.dataset.path)
    rms = found.errors["rms"].tolist()
    return Outcome(
        tuple(each.effect.label for each in found.findings.effects),
        rms[0],
        rms[1] / FLOOR_MM,
        rms[-1] / FLOOR_MM,
        driven(case, made, found.model, seed, count),
        found.findings.seconds,
    )


def run(count: int = 3) -> bool:
    """Run every case with `count` seeds; return whether all criteria are met.

    Each case must reach the floor, name the error, and correct the targets.
    """
    reached = True
    print(
        f"machine, what is wrong: nominal in its place, mm | held out over the floor of {FLOOR_MM:.3f} mm, base model "
        f"-> with what was found, <= {WITHIN} | {TARGETS_DRIVEN} new targets driven as they are, mm -> corrected, over "
        f"the floor, <= {DRIVEN_WITHIN}"
    )
    with tempfile.TemporaryDirectory() as folder:
        for case in CASES:
            for seed in range(count):
                found = outcome_of(case, simulated(case, seed, Path(folder), 400, 600), seed, TARGETS_DRIVEN)
                good, sent = found.reaches(case), found.driven
                reached &= good
                print(
                    f"{case.machine:10s} {case.title:39s} {found.nominal:6.3f} | {found.base:6.3f} -> "
                    f"{found.final:5.3f} {', '.join(found.labels) or 'nothing'} | {sent.plain:6.3f} -> "
                    f"{sent.corrected / FLOOR_MM:5.3f}, {sent.good} of {sent.asked}, left {sent.left_deg:.3f} deg "
                    f"({found.seconds:.1f} s){'' if good else '  MISSED'}",
                    flush=True,
                )
    return reached
