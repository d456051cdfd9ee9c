"""The FARO driver against the simulated bridge: frames, targets, beam, odd readings, abort, second client."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from drivers import (
    BeamBroken,
    Busy,
    CommandRefused,
    ConfigError,
    EmergencyStop,
    FaroTracker,
    InstrumentDeadlines,
    LinkError,
    MotionStopped,
    NoisyMeasurement,
    NotArmed,
    NotReady,
    OutOfRange,
    PointMeter,
    ProtocolError,
    TargetNotSeen,
    open_instrument,
)
from mocks.cell import CellThread
from mocks.cell_file import CellFile
from mocks.shared.mbp import line
from tests.drivers.expected import MBP_MEASURE, ExpectedDevice
from tests.drivers.waiting import PATIENCE_S, in_thread, until

FAST = CellFile(time_scale=10_000.0, effects=("none",))
SLOW = CellFile(time_scale=1.0, effects=("none",))


@pytest.fixture
def cell() -> Iterator[CellThread]:
    with CellThread(FAST) as cell:
        yield cell


@pytest.fixture
def tracker(cell: CellThread) -> Iterator[FaroTracker]:
    tracker = FaroTracker(cell.url("faro"), heartbeat_s=None)
    tracker.connect()
    tracker.arm()
    yield tracker
    tracker.disconnect()


def truth(cell: CellThread, name: str) -> tuple[float, ...]:
    return tuple(cell.do("state")["targets_tracker_mm"][name])


def test_is_a_point_meter_and_says_what_it_is(cell: CellThread) -> None:
    tracker = open_instrument("faro", cell.url("faro"))
    assert isinstance(tracker, PointMeter)
    tracker.connect()
    identity = tracker.identify()
    assert (identity.maker, identity.protocol, identity.simulated) == ("FARO", "mbp1", True)
    with pytest.raises(NotArmed):
        tracker.measure("T1")
    tracker.disconnect()
    with pytest.raises(LinkError):
        tracker.identify()


def test_measures_every_nest_by_name(cell: CellThread, tracker: FaroTracker) -> None:
    for name in ("N1", "N2", "N3", "T1", "T2", "T3"):
        assert math.dist(tracker.measure(name).xyz_mm, truth(cell, name)) < 0.3


def test_world_frame_comes_from_the_nests(cell: CellThread, tracker: FaroTracker) -> None:
    """Origin N1, x to N2, z normal: then a point of the tool is where the world says it is."""
    n1, n2, n3 = (np.array(tracker.measure(name).xyz_mm) for name in ("N1", "N2", "N3"))
    x = (n2 - n1) / np.linalg.norm(n2 - n1)
    z = np.cross(x, n3 - n1)
    z /= np.linalg.norm(z)
    turn = np.array([x, np.cross(z, x), z])
    world = turn @ (np.array(tracker.measure("T1").xyz_mm) - n1)
    assert math.dist(world, cell.do("state")["targets_world_mm"]["T1"]) < 0.5
    assert math.dist(n1, (0, 0, 0)) > 1000.0  # the tracker's frame is not the world's


def test_points_at_a_place_and_takes_the_nearest(cell: CellThread, tracker: FaroTracker) -> None:
    near = [value + 5.0 for value in truth(cell, "T2")]
    assert math.dist(tracker.measure("T2", near_mm=near).xyz_mm, truth(cell, "T2")) < 0.3
    with pytest.raises(TargetNotSeen):
        tracker.measure("T2", near_mm=[value + 500.0 for value in near])
    with pytest.raises(OutOfRange):
        tracker.measure("T2", near_mm=(0.0, 0.0, 1.0))


def test_one_smr_is_measured_where_it_sits_whatever_its_name(cell: CellThread, tracker: FaroTracker) -> None:
    cell.do("seat", target="T3")
    reading = tracker.measure("T1")
    assert math.dist(reading.xyz_mm, truth(cell, "T3")) < 0.3


def test_more_samples_scatter_less(cell: CellThread) -> None:
    assert cell.cell is not None
    device = cell.cell.tracker
    device._indicated_world = device.true_world
    ones = [device.average("N1", 1)[0] for _ in range(300)]
    many = [device.average("N1", 100)[0] for _ in range(300)]
    assert np.std(ones, axis=0).mean() == pytest.approx(0.02, rel=0.2)
    assert np.std(many, axis=0).mean() == pytest.approx(0.002, rel=0.2)


def test_beam_broken_and_back(cell: CellThread, tracker: FaroTracker) -> None:
    cell.do("break_beam")
    with pytest.raises(BeamBroken) as caught:
        tracker.measure("T1")
    assert caught.value.code == 2001
    assert caught.value.raw
    cell.do("restore_beam")
    tracker.measure("T1")


def test_beam_broken_during_a_reading() -> None:
    with CellThread(SLOW) as cell:
        tracker = FaroTracker(cell.url("faro"), heartbeat_s=None)
        tracker.connect()
        tracker.arm()
        reading = in_thread(lambda: tracker.measure("T1", samples=1000))
        until(lambda: cell.cell and cell.cell.tracker.held == "T1")
        cell.do("break_beam")
        with pytest.raises(BeamBroken):
            reading.result(PATIENCE_S)
        tracker.disconnect()


def test_interferometer_needs_home_after_a_break(cell: CellThread) -> None:
    tracker = FaroTracker(cell.url("faro"), heartbeat_s=None, distance_mode="IFM")
    tracker.connect()
    tracker.arm()
    cell.do("break_beam")
    cell.do("restore_beam")
    with pytest.raises(BeamBroken):
        tracker.measure("T1")
    tracker.disconnect()


def test_hidden_target(cell: CellThread, tracker: FaroTracker) -> None:
    cell.do("hide", target="T2")
    with pytest.raises(TargetNotSeen):
        tracker.measure("T2")
    tracker.measure("T1")
    cell.do("show", target="T2")
    tracker.measure("T2")


def test_unknown_target_and_bad_arguments(tracker: FaroTracker) -> None:
    with pytest.raises(CommandRefused):
        tracker.measure("T9")
    for options in ({"samples": 0}, {"near_mm": (math.nan, 0, 0)}):
        with pytest.raises(ConfigError):
            tracker.measure("T1", **options)  # type: ignore[arg-type]
    with pytest.raises(ConfigError):
        tracker.measure("T1 x=0")
    tracker.measure("T1")


@pytest.mark.parametrize(
    ("fields", "error"),
    [
        ({"status": 1}, NoisyMeasurement),
        ({"n": 3}, NoisyMeasurement),
        ({"age": 5.0}, NoisyMeasurement),
        ({"t": -1.0}, NoisyMeasurement),
        ({"sx": 0.9}, NoisyMeasurement),
        ({"x": 0.0, "y": 0.0, "z": 0.0, "r": 0.0}, ProtocolError),
        ({"x": "nan"}, ProtocolError),
        ({"x": "inf"}, ProtocolError),
        ({"r": 17.0}, ProtocolError),
        ({"target": "T2"}, ProtocolError),
        ({"temp": 900.0}, ProtocolError),
    ],
)
def test_impossible_readings_are_void(
    cell: CellThread, tracker: FaroTracker, fields: dict[str, Any], error: type[Exception]
) -> None:
    tracker.measure("T1")
    cell.do("odd_reading", fields=fields)
    with pytest.raises(error):
        tracker.measure("T1")
    if error is ProtocolError:  # nothing more is believed on that connection
        with pytest.raises((LinkError, NotArmed)):
            tracker.measure("T1")
        tracker.connect()
        tracker.arm()
    tracker.measure("T1")


@pytest.mark.parametrize(
    ("order", "error"),
    [
        ({"what": "tracker", "state": "WARMING"}, NotReady),
        ({"what": "tracker", "state": "ERROR"}, NotReady),
        ({"what": "weather", "on": False}, NotReady),
    ],
)
def test_arm_waits_for_a_ready_tracker(
    cell: CellThread, order: dict[str, Any], error: type[Exception]
) -> None:
    cell.do(**order)
    tracker = FaroTracker(cell.url("faro"), heartbeat_s=None)
    tracker.connect()
    with pytest.raises(error):
        tracker.arm()
    tracker.disconnect()


def test_arm_initialises_a_tracker_that_is_off(cell: CellThread) -> None:
    cell.do("tracker", state="OFF")
    tracker = FaroTracker(cell.url("faro"), heartbeat_s=None)
    tracker.connect()
    assert tracker.status().state == "OFF"
    tracker.arm()
    assert tracker.status().state == "READY"
    tracker.disconnect()


def test_emergency_stop_of_the_tracker(cell: CellThread, tracker: FaroTracker) -> None:
    cell.do("tracker", state="ESTOP")
    with pytest.raises(EmergencyStop):
        tracker.measure("T1")


def test_stop_ends_a_pending_reading() -> None:
    with CellThread(SLOW) as cell:
        tracker = FaroTracker(cell.url("faro"), heartbeat_s=None)
        tracker.connect()
        tracker.arm()
        reading = in_thread(lambda: tracker.measure("T1", samples=1000))
        until(lambda: cell.cell and cell.cell.tracker.held == "T1")
        tracker.stop()
        with pytest.raises(MotionStopped):
            reading.result(PATIENCE_S)
        tracker.arm()
        tracker.stop()
        tracker.disconnect()


def test_second_client_is_busy(cell: CellThread, tracker: FaroTracker) -> None:
    second = FaroTracker(cell.url("faro"), deadlines=InstrumentDeadlines(takeover_s=0.1))
    with pytest.raises(Busy):
        second.connect()
    second.disconnect()
    tracker.measure("T1")


def test_heartbeat_keeps_an_idle_connection(cell: CellThread) -> None:
    tracker = FaroTracker(cell.url("faro"), heartbeat_s=0.01)
    tracker.connect()
    tracker.arm()
    asked = tracker.session.client._numbers
    until(lambda: next(asked) > 40)
    tracker.measure("T1")
    tracker.disconnect()


@pytest.mark.parametrize("change", [("kind=TRACKER", "kind=BALLBAR"), ("proto=1", "proto=2")])
def test_wrong_device_or_version_on_the_port(change: tuple[str, str]) -> None:
    request, reply = MBP_MEASURE[0]
    changed = line(reply.rsplit(b"*", 1)[0].decode().replace(*change))
    with ExpectedDevice([(request, changed)]) as device:
        tracker = FaroTracker(f"tcp://127.0.0.1:{device.port}", heartbeat_s=None)
        with pytest.raises(ProtocolError, match=change[0].split("=")[0]):
            tracker.connect()


def test_wrong_protocol_on_the_port(cell: CellThread) -> None:
    tracker = FaroTracker(cell.url("abb"), heartbeat_s=None, deadlines=InstrumentDeadlines(reply_s=0.2))
    with pytest.raises(LinkError):
        tracker.connect()
    tracker.disconnect()
