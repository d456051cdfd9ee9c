"""The emScon driver against its simulated server, packet by packet and whole."""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers import (
    BeamBroken,
    Busy,
    ConfigError,
    EmsconTracker,
    LinkLost,
    NoisyMeasurement,
    NotReady,
    ProtocolError,
    TargetNotSeen,
)
from drivers.leica import emscon_packets as tpi
from mocks.cell import CellThread
from mocks.cell_file import CellFile
from mocks.leica import emscon as server
from mocks.leica.device import LeicaDevice
from tests.drivers.expected import Pair, converse
from tests.drivers.instrument_bench import EMSCON, truth

FAST = CellFile(time_scale=10_000.0, effects=("none",))


@pytest.fixture(scope="module")
def shared() -> Iterator[CellThread]:
    with CellThread(FAST, devices=("emscon",)) as cell:
        yield cell


@pytest.fixture
def device(shared: CellThread) -> LeicaDevice:
    assert shared.cell is not None
    shared.do("restore_beam")
    shared.do("tracker", state="READY")
    shared.do("weather", on=True)
    return shared.cell.at960


@pytest.fixture
def tracker(shared: CellThread, device: LeicaDevice) -> Iterator[EmsconTracker]:
    tracker = EmsconTracker(shared.url("emscon"))
    tracker.connect()
    tracker.arm()
    yield tracker
    tracker.disconnect()


def test_measures_where_it_points(tracker: EmsconTracker, device: LeicaDevice) -> None:
    for name in ("T1", "N1", "N2"):
        near = [value + 5.0 for value in truth(device, name)]
        reading = tracker.measure(name, samples=10, near_mm=near)
        assert math.dist(reading.xyz_mm, truth(device, name)) < 0.3
        assert reading.pressure_hpa == 1013.2
        again = tracker.measure(name, samples=10)  # the beam holds it
        assert 0.0 < math.dist(again.xyz_mm, reading.xyz_mm) < 0.3
    with pytest.raises(TargetNotSeen):
        tracker.measure("T2", near_mm=(900.0, 900.0, 900.0))
    tracker.measure("T1", near_mm=truth(device, "T1"))


def test_reflector_by_name(shared: CellThread, device: LeicaDevice) -> None:
    tracker = EmsconTracker(shared.url("emscon"), reflector="TBR-0.5in")
    tracker.connect()
    tracker.arm()
    assert shared.cell is not None
    assert shared.cell.emscon.reflector == 7
    tracker.disconnect()
    wrong = EmsconTracker(shared.url("emscon"), reflector="CCR-9in")
    wrong.connect()
    with pytest.raises(ConfigError, match=r"CCR-1\.5in, RRR-1\.5in, TBR-0\.5in"):
        wrong.arm()
    wrong.disconnect()


def test_broken_beam(shared: CellThread, tracker: EmsconTracker, device: LeicaDevice) -> None:
    tracker.measure("T1", near_mm=truth(device, "T1"))
    shared.do("break_beam")
    with pytest.raises(BeamBroken) as caught:
        tracker.measure("T1")
    assert (caught.value.code, caught.value.device) == (2001, "emscon")
    assert caught.value.raw
    shared.do("restore_beam")
    with pytest.raises(TargetNotSeen):  # nothing in the beam until it is pointed again
        tracker.measure("T1")
    tracker.measure("T1", near_mm=truth(device, "T1"))


def test_frozen_reading_is_stale(shared: CellThread, tracker: EmsconTracker, device: LeicaDevice) -> None:
    near = truth(device, "T1")
    fields = dict(zip("xyz", near, strict=True))
    shared.do("odd_reading", fields=fields)
    tracker.measure("T1", near_mm=near)
    shared.do("odd_reading", fields=fields)
    with pytest.raises(NoisyMeasurement, match="exactly like the one before"):
        tracker.measure("T1")


def test_what_another_program_left_is_put_in_order(
    shared: CellThread, device: LeicaDevice, caplog: pytest.LogCaptureFixture
) -> None:
    """A scaling transformation and a weather without correction are not visible in a point."""
    shared.do("meddle", settings=[1, 1, 1, 1, 0, 1, 0, 1, 1], scale=1.0005)
    tracker = EmsconTracker(shared.url("emscon"))
    tracker.connect()
    tracker.arm()
    reading = tracker.measure("T1", near_mm=truth(device, "T1"))
    assert math.dist(reading.xyz_mm, truth(device, "T1")) < 0.3
    assert shared.cell is not None
    assert shared.cell.emscon.settings == [2, 0, 0, 1, 1, 0, 0, 1, 1]
    put = "weather correction, transformation, station orientation, telling of changes, sending of positions"
    assert f"set for these readings: {put}" in caplog.text
    shared.do("meddle", settings=[2, 0, 0, 1, 1, 0, 32768, 0, 0], scale=1.0)
    with pytest.raises(ProtocolError, match="settings that do not exist"):
        tracker.arm()
    shared.do("meddle", settings=[2, 0, 0, 1, 1, 0, 0, 0, 0])
    tracker.disconnect()


@pytest.mark.parametrize(
    ("code", "what"),
    [
        (6, "units"),
        (7, "reflector"),
        (8, "system settings"),
        (11, "compensation"),
        (12, "coordinate system"),
        (15, "station"),
        (16, "transformation"),
        (17, "measurement mode"),
    ],
)
def test_settings_changed_between_two_readings(
    shared: CellThread, tracker: EmsconTracker, device: LeicaDevice, code: int, what: str
) -> None:
    """No program listens while the robot moves, so the change is received with the next answer."""
    tracker.measure("T1", near_mm=truth(device, "T1"))
    shared.do("meddle", code=code)
    with pytest.raises(NotReady, match=f"another program changed {what}") as caught:
        tracker.measure("T1", near_mm=truth(device, "T1"))
    assert "Close the other program" in caught.value.what_to_do
    tracker.arm()
    shared.do("meddle", code=code)
    with pytest.raises(NotReady, match="another program changed"):  # and not: nothing found
        tracker.measure("T1", near_mm=(900.0, 900.0, 900.0))
    tracker.arm()
    tracker.measure("T1", near_mm=truth(device, "T1"))


def test_another_reflector_is_not_armed_with(shared: CellThread, device: LeicaDevice) -> None:
    tracker = EmsconTracker(shared.url("emscon"))
    tracker.connect()
    shared.do("meddle", reflector=1)
    tracker.arm()
    shared.do("meddle", reflector=7, code=7)
    with pytest.raises(NotReady, match="uses reflector 7, until now it was 1"):
        tracker.arm()
    shared.do("meddle", reflector=1)
    tracker.arm()
    tracker.measure("T1", near_mm=truth(device, "T1"))
    tracker.disconnect()


def test_positions_that_nobody_asked_for(
    shared: CellThread, tracker: EmsconTracker, device: LeicaDevice
) -> None:
    shared.do("positions")
    tracker.measure("T1", near_mm=truth(device, "T1"))
    shared.do("positions")
    assert tracker.status().state == "READY"


def test_bad_requests(tracker: EmsconTracker) -> None:
    with pytest.raises(ConfigError):
        tracker.measure("T1", near_mm=(math.nan, 0.0, 0.0))
    with pytest.raises(ConfigError):
        EmsconTracker("tcp://127.0.0.1:1", rate_hz=0.0)


# -- packets -------------------------------------------------------------------------------------------------

UNITS = bytes.fromhex("20000000 00000000 05000000 01000000 01000000 00000000 01000000 00000000")
STATUS = bytes.fromhex("0c000000 00000000 02000000")
READY = bytes.fromhex("14000000 00000000 02000000 00000000 02000000")
CHANGED = bytes.fromhex("0c000000 08000000 06000000")


def ok(number: int) -> bytes:
    """A good answer without results, by hand."""
    return struct.pack("<iiii", 16, 0, number, 0)


AIR = struct.pack("<iiiiddd", 40, 0, 21, 0, 21.5, 1013.25, 45.0)
SYSTEM = struct.pack("<iiii10i", 56, 0, 1, 0, 0, 5, 3, 2, 3, 6, 0, 2, 0, 390123)
REFLECTOR = bytes.fromhex("0c000000 00000000 29000000")
SETTINGS = struct.pack("<iiii9i", 52, 0, 48, 0, 2, 0, 0, 1, 1, 0, 0, 0, 0)
SINGLE = struct.pack(
    "<iiiii17d", 156, 2, 0, 0, 0, *(300, 400, 0), *(0.01, 0.02, 0.01), 0.025, *(0,) * 7, 21.5, 1013.25, 45
)
CONVERSATION: list[Pair] = [
    (bytes.fromhex("0c000000 00000000 01000000"), SYSTEM),
    (UNITS, CHANGED + ok(5)),
    (STATUS, READY),
    (bytes.fromhex("0c000000 00000000 15000000"), AIR),
    (STATUS, READY),
    (bytes.fromhex("0c000000 00000000 15000000"), AIR),
    (bytes.fromhex("0c000000 00000000 01000000"), SYSTEM),
    (bytes.fromhex("0c000000 00000000 30000000"), SETTINGS),
    (bytes.fromhex("10000000 00000000 1a000000 00000000"), ok(26)),
    (bytes.fromhex("10000000 00000000 18000000 00000000"), ok(24)),
    (bytes.fromhex("18000000 00000000 2b000000 0000000000003e40 4c1d0000"), ok(43)),
    (REFLECTOR, struct.pack("<iiiii", 20, 0, 41, 0, 1)),
    (STATUS, READY),
    (bytes.fromhex("14000000 00000000 1c000000 f4010000 01000000"), ok(28)),
    (STATUS, READY),
    (bytes.fromhex("0c000000 00000000 31000000"), ok(49) + SINGLE),
]


def test_driver_speaks_as_written() -> None:
    reading = EMSCON.read(CONVERSATION, "N1")
    assert (reading.xyz_mm, reading.std_mm) == ((300.0, 400.0, 0.0), (0.01, 0.02, 0.01))
    assert (reading.t_air_c, reading.pressure_hpa, reading.humidity_percent) == (21.5, 1013.25, 45.0)
    assert reading.raw == SINGLE


def test_simulator_answers_as_written(shared: CellThread, device: LeicaDevice) -> None:
    """Bytes are compared if every tracker has the same, otherwise size, type, command, status."""

    def kinds(reply: bytes) -> bytes:
        out, at = b"", 0
        while at + 8 <= len(reply):
            size, kind = struct.unpack_from("<ii", reply, at)
            if kind != 8:
                out += reply[at : at + 16]
            at += size
        return out

    device.held = "N1"
    converse(shared.port("emscon"), CONVERSATION, same=kinds)


@given(st.binary(max_size=300))
def test_any_bytes(data: bytes) -> None:
    try:
        packet = tpi.parse(data)
    except ProtocolError:
        return
    assert packet.raw == data


@given(st.sampled_from([0, 1, 2, 6, 7, 8, 11]), st.binary(min_size=4, max_size=150))
def test_any_body_under_a_good_header(kind: int, body: bytes) -> None:
    try:
        packet = tpi.parse(struct.pack("<ii", 8 + len(body), kind) + body)
    except ProtocolError:
        return
    assert packet.kind == kind


@given(st.floats(allow_nan=False), st.floats(allow_nan=False), st.floats(allow_nan=False))
def test_places_are_read_by_the_server(x: float, y: float, z: float) -> None:
    data = tpi.command(tpi.GO_POSITION, x, y, z, 1)
    assert server.numbers(data[:12]) == [40, 0, 55]
    assert data[12:36] == server.f64(x, y, z)
    assert server.numbers(data[36:]) == [1]


@pytest.mark.parametrize(
    ("status", "error"), [(1, Busy), (27, NotReady), (37, BeamBroken), (10004, TargetNotSeen), (38, LinkLost)]
)
def test_status_numbers(status: int, error: type[Exception]) -> None:
    packet = tpi.parse(struct.pack("<iiii", 16, 0, 49, status))
    assert type(tpi.error_of(packet, "emscon", "measure")) is error
