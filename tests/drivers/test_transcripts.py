"""Golden conversations of the three dialects, with the driver and with the simulator."""

from __future__ import annotations

import pytest

from drivers import AbbArm, CannotStop
from mocks.cell import CellThread
from mocks.cell_file import CellFile
from mocks.shared.mbp import line
from tests.drivers.expected import (
    CALSRV_BACKGROUND,
    CALSRV_MAIN,
    CALSRV_REFUSALS,
    MBP_MEASURE,
    OPEN_ABB_CLIENT,
    STOCK_MOVE,
    ExpectedDevice,
    Pair,
    converse,
    shapes,
)
from tests.drivers.instrument_bench import FARO

TARGET = (10.12345, -5.0, 0.0, 0.0, 0.0, 90.0)
FAST = CellFile(time_scale=10_000.0, effects=("none",))

MEASURE_REQUEST = line("6 MEASURE samples=10 rate=100.0 timeout=5.1 face=1 target=T1")
MEASURE_REPLY = line(
    "6 OK x=300.0 y=400.0 z=0.0 sx=0.01 sy=0.02 sz=0.01 n=10 t=12.5 age=0.0 az=53.13 el=0.0 r=500.0 sr=0.001 "
    "status=0 temp=21.89 P=1013.2 H=45.0 mode=IFM_ADM face=1 target=T1"
)
MBP_FULL: list[Pair] = [
    *MBP_MEASURE,
    (line("5 MODE distance=IFM_ADM"), line("5 OK")),
    (MEASURE_REQUEST, line("6 ACK eta=1.0") + MEASURE_REPLY),
]


def test_driver_speaks_stock_open_abb() -> None:
    with ExpectedDevice(STOCK_MOVE) as device:
        arm = AbbArm(f"tcp://127.0.0.1:{device.port}")
        arm.connect()
        assert not arm.can_stop
        arm.arm()
        reached = arm.move_to(TARGET)
        assert reached.joints_deg == (10.12, -5.0, 0.0, 0.0, 0.0, 90.0)
        assert reached.resolution_deg == 0.01
        with pytest.raises(CannotStop):
            arm.stop()
        arm.disconnect()


def test_an_answer_that_was_damaged_is_not_the_position() -> None:
    """A tenth of a degree became nine, which is within all limits: only asking again shows it."""
    damaged = (b"4 #", b"4 1 10.92 -5.00 0.00 0.00 0.00 90.00")
    moved = STOCK_MOVE.index((b"4 #", b"4 1 10.12 -5.00 0.00 0.00 0.00 90.00"))
    with ExpectedDevice([*STOCK_MOVE, damaged, STOCK_MOVE[-1], *STOCK_MOVE[moved:]]) as device:
        arm = AbbArm(f"tcp://127.0.0.1:{device.port}")
        arm.connect()
        arm.arm()
        arm.move_to(TARGET)
        assert arm.position().joints_deg == (10.12, -5.0, 0.0, 0.0, 0.0, 90.0)
        arm.disconnect()


def test_driver_speaks_calsrv() -> None:
    with ExpectedDevice(CALSRV_MAIN) as main, ExpectedDevice(CALSRV_BACKGROUND) as back:
        arm = AbbArm(f"tcp://127.0.0.1:{main.port}?background={back.port}")
        arm.connect()
        assert arm.can_stop
        arm.arm()
        assert arm.move_to(TARGET).joints_deg == TARGET
        arm.stop()
        arm.disconnect()


def test_driver_speaks_mbp() -> None:
    reading = FARO.read(MBP_FULL, "T1")
    assert reading.xyz_mm == (300.0, 400.0, 0.0)
    assert reading.std_mm == (0.01, 0.02, 0.01)
    assert (reading.samples, reading.t_s, reading.age_s) == (10, 12.5, 0.0)
    assert (reading.t_air_c, reading.pressure_hpa, reading.humidity_percent) == (21.89, 1013.2, 45.0)
    assert reading.raw + b"\n" == MEASURE_REPLY


def test_the_answer_to_an_earlier_question_is_no_reading() -> None:
    late = MEASURE_REPLY[: MEASURE_REPLY.rindex(b"*")].replace(b"6 OK x=300.0", b"5 OK x=310.0").decode()
    later = (MEASURE_REQUEST, line("6 ACK eta=1.0") + line(late) + MEASURE_REPLY)
    reading = FARO.read([*MBP_FULL[:-1], later], "T1")
    assert reading.xyz_mm == (300.0, 400.0, 0.0)


def test_stock_simulator_speaks_open_abb() -> None:
    with CellThread(FAST, stock=True) as cell:
        converse(cell.port("abb"), OPEN_ABB_CLIENT)


def test_stock_simulator_serves_the_drivers_conversation() -> None:
    with CellThread(FAST, stock=True) as cell:
        converse(cell.port("abb"), STOCK_MOVE)


def test_calsrv_simulator() -> None:
    with CellThread(FAST) as cell:
        converse(cell.port("abb"), CALSRV_MAIN + CALSRV_REFUSALS)
        converse(cell.port("abb-background"), CALSRV_BACKGROUND)


def test_calsrv_simulator_answers_questions_of_open_abb() -> None:
    asked = (b"0 #", b"55 #")
    old = [pair for pair in OPEN_ABB_CLIENT if pair[0] in asked]
    assert {pair[0] for pair in old} == set(asked)
    with CellThread(FAST) as cell:
        converse(cell.port("abb"), [*old, (b"4 #", b"4 1 0.00 0.00 0.00 0.00 0.00 0.00")])


def test_faro_simulator() -> None:
    with CellThread(FAST) as cell:
        converse(cell.port("faro"), MBP_MEASURE, same=shapes)


def test_faro_simulator_measures() -> None:
    pairs = [*MBP_MEASURE, (line("5 MODE distance=IFM_ADM"), line("5 OK"))]
    with CellThread(FAST) as cell:
        converse(
            cell.port("faro"), [*pairs, (MEASURE_REQUEST, line("6 ACK eta=1.0") + MEASURE_REPLY)], same=shapes
        )
