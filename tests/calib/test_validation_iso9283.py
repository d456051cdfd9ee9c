"""ISO 9283 by hand: visits whose squares come out even, worked out in fractions, with n - 1."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
import pytest

from calib.validation.iso9283 import (
    distance_figures,
    figures_between,
    figures_of_pose,
    pose_accuracy,
    pose_repeatability,
    repeated_poses,
    unidirectional,
    variation,
)

# Offsets from the barycentre (they sum to zero), with lengths 5, 5, 10, 10 and 0.
OFFSETS = np.array([[3, 4, 0], [-3, -4, 0], [6, 0, 8], [-6, 0, -8], [0, 0, 0]], dtype=float)
LENGTHS = [Fraction(5), Fraction(5), Fraction(10), Fraction(10), Fraction(0)]


def test_pose_accuracy_and_repeatability_by_hand() -> None:
    mean = sum(LENGTHS) / len(LENGTHS)
    variance = sum((length - mean) ** 2 for length in LENGTHS) / (len(LENGTHS) - 1)
    assert (mean, variance) == (Fraction(6), Fraction(35, 2))
    visits = OFFSETS + np.array([101.0, 202.0, 302.0])
    assert pose_accuracy(visits, np.array([100.0, 200.0, 300.0])) == pytest.approx(3.0)  # |(1, 2, 2)|
    assert pose_repeatability(visits) == pytest.approx(float(mean) + 3.0 * math.sqrt(variance))
    assert pose_repeatability(visits) == pytest.approx(18.549900398)  # n in place of n - 1 would give 17.2250
    assert math.isnan(pose_repeatability(visits[:1]))


def test_distance_accuracy_and_repeatability_by_hand() -> None:
    first = np.zeros((4, 3))
    second = np.array([[99, 0, 0], [0, 101, 0], [0, 0, 103], [60, 80, 0]], dtype=float)
    distances = [Fraction(99), Fraction(101), Fraction(103), Fraction(100)]
    mean = sum(distances) / 4
    variance = sum((d - mean) ** 2 for d in distances) / 3
    assert (mean, variance) == (Fraction(403, 4), Fraction(35, 12))
    accuracy, repeatability = distance_figures(first, second, 100.0)
    assert accuracy == pytest.approx(0.75)
    assert repeatability == pytest.approx(3.0 * math.sqrt(35.0 / 12.0))


def test_variation_is_the_farthest_pair_of_barycentres() -> None:
    assert variation(np.array([[0, 0, 0], [1, 0, 0], [1, 2, 2]], dtype=float)) == pytest.approx(3.0)


def test_a_pose_from_two_directions() -> None:
    points = np.vstack([OFFSETS, OFFSETS + np.array([0.0, 12.0, 0.0]), [[999.0, 0.0, 0.0]]])
    sides = np.array([[1.0, 1.0]] * 5 + [[1.0, -1.0]] * 5 + [[1.0, 1.0]])
    angles = np.zeros((11, 3))
    angles[:5, 2], angles[5:10, 2] = 1e-3, -1e-3
    commands = np.tile([0.0, 2.0, 0.0], (11, 1))
    pose = figures_of_pose(np.arange(10), points, commands, angles, sides)
    assert (pose.reading, pose.visits, pose.directions) == (0, 10, 2)
    assert pose.accuracy == pytest.approx(4.0)  # barycentre at y = 6
    assert pose.variation == pytest.approx(12.0)
    assert pose.variation_angles == pytest.approx((0.0, 0.0, 2e-3))
    assert pose.accuracy_angles == pytest.approx((0.0, 0.0, 0.0))
    # from either direction the visits scatter as OFFSETS do and the angles not at all: what lies between is vAP
    assert pose.repeatability == pytest.approx(pose_repeatability(OFFSETS))
    assert pose.repeatability_angles == pytest.approx((0.0, 0.0, 0.0))


def test_one_visit_from_either_side_is_no_repeatability() -> None:
    """A sweep forth and back: what differs is the direction of approach."""
    sides = np.array([[1.0], [-1.0]])
    pose = figures_of_pose(np.arange(2), OFFSETS[:2], np.zeros((2, 3)), np.zeros((2, 3)), sides)
    assert math.isnan(pose.repeatability)
    assert (pose.repeatability_angles, pose.variation) == (None, None)
    np.testing.assert_array_equal(unidirectional(np.arange(3), np.array([[1.0], [-1.0], [-1.0]])), [1, 2])


def test_one_direction_has_no_variation_and_missing_orientations_no_angles() -> None:
    angles = np.full((5, 3), np.nan)
    pose = figures_of_pose(np.arange(5), OFFSETS, np.zeros((5, 3)), angles, np.ones((5, 6)))
    assert pose.accuracy == pytest.approx(0.0, abs=1e-12)
    assert (pose.variation, pose.variation_angles) == (None, None)
    assert (pose.accuracy_angles, pose.repeatability_angles) == (None, None)


def test_a_direction_of_one_visit_is_no_barycentre() -> None:
    sides = np.ones((5, 6))
    sides[0, 2] = -1.0
    pose = figures_of_pose(np.arange(5), OFFSETS, np.zeros((5, 3)), np.full((5, 3), np.nan), sides)
    assert pose.variation is None
    assert pose.directions == 2


def test_distances_pair_the_visits_in_turn_and_leave_out_the_surplus() -> None:
    points = np.array([[0, 0, 0], [10, 0, 0], [0, 0, 0], [12, 0, 0], [500, 0, 0]], dtype=float)
    commands = np.array([[0, 0, 0], [10, 0, 0]] * 2 + [[0, 0, 0]], dtype=float)
    pair = figures_between(np.array([0, 2, 4]), np.array([1, 3]), points, commands)
    assert (pair.readings, pair.visits) == ((0, 1), 2)
    assert pair.accuracy == pytest.approx(1.0)
    assert pair.repeatability == pytest.approx(3.0 * math.sqrt(2.0))


def test_repeats_are_found_by_command_series_and_target() -> None:
    joints = np.array([[0.1, 0.2], [0.3, 0.4], [0.1, 0.2], [0.1, 0.2], [0.3, 0.4 + 1e-12]])
    series = np.array([0, 0, 0, 1, 0])
    target = np.zeros(5, dtype=np.int64)
    assert [rows.tolist() for rows in repeated_poses(joints, series, target)] == [[0, 2], [1, 4]]
    assert repeated_poses(joints[:2], series[:2], target[:2]) == []
