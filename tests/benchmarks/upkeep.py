"""Benchmark of the thermal update: a cold start, with and without one SMR measured again.

Each arm is calibrated from a cold start until it is warm, and diagnosed. On the simulated day, its warming is
between nothing and twice as much, and slower or faster, according to duty and hall. Every quarter of an hour, four
poses of one target that a watch chooses are measured and update the thermal parameters. Between the updates, the
error is computed at fresh poses against the true points, and compared with a day just like that of the calibration.
Refused updates are counted as well, with no other change and after a tool was bumped.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calib import CalibratedModel, Dataset
from calib.diagnose import diagnose
from calib.model import BoundModel
from calib.saved import as_saved
from calib.units import DEG
from calib.watch import PlannedVisits, keep_up, later, plan, planned
from mocks.world import ArmState, Effect, World
from mocks.world.poses import approach_point, random_pose
from tests.benchmarks.clock import line
from tests.benchmarks.watch import calibrated, world_of

GROWTH = 3e-4  # of aluminium by 13 K
POSES, CANDIDATES, FRESH = 4, 200, 30
EVERY_S, DAY_S = 900.0, 4.0 * 3600.0
TARGETS = ("T2",)
BUMP_MM = 0.3


def baseline(seed: int) -> tuple[World, Effect, CalibratedModel, Dataset]:
    """An arm that warms up, its warm-up, its model and the header of its calibration."""
    world = world_of(seed)
    drawn = world.draw_effect("warm_up")
    warming = drawn.with_values(alpha=GROWTH * float(np.sign(drawn.values["alpha"])))
    world.effects = [warming]
    dataset = calibrated(world, seed)
    diagnosis = diagnose(dataset)
    return world, warming, as_saved(diagnosis.final, diagnosis), dataset


def of_today(seed: int, warming: Effect, rng: np.random.Generator, *, bumped: bool) -> World:
    """Simulate the arm on another day, with random extent and rate of its warming.

    If `bumped`, its tool has also been bumped.
    """
    world = world_of(seed)
    alpha = warming.values["alpha"] * rng.uniform(0.0, 2.0)
    effects = [warming.with_values(alpha=alpha, T_c=warming.values["T_c"] * rng.uniform(0.7, 1.5))]
    if bumped:
        bump = world.draw_effect("tool_shift")
        values = {k: v * BUMP_MM / 0.1 for k, v in bump.values.items()}
        effects.append(bump.with_values(**{**values, **dict.fromkeys(bump.constants, 0.0)}))
    world.effects = effects
    return world


def checked(saved: CalibratedModel, dataset: Dataset, world: World) -> PlannedVisits:
    """The few poses of one target that a watch chooses."""
    rng = np.random.default_rng(5)
    joints = np.radians([random_pose(world.robot, world.targets, rng) for _ in range(CANDIDATES)])
    sides = np.ones_like(joints)
    return plan(
        saved,
        dataset.header,
        PlannedVisits.of_points(joints, sides, np.full(CANDIDATES, 5.0 * DEG), TARGETS),
        POSES,
    ).visits


def measured(
    saved: CalibratedModel, dataset: Dataset, check: PlannedVisits, world: World, at_s: float, first: int
) -> Dataset:
    """Measure the check poses, beginning at `at_s` after the cold start.

    `first` is the number of the first reading.
    """
    template = later(planned(saved, dataset.header, check), at_s)
    times, points = template.conditions.time, []
    for i, (joints, side) in enumerate(zip(np.degrees(check.joints), check.sides, strict=True)):
        at, sides = tuple(joints.tolist()), tuple(int(s) for s in side)
        state = ArmState(at, approach_point(at, sides), sides, float(times[i]), 22.0, first + i)
        points.append(world.measured_point(state, TARGETS[0]))
    return replace(template, points=np.array(points))


def error_mm(saved: CalibratedModel, dataset: Dataset, world: World, at_s: float, seed: int) -> float:
    """RMS distance of predicted from true positions at fresh poses at one time."""
    rng = np.random.default_rng(seed)
    poses = [random_pose(world.robot, world.targets, rng) for _ in range(FRESH)]
    ones = np.ones((FRESH, 6))
    visits = PlannedVisits.of_points(np.radians(poses), ones, np.full(FRESH, 5.0 * DEG), TARGETS)
    conditions = planned(saved, dataset.header, visits).conditions
    conditions = replace(conditions, time=np.full(FRESH, at_s))
    predicted = BoundModel(saved.model, conditions).predict(saved.estimate)
    states = [ArmState(q, approach_point(q, (1,) * 6), (1,) * 6, at_s) for q in poses]
    true = np.array([world.true_point(state, TARGETS[0]) for state in states])
    return float(np.sqrt(np.mean(np.sum((predicted - true) ** 2, axis=1))))


def run(count: int = 10) -> bool:
    """Print the error over `count` days, and how often updates are refused."""
    errors, refused, noticed, unnamed = [], [], [], 0
    for arm in range(count):
        seed = 7000 + arm
        world, warming, saved, dataset = baseline(seed)
        if not any(e.label == "warm_up" for e in saved.model.effects):
            unnamed += 1
            continue
        rng = np.random.default_rng(seed)
        today = of_today(seed, warming, rng, bumped=False)
        struck = of_today(seed, warming, np.random.default_rng(seed), bumped=True)
        check, kept = checked(saved, dataset, world), saved
        for number, now_s in enumerate(np.arange(EVERY_S, DAY_S, EVERY_S).tolist()):
            first = 1000 * (number + 1)
            noticed.append(keep_up(kept, measured(saved, dataset, check, struck, now_s, first)).model is None)
            found = keep_up(kept, measured(saved, dataset, check, today, now_s, first))
            refused.append(found.model is None)
            kept = found.model or kept
            at_s = now_s + EVERY_S / 2.0
            days = ((saved, today), (kept, today), (saved, world))
            errors.append([error_mm(model, dataset, day, at_s, number) for model, day in days])
    without, with_it, alike = np.sqrt(np.mean(np.array(errors) ** 2, axis=0))
    halved = bool(with_it < 0.5 * without)
    line(
        f"without / with upkeep, {len(errors)} quarters of an hour",
        f"{without:.3f} / {with_it:.3f} mm ({alike:.3f} on a day like the calibration's)",
        "half",
        halved,
    )
    alarms, caught = float(np.mean(refused)), float(np.mean(noticed))
    line(f"refused with nothing else changed, of {len(refused)}", f"{alarms:.1%}", "2 %", alarms <= 0.02)
    line(f"refused after a bump of {BUMP_MM} mm, of {len(noticed)}", f"{caught:.0%}", "95 %", caught >= 0.95)
    print(f"{unnamed} of {count} calibrations did not name the warm-up", flush=True)
    return halved and alarms <= 0.02 and caught >= 0.95
