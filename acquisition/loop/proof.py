"""Proof of a saved model: new poses on the robot, with its corrections and without.

    campaign 1: nests and one pose -> corrected targets of new poses -> campaign 2, ... -> verification

The last part is that of a closed loop (`acquisition.loop.loop.verify`). The world frame of each campaign is that of its
own nests. The instrument's own errors in the readings of the model say nothing of today, and nothing of them is
removed. The clock of a model that follows time began with its readings.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from acquisition.campaign.campaign import FORMAT, Campaign, campaign_from
from acquisition.campaign.driven import refuse_other_robot
from acquisition.campaign.plan import DECIMALS, check_plan, make_plan
from acquisition.campaign.poses import draw_poses
from acquisition.cell.cell import Cell
from acquisition.loop.loop import (
    APPROACH_DEG,
    Equipment,
    Say,
    Targets,
    campaign_of,
    correction,
    follows_conditions,
    measure,
    new_targets,
    verify,
)
from acquisition.record.store import RecordStore
from acquisition.record.verification import Verification
from calib.compensate import Bounds, refuse_unlikely
from calib.errors import DataError
from calib.model import StatedConditions
from calib.saved import CalibratedModel
from drivers.errors import ConfigError

_FIRST_POSE = 79  # random stream, in addition to those of the plan and of the new poses
_USUAL_C = 20.0


@dataclass(frozen=True)
class ProofPlan:
    """Plan of a proof, before it has measured.

    Attributes
    ----------
    readings
        Number of readings of poses, corrected, uncorrected and the first.
    largest_deg
        Largest correction of a joint, deg, or mm of one that slides.
    refused
        Why other poses were refused.
    follows
        The correction follows time or temperature: every pose is corrected just before it is driven.
    """

    readings: int
    largest_deg: float
    refused: tuple[str, ...]
    follows: bool

    def in_words(self) -> str:
        """Return the plan in words, without a full stop."""
        text = f"{self.readings} readings, corrections of {self.largest_deg:.3f} deg or mm at most"
        if self.follows:
            text += ", every pose corrected just before it is driven"
        if self.refused:
            others = "1 other pose" if len(self.refused) == 1 else f"{len(self.refused)} other poses"
            text += f"; {others} refused: {self.refused[0]}"
        return text


def usable_here(cell: Cell, saved: CalibratedModel, file: Path, *, simulated: bool) -> CalibratedModel:
    """Return a model as this cell can prove it.

    It has the loads of the cell, and no errors of the instrument.

    Raises
    ------
    ConfigError
        The instrument measures distances, which do not show where the robot lands.
    DataError
        The model is of another robot, base or tool, or of a simulated robot where the cell is real.
    """
    if cell.instrument.declared.measures_lengths:
        raise ConfigError(
            f"a verification needs an instrument that measures points, the {cell.instrument.name} measures distances",
            what_to_do="Judge the model with its legs: truepose validate LEGS.csv --model MODEL.json.",
        )
    refuse_other_robot(cell, saved, file)
    if saved.simulated and not simulated:
        raise DataError(
            "was identified from a simulated robot and says nothing of this one.",
            do="Calibrate this robot, or start the service with --simulate to rehearse.",
            file=file,
            key="simulated",
        )
    if saved.model.placements:
        raise DataError(
            "states no place of the robot in the world: its fit has placed the base.",
            do="Judge it on a measured campaign instead: truepose validate DATA.csv --model MODEL.json --place.",
            file=file,
            key="placements",
        )
    model = saved.model
    missing = sorted(set(cell.tool.targets) - set.union(*(set(own) for own in model.targets.values())))
    if missing:
        raise DataError(
            f"knows no target {', '.join(missing)}, which the cell measures.",
            do="Mount the tool with which it was identified, or calibrate with this one.",
            file=file,
            key="tool_targets_mm",
        )
    of_instrument = model.owned(("instrument",)) > 0.0
    return replace(
        saved,
        loads=cell.loads or saved.loads,
        estimate=np.where(of_instrument, 0.0, saved.estimate),
    )


def proof_campaign(cell: Cell, saved: CalibratedModel, seed: int = 1) -> Campaign:
    """Return the first campaign of a proof: the nests and one pose.

    The pose is approached from the side of the corrections.

    It measures no other robot than that of the model, if the model names its serial number.

    Raises
    ------
    UnsafePlan
        No pose is clear.
    """
    rng = np.random.default_rng([seed, _FIRST_POSE])
    (pose,) = draw_poses(cell, 1, rng, APPROACH_DEG, both=False, decimals=DECIMALS)
    one = next((each for each in saved.devices if each.get("role") == "robot" and each.get("serial")), {})
    return campaign_from(
        {
            "format": FORMAT,
            "seed": seed,
            "approach": {"offset_deg": APPROACH_DEG, "sides": "one"},
            **(
                {"robot": {name: one[name] for name in ("maker", "model", "serial") if name in one}}
                if one
                else {}
            ),
            "block": [
                {
                    "kind": "poses",
                    "set": "validation",
                    "select": "list",
                    "joints_deg": [list(pose.joints_deg)],
                }
            ],
        },
        "proof",
    )


def plan_of_proof(
    cell: Cell, saved: CalibratedModel, poses: int, seed: int = 1, since_s: float = 0.0
) -> ProofPlan:
    """Draw, correct and check all poses of a proof, for the usual air of the model.

    Raises
    ------
    DataError
        The model corrects more than is plausible, or needs a condition that is not known.
    UnsafePlan, ConfigError
        Hardly any pose is clear, or none can be corrected.
    """
    used, _ = saved.for_use()
    air = used.usual.temperature_c
    stated = StatedConditions(
        series=next(iter(used.model.targets)),
        temperature_c=_USUAL_C if np.isnan(air) else air,
        time_s=since_s,
        loads=used.loads,
        gravity=used.gravity,
    )
    like = proof_campaign(cell, saved, seed)
    try:
        refuse_unlikely(used.model, used.estimate, stated, Bounds(), coupling=used.coupling)
        goals, refused = new_targets(cell, seed, used, stated, poses)
        follows = follows_conditions(cell, used, goals)
        done = correction(cell, used, goals, stated)
    except DataError as error:
        if np.isnan(since_s):
            raise DataError(
                f"{error.what} It does not say when its readings began, and follows the time since.",
                do="Calibrate this robot again: a loop measures, corrects and verifies on one clock.",
            ) from error
        raise
    corrected = np.round(done.joints / cell.robot.model.joint_units, DECIMALS)
    readings = 0
    for campaign in (like, campaign_of(like, corrected, goals)):
        visits = make_plan(cell, campaign)
        check_plan(cell, visits)
        readings += sum(len(visit.targets) for visit in visits if visit.counted)
    return ProofPlan(readings, float(np.max(np.abs(corrected - goals))), tuple(refused), follows)


def clock_of(saved: CalibratedModel, began_utc: float, time_scale: float) -> float:
    """Return the time on the model's clock, s, at a moment, s since 1970.

    It is NaN if it is not known to the minute.
    """
    try:
        began = datetime.strptime(saved.began or "", "%Y-%m-%d %H:%M UTC").replace(tzinfo=UTC)
    except ValueError:
        return float("nan")
    return (began_utc - began.timestamp()) * time_scale


def prove(
    equipment: Equipment, saved: CalibratedModel, folder: Path, *, poses: int, seed: int, say: Say
) -> tuple[Targets, Verification]:
    """Drive new poses with the corrections of a model and without, and judge the landings.

    `saved` is that of `usable_here`. The records are in `folder`/campaign1, campaign2, ...; those that an earlier
    program has begun are continued.

    Raises
    ------
    LoopEnded
        A campaign ended early.
    DataError, UnsafePlan, ConfigError
        As `plan_of_proof`, for the conditions of the moment.
    """
    cell = equipment.cell
    campaign = proof_campaign(cell, saved, seed)
    say("campaign 1: nests and the first pose")
    first = measure(equipment, campaign, folder / "campaign1")
    with RecordStore.reading(first.record) as store:
        began_utc = store.campaign["started_utc"]
    since_s = clock_of(saved, began_utc, cell.time_scale if equipment.simulated else 1.0)
    say("verification: driving corrected targets and the same uncorrected")
    return verify(equipment, campaign, folder, saved, first, first, poses, say, since_s=since_s)
