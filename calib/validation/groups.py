"""Errors by group: the same errors by target, series, branch, side of approach, and distance from a point.

A grouping gives every reading a name; a group is summarised as a whole is. Figure 4.7 of Nubiola's thesis is the
grouping by distance.

The branch of a six-axis robot's configuration, from the nominal axes: front or back, up or down, flip or noflip.

Signs of what vanishes in the three singular surfaces, for arms with a spherical wrist and for the URs alike. z_i is
the axis of joint i, o_i a point on it, w where axes 5 and 6 meet (the wrist centre of a spherical wrist):

    front / back    (z_1 x z_2) . (w - o_1), relative to its sign at the zero pose: the wrist lies before or behind
                    axis 1; for an arm that is upright at zero, its own sign
    up / down       z_2 . ((o_3 - o_2) x (e - o_3)) > 0 is up: the branch of theta_3; e is w, or a point on axis 4
                    where axes 3 and 4 are parallel (URs)
    flip / noflip   z_5 . (z_4 x z_6) > 0 is noflip: the sign of sin theta_5

The product of the three has, up to one sign a robot, the sign of the Jacobian's determinant. Source of the words:
Nubiola, thesis 4; elsewhere 'up' may be named otherwise.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from calib.arm.kinematics import Chain, Placement, nominal_values, propagate
from calib.arm.robot import Robot
from calib.array import Array
from calib.data.conditions import Conditions
from calib.validation.summary import Summary, summarise

MOST_BINS = 10

_PARALLEL = 1e-6

_MEETING_MM = 1e-7


@dataclass(frozen=True)
class Grouping:
    """Readings by one property; `groups` in the order in which they are shown."""

    title: str
    groups: tuple[tuple[str, Summary], ...]


def grouped(title: str, names: Sequence[str], errors: Array) -> Grouping | None:
    """Summaries of errors (n,) by name; None where all have the same name: there is nothing to compare."""
    labels = np.array(names)
    kinds = list(dict.fromkeys(sorted(labels)))
    if len(kinds) < 2:
        return None
    found = [(str(kind), summarise(errors[labels == kind])) for kind in kinds]
    return Grouping(title, tuple((kind, summary) for kind, summary in found if summary is not None))


def groupings(robot: Robot, conditions: Conditions, errors: Array) -> list[Grouping]:
    """Errors (n,) of readings by target, series, branch and side of approach, as far as the readings differ in them."""
    return [grouping for grouping in _groupings(robot, conditions, errors) if grouping is not None]


def _groupings(robot: Robot, conditions: Conditions, errors: Array) -> Iterator[Grouping | None]:
    yield grouped("target", [conditions.target_names[t] for t in conditions.target], errors)
    yield grouped("series", [conditions.series_names[s] for s in conditions.series], errors)
    configurations = branches(robot, conditions.joints)
    if configurations is not None:
        yield grouped("branch", configurations, errors)
    for k, side in enumerate(conditions.side.T, start=1):
        words = np.select([side > 0.0, side < 0.0], ["from below", "from above"], "unknown")
        yield grouped(f"approach of j{k}", words.tolist(), errors)


def by_distance(points: Array, reference: Array, errors: Array) -> Grouping:
    """Errors (n,) by the distance of points (n, 3) from a reference point (3,), mm, in bins of a round width."""
    distance = np.linalg.norm(points - reference, axis=1)
    width = _round_width(float(np.ptp(distance)) / MOST_BINS)
    bins = np.floor(distance / width).astype(int)
    found = []
    for k in np.unique(bins):
        summary = summarise(errors[bins == k])
        if summary is not None:
            found.append((f"{k * width:g} to {(k + 1) * width:g} mm", summary))
    return Grouping("distance from the point", tuple(found))


def _round_width(least: float) -> float:
    """The smallest of 1, 2, 5, 10, 20, 50 ... mm that is not below `least`."""
    decade = 10.0 ** np.floor(np.log10(max(least, 1.0)))
    return float(next(step * decade for step in (1.0, 2.0, 5.0, 10.0) if step * decade >= max(least, 1.0)))


def branches(robot: Robot, joints: Array) -> list[str] | None:
    """(n,) 'front/up/noflip' and so on at model angles (n, N), rad; None for robots that are not of this kind.

    Of this kind: six joints, axes 5 and 6 meeting at an angle.
    """
    if robot.joints != 6:
        return None
    z, o = _axes(robot, np.vstack([joints, np.zeros((1, 6))]))
    across = np.cross(z[4], z[5])
    size = np.sum(across**2, axis=1)
    if size.min() < _PARALLEL or np.abs(np.sum((o[5] - o[4]) * across, axis=1)).max() > _PARALLEL * 1e3:
        return None
    along = np.sum(np.cross(o[5] - o[4], z[5]) * across, axis=1) / size
    wrist = o[4] + along[:, None] * z[4]
    parallel = np.linalg.norm(np.cross(z[2], z[3]), axis=1).max() < _PARALLEL
    elbow = o[3] if parallel else wrist
    reach = np.sum(np.cross(z[0], z[1]) * (wrist - o[0]), axis=1)
    front = reach * (-1.0 if reach[-1] < -_MEETING_MM else 1.0) >= 0.0
    up = np.sum(z[1] * np.cross(o[2] - o[1], elbow - o[2]), axis=1) >= 0.0
    noflip = np.sum(z[4] * np.cross(z[3], z[5]), axis=1) >= 0.0
    words = zip(front[:-1], up[:-1], noflip[:-1], strict=True)
    return [
        f"{'front' if f else 'back'}/{'up' if u else 'down'}/{'noflip' if w else 'flip'}" for f, u, w in words
    ]


def _axes(robot: Robot, joints: Array) -> tuple[Array, Array]:
    """Directions and points (6, n, 3) of the joint axes of the nominal robot, base frame."""
    frames = propagate(Chain.of(robot), nominal_values(robot, joints), Placement())
    n = len(joints)

    def stacked(by_slot: dict[str, Array]) -> Array:
        return np.stack([np.broadcast_to(by_slot[f"theta{k}"], (3, n)).T for k in range(1, 7)])

    return stacked(frames.axis), stacked(frames.origin)
