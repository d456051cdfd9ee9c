"""Test control charts and due dates.

They are compared with printed examples, hand computation, and draws of steady parameters.
"""

from __future__ import annotations

from datetime import UTC, datetime, timedelta

import numpy as np
import pytest
from scipy import stats

from calib.errors import DataError
from calib.upkeep import Check, DriftInterval, InUse, Method, Staircase, chart_of, next_due

START = datetime(2026, 1, 1, tzinfo=UTC)
LATE = START + timedelta(days=30)


def checks(values: list[float], every: float = 100.0, u: float = 0.02, used: float = 0.0) -> list[Check]:
    """Build checks that are `every` days apart, after `used` further hours each."""
    return [
        Check(START + timedelta(days=every * i), v, u, used * i if used else None)
        for i, v in enumerate(values)
    ]


def days(method: Method, history: list[Check], late: float = 0.0) -> float:
    """Days from the last check until the next."""
    last = max(check.at for check in history)
    return (next_due(method, history, last + timedelta(days=late)).date - last) / timedelta(days=1)


def test_centre_and_scatter_are_those_of_a_printed_example() -> None:
    """NIST/SEMATECH e-Handbook 6.3.2.2: flow rates, mean 50.81, mean moving range 1.8778."""
    flow = [49.6, 47.6, 49.9, 51.3, 47.8, 51.2, 52.6, 52.4, 53.6, 52.1]
    chart = chart_of(checks(flow, u=0.0), reference=10)
    assert chart.centre == pytest.approx(50.81)
    assert chart.sigma == pytest.approx(1.8778 / 1.128, rel=1e-3)
    assert chart.signals == ()
    assert [s.index for s in chart_of(checks([*flow, 70.0], u=0.0)).signals if s.chart == "value"] == [10]


def test_the_weighted_mean_is_that_of_a_printed_example() -> None:
    """The weighted mean agrees with NIST/SEMATECH e-Handbook 6.3.2.4.

    The weight is 0.3, begun at 50; the variance of the mean is 0.3 / 1.7 of that of a value.
    """
    values = "52 47 53 49.3 50.1 47 51 50.1 51.2 50.5 49.6 47.6 49.9 51.3 47.8 51.2 52.6 52.4 53.6 52.1"
    means = (
        "50.60 49.52 50.56 50.18 50.16 49.21 49.75 49.85 50.26 50.33 50.11 49.36 49.52 50.05 49.38 49.92 50.73 "
        "51.23 51.94 51.99"
    )
    history = checks([50.0, *map(float, values.split())], u=2.0 * 2.0539)
    chart = chart_of(history, weight=0.3, reference=1)
    np.testing.assert_allclose(chart.mean[1:], [float(m) for m in means.split()], atol=0.006)
    of_value, of_mean = (np.diff(each)[-1, 0] for each in (chart.limits, chart.mean_limits))
    # both have the variance of the centre, one value's, besides
    assert of_mean / of_value == pytest.approx(np.sqrt((0.3 / 1.7 + 1.0) / 2.0), rel=1e-3)


@pytest.mark.parametrize(("scatter", "u"), [(1.0, 0.0), (0.0, 1.0), (0.5, 1.0)])
@pytest.mark.parametrize("reference", [2, 10])
def test_a_steady_parameter_signals_no_more_than_stated(scatter: float, u: float, reference: int) -> None:
    rng, signalled = np.random.default_rng(5), []
    for _ in range(500):
        values = rng.normal(size=reference + 3) * np.hypot(scatter, u)
        chart = chart_of(checks(values.tolist(), u=2.0 * u), 0.1, reference=reference)
        signalled.append(any(s.index == reference + 2 for s in chart.signals))
    assert 0.005 < np.mean(signalled) < 0.12


def test_a_jump_shows_at_once_and_a_slow_change_in_the_mean() -> None:
    rng = np.random.default_rng(1)
    steady = rng.normal(size=10)
    (jump,) = {s.index for s in chart_of(checks([*steady, 9.0], u=2.0)).signals}
    assert jump == 10
    history = checks([*steady, *(2.4 + 0.3 * rng.normal(size=12))], u=2.0)
    slow = chart_of(history).signals
    assert slow
    assert {s.chart for s in slow} == {"mean"}
    assert f"The value of {history[slow[0].index].at:%Y-%m-%d} " in slow[0].because


def test_a_value_less_sure_has_wider_limits() -> None:
    history = checks([0.0, 0.1, -0.1, 0.05, 0.0], u=0.2)
    vague = Check(history[-1].at + timedelta(days=1), 0.5, 1.0)
    limits = chart_of([*history, vague]).limits
    assert np.diff(limits)[-1] > 3.0 * np.diff(limits)[-2]


def test_a_sure_value_among_vague_ones_is_judged_by_what_the_centre_may_be_off() -> None:
    """The centre of 0.1 and 0.3 is uncertain by sqrt(0.01^2 + 0.1^2) / 2, and so are both.

    The values are computed by hand.
    """
    history = [Check(START, 0.1, 0.02), Check(START + timedelta(days=9), 0.3, 0.2), Check(LATE, 0.2, 0.2)]
    chart = chart_of(history)
    between = chart.sigma**2 - (0.01**2 + 0.1**2) / 2.0
    half = stats.t.isf(0.0025, chart.freedom) * np.sqrt((0.01**2 + 0.1**2 + 2.0 * between) / 4.0)
    assert chart.limits[:2] - chart.centre == pytest.approx(np.array([[-half, half]] * 2))
    assert chart.signals == ()


def test_of_two_values_the_first_is_the_centre_and_has_no_limits() -> None:
    chart = chart_of(checks([0.1, 0.4], u=0.02))
    assert np.isinf(chart.limits[0]).all()
    assert chart.centre == pytest.approx(0.1)
    assert [each.index for each in chart.signals if each.chart == "value"] == [1]


def test_the_stair_goes_up_slowly_and_down_fast() -> None:
    stair = Staircase(100.0, permitted=0.2)
    assert stair.shorter == pytest.approx(0.4241, abs=1e-4)  # 1.1 ** -9: nine of ten checks pass
    assert days(stair, checks([0.05])) == pytest.approx(100.0)
    assert days(stair, checks([0.05, 0.05])) == pytest.approx(110.0)
    assert days(stair, checks([0.05, 0.17])) == pytest.approx(100.0)  # between 80 and 100 %
    assert days(stair, checks([0.05, 0.15], u=0.03)) == pytest.approx(100.0)  # with U beyond 80 %
    assert days(stair, checks([0.05, 0.21])) == pytest.approx(42.41, abs=0.01)
    assert days(stair, checks([0.05] * 60, every=1700.0)) == stair.longest
    assert days(stair, checks([0.9] * 60)) == stair.shortest


def test_early_checks_do_not_lengthen_the_interval() -> None:
    assert days(Staircase(100.0, permitted=0.2), checks([0.01] * 20, every=5.0)) == pytest.approx(100.0)


def test_drift_reaches_what_is_permitted_when_its_uncertainty_does() -> None:
    """2 + 0.01 t + 2 * 0.1 sqrt(1/3 + (t + 100)^2 / 20000) reaches 5 at t = 249.3, by hand."""
    assert days(DriftInterval(90.0, permitted=5.0), checks([0.0, 1.0, 2.0], u=0.2)) == pytest.approx(
        249.3, abs=0.1
    )
    assert days(DriftInterval(90.0, permitted=5.0), checks([1.0])) == pytest.approx(90.0)
    assert days(DriftInterval(90.0, permitted=5.0), checks([1.0, 1.0, 1.0], u=0.001)) == pytest.approx(1825.0)
    assert days(DriftInterval(90.0, permitted=5.0), checks([0.0, 6.0, 6.0])) == pytest.approx(7.0)


def test_what_values_scatter_about_their_line_counts() -> None:
    """The scatter of values about their line counts.

    By hand, the line is 0, scatter^2 = 4 / 2, and 2 sqrt(2 (1/4 + (t + 150)^2 / 50000) + 1.99) = 6 at t = 253.4.
    """
    scattered = checks([1.0, -1.0, -1.0, 1.0], u=0.2)
    assert days(DriftInterval(90.0, permitted=6.0), scattered) == pytest.approx(253.4, abs=0.1)


def test_hours_of_use_become_days_by_the_counter() -> None:
    by = Staircase(1000.0, permitted=0.2, longest=5000.0)
    assert days(InUse(by), checks([0.05], used=0.0, u=0.02) and [Check(START, 0.05, 0.02, 40.0)]) == 62.5
    assert days(InUse(by), checks([0.05, 0.17], used=500.0)) == pytest.approx(200.0)  # five hours a day
    assert days(InUse(by), checks([0.05, 0.17], used=1.0)) == pytest.approx(730.0)  # it hardly runs
    within_the_hour = [Check(START + timedelta(minutes=30 * k), 0.05, 0.02, 40.0 + 0.5 * k) for k in (0, 1)]
    assert days(InUse(by), within_the_hour) == 62.5  # which says nothing of the use of a day
    with pytest.raises(DataError, match="counter"):
        days(InUse(by), checks([0.05, 0.17]))
    with pytest.raises(DataError, match="backwards"):
        days(InUse(by), [Check(START, 0.0, 0.1, 50.0), Check(START + timedelta(days=9), 0.0, 0.1, 3.0)])


def test_the_reason_is_a_sentence_and_says_what_is_overdue() -> None:
    history = checks([0.05, 0.21])
    due = next_due(Staircase(100.0, permitted=0.2), history, history[-1].at + timedelta(days=50))
    assert due.because == (
        "The last check found 0.21 (U 0.02) of 0.2 permitted: too much, so the interval is 42 days instead of 100; "
        "overdue by 7 days."
    )
    assert next_due(DriftInterval(90.0, permitted=1.0), [], START).date == START
    in_hours = next_due(
        InUse(DriftInterval(90.0, permitted=1.0)),
        checks([0.1, 0.1, 0.1], used=300.0),
        START.replace(year=2027),
    )
    assert "per hour of use" in in_hours.because


@pytest.mark.parametrize(
    ("spoil", "key"),
    [
        (lambda: Check(datetime(2026, 1, 1), 0.0, 0.1), "at"),
        (lambda: Check(START, np.nan, 0.1), "value"),
        (lambda: Check(START, 0.0, -0.1), "value"),
        (lambda: Check(START, 0.0, 0.1, -4.0), "used_h"),
        (lambda: Staircase(1.0, permitted=0.2), "first"),
        (lambda: Staircase(90.0, permitted=0.0), "permitted"),
        (lambda: DriftInterval(90.0, permitted=np.nan), "permitted"),
        (lambda: InUse(DriftInterval(90.0, permitted=1.0), hours_a_day=25.0), "hours_a_day"),
        (lambda: next_due(DriftInterval(90.0, permitted=1.0), checks([0.0, 0.0]), START), "at"),
        (lambda: next_due(DriftInterval(90.0, permitted=1.0), checks([0.0]), datetime(2027, 1, 1)), "now"),
        (lambda: days(DriftInterval(90.0, permitted=1.0), checks([0.0, 0.0, 0.0], u=0.0)), "u"),
        (lambda: chart_of([]), "reference"),
        (lambda: chart_of(checks([1.0, 1.0, 1.0], u=0.0)), "history"),
        (lambda: chart_of(checks([1.0, 2.0]), rate=1.0), "rate"),
    ],
)
def test_bad_input_is_refused_by_key(spoil: object, key: str) -> None:
    with pytest.raises(DataError) as refused:
        spoil()  # pyright: ignore[reportCallIssue]
    assert refused.value.key == key
