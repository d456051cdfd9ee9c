"""Benchmark of `truepose robot check FILE DATA`: each usual mistake alone, on ten arms.

The arms have usual builds. There are 20 readings. The real arm differs from its table as real arms do (0.05 deg,
0.3 mm), stands at a random place, and is measured to 0.05 mm. A mistake counts as named if the list of likeliest
causes contains it: causes on that list explain the readings equally well, so that the readings cannot distinguish
them. The program also prints how often it is the first, and how often a good file is accused.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from calib import Robot, forward, load_robot
from calib.array import Array
from calib.data import InterpretedReadings
from calib.robot_file import CheckReadings, Draft, DraftLink, held_against, written_robot
from calib.units import DEG
from tests.benchmarks.clock import at_most, line

READINGS = 20
NAMED = 0.95
TARGETS = np.array([[60.0, 20.0, 110.0], [-55.0, 35.0, 95.0], [10.0, -70.0, 130.0]])
NOISE_MM = 0.05
BUILDS: dict[str, tuple[str, tuple[tuple[float, ...], ...]]] = {
    # convention; alpha deg, a mm, theta deg, d mm of every link; a fifth number 1: it slides
    "offset wrist": (
        "mdh",
        (
            (0, 0, 0, 450),
            (-90, 150, -90, 0),
            (0, 610, 0, 0),
            (-90, 130, 0, 640),
            (90, 0, 0, 0),
            (-90, 40, 180, 100),
        ),
    ),
    "large": (
        "mdh",
        (
            (0, 0, 0, 670),
            (-90, 312, -90, 0),
            (0, 1075, 0, 0),
            (-90, 225, 0, 1280),
            (90, 0, 0, 0),
            (-90, 0, 180, 215),
        ),
    ),
    "small, standard": (
        "dh",
        ((-90, 0, 0, 135), (0, 135, -90, 0), (-90, 38, 0, 0), (90, 0, 0, 120), (-90, 0, 0, 0), (0, 0, 0, 70)),
    ),
    "seven axes": (
        "mdh",
        (
            (0, 0, 0, 340),
            (-90, 0, 0, 0),
            (90, 0, 0, 400),
            (90, 0, 0, 0),
            (-90, 0, 0, 400),
            (-90, 0, 0, 0),
            (90, 0, 0, 126),
        ),
    ),
    "SCARA": ("mdh", ((0, 0, 0, 380), (0, 325, 0, 0), (180, 275, 0, 0, 1), (0, 0, 0, 0))),
    "six on a track": (
        "mdh",
        (
            (-90, 0, 0, 0, 1),
            (90, 0, 0, 400),
            (-90, 75, -90, 0),
            (0, 365, 0, 0),
            (-90, 90, 0, 405),
            (90, 0, 0, 0),
            (-90, 0, 180, 80),
        ),
    ),
}


def arms() -> dict[str, Robot]:
    """Ten arms: four of the library and six of other builds."""
    out = {name: load_robot(name) for name in ("abb-irb120", "fanuc-lrmate200ic", "ur5", "ur10")}
    for name, (convention, rows) in BUILDS.items():
        links = tuple(
            DraftLink(
                row[0],
                row[1],
                row[2],
                row[3],
                0.0 if row[4:] else -120.0,
                600.0 if row[4:] else 120.0,
                bool(row[4:]),
            )
            for row in rows
        )
        out[name] = written_robot(Draft(name, "x", "dh" if convention == "dh" else "mdh", "bench", links))
    return out


def readings_of(robot: Robot, seed: int) -> tuple[Array, NDArray[np.int64], Array]:
    """Simulate a real arm of this build at a random place.

    Return joints (n, N), index of the target (n,) and points (n, 3), mm.
    """
    rng = np.random.default_rng(seed)
    real = replace(
        robot,
        alpha=tuple(x + 0.05 * DEG * rng.normal() for x in robot.alpha),
        theta=tuple(x + 0.05 * DEG * rng.normal() for x in robot.theta),
        a=tuple(x + 0.3 * rng.normal() for x in robot.a),
        d=tuple(x + 0.3 * rng.normal() for x in robot.d),
    )
    low, high = np.array(robot.lower), np.array(robot.upper)
    turning = np.array([unit == "deg" for unit in robot.units])
    low, high = (
        np.where(turning, np.maximum(low, -np.pi), low),
        np.where(turning, np.minimum(high, np.pi), high),
    )
    joints = rng.uniform(low, high, (READINGS, robot.joints))
    which = np.arange(READINGS, dtype=np.int64) % len(TARGETS)
    flange = forward(real, joints)
    points = flange[:, :3, 3] + np.einsum("nij,nj->ni", flange[:, :3, :3], TARGETS[which])
    turn = Rotation.random(rng=rng).as_matrix()
    measured = points @ turn.T + rng.uniform(-2000.0, 2000.0, 3) + rng.normal(0.0, NOISE_MM, points.shape)
    return joints, which, measured


def mistakes(robot: Robot, joints: Array, points: Array) -> Iterator[tuple[str, Robot, Array, Array, str]]:
    """Name, robot file and readings with the mistake in them, and the words that name it."""

    def counted(change: Array, offset: Array | None = None) -> Array:
        return joints @ change.T + (0.0 if offset is None else offset)

    name, count, eye = (
        {k: axis.removeprefix("j") for k, axis in enumerate(robot.axes)},
        robot.joints,
        np.eye(robot.joints),
    )
    other = replace(robot, convention="dh" if robot.convention == "mdh" else "mdh")
    yield "convention", other, joints, points, "as its convention says"
    small = replace(robot, a=tuple(x / 1e3 for x in robot.a), d=tuple(x / 1e3 for x in robot.d))
    yield "table in metres", small, joints, points, "has its lengths in metres"
    narrow = replace(
        robot, alpha=tuple(x * DEG for x in robot.alpha), theta=tuple(x * DEG for x in robot.theta)
    )
    if max(abs(np.sin(x)) for x in (*robot.alpha, *robot.theta)) > 0.1:
        yield "table in radians", narrow, joints, points, "has its angles in radians"
    turning = np.array([unit == "deg" for unit in robot.units])
    yield (
        "joints in radians",
        robot,
        joints * np.where(turning, DEG, 1.0),
        points,
        "all joints are given in radians",
    )
    yield "points in metres", robot, joints, points / 1e3, "measured numbers are metres"
    for k in range(count):
        change = eye.copy()
        change[k, k] = -1.0
        yield (
            "sign of a joint",
            robot,
            counted(change),
            points,
            f"joint {name[k]} {robot.kinds[k]} in the other",
        )
        if abs(np.sin(robot.alpha[k])) > 0.1:
            mirrored = tuple(-x if i == k else x for i, x in enumerate(robot.alpha))
            if (
                k or robot.convention == "dh"
            ):  # in front of a modified first link stands the base, which is free
                words = f"alpha_deg of link {k + 1} with the wrong sign"
                yield "sign of an alpha", replace(robot, alpha=mirrored), joints, points, words
        for off in (90.0, -90.0, 180.0) if turning[k] and k != _free(robot) else ():
            shifted = tuple(x + off * DEG * (i == k) for i, x in enumerate(robot.theta))
            words = f"zero of joint {name[k]} is {abs(off):g} deg off"
            yield f"zero off by {abs(off):g}", replace(robot, theta=shifted), joints, points, words
        if k + 1 == count or turning[k] != turning[k + 1]:
            continue
        order = [*range(k), k + 1, k, *range(k + 2, count)]
        swapped = f"joints {name[k]} and {name[k + 1]} are in each other's column"
        yield "order of joints", robot, joints[:, order], points, swapped
        coupled = eye.copy()
        coupled[k + 1, k] = 1.0
        words = f"joint {name[k + 1]} of the robot is the controller's plus"
        if (name[k], name[k + 1]) == ("2", "3"):
            yield (
                "coupling of 2 and 3",
                robot,
                counted(np.linalg.inv(coupled).astype(np.float64)),
                points,
                words,
            )
    for k in range(count - 1):
        order = [*range(k), k + 1, k, *range(k + 2, count)]
        numbers = {key: tuple(getattr(robot, key)[i] for i in order) for key in ("alpha", "a", "theta", "d")}
        words = f"links {k + 1} and {k + 2} in each other's place"
        yield "order of links", replace(robot, **numbers), joints, points, words


def _free(robot: Robot) -> int:
    """Return the joint whose zero the free base absorbs (0-based), or -1.

    It is the first joint, if that one turns.
    """
    return 0 if robot.units[0] == "deg" else -1


def named(robot: Robot, joints: Array, which: NDArray[np.int64], points: Array) -> tuple[str, ...]:
    """List the mistakes that the check reports."""
    everything = InterpretedReadings(robot, "none", joints, which, points)
    usable = np.ones(len(joints), dtype=bool)
    handful = CheckReadings(everything, np.flatnonzero(usable), usable, TARGETS, tool_unknown=False)
    return tuple(each.what for each in held_against(Path("own.toml"), "", handful).mistakes)


def run(seeds: int = 2) -> bool:
    """Print the share of mistakes named by kind, and of good files accused."""
    tried: Counter[str] = Counter()
    right: Counter[str] = Counter()
    first: Counter[str] = Counter()
    missed, accused, good = [], 0, 0
    for arm, library in arms().items():
        robot = replace(library, name="own")
        for seed in range(1, seeds + 1):
            joints, which, points = readings_of(robot, seed)
            good += 1
            accused += bool(named(robot, joints, which, points))
            for kind, file, counted, measured, words in mistakes(robot, joints, points):
                found = named(file, counted, which, measured)
                tried[kind] += 1
                right[kind] += any(re.search(words, what) is not None for what in found)
                first[kind] += bool(found) and re.search(words, found[0]) is not None
                if not any(re.search(words, what) for what in found):
                    missed.append(f"{arm}, seed {seed}, {kind}, {words}: {'; '.join(found) or 'nothing'}")
    reached = True
    for kind, count in tried.items():
        line(
            f"{kind}, {count} files, first named {first[kind] / count:.0%}",
            f"{right[kind] / count:.1%}",
            "",
            True,
        )
    share = sum(right.values()) / sum(tried.values())
    reached &= share >= NAMED
    line(
        f"usual mistakes named, {len(arms())} arms, {sum(tried.values())} files",
        f"{share:.1%}",
        f"{NAMED:.0%}",
        reached,
    )
    reached &= at_most("good files accused", accused, good, 0.0)
    for each in missed:
        print("   ", each)
    return reached
