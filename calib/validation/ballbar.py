"""Judgement of a calibrated robot by a ballbar alone.

**Sphere test.** One target moves over a sphere about one ball on the base, with constant orientation of the tool. The
radial error is the measured distance less the distance that a model predicts.

**Repeatability.** It is the scatter of distances that were measured more than once at the same pose.

**Growth of the error.** The error grows with the distance from the point over the fixture that all legs reach, Figure
4.7. Lengths are in mm. Source: Nubiola, thesis, 2.6.3 and 4.4.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.arm.hexapod import trilaterated
from calib.arm.kinematics import forward
from calib.array import Array
from calib.data.dataset import Dataset
from calib.fit.held_out import length_differences
from calib.model.model import ModelStructure

FEWEST = 10
"""Points of a sphere: fewer are chance neighbours of other campaigns."""
_ALIKE = np.cos(np.radians(2.0))  # turns of the tool that count as the same


@dataclass(frozen=True)
class SphereTest:
    """Result of a sphere test: a target about a ball on the base.

    Attributes
    ----------
    errors_mm : array of shape (n,)
        Measured less predicted radius, mm.
    """

    target: str
    base_target: str
    radius_mm: float
    errors_mm: Array

    @property
    def n(self) -> int:
        """Number of distances."""
        return len(self.errors_mm)

    @property
    def mean_mm(self) -> float:
        return float(np.mean(self.errors_mm))

    @property
    def std_mm(self) -> float:
        return float(np.std(self.errors_mm, ddof=1))

    @property
    def largest_mm(self) -> float:
        return float(np.max(np.abs(self.errors_mm)))


@dataclass(frozen=True)
class LengthRepeats:
    """Distances measured more than once at one pose: number, pooled and worst scatter, mm."""

    poses: int
    readings: int
    std_mm: float
    worst_mm: float


def sphere_tests(
    dataset: Dataset, rows: NDArray[np.bool_], model: ModelStructure, estimate: Array
) -> tuple[SphereTest, ...]:
    """Judge every sphere among the distances of some rows (mask) with a model."""
    out = []
    for sphere in spheres_of(dataset, rows):
        conditions, first = dataset.conditions, int(np.flatnonzero(sphere)[0])
        out.append(
            SphereTest(
                conditions.target_names[conditions.target[first]],
                conditions.anchor_names[conditions.anchor[first]],
                float(np.median(dataset.lengths[sphere])),
                length_differences(dataset, sphere, model, estimate),
            )
        )
    return tuple(out)


def spheres_of(dataset: Dataset, rows: NDArray[np.bool_]) -> list[NDArray[np.bool_]]:
    """Find the spheres among the distances; return a mask (n,) for each.

    A sphere has one distance in each pose, from one target to one ball, always with the same orientation of the tool.
    """
    conditions = dataset.conditions
    spanned = np.flatnonzero(rows & dataset.usable & dataset.spanned)
    legs = np.unique(
        np.column_stack([conditions.pose, conditions.target, conditions.anchor])[spanned], axis=0
    )
    standings, count = np.unique(legs[:, 0], return_counts=True)
    alone = spanned[np.isin(conditions.pose[spanned], standings[count == 1])]
    turned = forward(dataset.header.robot, conditions.joints[alone])[:, :3, :3]
    key = np.column_stack([conditions.series, conditions.target, conditions.anchor])[alone]
    found = []
    for pair in np.unique(key, axis=0):
        here = np.flatnonzero(np.all(key == pair, axis=1))
        cosine = (np.einsum("aij,bij->ab", turned[here], turned[here]) - 1.0) / 2.0
        most = int(np.argmax((cosine > _ALIKE).sum(axis=1)))
        alike = here[cosine[most] > _ALIKE]
        if len(alike) >= FEWEST:
            mask = np.zeros(len(dataset), dtype=bool)
            mask[alone[alike]] = True
            found.append(mask)
    return found


def repeats_of_lengths(dataset: Dataset) -> LengthRepeats | None:
    """Compute the scatter of distances repeated at one pose from the same sides.

    The result is None if no distance was repeated.
    """
    conditions = dataset.conditions
    rows = np.flatnonzero(dataset.usable & dataset.spanned)
    key = np.column_stack(
        [conditions.pose, conditions.series, conditions.target, conditions.anchor, conditions.side]
    )[rows]
    _, which, count = np.unique(key, axis=0, return_inverse=True, return_counts=True)
    which = which.reshape(-1)
    repeated = count > 1
    if not repeated.any():
        return None
    lengths = dataset.lengths[rows]
    mean = np.bincount(which, lengths) / count
    square = np.bincount(which, (lengths - mean[which]) ** 2)[repeated]
    freedom = count[repeated] - 1
    return LengthRepeats(
        int(repeated.sum()),
        int(count[repeated].sum()),
        float(np.sqrt(square.sum() / freedom.sum())),
        float(np.sqrt(np.max(square / freedom))),
    )


def over_the_fixture(dataset: Dataset) -> Array | None:
    """Find the point (3,) above three balls of the base that all legs reach, world, mm.

    The result is None if there is no such point.
    """
    places = [np.array(place) for place in dataset.header.base_targets.values()]
    rows = dataset.usable & dataset.spanned
    if len(places) < 3 or not rows.any():
        return None
    one, two, three = (place[None] for place in places[:3])
    leg = np.full(1, float(np.median(dataset.lengths[rows])))
    up = np.sign(np.cross(two - one, three - one)[:, 2])
    point = trilaterated(one, two, three, leg, leg, leg, up)[0]
    return point if np.all(np.isfinite(point)) else None
