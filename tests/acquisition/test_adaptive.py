"""Adaptive campaigns: their poses join the plan batch by batch, whatever interrupts them."""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import Future
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from acquisition import Campaign, Run
from acquisition.campaign.campaign import campaign_from
from acquisition.campaign.plan import Visit
from acquisition.errors import UnsafePlan
from acquisition.loop import calibration_campaign
from acquisition.record import Event, RecordStore
from acquisition.run import adaptive
from acquisition.run.adaptive import Miss, MissesThatCount, exceed, look_at
from acquisition.run.duration import at_once
from drivers import ConfigError
from tests.acquisition.fakes import Bench, Crash, JumpingClock, a_cell, devices_of
from tests.drivers.waiting import PATIENCE_S

TABLE: dict[str, Any] = {
    "format": "truepose-campaign/1",
    "approach": {"offset_deg": -5.0, "sides": "both"},
    "samples": 10,
    "block": [{"kind": "adaptive", "accuracy_mm": 0.045}],
}


def a_campaign(*, reference_every: int = 0, **block: Any) -> Campaign:
    table = TABLE | {"block": [TABLE["block"][0] | block], "reference_every": reference_every}
    return campaign_from(table, "campaign.toml")


def plan_of(folder: Path) -> list[Visit]:
    with RecordStore.reading(folder) as store:
        return list(dict.fromkeys(planned.visit for planned in store.plan()))


def measured(folder: Path, campaign: Campaign, bench: Bench | None = None) -> Run:
    bench = bench or Bench(a_cell())
    run = Run.create(folder, bench.cell, campaign, simulated=True)
    outcome = run.execute(devices_of(bench), JumpingClock())
    assert outcome.state.value == "succeeded", outcome
    return run


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("undisturbed") / "record"
    measured(folder, a_campaign()).close()
    return folder


def test_it_ends_once_the_limit_is_below_the_wanted_accuracy(undisturbed: Path) -> None:
    with Run.open(undisturbed) as run:
        reached = run.status().accuracy
    assert reached is not None
    poses = [each for each in plan_of(undisturbed) if each.kind == "pose"]
    assert reached["reached"]
    assert reached["bound_mm"] <= 0.045
    assert len(poses) >= 15
    looks = reached["history"]
    assert [each["poses"] for each in looks] == sorted(each["poses"] for each in looks)
    assert looks[0]["bound_mm"] is None  # nothing was predicted before it was used
    assert len({each.joints_deg for each in poses}) == len(poses)  # none is driven twice
    assert [each.number for each in plan_of(undisturbed)] == list(range(len(plan_of(undisturbed))))


@pytest.mark.parametrize("call", [60, 90, 101])
def test_what_interrupts_it_changes_no_pose(tmp_path: Path, undisturbed: Path, call: int) -> None:
    """The program dies in mid-batch; the next one measures the same poses in the same order."""

    def crash() -> None:
        raise Crash

    bench, folder = Bench(a_cell()), tmp_path / "record"
    bench.faults[call] = crash
    with Run.create(folder, bench.cell, a_campaign(), simulated=True) as run, pytest.raises(Crash):
        run.execute(devices_of(bench), JumpingClock())
    with Run.open(folder) as run:
        run.resume()
        assert run.execute(devices_of(bench), JumpingClock()).state.value == "succeeded"
    again, planned = plan_of(folder), plan_of(undisturbed)
    # a look begins with the last visit of a batch, or after it: what it chose may differ only from there on
    assert again[: 3 + 10] == planned[: 3 + 10]
    assert {each.joints_deg for each in again if each.kind == "pose"} <= {
        pose.joints_deg for pose in _candidates(bench)
    }


def _candidates(bench: Bench) -> Any:
    campaign = a_campaign()
    found = adaptive.block_of(campaign)
    assert found is not None
    return adaptive.pool_of(found[1], adaptive.site_of(bench.cell, campaign, found[0])).candidates


def test_a_program_that_dies_between_two_batches_goes_on(tmp_path: Path, undisturbed: Path) -> None:
    def crash(function: Callable[[Path], Any], record: Path, /) -> Future[Any]:
        if function is look_at:
            raise Crash
        return at_once(function, record)

    bench, folder = Bench(a_cell()), tmp_path / "record"
    with Run.create(folder, bench.cell, a_campaign(), simulated=True) as run, pytest.raises(Crash):
        run.execute(devices_of(bench), JumpingClock(), begin=crash)
    with Run.open(folder) as run:
        run.resume()
        assert run.execute(devices_of(bench), JumpingClock()).state.value == "succeeded"
    assert len(plan_of(folder)) == len(plan_of(undisturbed))


def test_a_stop_does_not_wait_for_a_computation(tmp_path: Path) -> None:
    bench, looking = Bench(a_cell()), threading.Event()

    def never(function: Callable[[Path], Any], _: Path, /) -> Future[Any]:
        if function is look_at:
            looking.set()
        return Future()

    with Run.create(tmp_path / "record", bench.cell, a_campaign(), simulated=True) as run:
        ended: list[str] = []
        thread = threading.Thread(
            target=lambda: ended.append(
                run.execute(devices_of(bench), JumpingClock(), begin=never).state.value
            )
        )
        thread.start()
        assert looking.wait(PATIENCE_S)
        run.stop(by="anna")
        thread.join(PATIENCE_S)
    assert ended == ["stopped"]


def test_what_another_process_cannot_compute_is_computed_here(tmp_path: Path) -> None:
    def refused(function: Callable[[Path], Any], _: Path, /) -> Future[Any]:
        future: Future[Any] = Future()
        future.set_exception(RuntimeError("no process is free"))
        return future

    bench = Bench(a_cell())
    with Run.create(tmp_path / "record", bench.cell, a_campaign(), simulated=True) as run:
        assert run.execute(devices_of(bench), JumpingClock(), begin=refused).state.value == "succeeded"


def test_a_batch_that_may_not_be_driven_is_not_begun(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    bench = Bench(a_cell())
    folder = tmp_path / "record"
    with Run.create(folder, bench.cell, a_campaign(), simulated=True) as run:

        def unsafe(*_: object) -> None:
            raise UnsafePlan("pose 11: the elbow is in the table")

        monkeypatch.setattr(adaptive, "check_plan", unsafe)
        outcome = run.execute(devices_of(bench), JumpingClock())
    assert outcome.state.value == "paused"
    assert "the elbow is in the table" in outcome.reason
    assert len([each for each in plan_of(folder) if each.kind == "pose"]) == 10  # the first batch alone


@pytest.mark.parametrize("look", [1, 2])
@pytest.mark.parametrize("kind", ["accuracy", "planned", "batch"])
def test_a_program_that_dies_as_a_batch_joins_the_record_loses_nothing(
    tmp_path: Path, undisturbed: Path, kind: str, look: int
) -> None:
    bench, folder, seen = Bench(a_cell()), tmp_path / "record", list[str]()

    def dies(event: Event) -> None:
        seen.append(event.kind)
        if event.kind == kind and seen.count(kind) == look:
            raise Crash

    with Run.create(folder, bench.cell, a_campaign(), simulated=True) as run, pytest.raises(Crash):
        run.execute(devices_of(bench), JumpingClock(), on_event=dies)
    with Run.open(folder) as run:
        run.resume()
        assert run.execute(devices_of(bench), JumpingClock()).state.value == "succeeded"
    again, planned = plan_of(folder), plan_of(undisturbed)
    assert [each.number for each in again] == list(range(len(again)))
    assert len({each.joints_deg for each in again if each.kind == "pose"}) == len(again) - 3
    assert [each.joints_deg for each in again[:18]] == [each.joints_deg for each in planned[:18]]


def test_a_cell_that_leaves_few_poses_ends_before_one_is_driven_twice(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("acquisition.campaign.blocks.adaptive._CANDIDATES", 32)
    monkeypatch.setattr(adaptive, "WORTH", -1.0)
    monkeypatch.setattr(adaptive, "SETTLED", 1000)
    with measured(tmp_path / "record", a_campaign(accuracy_mm=0.001, most=100)) as run:
        reached = run.status().accuracy
    assert reached is not None
    assert "No further poses" in reached["ended"]
    poses = [each.joints_deg for each in plan_of(tmp_path / "record") if each.kind == "pose"]
    assert len(set(poses)) == len(poses)


def test_what_the_model_no_longer_gains_more_poses_may_still_show(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Near the floor the limit falls with the number of misses, long after the model is known."""
    monkeypatch.setattr(adaptive, "WORTH", 1.0)  # whatever ten more poses gain is too little
    with measured(tmp_path / "shown", a_campaign(accuracy_mm=0.0435)) as run:
        shown = run.status().accuracy
    with measured(tmp_path / "below", a_campaign(accuracy_mm=0.03)) as run:
        below = run.status().accuracy
    assert shown is not None
    assert below is not None
    assert shown["reached"]
    assert shown["deciding_mm"] <= 0.0435
    assert len([each for each in shown["history"] if each["poses"] >= 15]) > 1
    assert not below["reached"]
    assert below["poses"] < 20
    assert f"{below['floor_mm']:.3f} mm" in below["ended"]


def some_misses(effects: tuple[str, ...], square: float, count: int, *, drawn: bool = False) -> list[Miss]:
    return [Miss(i, square, 9, drawn, effects) for i in range(count)]


def test_what_another_model_missed_does_not_count_once_the_present_one_has_predicted() -> None:
    before, since = some_misses((), 90.0, 20), some_misses(("backlash:j2",), 9.0, 5)
    judged = MissesThatCount.of([*before, *since], ("backlash:j2",), numbers=9)
    assert judged.freedom == 45
    assert judged.limits_mm(0.04, 0.95)[0] == pytest.approx(0.04)
    assert MissesThatCount.of(before, ("backlash:j2",), numbers=9).limits_mm(0.04, 0.95)[0] > 0.1
    drawn = MissesThatCount.of(
        [*since, *some_misses(("backlash:j2",), 9.0, 2, drawn=True)], (), 9, drawn_only=True
    )
    assert drawn.freedom == 18


def test_only_misses_beyond_chance_are_news() -> None:
    usual, more, step = (some_misses((), 9.0 * each, 5) for each in (1.0, 1.5, 8.0))
    assert exceed(step, usual * 6)
    assert not exceed(more, usual * 6)
    assert not exceed(step, step * 2)  # it has been seen before
    assert not exceed(step, [])


def test_more_poses_bring_the_limit_down_and_hope_is_no_less() -> None:
    judged = MissesThatCount.of(some_misses((), 10.0, 20), (), numbers=9)
    later = [judged.later_mm(0.04, count) for count in (5, 20, 80)]
    assert later == sorted(later, reverse=True)
    assert later[0] < judged.limits_mm(0.04, adaptive.DECIDING)[1]
    assert 0.04 < judged.later_mm(0.04, 20, hopeful=True) < later[1]
    unjudged = MissesThatCount.of([], (), numbers=9)
    assert unjudged.later_mm(0.04, 5) > unjudged.later_mm(0.04, 20) > 0.04


def test_the_time_is_kept(tmp_path: Path) -> None:
    with measured(tmp_path / "record", a_campaign(accuracy_mm=0.001, minutes=3.0)) as run:
        reached = run.status().accuracy
    assert reached is not None
    assert not reached["reached"]
    assert "time is up" in reached["ended"]
    assert reached["minutes"] < 3.0


def a_pause_of_a_day(folder: Path, campaign: Campaign) -> dict[str, Any] | None:
    """Pause after some poses, go on the next day, and return the accuracy at the end."""
    bench, clock = Bench(a_cell()), JumpingClock()
    with Run.create(folder, bench.cell, campaign, simulated=True) as run:
        bench.faults[60] = run.pause
        assert run.execute(devices_of(bench), clock).state.value == "paused"
    clock.calendar += 86_400.0
    with Run.open(folder) as run:
        run.resume()
        assert run.execute(devices_of(bench), clock).state.value == "succeeded"
        return run.status().accuracy


def test_a_pause_takes_no_time(tmp_path: Path, undisturbed: Path) -> None:
    """A calibration that goes on next morning still has its minutes."""
    reached = a_pause_of_a_day(tmp_path / "record", a_campaign(minutes=60.0))
    with Run.open(undisturbed) as run:
        usual = run.status().accuracy
    assert reached is not None
    assert usual is not None
    assert reached["reached"]
    assert reached["minutes"] == pytest.approx(usual["minutes"], abs=2.0)


def test_what_a_real_robot_waits_for_is_time_at_the_cell(tmp_path: Path) -> None:
    """Only a simulated one, whose minutes last a fraction of a second, is not charged with computations."""
    clocks = [JumpingClock(), JumpingClock()]
    minutes: list[float] = []
    for clock, simulated in zip(clocks, (True, False), strict=True):

        def slow(
            function: Callable[[Path], Any], record: Path, /, clock: JumpingClock = clock
        ) -> Future[Any]:
            if function is look_at:
                clock.wait(600.0, threading.Event())
            return at_once(function, record)

        bench, folder = Bench(a_cell()), tmp_path / str(simulated)
        with Run.create(folder, bench.cell, a_campaign(), simulated=simulated) as run:
            assert run.execute(devices_of(bench), clock, begin=slow).state.value == "succeeded"
            accuracy = run.status().accuracy
            assert accuracy is not None
            minutes.append(accuracy["minutes"])
    assert minutes[1] > minutes[0] + 10.0


def test_validation_poses_of_the_campaign_are_not_judged_again_in_every_look(tmp_path: Path) -> None:
    validation = {"kind": "poses", "set": "validation", "count": 5}
    table = TABLE | {"block": [validation, TABLE["block"][0]]}
    measured(tmp_path / "record", campaign_from(table, "campaign.toml")).close()
    with RecordStore.reading(tmp_path / "record") as store:
        judged = [miss["visit"] for each in store.data_of_events("accuracy") for miss in each["misses"]]
        added = [number for each in store.data_of_events("batch") for number in each["visits"]]
    assert judged
    assert len(set(judged)) == len(judged)
    assert set(judged) <= set(added)


@pytest.mark.parametrize(
    ("later", "words"),
    [
        (TABLE["block"][0], "kind"),
        ({"kind": "poses", "set": "validation", "count": 5, "new_station": True}, "new_station"),
    ],
)
def test_what_cannot_follow_an_adaptive_block_is_refused(later: dict[str, Any], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        campaign_from(TABLE | {"block": [*TABLE["block"], later]}, "campaign.toml")


def test_the_reference_pose_comes_again_in_batches(tmp_path: Path) -> None:
    measured(tmp_path / "record", a_campaign(reference_every=15)).close()
    visits = [each for each in plan_of(tmp_path / "record") if each.kind == "pose"]
    places = [i for i, each in enumerate(visits) if each.set == "reference"]
    assert places[0] == 0
    assert max(np.diff(places)) <= 6 + 1  # 15 readings are five poses


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"accuracy_mm": 0.0}, "accuracy_mm"),
        ({"most": 10}, "most"),
        ({"zone": {"x_mm": [500.0, 300.0]}}, "zone.x_mm"),
        ({"zone": {"x_mm": [300.0, 500.0]}, "zone_joints_deg": [[0.0] * 6]}, "zone_joints_deg"),
        ({"set": "validation"}, "set"),
        ({"minutes": float("nan")}, "minutes"),
    ],
)
def test_a_wrong_key_is_named(changed: dict[str, Any], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        a_campaign(**changed)


def test_a_zone_out_of_reach_is_refused_before_anything_moves(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="zone"):
        Run.create(tmp_path / "record", a_cell(), a_campaign(zone={"x_mm": [5000.0, 5100.0]}))
    assert not (tmp_path / "record").exists()


def test_the_poses_of_a_program_are_its_zone(tmp_path: Path) -> None:
    """What is drawn at random comes from everywhere in it, and what no robot reaches is refused."""
    cell = a_cell()
    many = [list(pose.joints_deg) for pose in _candidates(Bench(cell))[:200]]
    many.sort(key=lambda row: row[0])  # as a program passes along its part
    given = a_campaign(zone_joints_deg=many)
    found = adaptive.block_of(given)
    assert found is not None
    pool = adaptive.pool_of(found[1], adaptive.site_of(cell, given, 0))
    probes = pool.candidates[pool.drawn :]
    assert len(pool.zone) == 200
    assert len(probes) <= 60
    drawn = [pose.joints_deg[0] for pose in probes[:10]]
    assert np.ptp(drawn) > 0.3 * np.ptp([row[0] for row in many])
    with pytest.raises(ConfigError, match="zone_joints_deg 2 is outside"):
        Run.create(tmp_path / "record", cell, a_campaign(zone_joints_deg=[many[0], [500.0, *many[0][1:]]]))


def test_with_a_single_reflector_one_target_is_measured(tmp_path: Path) -> None:
    """Nobody would move it between the poses."""
    cell = a_cell(instrument__one_smr=True)
    with pytest.raises(ConfigError, match="the only SMR"):
        Run.create(tmp_path / "record", cell, a_campaign())
    campaign, outlook = calibration_campaign(cell, accuracy_mm=0.1)
    assert outlook.targets == 1
    assert campaign.blocks[0].targets == ("T3",)  # the farthest from the last axis


def test_an_accuracy_below_the_floor_is_refused_and_one_just_above_is_not() -> None:
    with pytest.raises(ConfigError, match="cannot be reached") as refused:
        calibration_campaign(a_cell(), accuracy_mm=0.02)
    least = float(refused.value.what_to_do.split()[1])
    _, outlook = calibration_campaign(a_cell(), accuracy_mm=least)
    assert outlook.floor_mm < least
    with pytest.raises(ConfigError, match="cannot be reached"):
        calibration_campaign(a_cell(), accuracy_mm=least - 0.002)


def test_a_finer_accuracy_needs_more_poses_and_time() -> None:
    outlooks = [calibration_campaign(a_cell(), accuracy_mm=wanted)[1] for wanted in (0.1, 0.05, 0.045)]
    poses = [outlook.poses or outlook.most for outlook in outlooks]
    assert poses == sorted(poses)
    assert poses[0] < poses[-1]
    minutes = [outlook.minutes for outlook in outlooks]
    assert minutes == sorted(minutes)
