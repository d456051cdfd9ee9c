"""Benchmark of the watch of simulated arms: detection, names, false alarms, updates.

Arms, effects, repeatability and tracker are those of `mocks.world`. Each arm is calibrated with 60 poses of three
targets and 20 held-out poses, diagnosed, and watched with 10 poses of one target. The plan chooses visits and
readings so that all changes are detected; a second series takes one reading at each pose. The changes are: none, a
tool bumped by 0.1 mm, a zero lost by 0.01 deg, a base moved by 0.1 mm, backlash of 0.01 deg, 0.5 kg more on the
flange. Frame and station are the same throughout.

Verdicts are those of the linear odds, for many watches at once. The first watch of each kind goes through `judge`
as well, and its model is updated. The arm is also calibrated again as it was at first, with its tool freed if the
tool moved.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from calib import CalibratedModel, DataError, Dataset, read_dataset
from calib.array import Array
from calib.diagnose import diagnose
from calib.model import BoundModel
from calib.saved import as_saved
from calib.units import DEG
from calib.watch import RATE, PlannedVisits, WhitenedReadings, cause_to_update, judge, plan, planned
from calib.watch.judge import odds_of
from mocks.campaign import DEFAULT_FIT, Campaign, write_campaign
from mocks.world import ArmState, Effect, Session, World
from mocks.world.dataset import header_of, row_of
from mocks.world.poses import approach_point, random_pose
from tests.benchmarks.clock import line
from tests.benchmarks.diagnosis_sets import visits
from tests.calib.updates import as_updated

TARGETS = ("T2",)
POSES, CANDIDATES, WATCHES = 10, 400, 20
UNCHANGED = 5  # times as many watches with nothing changed: rare alarms take more to count
FREED = {"tool_shift": ("tool",)}
KINDS = ("nothing", "tool_shift", "joint_step", "base_shift", "backlash", "payload_mass")
EVERY = range(1, 7)
HEAVIER_KG = 0.5
ZERO_DEG, PLAY_DEG = 0.01, 0.01  # those of tool and base are drawn by the simulator with 0.1 mm
_READINGS, _HELD_OUT, _JUDGED = 180, 60, 60


def world_of(seed: int, changed: Effect | None = None) -> World:
    """Simulate an arm, with the change if one is given."""
    world = World("abb-irb120", seed, [], session=Session(_READINGS + _HELD_OUT))
    world.effects = [] if changed is None else [changed]
    return world


def change(
    world: World, kind: str, rng: np.random.Generator, joints: Sequence[int]
) -> tuple[str, Effect | None]:
    """The label of a change and the effect that causes it; joints are drawn of some."""
    if kind == "nothing":
        return "", None
    label = f"{kind}:j{rng.choice(joints)}" if kind in ("joint_step", "backlash") else kind
    drawn = world.draw_effect(label)
    sign = float(rng.choice((-1.0, 1.0)))
    values = {"at_reading": 0.0, "step": sign * ZERO_DEG, "gap": PLAY_DEG, "mass": HEAVIER_KG}
    return label, drawn.with_values(**{k: v for k, v in values.items() if k in drawn.values})


def calibrated(world: World, seed: int, groups: Sequence[str] = DEFAULT_FIT) -> Dataset:
    """The data set of a calibration that frees some groups."""
    kinds, readings = visits(world, _READINGS, _HELD_OUT, 1, 3, "offset", np.random.default_rng(seed))
    rows = [row_of(world, i, *each) for i, each in enumerate(zip(kinds, readings, strict=True))]
    with tempfile.TemporaryDirectory() as folder:
        campaign = Campaign(rows, header_of(world, 1.0, list(groups)), {}, world, readings)
        return read_dataset(write_campaign(campaign, Path(folder))["csv"])


def planned_for(saved: CalibratedModel, dataset: Dataset, world: World, often: int | None) -> PlannedVisits:
    """Plan the check poses of one target, chosen by `plan` from random ones.

    `often` is the number of visits to each pose and of readings per visit; None leaves the choice to `plan`.
    """
    candidates = drawn(world, CANDIDATES, np.random.default_rng(5))
    return plan(saved, dataset.header, candidates, POSES, times=often, repeats=often).visits


def drawn(world: World, count: int, rng: np.random.Generator) -> PlannedVisits:
    """Draw random poses of one target; each joint approaches from a random side."""
    joints = np.radians([random_pose(world.robot, world.targets, rng) for _ in range(count)])
    sides = rng.choice((-1.0, 1.0), size=joints.shape)
    return PlannedVisits.of_points(joints, sides, np.full(count, 5.0 * DEG), TARGETS)


def watched(
    saved: CalibratedModel, dataset: Dataset, check: PlannedVisits, world: World, first: int
) -> Dataset:
    """The check poses measured in a world, as a data set."""
    return replace(planned(saved, dataset.header, check), points=measured(world, check, 22.0, first))


def measured(world: World, check: PlannedVisits, air_c: float, first: int) -> Array:
    """Measure the check poses, (n, 3), mm.

    `first` is the number of the first visit; it determines the random rest position of the arm.
    """
    points = []
    for i, (joints, side, read) in enumerate(
        zip(np.degrees(check.joints), check.sides, check.read, strict=True)
    ):
        at, sides = tuple(joints.tolist()), tuple(int(s) for s in side)
        state = ArmState(at, approach_point(at, sides), sides, 20.0 * i, air_c, first + i)
        points += [world.measured_point(state, target) for target, _ in read]
    return np.array(points)


def error_mm(saved: CalibratedModel, dataset: Dataset, world: World) -> tuple[float, float]:
    """Return RMS distances at fresh poses of the predicted target from readings and truth, mm."""
    rng = np.random.default_rng(8)
    poses = [random_pose(world.robot, world.targets, rng) for _ in range(_JUDGED)]
    sides = rng.choice((-1, 1), size=(_JUDGED, 6))
    at = planned(
        saved,
        dataset.header,
        PlannedVisits.of_points(np.radians(poses), sides.astype(float), np.full(_JUDGED, 5.0 * DEG), TARGETS),
    )
    predicted = BoundModel(saved.model, at.conditions).predict(saved.estimate)
    states = [
        ArmState(q, approach_point(q, s), s) for q, s in zip(poses, map(tuple, sides.tolist()), strict=True)
    ]
    read = np.array([world.measured_point(state, TARGETS[0]) for state in states])
    true = np.array([world.true_point(state, TARGETS[0]) for state in states])
    of_readings, of_truth = (np.sqrt(np.mean(np.sum((predicted - p) ** 2, axis=1))) for p in (read, true))
    return float(of_readings), float(of_truth)


Row = tuple[str, bool, bool, bool, bool]
"""Of a watch: what had changed, and whether it was seen, in the class, alone, and never told from another."""


def run(count: int = 100) -> bool:
    """Print the results of `count` watches of each change, and of further unchanged watches.

    Without a change there are `UNCHANGED` times as many, with `WATCHES` watches per arm. The visits chosen by the
    plan are judged. The series with one reading at each pose is only printed.
    """
    reached = _told(*_counted(count, None))
    print("with one reading at each pose:", flush=True)
    _told(*_counted(count, 1))
    return reached


Counted = dict[str, list[Row]]
Errors = dict[str, list[tuple[float, ...]]]


def _counted(
    count: int,
    often: int | None,
    kinds: Sequence[str] = KINDS,
) -> tuple[Counted, Errors, int]:
    """Count the results of each kind of watch, planned by `planned_for`.

    Also return the errors of updated and new models, and how often `judge` and the odds disagree.
    """
    counts: Counted = {kind: [] for kind in kinds}
    errors: Errors = {kind: [] for kind in kinds[1:]}
    check = None
    unlike = 0
    for arm in range(max(count // WATCHES, 1)):
        seed = 4000 + arm
        world, rng = world_of(seed), np.random.default_rng(seed)
        dataset = calibrated(world, seed)
        diagnosis = diagnose(dataset)
        saved = as_saved(diagnosis.final, diagnosis)
        if check is None:
            check = planned_for(saved, dataset, world, often)
            print(f"{check.readings} readings in {len(check)} visits", flush=True)
        whiten, odds = odds_of(WhitenedReadings.of(saved, watched(saved, dataset, check, world, 0)))
        limit, labels = odds.limit(RATE), [cause.effect.label for cause in odds.causes]
        for k, kind in enumerate(kinds):
            for i in range(WATCHES * (1 if k else UNCHANGED)):
                label, changed = change(world, kind, rng, EVERY)
                there = world_of(seed, changed)
                first = 1000 * (1 + k * UNCHANGED * WATCHES + i)
                there._noise_rng = np.random.default_rng([seed, first])
                data = watched(saved, dataset, check, there, first)
                seen = WhitenedReadings.of(saved, data)
                white = (whiten @ seen.residual)[None]
                alarm = bool(odds.p_values(white).min() < limit)
                named = odds.named(white)
                cause = labels.index(label) if label in labels else -1
                member = alarm and cause >= 0 and bool(named.members[0, cause])
                alone = member and bool(named.alone[0]) and int(named.best[0]) == cause
                twins = cause < 0 or bool(odds.always(cause))
                counts[kind].append((label, alarm, member, alone, twins))
                if i == 0:
                    verdict = judge(seen)
                    unlike += (verdict.kind != "unchanged") != alarm
                    if label and alarm:
                        try:
                            updated = as_updated(saved, seen, cause_to_update(verdict))
                        except DataError:
                            continue
                        again = diagnose(calibrated(there, seed + 500, (*DEFAULT_FIT, *FREED.get(kind, ()))))
                        fresh = as_saved(again.final, again)
                        errors[kind].append((*error_mm(updated, data, there), *error_mm(fresh, data, there)))
    return counts, errors, unlike


def _shares(name: str, rows: Sequence[Row], *, said: bool) -> bool:
    """Print the shares that were detected, in the class, and identified alone.

    The last share counts only changes that the poses can distinguish. `said` states whether the shares are judged.
    """
    seen = sum(row[1] for row in rows) / len(rows)
    member = sum(row[2] for row in rows) / len(rows)
    able = [row[3] for row in rows if not row[4]]
    alone = f"{np.mean(able):.0%}" if able else "never"
    ok = seen >= 0.95 and member >= 0.95 and (not able or float(np.mean(able)) >= 0.8)
    figures = f"seen {seen:.1%}, in class {member:.1%}, alone {alone}"
    if said:
        line(f"{name}, of {len(rows)}", figures, "95, 95, 80 %", ok)
    else:
        print(f"{name + ', of ' + str(len(rows)):<40} {figures}", flush=True)
    return ok


def _told(counts: Counted, errors: Errors, unlike: int) -> bool:
    n = len(counts["nothing"])
    alarms = sum(row[1] for row in counts["nothing"]) / n
    reached = 0.005 <= alarms <= 0.015
    line(f"false alarms, of {n}", f"{alarms:.2%}", "1 % +- 0.5 %", reached)
    for kind in list(counts)[1:]:
        rows = counts[kind]
        ok = _shares(kind, rows, said=True)
        reached &= ok
        for label in sorted({row[0] for row in rows} - {kind}):
            _shares(f"  {label}", [row for row in rows if row[0] == label], said=False)
        if errors[kind]:
            updated, true, fresh, fresh_true = np.sqrt(np.mean(np.array(errors[kind]) ** 2, axis=0))
            ratio = float(updated / fresh)
            reached &= ratio <= 1.2
            line(
                f"  updated over recalibrated, of {len(errors[kind])}: on readings (of the truth)",
                f"{ratio:.2f}, {updated:.3f} / {fresh:.3f} mm ({true / fresh_true:.2f}, {true:.3f} / {fresh_true:.3f})",
                "1.2",
                ratio <= 1.2,
            )
    line("  first of each kind: alarms by judge and by the odds differ", f"{unlike}", "0", unlike == 0)
    return reached and unlike == 0
