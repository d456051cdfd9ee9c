"""Placement of a calibrated robot at another location, with the robot unchanged.

The base is fitted, and the tool if the model frees it. Effects of the instrument and the mounting in the old set-up are
left out. For every series, with x_i the flange of the calibrated robot in its base frame,

    minimise  sum_i w_i | m_i - (R (x_i + F_i t_k) + T) |^2   over R, T and the targets t_k,

by Gauss-Newton with Huber weights, from the start that the identification uses. All readings have the same weight,
except gross errors: the residual after a calibration is due to the robot, not to the instrument.

Distances have no frame. Balls that a model does not know, since another instrument identified it, are placed by the
distances themselves (`balls_of`), with the robot unchanged. If every row judges, `halved` gives half of the poses to
this purpose, so that no distance judges a place that was fitted to it. Source: Nubiola, thesis, section 2.6.3.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from calib.arm.start import base_and_tool, settled, tool_turn
from calib.array import Array
from calib.data.dataset import Dataset
from calib.errors import DataError
from calib.fit.placing import base_model_of
from calib.model.model import BoundModel, ModelStructure
from calib.text.toml_table import Vector

FEWEST = 3
_LOOSELY_MM = 5.0  # of a ball that was put down by rule, if its header states no uncertainty
_FEWEST_DISTANCES = 4  # three coordinates of a ball, and one to spare


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


def knows_ends(model: ModelStructure, dataset: Dataset, rows: NDArray[np.bool_]) -> bool:
    """Check if a model has the tool target, in its series, and the base target of every distance of a mask."""
    conditions = dataset.conditions.take(rows & dataset.spanned)
    ends = np.unique(np.column_stack([conditions.series, conditions.target, conditions.anchor]), axis=0)
    return all(
        conditions.target_names[t] in model.targets.get(conditions.series_names[s], {})
        and conditions.anchor_names[a] in model.anchors
        for s, t, a in ends.tolist()
    )


def halved(dataset: Dataset) -> Dataset:
    """Move every second pose with distances from the validation to the calibration set.

    Poses whose first distances have the same ends alternate in the order of measuring. All distances of a pose stay
    together.
    """
    conditions = dataset.conditions
    rows = np.flatnonzero(dataset.validation_rows & dataset.spanned)
    first = rows[np.unique(conditions.pose[rows], return_index=True)[1]]
    keys = (conditions.order, conditions.anchor, conditions.target, conditions.series)
    alternate = first[np.lexsort([key[first] for key in keys])][::2]
    given = np.isin(conditions.pose, conditions.pose[alternate]) & (dataset.sets == "validation")
    return replace(dataset, sets=np.where(given, "calibration", dataset.sets))


def balls_of(dataset: Dataset) -> ModelStructure:
    """Build the base model whose balls `calib.fit.place_nominal` places by distances.

    The balls of the tool and of the base are free. Uncertainties in the header hold them to its positions. Without
    one, a base target is held loosely.

    Raises
    ------
    DataError
        A series or a base target has too few distances to be placed, or distances from too few places.
    """
    conditions, spanned = dataset.conditions, dataset.usable & dataset.spanned
    fitted = spanned & dataset.fit_rows
    judged = spanned & ~fitted
    for what, names, index in (
        ("series", conditions.series_names, conditions.series),
        ("base target", conditions.anchor_names, conditions.anchor),
    ):
        counts = np.bincount(index[fitted], minlength=len(names))
        for k in np.unique(index[judged]):
            if counts[k] < _FEWEST_DISTANCES:
                raise DataError(
                    f"{what} '{names[k]}' has {counts[k]} distances that place its balls and do not judge.",
                    do=f"Measure {_FEWEST_DISTANCES} or more with set = calibration, or more that judge.",
                    file=dataset.path,
                    key="set",
                )
    header, own = dataset.header, dataset.header.groups
    loosely = dict.fromkeys(header.base_targets, _LOOSELY_MM) | dict(header.base_targets_u_mm)
    free = replace(dataset, header=replace(header, base_targets_u_mm=loosely))
    model = base_model_of(free, own if "tool" in own else (*own, "tool"))
    lost = [name for name, at in model.anchors.items() if name not in header.base_targets and not any(at)]
    if lost:
        raise DataError(
            f"has distances that leave open where the base target '{lost[0]}' is.",
            do="Give its position in [base_targets], if only roughly, or measure it from more places.",
            file=dataset.path,
            key="base_target",
        )
    return model


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
