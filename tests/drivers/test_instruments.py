"""Common behaviour of all instrument drivers, on every wire.

Arming, states, odd readings, stop.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Iterator
from typing import Any

import pytest

from drivers import (
    Busy,
    ConfigError,
    EmergencyStop,
    InstrumentDeadlines,
    LinkError,
    MotionStopped,
    NoisyMeasurement,
    NotArmed,
    NotReady,
    OutOfRange,
    ProtocolError,
    TargetNotSeen,
)
from mocks.cell import CellThread
from tests.drivers.instrument_bench import BENCHES, Bench
from tests.drivers.waiting import PATIENCE_S, in_thread, until


@pytest.fixture(params=list(BENCHES))
def bench(request: pytest.FixtureRequest) -> Bench:
    return BENCHES[request.param]


@pytest.fixture
def cell(bench: Bench) -> Iterator[CellThread]:
    with bench.cell(10_000.0) as cell:
        yield cell


def test_is_a_meter_says_what_it_is_and_warns_once(
    bench: Bench, cell: CellThread, caplog: pytest.LogCaptureFixture
) -> None:
    meter = bench.open(cell.url(bench.driver))
    assert isinstance(meter, bench.meter)
    assert meter.unverified_on_hardware
    with caplog.at_level(logging.WARNING):
        meter.connect()
        meter.connect()
    assert [each.message for each in caplog.records if "UNVERIFIED" in each.message] == [
        f"{bench.driver}: this driver is UNVERIFIED ON HARDWARE: check its first readings"
    ]
    found = meter.identify()
    assert (found.maker, found.serial, found.simulated) == bench.identity
    with pytest.raises(NotArmed):
        bench.measure(meter)
    meter.disconnect()
    with pytest.raises(LinkError):
        meter.identify()


TRACKER: list[tuple[dict[str, Any], type[Exception]]] = [
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
]
ODD: dict[str, list[tuple[dict[str, Any], type[Exception]]]] = {
    "faro": TRACKER,
    "leica": TRACKER,
    "emscon": [
        ({"status": 10013}, NoisyMeasurement),
        ({"status": 4711}, TargetNotSeen),
        ({"mode": 1}, NoisyMeasurement),
        ({"sx": 0.9}, NoisyMeasurement),
        ({"x": 0.0, "y": 0.0, "z": 0.0}, ProtocolError),
        ({"x": math.nan}, ProtocolError),
        ({"y": math.inf}, ProtocolError),
        ({"T": math.nan}, ProtocolError),
    ],
    "ctrack": [
        ({"frames": 3}, NoisyMeasurement),
        ({"age": 5.0}, NoisyMeasurement),
        ({"t": -1.0}, NoisyMeasurement),
        ({"sx": 0.9}, NoisyMeasurement),
        ({"srot": 9.0}, NoisyMeasurement),
        ({"rms": 3.0}, NoisyMeasurement),
        ({"rvisible": 11}, TargetNotSeen),
        ({"model": "T2"}, ProtocolError),
        ({"ref": "T2"}, ProtocolError),
        ({"visible": 21}, ProtocolError),
        ({"q0": 0.9, "q1": 0.9}, ProtocolError),
        ({"q0": "nan"}, ProtocolError),
        ({"x": 0.0, "y": 0.0, "z": 0.0}, ProtocolError),
        ({"x": "inf"}, ProtocolError),
    ],
    "qc20w": [
        ({"n": 3}, NoisyMeasurement),
        ({"age": 5.0}, NoisyMeasurement),
        ({"t": -1.0}, NoisyMeasurement),
        ({"sd": 0.1}, NoisyMeasurement),
        ({"over": 1}, OutOfRange),
        ({"d": -1.2}, OutOfRange),
        ({"d": "nan"}, ProtocolError),
        ({"d": 1e6}, ProtocolError),
        ({"temp": 300.0}, ProtocolError),
        ({"base": "B2"}, ProtocolError),
    ],
}


@pytest.mark.parametrize(
    ("bench", "fields", "error"),
    [
        pytest.param(BENCHES[driver], *odd, id=f"{driver}-{odd[0]}")
        for driver, rows in ODD.items()
        for odd in rows
    ],
)
def test_impossible_readings_are_void(
    bench: Bench, cell: CellThread, fields: dict[str, Any], error: type[Exception]
) -> None:
    meter = bench.armed(cell)
    bench.measure(meter)
    cell.do(bench.odd, fields=fields)
    with pytest.raises(error) as caught:
        bench.measure(meter)
    assert caught.value.device == bench.driver  # type: ignore[attr-defined]
    if error is ProtocolError:  # nothing more is believed on that connection
        with pytest.raises((LinkError, NotArmed)):
            bench.measure(meter)
        meter.connect()
        meter.arm()
    bench.measure(meter)
    meter.disconnect()


WEATHER = {"what": "weather", "on": False}


@pytest.mark.parametrize(
    ("driver", "state", "error"),
    [
        *((driver, "WARMING", NotReady) for driver in ("faro", "leica", "emscon", "ctrack")),
        *((driver, "ERROR", NotReady) for driver in ("faro", "leica", "emscon", "ctrack")),
        *((driver, "no weather", NotReady) for driver in ("faro", "leica", "emscon")),
        *((driver, "ESTOP", EmergencyStop) for driver in ("faro", "leica", "ctrack")),
    ],
)
def test_waits_for_a_ready_instrument(driver: str, state: str, error: type[Exception]) -> None:
    bench = BENCHES[driver]
    with bench.cell(10_000.0) as cell:
        meter = bench.armed(cell)
        cell.do(**(WEATHER if state == "no weather" else {"what": bench.state, "state": state}))
        with pytest.raises(error):
            bench.measure(meter)
        with pytest.raises(error):
            meter.arm()
        meter.disconnect()


@pytest.mark.parametrize("driver", ["faro", "leica", "emscon", "ctrack"])
def test_arm_initialises_what_is_off(driver: str) -> None:
    bench = BENCHES[driver]
    with bench.cell(10_000.0) as cell:
        cell.do(bench.state, state="OFF")
        meter = bench.open(cell.url(driver))
        meter.connect()
        assert meter.status().state == "OFF"
        meter.arm()
        assert meter.status().state == "READY"
        meter.disconnect()


def test_questions_that_are_not_asked(bench: Bench, cell: CellThread) -> None:
    meter = bench.armed(cell)
    with pytest.raises(ConfigError):
        bench.measure(meter, samples=0)
    if not bench.pointed:  # else no name goes over the wire
        with pytest.raises(ConfigError):
            meter.measure("T1 x=0", **bench.asked)
    bench.measure(meter)
    meter.disconnect()


def test_stop_and_loss_end_a_pending_reading_and_a_second_client_is_refused(bench: Bench) -> None:
    with bench.cell(1.0) as cell:
        meter = bench.armed(cell)
        second = bench.open(cell.url(bench.driver), deadlines=InstrumentDeadlines(takeover_s=0.1))
        with pytest.raises(Busy):
            second.connect()
        ends: list[tuple[Any, type[Exception]]] = [(meter.stop, MotionStopped)]
        if bench.loss is not None:
            order, error = bench.loss
            ends.append((lambda: cell.do(order), error))
        for interrupt, error in ends:
            meter.arm()
            reading = in_thread(lambda: bench.measure(meter, samples=1000))
            until(lambda: cell.cell and bench.busy(cell.cell))
            interrupt()
            with pytest.raises(error):
                reading.result(PATIENCE_S)
        meter.disconnect()
