"""A trained regression of a robot: its correction of a model, its region and its features.

It works in the base frame, which every series shares, and whose axes are those of the features:

    on residuals   svr(q) = R' (measured - p)           prediction = p + R svr(q)
    on positions   svr(q) = R' (measured - p) + p_0     prediction = p + R (svr(q) - p_0)

Here p is the prediction of the model in the world, R the base in the world, and p_0 the nominal robot's point in
its base frame. A regression on positions is based on the nominal robot in its place, but its predictions do not
depend on that robot. A regression on residuals is based on a fitted model. Far from its samples it falls back on a
mean, not on nonsense.

A regression may be used only between the joint angles of its training.

The regressors of a regression are named products of sines and cosines of the joint angles, with values (n, p). For
arms with the structure of a UR (alpha 90, 0, 0, 90, -90, 0 deg, with a2, a3, d1, d4, d5 and d6) the flange is, with
s234 = sin(q2 + q3 + q4) and so on, at

    x =  c1 (a2 c2 + a3 c23 + d5 s234 - d6 c234 s5) + s1 (d4 + d6 c5)
    y =  s1 (a2 c2 + a3 c23 + d5 s234 - d6 c234 s5) - c1 (d4 + d6 c5)
    z =  d1 + a2 s2 + a3 s23 - d5 c234 - d6 s234 s5

`CLOSED_FORM` holds each product of sines and cosines in these sums. `PRINTED` holds those of equations (9) to (11)
of Khanesar et al. 2022, whose z has the products of s234 and c234 exchanged. Unless the tool points down, their z
misses the arm by 156 mm, which the data of that paper could not show.

If the tool points down, s234 s5 = 1, so that s5 = s234 = +-1 and c5 = c234 = 0. The sums above are then the eleven
columns and an offset of `TOOL_DOWN`. The single products do not reduce as far: 29 of the 37 columns stay
independent (s2c3c4 alone is not constant), 18 more than the arm needs. With some forty waypoints they overfit.

None of the sets contains the constant, because the regression has a separate offset for each output.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from calib.arm.kinematics import forward
from calib.arm.robot import Robot, refuse_slides
from calib.array import Array
from calib.data.conditions import Conditions
from calib.errors import DataError
from calib.fit.readings import FitReadings
from calib.model.model import BoundModel, ModelStructure
from calib.regression.mls_svr import Kernel, Linear, MlsSvr, choose, widths
from calib.units import DEG

_S234 = ("s2c3c4", "c2s3c4", "c2c3s4", "s2s3s4")
_C234 = ("c2c3c4", "c2s3s4", "s2c3s4", "s2s3c4")


def _across(own: str, other: str) -> tuple[str, ...]:
    """List the products of x (own = "c1", other = "s1") or of y (exchanged)."""
    return (
        *(f"{other}c5", other, f"{own}c2", f"{own}c2c3", f"{own}s2s3"),
        *(own + product for product in _S234),
        *(own + product + "s5" for product in _C234),
    )


def _up(without_5: tuple[str, ...], with_5: tuple[str, ...]) -> tuple[str, ...]:
    return ("s2", "s2c3", "c2s3", *without_5, *(product + "s5" for product in with_5))


CLOSED_FORM = (*_across("c1", "s1"), *_across("s1", "c1"), *_up(_C234, _S234))
PRINTED = (*_across("c1", "s1"), *_across("s1", "c1"), *_up(_S234, _C234))
TOOL_DOWN = ("c1", "s1", "c1c2", "c1c2c3", "c1s2s3", "s1c2", "s1c2c3", "s1s2s3", "s2", "s2c3", "c2s3")


def turns(joints: int) -> tuple[str, ...]:
    """Return sine and cosine of each joint and the products for each two joints.

    This set suits an arm of any structure.
    """
    single = [[f"c{j}", f"s{j}"] for j in range(1, joints + 1)]
    pairs = [a + b for k, one in enumerate(single) for two in single[k + 1 :] for a in one for b in two]
    return (*(name for pair in single for name in pair), *pairs)


_OF_UR: Mapping[str, tuple[str, ...]] = {
    "closed-form": CLOSED_FORM,
    "printed": PRINTED,
    "tool-down": TOOL_DOWN,
}

SETS = (*_OF_UR, "turns")
"""Names of the sets of products. All but `turns` are for the UR's structure."""

_DOWN = np.cos(0.1 * DEG)


def products_of(name: str, robot: Robot) -> tuple[str, ...]:
    """Return the products of a set for a robot.

    Raises
    ------
    DataError
        The name is unknown, or the set belongs to another structure than that of the robot.
    """
    if name == "turns":
        return turns(robot.joints)
    if name not in _OF_UR:
        raise DataError(f"is {name!r}.", do=f"Use one of {', '.join(SETS)}.", key="--features")
    if not like_ur(robot):
        raise DataError(
            f"is {name!r}: these products belong to the UR's structure, which {robot.name} does not have.",
            do="Use --features turns.",
            key="--features",
        )
    return _OF_UR[name]


def usual(robot: Robot, joints: Array) -> str:
    """Name the default set for samples at model angles (n, N), rad.

    It is the smallest set that can describe the arm at these samples.
    """
    if not like_ur(robot):
        return "turns"
    along = np.sin(joints[:, 1:4].sum(axis=1)) * np.sin(joints[:, 4])  # of the tool's axis on the vertical
    upright = np.all(np.abs(along) > _DOWN) and not flipped(joints).any()
    return "tool-down" if upright else "closed-form"


def flipped(joints: Array) -> NDArray[np.bool_]:
    """Mark the samples (n,) whose wrist is flipped against most others.

    Joint 5 has another sign there, so that d5 s234 has one too, and the products of `TOOL_DOWN` cannot describe both.
    """
    positive = joints[:, 4] % (2.0 * np.pi) < np.pi
    return positive != (2 * np.count_nonzero(positive) >= len(positive))


def like_ur(robot: Robot) -> bool:
    """Test whether an arm has the structure of a UR."""
    if robot.convention != "dh" or robot.joints != 6:
        return False
    quarter = 0.5 * np.pi
    zeros = (robot.a[0], *robot.a[3:], robot.d[1], robot.d[2], *robot.theta)
    return bool(np.allclose(robot.alpha, (quarter, 0.0, 0.0, quarter, -quarter, 0.0)) and not np.any(zeros))


def evaluate(products: tuple[str, ...], joints: Array) -> Array:
    """Evaluate the products at joint angles (n, N), rad, shape (n, p).

    The product "c1s2" is cos(q1) sin(q2).
    """
    waves = {"c": np.cos(joints), "s": np.sin(joints)}
    out = np.ones((len(joints), len(products)))
    for k, product in enumerate(products):
        for kind, joint in zip(product[::2], product[1::2], strict=True):
            out[:, k] *= waves[kind][:, int(joint) - 1]
    return out


def independent(features: Array) -> int:
    """Count the independent columns of features (n, p) after their means are subtracted."""
    if not features.size:
        return 0
    sizes = np.linalg.svd(features - features.mean(axis=0), compute_uv=False)
    return int((sizes > 1e-9 * max(float(sizes[0]), 1e-300)).sum())


Subject = Literal["residuals", "positions"]
KERNELS = ("linear", "rbf")
_FEWEST = 2  # waypoints: one to leave out, one to keep
MARGIN = 0.5 * DEG
"""By how much a joint may lie beyond the trained range: a wrist 5 deg away errs by millimetres."""

_FARTHER = 1.25  # than any training sample from their centre, in units of their spread


@dataclass(frozen=True)
class RegressionRequest:
    """Options of a regression: its subject, a set of `SETS`, and a linear or rbf kernel."""

    on: Subject = "residuals"
    features: str = "turns"
    kernel: str = "linear"

    @classmethod
    def of(cls, on: str, features: str, kernel: str) -> RegressionRequest:
        """Read the options from the texts of a command line or file.

        Raises
        ------
        DataError
            An option has an unknown value; the error names the option.
        """
        for key, value, allowed in (("--on", on, get_args(Subject)), ("--kernel", kernel, KERNELS)):
            if value not in allowed:
                raise DataError(f"is {value!r}.", do=f"Use {' or '.join(allowed)}.", key=key)
        return cls("positions" if on == "positions" else "residuals", features, kernel)


@dataclass(frozen=True)
class Regression:
    """A regression that was trained at `joints` (n, N), rad.

    Attributes
    ----------
    target : tuple of float
        Nominal position (x, y, z) of the tool target that it predicts, mm, in the flange frame.
    rms : float
        RMS error, mm, on the waypoints that were left out when gamma and lambda were chosen.
    """

    wanted: RegressionRequest
    target: tuple[float, float, float]
    joints: Array
    svr: MlsSvr
    rms: float

    @property
    def region(self) -> Region:
        """The region in which it may be used."""
        return Region.of(self.joints)

    def shift(self, robot: Robot, joints: Array) -> Array:
        """Return the shift that it adds to the prediction of its model, mm, shape (k, 3).

        The shift is in the base frame, and the model angles (k, N) are in rad. Nothing is refused here, but the
        prediction is valid only within `region`.
        """
        said = self.svr.predict(evaluate(products_of(self.wanted.features, robot), joints))
        if self.wanted.on == "residuals":
            return said
        poses = forward(robot, joints)
        return said - poses[:, :3, 3] - poses[:, :3, :3] @ np.array(self.target)

    def predict(self, model: ModelStructure, estimate: Array, conditions: Conditions) -> Array:
        """Predict points in the world, mm, shape (k, 3): those of its model plus the shift."""
        points, base = world_points(model, estimate, conditions)
        return points + np.einsum("nij,nj->ni", base, self.shift(model.robot, conditions.joints))


def world_points(model: ModelStructure, estimate: Array, conditions: Conditions) -> tuple[Array, Array]:
    """Predict points (n, 3), mm, world, and the axes (n, 3, 3) of the base in the world."""
    frames = BoundModel(model, conditions).frames(estimate, ())
    at_home = estimate.copy()
    at_home[model.of_base] = 0.0
    home = BoundModel(replace(model, placements={}), conditions).frames(at_home, ())
    points = np.broadcast_to(frames.p, (3, len(conditions))).T
    return points, frames.rotation @ home.rotation.transpose(0, 2, 1)


def train(
    wanted: RegressionRequest,
    model: ModelStructure,
    estimate: Array,
    readings: FitReadings,
    waypoint: NDArray[np.int64],
) -> Regression | None:
    """Train a regression on n readings of points.

    On residuals, the gain on left-out waypoints must exceed twice its standard error. Otherwise the model is better
    without the regression.

    Parameters
    ----------
    model : ModelStructure
        Model that the regression is based on. For a regression on positions, it is the nominal robot in its place.
    waypoint : array of shape (n,)
        Waypoint of each reading.

    Returns
    -------
    Regression or None
        None if a regression on residuals gains nothing.

    Raises
    ------
    DataError
        There is no point or only one waypoint, or a regression on positions has several targets or series.
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
    if wanted.features == "tool-down" and (other := flipped(conditions.joints)).any():
        few, all_of = len(np.unique(waypoint[other])), len(np.unique(waypoint))
        raise DataError(
            f"is 'tool-down', but the wrist is flipped at {few} of {all_of} waypoints: these products cannot describe "
            "both wrists.",
            do="Use --features closed-form, or leave these waypoints out.",
            key="--features",
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
    """The trained ranges of the joints (N,), rad, and the correlations of their angles.

    Angles unlike all training samples may still lie within the range of each joint. `axes` (N, N) are the principal
    directions of the trained joint angles about `centre` (N,), and `spread` (N,) their standard deviations.

    Along a direction that hardly varied, no angle may go farther than `reach` (N,). An example is a tool that
    always points down, which keeps q2 + q3 + q4. Along the other directions together, no angles may lie outside the
    ellipsoid of `radius`.
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
        """Create the region of training joints (n, N), rad."""
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
        """Test whether joints (k, N), rad, lie within the region, shape (k,); NaN does not."""
        within = ((joints >= self.lower) & (joints <= self.upper)).all(axis=1)
        along = np.abs((joints - self.centre) @ self.axes)
        wide = np.isinf(self.reach)
        near = np.linalg.norm(along[:, wide] / self.spread[wide], axis=1) <= self.radius
        return within & near & (along <= self.reach).all(axis=1)
