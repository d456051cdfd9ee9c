"""The reason for which a fit ended.

The tests catch a fit that was cut off or is stuck and is reported as converged, or with the wrong reason.
"""

from __future__ import annotations

from functools import cached_property
from pathlib import Path

import numpy as np
import pytest

from calib import IdentificationFit, identify, read_dataset
from calib.array import Array
from calib.fit.ending import FitTermination
from calib.fit.identify import fit_plain
from calib.fit.least_squares import Linearisation, solve
from calib.model import BoundModel
from mocks.campaign import make_campaign, write_campaign


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> IdentificationFit:
    folder: Path = tmp_path_factory.mktemp("plain")
    write_campaign(make_campaign(seed=40, n=60, n_validation=10, effects=[]), folder)
    return identify(read_dataset(folder / "data.csv"))


class Backwards(Linearisation):
    """A derivative of the wrong sign: every step leads uphill."""

    @cached_property
    def columns(self) -> Array:
        return -super().columns


def test_a_fit_that_arrives(found: IdentificationFit) -> None:
    assert found.ending is FitTermination.CONVERGED
    assert found.converged
    assert not any("converge" in warning for warning in found.warnings)


def test_a_fit_that_is_cut_off_says_so(found: IdentificationFit, tmp_path: Path) -> None:
    write_campaign(make_campaign(seed=40, n=60, n_validation=10, effects=[]), tmp_path)
    start = np.zeros(len(found.estimate))
    start[:6] = found.estimate[:6] + 0.3
    cut = fit_plain(
        read_dataset(tmp_path / "data.csv"),
        found.model,
        found.readings,
        start,
        np.diag(found.covariance) > 0.0,
        found.dropped,
        max_iterations=2,
    )
    assert cut.ending is FitTermination.ROUNDS
    assert not cut.converged
    assert any("as many steps as it may. Do not use its parameters." in warning for warning in cut.warnings)


def test_a_fit_whose_every_step_leads_uphill(found: IdentificationFit) -> None:
    design = BoundModel(found.model, found.readings.conditions)
    away = found.estimate + 3.0 * found.standard_errors
    start = Backwards(design, found.readings.observed, away)
    solution = solve(start, np.diag(found.covariance) > 0.0)
    assert solution.ending is FitTermination.NO_DESCENT
    np.testing.assert_array_equal(solution.estimate, away)
