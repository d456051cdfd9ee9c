"""Test the reported error and uncertainty measures on numbers that can be counted by hand."""

from __future__ import annotations

import numpy as np
import pytest

from calib.fit import expanded, statistics_of


def test_statistics_of_a_hundred_and_one_errors() -> None:
    found = statistics_of(np.arange(101.0))
    assert found is not None
    assert (found.n, found.mean, found.p95, found.max) == (101, 50.0, 95.0, 100.0)
    assert found.rms == pytest.approx(np.sqrt(100.0 * 201.0 / 6.0))
    assert statistics_of(np.zeros(0)) is None


def test_expanded_is_twice_the_largest_standard_uncertainty() -> None:
    np.testing.assert_allclose(expanded(np.diag([1.0, 9.0, 4.0])[None]), [6.0])
