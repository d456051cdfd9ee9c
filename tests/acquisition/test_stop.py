"""A stop while a link is down.

It names the device that it did not reach, and stops everything else. These would catch: a stop that answers "nothing to
complain of" while the robot moves on, and an instrument that waits until the robot is abandoned. They would also catch
a complaint about a robot that no one has set moving.
"""

from __future__ import annotations

import threading
from concurrent.futures import Future

import pytest

from acquisition import Devices
from acquisition.errors import StorageError
from acquisition.run.orders.control import Control
from acquisition.run.orders.stop_orders import StopOrders
from acquisition.run.rig.rig import PRESS, DevicePair
from drivers import AcquisitionError, CannotStop, LinkLost, LinkTimeout, ProtectiveStop
from tests.acquisition.fakes import FakeArm, FakeMeter, JumpingClock, devices_of
from tests.acquisition.stage import Stage
from tests.drivers.waiting import PATIENCE_S, in_thread

MOVE, CONNECT = 9, 10  # calls of a stage: to the pose; after a lost link, to the robot again


class FarArm(FakeArm):
    """Its cable is out: `stop` raises this."""

    trouble: AcquisitionError

    def stop(self) -> None:
        super().stop()
        raise self.trouble


class ReachingArm(FakeArm):
    """Arm that is connected again to be stopped, like a controller whose link may be broken."""

    held = False

    def connect(self) -> None:
        super().connect()
        self.held = True

    def disconnect(self) -> None:
        super().disconnect()
        self.held = False

    def stop(self) -> None:
        super().stop()
        self.held = True


def far(stage: Stage, trouble: AcquisitionError) -> tuple[Devices, FarArm, FakeMeter]:
    arm, meter = FarArm(stage.bench), FakeMeter(stage.bench)
    arm.trouble = trouble
    return Devices(arm, meter, stage.operator), arm, meter


def lose_the_link() -> None:
    raise LinkLost("reset", device="arm")


@pytest.mark.parametrize(
    ("trouble", "words"),
    [
        (LinkTimeout("no answer", device="arm"), "no answer"),
        (CannotStop("stock open_abb has no stop", device="arm"), "not connected"),
    ],
    ids=["no answer", "not asked who it is"],
)
def test_a_stop_while_the_robot_is_not_reached_says_so(
    stage: Stage, trouble: AcquisitionError, words: str
) -> None:
    devices, arm, meter = far(stage, trouble)
    problems: list[AcquisitionError] = []
    stage.bench.faults[MOVE] = lose_the_link
    stage.bench.faults[CONNECT] = lambda: problems.extend(stage.run.stop(by="anna"))
    outcome = stage.run.execute(devices, stage.clock)
    assert outcome.state.value == "stopped"
    assert (arm.stops, meter.armed) == (1, False)
    (problem,) = problems
    for said in (outcome.reason, stage.run.status().reason):  # whoever looks later reads it as well
        assert said.startswith(PRESS)
        assert problem.message in said
    assert (problem.device, problem.what_to_do) == ("arm", PRESS)
    assert words in problem.message
    assert stage.bench.log[-1] == "connect arm"


def test_a_pause_after_a_link_broke_in_a_move_halts_the_robot(stage: Stage) -> None:
    """No check follows that move: without an order, it would end in a paused campaign."""
    devices, arm, _ = far(stage, LinkTimeout("no answer", device="arm"))

    def pull_the_cable_and_pause() -> None:
        stage.run.pause("anna")
        lose_the_link()

    stage.bench.faults[MOVE] = pull_the_cable_and_pause
    outcome = stage.run.execute(devices, stage.clock)
    assert (outcome.state.value, arm.stops) == ("paused", 1)
    assert outcome.reason.startswith(f"{PRESS} Paused on request.")


def test_a_pause_of_a_robot_at_rest_orders_no_stop(stage: Stage) -> None:
    devices, arm, _ = far(stage, LinkTimeout("no answer", device="arm"))
    stage.bench.faults[MOVE] = lambda: stage.run.pause("anna")
    outcome = stage.run.execute(devices, stage.clock)
    assert (outcome.state.value, outcome.reason, arm.stops) == ("paused", "Paused on request.", 0)


def test_the_instrument_does_not_wait_for_the_robot_to_be_given_up(stage: Stage) -> None:
    stopped = threading.Event()

    class LastArm(FakeArm):
        def stop(self) -> None:
            assert stopped.wait(PATIENCE_S), "the robot first, and nothing beside it"
            raise LinkTimeout("no answer", device=self.name)

    class Meter(FakeMeter):
        def stop(self) -> None:
            super().stop()
            stopped.set()

    problems: list[AcquisitionError] = []
    stage.bench.faults[MOVE] = lambda: problems.extend(stage.run.stop(by="anna"))
    devices = Devices(LastArm(stage.bench), Meter(stage.bench), stage.operator)
    assert stage.run.execute(devices, stage.clock).state.value == "stopped"
    assert [type(each) for each in problems] == [LinkTimeout]


def test_a_robot_that_nobody_has_set_moving_is_no_complaint(stage: Stage) -> None:
    devices, _, _ = far(stage, CannotStop("stock open_abb has no stop", device="arm"))
    problems: list[AcquisitionError] = []
    stage.bench.faults[1] = lambda: problems.extend(stage.run.stop(by="anna"))  # while it connects
    assert stage.run.execute(devices, stage.clock).state.value == "stopped"
    assert problems == []


def test_a_stop_ends_the_run_whatever_the_controller_makes_of_it(stage: Stage) -> None:
    """A stop that arrives late looks to the driver like a safety function."""

    def stop() -> None:
        stage.run.stop(by="anna")
        raise ProtectiveStop("motion stopped by the controller", device="arm")

    stage.bench.faults[MOVE] = stop
    outcome = stage.execute()
    assert (outcome.state.value, stage.run.status().state) == ("stopped", "stopped")
    assert outcome.reason.startswith("Stopped on request; arm: motion stopped by the controller.")


def test_no_link_is_closed_while_a_stop_uses_it(stage: Stage) -> None:
    """The move ends as soon as the robot halts; the answer to the stop is still on its way then."""
    stopping, closed = threading.Event(), threading.Event()

    class Arm(FakeArm):
        def stop(self) -> None:
            super().stop()
            stopping.set()
            if closed.wait(0.2):
                raise LinkLost("bad file descriptor", device=self.name)

        def disconnect(self) -> None:
            closed.set()

    stops: list[Future[list[AcquisitionError]]] = []

    def stop() -> None:
        stops.append(in_thread(lambda: stage.run.stop(by="anna")))
        stopping.wait(PATIENCE_S)

    stage.bench.faults[MOVE] = stop
    devices = Devices(Arm(stage.bench), FakeMeter(stage.bench), stage.operator)
    assert stage.run.execute(devices, stage.clock).state.value == "stopped"
    assert stops[0].result(PATIENCE_S) == []
    assert closed.is_set()


def test_a_link_that_is_there_again_is_none_that_is_down(stage: Stage) -> None:
    devices = devices_of(stage.bench, stage.operator)
    problems: list[AcquisitionError] = []
    stage.bench.faults[MOVE] = lose_the_link
    stage.bench.faults[CONNECT + 2] = lambda: problems.extend(stage.run.stop(by="anna"))
    assert stage.run.execute(devices, stage.clock).state.value == "stopped"
    assert problems == []


def test_a_stop_does_not_wait_for_the_record_and_the_run_does_not_end_before_it(stage: Stage) -> None:
    """A sync of a busy disk was seen to take 250 ms."""
    writing, written = threading.Event(), threading.Event()
    events: list[tuple[str, object]] = []

    def write() -> None:
        with stage.run._store.changing():
            writing.set()
            written.wait(2.0 * PATIENCE_S)

    def stop() -> None:
        held = in_thread(write)
        assert writing.wait(PATIENCE_S)
        stopping = in_thread(lambda: stage.run.stop(by="anna"))
        try:
            assert stopping.result(PATIENCE_S) == []
            assert stage.bench.log[-1] == "move"
        finally:
            written.set()
        held.result(PATIENCE_S)

    stage.bench.faults[MOVE] = stop
    outcome = stage.execute(lambda event: events.append((event.kind, event.data.get("state"))))
    assert outcome.state.value == "stopped"
    assert events.index(("command", None)) < events.index(("state", "stopped"))


def test_an_order_that_could_not_be_noted_is_noted_with_the_end(
    stage: Stage, monkeypatch: pytest.MonkeyPatch
) -> None:
    store = stage.run._store
    command, tried = store.command, threading.Event()

    def full(verb: str, by: str, key: str | None = None) -> bool:
        monkeypatch.setattr(store, "command", command)
        tried.set()
        raise StorageError("disk is full")

    def stop() -> None:
        monkeypatch.setattr(store, "command", full)
        stage.run.stop(by="anna")
        assert tried.wait(PATIENCE_S)

    stage.bench.faults[MOVE] = stop
    assert stage.execute().state.value == "stopped"
    noted = [event.data for event in stage.run.events() if event.kind == "command"]
    assert noted == [{"verb": "stop", "by": "anna"}]


def test_the_end_of_a_run_waits_for_what_is_being_noted(
    stage: Stage, monkeypatch: pytest.MonkeyPatch
) -> None:
    let_go, noting = threading.Event(), StopOrders(stage.run._store)
    monkeypatch.setattr(stage.run._store, "command", lambda *order: let_go.wait(PATIENCE_S))
    noting.begin("anna", None)
    ending = in_thread(noting.finish)
    try:
        with pytest.raises(TimeoutError):
            ending.result(0.2)
    finally:
        let_go.set()
    ending.result(PATIENCE_S)


def test_a_stop_that_comes_after_the_run_has_let_go_keeps_no_connection(stage: Stage) -> None:
    """A controller has one place for a program: the next run would not be answered."""
    arm = ReachingArm(stage.bench)
    rig = DevicePair(
        Devices(arm, FakeMeter(stage.bench), stage.operator), Control(JumpingClock()), lambda _: None
    )
    rig.make_ready()
    rig.release()
    assert rig.halt() == []
    assert (arm.stops, arm.held) == (1, False)


def test_a_stop_does_not_wait_for_a_device_that_is_slow_to_let_go(stage: Stage) -> None:
    """The thread that is letting go ends also the connection that the stop made."""
    letting_go, let_go = threading.Event(), threading.Event()

    class SlowToLetGo(ReachingArm):
        def disconnect(self) -> None:
            super().disconnect()
            letting_go.set()
            let_go.wait(PATIENCE_S)

    arm = SlowToLetGo(stage.bench)
    rig = DevicePair(
        Devices(arm, FakeMeter(stage.bench), stage.operator), Control(JumpingClock()), lambda _: None
    )
    rig.make_ready()
    ending = in_thread(rig.release)
    try:
        assert letting_go.wait(PATIENCE_S)
        assert in_thread(rig.halt).result(PATIENCE_S / 2.0) == []
        assert (arm.stops, arm.held) == (1, True)
    finally:
        let_go.set()
    ending.result(PATIENCE_S)
    assert not arm.held
