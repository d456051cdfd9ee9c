"""Simulated data sets for the benchmark of the diagnosis: draws, seeds, and their files.

Every set follows from its kind and its number. Robots: IRB 120 in three of five, LR Mate 200iC, UR10. Readings 50,
200 or 1000, sizes spread evenly in their logarithm from 0.5 to 5 times the noise. The name of an effect is drawn
first, then its joint, order, target or partner. Otherwise the many orders of the periodic errors would crowd out
other kinds.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from calib import Dataset, read_dataset
from calib.effects.transmission import pairs
from mocks.campaign import DEFAULT_FIT, Campaign, make_campaign, plan, write_campaign
from mocks.world import DEPARTURES, OUTSIDE, ArmState, Session, World, stream
from mocks.world.dataset import header_of, row_of
from mocks.world.poses import approach_point, random_sides
from mocks.world.scaling import Reading
from mocks.world.world import POSE_STREAM

ROBOTS = ("abb-irb120", "abb-irb120", "abb-irb120", "fanuc-lrmate200ic", "ur10")
READINGS = (50, 200, 200, 1000, 50, 200)
VALIDATION = 60
SMALLEST, LARGEST = 0.5, 5.0
TOOL: dict[str, tuple[float, tuple[float, float, float]]] = {"ur10": (2.7, (50.0, 25.0, 100.0))}
"""Mass in kg and centre in mm of a tool for the robot whose own loads have none: without one gravity never loads
joint 6, and a centre would have to be metres off to show."""

PER_JOINT = (
    "encoder_scale",
    "backlash",
    "dead_zone",
    "cubic_stiffness",
    "thermal_joint",
    "link_torsion",
    "bearing_tilt",
)
ALONE = (
    "thermal_growth",
    "warm_up",
    "pedestal",
    "payload_mass",
    "payload_cog",
    "tool_offset",
    "tool_tilt",
    "tool_shift",
    "base_shift",
    "drift_translation",
    "drift_rotation",
    "tracker_scale",
)
OF_LENGTHS = ("settling", "lost_motion")
NAMES = ("periodic", "periodic", "periodic", *PER_JOINT, *OF_LENGTHS, "coupling", "target_offset", *ALONE)
"""Every name of the library that the default base model does not hold already; settling and lost motion only after
moves of many lengths, since after moves of one length they are the same."""
GEAR = (50, 51, 80, 81, 100, 101, 120, 121, 160, 200, 242, 320)


@dataclass(frozen=True)
class Draw:
    """One data set: everything `make_campaign` needs."""

    kind: str
    robot: str
    seed: int
    labels: tuple[str, ...]
    n: int = 200
    size: float = 3.0
    departure: str | None = None
    approach: str = "offset"
    declared: float = 1.0
    fit: tuple[str, ...] = tuple(DEFAULT_FIT)

    def campaign(self) -> Campaign:
        """Simulate the campaign.

        Raises
        ------
        ValueError
            An effect moves nothing.
        """
        mass_kg, cog_mm = TOOL.get(self.robot, (None, None))
        return make_campaign(
            self.robot,
            self.seed,
            self.n,
            VALIDATION,
            list(self.labels),
            self.size,
            departure=self.departure,
            approach=self.approach,
            noise_declared_factor=self.declared,
            tool_mass_kg=mass_kg,
            tool_cog_mm=cog_mm,
            fit=self.fit,
        )


def load(campaign: Campaign) -> Dataset:
    """The data set of a campaign, through its files."""
    with tempfile.TemporaryDirectory() as folder:
        return read_dataset(write_campaign(campaign, Path(folder))["csv"])


def a_label(name: str, rng: np.random.Generator) -> str:
    """A label of this name, its parts drawn."""
    joint = int(rng.integers(1, 7))
    if name == "periodic":
        orders = (int(rng.integers(1, 7)), int(rng.integers(7, 50)), int(rng.choice(GEAR)))
        return f"periodic:j{joint}:n{orders[int(rng.integers(3))]}"
    if name == "coupling":
        able = pairs(6)
        a, b = able[int(rng.integers(len(able)))]
        return f"coupling:j{a}-j{b}"
    if name == "target_offset":
        return f"target_offset:T{rng.integers(1, 4)}"
    return f"{name}:j{joint}" if name in (*PER_JOINT, *OF_LENGTHS) else name


def some_labels(count: int, rng: np.random.Generator, approach: str) -> tuple[str, ...]:
    """Draw `count` different labels."""
    names = [name for name in NAMES if name not in OF_LENGTHS or approach != "offset"]
    chosen: list[str] = []
    while len(chosen) < count:
        label = a_label(names[int(rng.integers(len(names)))], rng)
        if label not in chosen:
            chosen.append(label)
    return tuple(chosen)


def _draw(kind: str, seed: int, labels: Callable[[np.random.Generator, str], tuple[str, ...]]) -> Draw:
    rng = np.random.default_rng(seed)
    approach = ("direct", "varied", "offset", "offset")[int(4.0 * rng.random())]
    return Draw(
        kind=kind,
        robot=str(rng.choice(ROBOTS)),
        seed=seed,
        n=int(rng.choice(READINGS)),
        size=float(np.exp(rng.uniform(np.log(SMALLEST), np.log(LARGEST)))),
        approach=approach,
        labels=labels(rng, approach),
    )


def several(kind: str, count: int, seed: int) -> Draw:
    """`count` effects of the library at once."""
    return _draw(kind, seed, lambda rng, approach: some_labels(count, rng, approach))


def lean(seed: int) -> Draw:
    """Draw a set whose base model lacks parallel twists or compliances that the arm has."""
    drawn = _draw("lean base model", seed, lambda rng, approach: ())
    lacking = ("parallel_twist", "compliance")[seed % 2]
    return replace(drawn, fit=tuple(group for group in DEFAULT_FIT if group != lacking))


def complete(seed: int, declared: float = 1.0) -> Draw:
    """Draw a set without any hidden effect.

    `declared` is the ratio of declared to true noise.
    """
    return replace(_draw("complete", seed, lambda rng, approach: ()), declared=declared)


def departing(seed: int, beside: int = 0) -> Draw:
    """An effect whose law departs from the textbook, with `beside` textbook effects."""
    departure = sorted(DEPARTURES)[seed % len(DEPARTURES)]
    replaced = DEPARTURES[departure][0]

    def labels(rng: np.random.Generator, approach: str) -> tuple[str, ...]:
        first = a_label(str(rng.choice(replaced)), rng)
        others = [x for x in some_labels(4 * beside, rng, approach) if x.partition(":")[0] not in replaced]
        return (first, *others[:beside])

    kind = f"departure and {beside} beside" if beside else "departure"
    return replace(_draw(kind, seed, labels), departure=departure)


def outside(seed: int) -> Draw:
    """Structure that no law of the library describes."""
    name = sorted(OUTSIDE)[seed % len(OUTSIDE)]
    return _draw("outside", seed, lambda rng, approach: (f"outside:{name}",))


def narrow(seed: int) -> Draw:
    """Draw a single effect for a start within a part of the joint ranges.

    Every pose is approached from a distance of 5 deg.
    """
    drawn = _draw("narrow start", seed, lambda rng, approach: some_labels(1, rng, "offset"))
    return replace(drawn, n=200, approach="offset")


def measured(world: World, readings: Sequence[Reading]) -> Campaign:
    """A campaign of these readings, all of them calibration, in a world that exists already."""
    rows = [row_of(world, i, "calibration", reading) for i, reading in enumerate(readings)]
    return Campaign(rows, header_of(world, 1.0, DEFAULT_FIT), {}, world, list(readings))


def crowded(readings: int, labels: Sequence[str], seed: int = 7) -> Campaign:
    """Simulate a campaign of many readings with many effects.

    Each effect is scaled on a hundred poses, since scaling on all of them takes minutes.
    """
    world = World("abb-irb120", seed, labels, session=Session(readings))
    rng = stream(seed, POSE_STREAM)
    return measured(world, plan(world, ["calibration"] * readings, True, "offset", rng))


def visits(
    world: World, n: int, held_out: int, each: int, at_once: int, approach: str, rng: np.random.Generator
) -> tuple[list[str], list[Reading]]:
    """Plan `n` calibration and `held_out` validation readings in random order of time.

    Every pose is visited `each` times from newly drawn sides. Each visit reads `at_once` targets, which share its
    repeatability.
    """
    names, per_pose = list(world.targets), each * at_once
    sets = ["calibration"] * -(-n // per_pose) + ["validation"] * -(-held_out // per_pose)
    stops = [pose for pose in range(len(sets)) for _ in range(each)]
    stops = [stops[i] for i in rng.permutation(len(stops))]
    drawn = plan(world, sets, True, "offset", rng)
    poses = [state.joints_deg for state, _ in drawn]
    kinds, readings, previous = [], [], poses[stops[-1]]
    for stop, pose in enumerate(stops):
        joints, sides = poses[pose], random_sides(6, rng)
        length = float(rng.uniform(5.0, 15.0)) if approach == "varied" else 5.0
        start = approach_point(joints, sides, length)
        if approach == "direct" and previous != joints:
            start, sides = previous, tuple(1 if q >= p else -1 for q, p in zip(joints, previous, strict=True))
        first = int(rng.integers(len(names)))
        if at_once == 1 and each > 1:
            first = pose % len(names)
        for k in range(at_once):
            order = stop * at_once + k
            t_s = round((order + 1) * world.session.seconds, 3)
            state = ArmState(joints, start, sides, t_s, round(world.air_c(t_s), 2), stop)
            readings.append((state, names[(first + k) % len(names)]))
            kinds.append(sets[pose])
        previous = joints
    return kinds, readings
