"""Benchmark of watches by other readings: false alarms and detection of planned changes.

Arms are drawn from the priors and measured by the second arm (`tests.benchmarks.arm`), as for the coverage of
intervals. The readings are poses from cameras, legs of a ballbar, several visits to two targets, and balls of an
artefact that the tool touches. The artefact is in its place or set down again. Each plan chooses ten of its
candidates. Some arms are unchanged. In others, one joint has lost its zero or has play, by the size that the plan
promises to detect in 95 %.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from calib import CalibratedModel, Dataset, identify, inverse_kinematics
from calib.array import Array
from calib.model import BoundModel
from calib.saved import as_saved
from calib.units import DEG
from calib.watch import RATE, SEEN, PlannedVisits, WatchPlan, WhitenedReadings, plan, planned
from calib.watch.judge import odds_of
from tests.benchmarks.clock import line
from tests.benchmarks.coverage import (
    BASE_TARGETS,
    KINDS,
    RANGE,
    ROBOT,
    TARGETS,
    Campaign,
    Kind,
    header_of,
    simulate,
    true_frames,
)

POSES, CANDIDATES, ARMS = 10, 120, 20
LEGS = (("T1", "B1"), ("T1", "B2"), ("T2", "B2"), ("T2", "B3"), ("T3", "B3"), ("T3", "B1"))
BALLS = np.array(
    [[450.0, 150.0, 250.0], [450.0, -150.0, 250.0], [300.0, 250.0, 350.0], [300.0, -250.0, 350.0]]
)
POINTS = Kind("points", 180)


@dataclass(frozen=True)
class Way:
    """Way to watch: the calibration of the arm, and the readings of each visit.

    Each pose is visited `rounds` times. If `touched`, the target sits in balls; if `frame_known`, these have kept
    their place.
    """

    name: str
    kind: Kind
    read: tuple[tuple[str, str], ...]
    rounds: int = 1
    touched: bool = False
    frame_known: bool = True


WAYS = (
    Way("poses", replace(KINDS[2], readings=120), (("T1", ""),)),
    Way("legs", Kind("distances", 300, points=False), LEGS),
    Way("two targets, twice", POINTS, (("T2", ""), ("T3", "")), rounds=2),
    Way("touched balls", POINTS, (("T2", ""),), touched=True),
    Way("touched balls, set down anew", POINTS, (("T2", ""),), touched=True, frame_known=False),
)


def candidates(way: Way, rng: np.random.Generator) -> tuple[PlannedVisits, Array]:
    """Candidates of a way, and (V, 3) the ball of each, mm; without balls NaN."""
    joints = rng.uniform(RANGE[:, 0], RANGE[:, 1], (CANDIDATES, ROBOT.joints))
    balls = np.full((CANDIDATES, 3), np.nan)
    if way.touched:
        balls = BALLS[np.arange(CANDIDATES) % len(BALLS)]
        flange = true_frames({}, joints, ("T2",), np.zeros(CANDIDATES, dtype=np.int64))
        flange[:, :3, 3] = balls - flange[:, :3, :3] @ np.array(TARGETS["T2"])
        every = inverse_kinematics(ROBOT, flange, seed=joints).joints[:, 0]
        reached = np.all(np.isfinite(every), axis=1)
        joints, balls = every[reached], balls[reached]
    sides = rng.choice((-1.0, 1.0), size=joints.shape)
    return PlannedVisits(joints, sides, np.full(len(joints), 5.0 * DEG), (way.read,) * len(joints)), balls


def measured(
    way: Way,
    campaign: Campaign,
    saved: CalibratedModel,
    visits: PlannedVisits,
    would: Dataset,
    balls: Array,
    changes: dict[str, float],
    rng: np.random.Generator,
) -> Dataset:
    """Simulate the planned readings of the true arm.

    `changes` gives sizes of `joint_step:jK` and `backlash:jK`, rad.
    """
    at = would.conditions
    truth, play = dict(campaign.truth), np.zeros(ROBOT.joints)
    for label, size in changes.items():
        joint = int(label[-1])
        if label.startswith("joint_step"):
            truth[f"theta{joint}"] = truth.get(f"theta{joint}", 0.0) + size
        else:
            play[joint - 1] = size / 2.0
    names, noise = at.target_names, would.header.noise
    joints, n = at.joints, len(at)

    def held(angles: Array) -> Array:
        which = np.array([list(TARGETS).index(names[t]) for t in at.target])
        return true_frames(truth, angles + at.side * play, tuple(TARGETS), which)

    if way.touched:
        place = balls + noise.sigma_mm * rng.normal(size=(n, 3))
        if not way.frame_known:
            moved = Rotation.from_rotvec(0.01 * rng.normal(size=3))
            place = moved.apply(place - BALLS.mean(axis=0)) + BALLS.mean(axis=0) + 3.0 * rng.normal(size=3)
        for _ in range(4):  # a person jogs until the target sits in its ball
            design = BoundModel(saved.model, replace(at, joints=joints))
            columns = design.frames(saved.estimate, ROBOT.joint_slots).velocities(ROBOT.joint_slots)
            columns = columns.transpose(2, 1, 0)
            joints = joints + np.einsum("nja,na->nj", np.linalg.pinv(columns), place - held(joints)[:, :3, 3])
        sat = planned(saved, would.header, replace(visits, joints=joints))
        return replace(sat, points=balls)
    frames = held(joints)
    if would.spanned.all():
        ends = np.array(
            [
                [v + truth.get(f"{b}.{k}", 0.0) for v, k in zip(BASE_TARGETS[b], "xyz", strict=True)]
                for b in at.anchor_names
            ]
        )
        lengths = np.linalg.norm(frames[:, :3, 3] - ends[at.anchor], axis=1)
        return replace(would, lengths=lengths + noise.length_mm * rng.normal(size=n))
    out = replace(would, points=frames[:, :3, 3] + noise.sigma_mm * rng.normal(size=(n, 3)))
    if would.turned.any():
        felt = Rotation.from_rotvec(noise.rotation * rng.normal(size=(n, 3))) * Rotation.from_matrix(
            frames[:, :3, :3]
        )
        out = replace(out, orientation=felt.as_quat(scalar_first=True))
    return out


def found(seen: WhitenedReadings, plan_of: WatchPlan) -> bool:
    """Return whether an alarm is raised at the limit of the plan."""
    whiten, odds = odds_of(seen)
    return bool(odds.p_values((whiten @ seen.residual)[None]).min() < plan_of.shown.limit)


def run(count: int = 500) -> bool:
    """Print for each way the false alarms and the detected changes among `count` watches.

    The changes have the size that the plan promises to detect.
    """
    good = True
    for way in WAYS:
        alarms, seen = [], []
        for arm in range(ARMS):
            rng = np.random.default_rng([arm, 77])
            campaign = simulate(way.kind, 300 + arm)
            saved = as_saved(identify(campaign.data))
            drawn, balls = candidates(way, rng)
            header = header_of(way.kind)
            chosen = plan(saved, header, drawn, POSES, RATE, times=way.rounds, frame_known=way.frame_known)
            at = np.tile(balls[list(chosen.chosen)], (way.rounds, 1))
            would = planned(saved, header, chosen.visits)
            sizes = {
                c.label: c.size * DEG
                for c in chosen.shown.causes
                if c.label.startswith(("joint_step", "backlash"))
            }
            for i in range(count // ARMS):
                label = list(sizes)[i % len(sizes)]
                for changes, kept in (({}, alarms), ({label: sizes[label]}, seen)):
                    data = measured(way, campaign, saved, chosen.visits, would, at, changes, rng)
                    kept.append(found(WhitenedReadings.of(saved, data, frame_known=way.frame_known), chosen))
        rate, share = float(np.mean(alarms)), float(np.mean(seen))
        good &= 0.005 <= rate <= 0.015
        line(
            f"{way.name}: false alarms, of {len(alarms)}",
            f"{rate:.1%}",
            "1 % +- 0.5 %",
            0.005 <= rate <= 0.015,
        )
        near = abs(share - SEEN) < 0.03
        good &= near
        line(f"{way.name}: seen at the promised size, of {len(seen)}", f"{share:.1%}", "95 % +- 3 %", near)
    return good
