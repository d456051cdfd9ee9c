"""The ballbar driver on its simulated bridge: TCP, a pseudo-terminal and a pyserial URL."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator

import numpy as np
import pytest

from drivers import (
    ConfigError,
    LinkLost,
    LinkTimeout,
    NoisyMeasurement,
    NotArmed,
    NotReady,
    OutOfRange,
    ProtocolError,
    Qc20w,
    open_instrument,
)
from drivers.serial_link import SerialLink
from mocks.cell import CellThread
from mocks.cell_file import CellFile
from mocks.shared.mbp import line
from mocks.world.world import REPEATABILITY_DEG
from tests.drivers.expected import Pair, converse, shapes
from tests.drivers.instrument_bench import BALLS, PLACE, QC20W
from tests.drivers.waiting import PATIENCE_S, in_thread, until

FAST = CellFile(time_scale=10_000.0, effects=("none",), nests=BALLS)


@pytest.fixture(scope="module")
def shared() -> Iterator[CellThread]:
    with CellThread(FAST, devices=("qc20w", "qc20w-serial")) as cell:
        yield cell


def pty_of(cell: CellThread) -> str:
    return str(cell.endpoints[1].line()["url"])


@pytest.fixture(params=["tcp", "pty"])
def meter(shared: CellThread, request: pytest.FixtureRequest) -> Iterator[Qc20w]:
    shared.do("mount", base=None, target=None)
    shared.do("knock", by_mm=0.0)
    shared.do("battery", percent=80.0)
    shared.do("radio", on=True)
    shared.do("calibrator", on=True)
    url = shared.url("qc20w") if request.param == "tcp" else pty_of(shared)
    meter = Qc20w(url, nominal_mm=300.0, heartbeat_s=None)
    meter.connect()
    meter.arm()
    yield meter
    meter.disconnect()


def test_a_bar_of_no_length_is_refused(shared: CellThread) -> None:
    with pytest.raises(ConfigError):
        open_instrument("qc20w", shared.url("qc20w"))  # no nominal length


def test_length_between_two_balls(meter: Qc20w) -> None:
    """The length is within the robot's repeatability, with small errors of bar and scale.

    Temperature and zero are a little wrong too. The lengths scatter only as the bar repeats, because the arm stands
    still.
    """
    meter.zero()
    lengths = [meter.measure("T1", base_target="B1", samples=50).length_mm for _ in range(20)]
    off = math.radians(REPEATABILITY_DEG) * np.linalg.norm(PLACE)  # of one joint
    assert np.mean(lengths) == pytest.approx(math.dist(PLACE, BALLS["B1"]), abs=3.0 * float(off))
    assert np.std(lengths) < 0.001


def test_what_a_length_is_made_of(meter: Qc20w) -> None:
    zero = meter.zero()
    reading = meter.measure("T1", base_target="B1")
    bar = meter.calibration
    assert bar is not None
    assert reading.t_air_c is not None
    warm = bar.length_mm * (1.0 + 11.7e-6 * (reading.t_air_c - 20.0))
    assert reading.length_mm == pytest.approx(warm + bar.scale * (reading.deviation_mm - zero), abs=1e-9)
    assert reading.zero_mm == zero
    assert 0.0 < abs(zero) < 0.01


@pytest.mark.parametrize("base", ["B2", "B3"])
def test_out_of_stroke(meter: Qc20w, base: str) -> None:
    with pytest.raises(OutOfRange) as caught:
        meter.measure("T1", base_target=base)
    assert caught.value.code == 2003
    assert "extension bar" in caught.value.what_to_do
    meter.measure("T1", base_target="B1")


def test_bar_knocked_off_and_bar_elsewhere(shared: CellThread, meter: Qc20w) -> None:
    before = meter.measure("T1", base_target="B1").length_mm
    shared.do("knock", by_mm=0.2)
    assert meter.measure("T1", base_target="B1").length_mm - before == pytest.approx(0.2, abs=0.06)
    shared.do("knock", by_mm=3.0)
    with pytest.raises(OutOfRange):
        meter.measure("T1", base_target="B1")
    shared.do("knock", by_mm=0.0)
    shared.do("mount", base="B2", target="T1")
    with pytest.raises(OutOfRange):  # whatever is asked, it sits where it sits
        meter.measure("T1", base_target="B1")


def test_wrong_extension_bar(shared: CellThread) -> None:
    shared.do("extend", nominal_mm=150.0)
    meter = Qc20w(shared.url("qc20w"), nominal_mm=300.0, heartbeat_s=None)
    meter.connect()
    with pytest.raises(NotReady, match="300 mm") as caught:
        meter.arm()
    assert "extension bar" in caught.value.what_to_do
    meter.disconnect()
    shared.do("extend", nominal_mm=300.0)


def test_a_bar_built_to_another_length_is_held_against_its_calibration() -> None:
    with CellThread(FAST, devices=("qc20w",)) as cell:
        meter = Qc20w(cell.url("qc20w"), nominal_mm=300.0, heartbeat_s=None)
        meter.connect()
        meter.arm()
        meter.zero()
        apart = float(np.linalg.norm(np.subtract(BALLS["B1"], BALLS["B2"])))
        meter.build(apart)
        assert meter.zero_mm == 0.0  # it was that of the other bar
        with pytest.raises(NotArmed):
            meter.measure("B1", base_target="B2")
        meter.arm()
        reading = meter.measure("B1", base_target="B2")
        assert reading.length_mm == pytest.approx(apart, abs=0.05)
        assert meter.calibration is not None
        assert abs(meter.calibration.length_mm - apart) < 0.1
        cell.do("extend", nominal_mm=300.0)  # the operator takes the wrong bar
        meter.build(150.0)
        with pytest.raises(NotReady, match=r"the bar is calibrated to \d+\.?\d* mm, 150 mm are needed now"):
            meter.arm()
        with pytest.raises(ConfigError, match="a ballbar of -1 mm is not possible"):
            meter.build(-1.0)
        meter.disconnect()


def test_a_zero_that_no_well_seated_bar_shows(shared: CellThread, meter: Qc20w) -> None:
    meter.arm()
    meter.zero()
    kept = meter.zero_mm
    shared.do("knock", by_mm=0.35)
    with pytest.raises(
        OutOfRange, match=r"a zero of \+0.35.* mm; a bar well seated in its calibrator shows 0.2 mm"
    ):
        meter.zero()
    assert meter.zero_mm == kept


def test_battery_radio_and_calibrator(shared: CellThread, meter: Qc20w) -> None:
    shared.do("battery", percent=2.0)
    with pytest.raises(NotReady):
        meter.measure("T1", base_target="B1")
    shared.do("battery", percent=50.0)
    assert meter.measure("T1", base_target="B1").battery_percent == 50.0
    shared.do("calibrator", on=False)
    with pytest.raises(OutOfRange):
        meter.zero()
    shared.do("radio", on=False)
    with pytest.raises(LinkLost):
        meter.measure("T1", base_target="B1")
    shared.do("radio", on=True)
    with pytest.raises(NotArmed):  # until it is connected anew
        meter.measure("T1", base_target="B1")
    meter.connect()
    meter.arm()
    meter.measure("T1", base_target="B1")


def after_a_break(meter: Qc20w) -> None:
    """Measure, and measure again if the break of the radio link voids the first reading."""
    try:
        meter.measure("T1", base_target="B1")
    except NoisyMeasurement:
        meter.measure("T1", base_target="B1")


def test_another_bar_paired_between_two_readings(shared: CellThread, meter: Qc20w) -> None:
    """The bridge stays connected and greets as before: only the certificate shows another bar."""
    shared.do("flicker")  # back at once, and the same bar
    after_a_break(meter)
    shared.do("pair", serial="2Q0777", longer_mm=0.3)
    with pytest.raises(NotReady, match=r"bar 2Q0777 of 300\.\d+ mm answers, until now it was 2Q0001"):
        after_a_break(meter)
    with pytest.raises(NotReady, match="2Q0777"):
        meter.arm()
    assert meter.identify().serial == "2Q0777"  # by which a record knows it in another program, too
    shared.do("pair", serial="2Q0001", longer_mm=-0.3)
    meter.arm()
    meter.measure("T1", base_target="B1")


def test_a_low_battery_says_what_to_do(shared: CellThread, meter: Qc20w) -> None:
    shared.do("battery", percent=2.0)
    with pytest.raises(NotReady) as caught:
        meter.measure("T1", base_target="B1")
    assert "battery into the instrument" in caught.value.what_to_do


def test_bad_requests(meter: Qc20w) -> None:
    for names in (("T1", "B 1"), ("T1 n=0", "B1")):
        with pytest.raises(ConfigError):
            meter.measure(names[0], base_target=names[1])
    with pytest.raises(ConfigError):
        Qc20w("tcp://127.0.0.1:1", nominal_mm=-1.0)


def test_radio_that_flickers_in_a_reading() -> None:
    slow = CellFile(time_scale=1.0, effects=("none",), nests=BALLS)
    with CellThread(slow, devices=("qc20w",)) as cell:
        meter = Qc20w(cell.url("qc20w"), nominal_mm=300.0, heartbeat_s=None)
        meter.connect()
        meter.arm()
        reading = in_thread(lambda: meter.measure("T1", base_target="B1", samples=100))
        until(lambda: cell.cell and cell.cell.qc20w.bridge.busy)
        cell.do("flicker")
        with pytest.raises(NoisyMeasurement, match="LINK_DOWN"):
            reading.result(PATIENCE_S)
        meter.disconnect()


# -- the serial line -----------------------------------------------------------------------------------------


def test_second_program_on_the_port_is_refused(shared: CellThread) -> None:
    first = Qc20w(pty_of(shared), nominal_mm=300.0, heartbeat_s=None)
    first.connect()
    second = Qc20w(pty_of(shared), nominal_mm=300.0, heartbeat_s=None)
    with pytest.raises(LinkLost):
        second.connect()
    first.disconnect()


def test_no_such_port_and_no_such_scheme() -> None:
    for url, error in (("/dev/no-such-port", LinkLost), ("nonsense://x", ConfigError)):
        with pytest.raises(error):
            Qc20w(url, nominal_mm=300.0).connect()


def test_echo_is_not_an_answer() -> None:
    """Reject the question itself as an answer: `loop://` of pyserial sends it back."""
    meter = Qc20w("loop://", nominal_mm=300.0, heartbeat_s=None)
    with pytest.raises(ProtocolError):
        meter.connect()


def test_numbers_go_on_over_a_reconnect(shared: CellThread) -> None:
    meter = Qc20w(pty_of(shared), nominal_mm=300.0, heartbeat_s=None)
    asked: list[int] = []
    for _ in range(2):
        meter.connect()
        asked.append(int(meter.session.ask("PING", {}).number))
    meter.disconnect()
    assert asked[1] == asked[0] + 2  # HELLO lies between


def test_unplugged_in_the_middle() -> None:
    ours, theirs = os.openpty()
    link = SerialLink(os.ttyname(theirs), "bar")
    link.open(connect_s=PATIENCE_S)
    reading = in_thread(
        lambda: link.read_until(b"\n", command="READ", deadline="reply_s", seconds=2.0 * PATIENCE_S)
    )
    os.write(ours, b"1 OK d=0.1")
    until(lambda: link._buffer)
    os.close(ours)
    with pytest.raises(LinkLost):
        reading.result(PATIENCE_S)
    link.close()
    os.close(theirs)


def test_closed_from_another_thread_and_deadline() -> None:
    ours, theirs = os.openpty()
    link = SerialLink(os.ttyname(theirs), "bar")
    link.open(connect_s=PATIENCE_S)
    with pytest.raises(LinkTimeout, match=r"reply_s = 0\.1"):
        link.read_until(b"\n", command="READ", deadline="reply_s", seconds=0.1)
    reading = in_thread(
        lambda: link.read_until(b"\n", command="READ", deadline="reply_s", seconds=2.0 * PATIENCE_S)
    )
    until(link._reading.locked)
    link.close()
    with pytest.raises(LinkLost):
        reading.result(PATIENCE_S)
    os.close(ours)
    os.close(theirs)


# -- golden transcript ---------------------------------------------------------------------------------------

READ: list[Pair] = [
    (
        b"1 HELLO proto=1 client=truepose crc=1*05B0\n",
        line(
            "1 OK proto=1 kind=BALLBAR vendor=Renishaw model=QC20-W serial=2Q0001 fw=1.4 bridge=1.0 crc=1 "
            "units=mm,deg,C,hPa sim=1"
        ),
    ),
    (b"2 STATUS*B508\n", line("2 OK state=READY T=21.89 batt=80.0")),
    (b"3 STATUS*F2DB\n", line("3 OK state=READY T=21.89 batt=80.0")),
    (
        line("4 CAL nominal=300.0"),
        line("4 OK L0=300.002 scale=1.0001 u=0.0005 alpha=11.7 date=2026-03-02 cert=SIM-0001 serial=2Q0001"),
    ),
    (
        line("5 READ n=10 rate=100.0 timeout=5.1 base=B1 target=T1"),
        line("5 ACK eta=1.0")
        + line("5 OK d=0.1 sd=0.0005 n=10 t=12.5 age=0.0 temp=22.0 batt=80.0 link=-60 over=0"),
    ),
]


def test_driver_speaks_as_written() -> None:
    reading = QC20W.read(READ, "T1")
    # 300.002 (1 + 11.7e-6 * 2) + 1.0001 * 0.1
    assert reading.length_mm == pytest.approx(300.1090300468, abs=1e-9)
    assert (reading.deviation_mm, reading.std_mm, reading.battery_percent) == (0.1, 0.0005, 80.0)


def test_a_deviation_in_metres_is_told_by_its_scatter() -> None:
    """Greeting and certificate are in mm; this would catch a sensor value left in metres."""
    reply = line("5 OK d=0.0001 sd=5e-07 n=10 t=12.5 age=0.0 temp=22.0 batt=80.0 link=-60 over=0")
    with pytest.raises(NotReady, match="less than the sensor can show"):
        QC20W.read([*READ[:-1], (READ[-1][0], reply)], "T1")


def test_simulator_answers_as_written(shared: CellThread) -> None:
    shared.do("mount", base=None, target=None)
    shared.do("battery", percent=80.0)
    converse(shared.port("qc20w"), READ, same=shapes)
