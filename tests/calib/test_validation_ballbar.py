"""Test the validation of a model by a ballbar alone.

These would catch: a sphere judged without its sign, legs of a hexapod that pass for a sphere, scatter of repeated
distances that is not pooled, and a growth of error from another point.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from acquisition import campaign_from, checked_plan
from calib import Dataset, identify, judge, read_dataset
from calib.validation import judge_repeats, over_the_fixture, sphere_tests
from tests.calib.campaigns import Row, write_files
from tests.calib.test_spans import _CELL, LEGS, TRUTH, header_of, legs_of

CENTRE = [21.639, 49.752, -72.91, 0.0, -17.09, -111.639]
SPHERE = {
    "kind": "sphere",
    "base": "B1",
    "targets": ["T1"],
    "centre_deg": CENTRE,
    "above_deg": 20.0,
    "count": 20,
}
POINTS = legs_of(
    TRUTH,
    _CELL,
    checked_plan(_CELL, campaign_from({"format": "truepose-campaign/1", "block": [SPHERE]}, "test")),
)
OFF_MM = -0.25


def dataset(folder: Path, sphere: list[Row], repeated: int = 0) -> Dataset:
    rows = [*LEGS, *sphere, *(dict(row) for row in sphere[:3] for _ in range(repeated))]
    for k, row in enumerate(rows):
        row["reading_id"] = k
    u_mm = {"base_targets_u_mm": 0.3, "tool_targets_u_mm": 0.05}
    return read_dataset(write_files(folder, rows, header_of(_CELL, _CELL.nests, _CELL.tool.targets, **u_mm)))


def test_the_radial_error_has_a_sign_and_a_section_of_its_own(tmp_path: Path) -> None:
    shorter = [row | {"length_mm": row["length_mm"] + OFF_MM} for row in POINTS]
    read = dataset(tmp_path, shorter)
    found = identify(read)
    (test,) = sphere_tests(read, read.validation_rows, found.model, found.estimate)
    assert (test.target, test.base_target, len(test.errors_mm)) == ("T1", "B1", 20)
    assert test.radius_mm == pytest.approx(300.0, abs=3.0)
    assert test.mean_mm == pytest.approx(OFF_MM, abs=0.05)
    assert test.largest_mm == pytest.approx(np.abs(test.errors_mm).max())
    assert test.std_mm < 0.05
    judged = judge("m", read, read.validation_rows, found.model, found.estimate)
    assert judged.spheres[0].mean_mm == test.mean_mm


def test_legs_of_a_hexapod_are_no_sphere(tmp_path: Path) -> None:
    read = dataset(tmp_path, [])
    found = identify(read)
    assert sphere_tests(read, read.usable, found.model, found.estimate) == ()


def test_growth_from_the_point_over_the_fixture(tmp_path: Path) -> None:
    read = dataset(tmp_path, POINTS)
    found = identify(read)
    above = over_the_fixture(read)
    assert above is not None
    cups = np.array(list(_CELL.nests.values()))
    legs = np.linalg.norm(above - cups, axis=1)
    assert np.ptp(legs) < 1e-9
    assert above[2] > cups[:, 2].max()
    by = {g.title: g for g in judge("m", read, read.validation_rows, found.model, found.estimate).groupings}
    groups = by["distance from the point"].groups
    assert sum(summary.n for _, summary in groups) == int(read.validation_rows.sum())
    assert len(groups) > 2


def test_distances_measured_more_than_once_show_their_scatter(tmp_path: Path) -> None:
    read = dataset(tmp_path / "a", POINTS)
    found = identify(read)
    assert judge_repeats(read, found.model, found.estimate).lengths is None  # stances to judge by are others
    rng = np.random.default_rng(3)
    read = dataset(tmp_path / "b", POINTS, repeated=30)
    rows = np.flatnonzero(read.sets == "validation")[-90:]
    read.lengths[rows] = read.lengths[rows] + rng.normal(0.0, 0.02, 90)
    lengths = judge_repeats(read, found.model, found.estimate).lengths
    assert lengths is not None
    assert (lengths.poses, lengths.readings) == (3, 93)
    assert lengths.std_mm == pytest.approx(0.02, rel=0.25)
    assert lengths.worst_mm >= lengths.std_mm
