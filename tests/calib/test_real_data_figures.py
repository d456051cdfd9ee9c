"""Test that the benchmark of real measurements fails for worse results or absent data."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.benchmarks import real_data
from tests.benchmarks.real_data import Figures, kept

ENTERED = {"base": 0.2, "named": 0.15, "carried": 0.1}
FIGURES = Figures(1.0, 0.2, 0.15, 0.1, "attributed", 1, 2, 3.0, 0.3)


@pytest.mark.parametrize(
    ("changed", "passes"),
    [
        ({}, True),
        ({"carried": 0.1019}, True),
        ({"carried": 0.1021}, False),
        ({"named": 0.16}, False),
        ({"base": 0.21}, False),
        ({"carried": None}, False),
        ({"memory_gb": 1.1}, False),
        ({"carried": 0.05, "seconds": 99.0}, True),
    ],
)
def test_a_figure_may_be_two_percent_worse_than_the_entered_one(
    changed: dict[str, float | None], passes: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    figures = Figures(**{**vars(FIGURES), **changed})  # type: ignore[arg-type]
    assert kept("p3", figures, ENTERED) is passes
    assert ("WORSE" in capsys.readouterr().out) is (not passes and "memory_gb" not in changed)


def test_a_set_without_entered_figures_passes() -> None:
    assert kept("p3", FIGURES, {})


def test_absent_data_are_reported_and_fail(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(real_data, "SHARED", tmp_path)
    assert not real_data.run(["p3"])
    assert str(tmp_path) in capsys.readouterr().out


def test_every_set_has_entered_figures() -> None:
    assert json.loads(real_data.ENTERED.read_text("utf-8")).keys() == real_data.YARDSTICKS.keys()
