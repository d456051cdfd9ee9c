"""Follow-up poses as a campaign of a cell.

These would catch: a pose that the cell refuses, and a file that cannot be read back. They would also catch a side, a
target or a length of approach that is lost between choice and campaign file.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from acquisition import Cell, campaign_from, checked_plan, read_campaign, read_cell
from acquisition.loop import campaign_table, campaign_text, in_cell, rehearsal
from calib import DataError, DiagnosisFit, read_dataset
from calib.diagnose import POSES, FollowUp, diagnose, later_visits
from calib.diagnose.follow_up import choose
from calib.units import DEG
from drivers import ConfigError
from tests.end_to_end.simulated import EXAMPLE
from tests.service.campaigns import write_narrow_data

CELL = read_cell(EXAMPLE / "cell.toml")


@pytest.fixture(scope="module")
def diagnosis(tmp_path_factory: pytest.TempPathFactory) -> DiagnosisFit:
    return diagnose(read_dataset(write_narrow_data(tmp_path_factory.mktemp("narrow"))))


@pytest.fixture(scope="module")
def planned(diagnosis: DiagnosisFit) -> FollowUp:
    assert diagnosis.follow_up is not None
    return in_cell(CELL, diagnosis.final, diagnosis.follow_up.rivals)


def narrowed(limits: tuple[tuple[float, float], ...]) -> Cell:
    return CELL.model_copy(update={"robot": CELL.robot.model_copy(update={"limits_deg": limits})})


def test_the_campaign_drives_what_was_chosen(planned: FollowUp, tmp_path: Path) -> None:
    file = tmp_path / "follow_up.toml"
    file.write_text(campaign_text(planned, CELL), encoding="utf-8")
    visits = [visit for visit in checked_plan(CELL, read_campaign(file)) if visit.kind == "pose"]
    assert len(visits) == POSES
    assert all(visit.set == "calibration" for visit in visits)
    driven = {
        (visit.joints_deg, visit.targets, round(visit.joints_deg[0] - visit.approach_deg[0], 3))
        for visit in visits
    }
    asked = {
        (tuple(joints), (target,), round(float(side * approach) / DEG, 3))
        for joints, target, side, approach in zip(
            np.round(planned.joints / DEG, 4).tolist(),
            planned.targets,
            planned.sides,
            planned.approach,
            strict=True,
        )
    }
    assert driven == asked
    assert all(len(set(visit.sides)) == 1 for visit in visits)


def test_the_file_says_what_it_is_for(planned: FollowUp) -> None:
    text = campaign_text(planned, CELL)
    for label, rival in planned.separations:
        assert f"# {label} from {rival}: expected squared distance" in text
    assert f"within the cell {CELL.name}" in text
    assert "no cell were looked at" in campaign_text(planned)


def test_settings_come_from_the_first_campaign(planned: FollowUp) -> None:
    settings = {"settle_s": 7.0, "samples": 33, "retries": 1}
    first = campaign_from(rehearsal.campaign_table(1, 4, 1) | settings, "test")
    table = campaign_table(planned, first)
    assert (table["settle_s"], table["samples"], table["retries"]) == (7.0, 33, 1)


def test_chosen_poses_separate_far_better_than_random_ones(
    diagnosis: DiagnosisFit, planned: FollowUp
) -> None:
    final = diagnosis.final
    rng = np.random.default_rng(1)
    joints = rng.uniform(-30.0, 30.0, (POSES, 6)) * DEG + planned.joints.mean(axis=0)
    random = later_visits(final, joints, np.ones(POSES), np.full(POSES, 5.0 * DEG), ["T1"] * POSES)
    _, brought = choose(final, planned.rivals, random, POSES)
    assert min(planned.separations.values()) > 3.0 * float(brought.min())


def test_short_ranges_leave_out_long_approaches(diagnosis: DiagnosisFit) -> None:
    assert diagnosis.follow_up is not None
    small = tuple((middle - 12.0, middle + 12.0) for middle in (0.0, 20.0, -40.0, 0.0, 30.0, 0.0))
    chosen = in_cell(narrowed(small), diagnosis.final, diagnosis.follow_up.rivals)
    np.testing.assert_allclose(chosen.approach, 5.0 * DEG)
    low, high = np.array(small).T * DEG
    stood = np.vstack([chosen.joints, chosen.joints - (chosen.sides * chosen.approach)[:, None]])
    assert np.all((stood >= low - 1e-6) & (stood <= high + 1e-6))


def test_a_cell_that_does_not_fit_is_refused(diagnosis: DiagnosisFit) -> None:
    assert diagnosis.follow_up is not None
    rivals = diagnosis.follow_up.rivals
    tool = CELL.tool.model_copy(update={"targets": {"A": (0.0, 0.0, 100.0)}})
    others = CELL.model_copy(update={"tool": tool})
    with pytest.raises(DataError, match="has the targets A, the data have T1, T2, T3"):
        in_cell(others, diagnosis.final, rivals)
    with pytest.raises(ConfigError, match="random poses"):
        in_cell(narrowed(((-1.0, 1.0),) * 6), diagnosis.final, rivals)
