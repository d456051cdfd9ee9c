"""Forecast of a campaign's duration.

It is counted by hand for a few moves, and scaled by the actual progress.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from acquisition.campaign.plan import READING_S, Forecast, make_plan
from acquisition.campaign.poses import START_AND_STOP_S
from tests.acquisition.fakes import a_campaign, a_cell

AT = [0.0, 40.0, 20.0, 0.0, 30.0, 0.0]


def forecast_of(*blocks: dict[str, Any], speed_deg_s: float = 10.0, **campaign: Any) -> Forecast:
    cell = a_cell(robot__speed_deg_s=speed_deg_s)
    the_campaign = a_campaign(block=list(blocks), approach={"offset_deg": -5.0}, **campaign)
    return Forecast.of(cell, the_campaign, make_plan(cell, the_campaign))


def listed(*turns: float, **block: Any) -> dict[str, Any]:
    """Poses that differ in joint 6."""
    poses = [[*AT[:5], turn] for turn in turns]
    return {"select": "list", "joints_deg": poses, "targets": ["T1", "T2"]} | block


def test_moves_settling_and_readings_are_counted() -> None:
    reading = READING_S + 10 / 1000.0  # ten samples
    # To the approach point 5 deg away and back; then 40 deg less 5, and 5 again; 4 s of settling each.
    first = 2 * (0.5 + START_AND_STOP_S) + 4.0 + 2 * reading
    second = 3.5 + 0.5 + 2 * START_AND_STOP_S + 4.0 + 2 * reading
    assert forecast_of(listed(0.0, 40.0)).total_s == pytest.approx(first + second)
    assert forecast_of(listed(0.0, 40.0), warm_up_s=60.0).total_s == pytest.approx(60.0 + first + second)
    assert forecast_of(listed(0.0, 40.0, settle_s=1.0)).total_s == pytest.approx(first + second - 6.0)
    left = forecast_of(listed(0.0, 40.0)).seconds_left(3, 0, first + second - reading)
    assert left == pytest.approx(reading)


def test_a_fast_joint_is_held_back_by_the_speed_of_the_flange() -> None:
    swing = {"select": "list", "joints_deg": [[-60.0, *AT[1:]], [60.0, *AT[1:]]], "targets": ["T1"]}
    cell = a_cell(robot__speed_mm_s=10.0)
    campaign = a_campaign(block=[swing], approach={"offset_deg": -5.0})
    slow = Forecast.of(cell, campaign, make_plan(cell, campaign)).total_s
    assert slow > 30.0 + forecast_of(swing, speed_deg_s=20.0).total_s


@given(
    readings=st.lists(st.floats(0.1, 100.0), min_size=1, max_size=30),
    before=st.floats(0.0, 1000.0),
    factor=st.floats(0.1, 10.0),
    data=st.data(),
)
def test_what_is_left_scales_with_how_it_came_on(
    readings: list[float], before: float, factor: float, data: st.DataObject
) -> None:
    forecast = Forecast(before, np.array(readings))
    begun = data.draw(st.integers(0, len(readings)))
    done = data.draw(st.integers(begun, len(readings)))
    assert forecast.seconds_left(0) == pytest.approx(forecast.total_s)
    assert forecast.seconds_left(len(readings), begun, 10.0) <= before
    if done > begun:
        elapsed = factor * (before + sum(readings[begun:done]))
        left = forecast.seconds_left(done, begun, elapsed)
        assert left == pytest.approx(factor * sum(readings[done:]), abs=1e-6)
    else:
        waited = forecast.seconds_left(done, begun, before + 1.0)
        assert waited == pytest.approx(max(0.0, sum(readings[done:]) - 1.0), abs=1e-6)


def test_a_path_that_is_driven_again_has_its_own_time_left() -> None:
    """The time of a failed attempt is not subtracted from the time of the next attempt."""
    forecast = Forecast(0.0, np.array([600.0, 10.0]))
    assert forecast.seconds_left(0, 0, 900.0, 0.25) == pytest.approx(460.0)
    assert forecast.seconds_left(0, 0, 100.0) == pytest.approx(510.0)
    # once a reading is done, at the pace of what was done
    assert forecast.seconds_left(1, 0, 1200.0, 0.5) == pytest.approx(10.0)
