"""The verification of a correction with a ballbar: corrected targets at new stances, and the lengths of their legs.

The stances are those of the cups and balls where the calibration found them, and were not measured for it. A perfect
correction holds every leg at the length that the nominal robot gives it. The error is the measured length minus that
one: an error along the bar, not of a position. No stance is driven uncorrected, where many legs would be out of the
stroke of the bar. Lengths mm, angles deg.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations
from pathlib import Path

import numpy as np

from acquisition.campaign.blocks.block import Approach, BlockVisit, Joints, Site, rounded
from acquisition.campaign.blocks.hexapod import HexapodBlock
from acquisition.cell.cell import Cell, point, with_nests
from acquisition.cell.workspace import targets_at
from acquisition.errors import RecordError
from acquisition.record.readings import readings_of
from acquisition.record.store import RecordStore
from acquisition.record.verification import JudgedLandings
from calib.array import Array
from calib.diagnose import DiagnosisFit
from calib.model import BoundModel, StatedConditions, conditions_of
from calib.text import Vector

LEGS_VERIFIED = 3  # of a new stance, with no ball in common
_MEASURED_DEG = 3.0  # a stance so near to a pose of the calibration was measured there


def new_stances(
    cell: Cell, diagnosis: DiagnosisFit, approach: Approach, rng: np.random.Generator, most: int
) -> Array:
    """Draw stances of the legs that the calibration did not measure; their nominal joints (k, N), deg."""
    joints = np.array([visit.joints_deg for visit in _stances(cell, diagnosis, approach)])
    measured = np.unique(cell.robot.counted(diagnosis.dataset.conditions.joints), axis=0)
    apart = np.abs(joints[:, None] - measured).max(axis=2).min(axis=1)
    return joints[rng.permutation(np.flatnonzero(apart > _MEASURED_DEG))[:most]]


def stances_near(
    cell: Cell, diagnosis: DiagnosisFit, approach: Approach, joints_deg: Array
) -> tuple[Array, list[list[tuple[str, str]]]]:
    """Return the stances nearest to joints (k, N), as nominal joints (k, N), deg, and the legs that verify each."""
    visits = _stances(cell, diagnosis, approach)
    stances = np.array([visit.joints_deg for visit in visits])
    nearest = np.abs(stances - np.asarray(joints_deg)[:, None]).max(axis=2).argmin(axis=1)
    return stances[nearest], [_one_to_each(visits[i]) for i in nearest]


def judge_legs(
    record: Path, goals: Mapping[Joints, Joints], cell: Cell, diagnosis: DiagnosisFit
) -> JudgedLandings:
    """Compare the legs of a record with their lengths on the nominal robot; `goals` are those of the driven joints.

    Raises
    ------
    RecordError
        There is no record, or no leg in it.
    """
    final, there = diagnosis.final, found_cell(cell, diagnosis)
    with RecordStore.reading(record) as store:
        rows = [row for row in readings_of(store) if row.counts and row.length_mm is not None]
    if not rows:
        raise RecordError(f"{record}: holds no leg of a new pose")
    names, targets = list(there.tool.targets), [row.target for row in rows]
    cups = np.array([there.nests[row.base_target or ""] for row in rows])
    poses = np.array([goals[rounded(row.joints)] for row in rows])
    required = targets_at(there, poses)[np.arange(len(rows)), [names.index(target) for target in targets]]
    leg = required - cups
    wanted = np.linalg.norm(leg, axis=1)
    direction = leg / wanted[:, None]
    robot, noise = final.model.robot, diagnosis.dataset.header.noise
    driven, before = (
        cell.robot.model_angles(np.array([getattr(row, name) for row in rows]))
        for name in ("joints", "approach")
    )
    stated = StatedConditions(loads=cell.loads, series=tuple(final.model.targets)[-1])
    design = BoundModel(final.model, conditions_of(final.model, driven, before, stated, targets))
    moves = design.frames(np.zeros_like(final.estimate), robot.joint_slots).velocities(robot.joint_slots)
    along = np.einsum("na,jan->nj", direction, moves) * noise.of_each_joint(robot.kinds)
    variance = np.sum(along**2, axis=1) + noise.length_mm**2
    return JudgedLandings(
        errors=(np.array([row.length_mm for row in rows]) - wanted)[:, None] * direction,
        corrected=np.ones(len(rows), dtype=bool),
        floor_mm=np.full(len(rows), float(np.sqrt(np.mean(variance)))),
        off_mm=None,
        u_mm=2.0 * np.sqrt(variance),
        goals_deg=poses,
        wanted=required,
        target=tuple(targets),
    )


def found_cell(cell: Cell, diagnosis: DiagnosisFit) -> Cell:
    """Return a cell with its cups and the balls of its tool where a calibration found them."""
    final = diagnosis.final
    model, tool = final.model, final.model.targets[tuple(final.model.targets)[-1]]

    def found(places: Mapping[str, Vector]) -> dict[str, Vector]:
        keys = {name: [f"{name}.{axis}" for axis in "xyz"] for name in places}
        return {
            name: point(
                np.add(
                    place,
                    [final.estimate[model.index[key]] if key in model.index else 0.0 for key in keys[name]],
                )
            )
            for name, place in places.items()
        }

    targets = {name: place for name, place in found(tool).items() if name in cell.tool.targets}
    there = with_nests(cell, found(model.anchors))
    return there.model_copy(
        update={"tool": cell.tool.model_copy(update={"targets": cell.tool.targets | targets})}
    )


def _stances(cell: Cell, diagnosis: DiagnosisFit, approach: Approach) -> list[BlockVisit]:
    there = found_cell(cell, diagnosis)
    site = Site(there, 0, 0, tuple(cell.tool.targets), approach)
    return HexapodBlock(kind="hexapod", configurations="all").visits_at(site)


def _one_to_each(visit: BlockVisit) -> list[tuple[str, str]]:
    """Return the legs by which a stance is verified."""
    return next(
        list(some)
        for some in combinations(visit.distances, LEGS_VERIFIED)
        if all(len(set(ends)) == LEGS_VERIFIED for ends in zip(*some, strict=True))
    )
