"""The AT960 driver on its simulated bridge.

Cones, beam and PowerLock, weather, reflector, faces, transcript.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import pytest

from drivers import BeamBroken, CommandRefused, ConfigError, LeicaTracker, NotReady, OutOfRange, TargetNotSeen
from mocks.cell import CellThread
from mocks.leica.device import LeicaDevice
from mocks.shared.at_rest import hidden_by
from mocks.shared.mbp import line
from tests.drivers.expected import ExpectedDevice, Pair, converse, shapes
from tests.drivers.instrument_bench import FACING, LEICA, ONE_SIDED, truth
from tests.drivers.waiting import until


@pytest.fixture(scope="module")
def shared() -> Iterator[CellThread]:
    with CellThread(ONE_SIDED, devices=("leica",)) as cell:
        yield cell


@pytest.fixture
def device(shared: CellThread) -> LeicaDevice:
    assert shared.cell is not None
    shared.cell.arm.start(FACING, 1e6, 1e9)
    for order in (
        {"what": "restore_beam"},
        {"what": "power_lock", "on": True},
        {"what": "tracker", "state": "READY"},
        {"what": "weather", "on": True},
        {"what": "seat", "target": None},
    ):
        shared.do(**order)
    return shared.cell.at960


@pytest.fixture
def tracker(shared: CellThread, device: LeicaDevice) -> Iterator[LeicaTracker]:
    tracker = LeicaTracker(shared.url("leica"), heartbeat_s=None)
    tracker.connect()
    tracker.arm()
    yield tracker
    tracker.disconnect()


def test_measures_by_name_and_by_place(tracker: LeicaTracker, device: LeicaDevice) -> None:
    for name in ("T1", "N1", "T2"):
        assert math.dist(tracker.measure(name).xyz_mm, truth(device, name)) < 0.3
        near = [value + 5.0 for value in truth(device, name)]
        assert math.dist(tracker.measure(name, near_mm=near).xyz_mm, truth(device, name)) < 0.3
    with pytest.raises(TargetNotSeen):
        tracker.measure("T2", near_mm=(900.0, 900.0, 900.0))
    with pytest.raises(OutOfRange):
        tracker.measure("T2", near_mm=(0.0, 0.0, 1.0))
    with pytest.raises(CommandRefused):
        tracker.measure("T9")


def test_an_smr_is_seen_within_30_deg(shared: CellThread, tracker: LeicaTracker, device: LeicaDevice) -> None:
    """T1's normal is turned about axis 5 until it leaves the cone.

    T2 declares no normal and is always visible.
    """
    assert shared.cell is not None
    seen, angles = [], []
    for j5 in range(-40, 100, 4):
        shared.cell.arm.start((*FACING[:4], float(j5), 0.0), 1e6, 1e9)
        until(lambda: not device.arm.moving)
        frame = device.world.flange(device.arm_state())
        ray = device.world.station - device.true_world("T1")
        angles.append(math.degrees(math.acos(frame[:3, 2] @ ray / np.linalg.norm(ray))))
        try:
            tracker.measure("T1", samples=2)
            seen.append(True)
        except TargetNotSeen:
            seen.append(False)
        tracker.measure("T2", samples=2)
    assert seen == [angle <= 30.0 for angle in angles]
    assert 3 < sum(seen) < len(seen) - 3


def test_limbs_hide_what_is_behind_them() -> None:
    limb = [np.array([0.0, 0.0, 0.0]), np.array([0.0, 0.0, 500.0])]
    eye = np.array([1000.0, 0.0, 250.0])
    for y, z, hidden in (
        (0.0, 250.0, True),
        (100.0, 250.0, True),
        (120.0, 250.0, False),
        (0.0, 900.0, False),
    ):
        assert hidden_by(limb, eye, np.array([-1000.0, y, z])) is hidden
    assert not hidden_by(limb, eye, np.array([100.0, 0.0, 250.0]))  # in front


def test_broken_beam_finds_its_target_again(
    shared: CellThread, tracker: LeicaTracker, device: LeicaDevice
) -> None:
    shared.do("break_beam")
    with pytest.raises(BeamBroken):
        tracker.measure("T1")
    shared.do("restore_beam")
    tracker.measure("T1")
    shared.do("power_lock", on=False)
    shared.do("break_beam")
    shared.do("restore_beam")
    with pytest.raises(TargetNotSeen):
        tracker.measure("T1")
    tracker.measure("T1", near_mm=truth(device, "T1"))
    tracker.measure("T1")


def test_manual_weather_scales_distances(tracker: LeicaTracker, device: LeicaDevice) -> None:
    """Errors of 10 K and 20 hPa give 0.95 * 10 + 0.27 * 20 ppm, about 39 um at 2.6 m.

    The mean of 40 readings shows it.
    """

    def range_mm() -> float:
        return float(np.mean([math.hypot(*tracker.measure("N1", samples=50).xyz_mm) for _ in range(40)]))

    right = range_mm()
    tracker.session.ask("WEATHER", {"source": "MAN", "T": device.air_c() + 10.0, "P": 993.2, "H": 45.0})
    wrong = range_mm()
    assert 1e6 * (wrong / right - 1.0) == pytest.approx(14.9, abs=5.0)
    tracker.arm()  # the station's again
    assert 1e6 * (range_mm() / right - 1.0) == pytest.approx(0.0, abs=5.0)


def test_head_drifts_while_it_warms_up(device: LeicaDevice) -> None:
    place = device.nests["N1"]
    far = float(np.linalg.norm(place - device.world.station))
    device._rng = np.random.default_rng(0)
    cold = np.mean([_indicated(device, 0.0) for _ in range(200)], axis=0)
    warm = np.mean([_indicated(device, 1e6) for _ in range(200)], axis=0)
    assert np.linalg.norm(cold - warm) == pytest.approx(10e-6 * far, rel=0.35)


def _indicated(device: LeicaDevice, t_s: float) -> np.ndarray:
    now, device.clock.now = device.clock.now, lambda: t_s
    try:
        return device._indicated_world("N1")
    finally:
        device.clock.now = now


def test_unknown_reflector_is_refused(shared: CellThread, tracker: LeicaTracker, device: LeicaDevice) -> None:
    tracker.disconnect()
    other = LeicaTracker(shared.url("leica"), heartbeat_s=None, reflector_mm=30.0)
    other.connect()
    with pytest.raises(CommandRefused, match="30 mm"):
        other.arm()
    other.disconnect()
    for options in ({"profile": "SLOW"}, {"faces": "three"}, {"rate_hz": 0.0}, {"reflector_mm": -1.0}):
        with pytest.raises(ConfigError):
            LeicaTracker("tcp://127.0.0.1:1", **options)  # type: ignore[arg-type]


def test_reflector_that_does_not_come_back_as_told() -> None:
    pairs = [*MEASURE[:5], (MEASURE[5][0], line("6 OK type=SMR d=12.7"))]
    with ExpectedDevice(pairs) as device:
        tracker = LeicaTracker(f"tcp://127.0.0.1:{device.port}", heartbeat_s=None)
        tracker.connect()
        with pytest.raises(NotReady, match=r"12\.7 mm, the cell one of 38\.1") as caught:
            tracker.arm()
        tracker.disconnect()
    assert "SMR" in caught.value.what_to_do


def test_both_faces(shared: CellThread, device: LeicaDevice) -> None:
    tracker = LeicaTracker(shared.url("leica"), heartbeat_s=None, faces="both")
    tracker.connect()
    tracker.arm()
    assert tracker.measure("T1").face == "BOTH"
    tracker.disconnect()


# -- golden transcript ---------------------------------------------------------------------------------------

MEASURE: list[Pair] = [
    (
        b"1 HELLO proto=1 client=truepose crc=1*05B0\n",
        line(
            "1 OK proto=1 kind=TRACKER vendor=Leica model=AT960-MR serial=750001 fw=2.3 bridge=1.0 crc=1 "
            "units=mm,deg,C,hPa sim=1"
        ),
    ),
    (b"2 STATUS*B508\n", line("2 OK state=READY T=21.89 P=1013.2 H=45.0")),
    (b"3 STATUS*F2DB\n", line("3 OK state=READY T=21.89 P=1013.2 H=45.0")),
    (line("4 WEATHER source=STATION"), line("4 OK T=21.89 P=1013.2 H=45.0 n=1.000270")),
    (line("5 MODE distance=ADM profile=STANDARD"), line("5 OK")),
    (line("6 TARGET type=SMR d=38.1"), line("6 OK type=SMR d=38.1")),
    (
        line("7 MEASURE samples=10 rate=100.0 face=1 target=N1 timeout=15.1"),
        line("7 ACK eta=1.0")
        + line(
            "7 OK x=300.0 y=400.0 z=0.0 sx=0.01 sy=0.02 sz=0.01 n=10 t=12.5 age=0.0 r=500.0 status=0 temp=21.89 "
            "P=1013.2 H=45.0 mode=ADM face=1 target=N1"
        ),
    ),
]


def test_driver_speaks_as_written() -> None:
    reading = LEICA.read(MEASURE, "N1")
    assert (reading.xyz_mm, reading.std_mm) == ((300.0, 400.0, 0.0), (0.01, 0.02, 0.01))
    assert (reading.samples, reading.t_s, reading.t_air_c, reading.mode) == (10, 12.5, 21.89, "ADM")


def test_simulator_answers_as_written(shared: CellThread, device: LeicaDevice) -> None:
    converse(shared.port("leica"), MEASURE, same=shapes)
