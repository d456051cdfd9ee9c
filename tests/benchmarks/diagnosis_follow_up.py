"""Ambiguous start with narrow poses, then the follow-up poses that the diagnosis chose.

All poses of the start lie within 35 % of every joint's range. If the diagnosis is ambiguous, its follow-up poses
are measured in the same world, after all other readings, and all readings together are diagnosed again.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from calib.array import Array
from calib.diagnose.diagnosis import DiagnosisFit, diagnose
from calib.diagnose.follow_up import FollowUp
from mocks.campaign import Campaign, plan
from mocks.world import ArmState, Robot, Session, World, scaled, stream
from mocks.world.dataset import row_of
from mocks.world.poses import random_pose
from mocks.world.world import POSE_STREAM
from tests.benchmarks.diagnosis_judge import Case, case_of
from tests.benchmarks.diagnosis_sets import TOOL, Draw, load, measured, narrow
from tests.benchmarks.diagnosis_truth import truth_of

SHARE = 0.35


def narrow_campaign(draw: Draw) -> Campaign:
    """A campaign within `SHARE` of every joint's range, about a pose that the robot can take."""
    mass_kg, cog_mm = TOOL.get(draw.robot, (None, None))
    session = Session(draw.n)
    world = World(draw.robot, draw.seed, session=session, tool_mass_kg=mass_kg, tool_cog_mm=cog_mm)
    rng = stream(draw.seed, POSE_STREAM)
    whole = world.robot
    world.robot = replace(whole, range_deg=_narrowed(whole, random_pose(whole, world.targets, rng)))
    sets = ["calibration"] * draw.n
    readings = plan(world, sets, True, draw.approach, rng)
    world.robot = whole
    world.effects = [scaled(world, world.draw_effect(label), readings, draw.size) for label in draw.labels]
    return measured(world, readings)


def _narrowed(robot: Robot, middle: tuple[float, ...]) -> tuple[tuple[float, float], ...]:
    """Ranges in deg of `SHARE` of the whole, with `middle` inside."""
    ranges = []
    for (low, high), q in zip(robot.range_deg, middle, strict=True):
        width = SHARE * (high - low)
        start = min(max(q - width / 2.0, low), high - width)
        ranges.append((start, start + width))
    return tuple(ranges)


def followed(campaign: Campaign, asked: FollowUp) -> Campaign:
    """The campaign with the follow-up poses measured behind it."""
    world, rows, readings = campaign.world, list(campaign.rows), list(campaign.readings)
    asked_for = zip(asked.joints, asked.sides, asked.approach, asked.targets, strict=True)
    for joints, side, approach, target in asked_for:
        pose = _degrees(joints)
        order = len(rows)
        t_s = (order + 1) * world.session.seconds
        t_air_c = round(world.air_c(t_s), 2)
        state = ArmState(
            pose, _degrees(joints - side * approach), (int(side),) * len(pose), t_s, t_air_c, order
        )
        readings.append((state, target))
        rows.append(row_of(world, order, "calibration", readings[-1]))
    return replace(campaign, rows=rows, readings=readings)


def _degrees(joints: Array) -> tuple[float, ...]:
    """Joint angles (N,) rad as a controller writes them."""
    return tuple(round(math.degrees(q), 3) for q in joints)


@dataclass(frozen=True)
class Followed:
    """Two diagnoses of one narrow start, and the procedures requested in addition to the poses.

    `apart` is the gap that as many poses over the whole ranges would have shown. If it is small, no pose
    distinguishes the effect.
    """

    before: Case
    after: Case
    procedures: tuple[str, ...]
    apart: float


def before_and_after(seed: int) -> Followed | None:
    """Diagnose a narrow start and its follow-up; return None if nothing is ambiguous at first."""
    draw = narrow(seed)
    try:
        campaign = narrow_campaign(draw)
    except ValueError:
        return None  # the effect moves nothing in these poses
    first, start = _diagnosed(draw, campaign)
    if start.verdict != "ambiguous" or start.follow_up is None:
        return None
    second, _ = _diagnosed(draw, followed(campaign, start.follow_up))
    return Followed(first, second, start.follow_up.procedures, _apart(draw, campaign.world))


def _apart(draw: Draw, world: World) -> float:
    """Gap of the hidden effect in poses over the whole ranges."""
    rng = stream(draw.seed, POSE_STREAM)
    wide = measured(world, plan(world, ["calibration"] * draw.n, True, draw.approach, rng))
    return truth_of(wide, load(wide)).effects[0].gap


def _diagnosed(draw: Draw, campaign: Campaign) -> tuple[Case, DiagnosisFit]:
    data = load(campaign)
    result = diagnose(data)
    return case_of(draw, truth_of(campaign, data), result), result
