"""Test a part of the real measurements: UR10, series B, 600 of 1,495 poses.

20 % are drawn at random and held out. These data have properties that no simulator contains. They would catch a
start, a robust fit or a search that works on simulated campaigns alone.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from calib import Dataset, DiagnosisFit, read_dataset
from calib.convert import ConvertedTable
from calib.convert.ipa_ur10 import read
from calib.diagnose import diagnose

DATA = Path(__file__).resolve().parents[3] / "shared" / "data" / "ur10_leica"
pytestmark = pytest.mark.skipif(
    not (DATA / "series_B.csv").is_file(), reason="the measured UR10 is not beside the repository"
)


@pytest.fixture(scope="module")
def diagnosed(tmp_path_factory: pytest.TempPathFactory) -> tuple[Dataset, DiagnosisFit]:
    table = read(DATA / "series_B.csv")
    rows = np.sort(np.random.default_rng(2).choice(len(table), 600, replace=False))
    part = ConvertedTable(
        {name: [cells[i] for i in rows] for name, cells in table.columns.items()}, table.header
    )
    path = tmp_path_factory.mktemp("ur10") / "part.csv"
    part.hold_out("random", 0.2, 1).write(path)
    data = read_dataset(path)
    return data, diagnose(data, most=8)


def test_the_base_model_is_below_half_a_millimetre(diagnosed: tuple[Dataset, DiagnosisFit]) -> None:
    data, result = diagnosed
    assert int(data.validation_rows.sum()) == 120
    assert result.base.converged
    assert result.error_before is not None
    assert result.error_nominal is not None
    assert result.error_before.n == 120
    assert result.error_before.rms < 0.50
    assert result.error_nominal.rms > 1.5 * result.error_before.rms
    assert len(result.base.faulty_rows) < 0.05 * 480


def test_the_effects_found_help_on_readings_that_were_held_out(
    diagnosed: tuple[Dataset, DiagnosisFit],
) -> None:
    _, result = diagnosed
    assert result.error_after is not None
    assert result.error_before is not None
    assert result.final.converged
    assert result.error_after.rms < 0.85 * result.error_before.rms
    assert result.error_after.p95 < result.error_before.p95
    named = [f.effect.label for f in result.effects if f.effect.label.startswith("periodic")]
    carried = [term.place for term in result.carried if term.condition.endswith("angle")]
    assert len(named) + len(carried) >= 4, "a UR10 is dominated by periodic errors of its joints"
    assert {f"joint {k}" for k in (1, 2, 3)} <= {*carried, *(f"joint {n[10]}" for n in named)}


def test_what_these_readings_cannot_show_is_said(diagnosed: tuple[Dataset, DiagnosisFit]) -> None:
    _, result = diagnosed
    text = " ".join(result.notes)
    assert "no time" in text
    assert "One tool target" in text
    assert result.verdict in ("unexplained", "ambiguous"), "eight effects are not all of it"
