"""A misspelt name is answered with the names that may be meant, not with all there are."""

from __future__ import annotations

from pathlib import Path

import pytest

from calib.arm.robot import built_in_robots, load_robot
from calib.errors import DataError
from calib.text.toml_table import did_you_mean


@pytest.mark.parametrize(
    ("typed", "meant"),
    [
        ("IRB 120", "'abb-irb120' or 'abb-irb1200-5-0.9'"),
        ("abb-irb210", "'abb-irb120'"),
        ("UR10", "'ur10' or 'ur10e'"),
        ("kr6", "'kuka-kr6-r900'"),
        ("lr mate", "'fanuc-lrmate200ic'"),
    ],
)
def test_the_nearest_robots_are_named(typed: str, meant: str) -> None:
    assert f"Did you mean {meant}" in did_you_mean(typed, built_in_robots())


@pytest.mark.parametrize("typed", ["", "-", "report.html", "\u00e4" * 500])
def test_nothing_is_guessed_where_nothing_is_near(typed: str) -> None:
    assert did_you_mean(typed, built_in_robots()) == ""


def test_the_refusal_of_a_robot_says_where_all_are_listed() -> None:
    with pytest.raises(DataError, match=r"Did you mean 'abb-irb120'.*truepose robot list") as refused:
        load_robot("abb irb 120", Path())
    assert len(str(refused.value)) < 250
