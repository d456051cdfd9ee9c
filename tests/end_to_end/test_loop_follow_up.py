"""The middle step of the closed loop on a simulated cell: ambiguous, followed up, resolved.

It works over the cell's sockets. These would catch: poses that do not distinguish the causes, and a second campaign on
a separate clock or in a separate frame. They would also catch validation rows that slip into the fit, and corrections
that still use the first diagnosis.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from acquisition import read_status
from acquisition.loop import LoopResult, close_loop, rehearsal
from acquisition.record.verification import read_landings, world_of
from calib import read_dataset
from calib.diagnose import POSES, SEPARATES
from service.cli import main
from tests.end_to_end.simulated import stepped_cell

EFFECT = "periodic:j5:n2"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("loop")


@pytest.fixture(scope="module")
def result(folder: Path) -> LoopResult:
    cell, campaign = rehearsal.write_files(folder, 2, EFFECT, 1.0, calibration=34, validation=8, narrow=True)
    with stepped_cell(cell) as equipment:
        return close_loop(equipment, campaign, folder, poses=5)


def test_what_was_ambiguous_is_settled(result: LoopResult) -> None:
    step = result.followed_up
    assert step is not None
    assert step.before.verdict == "ambiguous"
    (before,) = step.before.effects
    assert EFFECT in before.evidence.candidates
    assert not before.evidence.certain
    assert min(step.poses.separations.values()) > SEPARATES
    assert result.diagnosis.verdict == "attributed"
    (after,) = result.diagnosis.effects
    assert after.effect.label == EFFECT
    assert after.evidence.certain


def test_what_carries_over_is_better_for_it(result: LoopResult) -> None:
    step = result.followed_up
    assert step is not None
    before, after = step.before.error_after, result.diagnosis.error_after
    assert before is not None
    assert after is not None
    assert after.rms < 0.7 * before.rms  # validation poses lie all over the workspace
    assert result.verification.ratio < 1.6
    assert result.verification.uncorrected is not None
    assert result.verification.verified.rms < 0.1 * result.verification.uncorrected.rms


def test_both_campaigns_are_one_data_set(result: LoopResult, folder: Path) -> None:
    assert result.followed_up is not None
    alone, both = read_dataset(folder / "data1.csv"), read_dataset(result.data)
    n = len(alone)
    assert len(both) == n + POSES == n + result.followed_up.readings
    assert both.reading_id[:n] == alone.reading_id
    assert all(name.startswith("2-") for name in both.reading_id[n:])
    np.testing.assert_array_equal(both.sets[:n], alone.sets)
    assert set(both.sets[n:]) == {"calibration"}
    np.testing.assert_array_equal(both.points[:n], alone.points)
    # one clock: the follow-up begins after the last reading, not at zero
    assert both.conditions.time[n:].min() > alone.conditions.time.max()
    names = [both.conditions.target_names[t] for t in both.conditions.target[n:]]
    assert sorted(names) == sorted(result.followed_up.poses.targets)
    # one frame: that of the first campaign, not that of the nests measured again
    seen, world = read_landings(folder / "campaign_follow_up"), world_of(folder / "campaign1")
    np.testing.assert_allclose(both.points[n:], world.to_world(seen.points), atol=2e-6)
    assert np.max(np.abs(both.points[n:] - seen.own.to_world(seen.points))) > 1e-3


def test_records_are_joined_by_the_calendar_too(result: LoopResult, folder: Path, tmp_path: Path) -> None:
    """A person who runs both campaigns by hand joins them in the same way."""
    out = tmp_path / "joined.csv"
    first, later = folder / "campaign1", folder / "campaign_follow_up"
    assert main(["campaign", "export", str(first), str(out), "--with", str(later)]) == 0
    joined, both = read_dataset(out), read_dataset(result.data)
    assert joined.reading_id == both.reading_id
    np.testing.assert_array_equal(joined.points, both.points)
    np.testing.assert_allclose(joined.conditions.time, both.conditions.time, atol=1.0)


def test_every_campaign_has_its_record(result: LoopResult, folder: Path) -> None:
    records = sorted(path.name for path in folder.glob("campaign*/"))
    assert records == ["campaign1", "campaign2", "campaign_follow_up"]
    assert all(read_status(folder / name).state == "succeeded" for name in records)
    assert result.data == folder / "data.csv"
