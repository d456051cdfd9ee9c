"""The reference bridge of `examples/bridge` with our drivers.

One page of protocol must be enough for both sides.
"""

from __future__ import annotations

import importlib.util
import math
import socket
import threading
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from drivers import (
    Busy,
    CommandRefused,
    EmergencyStop,
    FaroTracker,
    InstrumentDeadlines,
    LeicaTracker,
    LinkTimeout,
    MotionStopped,
    NotReady,
    ProtocolError,
    TargetNotSeen,
)
from drivers.bridge.mbp import checksum
from mocks.faultproxy import FaultProxy
from tests.drivers.waiting import PATIENCE_S, in_thread, until

FILE = Path(__file__).parents[2] / "examples" / "bridge" / "bridge.py"


@pytest.fixture(scope="module")
def module() -> ModuleType:
    spec = importlib.util.spec_from_file_location("reference_bridge", FILE)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def bridge(module: ModuleType) -> Iterator[Any]:
    bridge = module.Bridge(module.Still())
    bridge.port = bridge.listen(0)
    thread = threading.Thread(target=bridge.serve)
    thread.start()
    yield bridge
    bridge.close()
    thread.join()


@pytest.fixture
def tracker(bridge: Any) -> Iterator[LeicaTracker]:
    tracker = LeicaTracker(f"tcp://127.0.0.1:{bridge.port}", heartbeat_s=None)
    tracker.connect()
    tracker.arm()
    yield tracker
    tracker.disconnect()


def test_both_tracker_drivers_measure_through_it(bridge: Any) -> None:
    for driver in (LeicaTracker, FaroTracker):
        tracker = driver(f"tcp://127.0.0.1:{bridge.port}", heartbeat_s=None)
        tracker.connect()
        tracker.arm()
        assert tracker.identify().simulated is True
        for near in (None, (1001.0, 2000.0, 300.0)):
            reading = tracker.measure("T1", samples=2, near_mm=near)
            assert math.dist(reading.xyz_mm, bridge.device.place) == 0.0
            assert reading.pressure_hpa == 1013.25
        with pytest.raises(TargetNotSeen):
            tracker.measure("T1", samples=2, near_mm=(0.0, 2000.0, 300.0))
        tracker.disconnect()


def test_states_and_exceptions_of_the_library(bridge: Any, tracker: LeicaTracker) -> None:
    device = bridge.device
    device.state = lambda: "ESTOP"
    with pytest.raises(EmergencyStop):
        tracker.measure("T1", samples=1)
    device.state = lambda: "WARMING"
    with pytest.raises(NotReady):
        tracker.arm()
    device.state = lambda: "READY"

    def broken(*_: object) -> None:
        raise RuntimeError('library says "no"\nand more')

    device.measure = broken
    with pytest.raises(CommandRefused, match="501: library says 'no' and more"):
        tracker.measure("T1", samples=1)
    del device.measure
    device.place = (0.0, 0.0, 0.0)  # a bridge that answers zeros after all
    with pytest.raises(ProtocolError, match="origin"):
        tracker.measure("T1", samples=1)


def test_stop_and_second_client(bridge: Any, tracker: LeicaTracker) -> None:
    second = LeicaTracker(f"tcp://127.0.0.1:{bridge.port}", deadlines=InstrumentDeadlines(takeover_s=0.1))
    with pytest.raises(Busy):
        second.connect()
    reading = in_thread(lambda: tracker.measure("T1", samples=1000))
    until(bridge.busy)
    tracker.stop()
    with pytest.raises(MotionStopped):
        reading.result(PATIENCE_S)
    tracker.arm()
    tracker.measure("T1", samples=1)


def test_client_that_leaves_ends_what_moves_and_comes_back(bridge: Any, tracker: LeicaTracker) -> None:
    reading = in_thread(lambda: tracker.measure("T1", samples=1000))
    until(bridge.busy)
    tracker.disconnect()
    assert reading.exception(PATIENCE_S) is not None
    tracker.connect()
    tracker.arm()
    tracker.measure("T1", samples=1)


@pytest.mark.parametrize("fault", ["flip", "garbage", "half", "stale", "reorder", "duplicate"])
def test_never_a_wrong_reading_through_it(bridge: Any, fault: str) -> None:
    """Every measurement has a separate place, so an earlier one would be visible."""
    made = 0

    def measure(*_: object) -> tuple[tuple[float, ...], tuple[float, ...]]:
        nonlocal made
        made += 1
        return (1000.0 + made, 2000.0, 300.0), (0.01, 0.01, 0.01)

    bridge.device.measure = measure
    with FaultProxy(bridge.port, boundary=b"\n") as proxy:
        limits = InstrumentDeadlines(reply_s=0.3, measure_margin_s=0.3)
        tracker = LeicaTracker(f"tcp://127.0.0.1:{proxy.port}", heartbeat_s=None, deadlines=limits)
        for after in (0, 1):
            tracker.connect()
            tracker.arm()
            proxy.spoil(fault, after=after)
            for _ in range(3):
                try:
                    assert tracker.measure("T1", samples=1).xyz_mm[0] == 1000.0 + made
                except (ProtocolError, LinkTimeout):
                    break
            proxy.heal()
        tracker.disconnect()


def test_lines_that_are_no_requests(bridge: Any) -> None:
    with socket.create_connection(("127.0.0.1", bridge.port), timeout=PATIENCE_S) as client:
        lines = client.makefile("rb")
        for body, wanted in (
            (b"nonsense", b"0 ERR code=101"),
            (b"5 NONSENSE", b"5 ERR code=102"),
            (b"6 TARGET", b"6 ERR code=103"),
            (b"7 HELLO proto=2", b"7 ERR code=103"),
        ):
            client.sendall(body + b"*0000\n" + body + b"*" + checksum(body).encode() + b"\n")
            assert lines.readline().startswith(wanted)  # the line with the wrong sum was thrown away
        lines.close()
