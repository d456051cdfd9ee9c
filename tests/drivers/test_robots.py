"""Common behaviour of all robot drivers, on every wire.

Arming, limits, stop, disconnect, false arrivals.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Iterator
from typing import Any

import pytest

from drivers import (
    CannotStop,
    ConfigError,
    EmergencyStop,
    EnableLost,
    JointLimit,
    LinkError,
    LinkTimeout,
    MotionStopped,
    NotArmed,
    NotReached,
    NotReady,
    ProtectiveStop,
    RobotArm,
    WrongMode,
    open_robot,
)
from mocks.cell import CellThread
from tests.drivers.robot_bench import BENCHES, FANUC_WIRES, REPORTING, STOPPABLE, Bench
from tests.drivers.waiting import PATIENCE_S, under_way


@pytest.fixture(params=list(BENCHES))
def bench(request: pytest.FixtureRequest) -> Bench:
    return BENCHES[request.param]


@pytest.fixture
def fast(bench: Bench) -> Iterator[CellThread]:
    with bench.cell(5000.0) as cell:
        yield cell


@pytest.fixture
def slow(bench: Bench) -> Iterator[CellThread]:
    """Run moves of most of a minute, so that events happen on the way on a busy machine too."""
    with bench.cell(1.0) as cell:
        yield cell


def test_is_a_robot_arm_says_what_it_is_and_warns_once(
    bench: Bench, fast: CellThread, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.WARNING):
        arm = bench.arm(fast)
        arm.connect()
        identity = arm.identify()
        arm.disconnect()
    assert isinstance(arm, RobotArm)
    assert (identity.maker, identity.model, identity.protocol) == bench.identity
    assert sum("unverified" in record.message for record in caplog.records) == 1


def test_nothing_moves_on_connect_nor_without_arming(bench: Bench, fast: CellThread) -> None:
    arm = bench.arm(fast)
    with pytest.raises(NotArmed):
        arm.move_to((1.0,) * 6)
    arm.arm()
    arm.disarm()
    with pytest.raises(NotArmed):
        arm.move_to((1.0,) * 6)
    assert fast.do("state")["joints_deg"] == (0.0,) * 6
    arm.disconnect()


def test_limits_of_the_cell_are_checked_before_anything_is_sent(bench: Bench, fast: CellThread) -> None:
    arm = bench.arm(fast, limits_deg=[(-90, 90)] * 6)
    arm.arm()
    for bad in (math.nan, math.inf, 91.0, -91.0):
        with pytest.raises(JointLimit) as caught:
            arm.move_to((0, 0, bad, 0, 0, 0))
        assert caught.value.exit_code == 5
    with pytest.raises(JointLimit):
        arm.move_to((0, 0))
    assert fast.do("state")["joints_deg"] == (0.0,) * 6
    arm.move_to((90, 0, 0, 0, 0, 0))
    arm.disconnect()


@pytest.mark.parametrize(
    ("wire", "beyond", "error"),
    [
        ("abb", (170.0, 0, 0, 0, 0, 0), JointLimit),
        ("abb-simple", (170.0, 0, 0, 0, 0, 0), ProtectiveStop),
        *((wire, (0, 0, -143.0, 0, 0, 0), JointLimit) for wire in FANUC_WIRES),
        ("yaskawa", (0, 150.0, 0, 0, 0, 0), ProtectiveStop),
    ],
)
def test_controller_refuses_its_own_limit_and_nothing_moves(
    wire: str, beyond: tuple[float, ...], error: type[Exception]
) -> None:
    bench = BENCHES[wire]
    with bench.cell(5000.0) as cell:
        arm = bench.arm(cell)
        arm.arm()
        with pytest.raises(error, match="50027" if wire == "abb-simple" else None):
            arm.move_to(beyond)
        assert cell.do("state")["joints_deg"] == (0.0,) * 6
        with pytest.raises(NotArmed):
            arm.move_to((1.0,) * 6)
        arm.disconnect()


@pytest.mark.parametrize("bench", [BENCHES[name] for name in STOPPABLE], ids=STOPPABLE)
def test_stop_ends_a_pending_move(bench: Bench, slow: CellThread) -> None:
    arm = bench.arm(slow, speed_deg_s=4.0)
    assert arm.can_stop
    arm.arm()
    move = under_way(arm, bench.far, slow)
    arm.stop()
    with pytest.raises(MotionStopped):
        move.result(PATIENCE_S)
    state = slow.do("state")
    assert not state["moving"]
    assert max(state["joints_deg"]) < 60.0
    with pytest.raises(NotArmed):
        arm.move_to(bench.far)
    arm.arm()
    assert arm.position().joints_deg[0] == pytest.approx(state["joints_deg"][0], abs=0.015)
    arm.disconnect()


@pytest.mark.parametrize(
    "bench", [BENCHES[name] for name in (*STOPPABLE, "ur-rtde")], ids=[*STOPPABLE, "ur-rtde"]
)
def test_stop_before_any_move_twice_and_without_a_connection(bench: Bench, fast: CellThread) -> None:
    arm = bench.arm(fast)
    arm.stop()
    arm.stop()
    arm.disconnect()
    arm.stop()
    arm.disconnect()
    with pytest.raises(LinkError):
        open_robot(bench.driver, fast.url(bench.device), **bench.more).position()


def test_disconnect_from_another_thread_ends_a_pending_move(bench: Bench, slow: CellThread) -> None:
    arm = bench.arm(slow, speed_deg_s=4.0)
    arm.arm()
    move = under_way(arm, bench.far, slow)
    arm.disconnect()
    with pytest.raises(LinkError):
        move.result(PATIENCE_S)


@pytest.mark.parametrize("bench", [BENCHES[name] for name in REPORTING], ids=REPORTING)
def test_end_of_a_move_elsewhere_is_not_believed(bench: Bench, fast: CellThread) -> None:
    arm = bench.arm(fast)
    arm.arm()
    assert fast.cell is not None
    start = fast.cell.arm.start

    def short(target: tuple[float, ...], rate_deg_s: float, tool_mm_s: float) -> None:
        start(tuple(0.9 * q for q in target), rate_deg_s, tool_mm_s)

    fast.cell.arm.start = short  # type: ignore[method-assign, assignment]
    arm.deadlines = bench.quick
    with pytest.raises(NotReached):
        arm.move_to(bench.far)
    with pytest.raises(NotArmed):
        arm.move_to(bench.far)
    arm.disconnect()


MANUAL, MOTORS_OFF = {"what": "mode", "mode": "manual"}, {"what": "motors", "on": False}
ESTOP, SUPERVISED = {"what": "estop"}, {"what": "supervise"}


@pytest.mark.parametrize(
    ("bench", "order", "error"),
    [
        (BENCHES["abb"], MANUAL, EnableLost),
        (BENCHES["abb"], MOTORS_OFF, EnableLost),
        (BENCHES["abb-simple"], MANUAL, WrongMode),
        (BENCHES["abb-simple"], MOTORS_OFF, EnableLost),
        (BENCHES["abb-simple"], SUPERVISED, ProtectiveStop),
        (BENCHES["yaskawa"], MANUAL, WrongMode),
        (BENCHES["yaskawa"], MOTORS_OFF, EnableLost),
        (BENCHES["yaskawa"], SUPERVISED, ProtectiveStop),
        *(
            (BENCHES[wire], order, (EnableLost, WrongMode, ProtectiveStop))
            for wire in FANUC_WIRES
            for order in (MANUAL, MOTORS_OFF)
        ),
    ],
)
def test_controller_gives_up_during_a_move(
    bench: Bench, slow: CellThread, order: dict[str, Any], error: Any
) -> None:
    arm = bench.arm(slow, speed_deg_s=4.0)
    arm.arm()
    move = under_way(arm, bench.far, slow)
    slow.do(**order)
    with pytest.raises(error):
        move.result(PATIENCE_S)
    assert not slow.do("state")["moving"]
    arm.disconnect()


@pytest.mark.parametrize(
    "bench", [BENCHES[name] for name in (*STOPPABLE, "mappdk")], ids=[*STOPPABLE, "mappdk"]
)
def test_emergency_stop_during_a_move_is_seen_and_never_resumed(bench: Bench, slow: CellThread) -> None:
    arm = bench.arm(slow, speed_deg_s=4.0)
    arm.arm()
    move = under_way(arm, bench.far, slow)
    slow.do("estop")
    unreported = {"mappdk": ProtectiveStop, "hses": EnableLost}  # one only sees what follows from it
    with pytest.raises(unreported.get(bench.identity[2], EmergencyStop)):
        move.result(PATIENCE_S)
    slow.do("restart")
    arm.connect()
    with pytest.raises(NotArmed):
        arm.move_to(bench.far)
    assert not slow.do("state")["moving"]
    arm.arm()
    assert arm.position().joints_deg[0] < 60.0
    arm.disconnect()


@pytest.mark.parametrize(
    ("bench", "order", "error"),
    [
        (BENCHES["abb"], {"what": "mode", "mode": "manual_full"}, WrongMode),
        (BENCHES["abb"], MOTORS_OFF, WrongMode),
        (BENCHES["abb-simple"], MANUAL, WrongMode),
        (BENCHES["abb-simple"], MOTORS_OFF, WrongMode),
        (BENCHES["abb-simple"], SUPERVISED, NotReady),
        (BENCHES["abb-simple"], ESTOP, EmergencyStop),
        (BENCHES["yaskawa"], MANUAL, WrongMode),
        (BENCHES["yaskawa"], MOTORS_OFF, WrongMode),
        (BENCHES["yaskawa"], SUPERVISED, ProtectiveStop),
        *((BENCHES[wire], ESTOP, EmergencyStop) for wire in ("mappdk-cal", "modbus-hmi", "modbus-io", "rmi")),
        *(
            (BENCHES[wire], MOTORS_OFF, (WrongMode, EnableLost))
            for wire in ("mappdk-cal", "modbus-hmi", "modbus-io", "rmi")
        ),
    ],
)
def test_arm_refuses_a_controller_that_cannot_move(
    bench: Bench, fast: CellThread, order: dict[str, Any], error: Any
) -> None:
    arm = bench.arm(fast)
    fast.do(**order)
    with pytest.raises(error):
        arm.arm()
    if order is ESTOP:
        assert arm.status().emergency_stop
    arm.disconnect()


@pytest.mark.parametrize("bench", [BENCHES["abb-stock"], BENCHES["mappdk"]])
def test_a_stock_server_cannot_be_stopped_and_says_so(bench: Bench, fast: CellThread) -> None:
    arm = bench.arm(fast)
    assert not arm.can_stop
    arm.arm()
    with pytest.raises(CannotStop):
        arm.stop()
    with pytest.raises(NotArmed):
        arm.move_to(bench.far)
    arm.disconnect()


@pytest.mark.parametrize("bench", [BENCHES["abb"], BENCHES["mappdk"]])
def test_second_client_is_refused(bench: Bench, fast: CellThread) -> None:
    first = bench.arm(fast)
    second = open_robot(bench.driver, fast.url(bench.device), deadlines=bench.hasty)
    with pytest.raises(LinkTimeout) as caught:
        second.connect()
    assert "no other program" in caught.value.what_to_do
    first.disconnect()
    second.deadlines = bench.patient  # type: ignore[attr-defined]
    second.connect()
    second.disconnect()


@pytest.mark.parametrize("driver", ["abb", "abb-simple", "fanuc", "fanuc-rmi", "ur"])
@pytest.mark.parametrize(
    ("url", "options"),
    [
        ("http://h:1", {}),
        ("tcp://h", {}),
        ("tcp://h:99999", {}),
        ("tcp://h:x", {}),
        ("tcp://h:30004", {"speed_deg_s": 0}),
        ("tcp://h:30004", {"limits_deg": [(0, 1)]}),
        ("tcp://h:30004", {"colour": "red"}),
    ],
)
def test_what_no_driver_takes(driver: str, url: str, options: dict[str, Any]) -> None:
    with pytest.raises(ConfigError):
        open_robot(driver, url, **options)


NUMBERS = BENCHES["yaskawa"].more


@pytest.mark.parametrize(
    ("driver", "url", "options"),
    [
        ("abb", "tcp://h:5000?background=x", {}),
        ("abb-simple", "tcp://h:11000?state=x", {}),
        ("abb-simple", "tcp://h:11000?state=70000", {}),
        ("fanuc", "tcp://h:18735?modbus=other", {}),
        ("fanuc", "tcp://h:18735?logger=x", {}),
        ("fanuc", "tcp://h:502?modbus=io&inputs=x", {}),
        ("fanuc", "tcp://h:502?modbus=io&outputs=99999", {}),
        ("fanuc", "tcp://h:502?modbus=io&table=coils", {}),
        ("fanuc", "tcp://h:18735?max_deg_s=1,2,3", {}),
        ("fanuc", "tcp://h:18735?max_deg_s=1,2,3,4,5,x", {}),
        ("fanuc", "tcp://h:18735?max_deg_s=1,2,3,4,5,0", {}),
        ("fanuc-rmi", "tcp://h:16001?session=x", {}),
        ("fanuc-rmi", "tcp://h:502?modbus=hmi", {}),
        ("fanuc-rmi", "tcp://h:16001?max_deg_s=1,2,3", {}),
        ("ur", "tcp://h:3", {}),
        ("ur", "tcp://h:30004?realtime=x", {}),
        ("ur", "tcp://h:30004?dashboard=70000", {}),
        ("ur", "tcp://h:30004?feed=modbus", {}),
        ("ur", "tcp://h:30004", {"watchdog_s": 0}),
        ("yaskawa", "tcp://h:10040", NUMBERS),
        ("yaskawa", "udp://h", NUMBERS),
        ("yaskawa", "udp://h:10040", {}),
        ("yaskawa", "udp://h:10040", NUMBERS | {"speed_mm_s": 0}),
        ("yaskawa", "udp://h:10040", NUMBERS | {"pulses_per_deg": (1000.0,) * 5}),
        ("yaskawa", "udp://h:10040", NUMBERS | {"pulses_per_deg": (0.0,) * 6}),
        ("yaskawa", "udp://h:10040", NUMBERS | {"max_deg_s": (math.inf,) * 6}),
    ],
)
def test_what_one_driver_does_not_take(driver: str, url: str, options: dict[str, Any]) -> None:
    with pytest.raises(ConfigError):
        open_robot(driver, url, **options)
