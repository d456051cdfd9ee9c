"""Benchmark of files with one usual mistake each, on every robot, and of odd but right sets.

A mistake counts as named if the readings are refused, exit code 2, with the words that mend it. Sets without a
mistake (zero tools, tilted bases, one-joint sweeps, narrow workspaces, distances only) must all be read.
"""

from __future__ import annotations

import copy
import re
import tomllib
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import tomli_w
from scipy.spatial.transform import Rotation

from calib import DataError, forward, load_robot, read_dataset
from calib.arm.robot import BUILT_IN
from mocks.campaign import make_campaign
from mocks.world import ROBOTS
from tests.benchmarks.clock import line
from tests.benchmarks.coverage import RANGE
from tests.calib.campaigns import write_files
from tests.calib.cells import NOISE, Cell

Row = dict[str, Any]
Files = tuple[list[Row], dict[str, Any], dict[str, Any]]
"""Rows, header and robot table of one data set."""

NAMED = 0.95
"""Share of mistakes that must be named."""

_POSES = 20
_ODD = 500
_POINT = ("x_mm", "y_mm", "z_mm")


def _joint(k: int, change: Callable[[float], float]) -> Callable[[Files], None]:
    def do(files: Files) -> None:
        for row in files[0]:
            row[f"j{k}_deg"] = change(row[f"j{k}_deg"])

    return do


def _swapped(k: int) -> Callable[[Files], None]:
    def do(files: Files) -> None:
        for row in files[0]:
            row[f"j{k}_deg"], row[f"j{k + 1}_deg"] = row[f"j{k + 1}_deg"], row[f"j{k}_deg"]

    return do


def _slipped(late: int) -> Callable[[Files], None]:
    def do(files: Files) -> None:
        rows = files[0]
        points = [{axis: row[axis] for axis in _POINT} for row in rows]
        for i, row in enumerate(rows):
            row.update(points[(i - late) % len(rows)])

    return do


def _points(factor: tuple[float, float, float]) -> Callable[[Files], None]:
    def do(files: Files) -> None:
        for row in files[0]:
            for axis, times in zip(_POINT, factor, strict=True):
                row[axis] *= times

    return do


def _links(change: Callable[[dict[str, Any]], None], only: int | None = None) -> Callable[[Files], None]:
    def do(files: Files) -> None:
        for k, link in enumerate(files[2]["link"], start=1):
            if only in (None, k):
                change(link)

    return do


def _radians(link: dict[str, Any]) -> None:
    link["alpha_deg"], link["theta_deg"] = np.radians(link["alpha_deg"]), np.radians(link["theta_deg"])


def _metres(link: dict[str, Any]) -> None:
    link["a_mm"], link["d_mm"] = link["a_mm"] / 1000.0, link["d_mm"] / 1000.0


def _inches(link: dict[str, Any]) -> None:
    link["a_mm"], link["d_mm"] = link["a_mm"] / 25.4, link["d_mm"] / 25.4


def _mirrored_alpha(link: dict[str, Any]) -> None:
    link["alpha_deg"] = -link["alpha_deg"]


def _other_convention(files: Files) -> None:
    files[2]["convention"] = {"dh": "mdh", "mdh": "dh"}[files[2]["convention"]]


def _tools(factor: float) -> Callable[[Files], None]:
    def do(files: Files) -> None:
        tools = files[1]["tool_targets"]
        files[1]["tool_targets"] = {name: [factor * x for x in at] for name, at in tools.items()}

    return do


def _exchanged(files: Files) -> None:
    other = {"T1": "T2", "T2": "T1"}
    for row in files[0]:
        row["tool_target"] = other.get(row["tool_target"], row["tool_target"])


def _reversed(files: Files) -> None:
    for row in files[0]:
        for k in (1, 2, 3):
            row[f"j{k}_deg"], row[f"j{7 - k}_deg"] = row[f"j{7 - k}_deg"], row[f"j{k}_deg"]


def _as_fanuc(files: Files) -> None:
    for row in files[0]:
        row["j3_deg"] = -row["j3_deg"] - row["j2_deg"]
    files[1]["beyond_limits"] = True


def _of_two_stations(files: Files) -> None:
    turn = Rotation.from_euler("xyz", (5.0, -10.0, 130.0), degrees=True)
    for row in files[0][12:]:
        there = turn.apply([row[axis] for axis in _POINT]) + np.array([800.0, -300.0, 90.0])
        row.update(zip(_POINT, there, strict=True))


def _of_another_target(files: Files) -> None:
    """The last five readings are of a point 70 mm further along the flange."""
    robot = load_robot(files[1]["robot"])
    rows = files[0][15:]
    angles = np.radians([[row[f"j{k}_deg"] for k in range(1, 7)] for row in rows])
    flange = forward(robot, robot.model_angles(angles, files[1].get("joint_coupling", "none")))
    for row, along in zip(rows, 70.0 * flange[:, :3, 2], strict=True):
        row.update(zip(_POINT, [row[axis] for axis in _POINT] + along, strict=True))


def mistakes(robot: dict[str, Any]) -> Iterator[tuple[str, Callable[[Files], None], str, bool]]:
    """Yield each mistake: its name, its change to the files, and the words that mend it.

    The last item states whether the mistake is in a robot file of the user.
    """
    count = len(robot["link"])
    for k in range(1, count + 1):
        yield f"sign of joint {k}", _joint(k, lambda q: -q), f"sign of the column j{k}_deg", False
        for off in (90.0, -90.0):
            if k == 1:
                continue  # where the base stands is free, and takes it up
            words = f"Add [{'+' if off < 0.0 else '-'}]90 to the column j{k}_deg"
            yield f"zero of joint {k} {off:+.0f}", _joint(k, lambda q, off=off: q + off), words, False
        if k < count:
            yield f"joints {k} and {k + 1} swapped", _swapped(k), f"Swap the columns j{k}_deg", False
    for late in (1, 2, 3, -1):
        words = f"Move the measured columns {abs(late)} rows? {'up' if late > 0 else 'down'}"
        yield f"points {late:+d} rows", _slipped(late), words, False
    for unit, factor in (("metres", 1e-3), ("inches", 1.0 / 25.4), ("micrometres", 1e3)):
        yield f"points in {unit}", _points((factor, factor, factor)), unit, False
    for unit, factor in (("metres", 1e-3), ("inches", 1.0 / 25.4), ("micrometres", 1e3)):
        yield f"tool in {unit}", _tools(factor), f"tool targets are in {unit}", False
    yield "tool targets exchanged", _exchanged, "Exchange T1 and T2", False
    yield "joints reversed", _reversed, "in reverse order", False
    yield "two stations", _of_two_stations, "8 of 20 .* another station", False
    yield "another target", _of_another_target, r"5 of 20 .* another tool target: at \[.*(69|70|71)", False
    if not robot.get("joint_matrices"):
        yield "joint 3 as Fanuc counts", _as_fanuc, "minus its joint 2: the two are coupled", False
    yield "points mirrored", _points((1.0, -1.0, 1.0)), "left-handed", False
    yield "robot file in radians", _links(_radians), "degrees", True
    yield "robot file in metres", _links(_metres), "by 1000", True
    yield "robot file in inches", _links(_inches), "by 25.4", True
    yield "the other convention", _other_convention, "Set convention", True
    for k, link in enumerate(robot["link"], start=1):
        if abs(np.sin(np.radians(link["alpha_deg"]))) > 0.1:
            yield f"sign of alpha{k}", _links(_mirrored_alpha, k), f"alpha_deg = .* link {k}", True


def refusal(folder: Path, files: Files, *, own: bool) -> str:
    """Return the text with which the files are refused, or an empty text if they are read."""
    rows, header, robot = files
    if own:
        (folder / "own.toml").write_text(tomli_w.dumps(robot | {"name": "own"}), encoding="utf-8")
        header = header | {"robot": "own.toml"}
    try:
        read_dataset(write_files(folder, rows, header))
    except DataError as error:
        return str(error)
    return ""


def files_of(robot: str, seed: int) -> Files:
    """Simulate 20 poses, three targets of the tool in turn; also return the robot table."""
    campaign = make_campaign(robot, seed=seed, n=_POSES, n_validation=0, effects=[])
    table = tomllib.loads((BUILT_IN / f"{robot}.toml").read_text(encoding="utf-8"))
    return copy.deepcopy(campaign.rows), {**campaign.header, "world": "free"}, table


def study(seeds: int) -> tuple[Counter[str], Counter[str], list[str]]:
    """Mistakes tried and named, by robot, and the ones that were not."""
    tried: Counter[str] = Counter()
    named: Counter[str] = Counter()
    missed = []
    with TemporaryDirectory() as folder:
        for robot in sorted(ROBOTS):
            for seed in range(1, seeds + 1):
                good = files_of(robot, seed)
                for what, do, words, own in mistakes(good[2]):
                    files = copy.deepcopy(good)
                    do(files)
                    text = refusal(Path(folder), files, own=own)
                    tried[robot] += 1
                    if re.search(words, text):
                        named[robot] += 1
                    else:
                        missed.append(f"{robot}, seed {seed}, {what}: {text[-220:] or 'read'}")
    return tried, named, missed


def odd_sets(count: int) -> Iterator[tuple[str, Cell, dict[str, Any]]]:
    """Yield sets without a mistake that are hard to place.

    Each item holds the oddity, the readings, and keys of the header.
    """
    everything = ["base", "geometry", "parallel_twist", "compliance", "tool"]
    for seed in range(count):
        rng = np.random.default_rng(seed)
        place = np.eye(4)
        place[:3, :3] = Rotation.random(rng=rng).as_matrix()
        place[:3, 3] = rng.uniform(-3000.0, 3000.0, 3)
        cell = Cell(seed, place)
        kind = seed % 5
        n = int(rng.integers(12, 200))
        if kind == 0:
            cell.measure("p", n, ["T2"], noise=NOISE)
            yield (
                "tilted base, zero tool, freed",
                cell,
                {
                    "tool_targets": {"T2": [0.0, 0.0, 0.0]},
                    "model": {"fit": everything},
                },
            )
        elif kind == 1:
            home = rng.uniform(RANGE[:, 0], RANGE[:, 1])
            joint = int(rng.integers(1, 7))
            joints = np.tile(home, (n, 1))
            joints[:, joint - 1] = np.radians(rng.uniform(-60.0, 60.0, n))
            cell.measure("p", n, ["T2"], joints=joints, noise=NOISE, validation=0)
            yield f"sweep of joint {joint} alone", cell, {}
        elif kind == 2:
            centre = rng.uniform(RANGE[:, 0], RANGE[:, 1])
            joints = centre + np.radians(rng.uniform(-1.0, 1.0, (n, 6)) * rng.uniform(1.0, 15.0))
            joints = np.clip(joints, RANGE[:, 0], RANGE[:, 1])
            cell.measure("p", n, joints=joints, noise=NOISE, validation=0)
            yield "narrow workspace", cell, {}
        elif kind == 3:
            cell.measure("l", max(n, 60), noise=NOISE)
            yield "distances only", cell, {"base_targets": "free"} if seed % 2 else {}
        else:
            cell.measure("p", n, noise=NOISE)
            wrong = {t: list(rng.uniform(-200.0, 200.0, 3)) for t in cell.targets}
            yield "wrong tool", cell, {"tool_targets": wrong}


def run(seeds: int = 3) -> bool:
    """Print the share of mistakes that are named, and how many good sets are refused."""
    tried, named, missed = study(seeds)
    reached = True
    for robot, count in tried.items():
        share = named[robot] / count
        line(
            f"mistakes named, {robot}, {count} sets of {_POSES} poses",
            f"{share:.1%}",
            f"{NAMED:.0%}",
            share >= NAMED,
        )
        reached &= share >= NAMED
    refused = []
    with TemporaryDirectory() as folder:
        for what, cell, header in odd_sets(_ODD):
            try:
                cell.dataset(Path(folder), **header)
            except DataError as error:
                refused.append(f"{what}: {error}")
    line(f"good sets refused, of {_ODD} odd ones", str(len(refused)), "0", not refused)
    for each in (*missed, *refused):
        print("   ", each)
    return reached and not refused
