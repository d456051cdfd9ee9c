"""The FARO driver on the simulated bridge.

Frames, targets, beam, odd readings, abort, second client.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import pytest

from drivers import (
    BeamBroken,
    CommandRefused,
    ConfigError,
    FaroTracker,
    InstrumentDeadlines,
    LinkError,
    NotReady,
    OutOfRange,
    ProtocolError,
    TargetNotSeen,
)
from mocks.cell import CellThread
from mocks.cell_file import CellFile
from mocks.shared.mbp import line
from tests.drivers.expected import MBP_MEASURE, ExpectedDevice
from tests.drivers.waiting import until

FAST = CellFile(time_scale=10_000.0, effects=("none",))


class Wire:
    """Log of the bytes that were sent."""

    def __init__(self) -> None:
        self.sent: list[bytes] = []

    def record(self, device: str, direction: str, data: bytes) -> None:
        if direction == ">":
            self.sent.append(data)


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
    with pytest.raises(ConfigError):
        tracker.measure("T1", near_mm=(math.nan, 0, 0))
    tracker.measure("T1")


def test_a_measurement_is_waited_for_as_long_as_its_samples_last(cell: CellThread) -> None:
    wire = Wire()
    tracker = FaroTracker(cell.url("faro"), heartbeat_s=None, wire=wire, rate_hz=50.0)
    tracker.connect()
    tracker.arm()
    tracker.measure("T1", samples=1000)
    tracker.disconnect()
    (asked,) = [each.decode() for each in wire.sent if b"MEASURE" in each]
    fields = dict(part.split("=", 1) for part in asked.split("*")[0].split() if "=" in part)
    assert float(fields["timeout"]) >= 1000 / 50.0
    assert (fields["face"], float(fields["rate"])) == ("1", 50.0)
    with pytest.raises(ConfigError, match="rate_hz"):
        FaroTracker("tcp://127.0.0.1:1", rate_hz=0.0)


def test_without_weather_it_is_not_armed(cell: CellThread) -> None:
    assert cell.cell is not None
    cell.cell.tracker.weather = False
    tracker = FaroTracker(cell.url("faro"), heartbeat_s=None)
    tracker.connect()
    with pytest.raises(NotReady, match="weather"):
        tracker.arm()
    tracker.disconnect()


def test_heartbeat_keeps_an_idle_connection(cell: CellThread) -> None:
    """An idle wire carries heartbeats with answers until the driver disconnects."""
    wire = Wire()
    tracker = FaroTracker(cell.url("faro"), heartbeat_s=0.01, wire=wire)
    tracker.connect()
    tracker.arm()
    begun = len(wire.sent)
    until(lambda: sum(b"PING" in each for each in wire.sent[begun:]) > 5)
    tracker.measure("T1")
    tracker.disconnect()
    assert all(b"PING" in each or b"MEASURE" in each for each in wire.sent[begun:] if b"BYE" not in each)


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
