"""The closed loop: measure, find what the model lacks, correct targets, drive them, measure where the robot lands.

    campaign 1 -> data set -> diagnosis -> corrected targets of new poses -> campaign 2 -> verification

Every step is a function of the one before; `close_loop` runs them. The same clock serves both campaigns, so that a
drift goes on where it was. Corrections hold for an approach from one side, and for the time and the air temperature
at which the targets will be measured; where the model follows these, every pose is corrected just before it is driven.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from acquisition.campaign import FORMAT, Campaign, campaign_from
from acquisition.cell import Cell
from acquisition.clock import Clock
from acquisition.devices import Devices
from acquisition.errors import UnsafePlan
from acquisition.export import export
from acquisition.plan import DECIMALS
from acquisition.poses import draw_poses
from acquisition.run import Outcome, Run
from acquisition.states import State
from acquisition.store import Event
from acquisition.verification import (
    Judged,
    Verification,
    expected_temperature,
    first_reading_s,
    judge,
    read_landings,
    verification_of,
    world_of,
)
from acquisition.workspace import above_table, outside_boxes, points_of_arm
from acquisition.world_frame import WorldFrame
from calib.compensate import Correction, StatedConditions, correct
from calib.dataset import Dataset, read_dataset
from calib.diagnose.diagnosis import Diagnosis, diagnose
from calib.kinematics import Array
from calib.units import DEG

APPROACH_DEG = -5.0  # from below on every joint (Nubiola 2.5): the condition for which corrections hold
FEW = 1  # poses that are corrected at once where the model follows time or temperature
_FOLLOWS_MM = 0.002  # movement within a quarter of an hour or 0.3 K below which it does not
_NEW_POSES = 77  # random stream, beside those of the plan

Guard = Callable[[Run], AbstractContextManager[None]]
Say = Callable[[str], None]
Listen = Callable[[Run], Callable[[Event], None]]


class LoopEnded(Exception):
    """A campaign of the loop was paused, stopped or failed. `outcome` says how; its record can be resumed."""

    def __init__(self, outcome: Outcome) -> None:
        super().__init__(outcome.reason)
        self.outcome = outcome


@dataclass(frozen=True)
class Equipment:
    """What the loop works with. `guard` is entered around every execution, `listen` hears its events."""

    cell: Cell
    devices: Devices
    clock: Clock
    simulated: bool = False
    guard: Guard = lambda run: nullcontext()
    listen: Listen = lambda run: lambda event: None


@dataclass(frozen=True)
class Measured:
    """A finished campaign: its record, and when it began on the loop's clock, s."""

    record: Path
    began_s: float


@dataclass(frozen=True)
class Targets:
    """Wanted and corrected joint angles (k, N), deg, row by row; and why others were refused."""

    wanted: Array
    corrected: Array
    refused: tuple[str, ...] = ()


@dataclass(frozen=True)
class LoopResult:
    """What the loop found and proved."""

    data: Path
    diagnosis: Diagnosis
    targets: Targets
    verification: Verification


def close_loop(
    equipment: Equipment, campaign: Campaign, folder: Path, *, poses: int = 20, say: Say = lambda step: None
) -> LoopResult:
    """Run the whole loop; records in `folder`/campaign1, campaign2, ...; data set in `folder`/data.csv.

    poses: how many new poses verify the correction. Raises LoopEnded when a campaign ends early, DataError when
    the readings cannot be used, ConfigError or UnsafePlan before anything moves.
    """
    say("campaign 1: calibration and validation poses")
    first = measure(equipment, campaign, folder / "campaign1")
    data = export(first.record, folder / "data.csv")
    dataset = read_dataset(data)
    diagnosis = diagnose(dataset, progress=say)
    say("campaign 2: driving corrected targets")
    return verify(equipment, campaign, folder, first, data, diagnosis, poses)


def measure(equipment: Equipment, campaign: Campaign, record: Path) -> Measured:
    """Measure one campaign from beginning to end. Raises LoopEnded, ConfigError, UnsafePlan, RecordError."""
    with (
        Run.create(record, equipment.cell, campaign, simulated=equipment.simulated) as run,
        equipment.guard(run),
    ):
        began_s = equipment.clock.now()
        outcome = run.execute(equipment.devices, equipment.clock, equipment.listen(run))
    if outcome.state is not State.SUCCEEDED:
        raise LoopEnded(outcome)
    return Measured(record, began_s)


def verify(
    equipment: Equipment,
    campaign: Campaign,
    folder: Path,
    first: Measured,
    data: Path,
    diagnosis: Diagnosis,
    poses: int,
) -> LoopResult:
    """Drive corrected targets of new poses, and the same uncorrected, and judge where the robot landed."""
    dataset = diagnosis.dataset
    world = world_of(first.record)
    wanted, refused = new_targets(equipment, campaign, dataset, diagnosis, first, poses)
    size = FEW if follows_conditions(dataset, diagnosis, wanted) else len(wanted)
    batches: list[Judged] = []
    sent: list[Array] = []
    last = first
    for number, begin in enumerate(range(0, len(wanted), size), start=2):
        goals = wanted[begin : begin + size]
        stated = conditions_soon(equipment, dataset, first, last)
        joints = np.round(correction(equipment.cell, diagnosis, goals, stated).joints / DEG, DECIMALS)
        keep = np.all(np.isfinite(joints), axis=1) & clear(equipment.cell, joints)
        refused += ["the temperature moved it out of reach"] * int(np.sum(~keep))
        goals, joints = goals[keep], joints[keep]
        if not len(goals):
            continue
        second = measure(equipment, campaign_of(campaign, joints, goals), folder / f"campaign{number}")
        batches.append(_judged(equipment, second, first, joints, goals, diagnosis, world))
        sent.append(np.hstack([goals, joints]))
        last = second
    if not sent:
        raise UnsafePlan(f"none of {len(wanted)} corrected targets can be driven: {refused[-1]}")
    both = np.vstack(sent)
    half = both.shape[1] // 2
    verification = verification_of(batches, len(both), refused, f"{APPROACH_DEG:g} deg on every joint")
    return LoopResult(data, diagnosis, Targets(both[:, :half], both[:, half:], tuple(refused)), verification)


def _judged(
    equipment: Equipment,
    second: Measured,
    first: Measured,
    joints: Array,
    goals: Array,
    diagnosis: Diagnosis,
    world: WorldFrame,
) -> Judged:
    wanted = {tuple(q.tolist()): tuple(goal.tolist()) for q, goal in zip(joints, goals, strict=True)}
    later_s = second.began_s - first.began_s
    landings = read_landings(second.record)
    return judge(landings, wanted, diagnosis.dataset, diagnosis.final, world, equipment.cell, later_s)


def new_targets(
    equipment: Equipment,
    campaign: Campaign,
    dataset: Dataset,
    diagnosis: Diagnosis,
    first: Measured,
    poses: int,
) -> tuple[Array, list[str]]:
    """Joint angles (k, N), deg, of random new poses whose correction can be driven, and why others cannot.

    Raises UnsafePlan when not one can.
    """
    rng = np.random.default_rng([campaign.seed, _NEW_POSES])
    drawn = draw_poses(equipment.cell, 2 * poses, rng, APPROACH_DEG, both=False, decimals=DECIMALS)
    goals = np.array([joints for joints, _ in drawn])
    done = correction(equipment.cell, diagnosis, goals, conditions_soon(equipment, dataset, first, first))
    near_table = done.good & ~clear(equipment.cell, np.where(done.good[:, None], done.joints / DEG, goals))
    good = done.good & ~near_table
    last = int(np.flatnonzero(good)[:poses][-1]) if good.any() else -1
    reasons = [r for r in done.reasons[: last + 1] if r]
    reasons += ["its correction comes too close to table or boxes"] * int(near_table[: last + 1].sum())
    if last < 0:
        raise UnsafePlan(f"none of {len(goals)} new poses can be corrected: {reasons[0] if reasons else ''}")
    return goals[good][:poses], reasons


def conditions_soon(
    equipment: Equipment, dataset: Dataset, first: Measured, last: Measured
) -> StatedConditions:
    """The conditions at which the next targets will be measured, judged by the campaign before, `last`.

    Time on the clock of campaign 1; air temperature by the trend of the last readings.
    """
    lead_s = first_reading_s(last.record)
    soon_s = equipment.clock.now() + lead_s
    return StatedConditions(
        side=1.0,
        approach=-APPROACH_DEG * DEG,
        temperature_c=expected_temperature(last.record, soon_s - last.began_s, lead_s),
        time_s=soon_s - first.began_s,
        loads=dataset.header.loads,
        gravity=dataset.header.gravity,
    )


def correction(cell: Cell, diagnosis: Diagnosis, goals_deg: Array, stated: StatedConditions) -> Correction:
    """Corrections of joint targets (n, N), deg, within the cell's limits with room for the approach."""
    limits = np.array(cell.robot.limits_deg)
    room = 10.0**-DECIMALS  # what rounding may add
    limits = np.column_stack([limits[:, 0] - APPROACH_DEG + room, limits[:, 1] - room]) * DEG
    final = diagnosis.final
    return correct(final.model, final.estimate, goals_deg * DEG, stated, limits=limits)


def clear(cell: Cell, joints_deg: Array) -> Any:
    """(n,) whether arm and tool are clear of table and boxes, at the targets and at their approach points."""
    good = np.ones(len(joints_deg), dtype=bool)
    for stand in (joints_deg, joints_deg + APPROACH_DEG):
        points = points_of_arm(cell, np.nan_to_num(stand))
        good &= above_table(cell, points) & outside_boxes(cell, points)
    return good


def follows_conditions(dataset: Dataset, diagnosis: Diagnosis, goals_deg: Array) -> bool:
    """Whether the corrected joints depend on time or temperature more than a little."""
    stated = StatedConditions(temperature_c=22.0, time_s=3600.0, loads=dataset.header.loads)
    final, joints = diagnosis.final, goals_deg * DEG
    at = correct(final.model, final.estimate, joints, stated).joints
    for other in (replace(stated, temperature_c=22.3), replace(stated, time_s=4500.0)):
        moved = np.abs(correct(final.model, final.estimate, joints, other).joints - at)
        # An arm of half a metre turns an angle into a length.
        if 500.0 * float(np.nanmax(moved, initial=0.0)) > _FOLLOWS_MM:
            return True
    return False


def campaign_of(like: Campaign, corrected_deg: Array, wanted_deg: Array) -> Campaign:
    """Corrected targets first, then the same uncorrected; settle time, samples and retries as in `like`."""
    return campaign_from(
        {
            "format": FORMAT,
            "seed": like.seed,
            "approach": {"offset_deg": APPROACH_DEG, "sides": "one"},
            "settle_s": like.settle_s,
            "samples": like.samples,
            "retries": like.retries,
            "block": [_block(corrected_deg), _block(wanted_deg)],
        },
        "verification campaign",
    )


def _block(joints_deg: Array) -> dict[str, Any]:
    rows: Sequence[Sequence[float]] = joints_deg.tolist()
    return {"kind": "poses", "set": "validation", "select": "list", "joints_deg": rows}
