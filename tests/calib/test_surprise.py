"""Test the held-out misfit of a model, and structure that only few conditions show.

The conditions are a history of moves or a turning base. These would catch: few readings reported as extrapolation,
a verdict that ignores contradicting held-out readings, an effect judged by its small visible part, and a dependence
on the move before the last that has no place.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib import Dataset, identify, read_dataset
from calib.array import Array
from calib.data.read import moves_before_the_last
from calib.diagnose import diagnose
from calib.diagnose.found import surprise_of
from calib.diagnose.structure import BASE, TIME, left_over
from calib.effects.geometry import tool_shift
from calib.scan import Space
from calib.units import DEG
from service.results.models.diagnosed import DiagnosisOutcome
from service.wording import verdict_in_words
from tests.calib.campaigns import simulate


@pytest.fixture(scope="module")
def few(tmp_path_factory: pytest.TempPathFactory) -> list[Dataset]:
    """Thirty readings for some thirty parameters, twelve times."""
    return [
        simulate(tmp_path_factory.mktemp("few"), seed=seed, n=30, n_validation=40, effects=[])[1]
        for seed in range(12)
    ]


def test_few_readings_are_no_surprise(few: list[Dataset]) -> None:
    """A held-out error that agrees with the parameters' uncertainty is no misfit.

    It is far above the residual of the fit.
    """
    found = [surprise_of(data, identify(data)) for data in few]
    p = np.array([s.p_value for s in found if s is not None])
    assert len(p) == 12
    assert np.mean([s.times for s in found if s is not None]) == pytest.approx(1.0, abs=0.06)
    assert not any(s.real for s in found if s is not None)
    assert p.min() > 1e-3
    assert 0.15 < p.mean() < 0.85


def test_held_out_readings_that_contradict_a_verdict_are_told_before_it(few: list[Dataset]) -> None:
    data = few[0]
    points = data.points.copy()
    points[data.validation_rows] += (
        0.15,
        0.0,
        0.0,
    )  # all alike: the base has moved, where nothing was fitted
    result = diagnose(replace(data, points=points))
    assert result.verdict == "excess_noise", "a model that misses held-out readings is never complete"
    assert not result.effects
    assert result.surprise is not None
    assert result.surprise.real
    told = DiagnosisOutcome(result).document()["held_out_misfit"]
    assert told == {
        "times_expected": result.surprise.times,
        "p_value": result.surprise.p_value,
        "beyond": True,
    }
    words = verdict_in_words(result)
    assert "not all of those that were held out" in words
    assert "what the fit leaves" not in words
    assert surprise_of(replace(data, sets=np.full(len(data), "calibration")), result.final) is None


def test_an_effect_is_told_by_what_the_readings_show_of_it() -> None:
    """A tool that turned by 0.05 deg and hardly shifted."""
    turned = tool_shift(10.0)
    units = [p.unit for p in turned.parameters]
    values = np.where([u == "deg" for u in units], 0.03 * DEG, 1e-3)
    spread = np.where([u == "deg" for u in units], 0.002 * DEG, 3e-3)
    size, error, unit = turned.amplitude(values, np.diag(spread**2))
    assert (unit, size, error) == ("deg", pytest.approx(0.03 * np.sqrt(3.0)), pytest.approx(0.002))
    size, error, unit = turned.amplitude(
        values * np.where([u == "mm" for u in units], 100.0, 0.01), np.diag(spread**2)
    )
    assert (unit, size, error) == ("mm", pytest.approx(0.1 * np.sqrt(3.0)), pytest.approx(3e-3))


def moved(data: Dataset, by: Array) -> Dataset:
    """A data set whose points (n, 3) lie elsewhere."""
    return replace(data, points=data.points + by)


@pytest.fixture(scope="module")
def hundred(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    folder = tmp_path_factory.mktemp("hundred")
    return simulate(folder, seed=3, n=150, n_validation=0, effects=[], approach="offset")[1]


def test_a_base_that_leans_by_days_has_a_place(hundred: Dataset) -> None:
    day = (hundred.conditions.order * 6 // len(hundred)).astype(int)
    lean = np.random.default_rng(2).normal(size=(6, 3)) * 2e-4
    centre = hundred.points.mean(axis=0)  # about which the mean of the points stays where it is
    found = left_over(
        Space.of(identify(moved(hundred, np.cross(lean[day], hundred.points - centre).astype(np.float64))))
    )
    assert (found[0].where, found[0].acts_on) == (TIME, BASE)


def test_what_a_joint_keeps_of_the_move_before_the_last_has_a_place(hundred: Dataset) -> None:
    """Every pose is approached from 5 deg away; joint 1 keeps a part of the way to there."""
    c = hundred.conditions
    side = np.sign(moves_before_the_last(c)[:, 0])
    assert np.abs(np.mean(side * c.side[:, 0])) < 0.3, "the last move says nothing of it"
    across = np.column_stack([-hundred.points[:, 1], hundred.points[:, 0], np.zeros(len(hundred))])
    found = left_over(Space.of(identify(moved(hundred, side[:, None] * across * 1.5e-4))))
    assert (found[0].where, found[0].acts_on) == ("last move but one of joint 1", "joint 1")


ROWS = """reading_id,t_s,tool_target,{joints},{previous},x_mm,y_mm,z_mm
a,1,T1,{at0},{from5},400,10,500
b,2,T1,{at10},{from5},420,20,500
c,3,T2,{at10},{from5},430,20,540
d,4,T1,{at20},{at10},440,40,500
"""


def test_the_move_before_the_last_is_that_of_the_path(tmp_path: Path) -> None:
    """The move before the last is that of the path.

    It leads from the pose before to the start of the last move. If nothing lies between, it is the last move
    before.
    """
    names = {
        "joints": ",".join(f"j{k}_deg" for k in range(1, 7)),
        "previous": ",".join(f"prev{k}_deg" for k in range(1, 7)),
    }
    at = {
        name: ",".join([str(angle)] * 6)
        for name, angle in (("at0", 0), ("from5", 5), ("at10", 10), ("at20", 20))
    }
    (tmp_path / "d.csv").write_text(ROWS.format(**names, **at))
    (tmp_path / "d.toml").write_text(
        'format = "truepose-dataset/1"\nrobot = "abb-irb120"\n[tool_targets]\nT1 = [0, 0, 50]\nT2 = [0, 50, 50]\n'
        '[noise]\nkind = "isotropic"\nsigma_mm = 0.02\n'
    )
    earlier = read_dataset(tmp_path / "d.csv").conditions.earlier / DEG
    assert earlier[:, 0] == pytest.approx([0.0, 5.0, 5.0, 5.0]), (
        "b and c are one visit, d came straight from there"
    )
