"""Poses selected by observability, and poses whose targets look at the instrument."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from acquisition.campaign import Visit, draw_poses, make_plan, setup_of
from acquisition.campaign.plan import check_plan
from acquisition.cell.workspace import facing
from calib import forward
from calib.selection import candidates_of
from calib.units import DEG
from drivers import ConfigError
from tests.acquisition.fakes import a_campaign, a_cell


def plan_of(select: str, count: int = 40, cell: dict[str, Any] | None = None, **campaign: Any) -> list[Visit]:
    block = {"select": select, "count": count, "targets": ["T2", "T3"]}
    visits = make_plan(a_cell(**(cell or {})), a_campaign(block=[block], **campaign))
    return [visit for visit in visits if visit.kind == "pose"]


@pytest.fixture(scope="module")
def selected() -> list[Visit]:
    return plan_of("observability")


def log_det(visits: list[Visit]) -> float:
    joints = np.array([visit.joints_deg for visit in visits]) * DEG
    found = candidates_of(setup_of(a_cell(), ("T2", "T3")), joints)
    rows = (found.rows / found.unit).reshape(-1, len(found.unit))
    return float(np.linalg.slogdet(rows.T @ rows)[1])


def test_selected_poses_tell_more_than_random_ones_and_may_be_driven(selected: list[Visit]) -> None:
    assert len({visit.joints_deg for visit in selected}) == 40
    assert {visit.targets for visit in selected} == {("T2", "T3")}
    check_plan(a_cell(), selected)
    per_parameter = (log_det(selected) - log_det(plan_of("random"))) / 31
    assert per_parameter > np.log(1.2)


def test_the_seed_decides(selected: list[Visit]) -> None:
    assert plan_of("observability") == selected
    assert plan_of("observability", seed=4) != selected


def test_sides_are_drawn_independently_or_are_the_same(selected: list[Visit]) -> None:
    both = np.array([visit.sides for visit in selected])
    assert np.all(np.abs(both.mean(axis=0)) < 0.6)
    assert np.linalg.matrix_rank(both) == 6
    one = plan_of("observability", approach={"offset_deg": -5.0})
    assert {side for visit in one for side in visit.sides} == {1}


def test_too_few_poses_for_the_model_are_refused_by_block() -> None:
    with pytest.raises(ConfigError, match=r"block 1.*5 poses have 25 rows"):
        plan_of("observability", 5)
    with pytest.raises(ConfigError, match="random poses clear"):
        plan_of("observability", cell={"robot__table_z_mm": 5000.0})


NORMALS = {"T2": [0.0, 0.0, 1.0], "T3": [0.0, 0.0, 2.0]}


@pytest.mark.parametrize(("driver", "cone"), [("faro", 30.0), ("leica", 30.0), ("ctrack", 15.0)])
def test_targets_with_a_normal_look_at_the_instrument(driver: str, cone: float) -> None:
    cell = a_cell(tool__normals=NORMALS, instrument__driver=driver)
    drawn = draw_poses(cell, 50, np.random.default_rng(1), -5.0, both=True)
    poses = forward(cell.robot.model, np.array([pose.joints_deg for pose in drawn]) * DEG)
    station = np.array([2400.0, -900.0, 350.0])
    largest = 0.0
    for target in ("T2", "T3"):
        beam = station - (poses @ np.array([*cell.tool.targets[target], 1.0]))[:, :3]
        cosine = np.sum(beam * poses[:, :3, 2], axis=1) / np.linalg.norm(beam, axis=1)
        largest = max(largest, float(np.degrees(np.arccos(cosine)).max()))
    assert 0.7 * cone < largest <= cone
    low, high = np.array(cell.robot.limits_deg).T
    joints = np.random.default_rng(2).uniform(low, high, (500, 6))
    assert facing(cell, joints, ("T1",)).all()  # declares no normal
    assert not facing(cell, joints, ("T3",)).all()


def test_only_targets_that_are_measured_need_to_look() -> None:
    opposed = a_cell(tool__normals={"T1": [0, 0, 1], "T2": [0, 0, -1]})
    with pytest.raises(ConfigError, match="turn T1, T2 to the instrument within 30 deg"):
        draw_poses(opposed, 1, np.random.default_rng(1), -5.0, both=False)
    assert len(draw_poses(opposed, 5, np.random.default_rng(1), -5.0, both=False, targets=("T1", "T3"))) == 5
    campaign = a_campaign(block=[{"count": 5, "targets": ["T2"]}], reference_every=4)
    assert len([visit for visit in make_plan(opposed, campaign) if visit.set == "calibration"]) == 5


def test_candidates_are_as_many_as_are_found() -> None:
    high = a_cell(robot__table_z_mm=5000.0)
    assert draw_poses(high, 10, np.random.default_rng(1), -5.0, both=False, fewest=0) == []
    assert len(draw_poses(a_cell(), 700, np.random.default_rng(1), -5.0, both=False, fewest=0)) == 700
