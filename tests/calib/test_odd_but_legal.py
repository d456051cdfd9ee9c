"""Data sets that are odd but legal. Each of these once gave a wrong number without a word."""

from __future__ import annotations

from itertools import islice
from pathlib import Path

import numpy as np
import pytest

from calib import DataError, identify, read_dataset
from calib.diagnose import diagnose
from calib.units import to_internal
from mocks.campaign import make_campaign
from tests.benchmarks.misread import odd_sets
from tests.calib.campaigns import write_files


@pytest.mark.parametrize("seed", range(4))
def test_one_target_on_the_axis_with_the_tool_freed_claims_nothing(seed: int, tmp_path: Path) -> None:
    """Link 6 and the tool are confounded: whichever gives way, nothing may be named for it."""
    campaign = make_campaign(seed=seed, n=150, n_validation=30, effects=[], targets={"T1": (0.0, 0.0, 125.0)})
    header = {
        **campaign.header,
        "model": {"fit": ["base", "geometry", "parallel_twist", "compliance", "tool"]},
    }
    result = diagnose(read_dataset(write_files(tmp_path, campaign.rows, header)))
    assert result.verdict == "complete"
    assert result.base.noise_scale < 1.2


def test_clocks_of_two_series_may_both_start_at_zero(tmp_path: Path) -> None:
    """Sides of approach come from the row before in the same series.

    The clock of the other series does not matter.
    """
    campaign = make_campaign(seed=3, n=200, n_validation=0, effects=["backlash:j4"], approach="direct")
    rows = [dict(row) for row in campaign.rows]
    for i, row in enumerate(rows):
        second = i >= len(rows) // 2
        row["series"] = "b" if second else "a"
        row["t_s"] = (i - second * (len(rows) // 2)) * 20.0
        for key in [k for k in row if k.startswith(("approach", "prev"))]:
            del row[key]
    data = read_dataset(write_files(tmp_path, rows, campaign.header))
    joints, previous = data.conditions.joints, data.conditions.previous
    half = len(rows) // 2
    np.testing.assert_array_equal(previous[1:half], joints[: half - 1])
    np.testing.assert_array_equal(previous[half + 1 :], joints[half:-1])
    np.testing.assert_array_equal(previous[half], joints[half])


def test_a_nominal_world_may_be_turned(tmp_path: Path) -> None:
    """The nominal robot is placed at its position, for any rotation of the world frame."""
    campaign = make_campaign(seed=4, n=80, n_validation=20, effects=[])
    c, s = np.cos(2.5), np.sin(2.5)
    rows = [dict(row) for row in campaign.rows]
    for row in rows:
        x, y = row["x_mm"], row["y_mm"]
        row["x_mm"], row["y_mm"] = c * x - s * y + 3000.0, s * x + c * y - 2000.0
    for noise in ("nominal", "free"):
        header = {**campaign.header, "world": noise, "noise": {"kind": "isotropic", "sigma_mm": 0.02}}
        result = diagnose(read_dataset(write_files(tmp_path / noise, rows, header)))
        assert result.error_nominal is not None
        assert 0.5 < result.error_nominal.rms < 3.0


def test_what_stands_in_for_others_may_go_as_far_as_all_of_them(tmp_path: Path) -> None:
    """If one joint moves, the remaining parameter has the prior scale of all others.

    About twenty parameters are dropped.
    """
    sweeps = [(what, cell) for what, cell, _ in islice(odd_sets(12), 12) if what.startswith("sweep")]
    assert [what[9:16] for what, _ in sweeps] == ["joint 3", "joint 1", "joint 1"]
    for _, cell in sweeps:
        found = identify(cell.dataset(tmp_path))
        assert found.converged
        assert 0.85 < found.noise_scale < 1.15
        # and of those that could be left, one that need not go far in its own usual size
        moved = [
            p.size and found.estimate[found.model.index[p.name]] / to_internal(p.size, p.unit)
            for p in found.model.parameters
        ]
        assert max(abs(m) for m in moved if m is not None) < 5.0


def test_status_in_capitals_is_ok_and_other_words_are_refused(tmp_path: Path) -> None:
    campaign = make_campaign(seed=4, n=60, n_validation=0, effects=[])
    rows = [{**row, "status": "OK"} for row in campaign.rows]
    assert read_dataset(write_files(tmp_path, rows, campaign.header)).fit_rows.all()
    rows[7]["status"] = "good"
    with pytest.raises(DataError, match=r"line 9.*status.*good"):
        read_dataset(write_files(tmp_path, rows, campaign.header))


def test_a_rejected_row_may_hold_what_trackers_send_for_nothing(tmp_path: Path) -> None:
    campaign = make_campaign(seed=4, n=60, n_validation=0, effects=[])
    rows = [dict(row) for row in campaign.rows]
    rows[5] |= {"x_mm": 0.0, "y_mm": 0.0, "z_mm": 0.0, "status": "rejected:beam"}
    assert identify(read_dataset(write_files(tmp_path, rows, campaign.header))).converged


def test_one_uncertainty_of_three_is_refused(tmp_path: Path) -> None:
    campaign = make_campaign(seed=4, n=60, n_validation=0, effects=[])
    rows = [{**row, "u_x_mm": 5.0} for row in campaign.rows]
    with pytest.raises(DataError, match="u_x_mm"):
        read_dataset(write_files(tmp_path, rows, campaign.header))


def test_a_temperature_that_some_rows_lack_is_said_and_not_used(tmp_path: Path) -> None:
    """Rows to be predicted must have what the model needs, or the effect is not offered."""
    campaign = make_campaign(seed=11, n=150, n_validation=30, effects=["thermal_growth"])
    rows = [dict(row) for row in campaign.rows]
    for row in rows:
        if row["set"] == "validation":
            row["t_air_c"] = ""
    result = diagnose(read_dataset(write_files(tmp_path, rows, campaign.header)))
    assert "thermal_growth" not in {found.effect.label for found in result.effects}
    assert any("30 of 180 rows carry no temperature" in note for note in result.notes)
    assert result.error_after is not None
    assert np.isfinite(result.error_after.rms)
