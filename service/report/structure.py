"""Structure that no effect explains, drawn where it lives: over an angle, two of them, a load, time, the side of the
tool that is down, in the workspace, by target or by pose.

What is left of every reading is a vector; its three parts in the world are drawn over what drives it, with the weighted
means of bins, or as arrows at their place, means of the readings near it. Pure noise scatters evenly about zero and its
arrows point anywhere. Where the readings that the fit left out lie together, they are drawn among the others.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from calib.array import Array
from calib.data import Dataset
from calib.diagnose import ACTS_ON, EACH_POSE, Structure
from calib.fit import all_readings
from calib.model import Design
from service.report import residual_pictures as pictures
from service.report.quantities import Quantity, quantity_of
from service.report.residuals import Sample

_MOST_POSES = 40


def picture_of(left: Structure, number: int, dataset: Dataset, sample: Sample) -> str | None:
    """The picture of one place as SVG; None where no points were measured, or the place is not one we can draw."""
    name = f"left{number}"
    if left.acts_on == ACTS_ON:
        return _of_left_out(left.where, name, dataset, sample)
    rest = sample.left(dataset)
    pointed = np.isfinite(rest[:, 0])
    if not pointed.any():
        return None
    if left.where == "tool target":
        targets = sample.column("target").astype(np.int64)
        names = sample.parts[0].conditions.target_names
        return pictures.by_group(targets[pointed], names, rest[pointed], name, "every tool target")
    if left.where == EACH_POSE:
        return _by_pose(sample, rest, pointed, name)
    if left.where == "region of the workspace":
        points = dataset.points[np.concatenate([part.rows for part in sample.parts])]
        return pictures.in_space(points[pointed], rest[pointed], name)
    parts = [quantity_of(left.where, part.conditions, dataset.header) for part in sample.parts]
    known = [part for part in parts if part is not None]
    if len(known) < len(parts):
        return None
    quantity = _joined(known)
    if "down" in left.where:
        rest = _in_tool(sample, rest)
    quantity = _taken(quantity, pointed)
    if quantity.values.shape[1] == 2:
        return pictures.over_two(quantity, rest[pointed], name, left.where)
    return pictures.over(quantity, rest[pointed], sample.held[pointed], name, left.where)


def _joined(parts: list[Quantity]) -> Quantity:
    group = None
    if parts[0].group is not None:
        group = np.concatenate([part.group for part in parts if part.group is not None])
    return Quantity(np.concatenate([p.values for p in parts]), parts[0].labels, group, parts[0].group_names)


def _taken(quantity: Quantity, rows: NDArray[np.bool_]) -> Quantity:
    group = None if quantity.group is None else quantity.group[rows]
    return Quantity(quantity.values[rows], quantity.labels, group, quantity.group_names)


def _in_tool(sample: Sample, rest: Array) -> Array:
    """(n, 3) what is left along the axes of the tool."""
    turns = [design.frames(sample.fitted.estimate, ()).rotation for design in sample.designs]
    return np.einsum("nji,nj->ni", np.concatenate(turns), rest)


def _by_pose(sample: Sample, rest: Array, pointed: NDArray[np.bool_], name: str) -> str | None:
    """The poses whose own errors are largest, of those that were visited again in the calibration."""
    pose = sample.parts[0].conditions.pose
    count = len(pose)
    rest, pose = rest[:count][pointed[:count]], pose[pointed[:count]]
    if not len(pose):
        return None
    visits = np.bincount(pose)
    means = np.array([np.bincount(pose, column) for column in rest.T]) / np.maximum(visits, 1)
    size = np.where(visits > 1, np.linalg.norm(means, axis=0), -1.0)
    largest = np.argsort(-size)[: min(_MOST_POSES, int(np.sum(visits > 1)))]
    if not len(largest):
        return None
    rank = np.full(len(visits), -1)
    rank[largest] = np.arange(len(largest))
    shown = rank[pose] >= 0
    labels = [str(k + 1) if (k + 1) % 5 == 0 or k == 0 else "" for k in range(len(largest))]
    return pictures.by_group(
        rank[pose][shown], labels, rest[shown], name, "every pose that was visited again, the largest first"
    )


def _of_left_out(where: str, name: str, dataset: Dataset, sample: Sample) -> str | None:
    """How far every calibration reading lies from the model, those that were left out among the others."""
    readings, out = all_readings(dataset, sample.fitted)
    predicted = Design(sample.fitted.model, readings.conditions).predict(sample.fitted.estimate)
    error = np.linalg.norm(dataset.points[readings.rows] - predicted, axis=1)
    seen = np.isfinite(error)
    quantity = quantity_of(where, readings.conditions, dataset.header)
    if quantity is None or not seen.any():
        return None
    return pictures.left_out(_taken(quantity, seen), error[seen], out[seen], name, where)
