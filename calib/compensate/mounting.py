"""Tool points on the flange and base in the world of the readings, as a model holds them.

A correction counts in the frame of the base (`calib.compensate.calibrated`). A tool frame or a work frame of a
controller also needs where the targets are on the flange, and where the base is in the frame of the readings:

    target in the world = world . flange pose of the calibrated robot . tool
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from calib.arm.kinematics import ANCHOR, TARGET
from calib.array import Array
from calib.compensate.calibrated import in_base
from calib.compensate.carried import rigid_frames
from calib.model.model import BoundModel, ModelStructure, StatedConditions, conditions_at, series_of

_BASE = tuple(f"base.{axis}" for axis in ("x", "y", "z", "rx", "ry", "rz"))


@dataclass(frozen=True)
class Mounting:
    """Tool targets and base of one series.

    Attributes
    ----------
    tools : mapping of str to array of shape (4, 4)
        Pose of every target in the flange frame, mm.
    declared : tuple of str
        Targets whose position is the declared one, because no reading determined it.
    turned : bool
        Whether readings determined the orientation of the tool.
    world : array of shape (4, 4) or None
        Pose, in the world of the readings, of the frame in which a correction counts, mm. None if the readings do not
        determine it.
    """

    tools: Mapping[str, Array]
    declared: tuple[str, ...]
    turned: bool
    world: Array | None


def mounting_of(
    model: ModelStructure, estimate: Array, stated: StatedConditions, dropped: Collection[str] = ()
) -> Mounting:
    """Find the tool targets and the base of the stated series.

    Parameters
    ----------
    model : ModelStructure
        The whole model.
    estimate : array of shape (m,)
        Internal units.
    stated : StatedConditions
        Conditions; they name the series if there are several.
    dropped : collection of str, optional
        Parameters that the readings did not determine.

    Raises
    ------
    ValueError
        The series is unknown.
    """
    series, rest = series_of(model, stated), np.zeros((1, model.robot.joints))
    turn, bare = model.turns.get(series), in_base(model)
    tools: dict[str, Array] = {}
    declared: list[str] = []
    for name in model.targets[series]:
        design = BoundModel(bare, conditions_at(model, rest, stated, name))
        x, y, z, *angles = (_value(design.values(estimate), motion.slot) for motion in TARGET)
        pose = np.eye(4)
        pose[:3, 3] = x, y, z
        pose[:3, :3] = (np.eye(3) if turn is None else turn) @ Rotation.from_euler("XYZ", angles).as_matrix()
        tools[name] = pose
        if not _determined(design, [motion.slot for motion in TARGET[:3]], dropped):
            declared.append(name)
    design = BoundModel(bare, conditions_at(model, rest, stated))
    world: Array | None = np.eye(4)
    if series in model.placements:
        # Where lengths alone place neither the base nor its targets, the fit lets the targets give way.
        gone = {t.parameter for e in model.effects for t in e.terms if t.slot in ANCHOR} & set(dropped)
        known = len(_determined(design, _BASE, dropped)) == len(_BASE) and not gone
        values = design.values(estimate)
        base, _ = rigid_frames(model.robot, {slot: _value(values, slot) for slot in _BASE})
        world = model.placements[series] @ base if known else None
    return Mounting(tools, tuple(declared), turn is not None, world)


def _value(values: Mapping[str, Array | float], slot: str) -> float:
    return float(np.squeeze(values.get(slot, 0.0)))


def _determined(design: BoundModel, slots: Collection[str], dropped: Collection[str]) -> set[str]:
    """Return the slots on which a parameter acts that the readings determined."""
    names = [parameter.name for parameter in design.model.parameters]
    return {
        slot
        for position, slot, drive in design.terms
        if slot in slots and np.any(drive) and names[position] not in dropped
    }
