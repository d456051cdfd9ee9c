"""A store on SQLite and on PostgreSQL: documents are kept once, and their content is found."""

from __future__ import annotations

import threading
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from datetime import datetime, timedelta, timezone

import pytest

from calib.errors import DataError
from fleet.store import ERROR, Document, FleetJob, FleetStore, RobotKey, utc_now
from tests.fleet.documents import BEGAN, ROBOT, model, of, watch

OTHER = RobotKey("120-4712", "irb120")


def test_what_is_put_in_comes_out_byte_for_byte(store: FleetStore) -> None:
    given = model({"d1": 1.5})
    assert store.add(given).state == "new"
    assert store.content(given.hash) == given.content
    (entry,) = store.documents()
    found = (entry.hash, entry.robot, entry.measured_at, entry.size)
    assert found == (given.hash, ROBOT, BEGAN, len(given.content))
    assert entry.program == "truepose 0.1.0"
    assert not entry.conflict


def test_the_same_content_is_kept_once(store: FleetStore) -> None:
    given = model({"d1": 1.5})
    states = [store.add(given).state for _ in range(3)]
    assert states == ["new", "known", "known"]
    assert [each.state for each in store.add_all([given, model({"d1": 2.0}, day=1), given])] == [
        "known",
        "new",
        "known",
    ]
    assert len(store.documents()) == 2
    assert len(store.trend(ROBOT, "d1")) == 2
    assert store.known([given.hash, "0" * 64]) == {given.hash}


def test_two_contents_of_one_identity_are_both_kept_and_reported(store: FleetStore) -> None:
    one, two, three = (model({"d1": value}, identity="record-7:model") for value in (1.0, 2.0, 3.0))
    assert store.add(one).state == "new"
    found = store.add(two)
    assert (found.state, found.other_hashes) == ("conflict", (one.hash,))
    assert store.add(three).other_hashes == (one.hash, two.hash)
    again = store.add(one)
    assert (again.state, again.other_hashes) == ("known", (two.hash, three.hash))
    assert store.content(one.hash) == one.content
    assert store.content(two.hash) == two.content
    assert [each.conflict for each in store.documents(identity="record-7:model")] == [True] * 3
    assert store.add(model({"d1": 1.0}, identity="record-8:model", day=1)).state == "new"
    assert [each.conflict for each in store.documents(since=BEGAN + timedelta(days=0.5))] == [False]


def test_two_in_one_batch_contradict_each_other_too(store: FleetStore) -> None:
    one, two = (model({"d1": value}, identity="record-7:model") for value in (1.0, 2.0))
    first, second = store.add_all([one, two])
    assert (first.state, second.state, second.other_hashes) == ("new", "conflict", (one.hash,))


def test_one_content_of_two_robots_is_refused(store: FleetStore) -> None:
    given = model({"d1": 1.5})
    store.add(given)
    with pytest.raises(DataError, match="in the store already"):
        store.add(Document("model", OTHER, "cell-1", "x", BEGAN, given.content))
    assert [each.robot for each in store.robots()] == [ROBOT]  # nothing is left of what was refused


def test_a_batch_is_kept_whole_or_not_at_all(store: FleetStore) -> None:
    good, bad = (
        model({"d1": 1.5}),
        of("model", {"format": "truepose-model/1", "parameters": [{"name": "d1"}]}),
    )
    with pytest.raises(DataError, match="damaged"):
        store.add_all([good, bad])
    assert store.documents() == []
    assert store.robots() == []


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"\xff\xfe", "model record"),
        (b"[1, 2]", "is not a document"),
        (b'{"format": "truepose-model/3", "parameters": []}', "truepose-model/3"),
        (b'{"format": "truepose-model/1"}', "damaged"),
        (
            b'{"format": "truepose-model/1", "parameters": [{"name": "a", "value": "1", "std": 1, "unit": ""}]}',
            "dam",
        ),
        (
            b'{"format": "truepose-model/1", "parameters": [{"name": "a", "value": null, "std": 1, "unit": ""}]}',
            "dam",
        ),
    ],
)
def test_what_is_no_document_is_refused_with_its_place(store: FleetStore, content: bytes, said: str) -> None:
    with pytest.raises(DataError, match=said) as refused:
        store.add(Document("model", ROBOT, "cell-1", "record-1", BEGAN, content))
    assert "model record-1" in str(refused.value)
    assert refused.value.do


def test_trends_are_in_order_of_time_with_u(store: FleetStore) -> None:
    store.add_all([model({"d1": 0.1 * day, "a2": 5.0}, day=day) for day in (3, 1, 2)])
    store.add(model({"d1": 99.0}, robot=OTHER))
    points = store.trend(ROBOT, "d1")
    assert [point.value for point in points] == pytest.approx([0.1, 0.2, 0.3])
    assert [point.measured_at for point in points] == [BEGAN + timedelta(days=day) for day in (1, 2, 3)]
    assert {(point.u, point.unit, point.program) for point in points} == {
        (0.01, "mm", "truepose 0.1.0")
    }  # 2 std
    assert [point.parameter for point in store.trend(ROBOT)] == ["a2"] * 3 + ["d1"] * 3
    assert store.trend(ROBOT, "nothing") == []
    (alone,) = store.trend(OTHER, "d1")
    assert alone.value == 99.0


def test_a_parameter_without_a_standard_error_has_no_u(store: FleetStore) -> None:
    store.add(model({"d1": 1.0}, std=None))
    assert store.trend(ROBOT, "d1")[0].u is None


def test_trends_hold_no_carried_terms(store: FleetStore) -> None:
    entries = [
        {"name": name, "value": 1.5, "std": 0.1, "unit": "mm"} for name in ("d1", "carried:d5:time:1.size")
    ]
    effects = [
        {"group": "base model", "parameters": entries[:1]},
        {"group": "carried", "parameters": entries[1:]},
    ]
    store.add(of("model", {"format": "truepose-model/2", "parameters": entries, "effects": effects}))
    assert [point.parameter for point in store.trend(ROBOT)] == ["d1"]


def test_the_error_of_models_and_watches_is_one_trend(store: FleetStore) -> None:
    held_out = {"kind": "rows", "error_mm": {"n": 600, "rms": 0.06, "mean": 0.05, "p95": 0.1, "max": 0.2}}
    said = {"format": "truepose-watch/1", "verdict": "unchanged", "in_words": "", "advice": "", "causes": []}
    store.add_all(
        [
            of("model", {"format": "truepose-model/1", "parameters": [], "held_out": held_out}),
            of("watch", {**said, "error_mm": {"n": 20, "rms": 0.09, "max": 0.2, "u": 0.011}}, day=1),
            of("watch", {**said, "p_left": 1}, day=2),  # of an older version: it says nothing of the error
            of(
                "model",
                {"format": "truepose-model/1", "parameters": [], "held_out": held_out, "updates": [1]},
                day=3,
            ),
        ]
    )
    first, second = store.trend(ROBOT, ERROR)
    assert (first.value, first.u, first.unit) == (0.06, pytest.approx(2 * 0.06 / 60.0), "mm")
    assert (second.value, second.u) == (0.09, 0.011)


def test_verdicts_come_with_their_causes(store: FleetStore) -> None:
    store.add_all([watch("unchanged"), watch(day=7, size=0.05), watch(day=3, robot=OTHER)])
    diagnosis = {
        "format": "truepose-diagnosis/1",
        "verdict": "explained",
        "effects": [
            {
                "label": "backlash:j4",
                "meaning": "Play of joint 4.",
                "candidates": {"backlash:j4": 1.0},
                "amplitude": {"value": 0.02, "std": 0.001, "unit": "deg"},
            }
        ],
    }
    store.add(of("diagnosis", diagnosis, day=8))
    none, lost, play = store.verdicts(ROBOT)
    assert (none.verdict, none.causes) == ("unchanged", ())
    assert lost.advice == "Re-zero joint 4 by 0.05 deg."
    ((cause),) = lost.causes
    assert (cause.label, cause.value, cause.u, cause.unit, cause.weight) == (
        "joint_step:j4",
        0.05,
        0.004,
        "deg",
        0.9,
    )
    assert (play.causes[0].label, play.causes[0].u) == ("backlash:j4", 0.002)
    assert [each.robot for each in store.verdicts(kind="watch")] == [ROBOT, OTHER, ROBOT]
    assert len(store.verdicts(since=BEGAN + timedelta(days=7))) == 2


def test_upkeep_is_a_verdict_with_thermal_parameters(store: FleetStore) -> None:
    warm = {"name": "thermal.a2", "before": 0.0, "value": 0.12, "u": 0.02, "unit": "mm"}
    said = {
        "format": "truepose-upkeep/1",
        "in_words": "Warmer.",
        "advice": "Correct targets.",
        "parameters": [warm],
    }
    store.add_all(
        [
            of("thermal", {**said, "thermal": True, "instead": []}),
            of("thermal", {**said, "thermal": False, "instead": ["tool_shift"]}, day=1),
        ]
    )
    first, second = store.verdicts(ROBOT)
    assert (first.verdict, first.causes) == ("thermal", ())
    assert (second.verdict, [each.label for each in second.causes]) == ("not thermal", ["tool_shift"])
    (point,) = store.trend(ROBOT)  # what was not updated is no value
    assert (point.parameter, point.value, point.u) == ("thermal.a2", 0.12, 0.02)


def test_robots_with_what_is_known_of_each(store: FleetStore) -> None:
    store.add_all([model({"d1": 1.0}), watch(day=2), model({"d1": 2.0}, robot=OTHER, day=1)])
    one, two = store.robots()
    assert (one.robot, one.documents, one.last) == (
        ROBOT,
        {"model": 1, "watch": 1},
        BEGAN + timedelta(days=2),
    )
    assert (two.robot, two.documents, two.cells) == (OTHER, {"model": 1}, ("cell-1",))


def test_documents_by_robot_kind_and_time_newest_first(store: FleetStore) -> None:
    store.add_all(
        [model({"d1": 1.0}, day=day) for day in range(5)] + [watch(day=9), watch(day=9, robot=OTHER)]
    )
    assert [each.measured_at for each in store.documents(ROBOT, "model", limit=2)] == [
        BEGAN + timedelta(days=day) for day in (4, 3)
    ]
    assert len(store.documents(since=BEGAN + timedelta(days=4))) == 3
    assert store.documents(RobotKey("120-4711", "irb1600")) == []


def test_times_of_every_zone_are_kept_in_utc(store: FleetStore) -> None:
    east, west = (timezone(timedelta(hours=hours)) for hours in (9, -9))
    early = replace(model({"d1": 1.0}), measured_at=BEGAN.astimezone(east))
    late = replace(model({"d1": 1.0}, day=1), measured_at=(BEGAN + timedelta(minutes=1)).astimezone(west))
    store.add_all([late, early])
    assert [each.measured_at for each in store.documents()] == [BEGAN + timedelta(minutes=1), BEGAN]
    assert [point.measured_at for point in store.trend(ROBOT)] == [BEGAN, BEGAN + timedelta(minutes=1)]
    assert (
        len(store.documents(since=(BEGAN + timedelta(seconds=1)).astimezone(timezone(timedelta(hours=5)))))
        == 1
    )
    assert store.documents()[0].measured_at.utcoffset() == timedelta(0)
    first, last = (datetime(year, 1, 1, tzinfo=zone) for year, zone in ((1, east), (9999, west)))
    assert len(store.documents(since=first)) == 2
    for beyond in (first, last):
        with pytest.raises(DataError, match=r"measured_at.*clock"):
            replace(early, measured_at=beyond)


def test_many_at_once_keep_everything_once(url: str) -> None:
    """Four programs store the same forty documents, each in another order, two per identity."""
    documents = [model({"d1": float(i)}, identity=f"record-{i // 2}") for i in range(40)]
    ready = threading.Barrier(4)

    def put(first: int) -> list[str]:
        with FleetStore.open(url) as store:
            ready.wait(60.0)
            turned = documents[first:] + documents[:first]
            return [each.state for part in (turned[:20], turned[20:]) for each in store.add_all(part)]

    with ThreadPoolExecutor(4) as pool:
        states = [state for told in pool.map(put, (0, 10, 20, 30)) for state in told]
    assert (states.count("new"), states.count("conflict"), states.count("known")) == (20, 20, 120)
    with FleetStore.open(url) as store:
        assert len(store.documents()) == 40
        assert len(store.robots()) == 1


def test_a_job_belongs_to_one_until_its_time_is_over(store: FleetStore) -> None:
    jobs = [FleetJob("diagnose", letter * 64, "0.1.0") for letter in "ab"]
    assert store.work.claim(jobs, "one", BEGAN, 60.0) == jobs
    assert store.work.claim(jobs, "two", BEGAN + timedelta(seconds=59), 60.0) == []
    assert (
        store.work.claim(jobs[:1], "one", BEGAN + timedelta(seconds=59), 60.0) == jobs[:1]
    )  # has it for longer
    assert store.work.claim(jobs, "two", BEGAN + timedelta(seconds=60), 60.0) == jobs[1:]


def test_a_result_is_written_once(store: FleetStore) -> None:
    job, late = FleetJob("diagnose", "a" * 64, "0.1.0"), BEGAN + timedelta(hours=1)
    assert store.work.claim([job], "lost", BEGAN, 60.0) == [job]
    assert store.work.claim([job], "other", late, 60.0) == [job]
    assert store.work.finish(job, "other", b"result", late, 12.5)
    assert not store.work.finish(job, "lost", b"another", late, 99.0)  # comes late, and changes nothing
    (found,) = store.work.results(data="a" * 64)
    assert (found.job, found.owner, found.content, found.seconds) == (job, "other", b"result", 12.5)
    assert store.work.claim([job], "third", late + timedelta(days=1), 60.0) == []
    newer = FleetJob("diagnose", "a" * 64, "0.2.0")
    assert store.work.done([job, newer]) == {job}
    assert store.work.claim([newer], "third", late, 60.0) == [newer]


def test_how_a_robot_stands_is_the_same_alone_and_among_all(store: FleetStore) -> None:
    """The newest of several counts, but no updated calibration and no future day.

    A calibration is left out if a watch has updated it.
    """
    calibrated = model({"d1": 1.0})
    store.add_all([calibrated, watch(day=5), watch("unchanged", day=9), model({"d1": 1.1}, day=9)])
    store.add_all([model({"d1": 2.0}, robot=OTHER), watch(robot=OTHER, day=50_000)])  # a clock that is ahead
    last = watch("unchanged", robot=OTHER, day=(utc_now() - BEGAN) / timedelta(days=1))
    store.add(last)
    one, other = store.standings()
    assert [one, other] == [*store.standings(ROBOT), *store.standings(OTHER)]
    assert one.watched == store.verdicts(ROBOT)[-1]
    assert one.baseline is not None
    assert one.baseline.hash == calibrated.hash
    assert other.watched is not None
    assert other.watched.hash == last.hash
    assert other.known.last > utc_now()
