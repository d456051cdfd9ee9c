"""Information of each candidate pose: whitened Jacobian rows of the base model.

A pose has three rows per tool target measured there, at the nominal robot. They are whitened with the declared noise
of the instrument and the repeatability of the robot, which the targets of a pose share. Parameters that all candidates
together cannot determine are dropped and named. The columns of the others are scaled to a mean square of one per
candidate.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from calib.arm.robot import Load, Robot
from calib.array import Array
from calib.data.conditions import Conditions
from calib.data.header import DEFAULT_GROUPS, GROUPS
from calib.data.noise import Noise
from calib.errors import DataError
from calib.fit.least_squares import DroppedParameter, triangular_factor
from calib.model import base_model
from calib.model.effect import Parameter
from calib.model.model import BoundModel, ModelStructure, StatedConditions, conditions_at
from calib.units import to_internal

_SERIES = "selection"
_DEPENDENT = 1e-7  # share of a column left when those before it are projected out
_MOVES_NOTHING = 1e-6  # whitened displacement, over all candidates, for a parameter of its usual size


@dataclass(frozen=True)
class Setup:
    """Set-up of a measurement: targets, instrument, and model to be identified.

    Attributes
    ----------
    targets : mapping of name to (x, y, z)
        Tool targets that are measured at every pose, flange frame, mm.
    groups : sequence of str
        Parameter groups that the model frees.
    loads : tuple of Load or None
        None for those of the robot.
    """

    robot: Robot
    targets: Mapping[str, tuple[float, float, float]]
    noise: Noise
    groups: Sequence[str] = DEFAULT_GROUPS
    loads: tuple[Load, ...] | None = None

    def model(self) -> ModelStructure:
        """Build the base model.

        Raises
        ------
        DataError
            A group or a set of targets cannot be used.
        """
        for group in self.groups:
            if group not in GROUPS or group == "length_zero":
                raise DataError(
                    f"'{group}' is not a group for which poses are selected.",
                    do=f"Use some of {', '.join(g for g in GROUPS if g != 'length_zero')}.",
                    key="groups",
                )
        if not self.groups or not self.targets:
            raise DataError(
                "there is nothing to select for.", do="Name groups and tool targets.", key="groups"
            )
        measured = [dict.fromkeys(self.targets, False)]
        effects = base_model.build(tuple(dict.fromkeys(self.groups)), self.robot, [_SERIES], measured)
        return ModelStructure(self.robot, effects, {_SERIES: self.targets}, station=self.noise.station_mm)


@dataclass(frozen=True)
class Candidates:
    """N candidate poses of t targets each, for m parameters.

    Attributes
    ----------
    rows : array of shape (N, 3 t, m)
        Whitened rows.
    points : array of shape (N, t, 3, m)
        Derivative of every target, mm.
    repeatability : array of shape (N, t, 3, 3)
        Covariance of every target from the robot's repeatability, mm2.
    parameters : tuple of Parameter
        Parameters that are kept.
    unit : array of shape (m,)
        Internal units of one unit of each column.
    """

    joints: Array  # (N, J) rad
    rows: Array
    points: Array
    repeatability: Array
    parameters: tuple[Parameter, ...]
    unit: Array
    dropped: tuple[DroppedParameter, ...]


def candidates_of(setup: Setup, joints: Array) -> Candidates:
    """Build the candidates at joint angles (N, J), rad.

    Raises
    ------
    DataError
        The set-up or the angles cannot be used.
    """
    joints = np.asarray(joints, dtype=np.float64)
    if joints.ndim != 2 or len(joints) == 0 or joints.shape[1] != setup.robot.joints:
        raise DataError(
            f"the candidates have shape {joints.shape}.",
            do=f"Give (poses, {setup.robot.joints}) joint angles.",
        )
    if not np.all(np.isfinite(joints)):
        raise DataError("a candidate has an angle that is not finite.", do="Leave it out.")
    model = setup.model()
    stated = StatedConditions(loads=setup.loads)
    zero = np.zeros(len(model.parameters))
    parts = [
        derivatives(model, zero, conditions_at(model, joints, stated, target), setup.noise)
        for target in setup.targets
    ]
    points, scatter, noise = (np.stack(each, axis=1) for each in zip(*parts, strict=True))
    rows = whitened(points, scatter, noise)
    kept, dropped = _independent(rows.reshape(-1, rows.shape[-1]), model.parameters)
    rows, points = rows[:, :, kept], points[..., kept]
    size = np.linalg.norm(rows, axis=(0, 1)) / np.sqrt(len(joints))
    return Candidates(
        joints=joints,
        rows=rows / size,
        points=points / size,
        repeatability=scatter @ scatter.transpose(0, 1, 3, 2),
        parameters=tuple(model.parameters[j] for j in kept),
        unit=1.0 / size,
        dropped=dropped,
    )


def derivatives(
    model: ModelStructure, estimate: Array, conditions: Conditions, noise: Noise
) -> tuple[Array, Array, Array]:
    """Return derivatives and noise of n readings of points.

    They are the derivatives by the parameters (n, 3, m), mm per internal unit, the displacement by one standard
    deviation of each joint (n, 3, J), mm, and the covariance of the instrument (n, 3, 3), mm2.
    """
    design, n = BoundModel(model, conditions), len(conditions)
    robot = model.robot
    frames = design.frames(estimate, (*design.slots, *robot.joint_slots))
    columns = np.broadcast_to(design.point_columns(frames).reshape(3, n, -1), (3, n, len(estimate)))
    by_joint = np.broadcast_to(frames.velocities(robot.joint_slots), (robot.joints, 3, n)).transpose(2, 1, 0)
    points = np.broadcast_to(frames.p, (3, n)).T
    scatter = noise.of_each_joint(robot.kinds) * by_joint
    return columns.transpose(1, 0, 2), scatter, noise.of_points(points, np.full((n, 3), np.nan))


def whitened(points: Array, scatter: Array, noise: Array) -> Array:
    """Whiten the derivatives (N, t, 3, m) of the targets of a pose together, to (N, 3 t, m).

    All targets are measured at one rest position of the robot, which is off by scatter (N, t, 3, J). Each has a
    separate noise (N, t, 3, 3).
    """
    n, t, _, m = points.shape
    shared = scatter.reshape(n, 3 * t, -1)
    covariance = shared @ shared.transpose(0, 2, 1)
    for k in range(t):
        own = slice(3 * k, 3 * k + 3)
        covariance[:, own, own] += noise[:, k]
    try:
        lower = np.linalg.cholesky(covariance)
    except np.linalg.LinAlgError as error:
        raise DataError("the declared noise is zero.", do="Declare how well the instrument reads.") from error
    return np.asarray(np.linalg.solve(lower, points.reshape(n, 3 * t, m)), dtype=np.float64)


def _independent(
    columns: Array, parameters: Sequence[Parameter]
) -> tuple[list[int], tuple[DroppedParameter, ...]]:
    """Select independent columns (rows, m), in order, and list the dropped parameters.

    Base and tool come first, as in an identification: of a confounded group they stay.
    """
    size = np.linalg.norm(columns, axis=0)
    usual = np.array([to_internal(1.0 if p.size is None else p.size, p.unit) for p in parameters])
    seen = size * usual > _MOVES_NOTHING
    triangle = triangular_factor(columns / np.where(seen, size, np.inf))
    kept: list[int] = []
    dropped = []
    for j in sorted(range(len(parameters)), key=lambda j: parameters[j].size is not None):
        share = np.linalg.lstsq(triangle[:, kept], triangle[:, j], rcond=None)[0] if kept else np.zeros(0)
        if np.linalg.norm(triangle[:, j] - triangle[:, kept] @ share) > _DEPENDENT:
            kept.append(j)
            continue
        weight = np.abs(share)
        heavy = [kept[i] for i in np.argsort(-weight)[:6] if seen[j] and weight[i] > 0.05 * weight.max()]
        dropped.append(DroppedParameter(parameters[j].name, tuple(parameters[i].name for i in heavy)))
    return sorted(kept), tuple(dropped)
