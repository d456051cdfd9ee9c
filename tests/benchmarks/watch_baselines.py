"""The rate of false alarms over baselines: many arms, each calibrated once by few readings, and watched unchanged.

All watches of one baseline share its error, so a few of them say nothing about the stated rate. Every arm is one of
`mocks.world` with what a simulated cell hides in it (`mocks.cell`: one effect of gears, play, encoders, tool, base or
air, three times the noise), or with small errors of every gear and play of every joint at once, which no diagnosis
names. Campaign and watch go the way of a live cell without its wires: visits of three targets that share the
repeatability, a frame set up by 3-2-1 on nests that are measured anew each time, files, diagnosis, a plan with its own
choice of visits and readings, and the odds by which `judge` raises its alarm. What a tracker did in its own campaign
(drift) is over when the watch begins.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from acquisition.cell.world_frame import from_nests
from calib.data.dataset import Dataset
from calib.data.read import read_dataset
from calib.diagnose import diagnose
from calib.saved import SavedModel, as_saved
from calib.units import DEG
from calib.watch import Seen, Visits, plan
from calib.watch.judge import RATE, odds_of
from calib.watch.planning.planned import planned
from mocks.campaign import DEFAULT_FIT, Campaign, write_campaign
from mocks.world import ArmState, Session, World, random_label, scaled
from mocks.world.dataset import header_of, row_of
from mocks.world.poses import approach_point, random_pose
from mocks.world.scaling import Reading
from tests.benchmarks.diagnosis_sets import visits

READINGS, HELD_OUT = (30, 51, 102), 0.4
TARGETS = ("T2",)
POSES, CANDIDATES, WATCHES = 10, 150, 20
NESTS = {"N1": (0.0, 0.0, 0.0), "N2": (600.0, 0.0, 0.0), "N3": (0.0, 600.0, 0.0)}
_LABEL, _FRAME = 22, 40  # random streams: of `mocks.cell`, and our own
_PASSING = ("drift_translation", "drift_rotation")
_SMALL = 0.4  # times the noise: each of the errors that no diagnosis names


def arm(seed: int, kind: str, readings: int) -> World:
    """An arm with what is hidden in it, for a session of so many readings."""
    world = World("abb-irb120", seed, [], session=Session(readings))
    rng = np.random.default_rng([seed, _LABEL])
    return world


def hide(world: World, kind: str, readings: Sequence[Reading]) -> None:
    """Hide the effects of a kind in an arm, scaled on some readings."""
    rng = np.random.default_rng([world.seed, _LABEL])
    arrivals = 1 + max(state.reading for state, _ in readings)
    world.session = Session(arrivals, world.session.duration_s / arrivals)  # steps count arrivals
    if kind == "one":
        labels, size = [random_label(world.robot, rng)], 3.0
    elif kind == "none":
        labels, size = [], 1.0
    else:
        orders = rng.choice((1, 2, 3, 4, 50, 80, 100, 101, 120, 160), size=6)
        labels = [f"periodic:j{k}:n{n}" for k, n in enumerate(orders, start=1)]
        labels += [f"backlash:j{k}" for k in range(1, 7)]
        size = _SMALL
    world.effects = [scaled(world, world.draw_effect(label), readings, size) for label in labels]


def in_frame(world: World, points: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Points (n, 3) mm as they are in a world frame that is set up on nests measured now."""
    seen = {
        name: np.array(place) + world.noise.draw(np.array(place), world.station, rng)
        for name, place in NESTS.items()
    }
    return from_nests(seen, NESTS).to_world(points)


def calibrated(world: World, kind: str, readings: int) -> Dataset:
    """The data set of a calibration by about so many readings, and HELD_OUT times as many to judge by."""
    rng = np.random.default_rng([world.seed, _FRAME])
    kinds, those = visits(world, readings, round(HELD_OUT * readings), 1, 3, "offset", rng)
    hide(world, kind, those)
    rows = [row_of(world, i, *each) for i, each in enumerate(zip(kinds, those, strict=True))]
    axes = ("x_mm", "y_mm", "z_mm")
    points = in_frame(world, np.array([[row[axis] for axis in axes] for row in rows]), rng)
    for row, point in zip(rows, points.tolist(), strict=True):
        row.update(zip(axes, point, strict=True))
    header = header_of(world, 1.0, DEFAULT_FIT) | {"nests": {n: list(p) for n, p in NESTS.items()}}
    with tempfile.TemporaryDirectory() as folder:
        return read_dataset(write_campaign(Campaign(rows, header, {}, world, those), Path(folder))["csv"])


def checks(saved: SavedModel, dataset: Dataset, world: World) -> Visits:
    """The visits that the plan makes of random poses."""
    rng = np.random.default_rng([world.seed, 5])
    joints = np.radians([random_pose(world.robot, world.targets, rng) for _ in range(CANDIDATES)])
    sides = rng.choice((-1.0, 1.0), size=joints.shape)
    candidates = Visits.of_points(joints, sides, np.full(CANDIDATES, 5.0 * DEG), TARGETS)
    return plan(saved, dataset.header, candidates, POSES, times=None, repeats=None).visits


def watched(saved: SavedModel, dataset: Dataset, check: Visits, world: World, number: int) -> Dataset:
    """A watch of the unchanged arm, in a frame of its own."""
    template = planned(saved, dataset.header, check)
    conditions = template.conditions
    air_c = round(world.air_c(world.session.duration_s * (number + 1) / WATCHES), 2)
    conditions = replace(conditions, temperature=np.full(len(conditions), air_c))
    first, points = 10_000 * (1 + number), []
    for i, (joints, side, read) in enumerate(zip(np.degrees(check.joints), check.sides, check.read, strict=True)):
        at, sides = tuple(joints.tolist()), tuple(int(s) for s in side)
        state = ArmState(at, approach_point(at, sides), sides, 20.0 * i, air_c, first + i)
        points += [world.measured_point(state, target) for target, _ in read]
    rng = np.random.default_rng([world.seed, _FRAME, number])
    return replace(template, conditions=conditions, points=in_frame(world, np.array(points), rng))


def alarms(seed: int, kind: str, readings: int, say=None) -> int:
    """How many of WATCHES watches of an unchanged arm raise an alarm."""
    world = arm(seed, kind, round((1.0 + HELD_OUT) * readings))
    dataset = calibrated(world, kind, readings)
    hidden = [e.label for e in world.effects]
    world.effects = [effect for effect in world.effects if effect.label not in _PASSING]
    found = diagnose(dataset)
    saved = as_saved(found.final, found)
    check = checks(saved, dataset, world)
    whiten, odds, limit = None, None, 0.0
    residuals = []
    for number in range(WATCHES):
        seen = Seen.of(saved, watched(saved, dataset, check, world, number))
        if odds is None:
            whiten, odds = odds_of(seen)
            limit = odds.limit(RATE)
        residuals.append(whiten @ seen.residual)
    white = np.array(residuals)
    p = odds.p_values(white)
    n = int(np.sum(p.min(axis=1) < limit))
    if say:
        t2 = np.sum(white**2, axis=1) / odds.rows
        med = np.median(p, axis=0)
        worst = int(np.argmin(med[1:]))
        common = white.mean(axis=0)
        say(f"{kind} {readings} {seed} alarms {n} T2/q {t2.mean():.2f} mean {common@common:.0f}/{odds.rows} worst {odds.causes[worst].effect.label} {med[1+worst]:.1e} | hid {','.join(hidden[:2])} found {','.join(e.effect.label for e in found.effects)} {found.verdict} scale {saved.noise_scale:.2f} held {saved.held_out_rms_mm:.4f} lack {__import__('calib.watch.lack',fromlist=['x']).scatter_beyond(saved, planned(saved, dataset.header, check))/DEG:.5f} reads {check.readings}/{len(check)}")
    return n


if __name__ == "__main__":
    import sys
    import time
    kind, n, a, b = sys.argv[1], int(sys.argv[2]), int(sys.argv[3]), int(sys.argv[4])
    t=time.time(); total=0
    for s in range(a, b):
        total += alarms(s, kind, n, say=lambda x: print(x, flush=True))
    print(f"TOTAL {kind} {n}: {total} of {(b-a)*WATCHES} in {time.time()-t:.0f} s")
