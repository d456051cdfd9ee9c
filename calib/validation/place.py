"""Placement of a calibrated robot at another location, with the robot unchanged.

The base is fitted, and the tool if the model frees it. Effects of the instrument and the mounting in the old set-up are
left out. For every series, with x_i the flange of the calibrated robot in its base frame,

    minimise  sum_i w_i | m_i - (R (x_i + F_i t_k) + T) |^2   over R, T and the targets t_k,

by Gauss-Newton with Huber weights, from the start that the identification uses. All readings have the same weight,
except gross errors: the residual after a calibration is due to the robot, not to the instrument.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from calib.arm.start import base_and_tool, settled, tool_turn
from calib.array import Array
from calib.data.dataset import Dataset
from calib.errors import DataError
from calib.model.model import BoundModel, ModelStructure
from calib.text.toml_table import Vector

FEWEST = 3


def frees_tool(model: ModelStructure) -> bool:
    """Check if the tool targets were unknown to a model, as a whole or in part."""
    return any(effect.places & {"tool", "target"} for effect in model.effects)


def of_the_robot(model: ModelStructure, estimate: Array) -> tuple[ModelStructure, Array]:
    """Reduce a model and its estimate to the robot: no base, tool or instrument."""
    effects = tuple(effect for effect in model.effects if effect.owner == "robot")
    robot = ModelStructure(model.robot, effects, model.targets)
    return robot, np.array([estimate[model.index[p.name]] for p in robot.parameters])


def place(
    dataset: Dataset, model: ModelStructure, estimate: Array, rows: NDArray[np.bool_] | None = None
) -> tuple[ModelStructure, Array]:
    """Place the model's robot in every series of a data set, fitted to `rows`.

    The default for `rows` is `fit_rows`.

    Returns
    -------
    model : ModelStructure
    estimate : array
        Model and estimate for predictions.

    Raises
    ------
    DataError
        A series has too few points.
    """
    conditions, header = dataset.conditions, dataset.header
    rows = dataset.pointed & (dataset.fit_rows if rows is None else rows)
    held, values = of_the_robot(model, estimate)
    free = frees_tool(model)
    targets = {name: header.targets_of(name) for name in conditions.series_names}
    flange = flange_poses(held, values, dataset)
    placements, turns = {}, {}
    for s, name in enumerate(conditions.series_names):
        here = rows & (conditions.series == s)
        if not (conditions.series == s).any():
            continue
        if int(here.sum()) < FEWEST:
            raise DataError(
                f"series '{name}' has {int(here.sum())} points to place the robot with.",
                do=f"Measure {FEWEST} or more with set = calibration in every series.",
                file=dataset.path,
                key="set",
            )
        names = conditions.target_names
        nominal = np.array([targets[name].get(t, (0.0, 0.0, 0.0)) for t in names])
        which = conditions.target[here]
        pose, tool = base_and_tool(flange[here], nominal, which, dataset.points[here], tool_unknown=free)
        pose, tool = settled(flange[here], tool, which, dataset.points[here], pose, tool_unknown=free)
        placements[name] = pose
        if free:
            found: dict[str, Vector] = {
                names[t]: (float(tool[t, 0]), float(tool[t, 1]), float(tool[t, 2])) for t in np.unique(which)
            }
            targets[name] = {**targets[name], **found}
        turned = here & dataset.turned
        if free and turned.any():
            turns[name] = tool_turn(flange[turned], pose, dataset.orientation[turned])
    return replace(held, targets=targets, placements=placements, turns=turns), values


def targets_in_base(dataset: Dataset, model: ModelStructure, estimate: Array) -> Array:
    """Predict the target of every reading, mm, in the base frame of the robot, shape (n, 3).

    The pose of the base and the effects of the instrument are left out; the tool is that of the model.
    """
    effects = tuple(
        effect
        for effect in model.effects
        if effect.owner != "instrument" and not any(term.slot.startswith("base.") for term in effect.terms)
    )
    robot = replace(model, effects=effects, placements={})
    values = np.array([estimate[model.index[p.name]] for p in robot.parameters])
    return BoundModel(robot, dataset.conditions).predict(values)


def flange_poses(robot: ModelStructure, estimate: Array, dataset: Dataset) -> Array:
    """Compute flange poses (n, 4, 4) in the base frame, mm, of a robot without base and tool."""
    conditions = dataset.conditions
    at_flange = {
        series: dict.fromkeys(conditions.target_names, (0.0, 0.0, 0.0)) for series in conditions.series_names
    }
    frames = BoundModel(replace(robot, targets=at_flange), conditions).frames(estimate, ())
    poses = np.tile(np.eye(4), (len(conditions), 1, 1))
    poses[:, :3, :3] = frames.rotation
    poses[:, :3, 3] = np.broadcast_to(frames.p, (3, len(conditions))).T
    return poses
