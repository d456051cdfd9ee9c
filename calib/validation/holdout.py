"""Error of the base model by kind of hold-out, on which the error depends.

The readings that may enter a fit are split again, five times by each rule, and the base model is fitted to the rest:

    random   poses drawn at random: each has neighbours in the fit, which is optimistic
    region   slabs of the workspace along the direction in which the robot moved most
    time     fifths of every series in the order of measuring
    series   one whole series; the robot from the others is then placed on every second reading of it

All visits of one pose stay together, except in time. Rows of `set = validation` take no part at all.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calib.arm.kinematics import forward
from calib.array import Array
from calib.data.dataset import Dataset
from calib.errors import DataError
from calib.fit.held_out import errors_on
from calib.fit.identify import identify
from calib.validation.place import FEWEST, place
from calib.validation.summary import Summary, summarise

FOLDS = 5
SEED = 1

Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class HoldOutErrors:
    """Position errors of one kind of hold-out, mm, of all folds together.

    Attributes
    ----------
    left_out : int
        Number of readings that cannot be judged, since their series or their unknown tool target had no reading left in
        the fit.
    """

    kind: str
    folds: int
    errors: Summary | None
    left_out: int


def hold_outs(
    dataset: Dataset, *, folds: int = FOLDS, progress: Callable[[str], None] = lambda _: None
) -> list[HoldOutErrors]:
    """Compute the errors of the base model by kind of hold-out.

    Raises
    ------
    DataError
        There are fewer poses than folds, or the readings outside a fold do not determine the model.
    """
    rows = dataset.fit_rows & (dataset.pointed | dataset.spanned)
    poses = len(np.unique(dataset.conditions.pose[rows]))
    if poses < folds:
        raise DataError(
            f"has {poses} poses with a measured point or distance to hold out, in {folds} parts.",
            do="Measure more poses with set = calibration, or give the model to judge with --model M.json.",
            file=dataset.path,
            key="set",
        )
    out = []
    for kind, split in (("random", _random), ("region", _region), ("time", _time)):
        progress(f"holding out by {kind}")
        out.append(_pooled(kind, [_judge(dataset, held) for held in split(dataset, rows, folds)]))
    if len(dataset.conditions.series_names) > 1:
        progress("holding out by series")
        out.append(_pooled("series", list(_by_series(dataset, rows))))
    return out


def without(dataset: Dataset, held: Mask) -> Dataset:
    """Move the rows `held` of a data set to the validation set."""
    return replace(dataset, sets=np.where(held, "validation", dataset.sets))


def _pooled(kind: str, parts: list[tuple[Array, int]]) -> HoldOutErrors:
    errors = np.concatenate([found for found, _ in parts])
    return HoldOutErrors(kind, len(parts), summarise(errors), sum(lost for _, lost in parts))


def _judge(dataset: Dataset, held: Mask) -> tuple[Array, int]:
    """Compute the errors of the held rows with the model of the others.

    Also returns the number of rows that cannot be judged.
    """
    rest = without(dataset, held)
    judged = held & _placed(dataset, rest.fit_rows & (rest.pointed | rest.spanned))
    found = identify(rest)
    return errors_on(dataset, judged, found.model, found.estimate), int(held.sum() - judged.sum())


def _placed(dataset: Dataset, fitted: Mask) -> Mask:
    """Mark the rows (n,) whose series has `FEWEST` readings or more among those fitted.

    If the model frees the tool, their target must have as many readings in that series.
    """
    conditions = dataset.conditions
    kinds = [conditions.series]
    if "tool" in dataset.header.groups:
        kinds.append(conditions.target)
    _, which = np.unique(np.column_stack(kinds), axis=0, return_inverse=True)
    return np.bincount(which[fitted], minlength=which.max() + 1)[which] >= FEWEST


def _random(dataset: Dataset, rows: Mask, folds: int) -> Iterator[Mask]:
    pose = dataset.conditions.pose
    draw = np.random.default_rng(SEED).permutation(pose.max() + 1)
    for k in range(folds):
        yield rows & (draw[pose] % folds == k)


def _region(dataset: Dataset, rows: Mask, folds: int) -> Iterator[Mask]:
    # In the base frame, in which the series share their positions.
    places = forward(dataset.header.robot, dataset.conditions.joints)[:, :3, 3]
    centred = places - places[rows].mean(axis=0)
    along = centred @ np.linalg.svd(centred[rows], full_matrices=False)[2][0]
    pose = dataset.conditions.pose
    kinds, first = np.unique(pose[rows], return_index=True)
    slab = np.zeros(pose.max() + 1, dtype=int)
    order = np.argsort(along[rows][first], kind="stable")
    slab[kinds[order]] = np.arange(len(kinds)) * folds // len(kinds)
    for k in range(folds):
        yield rows & (slab[pose] == k)


def _time(dataset: Dataset, rows: Mask, folds: int) -> Iterator[Mask]:
    conditions = dataset.conditions
    fifth = np.zeros(len(dataset), dtype=int)
    for s in range(len(conditions.series_names)):
        here = np.flatnonzero(rows & (conditions.series == s))
        here = here[np.argsort(conditions.order[here], kind="stable")]
        fifth[here] = np.arange(len(here)) * folds // max(len(here), 1)
    for k in range(folds):
        yield rows & (fifth == k)


def _by_series(dataset: Dataset, rows: Mask) -> Iterator[tuple[Array, int]]:
    conditions = dataset.conditions
    for s in range(len(conditions.series_names)):
        held = rows & (conditions.series == s)
        found = identify(without(dataset, held))
        second = np.zeros(len(dataset), dtype=bool)
        second[np.flatnonzero(held)[::2]] = True
        fitted = (rows & ~held) | second
        model, estimate = place(dataset, found.model, found.estimate, fitted)
        left = held & ~second
        judged = left & _placed(dataset, fitted)
        yield errors_on(dataset, judged, model, estimate), int(left.sum() - judged.sum())
