"""The closed loop: measure, find unmodelled errors, correct new targets, verify them.

    campaign 1 -> data set -> diagnosis -> corrected targets of new poses -> campaign 2 -> verification
                             | ambiguous                                ^
                             v                                          |
               follow-up poses -> campaign -> data sets merged -> diagnosis

Every step is a function of the one before; `close_loop` runs them. The same clock serves all campaigns, so that a
drift continues where it was.

The corrected targets are the joints that a diagnosis commands, if the cell can take them. A correction is valid for an
approach from one side, and for the time and the air temperature of its measurement. If the model follows time or
temperature, every pose is corrected just before it is driven; a pose that an interruption has caught is corrected, and
checked, again. Whether a pause, a crash or the end of a program interrupted it makes no difference. Angles in deg.

With a ballbar the new poses are stances of its legs (`loop.leg_verification`), and there are no follow-up poses.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from acquisition.campaign.blocks.block import Approach
from acquisition.campaign.blocks.legs import LegsBlock
from acquisition.campaign.blocks.poses import PosesBlock
from acquisition.campaign.campaign import FORMAT, Campaign, campaign_from, campaign_of_record
from acquisition.campaign.plan import DECIMALS
from acquisition.campaign.poses import draw_poses
from acquisition.cell.cell import Cell
from acquisition.cell.devices import Devices
from acquisition.cell.robot_section import RobotSection
from acquisition.cell.transit import may_visit
from acquisition.errors import UnsafePlan
from acquisition.loop.follow_up_campaign import campaign_table, in_cell
from acquisition.loop.leg_verification import judge_legs, new_stances, stances_near
from acquisition.record.database import is_begun
from acquisition.record.device_serials import Individual, individuals_of, series_among
from acquisition.record.export import export, table_of
from acquisition.record.merge import CampaignPart, frame_of_part, merge
from acquisition.record.states import State
from acquisition.record.store import Event, RecordStore
from acquisition.record.verification import (
    JudgedLandings,
    Verification,
    expected_temperature,
    first_reading_s,
    judge,
    read_landings,
    verification_of,
    world_of,
)
from acquisition.run.clock import Clock
from acquisition.run.duration import Begin, at_once
from acquisition.run.orders.lease import LeaseDeadline
from acquisition.run.outcome import ExecutionOutcome
from acquisition.run.run import Run
from acquisition.run.status import RunStatus, read_status
from calib.array import Array
from calib.compensate import Bounds, Correction, correct, refuse_unlikely
from calib.data import read_dataset
from calib.diagnose import DiagnosisFit, FollowUp, diagnose
from calib.model import FLANGE, ModelStructure, StatedConditions, series_of
from calib.saved import CalibratedModel, as_saved, refuse_worse
from calib.units import DEG

FEW = 1  # poses that are corrected at once if the model follows time or temperature
_NEW_POSES = 77  # random stream, in addition to those of the plan
Create = Callable[[Path, Cell, Campaign, bool], AbstractContextManager[Run]]
Guard = Callable[[Run], AbstractContextManager[None]]
Say = Callable[[str], None]
Listen = Callable[[Run], Callable[[Event], None]]
Resumed = Callable[[Run, ExecutionOutcome], bool]
Compute = Callable[..., Any]
Diagnose = Callable[[Path, Say], DiagnosisFit]
APPROACH_DEG = -5.0  # from below on every joint (Nubiola 2.5): the condition for which corrections are valid
_APPROACH = Approach(offset_deg=APPROACH_DEG, sides="one")
_LEVER_MM = 500.0  # that turns an angle into a length
AGAIN = "verification: what an interruption has caught is corrected again"
_LOOP = "the loop"
_OLD = "Its targets were corrected for a time before an interruption; they are driven corrected again."
_FOLLOWS_MM = 0.002  # movement within a quarter of an hour or 0.3 K below which it does not


def here(function: Callable[..., Any], *args: object) -> Any:
    """Call the function in this process and return its value."""
    return function(*args)


def diagnosed(data: Path, say: Say = lambda step: None) -> DiagnosisFit:
    """Diagnose a data set.

    Raises
    ------
    DataError
        The data cannot be used.
    """
    return diagnose(read_dataset(data), progress=say)


def new_run(record: Path, cell: Cell, campaign: Campaign, simulated: bool) -> Run:
    """Create a campaign of the loop in its own record, with the errors of `Run.create`."""
    return Run.create(record, cell, campaign, simulated=simulated)


class LoopEnded(Exception):
    """A campaign of the loop was paused, stopped or failed.

    `outcome` has the state and the reason; the record can be resumed.
    """

    def __init__(self, outcome: ExecutionOutcome) -> None:
        super().__init__(outcome.reason)
        self.outcome = outcome


@dataclass(frozen=True)
class Equipment:
    """The equipment of a loop.

    Attributes
    ----------
    guard
        Context that is entered around every execution.
    listen
        Returns a listener for the events of a run.
    lease
        Returns the lease under which the robot moves.
    create
        Creates the record of a campaign at the folder that the loop proposes, or opens the one that is there.
    place
        Returns the folder where `create` puts the record that the loop proposes.
    rests
        Counts how often the loop has rested for a person, also between two campaigns.
    resumed
        Called when a campaign was paused; it waits for a person, who resumes the run. False ends the loop.
    compute
        Calls functions of a module that take seconds; in another process if a person must be served meanwhile.
    diagnose
        Makes the diagnosis, which takes minutes; in another process likewise.
    confirm
        Asks a person whether the motion that a text describes may begin. False ends the loop.
    begin
        Begins computations from the record of a campaign; in another process likewise.
    """

    cell: Cell
    devices: Devices
    clock: Clock
    simulated: bool = False
    guard: Guard = lambda run: nullcontext()
    listen: Listen = lambda run: lambda event: None
    lease: Callable[[], LeaseDeadline | None] = lambda: None
    create: Create = new_run
    place: Callable[[Path], Path] = lambda record: record
    rests: Callable[[], int] = lambda: 0
    resumed: Resumed = lambda run, outcome: False
    compute: Compute = here
    diagnose: Diagnose = diagnosed
    begin: Begin = at_once
    confirm: Callable[[str], bool] = lambda motion: True


@dataclass(frozen=True)
class MeasuredCampaign:
    """A finished campaign: its record, and when it began on the loop's clock, s."""

    record: Path
    began_s: float


@dataclass(frozen=True)
class Targets:
    """Target and corrected joint angles, both (k, N), deg, row by row.

    `refused` lists the reasons why others were refused.
    """

    wanted: Array
    corrected: Array
    refused: tuple[str, ...] = ()


@dataclass(frozen=True)
class FollowUpResult:
    """The result of a follow-up: the ambiguous diagnosis, the poses, the number of readings."""

    before: DiagnosisFit
    poses: FollowUp
    readings: int


@dataclass(frozen=True)
class LoopResult:
    """The results of a loop.

    `followed_up` is None if the diagnosis was not ambiguous, or no pose would have helped. `accuracy` is that of the
    status of the first campaign.
    """

    data: Path
    diagnosis: DiagnosisFit
    targets: Targets
    verification: Verification
    followed_up: FollowUpResult | None
    accuracy: dict[str, Any] | None = None


def close_loop(
    equipment: Equipment, campaign: Campaign, folder: Path, *, poses: int = 20, say: Say = lambda step: None
) -> LoopResult:
    """Run the whole loop.

    The records are in `folder`/campaign1, campaign2, ..., the data set is `folder`/data.csv. Follow-up poses are
    recorded in `folder`/campaign_follow_up; data.csv then holds both campaigns, data1.csv the first alone. The
    correction is verified at `poses` new poses.

    Raises
    ------
    LoopEnded
        A campaign ended early.
    DataError
        The readings cannot be used, or on held-out readings the model is worse than the nominal robot.
    ConfigError, UnsafePlan
        A campaign cannot be planned in the cell, or no new pose can be corrected.
    """
    say("campaign 1: calibration and validation poses")
    first = measure(equipment, campaign, folder / "campaign1")
    data: Path = equipment.compute(export, first.record, folder / "data.csv")
    diagnosis = equipment.diagnose(data, say)
    last, followed_up = first, None
    planned: FollowUp | None = equipment.compute(follow_up_of, equipment.cell, diagnosis)
    if planned is not None:
        say(f"follow-up: {len(planned.joints)} poses that distinguish {_rivals_in_words(planned)}")
        last = measure(
            equipment,
            campaign_from(campaign_table(planned, campaign), "follow-up campaign"),
            folder / "campaign_follow_up",
            like=first,
        )
        alone = len(diagnosis.dataset)
        data = equipment.compute(join, equipment.cell, first, last, folder)
        before, diagnosis = diagnosis, equipment.diagnose(data, say)
        followed_up = FollowUpResult(before, planned, len(diagnosis.dataset) - alone)
    refuse_worse(*diagnosis.gain, file=data, use=", then measure again")
    motion = f"drives {poses} new poses with corrected targets"
    if not equipment.cell.instrument.declared.measures_lengths:
        motion += ", and the same poses uncorrected"
    if not equipment.confirm(motion):
        raise LoopEnded(ExecutionOutcome(State.PAUSED, "The corrected targets were not driven."))
    say("campaign 2: driving corrected targets")
    saved = as_saved(diagnosis.final, diagnosis)
    targets, verification = verify(
        equipment, campaign, folder, saved, first, last, poses, say, diagnosis=diagnosis
    )
    accuracy = read_status(first.record).accuracy
    return LoopResult(data, diagnosis, targets, verification, followed_up, accuracy)


def follow_up_of(cell: Cell, diagnosis: DiagnosisFit) -> FollowUp | None:
    """Choose the poses of a cell that distinguish the rivals of a diagnosis.

    Returns None if there are no rivals, no pose helps, or a ballbar measures, for which poses would have to be stances.

    Raises
    ------
    ConfigError
        Hardly any pose is clear.
    """
    if diagnosis.follow_up is None or cell.instrument.declared.measures_lengths:
        return None
    planned = in_cell(cell, diagnosis.final, diagnosis.follow_up.rivals)
    return planned if planned.helps else None


def join(cell: Cell, first: MeasuredCampaign, later: MeasuredCampaign, folder: Path) -> Path:
    """Join a first campaign and its follow-up in one data set, `folder`/data.csv.

    The file data1.csv keeps the first campaign alone.
    """
    world = world_of(first.record)
    alone, added = table_of(first.record), table_of(later.record)
    alone.write(folder / "data1.csv")
    added.write(folder / "data_follow_up.csv")
    own = frame_of_part(later.record, world, cell.nests, individuals_of(first.record))
    part = CampaignPart(added, later.began_s - first.began_s, own)
    return merge(alone, world, [part]).write(folder / "data.csv")


def _rivals_in_words(planned: FollowUp) -> str:
    pairs = [f"{label} and {rival}" for label, rival in planned.separations]
    more = len(pairs) - 1
    return pairs[0] + (f" (and {more} other pair{'s' if more > 1 else ''})" if more else "")


def measure(
    equipment: Equipment, campaign: Campaign, record: Path, like: MeasuredCampaign | None = None
) -> MeasuredCampaign:
    """Measure one campaign from beginning to end, with the robot and the instrument of `like`.

    A record that an earlier program has begun is continued; a finished one is used as it is.

    Raises
    ------
    LoopEnded
        The campaign did not succeed.
    ConfigError, UnsafePlan
        The campaign does not fit the cell or its devices.
    RecordError
        The record cannot be written.
    """
    measured = _measured(equipment, campaign, record, like, rests=None)
    assert measured is not None
    return measured


def _measured(
    equipment: Equipment, campaign: Campaign, record: Path, like: MeasuredCampaign | None, rests: int | None
) -> MeasuredCampaign | None:
    """Measure as `measure` does, but abandon targets that have become old.

    They are old if the count of rests is no longer `rests`. The run is then stopped, and None returned. With None they
    cannot become old.
    """
    with equipment.create(record, equipment.cell, campaign, equipment.simulated) as run:
        age_s = run.age_s(equipment.clock)
        if like is not None and not age_s:
            run.expect(list(individuals_of(like.record).values()))
        began_s = equipment.clock.now() - age_s
        stale = rests is not None and equipment.rests() != rests
        outcome = ExecutionOutcome(State.PAUSED, _OLD) if stale else _executed(equipment, run)
        while not stale and outcome.state is State.PAUSED and equipment.resumed(run, outcome):
            stale = rests is not None
            outcome = outcome if stale else _executed(equipment, run)
        if stale:
            run.stop(by=_LOOP, reason=_OLD)
            return None
        measured = MeasuredCampaign(run.folder, began_s)
    if outcome.state is not State.SUCCEEDED:
        raise LoopEnded(outcome)
    return measured


def _executed(equipment: Equipment, run: Run) -> ExecutionOutcome:
    """Execute a run, unless an earlier program has, or somebody has finished it while it rested."""
    if run.status().state == State.SUCCEEDED.value:
        return ExecutionOutcome(State.SUCCEEDED, "")
    with equipment.guard(run):
        return run.execute(
            equipment.devices,
            equipment.clock,
            equipment.listen(run),
            lease=equipment.lease(),
            begin=equipment.begin,
        )


def verify(
    equipment: Equipment,
    campaign: Campaign,
    folder: Path,
    saved: CalibratedModel,
    first: MeasuredCampaign,
    last: MeasuredCampaign,
    poses: int,
    say: Say,
    *,
    since_s: float = 0.0,
    diagnosis: DiagnosisFit | None = None,
) -> tuple[Targets, Verification]:
    """Drive corrected targets of new poses, and the same uncorrected, and judge the landings.

    Parameters
    ----------
    campaign
        Seed of the poses; settle time, samples and retries of the readings; the robot that is needed.
    saved
        The whole model; its terms that need a campaign correct nothing.
    first, last
        The campaign that defines the world frame, and the one measured last.
    since_s
        Time on the clock of the model when `first` began, s; NaN if it is not known.
    diagnosis
        That of the calibration of which `first` is campaign 1. A ballbar needs its cups, balls and measured poses. None
        for an older model, which does not know how the instrument drifts: then every campaign is judged in the world
        frame of its own nests.

    Raises
    ------
    LoopEnded
        A campaign ended early.
    UnsafePlan
        No new pose can be corrected.
    DataError
        The model corrects more than is plausible, or needs a condition that is not known.
    """
    used, _ = saved.for_use()
    soon = conditions_soon(equipment, used, first, last, since_s)
    refuse_unlikely(used.model, used.estimate, soon, Bounds(), coupling=used.coupling)
    wanted: Array
    refused: list[str]
    wanted, refused = equipment.compute(
        new_targets, equipment.cell, campaign.seed, used, soon, poses, diagnosis
    )
    follows = follows_conditions(equipment.cell, used, wanted)
    size = FEW if follows else len(wanted)
    if follows:  # those measured before an interruption come first: at another time others can be corrected
        wanted = _measured_first(equipment, folder, wanted, diagnosis)
    devices = individuals_of(first.record)
    batches: list[JudgedLandings] = []
    accepted: dict[str, None] = {}
    sent: list[Array] = []
    begin, number = 0, 1
    while begin < len(wanted):
        number += 1
        goals, record = wanted[begin : begin + size], folder / f"campaign{number}"
        begun, rests = targets_of_record(equipment.place(record)), equipment.rests()
        status = None if begun is None else read_status(equipment.place(record))
        if status is not None and (status.finished_early or (follows and not _finished(status))):
            if not status.finished_early and status.reason != _OLD:
                with equipment.create(record, equipment.cell, campaign, equipment.simulated) as old:
                    old.stop(by=_LOOP, reason=_OLD)
                say(AGAIN)
            continue
        if begun is not None:  # by an earlier program
            joints, goals = begun[0], _goals_of(equipment.cell, begun, diagnosis)
            if not follows:
                say(f"verification: going on with the {len(goals)} new poses with which it began")
        else:
            stated = conditions_soon(equipment, used, first, last, since_s)
            done = equipment.compute(correction, equipment.cell, used, goals, stated)
            joints = np.round(done.joints / equipment.cell.robot.model.joint_units, DECIMALS)
            keep = np.all(np.isfinite(joints), axis=1) & clear(equipment.cell, joints)
            refused += ["the temperature moved it out of reach"] * int(np.sum(~keep))
            goals, joints = goals[keep], joints[keep]
        if not len(goals):
            begin, number = begin + size, number - 1  # no record is made
            continue
        corrected = campaign_of(campaign, joints, goals, _legs_at(equipment.cell, diagnosis, goals))
        may_age = follows and begun is None
        second = _measured(equipment, corrected, record, last, rests if may_age else None)
        if second is None:
            say(AGAIN)
            continue
        later_s = float(np.nan_to_num(since_s)) + second.began_s - first.began_s
        framed = second if diagnosis is None else first
        batches.append(
            _judged(second, framed, joints, goals, saved, equipment.cell, later_s, devices, diagnosis)
        )
        for each in individuals_of(second.record).values():
            if each.reason:
                accepted[each.why()] = None
        sent.append(np.hstack([goals, joints]))
        last = second
        begin += size
    if not sent:
        raise UnsafePlan(f"none of {len(wanted)} corrected targets can be driven: {refused[-1]}")
    both = np.vstack(sent)
    half = both.shape[1] // 2
    approach = f"{APPROACH_DEG:g} deg on every joint"
    verification = verification_of(batches, len(both), refused, approach, list(accepted))
    return Targets(both[:, :half], both[:, half:], tuple(refused)), verification


def _finished(status: RunStatus) -> bool:
    """Return whether all poses of a campaign were measured: a part of them proves nothing."""
    return status.state == State.SUCCEEDED.value and not status.finished_early


def _goals_of(cell: Cell, begun: tuple[Array, Array | None], diagnosis: DiagnosisFit | None) -> Array:
    """Return the poses (k, N), deg, that a record drives corrected; of legs it has only the corrected joints."""
    joints, goals = begun
    if goals is None:
        assert diagnosis is not None
        goals = stances_near(cell, diagnosis, _APPROACH, joints)[0]
    return goals


def _measured_first(
    equipment: Equipment, folder: Path, wanted: Array, diagnosis: DiagnosisFit | None
) -> Array:
    """Return as many poses as `wanted`, (k, N), deg, first those of finished campaigns."""
    done: list[Array] = []
    number = 2
    while (begun := targets_of_record(record := equipment.place(folder / f"campaign{number}"))) is not None:
        done += [_goals_of(equipment.cell, begun, diagnosis)] if _finished(read_status(record)) else []
        number += 1
    if not done:
        return wanted
    first = np.vstack(done)
    new = ~np.any(np.all(np.isclose(wanted[:, None], first[None]), axis=2), axis=1)
    return np.vstack([first, wanted[new]])[: len(wanted)]


def _judged(
    second: MeasuredCampaign,
    framed: MeasuredCampaign,
    joints: Array,
    goals: Array,
    saved: CalibratedModel,
    cell: Cell,
    later_s: float,
    devices: Mapping[str, Individual],
    diagnosis: DiagnosisFit | None,
) -> JudgedLandings:
    wanted = {tuple(q.tolist()): tuple(goal.tolist()) for q, goal in zip(joints, goals, strict=True)}
    if cell.instrument.declared.measures_lengths:
        assert diagnosis is not None
        return judge_legs(second.record, wanted, cell, diagnosis)
    return judge(read_landings(second.record), wanted, saved, world_of(framed.record), cell, later_s, devices)


def _legs_at(cell: Cell, diagnosis: DiagnosisFit | None, goals_deg: Array) -> list[list[tuple[str, str]]]:
    """Return the legs to be measured at each goal; none if points are measured."""
    if not cell.instrument.declared.measures_lengths:
        return []
    assert diagnosis is not None
    return stances_near(cell, diagnosis, _APPROACH, goals_deg)[1]


def new_targets(
    cell: Cell,
    seed: int,
    used: CalibratedModel,
    stated: StatedConditions,
    poses: int,
    diagnosis: DiagnosisFit | None = None,
) -> tuple[Array, list[str]]:
    """Draw new poses whose correction can be driven.

    `stated` are the conditions at which they will be measured, `diagnosis` is as in `verify`. Returns their joint
    angles (k, N), deg, and the reasons why others were refused.

    Raises
    ------
    UnsafePlan
        No pose can be corrected.
    """
    rng = np.random.default_rng([seed, _NEW_POSES])
    if cell.instrument.declared.measures_lengths:
        assert diagnosis is not None
        goals = new_stances(cell, diagnosis, _APPROACH, rng, 2 * poses)
    else:
        drawn = draw_poses(cell, 2 * poses, rng, APPROACH_DEG, both=False, decimals=DECIMALS)
        goals = np.array([pose.joints_deg for pose in drawn])
    done = correction(cell, used, goals, stated)
    corrected = done.joints / cell.robot.model.joint_units
    near_table = done.good & ~clear(cell, np.where(done.good[:, None], corrected, goals))
    good = done.good & ~near_table
    end = int(np.flatnonzero(good)[:poses][-1]) if good.any() else -1
    reasons = [r for r in done.reasons[: end + 1] if r]
    reasons += ["its correction comes too close to table or boxes"] * int(near_table[: end + 1].sum())
    if end < 0:
        raise UnsafePlan(f"none of {len(goals)} new poses can be corrected: {reasons[0] if reasons else ''}")
    return goals[good][:poses], reasons


def conditions_soon(
    equipment: Equipment,
    used: CalibratedModel,
    first: MeasuredCampaign,
    last: MeasuredCampaign,
    since_s: float,
) -> StatedConditions:
    """Predict the conditions at which the next targets will be measured.

    The time is on the clock of the model, `since_s` s when campaign 1 began. The air temperature follows the trend of
    the last readings of `last`, the campaign before.
    """
    lead_s = first_reading_s(last.record)
    soon_s = equipment.clock.now() + lead_s
    return StatedConditions(
        series=series_among(used.model.targets, individuals_of(last.record)),
        side=1.0,
        approach=-APPROACH_DEG * DEG,
        temperature_c=expected_temperature(last.record, soon_s - last.began_s, lead_s),
        time_s=since_s + soon_s - first.began_s,
        loads=used.loads,
        gravity=used.gravity,
    )


def correction(cell: Cell, used: CalibratedModel, goals_deg: Array, stated: StatedConditions) -> Correction:
    """Correct joint targets (n, N), deg or mm, within the cell's limits.

    The limits leave space for the approach. Targets and corrected joints are the controller's; the sides of `stated`
    are replaced by those of the approach.
    """
    robot, limits = cell.robot, np.array(cell.robot.limits_deg)
    units = cell.robot.model.joint_units
    room = 10.0**-DECIMALS  # the largest effect of rounding
    limits = np.column_stack([limits[:, 0] - APPROACH_DEG + room, limits[:, 1] - room]) * units[:, None]
    done = correct(
        used.model,
        used.estimate,
        robot.model_angles(goals_deg),
        _approached(robot, stated),
        target=_landing(used.model, stated),
        limits=limits,
        coupling=robot.coupling,
        regression=used.regression,
    )
    return replace(done, joints=robot.model.controller_angles(done.joints, robot.coupling))


def _landing(model: ModelStructure, stated: StatedConditions) -> str:
    """Choose the frame that is brought to its nominal place: the flange, and every target on it.

    An arm of fewer than six joints cannot correct every tilt of the flange. If it has only one target, the frame is
    then that target.
    """
    names = tuple(model.targets[series_of(model, stated)])
    return names[0] if model.robot.joints < 6 and len(names) == 1 else FLANGE


def _approached(robot: RobotSection, stated: StatedConditions) -> StatedConditions:
    """Return the conditions of the approach, with the last moves of the model's joints.

    Every joint of the controller arrives from `APPROACH_DEG`.
    """
    zero = np.zeros((1, robot.model.joints))
    moves = (robot.model_angles(zero) - robot.model_angles(zero + APPROACH_DEG))[0]
    return replace(stated, side=tuple(np.sign(moves)), approach=tuple(np.abs(moves)))


def clear(cell: Cell, joints_deg: Array) -> NDArray[np.bool_]:
    """Check that targets, their approach points, and the moves from and to home are clear."""
    joints = np.nan_to_num(joints_deg)
    return may_visit(cell, joints, joints + APPROACH_DEG)


def follows_conditions(cell: Cell, used: CalibratedModel, goals_deg: Array) -> bool:
    """Check whether the corrected joints depend noticeably on time or temperature."""
    model, robot = used.model, cell.robot
    stated = StatedConditions(
        series=next(iter(model.targets)), temperature_c=22.0, time_s=3600.0, loads=used.loads
    )
    joints = robot.model_angles(goals_deg)
    lever = np.where([kind == "slides" for kind in robot.model.kinds], 1.0, _LEVER_MM)
    at = correct(model, used.estimate, joints, stated).joints
    for other in (replace(stated, temperature_c=22.3), replace(stated, time_s=4500.0)):
        moved = np.abs(correct(model, used.estimate, joints, other).joints - at) * lever
        if float(np.nanmax(moved, initial=0.0)) > _FOLLOWS_MM:
            return True
    return False


def campaign_of(
    like: Campaign, corrected_deg: Array, wanted_deg: Array, legs: Sequence[Sequence[tuple[str, str]]] = ()
) -> Campaign:
    """Create a campaign of the corrected targets, followed by the same uncorrected, or only with the legs of each.

    Settle time, samples, retries and the robot that is needed are those of `like`.
    """
    of_legs = {"kind": "legs", "set": "validation", "joints_deg": corrected_deg.tolist(), "legs": legs}
    return campaign_from(
        {
            "format": FORMAT,
            "seed": like.seed,
            "approach": {"offset_deg": APPROACH_DEG, "sides": "one"},
            "settle_s": like.settle_s,
            "samples": like.samples,
            "retries": like.retries,
            **({"zero_every": like.zero_every} if legs else {}),
            **({"robot": dict(like.robot)} if like.robot else {}),
            "block": [of_legs] if legs else [_block(corrected_deg), _block(wanted_deg)],
        },
        "verification campaign",
    )


def targets_of_record(record: Path) -> tuple[Array, Array | None] | None:
    """Return the corrected and the wanted joints (k, N), deg, of a verification that was begun; None without one.

    Those of legs are wanted at the stances nearest to the corrected ones, and are not in the record.
    """
    if not is_begun(record):
        return None
    with RecordStore.reading(record) as store:
        campaign = campaign_of_record(store.campaign["campaign"], str(record))
    of_legs = next((block for block in campaign.blocks if isinstance(block, LegsBlock)), None)
    if of_legs is not None:
        return np.array(of_legs.joints_deg), None
    corrected, wanted = (
        np.array(block.joints_deg) for block in campaign.blocks if isinstance(block, PosesBlock)
    )
    return corrected, wanted


def _block(joints_deg: Array) -> dict[str, Any]:
    rows: Sequence[Sequence[float]] = joints_deg.tolist()
    return {"kind": "poses", "set": "validation", "select": "list", "joints_deg": rows}
