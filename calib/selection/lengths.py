"""Predicted uncertainty of an arm that will be identified from lengths between balls.

Every length is a row of the Jacobian of the base model at the nominal robot. The rows are whitened with the noise of
the length and the repeatability of the robot, which the lengths of one pose share. The rows and the priors of an
identification give a covariance, which is propagated to poses in the workspace. U (k = 2, along the worst direction)
is that of a complete model.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib.arm.robot import Load, Robot
from calib.array import Array
from calib.data.conditions import Conditions
from calib.data.header import DEFAULT_GROUPS
from calib.data.noise import Noise
from calib.fit.identification import expanded, predict_with_covariance
from calib.fit.least_squares import jacobian
from calib.model import base_model
from calib.model.model import BoundModel, ModelStructure, StatedConditions, conditions_at
from calib.model.observations import Observations, VisitCovariance

_SERIES = "plan"
Point = tuple[float, float, float]


@dataclass(frozen=True)
class Balls:
    """Balls on the tool (flange frame) and on the base (base frame of the robot), mm.

    Attributes
    ----------
    tool_u_mm : mapping of str to float
        Standard uncertainty per axis of the balls on the tool, if stated. The balls on the base define the frame in
        which the arm is identified; an error of that frame is no part of U.
    """

    tool: Mapping[str, Point]
    base: Mapping[str, Point]
    tool_u_mm: Mapping[str, float]


@dataclass(frozen=True)
class Lengths:
    """Lengths to be measured between balls.

    Attributes
    ----------
    joints : array of shape (n, N)
        Joint angles, rad.
    tool, base : sequence of str
        Balls between which each length is measured.
    """

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
) -> Array:
    """Predict U (p,), mm, of the first tool ball.

    Parameters
    ----------
    places : array of shape (p, N)
        Joint angles at which U is predicted, rad.
    noise_mm : float
        Standard deviation of a length, mm.
    repeatability : float
        Repeatability of every joint, rad.
    loads : tuple of Load, optional
        Default: those of the robot.
    """
    names, anchors = tuple(balls.tool), tuple(balls.base)
    model = model_of_lengths(robot, balls)
    stated = StatedConditions(loads=loads)
    prior = model.prior_std
    information = np.diag(np.where(np.isfinite(prior), 1.0 / np.where(prior > 0.0, prior, np.inf) ** 2, 0.0))
    nothing = np.zeros(len(model.parameters))
    conditions = conditions_at(model, lengths.joints, stated, names[0])
    known = conditions.target_names
    conditions = replace(
        conditions,
        target=np.array([known.index(name) for name in lengths.tool]),
        anchor=np.array([anchors.index(name) for name in lengths.base]),
        anchor_names=anchors,
        visit=conditions.pose,
    )
    columns = rows_of_lengths(
        model, nothing, conditions, Noise("isotropic", length_mm=noise_mm, repeatability=repeatability)
    )
    information += columns.T @ columns
    scale = 1.0 / np.sqrt(np.diag(information))
    inverse = np.asarray(
        np.linalg.pinv(information * scale * scale[:, None], hermitian=True), dtype=np.float64
    )
    covariance = scale[:, None] * inverse * scale
    at = conditions_at(model, places, stated, names[0])
    return expanded(predict_with_covariance(model, nothing, covariance, at)[1])


def model_of_lengths(robot: Robot, balls: Balls) -> ModelStructure:
    """Build the base model of an arm that is identified from lengths."""
    measured = [dict.fromkeys(balls.tool, False)]
    effects = base_model.build(DEFAULT_GROUPS, robot, [_SERIES], measured, None, balls.tool_u_mm)
    return ModelStructure(robot, effects, {_SERIES: balls.tool}, anchors=balls.base)


def rows_of_lengths(model: ModelStructure, estimate: Array, conditions: Conditions, noise: Noise) -> Array:
    """Return the whitened derivatives (n, m) of n lengths, those of a visit together."""
    design, n, robot = BoundModel(model, conditions), len(conditions), model.robot
    frames = design.frames(estimate)
    nothing, weight = np.zeros(n), np.full((1, 1, n), 1.0 / noise.length_mm)
    lengths = Observations(None, None, nothing, weight, np.ones(n, dtype=np.int64))
    scatter = noise.of_each_joint(robot.kinds)[:, None, None] * lengths.columns(frames, robot.joint_slots)
    shared = VisitCovariance(conditions.visit, scatter)
    return jacobian(design, replace(lengths, shared=shared), frames)
