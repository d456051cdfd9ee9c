"""Comparison of results of another version for the same data sets."""

from __future__ import annotations

import json
from datetime import UTC, datetime, timedelta
from typing import Any

import pytest

from calib.errors import DataError
from fleet.diagnose import VersionDifference, changes_between, named
from fleet.store import FleetJob, JobResult

OLD, NEW = "0.1.0+aaaaaaaaaaaa", "0.2.0+bbbbbbbbbbbb"
BEGAN = datetime(2026, 3, 2, tzinfo=UTC)


def result(
    data: str,
    program: str,
    verdict: str = "attributed",
    rms: float | None = 0.05,
    day: int = 0,
    **effects: tuple[float, float],
) -> JobResult:
    """Return the result of a version, with effects by label with size and standard error, deg."""
    table: dict[str, Any] = {
        "name": f"robot {data}",
        "verdict": verdict,
        "effects": [
            {"label": label, "value": value, "std": std, "unit": "deg"}
            for label, (value, std) in effects.items()
        ],
        "error_after_mm": None if rms is None else {"n": 20, "rms": rms},
    }
    moment = BEGAN + timedelta(days=day)
    return JobResult(
        FleetJob("diagnose most=10", data, program), "x", moment, 1.0, json.dumps(table).encode()
    )


def only(before: JobResult, now: JobResult) -> VersionDifference:
    (change,) = changes_between([before], [now], NEW).changed
    return change


def test_what_stays_is_not_told() -> None:
    same = [result(data, OLD, backlash=(0.1, 0.01)) for data in "abc"]
    now = [
        result(data, NEW, rms=0.0504, backlash=(0.109, 0.01)) for data in "abc"
    ]  # 0.8 %, 0.9 standard errors
    found = changes_between(same, now, NEW)
    assert (found.compared, found.missing, found.changed, found.since) == (3, 0, (), (OLD,))
    assert found.ratio == pytest.approx(1.008)


def test_verdicts_effects_sizes_and_errors_are_told() -> None:
    verdict = only(result("a", OLD), result("a", NEW, "unexplained"))
    assert (verdict.was.verdict, verdict.now.verdict) == ("attributed", "unexplained")
    other = only(result("a", OLD, lost=(0.1, 0.01)), result("a", NEW, won=(0.1, 0.01)))
    assert (other.gone, other.new, other.resized) == (["lost"], ["won"], [])
    size = only(result("a", OLD, backlash=(0.1, 0.01)), result("a", NEW, backlash=(0.111, 0.01)))
    assert (size.gone, size.new, size.resized) == ([], [], ["backlash"])
    error = only(result("a", OLD), result("a", NEW, rms=0.051))
    assert error.ratio == pytest.approx(1.02)


def test_data_that_cannot_be_used_any_more_is_told() -> None:
    now = only(result("a", OLD), result("a", NEW, "refused", None))
    assert (now.now.verdict, now.ratio) == ("refused", None)
    assert (
        changes_between([result("a", OLD, "refused", None)], [result("a", NEW, "refused", None)], NEW).changed
        == ()
    )


def test_the_worst_comes_first_and_what_is_new_is_counted() -> None:
    before = [result(data, OLD) for data in "abc"]
    now = [
        result("a", NEW, rms=0.04),
        result("b", NEW, rms=0.2),
        result("c", NEW, rms=0.06),
        result("d", NEW),
    ]
    found = changes_between(before, now, NEW)
    assert [each.data for each in found.changed] == ["b", "c", "a"]
    assert (found.compared, found.missing) == (3, 1)
    assert found.ratio == pytest.approx(1.2)


def test_of_several_builds_the_newest_result_of_a_data_set_counts() -> None:
    before = [
        result("a", "0.1.0+first", day=1),
        result("a", OLD, "unexplained", day=2),
        result("b", "0.1.0+first"),
    ]
    found = changes_between(before, [result("a", NEW), result("b", NEW)], NEW)
    assert [each.was.verdict for each in found.changed] == ["unexplained"]
    assert found.since == ("0.1.0+aaaaaaaaaaaa", "0.1.0+first")


def test_a_version_is_named_by_release_or_build() -> None:
    programs = ["0.1.0+first", OLD, NEW]
    assert named("0.1.0", programs, NEW) == ["0.1.0+first", OLD]
    assert named(OLD, programs, NEW) == [OLD]
    assert named("0.2.0", [*programs, "0.2.0+older"], NEW) == ["0.2.0+older"]  # not with itself
    with pytest.raises(DataError, match=r"'0\.3\.0' has no results.*0\.1\.0\+aaa"):
        named("0.3.0", programs, NEW)
    with pytest.raises(DataError, match="none but of this version"):
        named("0.2.0", [NEW], NEW)
