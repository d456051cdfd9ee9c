"""The campaign of a calibration from nominal to verified, and what it is expected to need and to reach.

An adaptive block measures until the accuracy is reached. Before it the reference pose is measured until the arm is
steady, in place of a fixed hour; the nests are checked while it runs. The outlook is reckoned from the poses that the
block would choose if the model held: nothing moves for it. Lengths mm, angles deg, times s.

With a ballbar, a person first measures the triangles of the balls and jogs the robot into the cups. There is no
reference pose, whose readings would need a person for hours: the arm is warm when the calibration begins.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from acquisition.campaign.blocks.adaptive import (
    BATCH,
    LEAST,
    first_of,
    numbers_in,
    pool_of,
    readings_in,
    seconds_to,
)
from acquisition.campaign.campaign import FORMAT, Campaign, campaign_from
from acquisition.campaign.plan import make_plan, site_of
from acquisition.cell.cell import Cell
from acquisition.loop.leg_verification import LEGS_VERIFIED
from acquisition.run.adaptive import MOUNTING_S, block_of, rest_s
from calib.selection import DECIDING, LEVEL, least_bound, model_limit
from drivers.errors import ConfigError

VERIFICATION = 10  # new poses on which the correction is verified, each driven corrected and uncorrected
_STEADY = 3.0  # RMS errors of a reading within which the readings of a steady arm lie
_WARM_UP: dict[str, Any] = {"over": 3, "every_s": 120.0, "at_most_s": 7200.0}
_NESTS_EVERY, _REFERENCE_EVERY = 90, 45  # readings
_NEST_S = 10.0
_TOUCH_S, _ZERO_S = 120.0, 120.0  # to jog the robot into a cup, and to build a bar and read its zero
_ZERO_EVERY = 60  # distances


@dataclass(frozen=True)
class Outlook:
    """What a calibration is expected to need and to reach.

    Attributes
    ----------
    poses, most
        Poses until the accuracy is reached, None if it is not expected within the `most` that may be used.
    targets
        Readings in each pose.
    mountings
        How often a person puts a ballbar between two balls, the verification included; 0 for another instrument.
    warm_up_minutes, measuring_minutes, verification_minutes
        Time of the parts of the calibration at the cell: until a steady arm is known to be steady, the poses, and the
        verification.
    least_minutes
        Time of warm-up and of the fewest poses after which a calibration may end.
    limit_mm
        Upper limit (95 %) of the RMS error of a reading in the zone after the calibration.
    floor_mm
        RMS of noise and repeatability in one reading, which no calibration lowers.
    """

    wanted_mm: float
    poses: int | None
    most: int
    targets: int
    mountings: int
    warm_up_minutes: float
    measuring_minutes: float
    verification_minutes: float
    least_minutes: float
    limit_mm: float
    floor_mm: float

    @property
    def minutes(self) -> float:
        """Time of the whole calibration at the cell."""
        return self.warm_up_minutes + self.measuring_minutes + self.verification_minutes

    def in_words(self) -> str:
        """Describe the outlook for the person who starts the calibration."""
        readings = f"{self.targets} reading{'s' if self.targets > 1 else ''} each"
        before = f"{self.warm_up_minutes:.0f} to see that a warm arm is steady (a cold one takes longer)"
        floor, are = "Noise and repeatability", "are"
        if self.mountings:
            readings = f"{self.targets} legs each"
            before = f"{self.warm_up_minutes:.0f} for the triangles and the cups, by a robot that is warm"
            floor, are = (
                f"The bar is mounted about {self.mountings} times. The repeatability of the robot",
                "is",
            )
        expected = f"The limit of the RMS error (95 %) is then expected to be {self.limit_mm:.3f} mm"
        if self.poses is None:
            first = (
                f"{self.wanted_mm:g} mm are not expected to be reached with {self.most} poses of {readings}"
            )
            last = f"{expected}."
        else:
            first = f"About {self.poses} poses with {readings}"
            last = f"{expected}, if the model describes the robot (required: {self.wanted_mm:g} mm)."
        return (
            f"{first}, about {self.minutes:.0f} minutes at the cell: {before}, {self.measuring_minutes:.0f} of "
            f"measuring, {self.verification_minutes:.0f} of verification. {last} {floor} alone {are} "
            f"{self.floor_mm:.3f} mm."
        )


def calibration_campaign(
    cell: Cell,
    *,
    accuracy_mm: float,
    minutes: float | None = None,
    zone: Mapping[str, Any] | None = None,
    zone_joints_deg: Sequence[Sequence[float]] | None = None,
    poses: int = VERIFICATION,
    seed: int = 1,
) -> tuple[Campaign, Outlook]:
    """Return the campaign that calibrates the robot of a cell, and its outlook.

    Parameters
    ----------
    accuracy_mm
        RMS error of a reading in the zone that is to be reached with 95 % confidence, mm.
    minutes
        Time for the whole calibration, verification included. Default: no limit.
    zone
        Box in the world in which the robot works: `x_mm`, `y_mm`, `z_mm`. Default: the workspace.
    zone_joints_deg
        Poses at which the robot works, in place of a box, deg.
    poses
        New poses on which the correction is verified.

    Raises
    ------
    ConfigError
        The accuracy cannot be reached, the zone is out of reach, the time is too short, or the cell has no triangles
        of balls for a ballbar.
    """
    lengths = cell.instrument.declared.measures_lengths
    block: dict[str, Any] = {"kind": "adaptive", "accuracy_mm": accuracy_mm}
    if cell.instrument.one_smr:
        block["targets"] = [max(cell.tool.targets, key=lambda name: np.hypot(*cell.tool.targets[name][:2]))]
    if zone is not None:
        block["zone"] = zone
    if zone_joints_deg is not None:
        block["zone_joints_deg"] = [list(row) for row in zone_joints_deg]
    table: dict[str, Any] = {
        "format": FORMAT,
        "seed": seed,
        "approach": {"offset_deg": -5.0, "sides": "both"},
        **({"zero_every": _ZERO_EVERY} if lengths else {"reference_every": _REFERENCE_EVERY}),
        "block": [{"kind": "ballbar_geometry", "touch_with": next(iter(cell.tool.targets))}, block]
        if lengths
        else [block],
    }
    outlook = outlook_of(cell, campaign_from(table, "calibration"), poses=poses)
    if not lengths:
        table["warm_up"] = _WARM_UP | {"below_mm": round(max(_STEADY * outlook.floor_mm, 0.02), 3)}
        table["nest_check"] = {
            "every": _NESTS_EVERY,
            "limit_mm": round(max(_STEADY * outlook.floor_mm, 0.05), 3),
        }
    if minutes is not None:
        least = outlook.verification_minutes + outlook.least_minutes
        if minutes < least:
            raise ConfigError(
                f"{minutes:g} minutes are too short: warm-up, {LEAST} poses and the verification of the correction "
                f"take about {np.ceil(least):.0f}",
                what_to_do=f"Give {np.ceil(least):.0f} minutes or more.",
            )
        block["minutes"] = round(minutes - outlook.verification_minutes, 2)
    return campaign_from(table, "calibration"), outlook


def outlook_of(cell: Cell, campaign: Campaign, *, poses: int = VERIFICATION) -> Outlook:
    """Reckon what a campaign with an adaptive block needs and reaches if the model holds.

    `poses` verify the correction.

    Raises
    ------
    ConfigError
        The accuracy cannot be reached, or the zone is out of reach.
    """
    found = block_of(campaign)
    assert found is not None
    number, block = found
    site = site_of(cell, campaign, number)
    pool = pool_of(block, site)
    used, design, floor_mm = first_of(site, pool)
    lengths, many, first = cell.instrument.declared.measures_lengths, readings_in(site), len(used)
    numbers = numbers_in(site)
    home = np.array(cell.robot.home_deg or [0.0] * cell.robot.model.joints)
    move_s, settle_s = float(np.median(seconds_to(cell, pool, home))), campaign.settle_of(number).seconds
    pose_s = move_s + rest_s(site, settle_s, campaign.samples)

    def limit_mm(level: float) -> float:
        judged = max(len(used) - first, BATCH)
        square = model_limit(design.spread, design.covariance, level) if lengths else design.variance
        return least_bound(float(np.hypot(np.sqrt(square), floor_mm)), numbers * judged, level)

    best_mm = least_bound(floor_mm, numbers * max(block.most - first, BATCH), DECIDING)
    if best_mm > block.accuracy_mm:
        alone = "noise of the instrument and repeatability of the robot alone are"
        if lengths:
            alone = "the repeatability of the robot alone is"
        raise ConfigError(
            f"an accuracy of {block.accuracy_mm:g} mm cannot be reached in this cell: {alone} {floor_mm:.3f} mm in "
            f"every reading, and {block.most} poses can show {best_mm:.3f} mm with 95 % confidence",
            what_to_do=f"Give {np.ceil(1000.0 * best_mm) / 1000.0:g} mm or more, or measure more accurately.",
        )
    while len(used) < LEAST or (limit_mm(DECIDING) > block.accuracy_mm and len(used) + BATCH <= block.most):
        more, design = design.best(BATCH, used)
        used += more
    warm_s = _WARM_UP["over"] * _WARM_UP["every_s"]
    nests_s = 2 * _NEST_S * len(cell.nests)
    verified_s, mountings = 2 * poses * pose_s, 0
    if lengths:
        balls = [visit for visit in make_plan(cell, campaign) if visit.block < number]
        touches = sum(
            visit.targets[0] in cell.tool.targets and visit.base_targets[0] in cell.nests for visit in balls
        )
        sides = len(balls) - touches
        warm_s, nests_s = touches * _TOUCH_S + sides * MOUNTING_S + 2 * _ZERO_S, 0.0
        verified_s = poses * (pose_s - (many - LEGS_VERIFIED) * MOUNTING_S)
        mountings = sides + many * len(used) + LEGS_VERIFIED * poses
    return Outlook(
        wanted_mm=block.accuracy_mm,
        poses=len(used) if limit_mm(DECIDING) <= block.accuracy_mm else None,
        most=block.most,
        targets=many,
        mountings=mountings,
        warm_up_minutes=warm_s / 60.0,
        measuring_minutes=(nests_s + len(used) * pose_s) / 60.0,
        verification_minutes=(nests_s + verified_s) / 60.0,
        least_minutes=(warm_s + nests_s + LEAST * pose_s) / 60.0,
        limit_mm=limit_mm(LEVEL),
        floor_mm=floor_mm,
    )
