"""Campaigns on arms that the library may not contain, as data sets read from files."""

from __future__ import annotations

import csv
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from calib.data import Dataset, read_dataset
from tests.benchmarks.strangers.arms import Arm, Array, screw
from tests.benchmarks.strangers.scene import Act, Moved, Scene

TARGETS = {"A": (45.0, 20.0, 90.0), "B": (-60.0, 35.0, 70.0), "C": (10.0, -75.0, 120.0)}
RANGE, ACROSS, PPM = 0.010, 0.016, 3.0  # mm, mm, per distance
REPEATS = 0.0006  # deg of every joint that turns, and 0.004 mm of one that slides
SLIDE_REPEATS = 0.004
SMALL_RAD, SMALL_MM = 1e-4, 0.1  # of what a law moves by 1


@dataclass(frozen=True)
class Plan:
    """Readings of a campaign.

    Poses are visited `each` times, with `at_once` targets per visit. `scatter` multiplies the usual repeatability.
    """

    calibration: int
    validation: int
    each: int = 1
    at_once: int = 1
    scatter: float = 1.0


class Made(NamedTuple):
    """Data set, and the displacement of its readings by the law alone, (n, 3), mm."""

    data: Dataset
    displaced: Array


@dataclass(frozen=True)
class TrueArm:
    """Arm with random errors on a random base.

    `base` is (4, 4), `softness` (N,) in rad/(N.mm).
    """

    arm: Arm
    base: Array
    softness: Array

    @classmethod
    def drawn(cls, arm: Arm, rng: np.random.Generator) -> TrueArm:
        """Draw an arm with usual errors: fractions of a millimetre and of 0.1 deg everywhere."""
        size = np.array([6e-4, 0.3, 1.2e-3, 0.3]) * min(1.0, arm.reach / 1000.0)
        lean = np.where([k + 1 in arm.twisted for k in range(arm.joints)], 5e-4, 0.0)
        wrong = rng.normal(size=(arm.joints, 4)) * size
        base = screw(2, rng.uniform(-3.0, 3.0), 0.0) @ screw(0, rng.normal(0.0, 0.01), 0.0)
        base[:3, 3] = rng.uniform(-300.0, 300.0, 3)
        low, high = arm.table[:, 4], arm.table[:, 5]
        heaviest = np.max(np.abs(arm.torques(rng.uniform(low, high, (200, arm.joints)))))
        soft = rng.uniform(1e-4, 4e-4, arm.joints) * np.arange(arm.joints) / max(float(heaviest), 1.0)
        return cls(arm.off(wrong, lean * rng.normal(size=arm.joints)), base, soft)

    def points(self, s: Scene, moved: Moved, size: float) -> Array:
        """Compute target positions in the instrument's frame, (n, 3), mm.

        A law has displaced joints, tool, base or point by `size`.
        """
        nominal = s.arm
        joints = s.joints + self.softness * nominal.torques(s.joints)
        for number, by in moved.joints.items():
            joints[:, number - 1] += size * by * (SMALL_MM if number in nominal.slides else SMALL_RAD)
        flange = self.arm.frames(joints)[-1]
        place = s.targets[s.target]
        if moved.tool is not None:
            place = place + size * SMALL_MM * moved.tool
        points = flange[:, :3, 3] + np.einsum("nij,nj->ni", flange[:, :3, :3], place)
        if moved.lean is not None:
            points = points + np.cross(size * SMALL_RAD * moved.lean, points)
        if moved.point is not None:
            points = points + size * SMALL_MM * moved.point
        return points @ self.base[:3, :3].T + self.base[:3, 3]


def ways(
    arm: Arm, plan: Plan, rng: np.random.Generator
) -> tuple[Array, NDArray[np.int64], NDArray[np.bool_]]:
    """Draw the visits of a campaign, in order of time.

    Return joints (v, N), pose numbers (v,), and which visits are held out.
    """
    per_pose = plan.each * plan.at_once
    counts = [-(-plan.calibration // per_pose), -(-plan.validation // per_pose)]
    low, high = arm.table[:, 4], arm.table[:, 5]
    room = 0.06 * (high - low)
    poses = rng.uniform(low + room, high - room, (sum(counts), arm.joints))
    held = np.arange(sum(counts)) >= counts[0]
    stops = rng.permutation(np.repeat(np.arange(sum(counts)), plan.each))
    return poses[stops], stops, held[stops]


def made(arm: Arm, act: Act | None, size: float | None, plan: Plan, seed: int) -> Made:
    """Simulate a campaign on an arm on which a law acts.

    `size` is the RMS displacement of the readings relative to their noise. With None, the law itself states its
    size.

    Raises
    ------
    ValueError
        The law moves nothing.
    """
    rng = np.random.default_rng([seed, sum(map(ord, arm.name)), plan.calibration])
    true = TrueArm.drawn(arm, rng)
    stops, pose, held = ways(arm, plan, rng)
    stops = np.round(stops / arm.unit, 4) * arm.unit
    visit = np.repeat(np.arange(len(stops)), plan.at_once)
    offset = seed % 2 == 1  # every joint comes from 4 to 12 deg away, else straight from the last pose
    way = rng.choice([-1.0, 1.0], stops.shape) * rng.uniform(0.02, 0.06, (len(stops), 1))
    start = np.round((stops - way * (arm.table[:, 5] - arm.table[:, 4]) / 2.0) / arm.unit, 4) * arm.unit
    past = np.vstack([stops[-1:], stops[:-1]])
    before = start if offset else past
    time = np.cumsum(15.0 + rng.gamma(1.0, 12.0, len(stops)) + 40.0 * (rng.random(len(stops)) < 0.06))
    air = (
        21.0
        + 1.2 * np.sin(time / 3000.0 + rng.uniform(0.0, 6.0))
        + 0.02 * np.cumsum(rng.normal(size=len(stops)))
    )
    target = (pose[visit] + rng.integers(3) + np.tile(np.arange(plan.at_once), len(stops))) % 3
    station = np.array([1.9, -0.7, 0.6]) * max(arm.reach, 1200.0)
    scene = Scene(
        arm=arm,
        joints=stops[visit],
        before=before[visit],
        time=np.round(time[visit] + 4.0 * np.tile(np.arange(plan.at_once), len(stops)), 2),
        air=np.round(air[visit], 2),
        target=target,
        targets=np.array(list(TARGETS.values())),
        station=station,
        rng=np.random.default_rng([seed, 3]),
    )
    scatter = (
        np.where([k + 1 in arm.slides for k in range(arm.joints)], SLIDE_REPEATS, REPEATS) * plan.scatter
    )
    still = replace(scene, joints=scene.joints + (rng.normal(size=stops.shape) * scatter * arm.unit)[visit])
    moved = Moved() if act is None else act(scene)
    quiet, base = true.points(scene, Moved(), 0.0), true.base
    place = base[:3, :3] @ station + base[:3, 3]
    along, sigma = _sight(quiet, place)
    noise = _noise(along, sigma, rng) + true.points(still, Moved(), 0.0) - quiet
    amount = 0.0 if act is None else 1.0
    if act is not None and size is not None:
        unit = float(np.sqrt(np.mean((true.points(scene, moved, 1.0) - quiet) ** 2)))
        if not unit > 1e-9:
            raise ValueError(f"moves nothing of {arm.name}")
        amount = size * float(np.sqrt(np.mean(noise**2))) / unit
    points = true.points(scene, moved, amount)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "set.csv"
        _write(path, scene, points + noise, held[visit], visit, plan, place)
        return Made(read_dataset(path), points - quiet)


def _sight(points: Array, place: Array) -> tuple[Array, Array]:
    """Return beam directions (n, 3), and sigmas along and across the beams (n, 2), mm."""
    way = points - place
    distance = np.linalg.norm(way, axis=1)
    sigma = np.column_stack([RANGE + 1e-6 * PPM * distance, ACROSS + 1e-6 * PPM * distance])
    return way / distance[:, None], sigma


def _noise(along: Array, sigma: Array, rng: np.random.Generator) -> Array:
    drawn = rng.normal(size=along.shape)
    by_beam = np.sum(drawn * along, axis=1, keepdims=True) * along
    return by_beam * sigma[:, :1] + (drawn - by_beam) * sigma[:, 1:]


def _write(
    path: Path,
    s: Scene,
    points: Array,
    held: NDArray[np.bool_],
    visit: NDArray[np.int64],
    plan: Plan,
    place: Array,
) -> None:
    """Write the data set with its header, and a robot file if the library lacks the arm."""
    arm, numbers = s.arm, range(1, s.arm.joints + 1)
    unit = ["mm" if k in arm.slides else "deg" for k in numbers]
    names = [f"j{k}_{u}" for k, u in zip(numbers, unit, strict=True)]
    names += [f"prev{k}_{u}" for k, u in zip(numbers, unit, strict=True)]
    names += ["visit", "tool_target", "x_mm", "y_mm", "z_mm", "t_s", "t_air_c", "set"]
    shown, came = s.joints / arm.unit, s.before / arm.unit
    target = list(TARGETS)
    with path.open("w", encoding="utf-8", newline="") as file:
        out = csv.writer(file)
        out.writerow(names)
        for i in range(s.count):
            row = [*(f"{q:.4f}" for q in (*shown[i], *came[i])), f"v{visit[i]}", target[s.target[i]]]
            row += [*(f"{x:.5f}" for x in points[i]), f"{s.time[i]:.2f}", f"{s.air[i]:.2f}"]
            out.writerow([*row, "validation" if held[i] else "calibration"])
    robot = arm.name
    if arm.text:
        robot = f"{arm.name}.toml"
        (path.parent / robot).write_text(arm.text, encoding="utf-8")
    targets = "".join(f"{name} = {list(at)}\n" for name, at in TARGETS.items())
    path.with_suffix(".toml").write_text(
        f'format = "truepose-dataset/1"\nrobot = "{robot}"\nsimulated = true\n[noise]\nkind = "tracker"\n'
        f"station_mm = {[round(float(x), 3) for x in place]}\nrange_mm = {RANGE}\ntransverse_mm = {ACROSS}\n"
        f"range_ppm = {PPM}\ntransverse_ppm = {PPM}\nrepeatability_deg = {REPEATS * plan.scatter}\n"
        f"repeatability_mm = {SLIDE_REPEATS * plan.scatter}\n[tool_targets]\n{targets}",
        encoding="utf-8",
    )
