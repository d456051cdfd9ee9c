"""A re-diagnosis is in a trend once, in the place of the model of the same readings.

It states its program.
"""

from __future__ import annotations

import json
from datetime import timedelta
from typing import Any

import pytest

from fleet.diagnose import DiagnosisOrder
from fleet.store import ERROR, FleetJob, FleetStore, RobotKey, dataset_content
from fleet.store.rediagnosed import FORMAT, TASK
from tests.fleet.documents import BEGAN, ROBOT, model, of, watch

OLD, NEW = "0.1.0+aaaaaaaaaaaa", "0.2.0+bbbbbbbbbbbb"


def dataset(store: FleetStore, day: float, *, robot: RobotKey = ROBOT, timeless: bool = False) -> str:
    """Put a data set of a day into a store; its hash."""
    content = json.loads(dataset_content(f"reading_id,{day}\n", "header"))
    named = of("dataset", content, robot=robot, day=day)
    if timeless:  # as the outbox names those that do not say when they were measured
        named = of("dataset", content, robot=robot, day=day, identity="x")
        object.__setattr__(named, "identity", f"dataset {named.hash}")
    return store.add(named).hash


def diagnosed(
    store: FleetStore,
    data: str,
    program: str,
    *,
    hours: float = 0.0,
    task: str = TASK,
    rms: float | None = 0.05,
    **values: float,
) -> None:
    """Keep the result of a version for a data set.

    The `values` are in mm, each with a standard error of 0.002.
    """
    table: dict[str, Any] = {
        "format": FORMAT,
        "verdict": "attributed" if values else "refused",
        "parameters": [
            {"name": name, "value": value, "std": 0.002, "unit": "mm"} for name, value in values.items()
        ],
        "error_after_mm": None if rms is None else {"n": 600, "rms": rms},
    }
    when = BEGAN + timedelta(days=30, hours=hours)
    store.work.finish(FleetJob(task, data, program), "w", json.dumps(table).encode(), when, 1.0)


def shown(store: FleetStore, parameter: str = "d1") -> list[tuple[float, float, str, bool]]:
    """Day, value, program, whether re-diagnosed."""
    return [
        ((point.measured_at - BEGAN) / timedelta(days=1), point.value, point.program, point.rediagnosed)
        for point in store.trend(ROBOT, parameter)
    ]


def test_one_measurement_is_one_point_by_the_version_that_was_last(store: FleetStore) -> None:
    store.add_all([model({"d1": 1.0, "a2": 5.0}, day=day) for day in (1, 2)])
    first, second, alone = (dataset(store, day) for day in (1, 2, 3))
    diagnosed(store, first, OLD, hours=0, d1=1.1)
    diagnosed(store, first, NEW, hours=1, d1=1.2)
    diagnosed(store, alone, NEW, hours=2, d1=3.0)
    assert shown(store) == [
        (1, 1.2, NEW, True),
        (2, 1.0, "truepose 0.1.0", False),
        (3, 3.0, NEW, True),
    ]
    assert shown(store, "a2") == [(2, 5.0, "truepose 0.1.0", False)]  # the version of day 1 has no a2
    (again, *_) = store.trend(ROBOT, "d1")
    assert (again.u, again.unit, again.hash) == (0.004, "mm", first)
    (error, _) = store.trend(ROBOT, ERROR)
    assert (error.value, error.u) == (0.05, pytest.approx(2 * 0.05 / 60))
    assert [each[1] for each in shown(store)] == [
        point.value for point in store.trend(ROBOT) if point.parameter == "d1"
    ]
    assert [point.value for point in store.trend(ROBOT, "d1", rediagnosed=False)] == [1.0, 1.0]
    assert second


def test_what_makes_no_model_replaces_none(store: FleetStore) -> None:
    """Refusals, searches cut short, untimed data, other robots, watches, and older versions."""
    store.add_all([model({"d1": 1.0}, day=day) for day in (1, 2, 3, 4)])
    diagnosed(store, dataset(store, 6), NEW, rms=None, d1=9.0)
    diagnosed(store, dataset(store, 1), NEW, rms=None)
    diagnosed(store, dataset(store, 2), NEW, task="diagnose most=1", d1=9.0)
    diagnosed(store, dataset(store, 3, timeless=True), NEW, d1=9.0)
    diagnosed(store, dataset(store, 4, robot=RobotKey("other", "irb120")), NEW, d1=9.0)
    old = FleetJob(TASK, dataset(store, 5), OLD)
    store.work.finish(old, "w", b'{"error_after_mm": {"n": 60, "rms": 0.05}}', BEGAN, 1.0)
    assert [each[1:] for each in shown(store)] == [(1.0, "truepose 0.1.0", False)] * 4
    assert store.trend(ROBOT, ERROR) == []


def test_a_watch_of_the_same_hour_stays(store: FleetStore) -> None:
    store.add(watch(day=1))
    said = {"format": "truepose-watch/1", "verdict": "unchanged", "in_words": "", "advice": "", "causes": []}
    store.add(of("watch", {**said, "error_mm": {"n": 20, "rms": 0.09, "u": 0.011}}, day=1, identity="w"))
    diagnosed(store, dataset(store, 1), NEW, d1=1.0)
    assert sorted(each[1] for each in shown(store, ERROR)) == [0.05, 0.09]


def test_the_task_of_trends_is_that_of_the_command() -> None:
    assert DiagnosisOrder("sqlite:///s.sqlite3", "x").task == TASK
    assert DiagnosisOrder("sqlite:///s.sqlite3", "x", most=1).task != TASK
