"""The uncertainty of an arm identified from lengths between balls, before anything is measured.

Every length is a row of the Jacobian of the base model at the nominal robot, whitened with the noise of the length and
the repeatability of the robot along it. With the priors of an identification the rows give a covariance, which is
carried to places of the workspace: U (k = 2, along the worst direction) of a model that is complete.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calib.arm.robot import Load, Robot
from calib.array import Array
from calib.data.groups import DEFAULT_GROUPS
from calib.fit.uncertainty import expanded, predict_with_covariance
from calib.model import base_model
from calib.model.model import Design, RobotModel
from calib.model.observations import Observations
from calib.model.stated import StatedConditions, conditions_at

_SERIES = "plan"
Point = tuple[float, float, float]


@dataclass(frozen=True)
class Balls:
    """Balls on the tool (flange frame) and on the base (base frame of the robot), mm.

    tool_u_mm: standard uncertainty per axis of those on the tool, where stated. Those on the base are the frame in
    which the arm is identified: where they are in another one is no part of U.
    """

    tool: Mapping[str, Point]
    base: Mapping[str, Point]
    tool_u_mm: Mapping[str, float]


@dataclass(frozen=True)
class Lengths:
    """n lengths: joints (n, N) rad, and the names of the balls between which each is measured."""

    joints: Array
    tool: Sequence[str]
    base: Sequence[str]


def uncertainty_of(
    robot: Robot,
    balls: Balls,
    lengths: Lengths,
    places: Array,
    *,
    noise_mm: float,
    repeatability: float,
    loads: tuple[Load, ...] | None = None,
    groups: Sequence[str] = DEFAULT_GROUPS,
) -> Array:
    """U (p,) mm of the first tool ball at joint angles `places` (p, N), rad.

    noise_mm: standard deviation of a length; repeatability: rad, of every joint; loads None: the robot's own.
    """
    names, anchors = tuple(balls.tool), tuple(balls.base)
    measured = [dict.fromkeys(names, False)]
    effects = base_model.build(groups, robot, [_SERIES], measured, None, balls.tool_u_mm)
    model = RobotModel(robot, effects, {_SERIES: balls.tool}, anchors=balls.base)
    stated = StatedConditions(loads=loads)
    prior = model.prior_std
    information = np.diag(np.where(np.isfinite(prior), 1.0 / np.where(prior > 0.0, prior, np.inf) ** 2, 0.0))
    tool = np.array([names.index(name) for name in lengths.tool])
    base = np.array([anchors.index(name) for name in lengths.base])
    nothing = np.zeros(len(model.parameters))
    for t in np.unique(tool):
        rows = tool == t
        conditions = replace(
            conditions_at(model, lengths.joints[rows], stated, names[t]),
            anchor=base[rows],
            anchor_names=anchors,
        )
        columns = _whitened(Design(model, conditions), nothing, noise_mm, repeatability)
        information += columns.T @ columns
    scale = 1.0 / np.sqrt(np.diag(information))
    inverse = np.asarray(
        np.linalg.pinv(information * scale * scale[:, None], hermitian=True), dtype=np.float64
    )
    covariance = scale[:, None] * inverse * scale
    at = conditions_at(model, places, stated, names[0])
    return expanded(predict_with_covariance(model, nothing, covariance, at)[1])


def _whitened(design: Design, estimate: Array, noise_mm: float, repeatability: float) -> Array:
    """(n, m) derivative of the lengths over their standard deviation."""
    n = len(design.conditions)
    frames = design.frames(estimate)
    plain = Observations(None, None, np.zeros(n), np.ones((1, 1, n)), np.ones(n, dtype=np.int64))
    joints = [f"theta{k}" for k in range(1, design.model.robot.joints + 1)]
    by_joint: NDArray[np.float64] = plain.columns(frames, joints)[:, 0]
    sigma = np.sqrt(noise_mm**2 + repeatability**2 * np.sum(by_joint**2, axis=0))
    return design.columns(plain.columns(frames, design.slots)) / sigma[:, None]
