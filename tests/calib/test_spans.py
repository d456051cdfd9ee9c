"""Test distances between balls of one body, in which the arm takes no part.

These would catch: a distance that enters the fit as if the arm had measured it, one that is read and not used, and
one with its sign or unit wrong in the derivative. They would also catch a wrong bar or an impossible triangle that
is fitted, and one that moves the positions without a warning.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from calib import DataError, Dataset, IdentificationFit, identify, read_dataset
from calib.fit import offsets_of
from calib.model.model import ties
from service.results.models.positions import by_the_bar
from tests.benchmarks.nests import example, header_of, legs_of, truth_of
from tests.calib.campaigns import Row, write_files

U_MM = 0.001
SIDES = (("B1", "B2"), ("B2", "B3"), ("B3", "B1"), ("T1", "T2"), ("T2", "T3"), ("T3", "T1"))
_CELL, _VISITS = example()
TRUTH = truth_of(_CELL, 3)
BALLS = {**TRUTH.cups, **TRUTH.balls}
LEGS = legs_of(TRUTH, _CELL, _VISITS[::3])


def span(one: str, other: str, off_mm: float = 0.0) -> Row:
    length = float(np.linalg.norm(BALLS[one] - BALLS[other])) + off_mm
    row = dict.fromkeys(LEGS[0], "") | {
        "reading_id": f"{one}{other}",
        "length_mm": length,
        "other_target": other,
    }
    return row | {"tool_target" if one.startswith("T") else "base_target": one}


def dataset(folder: Path, spans: Sequence[Row], legs: Sequence[Row] = LEGS, **more: Any) -> Dataset:
    u_mm: Mapping[str, Any] = {"base_targets_u_mm": 0.3, "tool_targets_u_mm": 0.05}
    header = header_of(_CELL, _CELL.nests, _CELL.tool.targets, **{**u_mm, **more})
    blank = {"other_target": "", "status": ""}
    return read_dataset(write_files(folder, [blank | row for row in (*legs, *spans)], header))


def sides_mm(found: IdentificationFit) -> np.ndarray:
    """Return the errors of the sides of the fitted triangles, (6,), mm."""
    offsets = {each.name: np.array(each.offset_mm) for each in offsets_of(found)}
    places = {**found.model.anchors, **found.model.targets["main"]}
    now = {name: np.array(places[name]) + off for name, off in offsets.items()}
    return np.array([np.linalg.norm(now[a] - now[b]) - np.linalg.norm(BALLS[a] - BALLS[b]) for a, b in SIDES])


def test_measuring_the_triangles_pays(tmp_path: Path) -> None:
    few = LEGS[:48]  # eight poses: the legs alone hardly show the triangles
    without = identify(dataset(tmp_path / "a", (), few))
    found = identify(dataset(tmp_path / "b", [span(*side) for side in SIDES], few))
    assert np.abs(sides_mm(found)).max() < U_MM
    assert found.degrees_of_freedom == without.degrees_of_freedom + len(SIDES)
    along = U_MM * ties(found.model, found.estimate)[1]
    known, guessed = (np.sqrt(np.diag(along @ each.covariance @ along.T)) for each in (found, without))
    assert known.max() < 1.5 * U_MM
    assert guessed.min() > 3.0 * U_MM


def test_they_are_no_readings_of_the_arm(tmp_path: Path) -> None:
    read = dataset(tmp_path, [span(*side) for side in SIDES])
    assert len(read) == len(LEGS)
    assert [each.name for each in read.spans] == [f"{a} to {b}" for a, b in SIDES]
    assert [each.series for each in read.spans] == ["", "", "", "main", "main", "main"]


def test_derivative(tmp_path: Path) -> None:
    model = identify(dataset(tmp_path, [span(*side) for side in SIDES])).model
    at = np.random.default_rng(1).normal(0.0, 0.3, len(model.parameters))
    _, columns = ties(model, at)
    for position in range(len(at)):
        step = np.zeros_like(at)
        step[position] = 1e-4
        change = ties(model, at - step)[0] - ties(model, at + step)[0]
        np.testing.assert_allclose(columns[:, position], change / 2e-4, atol=1e-4)


def test_one_that_the_rest_does_not_bear_out_is_named(tmp_path: Path) -> None:
    spans = [span(*side) for side in SIDES[:3]] + [span("T1", "T2"), span("T2", "T3"), span("T3", "T1", 0.4)]
    warnings = identify(dataset(tmp_path, spans)).warnings
    inconsistent_distances = [text for text in warnings if text.startswith("The distance")]
    assert len(inconsistent_distances) == 1
    assert "T3 to T1 (reading T3T1" in inconsistent_distances[0]
    assert "measure it again" in inconsistent_distances[0]


def test_rejected_and_validation_rows_are_left_out(tmp_path: Path) -> None:
    rows = [span("B1", "B2") | {"status": "rejected:by hand"}, span("B2", "B3") | {"set": "validation"}]
    assert dataset(tmp_path, rows).spans == ()


@pytest.mark.parametrize(
    ("row", "said"),
    [
        (span("B1", "B2", 100.0), "line {line}: column 'length_mm' has 400.* the header puts 300.0 mm apart"),
        (span("B1", "B2") | {"tool_target": "T1"}, "line {line}.*Name the first of two different balls"),
        (span("B1", "B2") | {"other_target": "B1"}, "two different balls"),
        (span("B1", "B2") | {"other_target": "B9"}, "leads to 'B9', which the header does not have"),
        (span("T1", "T2") | {"other_target": "B1"}, "leads to 'B1', which the header does not have"),
        (span("B1", "B2") | {"length_mm": ""}, "holds no distance"),
    ],
)
def test_what_cannot_be_is_refused(tmp_path: Path, row: Row, said: str) -> None:
    with pytest.raises(DataError, match=said.format(line=len(LEGS) + 2)):
        dataset(tmp_path, [row])


def test_impossible_triangle(tmp_path: Path) -> None:
    free = dict.fromkeys(_CELL.nests, "free")
    spans = [span("B1", "B2"), span("B2", "B3"), span("B3", "B1", 350.0)]
    with pytest.raises(DataError, match="B1, B2, B3: they make no triangle"):
        dataset(tmp_path, spans, base_targets=free, base_targets_u_mm=0.0)


def test_nothing_but_spans(tmp_path: Path) -> None:
    header = header_of(_CELL, _CELL.nests, _CELL.tool.targets)
    with pytest.raises(DataError, match="distances between balls only"):
        read_dataset(write_files(tmp_path, [span(*side) for side in SIDES], header))


def test_base_balls_by_the_bar(tmp_path: Path) -> None:
    """The base balls from the measured sides, fitted to the stated ones, suit a cell file."""
    said = by_the_bar(dataset(tmp_path, [span(*side) for side in SIDES]))
    found = {name: np.array(json.loads(place)) for name, place in re.findall(r"(B\d) = (\[[^\]]+\])", said)}
    for one, other in SIDES[:3]:
        there = np.linalg.norm(BALLS[one] - BALLS[other])
        assert np.linalg.norm(found[one] - found[other]) == pytest.approx(there, abs=0.002)
    middle = np.mean([found[name] - np.array(_CELL.nests[name]) for name in found], axis=0)
    assert np.abs(middle).max() < 0.001
    assert by_the_bar(dataset(tmp_path / "none", [span("B1", "B2")])) == ""
