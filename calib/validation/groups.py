"""Errors by group: the same errors by target, series, branch, side of approach, and distance from a point.

A grouping gives every reading a name; a group is summarised as a whole is. Figure 4.7 of Nubiola's thesis is the
grouping by distance.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from calib.arm.robot import Robot
from calib.array import Array
from calib.data.conditions import Conditions
from calib.validation.branch import branches
from calib.validation.summary import Summary, summarise

MOST_BINS = 10


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
