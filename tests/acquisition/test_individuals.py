"""The robot of a record is one robot: behaviour when another robot or instrument answers.

These would catch: a resumed campaign, a reconnect or a verification that takes any device that answers. They would also
catch an acceptance of any serial number, or without a reason, and readings of two robots or two instruments as one
series.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from acquisition import ExecutionOutcome, export
from acquisition.errors import OtherIndividual
from acquisition.record import DeviceAcceptance, export_together
from acquisition.record.device_serials import Individual, individuals_of
from acquisition.run.run import Run
from calib import read_dataset
from drivers import ConfigError, LinkLost
from service.report.scope import devices_of
from tests.acquisition.fakes import a_campaign
from tests.acquisition.stage import Stage
from tests.service.campaigns import read_rows

BLOCKS = [{"set": "calibration", "count": 12, "targets": ["T1", "T2"]}]
HALF = 16  # device calls until some readings are there
ROLES = ("robot", "instrument")
MOTIONS = ("arm", "move", "measure")


@pytest.fixture
def make(tmp_path: Path) -> Iterator[Callable[..., Stage]]:
    made: list[Stage] = []

    def one(name: str = "r", **campaign: Any) -> Stage:
        made.append(Stage(tmp_path / name, **campaign))
        return made[-1]

    yield one
    for stage in made:
        stage.run.close()


def exchange(stage: Stage, role: str, serial: str = "777777") -> None:
    stage.bench.who[role] = replace(stage.bench.who[role], serial=serial)


def half_done(make: Callable[..., Stage]) -> Stage:
    stage = make(block=BLOCKS)
    stage.bench.faults[HALF] = stage.run.pause
    assert stage.execute().state.value == "paused"
    assert stage.run.status().done > 0
    return stage


def refused(stage: Stage, role: str, outcome: ExecutionOutcome) -> None:
    """Assert that nothing was armed or moved, and that the run gives the reason."""
    assert outcome.state.value == "paused"
    assert isinstance(outcome.error, OtherIndividual)
    assert outcome.exit_code == 5
    assert f"another {role} answers" in outcome.reason
    assert "777777" in outcome.reason
    assert "--accept-device" in outcome.reason
    assert not [call for call in stage.bench.log if call.startswith(MOTIONS)]


@pytest.mark.parametrize("role", ROLES)
def test_another_one_is_refused_on_resuming(make: Callable[..., Stage], role: str) -> None:
    stage = half_done(make)
    exchange(stage, role)
    for accepted in (None, DeviceAcceptance("1", "a mistake", "anna")):  # no leave, and leave for another
        stage.bench.log.clear()
        stage.run.resume(by="anna", accepted=accepted)
        refused(stage, role, stage.execute())
    exchange(stage, role, "1")
    stage.run.resume(by="anna")
    assert stage.execute().state.value == "succeeded"


@pytest.mark.parametrize("role", ROLES)
def test_another_one_is_refused_after_a_cable_was_out(make: Callable[..., Stage], role: str) -> None:
    stage = make(block=BLOCKS)

    def swap() -> None:
        exchange(stage, role)
        stage.bench.log.clear()
        raise LinkLost("cable out")

    stage.bench.faults[8 if role == "robot" else 10] = swap  # the first move, the first reading of a pose
    refused(stage, role, stage.execute())


@pytest.mark.parametrize("role", ROLES)
def test_an_accepted_one_is_kept_with_its_reason_and_is_a_series(
    make: Callable[..., Stage], tmp_path: Path, role: str
) -> None:
    stage = half_done(make)
    before = stage.run.status().done
    exchange(stage, role)
    stage.run.resume(by="anna", accepted=DeviceAcceptance(" 777777", "arm replaced under warranty", "anna"))
    assert stage.execute().state.value == "succeeded"
    by_kind = {event.kind: event.data for event in stage.run.events()}
    assert by_kind["accept_other"]["reason"] == "arm replaced under warranty"
    assert by_kind["other_device_accepted"]["by"] == "anna"
    assert "777777" in by_kind["other_device_accepted"]["now"]
    out = export(stage.folder, tmp_path / "out.csv")
    series = [row["series"] for row in read_rows(out)]
    names = ["1+1", "777777+1" if role == "robot" else "1+777777"]
    assert series == names[:1] * before + names[1:] * (24 - before)
    dataset = read_dataset(out)
    assert set(dataset.conditions.series_names) == set(names)
    assert dataset.header.unknown_keys == ()
    assert [line for line in devices_of(dataset) if "arm replaced under warranty" in line[1]] == [
        (role.capitalize(), next(t for n, t in devices_of(dataset) if "777777," in t and "warranty" in t))
    ]
    # Back to the first one: that is another one again.
    stage.run.close()
    assert individuals_of(stage.folder)[role].serial == "777777"


def test_one_robot_and_one_instrument_are_one_series(make: Callable[..., Stage], tmp_path: Path) -> None:
    stage = make(block=BLOCKS)
    stage.execute()
    out = export(stage.folder, tmp_path / "out.csv")
    assert "series" not in read_rows(out)[0]
    assert [each["serial"] for each in read_dataset(out).header.devices] == ["1", "1"]


def test_what_is_not_told_proves_nothing_until_it_is_told(make: Callable[..., Stage]) -> None:
    stage = make(block=BLOCKS)
    exchange(stage, "robot", "")
    stage.bench.faults[HALF] = stage.run.pause
    stage.execute()
    exchange(stage, "robot", "120-000001")
    stage.bench.faults[stage.bench.calls + 8] = stage.run.pause
    stage.run.resume()
    assert stage.execute().error is None
    assert individuals_of(stage.folder)["robot"].serial == "120-000001"
    exchange(stage, "robot", "")  # a dialect that does not report it, of the same robot for all one knows
    stage.bench.faults[stage.bench.calls + 8] = stage.run.pause
    stage.run.resume()
    assert stage.execute().error is None
    exchange(stage, "robot")
    stage.bench.log.clear()
    stage.run.resume()
    refused(stage, "robot", stage.execute())


@pytest.mark.parametrize("open_first", [True, False])
def test_a_robot_is_known_by_its_alias_whether_or_not_it_tells_its_number(
    make: Callable[..., Stage], open_first: bool
) -> None:
    """A UR whose dashboard opens, or closes, between two programs."""
    stage = make(block=BLOCKS)

    def answer(serial: str, alias: str) -> None:
        stage.bench.who["robot"] = replace(stage.bench.who["robot"], serial=serial, alias=alias)

    told = [("20155301234", "calibration-1"), ("calibration-1", "calibration-1")]
    first, second = told if open_first else reversed(told)
    answer(*first)
    stage.bench.faults[HALF] = stage.run.pause
    stage.execute()
    answer(*second)
    stage.bench.faults[stage.bench.calls + 8] = stage.run.pause
    stage.run.resume()
    assert stage.execute().error is None
    assert individuals_of(stage.folder)["robot"].serial == first[0]
    answer("777777", "calibration-2")
    stage.bench.log.clear()
    stage.run.resume()
    refused(stage, "robot", stage.execute())


def test_another_model_is_another_device_and_new_software_is_not(make: Callable[..., Stage]) -> None:
    stage = half_done(make)
    stage.bench.who["instrument"] = replace(stage.bench.who["instrument"], firmware="2", protocol="other")
    stage.bench.faults[stage.bench.calls + 8] = stage.run.pause
    stage.run.resume()
    assert stage.execute().error is None
    stage.bench.who["instrument"] = replace(stage.bench.who["instrument"], model="another", serial="")
    stage.run.resume(accepted=DeviceAcceptance("meter", "no", "anna"))
    assert isinstance(stage.execute().error, OtherIndividual)
    stage.run.resume(accepted=DeviceAcceptance("another", "it reports no serial number", "anna"))
    assert stage.execute().state.value == "succeeded"


def test_the_robot_of_a_model_is_needed_in_every_program(make: Callable[..., Stage]) -> None:
    """The robot is required by `watch run`.

    `campaign resume` finds that requirement in the record, and accepting another robot does not help.
    """
    stage = make(block=BLOCKS)
    stage.run.need(Individual.of("robot", stage.bench.who["robot"]))
    exchange(stage, "robot")
    for _ in range(2):
        outcome = stage.execute()
        assert isinstance(outcome.error, OtherIndividual)
        assert "the model is of ABB IRB 120, serial number 1. Give the model of this robot" in outcome.reason
        assert not [call for call in stage.bench.log if call.startswith(MOTIONS)]
        stage.run.close()
        stage.run = Run.open(stage.folder)
        stage.run.resume(accepted=DeviceAcceptance("777777", "why not", "bert"))
    exchange(stage, "robot", "1")
    assert stage.execute().state.value == "succeeded"


@pytest.mark.parametrize("simulated", [False, True])
def test_a_campaign_names_the_one_robot_that_it_is_for(make: Callable[..., Stage], simulated: bool) -> None:
    """The plan of a watch names the robot of its baseline, and every way of running checks it.

    A rehearsal takes any robot.
    """
    stage = make(block=BLOCKS)
    stage.run.close()
    campaign = a_campaign(block=BLOCKS, robot={"model": "IRB 120", "serial": "12"})
    stage.run = Run.create(stage.folder.with_name("for"), stage.bench.cell, campaign, simulated=simulated)
    outcome = stage.execute()
    if simulated:
        assert outcome.state.value == "succeeded"
        return
    assert "serial number 1, but the model is of IRB 120, serial number 12. Give" in outcome.reason
    assert not [call for call in stage.bench.log if call.startswith(MOTIONS)]


@pytest.mark.parametrize("given", [("", "why"), ("777777", " ")])
def test_a_serial_number_and_a_reason(given: tuple[str, str]) -> None:
    with pytest.raises(ConfigError, match="for a reason"):
        DeviceAcceptance(*given)


@pytest.mark.parametrize("role", ROLES)
def test_a_verification_is_of_the_same_robot(make: Callable[..., Stage], role: str) -> None:
    first, second = make("a", block=BLOCKS), make("b", block=BLOCKS)
    first.execute()
    second.run.expect(list(individuals_of(first.folder).values()))
    exchange(second, role)
    refused(second, role, second.execute())
    second.run.resume(accepted=DeviceAcceptance("777777", "why not", "bert"))
    assert second.execute().state.value == "succeeded"
    assert individuals_of(second.folder)[role].why().endswith("was accepted by bert beside another: why not")


def test_records_of_two_robots_are_not_poured_together(make: Callable[..., Stage], tmp_path: Path) -> None:
    first, second, third = (make(name, block=BLOCKS) for name in "abc")
    exchange(second, "robot")
    exchange(third, "instrument", "tracker-2")
    for stage in (first, second, third):
        assert stage.execute().state.value == "succeeded"
    out = tmp_path / "all.csv"
    with pytest.raises(OtherIndividual, match=r"serial number 777777, .* with ABB IRB 120, serial number 1"):
        export_together([first.folder, second.folder], out)
    with pytest.raises(OtherIndividual):
        export_together([first.folder, second.folder], out, DeviceAcceptance("1", "the wrong one"))
    assert not out.exists()
    export_together(
        [first.folder, second.folder, third.folder], out, DeviceAcceptance("777777", "same build", "eve")
    )
    assert [row["series"] for row in read_rows(out)] == ["1+1"] * 24 + ["777777+1"] * 24 + [
        "1+tracker-2"
    ] * 24
    devices = read_dataset(out).header.devices
    assert [each["reason"] for each in devices if each["serial"] == "777777"] == ["same build"]
    export_together([first.folder, third.folder], out)  # two instruments of one robot need nobody's leave
    assert {row["series"] for row in read_rows(out)} == {"1+1", "1+tracker-2"}
