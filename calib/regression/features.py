"""Regressors of the joint angles for a regression on positions: (n, p), each named.

For arms of the UR's structure (alpha 90, 0, 0, 90, -90, 0 deg; a2, a3; d1, d4, d5, d6) the flange is, with
s234 = sin(q2 + q3 + q4) and so on, at

    x =  c1 (a2 c2 + a3 c23 + d5 s234 - d6 c234 s5) + s1 (d4 + d6 c5)
    y =  s1 (a2 c2 + a3 c23 + d5 s234 - d6 c234 s5) - c1 (d4 + d6 c5)
    z =  d1 + a2 s2 + a3 s23 - d5 c234 - d6 s234 s5

Every product of sines and cosines in these sums is a regressor: `CLOSED_FORM`. `PRINTED` are equations (9) to (11) of
Khanesar et al. 2022, whose z has the products of s234 and c234 exchanged: away from a tool that points down it misses
the arm by 156 mm, which nothing in that paper's data could show. Where the tool points down, s234 s5 = 1, so that
s5 = s234 = +-1 and c5 = c234 = 0: the sums above are then eleven columns and an offset, `TOOL_DOWN`. The products one
by one are not: of the 37 columns 29 stay independent (s2c3c4 alone is no constant), 18 more than the arm needs, and
with some forty waypoints they overfit.

The constant is in none of the sets: the regression has an offset of its own for every output.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from calib.arm.robot import Robot
from calib.array import Array
from calib.errors import DataError
from calib.units import DEG

_S234 = ("s2c3c4", "c2s3c4", "c2c3s4", "s2s3s4")
_C234 = ("c2c3c4", "c2s3s4", "s2c3s4", "s2s3c4")


def _across(own: str, other: str) -> tuple[str, ...]:
    """Products of x (own = "c1", other = "s1") or of y (exchanged)."""
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
    """Sine and cosine of every joint and the products of two joints': for an arm of any structure."""
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
    """The products of a set for a robot. Raises DataError for an unknown name, or a set of another structure."""
    if name == "turns":
        return turns(robot.joints)
    if name not in _OF_UR:
        raise DataError(f"is {name!r}.", do=f"Use one of {', '.join(SETS)}.", key="--features")
    if not _like_ur(robot):
        raise DataError(
            f"is {name!r}: these products belong to the UR's structure, which {robot.name} does not have.",
            do="Use --features turns.",
            key="--features",
        )
    return _OF_UR[name]


def usual(robot: Robot, joints: Array) -> str:
    """The set for samples at model angles (n, N), rad, where none is asked for: the smallest that holds the arm."""
    if not _like_ur(robot):
        return "turns"
    along = np.sin(joints[:, 1:4].sum(axis=1)) * np.sin(joints[:, 4])  # of the tool's axis on the vertical
    return "tool-down" if np.all(np.abs(along) > _DOWN) else "closed-form"


def _like_ur(robot: Robot) -> bool:
    if robot.convention != "dh" or robot.joints != 6:
        return False
    quarter = 0.5 * np.pi
    zeros = (robot.a[0], *robot.a[3:], robot.d[1], robot.d[2], *robot.theta)
    return bool(np.allclose(robot.alpha, (quarter, 0.0, 0.0, quarter, -quarter, 0.0)) and not np.any(zeros))


def evaluate(products: tuple[str, ...], joints: Array) -> Array:
    """(n, p) values of the products at joint angles (n, N), rad: "c1s2" is cos(q1) sin(q2)."""
    waves = {"c": np.cos(joints), "s": np.sin(joints)}
    out = np.ones((len(joints), len(products)))
    for k, product in enumerate(products):
        for kind, joint in zip(product[::2], product[1::2], strict=True):
            out[:, k] *= waves[kind][:, int(joint) - 1]
    return out


def independent(features: Array) -> int:
    """Number of columns of (n, p) features, their means taken off, that are independent on these readings."""
    if not features.size:
        return 0
    sizes = np.linalg.svd(features - features.mean(axis=0), compute_uv=False)
    return int((sizes > 1e-9 * max(float(sizes[0]), 1e-300)).sum())
