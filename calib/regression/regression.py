"""A trained regression of a robot: the correction that it adds to its model, and the region where it may be used.

It works in the base frame, which every series shares, and whose axes are those of the features:

    on residuals   svr(q) = R' (measured - p)           prediction = p + R svr(q)
    on positions   svr(q) = R' (measured - p) + p_0     prediction = p + R (svr(q) - p_0)

p: prediction of the model in the world, R: the base in the world, p_0: the nominal robot's point in its base frame.
A regression on positions is based on the nominal robot in its place, and what it says does not depend on that robot;
one on residuals is based on a fitted model, and far from its samples falls back on a mean, not on nonsense.

The region in which a regression may be used: between the joint angles of its training, and nowhere else.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from calib.arm.kinematics import forward
from calib.arm.robot import Robot, refuse_slides
from calib.array import Array
from calib.data.conditions import Conditions
from calib.errors import DataError
from calib.fit.readings import Readings
from calib.model.model import Design, RobotModel
from calib.regression.choose import choose, widths
from calib.regression.features import evaluate, products_of
from calib.regression.mls_svr import Kernel, Linear, MlsSvr
from calib.units import DEG

Subject = Literal["residuals", "positions"]

KERNELS = ("linear", "rbf")

_FEWEST = 2  # waypoints: one to leave out, one to keep

MARGIN = 0.5 * DEG

"""By how much a joint may lie beyond the trained range: a wrist 5 deg away errs by millimetres."""

_FARTHER = 1.25  # than any training sample from their centre, in units of their spread


@dataclass(frozen=True)
class Wanted:
    """The request for a regression. features: a name of `features.SETS`; kernel: linear or rbf."""

    on: Subject = "residuals"
    features: str = "turns"
    kernel: str = "linear"

    @classmethod
    def of(cls, on: str, features: str, kernel: str) -> Wanted:
        """The regression that words of a command line or a file ask for. Raises DataError naming the option."""
        for key, value, allowed in (("--on", on, get_args(Subject)), ("--kernel", kernel, KERNELS)):
            if value not in allowed:
                raise DataError(f"is {value!r}.", do=f"Use {' or '.join(allowed)}.", key=key)
        return cls("positions" if on == "positions" else "residuals", features, kernel)


@dataclass(frozen=True)
class Regression:
    """A regression that was trained at `joints` (n, N), rad.

    target: (x, y, z) mm of the point it speaks of, nominal in the flange frame; rms: of its errors, mm, on the
    waypoints that were left out when gamma and lambda were chosen.
    """

    wanted: Wanted
    target: tuple[float, float, float]
    joints: Array
    svr: MlsSvr
    rms: float

    @property
    def region(self) -> Region:
        """The region in which it may be used."""
        return Region.of(self.joints)

    def shift(self, robot: Robot, joints: Array) -> Array:
        """(k, 3) what it adds to the point that its model predicts, mm, base frame, at model angles (k, N), rad.

        Nothing is refused here: the prediction is valid within `region` only.
        """
        said = self.svr.predict(evaluate(products_of(self.wanted.features, robot), joints))
        if self.wanted.on == "residuals":
            return said
        poses = forward(robot, joints)
        return said - poses[:, :3, 3] - poses[:, :3, :3] @ np.array(self.target)

    def predict(self, model: RobotModel, estimate: Array, conditions: Conditions) -> Array:
        """(k, 3) points in the world, mm: the model that it is based on and what it adds."""
        points, base = world_points(model, estimate, conditions)
        return points + np.einsum("nij,nj->ni", base, self.shift(model.robot, conditions.joints))


def world_points(model: RobotModel, estimate: Array, conditions: Conditions) -> tuple[Array, Array]:
    """Predicted points (n, 3), mm, world, and the axes (n, 3, 3) of the base in the world."""
    frames = Design(model, conditions).frames(estimate, ())
    at_home = estimate.copy()
    at_home[model.of_base] = 0.0
    home = Design(replace(model, placements={}), conditions).frames(at_home, ())
    points = np.broadcast_to(frames.p, (3, len(conditions))).T
    return points, frames.rotation @ home.rotation.transpose(0, 2, 1)


def train(
    wanted: Wanted, model: RobotModel, estimate: Array, readings: Readings, waypoint: NDArray[np.int64]
) -> Regression | None:
    """Train on readings of points, n of them, by waypoint (n,); None where a regression on residuals gains nothing.

    It must gain, on waypoints left out, more than twice the standard error of the gain: else the model is better off
    alone. For a regression on positions `model` is the nominal robot in its place. Raises DataError where there is no
    point, one waypoint only, or several targets for a regression on positions.
    """
    refuse_slides(model.robot, "a regression knows")
    measured = readings.observed.points
    if measured is None:
        raise DataError(
            "hold no points: the regression is one on positions.", do="Measure points.", key="x_mm"
        )
    if len(np.unique(waypoint)) < _FEWEST:
        raise DataError(
            "are all of one waypoint: nothing can be left out to choose by.",
            do="Measure more waypoints, some 30 or more.",
            key="waypoint",
        )
    conditions = readings.conditions
    series, target = (
        conditions.series_names[conditions.series[0]],
        conditions.target_names[conditions.target[0]],
    )
    several = len({*zip(conditions.series.tolist(), conditions.target.tolist(), strict=True)}) > 1
    if several and wanted.on == "positions":
        raise DataError(
            "are of several tool targets or series: a regression on positions knows one point.",
            do="Use --on residuals without --compare, or a data set of one series and one target.",
            key="tool_target",
        )
    points, base = world_points(model, estimate, conditions)
    outputs = np.einsum("nji,nj->ni", base, measured.T - points)
    place = model.targets[series][target]
    if wanted.on == "positions":
        poses = forward(model.robot, conditions.joints)
        outputs = outputs + poses[:, :3, 3] + poses[:, :3, :3] @ np.array(place)
    features = evaluate(products_of(wanted.features, model.robot), conditions.joints)
    kernels: tuple[Kernel, ...] = (Linear(),) if wanted.kernel == "linear" else widths(features)
    chosen = choose(features, outputs, waypoint, kernels)
    if wanted.on == "residuals" and not chosen.sure:
        return None
    return Regression(wanted, place, conditions.joints, chosen.fit(features, outputs), chosen.rms)


@dataclass(frozen=True)
class Region:
    """The trained ranges of the joints (N,), rad, and what the joints had in common.

    Angles that no training sample resembles may still lie within every joint's own range. `axes` (N, N) are the
    principal directions of the trained joint angles about `centre` (N,), and `spread` (N,) their standard deviations.
    Along a direction that hardly varied (a tool that always points down keeps q2 + q3 + q4) nothing may go farther than
    `reach` (N,); along the others together, nothing may lie outside the ellipsoid of `radius`.
    """

    lower: Array
    upper: Array
    centre: Array
    axes: Array
    spread: Array
    reach: Array
    radius: float

    @classmethod
    def of(cls, joints: Array) -> Region:
        """The region of training joints (n, N), rad."""
        centre = joints.mean(axis=0)
        values, axes = np.linalg.eigh((joints - centre).T @ (joints - centre) / len(joints))
        spread = np.maximum(np.sqrt(np.maximum(values, 0.0)), 1e-12)
        along = np.abs((joints - centre) @ axes)
        wide = spread > MARGIN
        radius = _FARTHER * float(np.linalg.norm(along[:, wide] / spread[wide], axis=1).max())
        reach = np.where(wide, np.inf, along.max(axis=0) + MARGIN)
        return cls(
            joints.min(axis=0) - MARGIN, joints.max(axis=0) + MARGIN, centre, axes, spread, reach, radius
        )

    def holds(self, joints: Array) -> NDArray[np.bool_]:
        """(k,) whether joints (k, N), rad, lie within; those that are NaN do not."""
        within = ((joints >= self.lower) & (joints <= self.upper)).all(axis=1)
        along = np.abs((joints - self.centre) @ self.axes)
        wide = np.isinf(self.reach)
        near = np.linalg.norm(along[:, wide] / self.spread[wide], axis=1) <= self.radius
        return within & near & (along <= self.reach).all(axis=1)
