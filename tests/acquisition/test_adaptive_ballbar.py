"""Adaptive campaigns with a ballbar: stances whose legs a person measures, batch by batch.

These would catch: a person who is sent to legs out of stroke although the model knows better, an accuracy that counts
where the cups stand, a calibration that begins without them, and one that a crash or an abort leaves torn.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from acquisition.errors import UnsafePlan
from acquisition.loop import calibration_campaign
from acquisition.record import RecordStore
from acquisition.record.store import PlannedReading
from acquisition.run import adaptive
from acquisition.run.ballbar import driven_stances
from drivers import Answer, ConfigError
from tests.acquisition.bars import OFF_DEG, Bar, made
from tests.acquisition.fakes import BALLBAR, a_cell

ADAPTIVE: dict[str, Any] = {"block": [{"kind": "adaptive", "accuracy_mm": 0.1}], "off_deg": OFF_DEG}


@pytest.fixture(scope="module")
def bars(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    with made(Bar, tmp_path_factory.mktemp("bars"), **ADAPTIVE) as make:
        yield make


@pytest.fixture(scope="module")
def undisturbed(bars: Any) -> Bar:
    bar: Bar = bars()
    assert bar.execute() == "succeeded"
    return bar


def legs_of(bar: Bar) -> list[PlannedReading]:
    with RecordStore.reading(bar.folder) as store:
        return store.plan()


def test_it_ends_once_the_accuracy_is_reached(undisturbed: Bar) -> None:
    accuracy, legs = undisturbed.run.status().accuracy, legs_of(undisturbed)
    assert accuracy is not None
    assert accuracy["reached"]
    assert accuracy["floor_mm"] < accuracy["bound_mm"] <= 0.1
    visits = {each.visit.number for each in legs}
    assert 15 <= len(visits) <= 30
    assert len(legs) == 6 * len(visits)
    assert {each.status for each in legs} == {"measured", "skipped"}
    prompts = undisturbed.operator.asked
    assert sum(text.startswith("Take the ballbar off") for text in prompts) == len(visits)  # once a pose
    assert sum(text.startswith("Attach") for text in prompts) == len(legs)


def test_only_the_first_poses_have_legs_out_of_stroke(undisturbed: Bar) -> None:
    """From the second batch on, the robot is driven through the model."""
    legs = legs_of(undisturbed)
    skipped = [each for each in legs if each.status == "skipped"]
    assert skipped
    assert {each.visit.number for each in skipped} <= set(range(10))
    reasons = {each["reason"] for each in undisturbed.events_of("skipped")}
    assert all("out of the stroke" in reason for reason in reasons)
    first, later = (
        {each.visit for each in legs if (each.visit.number < 10) == first} for first in (True, False)
    )
    stances = {pose.joints_deg for pose in _pool(undisturbed).candidates}
    assert all(visit.joints_deg in stances for visit in first)
    assert not any(visit.joints_deg in stances for visit in later)
    for visit in later:
        goal = _pool(undisturbed).goal(visit.joints_deg, visit.readings)
        moved = np.subtract(visit.joints_deg, goal)
        np.testing.assert_allclose(moved, -np.array(OFF_DEG), atol=0.3)
        assert goal not in {each.joints_deg for each in first}


def test_the_limits_allow_for_what_one_model_may_be_off_where_no_leg_reaches(
    undisturbed: Bar, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The limit that decides allows for more than the one that is stated."""
    allowed = adaptive.look_at(undisturbed.folder)[0]
    monkeypatch.setattr(adaptive, "model_limit", lambda spread, covariance, _: np.sum(spread * covariance))
    alone = adaptive.look_at(undisturbed.folder)[0]
    assert allowed.rms_mm == alone.rms_mm
    assert allowed.bound_mm is not None
    assert allowed.deciding_mm is not None
    assert alone.bound_mm is not None
    assert alone.deciding_mm is not None
    more, deciding = allowed.bound_mm / alone.bound_mm, allowed.deciding_mm / alone.deciding_mm
    assert 1.01 < more < deciding


def _pool(bar: Bar) -> adaptive.Pool:
    campaign = bar.run.campaign
    found = adaptive.block_of(campaign)
    assert found is not None
    return adaptive.pool_of(found[1], adaptive.site_of(bar.bench.cell, campaign, found[0]))


def test_what_interrupts_it_changes_no_pose(bars: Any, undisturbed: Bar) -> None:
    bar = bars()
    bar.crash_at(110)
    assert bar.run.status().state == "paused"
    bar.run.resume()
    assert bar.execute() == "succeeded"
    again, before = ([each.visit.joints_deg for each in legs_of(each)] for each in (bar, undisturbed))
    assert again == before


def test_an_abort_ends_it_at_the_prompt(bars: Any) -> None:
    bar = bars(*[Answer.CONFIRM] * 75, Answer.ABORT)
    assert bar.execute() == "stopped"
    assert len(bar.operator.asked) == 76
    assert bar.run.status().accuracy["poses"] <= 10


def test_a_batch_that_may_not_be_driven_is_not_begun(bars: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    bar = bars()

    def unsafe(*_: object) -> None:
        raise UnsafePlan("pose 11: the elbow is in the table")

    monkeypatch.setattr(adaptive, "check_plan", unsafe)
    assert bar.execute() == "paused"
    assert {each.visit.number for each in legs_of(bar)} == set(range(10))


def test_a_stance_that_the_model_moves_out_of_reach_is_driven_as_it_is(
    undisturbed: Bar, monkeypatch: pytest.MonkeyPatch
) -> None:
    visit = legs_of(undisturbed)[0].visit
    fitted = adaptive.table_of(undisturbed.folder).dataset()
    from calib import identify

    found = identify(fitted)
    assert driven_stances.driven(undisturbed.bench.cell, found, [visit])[0].joints_deg != visit.joints_deg
    monkeypatch.setattr(driven_stances, "may_visit", lambda *_: np.array([False]))
    assert driven_stances.driven(undisturbed.bench.cell, found, [visit]) == [visit]


def test_the_outlook_counts_hands(tmp_path: Path) -> None:
    cell = a_cell(**BALLBAR)
    campaign, outlook = calibration_campaign(cell, accuracy_mm=0.06)
    kinds = [block.kind for block in campaign.blocks]
    assert kinds == ["ballbar_geometry", "adaptive"]
    assert outlook.targets == 6
    assert outlook.poses is not None
    assert outlook.mountings >= 6 * outlook.poses + 3 * 10
    assert outlook.measuring_minutes > 6 * outlook.poses * adaptive.MOUNTING_S / 60.0
    assert f"{outlook.mountings} times" in outlook.in_words()
    assert outlook.floor_mm < outlook.limit_mm <= 0.06
    few = calibration_campaign(cell, accuracy_mm=0.06, poses=2)[1]
    assert few.mountings == outlook.mountings - 3 * 8
    assert few.minutes < outlook.minutes


@pytest.mark.parametrize(
    ("cell", "asked", "words"),
    [
        ({"world__nests": {"B1": [486.6, 50, -100], "B2": [313.4, 150, -100]}}, {}, "three"),
        ({}, {"accuracy_mm": 0.004}, "cannot be reached"),
        ({}, {"minutes": 20.0}, "too short"),
        ({}, {"zone": {"x_mm": [5000.0, 5100.0]}}, "zone"),
    ],
)
def test_what_cannot_work_is_said_before_the_first_motion(
    cell: dict[str, Any], asked: dict[str, Any], words: str
) -> None:
    options: dict[str, Any] = {"accuracy_mm": 0.06, **asked}
    with pytest.raises(ConfigError, match=words):
        calibration_campaign(a_cell(**BALLBAR | cell), **options)
