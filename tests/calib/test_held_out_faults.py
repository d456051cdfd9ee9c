"""Test held-out readings of another target or with a gross error: reported, counted twice.

The error is counted with and without them.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib.data import Dataset
from calib.diagnose import DiagnosisFit, diagnose
from calib.fit.held_out import held_out_faults
from service.wording import verdict_in_words
from tests.calib.campaigns import simulate


@pytest.fixture(scope="module")
def clean(tmp_path_factory: pytest.TempPathFactory) -> tuple[Dataset, DiagnosisFit]:
    _, data = simulate(tmp_path_factory.mktemp("faults"), seed=8, n=90, n_validation=60, effects=[])
    return data, diagnose(data)


def test_nothing_is_faulty_in_a_good_set(clean: tuple[Dataset, DiagnosisFit]) -> None:
    data, found = clean
    assert found.held_out_faults.faults == ()
    assert found.held_out_faults.error_without == found.error_after
    assert not found.held_out_faults.rows.any()
    assert found.verdict == "complete"
    assert "held-out reading" not in verdict_in_words(found)
    assert len(data) == len(found.held_out_faults.rows)


def test_another_target_is_named_and_both_errors_are_stated(clean: tuple[Dataset, DiagnosisFit]) -> None:
    data, before = clean
    conditions = data.conditions
    assert len(conditions.target_names) > 1
    held = np.flatnonzero(data.validation_rows)[::12]
    target = conditions.target.copy()
    target[held] = (target[held] + 1) % len(conditions.target_names)
    found = diagnose(replace(data, conditions=replace(conditions, target=target)))
    np.testing.assert_array_equal(found.final.estimate, before.final.estimate)
    faults = found.held_out_faults
    assert {f.reading_id for f in faults.faults} == {data.reading_id[i] for i in held}
    for fault, row in zip(faults.faults, held, strict=True):
        assert fault.fits == conditions.target_names[conditions.target[row]]
        assert fault.target == conditions.target_names[target[row]]
    assert found.error_after is not None
    assert faults.error_without is not None
    assert faults.error_without.n == found.error_after.n - len(held)
    assert found.error_after.rms > 10.0 * faults.error_without.rms
    assert found.verdict == "excess_noise", "many faulty readings: nothing is complete"
    assert f"{faults.error_without.rms:.3f} mm RMS" in verdict_in_words(found)


def test_a_gross_error_fits_no_target_and_one_of_many_spoils_no_verdict(
    clean: tuple[Dataset, DiagnosisFit],
) -> None:
    data, _ = clean
    row = int(np.flatnonzero(data.validation_rows)[5])
    points = data.points.copy()
    points[row] += (7.0, -3.0, 2.0)
    found = diagnose(replace(data, points=points))
    (fault,) = found.held_out_faults.faults
    assert (fault.reading_id, fault.fits) == (data.reading_id[row], None)
    assert fault.error_mm == pytest.approx(np.linalg.norm((7.0, -3.0, 2.0)), rel=0.05)
    assert found.verdict == "complete"


def test_a_model_that_does_not_hold_makes_no_reading_faulty(
    clean: tuple[Dataset, DiagnosisFit], tmp_path: Path
) -> None:
    data, before = clean
    points = data.points.copy()
    points[data.validation_rows] += (0.5, 0.0, 0.0)
    moved = replace(data, points=points)
    assert held_out_faults(moved, before.final).faults == ()
