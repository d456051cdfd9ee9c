"""Checksums of MBP/1 on TCP.

They are always requested, and required once promised; a bridge without checksums causes a warning.
"""

from __future__ import annotations

import logging

import pytest

from drivers import FaroTracker, ProtocolError
from mocks.cell import CellThread
from mocks.cell_file import CellFile
from mocks.shared.mbp import line
from tests.drivers.expected import ExpectedDevice, Pair

FAST = CellFile(time_scale=10_000.0, effects=("none",))
ASKED = line("1 HELLO proto=1 client=truepose crc=1")
HELLO = "1 OK proto=1 kind=TRACKER vendor=FARO model=ION serial=1 fw=4.1 bridge=1.0 units=mm,deg,C,hPa sim=1"
STATUS: Pair = (line("2 STATUS"), b"2 OK state=READY T=21.5 P=1013.2 H=45.0\n")


def tracker(port: int) -> FaroTracker:
    return FaroTracker(f"tcp://127.0.0.1:{port}", heartbeat_s=None)


def test_a_bridge_that_promises_sums_must_send_one_with_its_promise() -> None:
    """Otherwise, damage to the mark of the checksum would end all checking."""
    unsealed = [(ASKED, f"{HELLO} crc=1\n".encode())]
    with ExpectedDevice(unsealed) as device, pytest.raises(ProtocolError, match="checksum missing"):
        tracker(device.port).connect()


def test_a_bridge_that_sends_sums_is_held_to_them_whatever_it_says() -> None:
    with ExpectedDevice([(ASKED, line(f"{HELLO} crc=0")), STATUS]) as device:
        faro = tracker(device.port)
        faro.connect()
        assert not faro.weakness
        with pytest.raises(ProtocolError, match="checksum missing"):
            faro.status()


@pytest.mark.parametrize("crc", [" crc=0", ""])
def test_a_bridge_without_sums_is_believed_and_named(crc: str, caplog: pytest.LogCaptureFixture) -> None:
    with ExpectedDevice([(ASKED, f"{HELLO}{crc}\n".encode()), STATUS]) as device:
        faro = tracker(device.port)
        with caplog.at_level(logging.WARNING):
            faro.connect()
        assert faro.status().state == "READY"
        assert "sends no checksums" in faro.weakness
        faro.disconnect()
    assert sum("sends no checksums" in record.message for record in caplog.records) == 1


def test_empty_lines_and_capitals_are_no_fault_of_a_bridge() -> None:
    """An empty line, a keepalive of the bridge, once cost two seconds and a reconnection."""
    hello = line(f"{HELLO.replace('mm,deg', 'MM,Deg')} crc=1")
    status = b"\r\n\n" + line("2 OK state=READY T=21.5 P=1013.2 H=45.0")
    with ExpectedDevice([(ASKED, b"\n" + hello), (STATUS[0], status)]) as device:
        faro = tracker(device.port)
        faro.connect()
        assert faro.status().state == "READY"
        faro.disconnect()


@pytest.mark.parametrize("units", ["m,rad,C,hPa", "in,deg,C,hPa", "um", "mm,gon"])
def test_a_bridge_that_speaks_in_other_units_is_refused(units: str) -> None:
    """A ballbar in metres would make a deviation of 0.5 mm one of 0.0005 mm."""
    hello = f"{HELLO.replace('mm,deg,C,hPa', units)} crc=1"
    with (
        ExpectedDevice([(ASKED, line(hello))]) as device,
        pytest.raises(ProtocolError, match=r"units is .*, needed mm,deg") as caught,
    ):
        tracker(device.port).connect()
    assert "convert" in caught.value.what_to_do


def test_the_simulator_without_sums() -> None:
    with CellThread(FAST, devices=("faro",)) as cell:
        cell.do("sums", on=False)
        faro = tracker(cell.port("faro"))
        faro.connect()
        faro.arm()
        assert faro.measure("T1", samples=10).target == "T1"
        assert faro.weakness
        faro.disconnect()
        cell.do("sums", on=True)
        faro.connect()
        assert not faro.weakness
        faro.disconnect()
